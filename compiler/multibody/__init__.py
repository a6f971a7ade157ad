"""A mechanism as one multiport: efforts in, flows and coordinates out."""

from .mechanics import mechanism_equations
from .motion import MechanismEquations, PortMotion
from .tree import drivable

__all__ = ["MechanismEquations", "PortMotion", "drivable", "mechanism_equations"]
