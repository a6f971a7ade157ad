"""Bond graph to causal graph: a causal stroke on every bond, each with its reason."""

from .assign import CausalGraph, assign_causality
from .dependence import Dependence, dependences
from .strokes import StrokeReason

__all__ = ["CausalGraph", "Dependence", "StrokeReason", "assign_causality", "dependences"]
