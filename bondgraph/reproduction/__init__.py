"""A folder of models with a list of published values: everything is computed again, and a page says how well it agrees."""

from .reproduce import reproduce

__all__ = ["reproduce"]
