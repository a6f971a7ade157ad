"""Settings of sliders: parameters and inputs of the model itself, and those among them that are arguments of every run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from compiler.api import Scale, Source, evaluate, read_unit

from ....author_units import author_units, quantities_in
from ....compiled_model import CompiledModel
from ....errors import UsageError
from ....quantities import quantity
from ...text.tables import visible

MOST = 200
COMPUTED = 6  # digits of a value that does not stand in the text
_NUMBER = re.compile(r"\d+\.?\d*(?:[eE][-+]?\d+)?")


def parameters_of(model: CompiledModel) -> list[dict[str, Any]]:
    """Return parameters and inputs that are numbers, as data, in the author's units; an input that depends on time begins at zero."""
    rows = list[dict[str, Any]]()
    sizes = _sizes(model.source.text)
    quantities = model.compilation().whole_graph.quantities
    units = author_units(model, {n: q.unit for n, q in quantities.items() if "." not in n})
    for name, (unit, scale) in units.items():
        item = quantities[name]
        value = _value(item)
        if value is None and item.role == "input":
            value = 0.0
        if item.role in ("parameter", "input") and value is not None:
            size = sizes.get(scale.dimension, 0.0) * abs(scale.from_si(1.0) - scale.from_si(0.0)) if unit else 0.0
            number = _in(scale, value)
            if abs(number) not in map(float, _NUMBER.findall(item.span.words)):
                number = float(f"{number:.{COMPUTED}g}")
            row = {"name": name, "role": item.role, "unit": visible(unit), "value": number, "size": size}
            rows.append({**row, "description": visible(item.description)})
    return rows[:MOST]


def _in(scale: Scale, value: float) -> float:
    """Return a value in a unit, without the digits that the conversion adds."""
    return float(f"{scale.from_si(value):.12g}")


def settings_of(
    parameters: list[dict[str, Any]], texts: Mapping[str, str | float]
) -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
    """Return values of texts with units, in SI and in the parameters' units, and for each text that is no value of its parameter the reason."""
    units = {p["name"]: p["unit"] or "1" for p in parameters}
    if not set(texts) <= set(units):
        raise UsageError("BR923", "there is no such parameter")
    values, shown, wrong = dict[str, float](), dict[str, float](), dict[str, str]()
    for name, text in texts.items():
        try:
            values[name] = quantity(text, units[name], name)
            shown[name] = _in(read_unit(Source("unit", units[name])), values[name])
        except UsageError as problem:
            wrong[name] = str(problem)
    return values, shown, wrong


def _sizes(text: str) -> dict[Any, float]:
    """Return the largest number of each dimension in a text: the range of the slider of a value that is zero."""
    found: dict[Any, float] = {}
    for number, _, scale in quantities_in(text):
        size = abs(scale.to_si(number))
        if 0 < size < float("inf"):
            found[scale.dimension] = max(size, found.get(scale.dimension, 0.0))
    return found


def base_settings(model: CompiledModel, experiment: str) -> dict[str, float]:
    """Return the values in an experiment of all independent constants: set in every run, so that another value needs no compilation."""
    quantities = model.compilation(model.scene(experiment)).whole_graph.quantities
    found: dict[str, float] = {}
    for told in parameters_of(model):
        item = quantities[told["name"]]
        value = _value(item)
        if value is not None and not getattr(item.definition, "arguments", ()):
            found[told["name"]] = value
    return found


def _value(item: Any) -> float | None:
    """Return the value of a quantity before a run; None if it depends on time or on the state."""
    if item.value is not None:
        return float(item.value)
    if item.definition is None or item.definition.arguments:
        return None
    try:
        return evaluate(item.definition.expression, dict[object, float]().__getitem__)
    except (ArithmeticError, ValueError, LookupError):
        return None
