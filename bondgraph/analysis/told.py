"""How analyses are told in numbers: what all of their results have in common."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any


def finite(value: float) -> float | None:
    """A number for JSON: what is not finite is null."""
    return float(value) if math.isfinite(value) else None


def with_units(values: Mapping[str, float], units: Mapping[str, str]) -> dict[str, Any]:
    """{name: {value, unit}}, in SI."""
    return {name: {"value": finite(value), "unit": units.get(name, "1")} for name, value in values.items()}


def rows_of(matrix: Any) -> list[list[float | None]]:
    """A matrix by rows."""
    return [[finite(x) for x in row] for row in matrix]


def pair(value: complex) -> dict[str, float | None]:
    """{re, im}."""
    return {"re": finite(value.real), "im": finite(value.imag)}


def named(names: Iterable[str], values: Any) -> dict[str, float]:
    """Name -> float."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}
