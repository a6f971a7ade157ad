"""Handles: results of the calls of a graph, to be bonded, read and put into texts; and the names that they may have."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from compiler.api import ELEMENT_KINDS, RESERVED

from ..errors import UsageError

Head = TypeVar("Head")


def name_of(name: object) -> str:
    """Return a name of the language, with an index if it has one."""
    match = _NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise UsageError(
            "BR535", f"{name!r} is no name: letters a-z, digits and _, not a digit first, and perhaps an index, `mass[2]`",
        )  # fmt: skip
    word, index = match.groups()
    if word in RESERVED:
        raise UsageError("BR536", f"`{word}` is a word of the language and cannot be a name")
    return word if index is None else f"{word}[{', '.join(str(int(i)) for i in index.split(','))}]"


def model_name_of(name: object) -> str:
    """Return a name for a model."""
    own = name_of(name)
    if own in ELEMENT_KINDS or "[" in own:
        raise UsageError("BR537", f"`{name}` cannot be the name of a model")
    return own


_NAME = re.compile(r"([A-Za-z_][A-Za-z_0-9]*)(?:\[([0-9]{1,9}(?:, ?[0-9]{1,9})*)\])?")


class Bonding(Protocol):
    """The graph that a handle belongs to, as its handles see it."""

    name: str

    def bond(self, *places: object) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class NamedQuantity:
    """A parameter, constant, input, signal, output or slot; in an f-string it is its name, an item of a list is `gap[2]`, of a matrix `K[1, 2]`."""

    graph: Bonding
    name: str

    def __str__(self) -> str:
        return self.name

    def __getitem__(self, item: int | tuple[int, int]) -> NamedQuantity:
        """Return an item of a list, or an entry of a matrix, from 1."""
        items = item if isinstance(item, tuple) else (item,)
        if not all(isinstance(i, int) and i > 0 for i in items):
            raise UsageError("BR538", f"the items of `{self.name}` are counted from 1")
        return NamedQuantity(self.graph, f"{self.name}[{', '.join(map(str, items))}]")


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part with bonds: an element, a junction, a port, an instance; `part["x"]` is one of its ports.

    `a >> b` is the half arrow from a to b, `a >> (b, c)` are two; the expression returns its right side, so that chains can be written. In an f-string a
    part is its path: `f"{spring}.x"`.
    """

    graph: Bonding
    path: str
    ports: tuple[str, ...] | None = None  # None: only the compiler knows them

    def __str__(self) -> str:
        return self.path

    def __getitem__(self, port: str | int) -> Part:
        """Return one of its ports, or by a number one of the bonds of a multibond of a width: `body[2]`."""
        if isinstance(port, int):
            return Part(self.graph, f"{self.path}[{port}]")
        if self.ports is not None and port not in self.ports:
            known = ", ".join(self.ports) or "one, without a name"
            raise UsageError("BR539", f"`{self.path}` has no port `{port}`; its ports: {known}")
        return Part(self.graph, f"{self.path}.{name_of(port)}")

    def __rshift__(self, head: Head) -> Head:
        self.graph.bond(self, head)
        return head

    def __rrshift__(self, tails: Sequence[Part]) -> Part:
        self.graph.bond(tails, self)
        return self
