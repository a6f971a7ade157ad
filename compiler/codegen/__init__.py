"""State space to program: one folder for each target, with one interface."""

from .program import Program

__all__ = ["Program"]
