"""Continuation of a solution of loops in time along its branch: Newton's method from the last solution may arrive at another one that has moved near.

A guess counts where its first correction does nearly all, so that any other solution is many corrections away (Kantorovich), and where the determinant
keeps its sign, which differs between neighbours. A step counts where, too, it is corrected by little beside its way; else it is halved.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed, StepsCollapsed
from .branches import other_solutions, residuals_beside
from .loops import LoopSolver, SeparateLoop

NEARLY = 0.1  # of a correction: what further ones may add to the first
BESIDE = 0.25  # of the way at the greatest of the last speeds: most that a step is corrected by
LAST = 8  # knots whose speeds count
SLIGHT, ROUNDED = 1e-6, 1e-9  # of an unknown: corrections that need not be small beside the way, and that are rounding
HOLDS = 1e-5  # of the terms of an equation: what may be left of it
FIRST, FEWEST, SMALLEST = 1e-6, 32, 1e-9  # steps of a segment: the first, the least number of them, and the smallest
GAPS, SUCCESSIVE = np.array([512.0, 1.0]), 32  # in smallest steps, over which an infinite rate is passed; in a row
SOONER, NEARER = 0.125, 0.8  # share of such a gap, and of its way, within which a solution is after it
STEEP, SMALL = 1e-2, 1e-300  # the way to the nearest solution, as a share of that to any other; the least of any
AHEAD = 2.0 ** np.arange(-10.0, 20.0)  # in smallest steps


class Continuation:
    """Solutions from `start` to `stop` in one mode: the last knots, from each to the next by a step. No step is longer than between two of `places`."""

    def __init__(self, loops: LoopSolver, start: float, state: Array, mode: Array, stop: float, places: Array) -> None:
        self.loops, self.mode, self.stop, self.places = loops.measured(start, state, mode), mode, stop, places
        self.length, self.step, self.passed = stop - start, FIRST * (stop - start), 0
        self.times, self.states = [start], [np.asarray(state, dtype=float)]
        self.sign = self._first_corrections(np.array([start]), self.states[0][None])[1][0]
        slopes = np.abs(self.loops.matrix(start, self.states[0], mode, self.states[0])) * self.loops.magnitude
        self.usual = SLIGHT * HOLDS * slopes.sum(axis=-1)  # what may be left of each equation, whatever its terms

    def beyond(self, time: float) -> float:
        """Return the last knot, which is later than an instant, after a step if it was not. Raises `StepsCollapsed` where the branch ends."""
        while self.times[-1] <= time:
            self._advance()
        return self.times[-1]

    def at(self, times: Array) -> Any:
        """Return the solutions at instants of the last step."""
        (start, stop), (first, last) = self.times[-2:], self.states[-2:]
        share = ((times - start) / (stop - start))[:, None]
        guesses = np.where(share == 1.0, last, first + share * (last - first))
        ends, good, _ = self._near(times, guesses)
        if self.passed:  # no rate is finite there: a solution counts that is between those at both ends
            slack = SLIGHT * np.abs(last - first)
            between = (ends >= np.fmin(first, last) - slack) & (ends <= np.fmax(first, last) + slack)
            good |= self._balance(times, ends, self.loops.solved(times, guesses, self.mode)[1]) & between.all(axis=-1)
        for k in np.flatnonzero(~good):
            within = Continuation(self.loops, start, first, self.mode, times[k], self.places)
            within.beyond(np.nextafter(times[k], start))
            ends[k] = within.states[-1]
        return ends

    def _advance(self) -> None:
        """Make a step, halved until it counts."""
        start, last = self.times[-1], self.states[-1]
        scale, ways = np.maximum(np.abs(last), self.loops.magnitude), np.diff(self.states, axis=0)
        speeds = ways / np.diff(self.times)[:, None] if len(ways) else np.zeros((1, len(last)))
        later = self.places[self.places > start]
        end = min(float(later.min(initial=self.stop)), self.stop)
        size, smallest = min(self.step, self.length / FEWEST), SMALLEST * self.length
        while size >= smallest:
            time = end if start + 1.25 * size >= end else start + size
            guess = last + (time - start) * speeds[-1]
            ends, good, moved = self._near(np.array([time]), guess[None])
            most = BESIDE * (time - start) * np.abs(speeds).max(axis=0) + SLIGHT * scale
            if good[0] and (moved[0] <= most).all():
                self.step, self.passed = 2.0 * (time - start), 0
                return self._keep(time, ends[0])
            size = 0.5 * min(size, time - start)
        for size in np.maximum(smallest * GAPS, 64 * np.spacing(start)):
            time = end if start + 1.25 * size >= end else start + size
            there = self._just_after(start, last, time) if self.passed < SUCCESSIVE else None
            if there is not None:
                self.passed += 1
                self.step = 2.0 * (time - start)
                return self._keep(time, there)
        names = ", ".join(f"`{n}`" for n in self.loops.program.unknowns.names[:6])
        told = StepsCollapsed(
            "BR749", f"at t = {start:.9g} s the solution of the algebraic loop of {names} ends, or meets others: none lies on its branch just after;",
            "end the run before, or put a small storage into the loop, which then goes over to another solution as the real thing does",
        )  # fmt: skip
        told.ahead = tuple((start + t, last + t * speeds[-1]) for t in smallest * AHEAD)
        raise told.at(start, last, self.mode)

    def _just_after(self, start: float, last: Array, time: float) -> Any:
        """Return the solution at an instant just after the last knot where a rate is infinite, as of the root of t, or where two branches meet: the one to
        which there is nothing near, and nearer the earlier. None if there is no such one."""
        early = min(start + max(SOONER * (time - start), 4 * np.spacing(start)), time)
        later = self._nearest(time, last)
        sooner = None if later is None else self._nearest(early, last)
        if later is None or sooner is None:
            return None
        way = later - last
        rounding = SLIGHT * np.maximum(np.abs(last), np.abs(later))
        nearer = early == time or (np.abs(sooner - last) <= NEARER * np.abs(way) + rounding).all()
        signs = {self._sign_along(t, z, way) for t, z in ((start, last), (early, sooner), (time, later))}
        return later if nearer and not {1.0, -1.0} <= signs else None

    def _nearest(self, time: float, last: Array) -> Any:
        """Return the solution at an instant that is nearest to the last knot; None if there is none, or another one near."""
        try:
            there = self.loops.solve(time, last, self.mode)
        except RunFailed:
            return None
        found = np.array([there, *other_solutions(self.loops, time, there, self.mode)])
        ways = np.abs(found - last)
        best, *others = np.argsort((ways / np.fmax(ways.max(axis=0), SMALL)).max(axis=1))
        near = ways[best] / STEEP + SLIGHT * np.maximum(np.abs(last), np.abs(found[best]))
        holds = self._balance(np.array([time]), found[best, None], np.array([True]))[0]
        return found[best] if holds and not (ways[others] <= near).all(axis=1).any() else None

    def _sign_along(self, time: float, state: Array, way: Array) -> float:
        """Return the sign of the determinant at a solution; 0 where derivatives are not those of the residuals beside it: at a root of several orders."""
        loop = SeparateLoop(self.loops, (time, state, self.mode), state, np.arange(len(state)))
        regular = residuals_beside(loop, state, way)[0]
        return float(self._first_corrections(np.array([time]), state[None])[1][0]) if regular else 0.0

    def _keep(self, time: float, state: Array) -> None:
        """Store a knot."""
        self.times, self.states = [*self.times[-LAST:], time], [*self.states[-LAST:], state]
        self.sign = self._first_corrections(np.array([time]), state[None])[1][0] or self.sign

    def _near(self, times: Array, guesses: Array) -> tuple[Any, Any, Any]:
        """Return solutions from guesses, a mask of those that count, and the corrections."""
        ends, solved = self.loops.solved(times, guesses, self.mode)
        first, sign, exact = self._first_corrections(times, guesses)
        ends[exact] = guesses[exact]  # also where branches cross, and Newton's method has no step
        moved, rounding = np.abs(ends - guesses), ROUNDED * np.maximum(np.abs(ends), self.loops.magnitude)
        solved = self._balance(times, ends, solved)
        exact |= solved & ((moved <= rounding) & (np.abs(first) <= rounding)).all(axis=-1)
        nearly = (np.abs(ends - guesses - first) <= NEARLY * moved + rounding).all(axis=-1)
        return ends, exact | (solved & nearly & (sign == self.sign)), moved

    def _balance(self, times: Array, states: Array, solved: Array) -> Any:
        """Return a mask of solutions whose equations hold: where a slope is infinite, as of a root at zero, no correction is large."""
        with np.errstate(all="ignore"):
            terms = (np.abs(self.loops.matrix(times, states[0], self.mode, states)) * np.abs(states)[:, None]).sum(
                axis=-1
            )
            left = np.abs(self.loops.residual(times, states[0], self.mode, states))
        return solved & (left <= np.fmax(HOLDS * terms, self.usual)).all(axis=-1)

    def _first_corrections(self, times: Array, states: Array) -> tuple[Any, Any, Any]:
        """Return the first corrections of Newton's method, not a number where there are none, the signs of the determinants, and a mask of exact solutions."""
        unit = self.loops.magnitude
        with np.errstate(all="ignore"):
            slopes = self.loops.matrix(times, states[0], self.mode, states) * unit
            values = self.loops.residual(times, states[0], self.mode, states)
            zero = ~values.any(axis=-1)
            rows = np.abs(slopes).max(axis=-1)
            slopes, values = slopes / rows[..., None], values / rows
        fine = np.isfinite(slopes).all(axis=(-1, -2)) & np.isfinite(values).all(axis=-1)
        sign = np.where(fine, np.linalg.slogdet(np.where(fine[:, None, None], slopes, 0.0))[0], 0.0)
        solvable = np.where((sign != 0)[:, None, None], slopes, np.eye(len(unit)))
        first = np.linalg.solve(solvable, -values[..., None])[..., 0] * unit
        return np.where((sign != 0)[:, None], first, np.nan), sign, zero
