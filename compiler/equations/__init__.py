"""Causal graph to equations: causally ordered assignments over shared formulas."""

from .derive import derive_equations
from .fields import notes
from .system import EquationSystem

__all__ = ["EquationSystem", "derive_equations", "notes"]
