"""A program as plain data beside its functions, which a target supplies: the data can be cached with object code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from ..fast_dataclass import dataclass
from .program import HYBRID, Delays, Hybrid, HybridNote, LimitNote, NameTable, Native, Program, TimeFunctions


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
    signal_constants: tuple[int, ...] = ()

    def without_source(self) -> ProgramImage:
        """The same without the readable text, which is its largest part."""
        return replace(self, source="")


def program_of(
    image: ProgramImage, functions: Mapping[str, Callable[..., Any]], native: Native | None = None
) -> Program:
    """Program from its data, and its functions by name: `constants`, `jacobian`, `mode_at` if it has events, and those of the table."""
    names = image.names
    pattern, slopes, invariant_slopes = (
        tuple(np.array(part, dtype=int) for part in pair)
        for pair in (image.pattern, image.sensitivity_pattern, image.invariant_pattern)
    )
    multipliers, rates, parts, eliminated = image.of_invariants
    count = next((size for name, _, size in image.functions if name == "lags"), 0)
    given: dict[str, Any] = {
        "name": image.name, "source": image.source, "states": names["STATES"], "unknowns": names["UNKNOWNS"],
        "outputs": names["OUTPUTS"], "inputs": names["INPUTS"], "parameters": names["PARAMETERS"], "dependents": names["DEPENDENTS"],
        "jumping": names.get("FORCED", NameTable((), ())),
        "defaults": image.defaults, "input_defaults": image.input_defaults, "pattern": pattern, "sensitivity_pattern": slopes,
        "limits": image.limits, "invariants": names["INVARIANTS"], "invariant_pattern": invariant_slopes,
        "multipliers": multipliers, "rates": rates, "parts": parts, "eliminated": eliminated, "solved": None,
        "operations": image.operations, "differentiated": image.differentiated, "native": native,
        "time_functions": image.time_functions, "signal_constants": image.signal_constants, "functions": functions,
        "delays": Delays(count, functions["lags"], functions["delayed"]) if count else None,
        "hybrid": None if image.hybrid is None else _hybrid(image.hybrid, functions),
    }  # fmt: skip
    named = Program.__dataclass_fields__.keys() - set(HYBRID)
    return Program(**given | {name: function for name, function in functions.items() if name in named})


def _hybrid(note: HybridNote, functions: Mapping[str, Callable[..., Any]]) -> Hybrid:
    return Hybrid(*(getattr(note, f.name) for f in fields(note)), *(functions[name] for name in HYBRID))
