"""Persistent cache for results that are costly and independent of the text, if a caller provides a place for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Thing = TypeVar("Thing")


class Shelf(Protocol):
    """Cache backend: values by key. `fetch` returns None for a missing key."""

    def key_of(self, *parts: object) -> str: ...
    def fetch(self, key: str) -> object: ...
    def keep(self, key: str, value: object) -> None: ...


_shelves: list[Shelf] = []


def keep_on(shelf: Shelf) -> None:
    """Set the cache backend."""
    _shelves[:] = [shelf]


def kept(kind: type[Thing], content: str, make: Callable[[str], Thing]) -> Thing:
    """Result of `make` for a content: from the cache if it is there, else computed and stored."""
    if not _shelves:
        return make(content)
    shelf = _shelves[0]
    key = shelf.key_of(kind.__name__, content)
    found = shelf.fetch(key)
    if isinstance(found, kind):
        return found
    made = make(content)
    shelf.keep(key, made)
    return made
