"""JSON values: functions that all results share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from compiler.api import Array

from ..rendering import OfModel


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


def named(names: Iterable[str], values: Array) -> dict[str, float]:
    """Return name -> float."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def as_json(value: object) -> Any:
    """Return a value as JSON has it: null for a number that is not finite, {re, im} for a complex one, a list for an array, for a record what its
    `to_json` gives, else an object of its fields."""
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, complex):
        return {"re": finite(value.real), "im": finite(value.imag)}
    if isinstance(value, Mapping):
        return {key: as_json(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [as_json(item) for item in value]
    if hasattr(value, "to_json"):
        return value.to_json()
    if is_dataclass(value):
        return entries(value, *(f.name for f in fields(value)))
    return as_json(value.tolist()) if hasattr(value, "tolist") else value


def entries(result: object, *names: str) -> dict[str, Any]:
    """Return the attributes of a result with these names, by name, as JSON has them."""
    return {name: as_json(getattr(result, name)) for name in names}
