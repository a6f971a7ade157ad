"""A mechanism as one multiport: efforts in, flows and coordinates out."""

from .dynamics import Motion, mechanism_equations

__all__ = ["Motion", "mechanism_equations"]
