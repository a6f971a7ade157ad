"""A program as plain data beside its object code: both can be cached, and bound to arrays again without compilation."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from ...fast_dataclass import dataclass
from ..program import HybridNote, LimitNote, NameTable, TimeFunctions


class KernelRows(NamedTuple):
    """Data that the kernels of a module read: rows of 32-bit integers, and the numbers in which instances differ."""

    suffix: str
    streams: bytes
    numbers: bytes


@dataclass(frozen=True, slots=True)
class ProgramImage:
    """All of a program except its functions: plain data that can be cached beside the object code."""

    name: str
    source: str
    names: dict[str, NameTable]
    defaults: tuple[float, ...]
    input_defaults: tuple[float, ...]
    pattern: tuple[tuple[int, ...], tuple[int, ...]]
    sensitivity_pattern: tuple[tuple[int, ...], tuple[int, ...]]
    invariant_pattern: tuple[tuple[int, ...], tuple[int, ...]]
    # multipliers, rates, parts, eliminated
    of_invariants: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    limits: tuple[LimitNote, ...]
    operations: int
    differentiated: int
    functions: tuple[tuple[str, tuple[str, ...], int], ...]  # name, arguments, number of values
    rows: tuple[KernelRows, ...] = ()  # data that the kernels read
    hybrid: HybridNote | None = None
    time_functions: TimeFunctions | None = None

    def without_source(self) -> ProgramImage:
        """The same without the readable text, which is its largest part."""
        return replace(self, source="")
