"""Upper bounds of the states from the rates at the start alone, for states on which a pilot run gives no information."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...numerics.scales import equilibrated
from ..constraints.constraints import Constraints
from ..segments.timeline import Segment

PLACES = 9  # places of a segment at which the rates are evaluated
MOST_STRETCHES = 64


def chargeable(constraints: Constraints, state: Array, stretches: Sequence[Segment], known: Array) -> Any:
    """Return magnitudes of all states and unknowns, shape (n,).

    First the change at the largest rates over the whole run, or over the time in which a state itself brings its rate to zero: a diode at its full
    voltage would else bring 1e80 C. Then the effect of other states, link by link of the Jacobian. `known`: the known magnitudes, 0 elsewhere. A state
    that nothing moves and nothing couples stays 0.
    """
    program, inputs, constants = constraints.program, constraints.inputs, constraints.constants
    whole = stretches[-1].stop - stretches[0].start
    result = np.array(known, dtype=float)
    count = len(program.states.names)
    differential = np.arange(len(result)) < count
    changes, (rows, columns) = np.zeros(len(result)), program.pattern
    own = rows == columns
    with np.errstate(all="ignore"):
        for stretch in stretches[:: max(1, len(stretches) // MOST_STRETCHES)]:
            for time in np.linspace(stretch.start, stretch.stop, PLACES):
                place = time, state, inputs, constants, stretch.mode
                rates, returns = np.abs(program.derivative(*place)), np.zeros(len(result))
                returns[rows[own]] = -np.asarray(program.jacobian_entries(*place))[own]
                change = rates / np.maximum(returns, 1.0 / whole)
                changes = np.maximum(changes, np.where(np.isfinite(change), change, 0.0))
        first = stretches[0]
        entries = program.jacobian_entries(first.start, state, inputs, constants, first.mode)
    entries = np.where(np.isfinite(entries), entries, 0.0)
    follow = _followed(program, entries)
    gain = np.where(differential[rows], whole * np.abs(entries), 0.0)
    missing = result == 0
    result[missing & differential] = changes[missing & differential]
    for _ in range(len(result)):
        missing = (result == 0) | ~np.isfinite(result)
        if not missing.any():
            break
        brought, here = np.zeros(len(result)), np.where(missing, 0.0, result)
        np.maximum.at(brought, rows, gain * here[columns])
        brought[count:] = (follow * here[:count]).max(axis=1, initial=0.0)
        new = missing & (brought > 0) & np.isfinite(brought)
        if not new.any():
            break
        result[new] = brought[new]
    return np.where(np.isfinite(result), result, 0.0)


def _followed(program: Program, entries: Array) -> Any:
    """Return how far the unknowns of loops follow each state, shape (unknowns, states), from the derivatives of their residuals, whose units are others."""
    count, unknowns = len(program.states.names), len(program.unknowns.names)
    (rows, columns), whole = program.pattern, np.zeros((unknowns, count + unknowns))
    of_loops = rows >= count
    whole[rows[of_loops] - count, columns[of_loops]] = entries[of_loops]
    scaled, row_sizes, column_sizes = equilibrated(whole[:, count:])
    inverse = np.abs(np.linalg.pinv(scaled)) / column_sizes[:, None] / row_sizes
    return inverse @ np.abs(whole[:, :count])
