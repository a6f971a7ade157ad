"""Records of the source where there is no machine code: objects of Python that hold numpy arrays, with the interface of `record_layout.RecordArray`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from compiler.api import Array, Handed, Program, Record, record_of

from ..linear_algebra.factorise import sparse
from ..linear_algebra.sparse import Pattern
from .in_numpy import interpreted
from .record_layout import RecordArray, form_of


class Plain:
    """A record, and its fields by their names."""

    def __init__(self, noun: type[Record], values: Mapping[str, Any]) -> None:
        self.record: Any = object.__new__(noun)
        self.put(values)

    @property
    def address(self) -> Any:
        """The argument of the functions of the source."""
        return self.record

    def put(self, values: Mapping[str, Any]) -> None:
        """Set fields."""
        for name, value in values.items():
            setattr(self.record, name, _plain(value))

    def call(self, source: str, *arguments: Any) -> Any:
        """Call a function of the source on this record, with integers and arrays."""
        function = interpreted(source, self.record.n, getattr(self.record, "sparse", 0))
        return function(self.record, *(a.reshape(-1) if isinstance(a, np.ndarray) else a for a in arguments))

    def __getitem__(self, name: str) -> Any:
        return getattr(self.record, name)

    def __setitem__(self, name: str, value: Array | float) -> None:
        self.put({name: value})


def _plain(value: Array) -> Any:
    """Return a value of a field as the source reads it: records as objects, lists as arrays."""
    if isinstance(value, Mapping):
        return SimpleNamespace(**{name: _plain(inner) for name, inner in value.items()})
    if isinstance(value, list):
        return np.array(value, dtype=np.int64)
    return value.record if isinstance(value, Plain) else value


def record_for(
    noun: type[Record], program: Program, key: object, room: Callable[[], Mapping[str, Any]], given: Mapping[str, Any], native: bool
) -> RecordArray | Plain:  # fmt: skip
    """Return a record of machine code if `native`, else of Python; `room`: fields that depend on the program and the key alone."""
    if native:
        return RecordArray(form_of(noun, program, key, room), given)
    return Plain(noun, {**functions_of(noun, program), **room(), **given})


def functions_of(noun: type[Record], program: Program) -> dict[str, Callable[..., None]]:
    """Return the functions of a program that a record names, for calls by the source: values go into an argument."""
    functions: dict[str, Callable[..., None]] = {}
    count = len(program.states.names) + len(program.unknowns.names)
    for name, kind in record_of(noun).fields.items():
        if isinstance(kind, Handed):
            owner = program.hybrid if name == "roots" else program
            function: Any = getattr(owner, "jacobian_entries" if name == "entries" else name, None)
            functions[name] = _into(_of_time(function) if name == "signals" else function, count)
    return functions


def _into(function: Callable[..., Any], count: int) -> Callable[..., None]:
    """Wrap a function of `count` states and unknowns, which may be the first numbers of a longer array; an absent one is never called."""

    def call(time: float, state: Array, inputs: Array, constants: Array, mode: Array, out: Array) -> None:
        values = function(time, state[:count], inputs, constants, mode)
        out[: len(values)] = values

    return call


def _of_time(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda time, state, inputs, constants, mode: function(time, inputs, constants, mode)


class Unordered:
    """Pattern of sparse factors without an order of pivots: SuperLU chooses it by the numbers. The interface of `run.Ordered`."""

    def __init__(self, program: Program) -> None:
        differential, n = len(program.states.names), len(program.states.names) + len(program.unknowns.names)
        rows, columns = program.pattern
        self.values = Plain(Pattern, {"n": n, "tolerant": 0})
        self.record = self.values.record
        self.record.shifted_by = sparse(rows, columns, np.arange(n) < differential)

    def choose(self, shift: float, entries: Array) -> bool:
        """Return False: there is no other order."""
        return False
