"""Types of the subset, from the annotations of functions and records."""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import prod
from typing import Any, NamedTuple, get_args

from ..fast_dataclass import dataclass
from .arrays import Record

FLOAT, INT, BOOL, NOTHING = "double", "i64", "i1", "void"
FLOATS, INTS, WORDS, BYTES = "floats", "ints", "words", "bytes"
WORD, BYTE = "i32", "i8"  # items of `ShortInts` and `Bytes`: integers as soon as they are read
_WORDS = {
    "float": FLOAT,
    "int": INT,
    "bool": BOOL,
    "Floats": FLOATS,
    "Numbers": FLOATS,
    "Ints": INTS,
    "ShortInts": WORDS,
    "Bytes": BYTES,
    "None": NOTHING,
}
ITEMS = {FLOATS: FLOAT, INTS: INT, WORDS: WORD, BYTES: BYTE}
WIDENED = {WORD: "sext", BYTE: "zext"}  # instructions that make integers of items


# Disjoint kinds of memory: records and arrays never overlap, nor do numbers and pointers.
MEMORIES = ("field double", "field i64", "field ptr", "item double", "item i64", "item i32", "item i8")


class TranslationError(TypeError):
    """A line is outside of the subset."""


@dataclass(frozen=True)
class Fields:
    """Type of a record: its fields in order, each eight bytes wide."""

    name: str
    fields: dict[str, Any]

    def place(self, name: str) -> int:
        """Number of a field."""
        return list(self.fields).index(name)


@dataclass(frozen=True)
class Handed:
    """Type of a function that is passed as an argument."""

    arguments: tuple[Any, ...]
    result: Any


class Value(NamedTuple):
    """Type and text of a value; for an address, the kind of memory (of `MEMORIES`), if any."""

    kind: Any
    text: str
    memory: str = ""


def kind_of(annotation: Any, home: dict[str, Any]) -> Any:
    """Type of an annotation, in the namespace of its function or record."""
    if getattr(annotation, "__forward_arg__", None):
        annotation = annotation.__forward_arg__
    if annotation is None or annotation is type(None):
        return NOTHING
    if annotation in (float, int, bool):
        return _WORDS[annotation.__name__]
    if isinstance(annotation, str):
        if annotation in _WORDS:
            return _WORDS[annotation]
        annotation = home.get(annotation)
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return record_of(annotation)
    arguments = get_args(annotation)
    if len(arguments) == 2 and isinstance(arguments[0], list):
        return Handed(tuple(kind_of(a, home) for a in arguments[0]), kind_of(arguments[1], home))
    raise TranslationError(f"`{annotation}` is no type of the subset")


_KNOWN: dict[type, Fields] = {}


def record_of(noun: type) -> Fields:
    if noun not in _KNOWN:
        home = vars(sys.modules[noun.__module__])
        _KNOWN[noun] = Fields(noun.__name__, {n: kind_of(a, home) for n, a in noun.__annotations__.items()})
    return _KNOWN[noun]


def zeros_of(noun: type[Record], **numbers: int) -> dict[str, Any]:
    """Return the fields with which a record begins: these numbers, others 0, and arrays of zeros. Records, functions, and arrays whose size the record
    does not give are not among them. `numbers`: also such that only sizes need."""
    import numpy as np

    kinds = record_of(noun).fields
    values: dict[str, Any] = {name: 0 for name, kind in kinds.items() if kind in (FLOAT, INT)} | numbers
    fields = {name: values[name] for name in kinds if name in values}
    for name, (factors, plus) in ((n, vars(noun)[n]) for n in kinds if n in vars(noun)):
        size = prod(f if isinstance(f, int) else values[f] for f in factors) + plus
        fields[name] = np.zeros(size, dtype=np.int64 if kinds[name] == INTS else float)
    return fields


def text_of(kind: Any) -> str:
    """The type in LLVM's notation."""
    return kind if kind in (FLOAT, INT, BOOL, WORD, BYTE, NOTHING) else "ptr"


def signature(function: Callable[..., Any]) -> tuple[tuple[Any, ...], Any]:
    """Types of a function's arguments and of its result."""
    kinds = {n: kind_of(a, function.__globals__) for n, a in function.__annotations__.items()}
    result = kinds.pop("return")
    return tuple(kinds.values()), result
