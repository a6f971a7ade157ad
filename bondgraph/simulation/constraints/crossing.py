"""Crossing of a singular pose in one long step.

Where loop joints lose rank, two branches of motion cross. The branch with a continuous tangent is smooth, but the equations for accelerations
are not usable near the pose: beside the constraints they vary like one over the distance, so a stage with an error below its tolerance can
find forces of any size. Two measures help. The right-hand side is evaluated at the projection of a state (f(P(x)) is constant across the
constraints, smooth along them), and one collocation step of high order leads from well before to well after, with its stages apart from the
pose (Gauss, 8 stages, order 16; Hairer and Wanner, Solving ODEs II, section IV.5): steps of order 5 would be too short there to keep rounding,
which grows like one over the distance squared, below a tight tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array

from ..loops.loops import Eliminated, LoopSolver
from .constraints import Constraints

# Stages of the step, and of the step with which it is compared: more where the two differ by too much. All are even, as the pose is in the middle.
ORDERS = ((8, 6), (12, 10), (16, 14))
ROUNDED = 0.1  # fraction of the difference at the order before: where so much is left with more stages it is rounding
ITERATIONS = 60
DIFFERENCE = 1e-6  # relative to the magnitudes: step of difference quotients
COMPARED = (0.05, 0.3, 0.5, 0.7, 0.95, 1.0)  # fractions of a step at which both are compared
CLOSE = 1e-13  # change by the last iteration, in magnitudes
STALLED, SLOWEST = 1e-8, 0.9  # changes below that which get no smaller than by that are rounding


@dataclass(frozen=True, slots=True)
class Crossed:
    """A step over a singular pose, in units of the magnitudes; `at` gives the states within it."""

    start: float
    size: float
    before: Any
    slopes: Any  # (stages, n)
    error: float  # largest difference of two orders at some places
    rounded: bool = False  # whether that is rounding: more stages make it no smaller

    def at(self, times: Array) -> Any:
        """Return states (not projected) at instants; shape (times, n)."""
        shares = (np.asarray(times) - self.start) / self.size
        integrals = _integrals(np.atleast_1d(shares), len(self.slopes))
        return self.before + self.size * integrals @ self.slopes


class OnConstraints:
    """Rates of the states at their projection; states and rates in units of the magnitudes."""

    def __init__(self, constraints: Constraints, loops: LoopSolver, mode: Array, unknowns: Array) -> None:
        self.constraints, self.loops, self.mode, self.unknowns = constraints, loops, mode, unknowns
        self.reach, self.rates = constraints.reach, Eliminated(constraints.program).rates

    def __call__(self, time: float, scaled: Array) -> Any:
        return self.all(np.array([time]), scaled[None])[0]

    def all(self, times: Array, scaled: Array) -> Any:
        """Return the rates at several instants; shape (times, n)."""
        constraints = self.constraints
        if self.loops.affine and constraints.compiled is not None:
            rates, weak = constraints.compiled.rates(times, scaled, self.unknowns, self.mode)
            for k in np.flatnonzero(weak):
                rates[k] = self._one(times[k], scaled[k])
            return rates
        return np.stack([self._one(t, x) for t, x in zip(times, scaled, strict=True)])

    def _one(self, time: float, scaled: Array) -> Any:
        constraints = self.constraints
        state = np.concatenate([scaled * self.reach, self.unknowns])
        held = constraints.project(time, state, self.mode)
        if not self.loops.affine:
            held = self.loops.solve(time, held, self.mode)
        rates = self.rates(time, held, constraints.inputs, constraints.constants, self.mode)
        return np.asarray(rates)[: constraints.count] / self.reach


def cross(function: OnConstraints, time: float, scaled: Array, size: float, tolerance: float) -> Crossed | None:
    """Return a step of a given size, with as many stages as the tolerance asks for; None if its stages do not converge. Raises nothing."""
    state = np.concatenate([scaled * function.reach, function.unknowns])
    basis = function.constraints.tangents(time, state, function.mode)
    slopes = _slopes(function, time, scaled, basis)
    best: Crossed | None = None
    for order in ORDERS:
        crossed = _crossed(function, time, scaled, size, order, slopes, basis)
        if crossed is None:
            return best
        if best is not None and crossed.error > ROUNDED * best.error:
            return replace(min(best, crossed, key=lambda each: each.error), rounded=True)
        best = crossed
        if crossed.error <= tolerance:
            break
    return best


def _crossed(
    function: OnConstraints, time: float, scaled: Array, size: float, order: tuple[int, int], slopes: Array, basis: Array
) -> Crossed | None:  # fmt: skip
    """A step with the first number of stages, compared with one that has the second."""
    stages, fewer = order

    def stage_rates(stages: int, guess: Array | None) -> Any:
        """Return the rates at the stages of a Gauss step, by the simplified Newton iteration.

        The Jacobian is `slopes @ basis.T`, so the factorised matrix has only as many columns per stage as the motion has degrees of freedom.
        """
        places, matrix = _method(stages)
        inner = np.linalg.inv(np.eye(stages * basis.shape[1]) - size * np.kron(matrix, basis.T @ slopes))
        moved, last = guess, np.inf  # difference between the states at the stages and at the start
        if moved is None:
            moved = size * places[:, None] * function(time, scaled)
        for _ in range(ITERATIONS):
            rates = function.all(time + size * places, scaled + moved)
            rest = size * matrix @ rates - moved
            known = (inner @ (rest @ basis).ravel()).reshape(stages, -1)
            change = rest + size * matrix @ (known @ slopes.T)
            norm = float(np.abs(change).max())
            if not np.isfinite(norm) or norm > 1e3:
                return None
            moved = moved + change
            if norm < CLOSE or (norm < STALLED and norm > SLOWEST * last):
                return rates
            last = norm
        return None

    found = stage_rates(stages, None)
    if found is None:
        return None
    crossed = Crossed(time, size, scaled, found, 0.0)
    guess = crossed.at(time + size * _method(fewer)[0]) - scaled
    found = stage_rates(fewer, guess)
    if found is None:
        return None
    other = Crossed(time, size, scaled, found, 0.0)
    places = time + size * np.array(COMPARED)
    return replace(crossed, error=float(np.abs(crossed.at(places) - other.at(places)).max()))


def _slopes(function: OnConstraints, time: float, scaled: Array, basis: Array) -> Any:
    """Return the derivatives of the rates along directions, both in columns."""
    steps = DIFFERENCE * basis.T
    rates = function.all(np.full(2 * len(steps), time), np.concatenate([scaled + steps, scaled - steps]))
    return ((rates[: len(steps)] - rates[len(steps) :]) / (2 * DIFFERENCE)).T


@lru_cache(maxsize=8)
def _method(stages: int) -> tuple[Any, Any]:
    """Return nodes and matrix of the Gauss method."""
    places = (np.polynomial.legendre.leggauss(stages)[0] + 1) / 2
    return places, _integrals(places, stages)


def _integrals(shares: Array, stages: int) -> Any:
    """Integrals from 0 to `shares` of the step of the Lagrange polynomials of the stages; shape (shares, stages)."""
    x = 2 * shares - 1
    values = np.polynomial.legendre.legvander(x, stages)
    integrals = np.empty((len(x), stages))  # integrals of the Legendre polynomials from -1 to x
    integrals[:, 0] = x + 1
    for n in range(1, stages):
        integrals[:, n] = (values[:, n + 1] - values[:, n - 1]) / (2 * n + 1)
    return 0.5 * integrals @ _to_stages(stages).T


@lru_cache(maxsize=8)
def _to_stages(stages: int) -> Any:
    """Return the transposed matrix that maps values at the stages to coefficients of Legendre polynomials."""
    nodes, _ = np.polynomial.legendre.leggauss(stages)
    return np.linalg.inv(np.polynomial.legendre.legvander(nodes, stages - 1)).T
