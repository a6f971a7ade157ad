"""Continuation of a solution of loops in time along its branch: Newton's method from the last solution may arrive at another one that has moved near.

A guess counts where its first correction does nearly all, so that any other solution is many corrections away (Kantorovich), and where the determinant
keeps its sign, which differs between neighbours. A step counts where, too, it is corrected by little beside its way; else it is halved.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import StepsCollapsed
from .branches import other_solutions
from .loops import LoopSolver

NEARLY = 0.1  # of a correction: what further ones may add to the first
BESIDE = 0.25  # of the way at the greatest of the last speeds: most that a step is corrected by
LAST = 8  # knots whose speeds count
SLIGHT, ROUNDED = 1e-6, 1e-9  # of an unknown: corrections that need not be small beside the way, and that are rounding
HOLDS = 1e-5  # of the terms of an equation: what may be left of it
FIRST, FEWEST, SMALLEST = 1e-6, 32, 1e-9  # steps of a segment: the first, the least number of them, and the smallest
GAPS, STEEP = 0.5 ** np.arange(12.0), 1e-2  # smaller ones, and how far an unknown, of its magnitude, may go there
AHEAD = 2.0 ** np.arange(-10.0, 20.0)  # in smallest steps


class Continuation:
    """Solutions from `start` to `stop` in one mode: the last knots, from each to the next by a step. No step is longer than between two of `places`."""

    def __init__(self, loops: LoopSolver, start: float, state: Array, mode: Array, stop: float, places: Array) -> None:
        self.loops, self.mode, self.stop, self.places = loops.measured(start, state, mode), mode, stop, places
        self.length, self.step = stop - start, FIRST * (stop - start)
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
        ends, good, _ = self._near(times, np.where(share == 1.0, last, first + share * (last - first)))
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
                self.step = 2.0 * (time - start)
                return self._keep(time, ends[0])
            size = 0.5 * min(size, time - start)
        # A rate that is infinite at one instant, as of the root of t, or at which two branches meet.
        for gap in smallest * GAPS:
            time = min(start + gap, end)
            (there,), solved = self.loops.solved(np.array([time]), last[None], self.mode)
            sign = self._first_corrections(np.array([time]), there[None])[1]
            if (
                time > start
                and self._balance(np.array([time]), there[None], solved)[0]
                and sign[0] * self.sign >= 0
                and _are_near(there, last, scale)
            ):
                if not any(_are_near(z, last, scale) for z in other_solutions(self.loops, time, there, self.mode)):
                    self.step = 2.0 * smallest
                    return self._keep(time, there)
                break
        names = ", ".join(f"`{n}`" for n in self.loops.program.unknowns.names[:6])
        told = StepsCollapsed(
            "BR749", f"at t = {start:.9g} s the solution of the algebraic loop of {names} ends, or meets others: none lies on its branch just after;",
            "end the run before, or put a small storage into the loop, which then goes over to another solution as the real thing does",
        )  # fmt: skip
        told.ahead = tuple((start + t, last + t * speeds[-1]) for t in smallest * AHEAD)
        raise told.at(start, last, self.mode)

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


def _are_near(a: Array, b: Array, scale: Array) -> bool:
    return bool((np.abs(a - b) <= STEEP * scale).all())
