"""Bond graph to causal graph: strokes, and for each stroke why."""

from .assign import CausalGraph, assign_causality
from .dependence import Dependence, dependences
from .strokes import Because

__all__ = ["Because", "CausalGraph", "Dependence", "assign_causality", "dependences"]
