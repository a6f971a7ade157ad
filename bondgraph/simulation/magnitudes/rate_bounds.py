"""Upper bounds of the states from the rates at the start alone, for states on which a pilot run gives no information."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ..segments.timeline import Segment

PLACES = 9  # places of a segment at which the rates are evaluated
MOST_STRETCHES = 64


def chargeable(
    program: Program, constants: Array, inputs: Array, state: Array, stretches: Sequence[Segment], known: Array
) -> Any:
    """Return positive magnitudes of all states and unknowns, shape (n,).

    First the change at the largest rates over the whole run, then the effect of other states, link by link of the Jacobian. `known`: the known
    magnitudes, 0 elsewhere. A state that nothing moves and nothing couples gets the largest of all.
    """
    whole = stretches[-1].stop - stretches[0].start
    result = np.array(known, dtype=float)
    differential = np.arange(len(result)) < len(program.states.names)
    rates = np.zeros(len(result))
    with np.errstate(all="ignore"):
        for stretch in stretches[:: max(1, len(stretches) // MOST_STRETCHES)]:
            for time in np.linspace(stretch.start, stretch.stop, PLACES):
                slope = np.abs(program.derivative(time, state, inputs, constants, stretch.mode))
                rates = np.maximum(rates, np.where(np.isfinite(slope), slope, 0.0))
        first = stretches[0]
        gain = np.abs(program.jacobian_entries(first.start, state, inputs, constants, first.mode))
    missing = result == 0
    result[missing & differential] = (rates * whole)[missing & differential]
    rows, columns = program.pattern
    gain = np.where(np.isfinite(gain), gain, 0.0) * np.where(differential[rows], whole, 1.0)
    for _ in range(len(result)):
        missing = (result == 0) | ~np.isfinite(result)
        if not missing.any():
            break
        brought = np.zeros(len(result))
        np.maximum.at(brought, rows, gain * np.where(missing, 0.0, result)[columns])
        new = missing & (brought > 0) & np.isfinite(brought)
        if not new.any():
            break
        result[new] = brought[new]
    left = (result == 0) | ~np.isfinite(result)
    result[left] = result[~left].max(initial=0.0) or 1.0
    return result
