"""Types of the subset: arrays, which are numpy arrays in Python and bare addresses in machine code; and records of them."""

from __future__ import annotations

from typing import Any, Protocol, overload


class Floats(Protocol):
    """An array of doubles."""

    @overload
    def __getitem__(self, place: int) -> float: ...
    @overload
    def __getitem__(self, place: slice) -> Floats: ...
    def __setitem__(self, place: int, value: float) -> None: ...


class Ints(Protocol):
    """An array of 64-bit integers."""

    @overload
    def __getitem__(self, place: int) -> int: ...
    @overload
    def __getitem__(self, place: slice) -> Ints: ...
    def __setitem__(self, place: int, value: int) -> None: ...


class ShortInts(Protocol):
    """An array of 32-bit integers, as a library of C is given; its items count as 64-bit integers."""

    def __getitem__(self, place: int) -> int: ...
    def __setitem__(self, place: int, value: int) -> None: ...


class Bytes(ShortInts, Protocol):
    """An array of bytes: a text or truth values of C; its items count as 64-bit integers from 0 to 255."""


Numbers = tuple[float, ...]  # a literal list in the source


def sized(*factors: int | str, plus: int = 0) -> Any:
    """Return the size of an array that begins with its record, for `kinds.zeros_of`: the product of numbers, and `plus`. A text names a number."""
    return factors, plus


class Record:
    """Common data of several functions: a class whose annotations are its fields, in this order, each eight bytes wide.

    It is no dataclass: making one with a hundred fields would take longer than all other work.
    """

    def __init__(self, **fields: object) -> None:
        for name in self.__annotations__:
            setattr(self, name, fields.pop(name))
        if fields:
            raise TypeError(f"no fields: {', '.join(fields)}")
