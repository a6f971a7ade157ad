"""Bounded caches in memory: the latest entries of a dictionary, which threads may share."""

from __future__ import annotations

from typing import Any


def keep(things: dict[Any, Any], key: object, thing: object, most: int) -> None:
    """Store a value by its key, and keep only the latest ones."""
    for old in list(things)[: max(0, len(things) - most + 1)]:
        things.pop(old, None)
    things[key] = thing
