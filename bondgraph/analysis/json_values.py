"""JSON values: functions that all results of analyses share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from compiler.api import Array


class OfModel(Protocol):
    """Result of a model in an experiment."""

    @property
    def model(self) -> str: ...

    @property
    def experiment(self) -> str | None: ...


def head(schema: str, result: OfModel) -> dict[str, Any]:
    """Return the first entries of a result: {schema, model, experiment}."""
    return {"schema": schema, "model": result.model, "experiment": result.experiment}


def finite(value: float) -> float | None:
    """Return a number for JSON: null if it is not finite."""
    return float(value) if math.isfinite(value) else None


def with_units(values: Mapping[str, float], units: Mapping[str, str]) -> dict[str, Any]:
    """Return {name: {value, unit}}, in SI."""
    return {name: {"value": finite(value), "unit": units.get(name, "1")} for name, value in values.items()}


def arrays_with_units(values: Mapping[str, Array], units: Mapping[str, str]) -> dict[str, Any]:
    """Return {name: {unit, values}}, in SI."""
    return {name: {"unit": units.get(name, "1"), "values": array.tolist()} for name, array in values.items()}


def rows_of(matrix: Array | list[Array]) -> list[list[float | None]]:
    """Return a matrix by rows."""
    return [[finite(x) for x in row] for row in matrix]


def pair(value: complex) -> dict[str, float | None]:
    """Return {re, im}."""
    return {"re": finite(value.real), "im": finite(value.imag)}


def named(names: Iterable[str], values: Array) -> dict[str, float]:
    """Return name -> float."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}
