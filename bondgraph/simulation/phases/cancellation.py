"""Outputs that are small differences of large numbers: what the tolerance of the states leaves of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray

from ...results.records import ToleranceDoubt
from ..segments.timeline import Segment

STEP = 1e-7  # relative: by which a state is moved
MOST_STATES = 64  # of a model whose outputs are looked at
PLACES = (0.23, 0.61, 0.87)  # in the longest segment
EXACT = 1e-12  # relative to the states: accuracy of the matrix exponential
DOUBTED = 10.0  # in units of the accuracy
ZERO = 1e-13  # relative to the terms: smaller outputs are zero to rounding, as by a symmetry


def terms_of_outputs(
    output: Callable[[Array, Array, Array], Any], instants: Array, states: Array, segments: Sequence[Segment]
) -> Any:
    """Return the largest term (..., outputs) of a state or unknown in each output, its slope times its value, at some instants; 0 without states.

    `output`: of instants (k,), states (..., k, n) and a mode; `states`: (..., points, n).
    """
    lengths = [s.stop - s.start for s in segments]
    longest = segments[lengths.index(max(lengths))]
    begin, end = instants.searchsorted((longest.start, longest.stop)).tolist()
    points, count = states.shape[-2:]
    if not begin < end <= points or not 0 < count <= MOST_STATES:
        return 0.0
    places = [int(begin + place * (end - begin)) for place in PLACES]
    moved = states[..., places, None, :] * _moves(count)
    flat = moved.reshape(*moved.shape[:-3], -1, count)  # machine code takes one row after another
    values = output(instants[places].repeat(count + 1), flat, longest.mode).reshape(*moved.shape[:-1], -1)
    return np.abs(values[..., 1:, :] - values[..., :1, :]).max(axis=(-3, -2)) / STEP


@lru_cache
def _moves(count: int) -> Array:
    """Return factors (n + 1, n) of states: none moved, then each."""
    return np.asarray(np.vstack([np.ones(count), np.ones((count, count)) + STEP * np.eye(count)]))


def doubtful_outputs(values: Array, terms: Any, accuracy: float) -> tuple[BoolArray, Array]:
    """Return a mask (..., outputs) of those of whose size the `accuracy` of the terms leaves a tenth or more in doubt, and the sizes; `values`: (..., points,
    outputs)."""
    largest = _largest(values)
    return (largest < DOUBTED * accuracy * terms) & (largest > ZERO * terms), largest


def _largest(values: Array) -> Any:
    """Return the largest absolute value of each output, shape (..., outputs); from rows of numbers in a row, as numpy takes short ones ten times as long."""
    return np.abs(np.ascontiguousarray(values.swapaxes(-1, -2))).max(axis=-1, initial=0.0)


def doubts_on_outputs(names: Sequence[str], values: Array, terms: Any, accuracy: float, begin: float) -> tuple[ToleranceDoubt, ...]:  # fmt: skip
    """Return a warning on each output that is doubtful. `values`: (points, outputs)."""
    doubtful, largest = doubtful_outputs(values, terms, accuracy)
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
