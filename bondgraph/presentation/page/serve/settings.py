"""Settings of sliders: parameters and inputs of the model itself, and those among them that are arguments of every run."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from compiler.api import CompilationFailed, Source, evaluate, read_unit

from ...text.tables import visible

if TYPE_CHECKING:
    from ....compiled_model import CompiledModel

MOST = 200
_NUMBERS = re.compile(r"(\d+(?:\.\d+)?(?:[eE][-+]?\d{1,3})?) ?(?:\[([^\]\n]{1,40})\]|([^\W\d]\w{0,8}))")


def parameters_of(model: CompiledModel) -> list[dict[str, Any]]:
    """Return parameters and inputs that are numbers, as data; an input that depends on time begins at zero."""
    found = []
    sizes = _sizes(model.source.text)
    for name, quantity in model.compilation().whole_graph.quantities.items():
        value = _value(quantity)
        if value is None and quantity.role == "input":
            value = 0.0
        if quantity.role in ("parameter", "input") and "." not in name and value is not None:
            unit = "" if quantity.unit == "1" else visible(quantity.unit)
            words = visible(quantity.description)
            size = 0.0 if quantity.unit == "1" else sizes.get(read_unit(Source("unit", quantity.unit)).dimension, 0.0)
            told = {
                "name": name,
                "role": quantity.role,
                "unit": unit,
                "value": value,
                "size": size,
                "description": words,
            }
            found.append(told)
    return found[:MOST]


def _sizes(text: str) -> dict[Any, float]:
    """Return the largest number of each dimension in a text: the range of the slider of a value that is zero."""
    found: dict[Any, float] = {}
    for number, bracketed, plain in _NUMBERS.findall(text):
        try:
            scale = read_unit(Source("unit", bracketed or plain))
        except CompilationFailed:
            continue  # the word is no unit
        size = abs(float(scale.to_si(Fraction(number))))
        if 0 < size < float("inf"):
            found[scale.dimension] = max(size, found.get(scale.dimension, 0.0))
    return found


def base_settings(model: CompiledModel, experiment: str) -> dict[str, float]:
    """Return the values in an experiment of all independent constants: set in every run, so that another value needs no compilation."""
    quantities = model.compilation(model.scene(experiment)).whole_graph.quantities
    found: dict[str, float] = {}
    for told in parameters_of(model):
        quantity = quantities[told["name"]]
        value = _value(quantity)
        if value is not None and not getattr(quantity.definition, "arguments", ()):
            found[told["name"]] = value
    return found


def _value(quantity: Any) -> float | None:
    """Return the value of a quantity before a run; None if it depends on time or on the state."""
    if quantity.value is not None:
        return float(quantity.value)
    if quantity.definition is None or quantity.definition.arguments:
        return None
    try:
        return evaluate(quantity.definition.expression, _nothing)
    except (ArithmeticError, ValueError, LookupError):
        return None


def _nothing(key: object) -> float:
    raise LookupError(key)
