"""Reproduction of published values: every entry of a list in a folder is computed again, and a page shows the agreement."""

from .reproduce import reproduce

__all__ = ["reproduce"]
