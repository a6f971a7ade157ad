"""The linear model at a point: x' = f + A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0), exact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array

from ..errors import MissingPackage
from ..quantities import listed
from ..rendering import OfModel, Summarised
from ..results.json_values import entries, head, named, with_units
from .operating_point import OperatingPoint
from .pulses import held_note, refuse_moving_pulses
from .rounding import without_rounding

SCHEMA = "bondgraph-linearization/1"


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(OfModel, Summarised):
    """Matrices A (n, n), B (n, k), C (m, n), D (m, k), in SI, for `states`, `inputs` and `outputs` by the author's names.

    `states` are the free ones: coordinates tied by loop joints follow them, unknowns of loops are eliminated. `x` (n,), `u` (k,), `y` (m,) are the
    values at the point, `rates` (n,) is x' there: zero at an equilibrium. `unneeded`: states that no requested output depends on.
    """

    time: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    A: Array
    B: Array
    C: Array
    D: Array
    x: Array
    u: Array
    y: Array
    rates: Array
    unneeded: tuple[str, ...] = ()
    held: str = ""  # note on a model that time moves

    @property
    def note(self) -> str:
        """Note on the states that are left out, and on a model that time moves; empty for the whole of one that it does not."""
        return "; ".join(filter(None, (part_note(self.unneeded), self.held)))

    def to_scipy(self) -> Any:
        """Return a continuous `scipy.signal.StateSpace`. Raises ValueError without an input or output, as that has no such form."""
        if not self.inputs or not self.outputs:
            raise ValueError("a state space of scipy has at least one input and one output")
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return a `control.StateSpace` of python-control, with the author's names. Raises MissingPackage without it."""
        try:
            import control
        except ImportError as error:
            raise MissingPackage("BR208", "this needs python-control:", 'pip install "bondgraph-lang[control]"') from error  # fmt: skip
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, **names)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-linearization/1`, in SI.

        {schema, model, experiment, time, states, inputs, outputs: {name: {value, unit}}, A, B, C, D (rows), rates}; and `unneeded`, states that no
        requested output depends on.
        """
        told = {
            **head(SCHEMA, self),
            **entries(self, "time", *"ABCD", "rates", *(["unneeded"] if self.unneeded else [])),
        }
        for word, names, values in (
            ("states", self.states, self.x), ("inputs", self.inputs, self.u), ("outputs", self.outputs, self.y)
        ):  # fmt: skip
            told[word] = with_units(named(names, values), self.units)
        return told


def linearization(point: OperatingPoint, partial: bool = False) -> Linearization:
    """Return the linear model at a point; its inputs are the quantities by which the point's derivatives are taken (`by`).

    `partial`: the slopes of an output that has a kink or a jump there are NaN; otherwise that is refused. Raises `RunFailed`.
    """
    refuse_moving_pulses(point)
    space, reduced, program = point.compilation.state_space, point.reduced, point.program
    chosen = reduced.chosen
    rates = [space.states[i].rate for i in chosen]
    state_slopes, by_slopes = without_rounding(point, rates, *reduced.through(point.rate_slopes(chosen)))
    names, jumping = list(space.outputs), point.jumping()
    point.refuse_kinks([n for n in jumping if n not in names or not partial], "jumps at")
    sided = point.one_sided() if partial else point
    outputs = list(space.outputs.values())
    output_slopes, through = without_rounding(sided, outputs, *sided.of_states(outputs))
    bent = {*jumping, *(sided.kinks or ())}
    output_slopes[[n in bent or space.variables[v].name in bent for n, v in space.outputs.items()]] = np.nan
    return Linearization(
        program.name, point.made.plan.experiment, point.time, tuple(program.states.names[i] for i in chosen), point.by,
        program.outputs.names, linear_units(point), state_slopes, by_slopes, output_slopes, through, point.state[chosen],
        point.values_of(point.by), point.outputs, point.rates[chosen], point.unneeded,
        held_note(point, linear=True),
    )  # fmt: skip


def linear_units(point: OperatingPoint) -> dict[str, str]:
    """Return the SI units of outputs, states and inputs by name."""
    program, space = point.program, point.compilation.state_space
    units = dict(zip(program.outputs.names, program.outputs.units, strict=True))
    units |= dict(zip(program.states.names, program.states.units, strict=True))
    units |= {n: q.unit for n, q in point.compilation.whole_graph.quantities.items() if n in point.by}
    return units | {n: space.variables[space.quantities[n]].unit for n in point.by if n in space.quantities}


def part_note(unneeded: Sequence[str], more: str = "") -> str:
    """Return the note on a part of a model: the states that are left out. Empty for the whole."""
    if not unneeded:
        return ""
    states, them = ("1 state is", "it") if len(unneeded) == 1 else (f"{len(unneeded)} states are", "them")
    return f"{states} left out, as no requested output depends on {them}: {listed(unneeded)}{more}"


def state_matrix(point: OperatingPoint) -> Array:
    """Return A alone."""
    matrix: Array = point.reduced.through(point.rate_slopes(point.reduced.chosen))[0]
    return matrix
