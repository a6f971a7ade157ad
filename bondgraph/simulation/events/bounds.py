"""Bounds on the indicators of narrow conditions over a part of a step, from the ranges of its states.

A bell such as 1/(1 + ((x - a)/w)^2) may lie between two places of a step. Interval arithmetic on the indicator shows where it has no zero;
elsewhere a part is halved until the values at its places cover a good part of the range of each narrow operation, or until that range shrinks
with the part (as in `simulation/segments/resolution.py`). The range of a state is that of its polynomial (Ehlich and Zeller, Math. Z. 86, 1964:
a polynomial of degree n exceeds its values at m Chebyshev points by at most a factor of 1/cos(n pi/2m)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, Program, Ranges

from ...numerics.indicators import GRID, ON_GRID, PLACES, SURE, Interpolants

# fraction of half a range by which a polynomial may exceed it between the places of the grid
BEYOND = 1 / cos((PLACES - 1) * pi / (2 * GRID)) - 1
SEEN = 0.25  # least fraction of a range that values must cover
# largest fraction of the range on a part that the range on half of it may have, if it shrinks with the part
HALVED = 0.6
ROUNDING = 1e-12  # fraction of the largest value: smaller ranges are ignored


@dataclass(frozen=True, slots=True)
class Overlooked:
    """Masks of conditions on a part: those that may have a zero, and those with a peak that the values at its places do not show."""

    zero: BoolArray
    unseen: BoolArray
    reach: Array  # widths of the conditions' own ranges; 0 without one
    widths: Array  # ranges of all narrow operations, for the halves of the part


class Bounds:
    """Bounds on the narrow indicators of a program in a run. `count`: number of its conditions."""

    def __init__(self, program: Program, inputs: Array, constants: Array, count: int) -> None:
        functions = program.time_functions
        assert functions is not None
        self.conditions = [c for c in functions.conditions if c.place >= 0]
        places = [place for c in self.conditions for place in (c.place, *c.narrow)]
        self.ranges = Ranges(functions, places, constants, inputs)
        self.count = count

    def over(
        self, part: tuple[float, float], times: Array, states: Array, mode: Array, floor: Array, before: Array | None
    ) -> Overlooked:  # fmt: skip
        """Examine a part of a step. `times`, `states`: the Chebyshev places and the states there; `before`: `widths` of the part that it is half of."""
        ranges, low, high = self.ranges, np.array([part[0]]), np.array([part[1]])
        with np.errstate(all="ignore"):
            spans = dict(zip(ranges.states, self._spans(states[:, ranges.states]), strict=True))
            bounds = ranges.over(low, high, mode, spans)
            values = ranges.values(times, mode, states)
        zero, unseen = np.zeros((2, self.count), dtype=bool)
        reach = np.zeros(self.count)
        widths = np.array([float(np.ravel(b)[0]) - float(np.ravel(a)[0]) for a, b in bounds])
        largest = np.array([max(abs(float(np.ravel(x)[0])) for x in pair) for pair in bounds])
        shown = np.array([np.ptp(v) if np.ndim(v) else 0.0 for v in values])
        hides = (widths > ROUNDING * largest) & ~(shown >= SEEN * widths)
        if before is not None:
            hides &= ~(widths <= HALVED * before)
        place = 0
        for condition in self.conditions:
            least, most = (float(np.ravel(x)[0]) for x in bounds[place])
            number, last = condition.number, place + 1 + len(condition.narrow)
            zero[number] = least <= floor[number] and most >= -floor[number]
            reach[number] = most - least
            unseen[number] = hides[place + 1 : last].any()
            place = last
        return Overlooked(zero, unseen, reach, widths)

    def _spans(self, states: Array) -> Any:
        """Return lower and upper bounds of the polynomials through the states at the places, pairs of arrays (1,)."""
        found = Interpolants.through(states)
        grid = ON_GRID @ found.coefficients
        low, high = grid.min(axis=0), grid.max(axis=0)
        margin = 0.5 * BEYOND * (high - low) + SURE * found.error * (found.error < 1e-3 * found.variation)
        return [(np.array([a]), np.array([b])) for a, b in zip(low - margin, high + margin, strict=True)]


def bounds_of(program: Program, inputs: Array, constants: Array, count: int) -> Bounds | None:
    """Return the bounds of the narrow conditions of a program; None if it has none."""
    functions = program.time_functions
    if functions is None or all(c.place < 0 for c in functions.conditions):
        return None
    return Bounds(program, inputs, constants, count)


def notes_on_conditions(program: Program, crowded: BoolArray, touches: Mapping[int, float]) -> tuple[str, ...]:
    """Return a note for each condition that may be narrow and has no bounds, or too many parts to be searched (`crowded`), or that touches its threshold.

    `touches`: instants by the number of the condition, s.
    """
    functions, hybrid = program.time_functions, program.hybrid
    if hybrid is None:
        return ()
    touch = "comes within rounding of its threshold at t = {:.6g} s: it was not decided whether it changes there"
    notes = [(number, touch.format(time)) for number, time in touches.items()]
    if functions is not None:
        blind = "has no bounds within a step: a change that lasts for a small part of a step may have been missed"
        notes += [(c.number, blind) for c in functions.conditions if c.place < 0 or crowded[c.number]]
    conditions = hybrid.conditions
    return tuple(
        f"a condition on states of `{conditions[j].owner}` ({conditions[j].span.file_and_line}) {what}"
        for j, what in notes
    )
