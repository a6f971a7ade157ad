"""Continuation of a solution of loops in time along its branch: Newton's method from the last solution may arrive at another one that has moved near.

A guess counts where its first correction does nearly all, so that any other solution is many corrections away (Kantorovich), and where signs are kept that
differ between neighbours: of the determinant, or, if a pole lies between them, of what is divided by. A step counts where, too, it is corrected by little
beside its way, and the determinant, where it has fallen, changes little between places of it, or by jumps where laws bend; else it is halved. Branches that
cross, rather than come near each other, are passed: there the equations hold to rounding.
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
# of an unknown: corrections that need not be small beside the way, that are rounding, and none
SLIGHT, ROUNDED, RESTS = 1e-6, 1e-9, 1e-12
HOLDS = 1e-5  # of the terms of an equation: what may be left of it
FIRST, FEWEST, SMALLEST = 1e-6, 32, 1e-9  # steps of a segment: the first, the least number of them, and the smallest
UNSEEN = 8.0  # of the smallest steps: within them a solution with the same signs is the same
GAPS, SUCCESSIVE = np.array([512.0, 1.0]), 32  # in smallest steps, over which an infinite rate is passed; in a row
SOONER, NEARER = 0.125, 0.8  # share of such a gap, and of its way, within which a solution is after it
STEEP, SMALL = 1e-2, 1e-300  # the way to the nearest solution, as a share of that to any other; the least of any
AHEAD = 2.0 ** np.arange(-10.0, 20.0)  # in smallest steps
PLACES = np.arange(17) / 16  # of a step
CHANGED = np.log(4.0)  # the most that the logarithm of a determinant changes between two places, except by a jump
HALVINGS, AT_A_JUMP = 24, 2.0**-12  # of the way between two places, and what may be left of it, to a jump
ZOOMS, MARGIN = 18, 64.0  # to the least determinant, and the factor on rounding there
ULPS = np.finfo(float).eps * np.array([-3.0, -1.0, 0.0, 1.0, 2.0])


class Continuation:
    """Solutions from `start` to `stop` in one mode: the last knots, from each to the next by a step. No step is longer than between two of `places`."""

    def __init__(self, loops: LoopSolver, start: float, state: Array, mode: Array, stop: float, places: Array) -> None:
        self.loops, self.mode, self.stop, self.places = loops.measured(start, state, mode), mode, stop, places
        self.length, self.step, self.passed = stop - start, FIRST * (stop - start), 0
        self.least: Any = 0.0  # way of each unknown in a few of the smallest steps
        self.times, self.states = [start], [np.asarray(state, dtype=float)]
        self.signs, self.largest = (a[0] for a in self._determinants(np.array([start]), self.states[0][None])[:2])
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
        self.least = UNSEEN * SMALLEST * self.length * np.abs(speeds).max(axis=0)
        later = self.places[self.places > start]
        end = min(float(later.min(initial=self.stop)), self.stop)
        size, smallest = min(self.step, self.length / FEWEST), SMALLEST * self.length
        while size >= smallest:
            time = end if start + 1.25 * size >= end else start + size
            guess = last + (time - start) * speeds[-1]
            ends, good, moved = self._near(np.array([time]), guess[None])
            most = BESIDE * (time - start) * np.abs(speeds).max(axis=0) + SLIGHT * scale
            if good[0] and (moved[0] <= most).all() and self._is_branch(time, ends[0]):
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

    def _is_branch(self, time: float, state: Array) -> bool:
        """Return True if a step stays on its branch: there are solutions in between whose determinants change little, or another branch crosses."""
        start, last, places = self.times[-1], self.states[-1], PLACES
        times, guesses = start + places * (time - start), last + places[:, None] * (state - last)
        ends, good, _ = self._near(times[1:-1], guesses[1:-1])
        if good.all() and (np.abs([*ends, state] - last) <= RESTS * self.loops.magnitude).all():
            return True  # it rests, as where a law is flat throughout
        states = np.concatenate([last[None], ends, state[None]])
        signs, sizes, *_ = self._determinants(times, states)
        with np.errstate(all="ignore"):
            changes = np.abs(np.diff(sizes)) > CHANGED
        low = np.fmin(sizes[:-1], sizes[1:]) < self.largest - CHANGED
        same = good.all() and (signs[1:] == self.signs).all()
        if same and all(
            self._jumps(times[k : k + 2], states[k : k + 2], sizes[k : k + 2]) for k in np.flatnonzero(changes & low)
        ):
            return True
        for _ in range(ZOOMS):
            times, guesses = start + places * (time - start), last + places[:, None] * (state - last)
            least = int(self._determinants(times, guesses)[1].argmin())
            places = places[max(least - 1, 0)] + PLACES * (places[min(least + 1, 16)] - places[max(least - 1, 0)])
        there = guesses[least] + np.tile(ULPS, 5)[:, None] * np.maximum(np.abs(last), np.abs(state))
        left = self.loops.residual(times[least] * (1.0 + np.repeat(ULPS, 5)), last, self.mode, there)
        return bool((np.abs(left).min(axis=0) <= MARGIN * np.ptp(left, axis=0)).all())

    def _jumps(self, times: Array, states: Array, sizes: Array) -> bool:
        """Return True if the determinant keeps its sign between two solutions and changes by one jump: where a law bends the branch goes on."""
        (early, later), (first, last), (low, high) = times, states, sizes
        for _ in range(HALVINGS):
            time = 0.5 * (early + later)
            there, *_ = self._near(np.array([time]), 0.5 * (first + last)[None])
            signs, size, *_ = self._determinants(np.array([time]), there)
            if not self._balance(np.array([time]), there, np.array([True]))[0] or (signs[0] != self.signs).any():
                break  # rounding of the jump itself, or none
            if abs(size[0] - low) < abs(size[0] - high):
                early, first, low = time, there[0], size[0]
            else:
                later, last, high = time, there[0], size[0]
        near = later - early <= AT_A_JUMP * (times[1] - times[0])
        return bool(near and abs(high - low) > CHANGED and max(abs(low - sizes[0]), abs(high - sizes[1])) <= CHANGED)

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
        return float(self._determinants(np.array([time]), state[None])[0][0, 0]) if regular else 0.0

    def _keep(self, time: float, state: Array) -> None:
        """Store a knot."""
        self.times, self.states = [*self.times[-LAST:], time], [*self.states[-LAST:], state]
        signs, sizes, *_ = self._determinants(np.array([time]), state[None])
        self.signs, self.largest = np.where(signs[0] != 0, signs[0], self.signs), np.fmax(sizes[0], self.largest)

    def _near(self, times: Array, guesses: Array) -> tuple[Any, Any, Any]:
        """Return solutions from guesses, a mask of those that count, and the corrections."""
        ends, solved = self.loops.solved(times, guesses, self.mode)
        first, signs, exact = self._first_corrections(times, guesses)
        ends[exact] = guesses[exact]  # also where branches cross, and Newton's method has no step
        moved, rounding = np.abs(ends - guesses), ROUNDED * np.maximum(np.abs(ends), self.loops.magnitude)
        solved = self._balance(times, ends, solved)
        exact |= solved & ((moved <= rounding) & (np.abs(first) <= rounding)).all(axis=-1)
        nearly = (np.abs(ends - guesses - first) <= NEARLY * moved + rounding).all(axis=-1)
        same = signs == self.signs
        nearly |= (moved <= self.least).all(axis=-1)  # where a law bends within them, no correction is nearly all
        return ends, same[:, 1:].all(axis=-1) & (exact | (solved & nearly & same[:, 0])), moved

    def _balance(self, times: Array, states: Array, solved: Array) -> Any:
        """Return a mask of solutions whose equations hold: where a slope is infinite, as of a root at zero, no correction is large."""
        with np.errstate(all="ignore"):
            terms = (np.abs(self.loops.matrix(times, states[0], self.mode, states)) * np.abs(states)[:, None]).sum(
                axis=-1
            )
            left = np.abs(self.loops.residual(times, states[0], self.mode, states))
        return solved & (left <= np.fmax(HOLDS * terms, self.usual)).all(axis=-1)

    def _first_corrections(self, times: Array, states: Array) -> tuple[Any, Any, Any]:
        """Return the first corrections of Newton's method, not a number where there are none, the signs of `_determinants`, and a mask of exact solutions."""
        signs, _, slopes, rows = self._determinants(times, states)
        with np.errstate(all="ignore"):
            values = self.loops.residual(times, states[0], self.mode, states)
            zero, values = ~values.any(axis=-1), values / rows
        solvable = ((signs[:, 0] != 0) & np.isfinite(values).all(axis=-1))[:, None]
        first = np.linalg.solve(np.where(solvable[..., None], slopes, np.eye(len(rows[0]))), -values[..., None])[..., 0]
        return np.where(solvable, first * self.loops.magnitude, np.nan), signs, zero

    def _determinants(self, times: Array, states: Array) -> tuple[Any, Any, Any, Any]:
        """Return the signs of the determinants, 0 where there are none, and of what the laws divide by; the logarithms of the determinants; the matrices in
        units of the unknowns and of their rows, and these."""
        loops = self.loops
        with np.errstate(all="ignore"):
            slopes = loops.matrix(times, states[0], self.mode, states) * loops.magnitude
            rows = np.abs(slopes).max(axis=-1)
            slopes = slopes / rows[..., None]
            fine = np.isfinite(slopes).all(axis=(-1, -2))
            sign, size = np.linalg.slogdet(np.where(fine[:, None, None], slopes, 0.0))
            signs, size = sign[:, None], size + np.log(rows).sum(axis=-1)
            poles = loops.program.poles
            if poles is not None:
                below = poles(times, loops.full(states[0], states), loops.inputs, loops.constants, self.mode)
                signs = np.concatenate([signs, np.sign(below)], axis=1)
        return signs, size, slopes, rows
