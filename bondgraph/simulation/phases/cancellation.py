"""Outputs that are small differences of large numbers, or smaller than the absolute tolerances of what they read: what a run leaves of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...quantities import behind
from ...results.records import ToleranceDoubt
from ..segments.timeline import Segment

STEP = 1e-7  # relative: by which a state is moved
MOST_STATES = 64  # of a model whose outputs are looked at
PLACES = (0.23, 0.61, 0.87)  # in the longest segment
# What has risen from place to place by more than the square of the time is the beginning of what comes later, as far ahead of a wave.
RISEN = (PLACES[0] / PLACES[1]) ** 2, (PLACES[1] / PLACES[2]) ** 2
ROUNDED = 2e-12  # relative to its magnitude: a state is rounding, as that is a ten-thousandth of the largest with its unit at least
EXACT = 1e-12  # relative to the states: accuracy of the matrix exponential
DOUBTED = 10.0  # in units of the accuracy
FAR = 300.0  # in units of the accuracy: an output is told that a tolerance moves by more which is so large beside its state, and nobody gave it
ZERO = 1e-13  # relative to the terms: smaller outputs are zero to rounding, as by a symmetry


Places = tuple[Any, Any, Any]  # instants (k,), states (..., k, n) and a mode at which terms are looked for
RowsOfTerms = tuple[list[int], Any]


@dataclass(frozen=True, slots=True)
class OutputTerms:
    """Terms of outputs in a phase. `largest`: the largest term of a state or unknown in each output, its slope times its value, (..., outputs); `moved`:
    what the `absolute` tolerance (n,) of each state moves an output by, (n, outputs); `least`: how often that has to fit into an output (n,)."""

    largest: Any
    moved: Any
    absolute: Any
    program: Program
    least: Any


def places_of_terms(instants: Array, states: Array, rows: RowsOfTerms | None) -> Places | None:
    """Return the places of a solution at which terms are looked for; None without states. `states`: (..., points, n)."""
    return None if rows is None else (instants.take(rows[0]), states.take(rows[0], -2), rows[1])


def rows_of_terms(instants: Array, states: Array, segments: Sequence[Segment]) -> RowsOfTerms | None:
    """Return their indices among the instants, and the mode there."""
    lengths = [s.stop - s.start for s in segments]
    longest = segments[lengths.index(max(lengths))]
    begin, end = instants.searchsorted((longest.start, longest.stop)).tolist()
    points, count = states.shape[-2:]
    if not begin < end <= points or not 0 < count <= MOST_STATES:
        return None
    return [int(begin + place * (end - begin)) for place in PLACES], longest.mode


def terms_of_outputs(
    program: Program,
    output: Callable[[Array, Array, Array], Any],
    places: Places | None,
    absolute: Array,
    rtol: float,
    fixed: Any,
) -> OutputTerms:
    """Return the terms of outputs; 0 without places. `output`: of `Places`; `absolute`: tolerances (n,) of the states, 0 where they do not count; `fixed`
    marks those that the author gave, and those of poses."""
    if places is None:
        count = len(program.outputs.names)
        return OutputTerms(np.zeros(count), np.zeros((len(absolute), count)), absolute, program, 0 * absolute)
    times, values, mode = places
    size = values.shape[-1]
    first, middle, last = np.moveaxis(np.abs(values[..., : len(absolute)]), -2, 0)
    rising = (first <= RISEN[0] * middle) & (middle <= RISEN[1] * last)
    largest = np.maximum(np.maximum(first, middle), last)
    quiet = rising | (largest <= ROUNDED / rtol * absolute)
    floor = np.pad(STEP / rtol * absolute, (0, size - len(absolute)))
    steps = np.maximum(STEP * np.abs(values), floor)  # of a state far below its magnitude the slope would be rounding
    moved = values[..., None, :] + np.copysign(steps, values)[..., None, :] * _moves(size)
    flat = moved.reshape(*moved.shape[:-3], -1, size)  # machine code takes one row after another
    outputs = output(times.repeat(size + 1), flat, mode).reshape(*moved.shape[:-1], -1)
    changes = np.abs(outputs[..., 1:, :] - outputs[..., :1, :])
    slopes = np.divide(changes, steps[..., None], out=np.zeros(changes.shape), where=steps[..., None] > 0)
    terms = (slopes * np.abs(values)[..., None]).max(axis=(-3, -2))
    return OutputTerms(
        terms,
        slopes[..., : len(absolute), :].max(axis=-3) * np.where(quiet, 0.0, absolute)[:, None],
        absolute,
        program,
        np.where(fixed | (absolute <= FAR * rtol * largest), DOUBTED, max(DOUBTED, 1 / (FAR * rtol))),
    )


@lru_cache
def _moves(count: int) -> Array:
    """Return which state is moved (n + 1, n): none, then each."""
    return np.eye(count + 1, count, -1)


def largest_outputs(values: Array) -> Any:
    """Return the largest absolute value (outputs,) of each output; from rows of numbers in a row, as numpy takes short ones ten times as long."""
    return np.maximum.reduce(np.abs(np.ascontiguousarray(values.swapaxes(-1, -2))), axis=-1, initial=0.0)


def doubts_on_outputs(
    names: Sequence[str], largest: Array, phases: Sequence[OutputTerms], accuracy: float, begin: float
) -> tuple[ToleranceDoubt, ...]:
    """Return a warning on each output of whose size (outputs,) the `accuracy` of the terms leaves a tenth or more in doubt, or an absolute tolerance
    much more than the accuracy."""
    terms = np.max([phase.largest for phase in phases], axis=0)
    excesses = [phase.moved * phase.least[:, None] for phase in phases]
    excess = np.max([of_phase.max(axis=0, initial=0.0) for of_phase in excesses], axis=0)
    doubtful = largest < DOUBTED * accuracy * terms
    advice = "compute it from other quantities" if accuracy <= EXACT else "set a smaller `rtol`"
    doubts = []
    for k in ((doubtful | (largest < excess)) & (largest > ZERO * terms)).nonzero()[0].tolist():
        if doubtful[k]:
            condition, text = "terms that cancel", (
                f"`{names[k]}` is a difference of numbers {terms[k] / largest[k]:.1g} times as large, which are computed to {accuracy:.1g} of their size: "
                f"a tenth of it or more may be wrong; {advice}"
            )  # fmt: skip
        else:
            number = int(np.argmax([of_phase[:, k].max(initial=0.0) for of_phase in excesses]))
            phase, state = phases[number], int(excesses[number][:, k].argmax())
            name, unit = phase.program.states.names[state], behind(phase.program.states.units[state])
            moved = phase.moved[state, k]
            enough = f"{accuracy * phase.absolute[state] * largest[k] / moved:.1g}{unit}"
            condition, text = "below its tolerance", (
                f"`{names[k]}` is {largest[k]:.1g} at most, and the absolute tolerance of `{name}` may move it by {moved:.1g}: "
                f"{min(moved / largest[k], 1):.1g} of it or more may be wrong; set `tolerance {name} = {enough}` in `simulate`"
            )  # fmt: skip
        doubts.append(ToleranceDoubt(begin, names[k], condition, text, (), ""))
    return tuple(doubts)
