"""Text to syntax tree."""

from .parse import parse
from .tree import SyntaxTree

__all__ = ["SyntaxTree", "parse"]
