"""Prices of a run: states and operations for each output alone, and for the whole where a parameter or input is fixed at zero."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from compiler.api import CompilationFailed, adjustable, cost

from ..rendering import Summarised
from ..results.json_values import entries

if TYPE_CHECKING:
    from compiler.api import Compilation

    from ..compiled_model import CompiledModel

SCHEMA = "bondgraph-prices/1"


@dataclass(frozen=True, slots=True)
class Price:
    """Number of states, and operations of one evaluation of their rates and of the entries of their Jacobian."""

    states: int
    rates: int
    jacobian: int


@dataclass(frozen=True, slots=True, repr=False)
class Prices(Summarised):
    """Prices of a run: of the `whole`, of each of its `outputs` alone, and of the whole where a parameter or input is zero (`zeros`, if that saves anything).

    A zero has its price where the text or the experiment sets it: values set from outside stay arguments of one program. `untried`: quantities whose
    zeros were not compiled in the time.
    """

    whole: Price
    outputs: Mapping[str, Price]
    zeros: Mapping[str, Price]
    untried: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return {schema, whole, outputs: {name: price}, zeros: {name: price}, untried}; a price: {states, rates, jacobian}."""
        return {"schema": SCHEMA, **entries(self, "whole", "outputs", "zeros", "untried")}


def prices(
    model: CompiledModel, experiment: str | None, settings: Mapping[str, str | float], outputs: tuple[str, ...] | None, seconds: float
) -> Prices:  # fmt: skip
    """Compile an experiment for each output alone, and for zeros of its parameters and inputs as long as `seconds` last. Raises `CompilationFailed`."""

    def compiled(names: tuple[str, ...] | None, zero: Mapping[str, float]) -> Compilation:
        scene = model.scene(experiment, {**settings, **zero}, outputs=names)
        return model.compilation(replace(scene, fixed=frozenset(zero), from_start=True))

    compilation = compiled(outputs, {})
    whole, until = _price(compilation), clock.monotonic() + seconds
    alone = {name: _price(compiled((name,), {})) for name in compilation.lowered.space.outputs}
    zeros: dict[str, Price] = {}
    untried = []
    quantities = compilation.whole_graph.quantities
    for name in [n for n, q in quantities.items() if adjustable(q) and n not in compilation.zeros]:
        if clock.monotonic() > until:
            untried.append(name)
            continue
        try:
            price = _price(compiled(outputs, {name: 0.0}))
        except CompilationFailed:  # it divides, or nothing moves without it
            continue
        if (price.states, price.rates + price.jacobian) < (whole.states, whole.rates + whole.jacobian):
            zeros[name] = price
    return Prices(whole, alone, dict(sorted(zeros.items(), key=lambda item: item[1].rates + item[1].jacobian)), tuple(untried))  # fmt: skip


def _price(compilation: Compilation) -> Price:
    lowered = compilation.lowered
    count = cost(lowered)
    return Price(len(lowered.space.states), count.rates, count.jacobian)
