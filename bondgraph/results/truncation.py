"""Truncation report of a run with a bandwidth: the truncated modes, and an estimate of their effect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..quantities import behind
from .json_values import entries

NAMED = 3  # most modes, outputs and instants in a sentence


@dataclass(frozen=True, slots=True)
class FastMode:
    """A mode faster than the bandwidth: frequency in Hz (abs(eigenvalue)/2pi), damping ratio, elements with the largest shares in it."""

    frequency: float
    damping: float
    elements: tuple[str, ...]

    def is_like(self, other: FastMode) -> bool:
        """Return True if both count as the same mode at two instants: equal elements, and frequencies within 1 %."""
        return self.elements == other.elements and abs(self.frequency - other.frequency) <= 0.01 * other.frequency


@dataclass(frozen=True, slots=True)
class TruncationReport:
    """Truncation report of a run with a bandwidth in Hz.

    `faster`: number of faster oscillating modes (without those that decay without oscillation); `modes`: those that were truncated, at `instants` in s.
    `outputs`: largest amplitude of the truncated modes in each output of the run (SI); for an output that is proportional to the square (a power) the
    largest missing part. `kept`: upper bound on the shift of the slow solution in each output (SI); 0 if it is surely below the tolerance of the run,
    NaN (null in JSON) if unknown, with the cause in `reason`. `energy`: in J, if the run has a balance. `reason`: reason why not all, or no, modes were
    truncated; "" if there is none. All values except the bandwidth are estimates for modes that change slowly.
    """

    bandwidth: float
    faster: int = 0
    modes: tuple[FastMode, ...] = ()
    instants: tuple[float, ...] = ()
    outputs: Mapping[str, float] = field(default_factory=dict)
    kept: Mapping[str, float] = field(default_factory=dict)
    energy: float | None = None
    reason: str = ""

    def __str__(self) -> str:
        return self.sentence({})

    def sentence(self, units: Mapping[str, str]) -> str:
        """Return the report as one sentence. `units`: of the outputs."""
        head = f"bandwidth {frequency_text(self.bandwidth)}: "
        if not self.instants:
            return f"{head}nothing was left out: {self.reason}"
        count = len(self.instants)
        when = ", ".join(f"{t:.6g} s" for t in self.instants[:NAMED]) + (" …" if count > NAMED else "")
        joules = "" if self.energy is None else f", {self.energy:.3g} J"
        parts = [
            f"{head}{_modes(self.modes)} left out at t = {when}{f' ({count} times)' if count > NAMED else ''}{joules}"
        ]
        if any(_known(self.outputs).values()):
            parts.append(f"the outputs lack a ringing of up to {_largest(self.outputs, units)}")
        else:
            parts.append("no output shows it" if _all_known(self.outputs) else "what the outputs lack is not known")
        if any(_known(self.kept).values()):
            parts.append(f"what it does to the motion that is kept is estimated at {_largest(self.kept, units)}")
        if not _all_known(self.kept):
            rest = " of the others" if any(_known(self.kept).values()) else ""
            parts.append(f"what it does to the motion that is kept is not known{rest}")
        return "; ".join([*parts, *([self.reason] if self.reason else [])])

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, a part of `bondgraph-result/1`."""
        parts = entries(self, "faster", "modes", "instants", "outputs", "kept", "energy")
        return {"frequency": self.bandwidth, **parts, "reason": self.reason or None}


def read_truncation(told: Mapping[str, Any]) -> TruncationReport:
    """Return a report from the result of `to_json`."""
    modes = tuple(FastMode(m["frequency"], m["damping"], tuple(m["elements"])) for m in told["modes"])
    return TruncationReport(
        told["frequency"], told["faster"], modes, tuple(told["instants"]), _read(told["outputs"]), _read(told["kept"]), told["energy"],
        told["reason"] or "",
    )  # fmt: skip


def joined(before: TruncationReport | None, after: TruncationReport | None) -> TruncationReport | None:
    """Return the common report of two parts of a run."""
    if before is None or after is None:
        return after if before is None else before
    energies = [part.energy for part in (before, after) if part.energy is not None]
    reasons = dict.fromkeys(part.reason for part in (before, after) if part.reason)
    return TruncationReport(
        after.bandwidth, max(before.faster, after.faster),
        (*before.modes, *(m for m in after.modes if not any(m.is_like(old) for old in before.modes))),
        (*before.instants, *after.instants), _larger(before.outputs, after.outputs), _larger(before.kept, after.kept),
        sum(energies) if energies else None, "; ".join(reasons),
    )  # fmt: skip


def frequency_text(frequency: float) -> str:
    """Return a frequency as text with a suitable unit."""
    if not frequency > 0 or not math.isfinite(frequency):
        return f"{frequency:g} Hz"
    for unit, factor in (("GHz", 1e9), ("MHz", 1e6), ("kHz", 1e3), ("Hz", 1.0), ("mHz", 1e-3)):
        if frequency >= 0.9999999 * factor:
            return f"{frequency / factor:.4g} {unit}"
    return f"{frequency:.4g} Hz"


def _modes(modes: tuple[FastMode, ...]) -> str:
    where = ", ".join(f"`{e}`" for e in dict.fromkeys(e for m in modes[:NAMED] for e in m.elements[:1]))
    if len(modes) == 1:
        return f"a mode at {frequency_text(modes[0].frequency)} (mostly in {where})"
    slow, fast = (frequency_text(choose(m.frequency for m in modes)) for choose in (min, max))
    return f"{len(modes)} modes of {slow} to {fast} (mostly in {where})"


def _largest(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    values = _known(values)
    names = sorted((n for n in values if values[n]), key=lambda n: -values[n])
    return ", ".join(f"{values[n]:.3g}{behind(units.get(n, '1'))} (`{n}`)" for n in names[:NAMED])


def _larger(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """Return the larger value of each name; NaN (unknown) if one of them is NaN."""
    both = {n: (first.get(n, 0.0), second.get(n, 0.0)) for n in {**first, **second}}
    return {n: math.nan if any(map(math.isnan, pair)) else max(pair) for n, pair in both.items()}


def _known(values: Mapping[str, float]) -> dict[str, float]:
    return {n: v for n, v in values.items() if not math.isnan(v)}


def _all_known(values: Mapping[str, float]) -> bool:
    return not any(map(math.isnan, values.values()))


def _read(values: Mapping[str, float | None]) -> dict[str, float]:
    return {n: math.nan if v is None else v for n, v in values.items()}
