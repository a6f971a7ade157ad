"""Numbers of an analysis in a table of points, by name, each with its SI unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Numbers = dict[str, tuple[float, str]]


def numbers_of(role: str, found: Any) -> Numbers:
    """Return the numbers of one step's result; empty for a linear model."""
    return _READ[role](found) if role in _READ else {}


def _sensitivity(found: Any) -> Numbers:
    over_time = hasattr(found, "outputs")
    quantities = found.outputs if over_time else found.quantities
    slopes = found.slopes[-1] if over_time else found.slopes
    return {
        f"{q} by {p}": (float(slopes[i, j]), _over(found.units[q], found.units[p]))
        for i, q in enumerate(quantities)
        for j, p in enumerate(found.parameters)
    }


def _over(upper: str, lower: str) -> str:
    return upper if lower == "1" else f"{upper}/({lower})"


def _branch(found: Any) -> Numbers:
    unit, count, values = found.units.get(found.parameter, "1"), dict[str, int](), Numbers()
    for special in found.special:
        count[special.kind] = count.get(special.kind, 0) + 1
        values[f"{special.kind} {count[special.kind]} of {found.parameter}"] = (special.value, unit)
    return values or {f"last {found.parameter}": (float(found.values[-1]), unit)}


def _inversion(found: Any) -> Numbers:
    inputs: Mapping[str, Any] = found.inputs
    along = hasattr(found, "time")
    return {
        f"largest {n}" if along else n: (float(np.max(np.abs(v))) if along else float(v), found.units.get(n, "1"))
        for n, v in inputs.items()
    }


def _fit(found: Any) -> Numbers:
    return {p.name: (p.value, p.unit) for p in found.parameters}


def _chance(found: Any) -> Numbers:
    values = Numbers()
    for name in found.quantities:
        some = found.statistics(name)
        for word, short in (("mean", "mean"), ("standard deviation", "deviation")):
            values[f"{short} of {name}"] = (some.get(word, float("nan")), found.units[name])
    return values


_READ: dict[str, Callable[[Any], Numbers]] = {
    "sensitivity": _sensitivity,
    "continue": _branch,
    "invert": _inversion,
    "fit": _fit,
    "montecarlo": _chance,
}
