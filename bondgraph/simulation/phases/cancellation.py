"""Outputs that are small differences of large numbers: what the tolerance of the states leaves of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array

from ...results.records import ToleranceDoubt
from ..segments.timeline import Segment

STEP = 1e-7  # relative: by which a state is moved
MOST_STATES = 64  # of a model whose outputs are looked at
PLACES = (0.23, 0.61, 0.87)  # in the longest segment
EXACT = 1e-12  # relative to the states: accuracy of the matrix exponential
DOUBTED = 10.0  # in units of the accuracy
ZERO = 1e-13  # relative to the terms: smaller outputs are zero to rounding, as by a symmetry


Places = tuple[Any, Any, Any]  # instants (k,), states (..., k, n) and a mode at which terms are looked for


def places_of_terms(instants: Array, states: Array, segments: Sequence[Segment]) -> Places | None:
    """Return the places of a solution at which terms are looked for; None without states. `states`: (..., points, n)."""
    lengths = [s.stop - s.start for s in segments]
    longest = segments[lengths.index(max(lengths))]
    begin, end = instants.searchsorted((longest.start, longest.stop)).tolist()
    points, count = states.shape[-2:]
    if not begin < end <= points or not 0 < count <= MOST_STATES:
        return None
    places = [int(begin + place * (end - begin)) for place in PLACES]
    return instants[places], states[..., places, :], longest.mode


def terms_of_outputs(output: Callable[[Array, Array, Array], Any], places: Places | None) -> Any:
    """Return the largest term (..., outputs) of a state or unknown in each output, its slope times its value; 0 without places. `output`: of `Places`."""
    if places is None:
        return 0.0
    times, states, mode = places
    count = states.shape[-1]
    moved = states[..., None, :] * _moves(count)
    flat = moved.reshape(*moved.shape[:-3], -1, count)  # machine code takes one row after another
    values = output(times.repeat(count + 1), flat, mode).reshape(*moved.shape[:-1], -1)
    return np.abs(values[..., 1:, :] - values[..., :1, :]).max(axis=(-3, -2)) / STEP


@lru_cache
def _moves(count: int) -> Array:
    """Return factors (n + 1, n) of states: none moved, then each."""
    return np.asarray(np.vstack([np.ones(count), np.ones((count, count)) + STEP * np.eye(count)]))


def largest_outputs(values: Array) -> Any:
    """Return the largest absolute value (outputs,) of each output; from rows of numbers in a row, as numpy takes short ones ten times as long."""
    return np.abs(np.ascontiguousarray(values.swapaxes(-1, -2))).max(axis=-1, initial=0.0)


def doubts_on_outputs(names: Sequence[str], largest: Array, terms: Any, accuracy: float, begin: float) -> tuple[ToleranceDoubt, ...]:  # fmt: skip
    """Return a warning on each output of whose size (outputs,) the `accuracy` of the terms leaves a tenth or more in doubt."""
    doubtful = (largest < DOUBTED * accuracy * terms) & (largest > ZERO * terms)
    if not doubtful.any():
        return ()
    advice = "compute it from other quantities" if accuracy <= EXACT else "set a smaller `rtol`"
    return tuple(
        ToleranceDoubt(
            begin, names[k], "terms that cancel",
            f"`{names[k]}` is a difference of numbers {terms[k] / largest[k]:.1g} times as large, which are computed to {accuracy:.1g} of their size: "
            f"a tenth of it or more may be wrong; {advice}", (), "",
        )
        for k in doubtful.nonzero()[0].tolist()
    )  # fmt: skip
