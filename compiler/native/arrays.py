"""Types of what the subset works on: arrays of numpy when it runs as Python, bare addresses in machine code; and records of them."""

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


Numbers = tuple[float, ...]  # a list that stands in the source


class Record:
    """What several functions work on together: a class whose annotations are its fields, in this order, each eight bytes wide.

    No dataclass, whose making takes longer than all else for a hundred fields.
    """

    def __init__(self, **fields: object) -> None:
        for name in self.__annotations__:
            setattr(self, name, fields.pop(name))
        if fields:
            raise TypeError(f"no fields: {', '.join(fields)}")
