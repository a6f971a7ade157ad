"""Search for several solutions of a model's loops at the start: then no solution is marked as the intended one.

Newton's method from many guesses at once (`numerics/multistart.py`). Convergence to another regular solution proves another solution; its absence proves
nothing, but a curve has to be very narrow to remain hidden.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np

from compiler.api import Array

from ...numerics.multistart import guesses
from .loops import LoopSolver, SeparateLoop

CLOSE = 1e-6  # relative distance within which two solutions are equal
FLOOR = 1e-13  # of the magnitude: limit of Newton's method where a law is flat at a solution (a valve without flow)
LARGEST = 100  # most unknowns of a loop that is searched
SOLVED = 1e-3  # of the largest unknown: Newton step that is left at a solution
BENT = 1e-3  # relative change of the derivative between two different solutions
BETWEEN = np.arange(1, 20) / 20
# Neighbours of a solution, to either side, in shares of the distance to another.
NEIGHBOURS = np.outer((1.0, -1.0), 0.5 ** np.arange(6, 41))
BESIDE = np.outer((1.0, -1.0), 10.0 ** np.arange(-15, 0)).ravel()  # distances from a pole, in shares of it
HALVINGS = 60
EXPLAINED, IN_A_ROW = 0.25, 3  # error of residuals told by the derivative, and at how many successive neighbours
STANDS_OUT = 64.0  # times the residuals of these neighbours: one between that is none of rounding


def other_solutions(loops: LoopSolver, time: float, state: Array, mode: Array) -> list[Any]:
    """Return solutions for the unknowns that differ from the one in `state`, each of shape (unknowns,): loop by loop, smallest first."""
    unknowns = state[loops.count :]
    if not 0 < len(unknowns) <= LARGEST:
        return []
    loops, others = loops.measured(time, state, mode), list[Any]()
    for places in loops.separate():
        loop = SeparateLoop(loops, (time, state, mode), unknowns, places)
        found = _collect(loop, [unknowns[places]], first := guesses(unknowns[places], loop.magnitude))
        found = _with_ends(loop, found, _beside_poles(loop, first))
        if len(found) > 1:  # between two solutions often lies a third one that Newton's method avoids
            between = [a + t * (b - a) for a, b in combinations(found[:4], 2) for t in BETWEEN]
            found = _collect(loop, found, np.array(between))
        ends = (loops.newton(*loop.at, loop.full(z)) for z in sorted(found[1:], key=lambda z: np.abs(z).max()))
        others += [
            z for z in ends if z is not None and _in_mode(loops, time, np.concatenate([state[: loops.count], z]), mode)
        ]
    return others


def _beside_poles(loop: SeparateLoop, guesses: Array) -> Any:
    """Return solutions of a loop of one unknown beside the zeros, between guesses, of what it divides by: one may be closer to these than any guess is,
    and there all of Newton's steps are small."""
    if guesses.shape[1] > 1 or loop.loops.program.poles is None:
        return guesses[:0]
    z = np.sort(guesses, axis=0)
    signs = np.sign(loop.divisors(z))
    places, which = (signs[1:] * signs[:-1] < 0).nonzero()
    own = np.arange(len(which)), which
    poles, _ = _halved(z[places], z[places + 1], lambda middle: np.sign(loop.divisors(middle)[own]))
    z = np.sort((poles + np.abs(poles) * BESIDE).reshape(-1, 1), axis=0)
    sides, signs = np.sign(loop.divisors(z)), np.sign(loop.residual(z)[:, 0])
    crossed = (signs[1:] * signs[:-1] < 0) & (sides[1:] == sides[:-1]).all(axis=1)
    low, high = _halved(z[:-1][crossed], z[1:][crossed], lambda middle: np.sign(loop.residual(middle)[:, 0]))
    return 0.5 * (low + high)


def _halved(low: Array, high: Array, sign: Callable[[Array], Any]) -> tuple[Any, Any]:
    """Return the ends of intervals, (intervals, 1), halved about the change of a sign in each."""
    first = sign(low)
    for _ in range(HALVINGS if len(low) else 0):
        middle = 0.5 * (low + high)
        before = (sign(middle) == first)[:, None]
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low, high


def _in_mode(loops: LoopSolver, time: float, state: Array, mode: Array) -> bool:
    """Return True if the conditions on states hold at a solution as in the mode; otherwise it solves equations of another mode."""
    hybrid = loops.program.hybrid
    if hybrid is None:
        return True
    roots = np.asarray(hybrid.roots(time, state, loops.inputs, loops.constants, mode))
    held = np.asarray(mode)[[c.position for c in hybrid.conditions]] == 1.0
    return bool(((roots == 0) | ((roots < 0) == held)).all())


def _collect(loop: SeparateLoop, found: list[Any], guesses: Array) -> list[Any]:
    """Return the known solutions, and those to which guesses lead."""
    return _with_ends(loop, found, loop.arrivals(guesses))


def _with_ends(loop: SeparateLoop, known: list[Any], ends: Array) -> list[Any]:
    """Return the known solutions, and those among the ends of Newton's method."""
    solutions = list(known)
    for z in solutions if len(ends) else ():  # most arrive at known ones
        ends = ends[~_is_near(loop, ends, z).all(axis=-1)]
    for end in ends:
        if not any(_same(loop, end, z) for z in solutions) and _regular(loop, end) and _is_solved(loop, end):
            solutions.append(end)
    return solutions


def _same(loop: SeparateLoop, a: Array, b: Array) -> bool:
    """Return True if two solutions are equal to rounding: between two regular ones the derivative along their distance must change. About a root of
    several orders, as of sinh(w) - w, Newton's method ends anywhere: no derivative is that of the residuals, and none stands out between."""
    way = b - a
    if _is_near(loop, a, b).all():
        return True
    (here, low), (there, high) = (residuals_beside(loop, z, way) for z in (a, b))
    if not here and not there and (np.abs(loop.residual(a + BETWEEN[:, None] * way)) <= np.maximum(low, high)).all():
        return True
    slopes = loop.matrix(np.array([a, b, 0.5 * (a + b)])) * way
    size = np.abs(slopes).max(axis=(0, 2))
    along = slopes.sum(axis=2) / np.where(size > 0, size, 1.0)
    return bool(np.ptp(along, axis=0).max() <= BENT)


def residuals_beside(loop: SeparateLoop, z: Array, way: Array) -> tuple[bool, Any]:
    """Return True if the derivative at a solution tells the residuals beside it, and the least, (unknowns,), that stands out of these if it does not."""
    left, slopes = loop.residual(z + NEIGHBOURS[..., None] * way) - loop.residual(z), loop.matrix(z) * way
    scale, total = np.fmax(np.abs(slopes).max(axis=1), 1e-300), slopes.sum(axis=1)
    missed = np.abs((left - NEIGHBOURS[..., None] * total) / scale).max(axis=-1)
    told = missed < EXPLAINED * np.abs(NEIGHBOURS) * np.abs(total / scale).max()
    in_a_row = np.lib.stride_tricks.sliding_window_view(told, IN_A_ROW, axis=1).all(axis=-1).any()
    return bool(in_a_row), np.maximum(STANDS_OUT * np.abs(left).max(axis=(0, 1)), np.abs(total))


def _is_near(loop: SeparateLoop, a: Array, b: Array) -> Any:
    """Return a mask of the unknowns that agree in two solutions, of which the first may have a leading axis."""
    largest = np.maximum(np.abs(a), np.abs(b)).max(axis=-1, keepdims=True)
    return np.abs(b - a) <= np.maximum(CLOSE * largest, FLOOR * loop.magnitude)


def _is_solved(loop: SeparateLoop, z: Array) -> bool:
    """Return True if a Newton step is small beside the solution, or rounding: where a law is flat at zero, the method ends beside it, half a step away."""
    step = np.linalg.solve(loop.matrix(z), loop.residual(z))
    most = max(SOLVED * np.abs(z / loop.magnitude).max(), np.finfo(float).eps)
    return bool(np.abs(step / loop.magnitude).max() <= most)


def _regular(loop: SeparateLoop, z: Array) -> bool:
    """Return True if a solution is isolated: in a flat law a whole range would be a solution, which is no second one."""
    matrix = loop.matrix(z) * np.maximum(np.abs(z), 1e-300)
    scale = np.abs(matrix).max(axis=1)
    return bool((scale > 0).all()) and bool(np.linalg.cond(matrix / scale[:, None]) < 1e12)
