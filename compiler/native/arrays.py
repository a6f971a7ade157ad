"""Types of the arrays that the subset works on: numpy's when it runs as Python, bare addresses in machine code."""

from __future__ import annotations

from typing import Protocol, overload


class Floats(Protocol):
    """An array of doubles."""

    @overload
    def __getitem__(self, place: int) -> float: ...
    @overload
    def __getitem__(self, place: slice) -> Floats: ...
    def __setitem__(self, place: int, value: float) -> None: ...


class Ints(Protocol):
    """An array of whole numbers of 64 bits."""

    @overload
    def __getitem__(self, place: int) -> int: ...
    @overload
    def __getitem__(self, place: slice) -> Ints: ...
    def __setitem__(self, place: int, value: int) -> None: ...
