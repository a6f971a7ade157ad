"""Records of the source where there is no machine code: objects of Python that hold numpy arrays, with the interface of `record_layout.RecordArray`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from compiler.api import Program, Record

from ..factorise import sparse
from .record_layout import RecordArray, form_of
from .sparse import Pattern


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
            setattr(self.record, name, value.record if isinstance(value, Plain) else value)

    def __getitem__(self, name: str) -> Any:
        return getattr(self.record, name)

    def __setitem__(self, name: str, value: Any) -> None:
        self.put({name: value})


def record_for(
    noun: type[Record], program: Program, room: Callable[[], Mapping[str, Any]], given: Mapping[str, Any]
) -> RecordArray | Plain:
    """Return a record of machine code, or of Python if the program has none; `room`: fields that depend on the program alone."""
    if program.native is not None:
        return RecordArray(form_of(noun, program, "", room), given)
    functions = {"derivative": program.derivative, "entries": program.jacobian_entries}
    if program.hybrid is not None:
        functions["roots"] = program.hybrid.roots
    return Plain(noun, {**room(), **given} | {name: into(function) for name, function in functions.items()})


def into(function: Callable[..., Any]) -> Callable[..., None]:
    """Wrap a function of a program for the call by the source: values go into an argument."""

    def call(time: float, state: Any, inputs: Any, constants: Any, mode: Any, out: Any) -> None:
        found = function(time, state, inputs, constants, mode)
        out[: len(found)] = found

    return call


class Unordered:
    """Pattern of sparse factors without an order of pivots: SuperLU chooses it by the numbers. The interface of `run.Ordered`."""

    def __init__(self, program: Program) -> None:
        differential, n = len(program.states.names), len(program.states.names) + len(program.unknowns.names)
        rows, columns = program.pattern
        self.values = Plain(Pattern, {"n": n, "tolerant": 0})
        self.record = self.values.record
        self.record.shifted_by = sparse(rows, columns, np.arange(n) < differential)

    def choose(self, shift: float, entries: Any) -> bool:
        """Return False: there is no other order."""
        return False
