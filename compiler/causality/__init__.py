"""Bond graph to causal graph: a causal stroke on every bond, each with its reason."""

from .assign import CausalGraph, assign_causality
from .dependence import Dependence, dependences
from .strokes import Because

__all__ = ["Because", "CausalGraph", "Dependence", "assign_causality", "dependences"]
