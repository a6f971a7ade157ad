"""Text to syntax tree."""

from .parse import parse, parse_expression, parse_law, parse_what_can_be_read
from .tree import SyntaxTree

__all__ = ["SyntaxTree", "parse", "parse_expression", "parse_law", "parse_what_can_be_read"]
