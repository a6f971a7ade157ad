"""A program as plain data beside its object code: both can be cached, and bound to arrays again without compilation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ...native.machine import MachineCode
from ...nouns import dataclass
from ..program import HYBRID, HybridNote, LimitNote, Names, Native, Program, TimeFunctions, hybrid_of


class Rows(NamedTuple):
    """Data that the kernels of a module read: rows of 32-bit integers, and the numbers in which instances differ."""

    suffix: str
    streams: bytes
    numbers: bytes


@dataclass(frozen=True, slots=True)
class Described:
    """All of a program except its functions: plain data that can be cached beside the object code."""

    name: str
    source: str
    names: dict[str, Names]
    defaults: tuple[float, ...]
    input_defaults: tuple[float, ...]
    pattern: tuple[tuple[int, ...], tuple[int, ...]]
    sensitivity_pattern: tuple[tuple[int, ...], tuple[int, ...]]
    invariant_pattern: tuple[tuple[int, ...], tuple[int, ...]]
    of_invariants: tuple[
        tuple[int, ...], tuple[int, ...], tuple[int, ...], tuple[int, ...]
    ]  # multipliers, rates, parts, eliminated
    limits: tuple[LimitNote, ...]
    operations: int
    differentiated: int
    functions: tuple[tuple[str, tuple[str, ...], int], ...]  # name, arguments, number of values
    rows: tuple[Rows, ...] = ()  # data that the kernels read
    hybrid: HybridNote | None = None
    time_functions: TimeFunctions | None = None

    def without_source(self) -> Described:
        """The same without the readable text, which is its largest part."""
        return replace(self, source="")


def bind(described: Described, codes: Sequence[bytes]) -> Program:
    """Program from its data and object code."""
    import numpy as np

    from .evaluate import dense, functions, hand_over, mode_at

    machine = MachineCode(*codes)
    names = described.names
    for rows in described.rows:
        hand_over(machine, rows)
    native = Native(machine.addresses(name for name, _, _ in described.functions), machine)
    found = functions(described.functions, native.addresses, machine)
    pattern, slopes, held = (
        tuple(np.array(part, dtype=int) for part in pair)
        for pair in (described.pattern, described.sensitivity_pattern, described.invariant_pattern)
    )
    multipliers, rates, parts, eliminated = described.of_invariants
    count = len(names["STATES"].names) + len(names["UNKNOWNS"].names)
    given: dict[str, Any] = {
        "name": described.name, "source": described.source, "states": names["STATES"], "unknowns": names["UNKNOWNS"],
        "outputs": names["OUTPUTS"], "inputs": names["INPUTS"], "parameters": names["PARAMETERS"], "dependents": names["DEPENDENTS"],
        "defaults": described.defaults, "input_defaults": described.input_defaults, "pattern": pattern, "sensitivity_pattern": slopes,
        "jacobian": dense(found["jacobian_entries"], pattern, count), "limits": described.limits,
        "invariants": names["INVARIANTS"], "invariant_pattern": held,
        "multipliers": multipliers, "rates": rates, "parts": parts, "eliminated": eliminated, "solved": None,
        "operations": described.operations, "differentiated": described.differentiated, "native": native,
        "time_functions": described.time_functions,
    }  # fmt: skip
    note = described.hybrid
    if note is not None:
        found["mode_at"] = mode_at(note, found)
        given["hybrid"] = hybrid_of(note, found)
    given |= {name: function for name, function in found.items() if name not in (*HYBRID, "mode_at")}
    return Program(**given)
