"""Builder: models by calls instead of text."""

from .graph import Graph
from .mechanism import Mechanism
from .parts import Part, Quantity

__all__ = ["Graph", "Mechanism", "Part", "Quantity"]
