"""A mechanism as one multiport: efforts in, flows and coordinates out."""

from .mechanics import mechanism_equations
from .motion import MechanismEquations, Motion
from .tree import drivable

__all__ = ["MechanismEquations", "Motion", "drivable", "mechanism_equations"]
