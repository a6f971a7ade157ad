"""Fields of a result that are found when they are first read: most runs among many are read for their values alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Later:
    """Value of a field to be, by a function of nothing, which is called once."""

    __slots__ = ("_find",)

    def __init__(self, find: Callable[[], Any]) -> None:
        self._find = find

    def value(self) -> Any:
        """Find the value."""
        with np.errstate(all="ignore"):  # a run may end where a quantity has no value
            return self._find()


def later(find: Callable[[], Any], now: bool = False) -> Any:
    """Return the value of a field that is found at its first use, or `now`; as any type, which is that of the field."""
    value = Later(find)
    return value.value() if now else value


class LaterField:
    """Default of a field of a dataclass that may be given as `later`."""

    def __init__(self, default: Any) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, holder: Any, owner: type) -> Any:
        if holder is None:
            return self._default
        value = holder.__dict__[self._name]
        if type(value) is Later:
            value = holder.__dict__[self._name] = value.value()
        return value

    def __set__(self, holder: Any, value: Any) -> None:
        holder.__dict__[self._name] = value
