"""Equilibrium of a model with events: the mode holds at the equilibrium, and samples would set the same values again.

A law that is sampled (`every`) is at rest where x' = f(x, m) vanishes and the held values m are their own successors, m = g(x, m), whatever its
period: m' = (g(x, m) - m)/T has the same equilibrium, and is used in the search. Conditions and `when`s are examined where the search ends; if
they differ there, it goes on in the mode that they give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ..constraints.constraints import Constraints
from ..equilibrium.conserved import with_sums_kept
from ..equilibrium.dense import ROUNDING, EquilibriumSearch
from ..equilibrium.search import equilibrium, found_by
from ..segments.sampling import sampling_of
from ..segments.timeline import Segment
from .events import Events
from .indicators import HybridState

MOST_MODES = 30  # most modes in which an equilibrium is searched
SAME = 1e-9  # relative to the magnitudes: change of a state or sampled value by an event that counts as none
FARTHEST = 1e8  # relative to the first magnitudes: beyond it a counter would stop because of rounding
STEP = 2.0**-13  # relative to a magnitude: difference step for sampled values, accurate enough for Newton's method


def rest_with_events(
    constraints: Constraints, state: Array, first: Segment, events: Events, sums: Array
) -> HybridState:
    """Return the hybrid state at the equilibrium, with its mode; `sums`: factors of the states in sums that every motion keeps. Raises `RunFailed` if
    there is none."""
    visited = []
    at = HybridState(first.start, np.asarray(state, dtype=float), np.array(first.mode))
    sampled = sampled_settings(constraints)
    for _ in range(MOST_MODES):
        segment, slack = replace(first, mode=at.mode), np.zeros(len(at.mode))
        if sampled:
            search = SampledSearch(constraints, segment, sampled)
            full = found_by(search, search.joined(at.state, at.mode))
            rest, mode = search.split(full)
            at = HybridState(at.time, with_sums_kept(sums, constraints, at.state, rest, segment), mode)
            slack[search.places] = search.slack(full)
        else:
            rest = equilibrium(constraints, at.state, segment, sums)
            at = HybridState(at.time, with_sums_kept(sums, constraints, at.state, rest, segment), at.mode)
        events.measure(np.abs(at.state))
        events.log.clear()
        after = events.happen(at, due=events.due(at.time))
        moved = np.abs(after.state - at.state) > SAME * np.maximum(np.abs(after.state), np.abs(at.state))
        other = np.abs(after.mode - at.mode) > SAME * np.maximum(np.abs(after.mode), np.abs(at.mode)) + slack
        if not moved[: events.count].any() and not other.any():
            return after
        key = (after.mode.tobytes(), *(f"{x:.12g}" for x in after.state))
        if key in visited:
            break
        visited.append(key)
        at = after
    acted = ", ".join(dict.fromkeys(str(events.hybrid.events[i]) for h in events.log for i in h.events))
    raise RunFailed(
        "BR757", f"no equilibrium was found: in no mode that holds at a rest does the model stay there{f' ({acted})' * bool(acted)}; the conditions of the "
        "model make it go to and fro, as a thermostat does",
    )  # fmt: skip


def sampled_settings(constraints: Constraints) -> tuple[tuple[int, int, float], ...]:
    """Return, for each sampled setting, its index among all settings and in the mode, and its period in s.

    Raises `RunFailed` for samples that set stored quantities.
    """
    hybrid = constraints.program.hybrid
    if hybrid is None:
        return ()
    periods = iter(sampling_of(hybrid.sampling(constraints.constants))[:, 0].tolist())
    result, place = [], 0
    for event in hybrid.events:
        period = next(periods) if event.sampled else 0.0
        for setting in event.settings:
            if event.sampled and setting.kind != "mode":
                raise RunFailed(
                    "BR758", f"no equilibrium was found: `{event}` sets `{setting.words}` at each sample, which is stored",
                )  # fmt: skip
            if event.sampled:
                result.append((place, setting.position, period))
            place += 1
    return tuple(result)


class SampledSearch(EquilibriumSearch):
    """Rates of states and of sampled values; a full state is states, sampled values, unknowns of loops."""

    def __init__(self, constraints: Constraints, first: Segment, sampled: Sequence[tuple[int, int, float]]) -> None:
        super().__init__(constraints, first)
        program = constraints.program
        assert program.hybrid is not None
        self.hybrid, self.states = program.hybrid, len(program.states.names)
        self.settings = [s for s, _, _ in sampled]
        self.places, self.periods = np.array([p for _, p, _ in sampled]), np.array([t for _, _, t in sampled])
        modes = program.hybrid.modes
        self.names = (*program.states.names, *(modes.names[p].removeprefix("late ") for p in self.places))
        units = (*program.states.units, *(modes.units[p] for p in self.places))
        self.group(units)
        self.count = len(self.names)
        self.largest, self.unseen, self.drag = np.zeros((3, self.count))
        self.sums = np.zeros((0, self.count))

    def joined(self, state: Array, mode: Array) -> Any:
        """Return a full state from the program's state and the mode."""
        return np.concatenate([state[: self.states], mode[self.places], state[self.states :]])

    def split(self, full: Array) -> tuple[Any, Any]:
        """Return the program's state and the mode of a full state."""
        mode = np.array(self.mode, dtype=float)
        mode[self.places] = full[self.states : self.count]
        return np.concatenate([full[: self.states], full[self.count :]]), mode

    def at(self, full: Array) -> tuple[Any, Any, Any]:
        """Return the same as `EquilibriumSearch.at`, by differences."""
        state, mode = self.split(full)
        full = self._solved(self.joined(self.constraints.project(self.time, state, mode), mode))
        state, mode = self.split(full)
        if self.unread is None:
            from ..equilibrium.steady import unread_states

            own = unread_states(self.constraints, self.time, state, mode)
            self.unread = np.concatenate([own, np.zeros(len(self.places), dtype=bool)])
        if self.constraints:
            basis = self.constraints.tangents(self.time, state, mode)
            self.basis = np.zeros((self.count, basis.shape[1] + len(self.places)))
            self.basis[: self.states, : basis.shape[1]] = basis
            self.basis[self.states :, basis.shape[1] :] = np.eye(len(self.places))
        self.largest = np.maximum(self.largest, np.abs(full[: self.count]))
        steps, jacobian = STEP * self.scale(np.zeros(self.count)), np.zeros((self.count, self.count))
        for i, step in enumerate(steps):
            ends = []
            for sign in (1.0, -1.0):
                moved = full.copy()
                moved[i] += sign * step
                ends.append(self.rates(self._solved(moved)))
            jacobian[:, i] = (ends[0] - ends[1]) / (2 * step)
        self.loop_terms, rates = np.zeros(self.count), self.rates(full)
        first = max(np.abs(full[: self.count]).max(), np.abs(rates).max() * self.periods.max())
        self.farthest = min(self.farthest, FARTHEST * first) if first > 0 else self.farthest
        return full, rates, jacobian

    def derivatives_with_terms(self, full: Array) -> Any:
        """Return None: differences have no terms."""

    def rates(self, full: Array) -> Any:
        """Return the rates as `EquilibriumSearch.rates`: a sampled value approaches its successor within a period."""
        state, mode = self.split(full)
        fixed = (*self.fixed[:2], mode)
        own = np.array(self.program.derivative(self.time, state, *fixed))[: self.states]
        new = np.asarray(self.hybrid.values(self.time, state, *fixed))[self.settings]
        rates = np.concatenate([own, (new - mode[self.places]) / self.periods]) - self.drag * full[: self.count]
        rates[self.unread] = 0.0
        return rates

    def slack(self, full: Array) -> Any:
        """Return the changes of sampled values that count as none: those that relative changes of all coordinates by `SAME` make, and rounding."""
        here, change = self.rates(full), np.zeros(self.count)
        for i in np.flatnonzero(full[: self.count]):
            moved = full.copy()
            moved[i] *= 1 + SAME
            change += np.abs(self.rates(self._solved(moved)) - here)
        return change[self.states :] * self.periods + ROUNDING * self.scale(np.zeros(self.count))[self.states :]

    def not_finite(self, slope: Array, full: Array) -> RunFailed:
        """Return the same as `EquilibriumSearch.not_finite`."""
        bad = ", ".join(f"`{self.names[i]}`" for i in np.flatnonzero(~np.isfinite(slope))[:4])
        return RunFailed("BR759", f"at t = {self.time:.9g} s the rate of {bad} is not finite")

    def drivers(self, place: int) -> str:
        """Return the same as `EquilibriumSearch.drivers`."""
        return super().drivers(place) if place < self.states else "it is set anew at each sample"

    def cancels(self, full: Array, slope: Array) -> bool:
        """Return False: `EquilibriumSearch.cancels` is not applied to samples."""
        return False

    def _solved(self, full: Array) -> Any:
        state, mode = self.split(full)
        return self.joined(self.loops.solve(self.time, state, mode), mode)
