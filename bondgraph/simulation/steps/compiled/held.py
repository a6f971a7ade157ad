"""Constraints in machine code, as `constraints.py` asks for them: many instants in one call."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ....door import Program, record_of
from ...segments import mode_size
from .holding import Held, Square
from .run import addresses_of, machine_code, structure
from .squares import square

if TYPE_CHECKING:
    from ...closed.constraints import Constraints

_POINTER = ctypes.c_void_p
_COUNT = ctypes.c_int64


def fields_of(program: Program, inputs: Any, constants: Any, magnitude: Any, taking: Any) -> dict[str, Any]:
    """The fields of a `Held`; `taking`: which gaps take part. Empty where a program has no constraints."""
    count, full = len(program.states.names), len(program.states.names) + len(program.unknowns.names)
    gaps = len(program.multipliers)
    rows, columns = program.invariant_pattern
    rates = np.asarray(program.rates, dtype=int)
    lengths = [u == "m" for u in program.invariants.units]
    bound = [count + m for m in program.eliminated]
    squares = {
        name: square(rows, columns, chosen, lengths)
        for name, chosen in (("positions", np.flatnonzero(taking)), ("speeds", rates[taking & (rates >= 0)]))
    }
    squares["positions"]["vector"] = squares["positions"]["fresh"].copy()
    return {
        "inputs": inputs, "constants": constants, "mode": np.zeros(mode_size(program, constants)), "active": int(gaps > 0), "n": full,
        "count": count, "gaps": gaps, "magnitude": np.array(magnitude, dtype=float), "values": np.zeros(len(program.invariants.names)),
        "slopes": np.zeros(len(rows)), "multipliers": len(bound), "place": bound, "solution": np.zeros(full + len(bound)),
        "full": np.zeros(full),
    } | squares  # fmt: skip


def record(values: dict[str, Any], addresses: Mapping[str, int]) -> tuple[Any, list[Any]]:
    """A `Held` as machine code sees it, and what it points to; `addresses`: of the functions of the program."""
    kept: list[Any] = []
    put = dict(values)
    for name in ("positions", "speeds"):
        inner = dict(values[name])
        put[name], arrays = structure(Square, inner, addresses)
        kept += [*arrays, inner]
    found, arrays = structure(Held, put, addresses)
    values |= {k: v for k, v in put.items() if k not in ("positions", "speeds")}
    return found, [*kept, *arrays]


class NothingHeld:
    """What a program without constraints has in their place: the same for all."""

    redundant = False

    def __init__(self) -> None:
        room = {name: np.zeros(0) for name in record_of(Square).fields} | {"rows": 0, "below": 0, "weakest": 1.0}
        values: dict[str, Any] = {name: np.zeros(0) for name in record_of(Held).fields}
        values |= {
            "active": 0,
            "n": 0,
            "count": 0,
            "gaps": 0,
            "multipliers": 0,
            "positions": dict(room),
            "speeds": dict(room),
        }
        self.record, self._kept = record(values, {})

    def put_mode(self, mode: Any) -> None:
        """It reads none."""


@lru_cache
def nothing_held() -> NothingHeld:
    """The one of them."""
    return NothingHeld()


class CompiledConstraints:
    """Projections and singular values at several instants; states have their index last, unknowns included."""

    def __init__(self, constraints: Constraints) -> None:
        program = constraints.program
        magnitude = constraints.magnitude
        full = np.ones(len(program.states.names) + len(program.unknowns.names))
        full[: len(magnitude)] = magnitude
        self.values = fields_of(program, constraints.inputs, constraints.constants, full, constraints.taking)
        self.redundant = not constraints.taking.all()
        self.record, self._kept = record(self.values, addresses_of(program))
        self._here = ctypes.addressof(self.record)
        code = self._code = machine_code()
        signature = (_POINTER, _COUNT, _POINTER, _POINTER, _POINTER)
        self._hold = ctypes.CFUNCTYPE(None, *signature)(code.address("hold_all"))
        self._least = ctypes.CFUNCTYPE(None, *signature)(code.address("least_all"))
        self._rates = ctypes.CFUNCTYPE(None, *signature, _POINTER)(code.address("rates_all"))

    def put_mode(self, mode: Any) -> None:
        """The mode for what machine code asks of them by itself."""
        self.values["mode"][:] = mode

    def hold(self, times: Any, states: Any, mode: Any) -> tuple[Any, Any]:
        """The states on their invariants, and how many rows nearly hang together at each."""
        self.values["mode"][:] = mode
        times, states = np.ascontiguousarray(times, dtype=float), np.array(states, dtype=float)
        weak = np.zeros(len(times), dtype=np.int64)
        self._hold(self._here, len(times), times.ctypes.data, states.ctypes.data, weak.ctypes.data)
        return states, weak

    def least(self, times: Any, states: Any, mode: Any) -> Any:
        """The smallest singular value of the gaps' slopes at each."""
        self.values["mode"][:] = mode
        times, states = np.ascontiguousarray(times, dtype=float), np.ascontiguousarray(states, dtype=float)
        out = np.empty(len(times))
        self._least(self._here, len(times), times.ctypes.data, states.ctypes.data, out.ctypes.data)
        return out

    def rates(self, times: Any, scaled: Any, unknowns: Any, mode: Any) -> tuple[Any, Any]:
        """Rates of the states at their projections, in units of the magnitudes, and how many rows nearly hang together at each."""
        self.values["mode"][:] = mode
        self.values["full"][self.values["count"] :] = unknowns
        times, scaled = np.ascontiguousarray(times, dtype=float), np.ascontiguousarray(scaled, dtype=float)
        out, weak = np.empty_like(scaled), np.zeros(len(times), dtype=np.int64)
        self._rates(self._here, len(times), times.ctypes.data, scaled.ctypes.data, out.ctypes.data, weak.ctypes.data)
        return out, weak
