"""Bond graph to text: the way back."""

from .write import write_text

__all__ = ["write_text"]
