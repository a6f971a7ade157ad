"""Distributions of uncertain quantities: their kinds, and checks of their numbers."""

from __future__ import annotations

import math

from .fast_dataclass import dataclass

DISTRIBUTIONS = {
    "normal": ("mean", "standard deviation"),
    "lognormal": ("mean", "standard deviation"),
    "uniform": ("low", "high"),
    "triangular": ("low", "most likely", "high"),
}
SPREAD = "standard deviation"  # a difference, of temperatures one without their zero


@dataclass(frozen=True, slots=True)
class Distribution:
    """One of `DISTRIBUTIONS` with its numbers in SI; truncated at `low` and `high`."""

    kind: str
    numbers: tuple[float, ...]
    low: float = -math.inf
    high: float = math.inf


def fault(given: Distribution) -> str:
    """Reason why there is no such distribution; "" if there is one."""
    if not all(map(math.isfinite, given.numbers)):
        return "a distribution has finite numbers"
    match given.kind, given.numbers:
        case "normal" | "lognormal", (_, spread) if not spread > 0:
            return f"a standard deviation is larger than zero, not {spread:g}"
        case "lognormal", (mean, _) if not mean > 0:
            return f"what is lognormal has a mean above zero, not {mean:g}"
        case "uniform", (first, last) if not first < last:
            return f"uniform goes from low to high; {first:g} is not below {last:g}"
        case "triangular", (first, mode, last) if not (first <= mode <= last and first < last):
            return f"triangular goes from low by the most likely to high; this is {first:g}, {mode:g}, {last:g}"
    if not given.low < given.high:
        return f"truncated from low to high; {given.low:g} is not below {given.high:g}"
    return ""


def kinds_told() -> str:
    """All kinds with their numbers, in words."""
    kinds = ", ".join(f"{k}({', '.join(w)})" for k, w in DISTRIBUTIONS.items())
    return f"{kinds}, and truncated(one of these, low, high)"
