"""Delayed signals: their values are stored step by step as polynomials, and read when the delay has passed.

A program with delays is wrapped, so that its callers get the delayed inputs at the time of the call. No step is longer than the shortest delay
(the method of steps: Bellen and Zennaro, Numerical Methods for Delay Differential Equations, 2003, section 3.1). Where a delayed quantity
jumps, the signal jumps later: the run stops there, and reads on each side of the jump the value of that side.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...results.checkpoint import DelayHistory

DEGREE = 5  # degree of the polynomials, equal to that of the solver's dense output
# Every second one is a node, the others show the error.
PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * DEGREE + 1) / (2 * DEGREE))
SIGNS = np.where(np.arange(len(PLACES)) % 2, -1.0, 1.0)[:, None]
TO_COEFFICIENTS = np.linalg.inv(np.vander(PLACES[::2], increasing=True))
BETWEEN = np.vander(PLACES[1::2], DEGREE + 1, increasing=True)
SHARE = 0.1  # of the relative tolerance: largest error of a polynomial
NARROW = 4  # halvings of a step: a polynomial of so many, between longer ones, is at a pulse or a bend
DEEPEST, MOST_PIECES = 30, 1000  # halvings of a step, and its polynomials
ROUNDING = 64  # units in the last place of a time
JUMP = 1e-9  # relative change that counts as a jump
ROUNDS = 50  # iterations at the start for signals that depend on each other's past
NEWTON = 10  # steps of Newton's method if these do not settle
ROUNDED = 1e-14  # relative difference that is rounding
EPS = float(np.finfo(float).eps)
NOISE = 100.0  # what is below so many times the change by a last place of the states is rounding

StateAt = Callable[[Any], Any]  # instants (k,) -> states (k, n)


def history_of(program: Program, parameters: Array, before: DelayHistory | None) -> History | None:
    """Return the history of a program; None if it has no delays."""
    if program.delays is None:
        return None
    return History(program, program.constants(parameters), before)


class History:
    """Past values of the delayed signals of a program. `before`: the history of another program of the run."""

    def __init__(self, program: Program, constants: Array, before: DelayHistory | None = None) -> None:
        assert program.delays is not None
        self.plain, self.constants, self.count = program, constants, program.delays.count
        self.names = program.inputs.names[len(program.inputs.names) - self.count :]
        self.lags = np.asarray(program.delays.lags(constants), dtype=float)
        self.starts: list[float] = []  # starts of the stored steps
        self.stops: list[float] = []
        self.pieces: list[Any] = []  # (degree + 1, signals)
        self.first = np.zeros(self.count)  # values before the run
        self.last = self.first  # values at the end of the stored steps
        self.largest = np.zeros(self.count)  # magnitudes of the signals
        units = program.inputs.units[len(program.inputs.names) - self.count :]
        self.alike = np.array(
            [[one == other for other in units] for one in units]
        )  # a difference rounds as its terms do
        self.window = (-np.inf, np.inf)  # times are clipped to this interval
        self.cuts: list[float] = []  # instants at which a delayed signal jumps
        if before is not None:
            self._take(before)
        self.program = self._wrapped(program)

    def _take(self, before: DelayHistory) -> None:
        """Take over the history of another program; a signal unknown there is 0 before that history ends."""
        known = [before.names.index(n) if n in before.names else -1 for n in self.names]
        self.starts, self.stops, self.cuts = list(before.starts), list(before.stops), list(before.cuts)
        self.first = np.array([before.first[k] if k >= 0 else 0.0 for k in known])
        self.last = np.array([before.last[k] if k >= 0 else 0.0 for k in known])
        for piece in before.pieces:
            self.pieces.append(np.stack([piece[:, k] if k >= 0 else 0 * piece[:, 0] for k in known], axis=1))

    def past(self, count: int | None = None) -> DelayHistory:
        """Return the stored history, of the first `count` steps or of all, for another program or another run."""
        count = len(self.starts) if count is None else count
        last = self.last if count == len(self.starts) else self.pieces[count - 1].sum(axis=0) if count else self.first
        starts, stops, pieces = self.starts[:count], self.stops[:count], self.pieces[:count]
        return DelayHistory(self.names, starts, stops, pieces, list(self.cuts), self.first, last)

    # ------------------------------------------------------------ reading
    def at(self, time: float) -> Any:
        """Return the delayed signals at a time; shape (signals,)."""
        low, high = self.window
        margin = ROUNDING * np.spacing(max(abs(time), 1e-300))
        seen = min(max(time, low + margin), high - margin) if high - low > 4 * margin else 0.5 * (low + high)
        values = np.array(self.first)
        for i, lag in enumerate(self.lags):
            then = seen - lag
            place = bisect_right(self.starts, then) - 1
            if place >= 0:
                start, stop = self.starts[place], self.stops[place]
                share = min((then - start) / (stop - start), 1.0) if stop > start else 1.0
                values[i] = np.polynomial.polynomial.polyval(share, self.pieces[place][:, i])
        return values

    def filled(self, time: Array | float, inputs: Array) -> Any:
        """Return the inputs with the delayed signals at one or several times filled in."""
        inputs = np.asarray(inputs, dtype=float)
        if np.ndim(time) == 0:
            if inputs.ndim > 1:
                inputs = inputs.copy()
                inputs[..., -self.count :] = self.at(float(time))
                return inputs
            return np.concatenate([inputs[: -self.count], self.at(float(time))])
        times = np.asarray(time, dtype=float)
        late = np.stack([self.at(float(t)) for t in times.reshape(-1)]).reshape(*times.shape, self.count)
        full = np.broadcast_to(inputs, (*times.shape, inputs.shape[-1])).copy()
        full[..., -self.count :] = late
        return full

    def _wrapped(self, program: Program) -> Program:
        """Return the program with delayed signals filled in at each call."""

        def wrap(function: Callable[..., Any]) -> Callable[..., Any]:
            def called(time: Array | float, state: Array, inputs: Array, constants: Array, *mode: Any) -> Any:
                return function(time, state, self.filled(time, inputs), constants, *mode)

            return called

        def signals(time: Array | float, inputs: Array, constants: Array, mode: Array) -> Any:
            return program.signals(time, inputs, constants, mode)

        names = (
            "derivative", "jacobian_entries", "jacobian", "output", "claims", "dependent", "sensitivities", "forced", "powers", "holds",
            "limit_values", "invariant", "invariant_slopes", "solved", "bends", "peaks",
        )  # fmt: skip
        present: dict[str, Any] = {n: wrap(getattr(program, n)) for n in names if getattr(program, n, None) is not None}
        hybrid, delays = program.hybrid, program.delays
        assert delays is not None
        if hybrid is not None:
            inner = ("roots", "counts", "triggers", "values", "targets", "actives", "conjugates", "mode_at")
            within: dict[str, Any] = {n: wrap(getattr(hybrid, n)) for n in inner}
            hybrid = replace(hybrid, **within)
        delays = replace(delays, values=wrap(delays.values))
        return replace(program, signals=signals, hybrid=hybrid, delays=delays, **present)

    # ------------------------------------------------------------ writing
    def saved(self) -> tuple[Any, ...]:
        """Return the stored history, for `restore`."""
        return list(self.starts), list(self.stops), list(self.pieces), list(self.cuts), self.last

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Restore a stored history: remove everything that was added since `saved`."""
        self.starts, self.stops, self.pieces, self.cuts, self.last = saved
        self.window = (-np.inf, np.inf)

    def begin(self, time: float, state: Array, inputs: Array, mode: Array) -> Any:
        """Set the delayed signals before the run to their values at its start, iterated if they depend on each other; return by how much they still differ.

        Where they only go to and fro, as in a line without losses, Newton's method finds the values; not where each makes the other larger.
        """
        delays = self.program.delays
        assert delays is not None
        values, constants = delays.values, self.constants
        self.starts, self.stops, self.pieces, self.cuts = [], [], [], [time + lag for lag in self.lags]

        def after(before: Array) -> Any:
            self.first = before
            return np.asarray(values(time, state, inputs, constants, mode))

        present, changes = after(self.first), [0.0]
        while _differs(present, self.first) and len(changes) <= ROUNDS:
            changes.append(float(np.abs(present - self.first).max()))
            present = after(present)
        if _differs(present, self.first) and changes[-1] <= changes[1]:
            present = self._solved(after, max(changes))
        self.last = self.first
        return present - self.first if _differs(present, self.first) else np.zeros(self.count)

    def _solved(self, after: Callable[[Array], Any], size: float) -> Any:
        """Set the delayed signals before the run by Newton's method; return what they are at its start. `size`: of a change of them."""
        present = after(self.first)
        for _ in range(NEWTON):
            here = self.first
            slopes = np.stack([after(here + size * unit) - present for unit in np.eye(self.count)], axis=1) / size
            try:
                here = here + np.linalg.solve(np.eye(self.count) - slopes, present - here)
            except np.linalg.LinAlgError:
                return after(here)
            present = after(here)
            if not _differs(present, here):
                break
        return present

    def keep(self, span: tuple[float, float], state_at: StateAt, inputs: Array, mode: Array, relative: float) -> None:
        """Store the future values of the delayed signals, from an accepted step: as many polynomials as they need within a tolerance.

        The solver chose the step by the states; what is delayed may be faster (a source), or bend where an earlier bend of it arrives.
        """
        delays = self.program.delays
        assert delays is not None
        waiting, first_new = [(*span, 0)], len(self.starts)
        depths: list[int] = []
        while waiting:
            start, stop, depth = waiting.pop()
            times: Any = start + (stop - start) * PLACES
            sampled = np.asarray(delays.values(times, state_at(times), inputs, self.constants, mode))
            values, between = sampled[::2], sampled[1::2]
            jumps = np.abs(values[0] - self.last).max() > JUMP * max(float(np.abs(values).max()), 1e-300)
            self.largest = np.fmax(self.largest, np.abs(sampled).max(axis=0))
            piece = TO_COEFFICIENTS @ (values - values[0])
            piece[0] += values[0]  # so that what stands still is delayed without rounding
            rounding = ROUNDED * (self.alike * self.largest).max(axis=1)
            miss = np.abs(BETWEEN @ piece - between)
            off = miss > np.fmax(SHARE * relative * self.largest, rounding)
            if off.any() or jumps:  # it may be no more than what last places of time and states do, where terms cancel
                states = state_at(times)
                near = delays.values(times, states * (1.0 + EPS * SIGNS), inputs, self.constants, mode)
                noise = NOISE * np.abs(np.asarray(near) - sampled).max(axis=0)
                off &= miss > noise
                jumps = jumps and bool((np.abs(values[0] - self.last) > noise).any())
            if off.any() and depth < DEEPEST and len(depths) < MOST_PIECES:
                joint = self._joint(start, stop)
                middle = 0.5 * (start + stop) if joint is None else joint
                deeper = depth + (joint is None)
                waiting += [(middle, stop, deeper), (start, middle, deeper)]
                continue
            if jumps and not depths:
                self._cut(start)
            self.last = values[-1]
            self.starts.append(start)
            self.stops.append(stop)
            self.pieces.append(piece)
            depths.append(depth)
        self._cut_in_narrow(self.starts[first_new:], depths)

    def _joint(self, start: float, stop: float) -> float | None:
        """Return the instant between two at which two stored polynomials arrive, nearest to the middle; None if there is none. What reads both bends there."""
        middle, least = 0.5 * (start + stop), ROUNDING * np.spacing(max(abs(start), abs(stop)))
        arriving = [
            self.starts[k] + lag
            for lag in self.lags
            for k in range(bisect_right(self.starts, start - lag), bisect_right(self.starts, stop - lag))
        ]
        inside = [t for t in arriving if start + least < t < stop - least]
        return min(inside, key=lambda t: abs(t - middle), default=None)

    def _cut(self, time: float) -> None:
        """Let the run stop where what happens now to the delayed signals arrives."""
        self.cuts += [time + lag for lag in self.lags]

    def _cut_in_narrow(self, starts: list[float], depths: list[int]) -> None:
        """Let the run stop within each pulse and at each bend that arrives, so that no step runs over it: in the middle of the deepest halves."""
        ends = np.flatnonzero(np.diff(depths)) + 1
        runs = list(pairwise([0, *ends, len(depths)]))
        around = [0, *(depths[low] for low, _ in runs), 0]
        for number, (low, high) in enumerate(runs):
            if depths[low] >= NARROW and depths[low] > max(around[number], around[number + 2]):
                self._cut(starts[(low + high) // 2])

    def are_alike(self, time: float, both: Sequence[tuple[Array, Array]], inputs: Array, relative: float) -> bool:
        """Return True if the future values of the delayed signals agree, within the tolerance, for two states and modes."""
        delays = self.program.delays
        assert delays is not None
        before, after = (np.asarray(delays.values(time, x, inputs, self.constants, mode)) for x, mode in both)
        return bool((np.abs(after - before) <= relative * self.largest).all())

    def next_cut(self, start: float, stop: float) -> float:
        """Return the next instant, at `stop` at the latest, at which a run from `start` must stop because a delayed signal jumps."""
        margin = ROUNDING * np.spacing(max(abs(start), abs(stop)))
        return min((c for c in self.cuts if start + margin < c < stop - margin), default=stop)


def _differs(found: Array, before: Array) -> bool:
    """Return True if signals differ by more than rounding."""
    return bool((np.abs(found - before) > ROUNDED * np.abs(found)).any())
