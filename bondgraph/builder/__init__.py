"""Builder: models by calls instead of text."""

from .graph import Graph
from .mechanism import Multibody
from .parts import NamedQuantity, Part

__all__ = ["Graph", "Multibody", "NamedQuantity", "Part"]
