"""Persistent cache for results that are costly and independent of the text, if a caller provides a place for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Thing = TypeVar("Thing")


class CacheBackend(Protocol):
    """Cache backend: values by key. `fetch` returns None for a missing key."""

    def key_of(self, *parts: object) -> str: ...
    def fetch(self, key: str) -> object: ...
    def keep(self, key: str, value: object) -> None: ...


_backends: list[Callable[[], CacheBackend]] = []


def keep_on(backend: Callable[[], CacheBackend]) -> None:
    """Set the cache backend, which is fetched when it is first needed."""
    _backends[:] = [backend]


def kept(kind: type[Thing], content: str, make: Callable[[str], Thing]) -> Thing:
    """Result of `make` for a content: from the cache if it is there, else computed and stored."""
    if not _backends:
        return make(content)
    backend = _backends[0]()
    key = backend.key_of(kind.__name__, content)
    found = backend.fetch(key)
    if isinstance(found, kind):
        return found
    made = make(content)
    backend.keep(key, made)
    return made
