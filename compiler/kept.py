"""What is costly to make and the same for every text, kept from one process to the next by whoever has a place for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Thing = TypeVar("Thing")


class Shelf(Protocol):
    """Where things are kept by a key; `fetch` gives None for what is not there."""

    def key_of(self, *parts: object) -> str: ...
    def fetch(self, key: str) -> object: ...
    def keep(self, key: str, value: object) -> None: ...


_shelves: list[Shelf] = []


def keep_on(shelf: Shelf) -> None:
    """From now on things are kept there."""
    _shelves[:] = [shelf]


def kept(kind: type[Thing], content: str, make: Callable[[str], Thing]) -> Thing:
    """What `make` makes of a content: from the shelf if it is there, else made and kept."""
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
