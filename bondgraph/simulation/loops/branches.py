"""Whether the loops of a model have more than one solution at the start: then none of them is the author's.

Newton's method from many guesses at once (`scatter.py`). What converges to another regular solution is another solution; that
nothing does is no proof, but a curve has to be very narrow to hide from it.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from .loops import LoopSolver
from .scatter import Loop, arrivals, guesses

CLOSE = 1e-6  # relative distance within which two solutions are one
FLOOR = (
    1e-13  # of the magnitude: where a law is flat at a solution (a valve without flow), Newton's method comes no closer
)
LARGEST = 100  # unknowns; more are not searched
BENT = 1e-3  # relative change of slope between two solutions that are not one
BETWEEN = np.arange(1, 20) / 20


def other_solutions(loops: LoopSolver, time: float, state: Any, mode: Any) -> list[Any]:
    """Solutions for the unknowns other than the one in `state`, each of shape (unknowns,): loop by loop, the smallest first."""
    known = state[loops.count :]
    if not 0 < len(known) <= LARGEST:
        return []
    others: list[Any] = []
    for places in loops.separate():
        loop = Loop(loops, (time, state, mode), known, places)
        found = _collect(loop, [known[places]], guesses(known[places]))
        if len(found) > 1:  # what lies between two solutions is often a third one that Newton's method shuns
            between = [a + t * (b - a) for a, b in combinations(found[:4], 2) for t in BETWEEN]
            found = _collect(loop, found, np.array(between))
        ends = (loops.newton(*loop.at, loop.full(z)) for z in sorted(found[1:], key=lambda z: np.abs(z).max()))
        others += [
            z for z in ends if z is not None and _in_mode(loops, time, np.concatenate([state[: loops.count], z]), mode)
        ]
    return others


def _in_mode(loops: LoopSolver, time: float, state: Any, mode: Any) -> bool:
    """Whether the conditions on states are at a solution as the mode has them: else it solves other equations than the model's."""
    hybrid = loops.program.hybrid
    if hybrid is None:
        return True
    roots = np.asarray(hybrid.roots(time, state, loops.inputs, loops.constants, mode))
    held = np.asarray(mode)[[c.position for c in hybrid.conditions]] == 1.0
    return bool(((roots == 0) | ((roots < 0) == held)).all())


def _collect(loop: Loop, found: list[Any], guesses: Any) -> list[Any]:
    """The solutions that are found, and those to which guesses lead."""
    found = list(found)
    for end in arrivals(loop, guesses):
        if not any(_same(loop, end, z) for z in found) and _regular(loop, end):
            found.append(end)
    return found


def _same(loop: Loop, a: Any, b: Any) -> bool:
    """Whether two solutions are one but for rounding: between two regular ones the slope along their distance must change."""
    way = b - a
    near = np.maximum(CLOSE * np.maximum(np.abs(a), np.abs(b)).max(), FLOOR * loop.magnitude)
    if (np.abs(way) <= near).all():
        return True
    slopes = loop.matrix(np.array([a, b, 0.5 * (a + b)])) * way
    size = np.abs(slopes).max(axis=(0, 2))
    along = slopes.sum(axis=2) / np.where(size > 0, size, 1.0)
    return bool(np.ptp(along, axis=0).max() <= BENT)


def _regular(loop: Loop, z: Any) -> bool:
    """Whether a solution stands alone: in a flat law a whole range would do, which is no second solution."""
    matrix = loop.matrix(z) * np.maximum(np.abs(z), 1e-300)
    scale = np.abs(matrix).max(axis=1)
    return bool((scale > 0).all()) and bool(np.linalg.cond(matrix / scale[:, None]) < 1e12)
