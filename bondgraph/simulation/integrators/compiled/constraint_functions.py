"""Constraints for the source of the steps, with the functions of `constraints.py`: many instants in one call."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from compiler.api import Array, BoolArray, Program

from ...segments.timeline import mode_size
from ..projection.normal_equations import square
from ..projection.projection import ProjectionWorkspace
from .plain import record_for


def fields_of(program: Program, inputs: Array, constants: Array, magnitude: Array, taking: BoolArray) -> dict[str, Any]:
    """Return the fields of a `ProjectionWorkspace`; `taking`: mask of the active constraints. Empty where a program has no constraints."""
    count, full = len(program.states.names), len(program.states.names) + len(program.unknowns.names)
    constraints = len(program.multipliers)
    rows, columns = program.invariant_pattern
    rates = np.asarray(program.rates, dtype=int)
    gaps = len(program.invariants.names) - int((rates >= 0).sum())
    lengths = [u == "m" for u in program.invariants.units]
    bound = [count + m for m in program.eliminated]
    squares = {
        name: square(rows, columns, chosen, lengths)
        for name, chosen in (("positions", np.flatnonzero(taking[:gaps])), ("velocities", rates[taking & (rates >= 0)]))
    }
    squares["positions"]["vector"] = squares["positions"]["fresh"].copy()
    return {
        "inputs": inputs, "constants": constants, "mode": np.zeros(mode_size(program, constants)), "active": int(constraints > 0), "n": full,
        "count": count, "gaps": gaps, "constraints": constraints, "magnitude": np.array(magnitude, dtype=float),
        "values": np.zeros(len(program.invariants.names)), "slopes": np.zeros(len(rows)), "multipliers": len(bound), "place": bound,
        "solution": np.zeros(full + len(bound)), "full": np.zeros(full),
    } | squares  # fmt: skip


class Invariants(Protocol):
    """Constraints of a program with the values of a run; `taking`: mask of the active constraints; `magnitude` of the states (n,)."""

    program: Program
    inputs: Any
    constants: Any
    magnitude: Any
    taking: Any

    def __bool__(self) -> bool: ...


class CompiledConstraints:
    """Projections and singular values at several instants; the index of the state is last, unknowns included. `native`: in machine code."""

    def __init__(self, constraints: Invariants, native: bool) -> None:
        program, taking = constraints.program, constraints.taking
        magnitude = np.ones(len(program.states.names) + len(program.unknowns.names))
        magnitude[: len(constraints.magnitude)] = constraints.magnitude
        given = {"inputs": constraints.inputs, "constants": constraints.constants, "magnitude": magnitude}

        def values() -> dict[str, Any]:
            found = fields_of(program, constraints.inputs, constraints.constants, magnitude, taking)
            return {name: value for name, value in found.items() if name not in given}

        self.values = record_for(ProjectionWorkspace, program, taking.tobytes(), values, given, native)
        self.native, self.redundant = native, not taking[: self.values["gaps"]].all()

    def project(self, times: Array, states: Array, mode: Array) -> tuple[Any, Any]:
        """Return the states projected on their invariants, and the number of nearly dependent rows at each."""
        self.values["mode"][:] = mode
        times, states = np.ascontiguousarray(times, dtype=float), np.array(states, dtype=float)
        weak = np.zeros(len(times), dtype=np.int64)
        self.values.call("project_all", len(times), times, states, weak)
        return states, weak

    def least_singular_values(self, times: Array, states: Array, mode: Array) -> Any:
        """Return the smallest singular value of the residuals' Jacobian at each instant."""
        self.values["mode"][:] = mode
        times, states = np.ascontiguousarray(times, dtype=float), np.ascontiguousarray(states, dtype=float)
        out = np.empty(len(times))
        self.values.call("least_singular_values", len(times), times, states, out)
        return out

    def rates(self, times: Array, scaled: Array, unknowns: Array, mode: Array) -> tuple[Any, Any]:
        """Return rates of the states at their projections, in units of the magnitudes, and the number of nearly dependent rows at each."""
        self.values["mode"][:] = mode
        self.values["full"][self.values["count"] :] = unknowns
        times, scaled = np.ascontiguousarray(times, dtype=float), np.ascontiguousarray(scaled, dtype=float)
        out, weak = np.empty_like(scaled), np.zeros(len(times), dtype=np.int64)
        self.values.call("rates_projected", len(times), times, scaled, out, weak)
        return out, weak
