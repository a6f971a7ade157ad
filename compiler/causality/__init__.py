"""Bond graph to causal graph: strokes, and for each stroke why."""

from .assign import Because, CausalGraph, assign_causality

__all__ = ["Because", "CausalGraph", "assign_causality"]
