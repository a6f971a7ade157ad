"""Text to syntax tree."""

from .parse import parse, parse_expression, parse_law
from .tree import SyntaxTree

__all__ = ["SyntaxTree", "parse", "parse_expression", "parse_law"]
