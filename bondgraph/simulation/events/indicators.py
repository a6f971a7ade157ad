"""Event indicators of a program: their rounding, and the truth of the conditions at and just after an instant.

The truth of a condition *just after* an instant counts: where its root is zero to rounding, the flow that follows decides the side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, Hybrid

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..constraints.constraints import Constraints

NOISE = 1e-13  # relative to the magnitudes: rounding in a root that is zero
REACHES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)  # relative to the magnitudes: how far the flow is followed to find a sign
SHARE = 1e-7  # of a magnitude, and of the time in which the flow moves a state by one: steps by which rounding of roots is found
LATE = 32  # units in the last place of a time: the change of a root within it counts as zero


@dataclass(slots=True)
class HybridState:
    """Hybrid state of a run: time, state and mode."""

    time: float
    state: Any
    mode: Any


@dataclass(eq=False)
class EventIndicators:
    """Conditions of a program in a run, with its inputs and parameters. `magnitude`: of states and unknowns, 0 where it is not known."""

    constraints: Constraints  # constraints of the program, with the program itself
    magnitude: Any
    horizon: float  # length of the run, s

    def __post_init__(self) -> None:
        self.program, self.inputs = self.constraints.program, self.constraints.inputs
        self.constants = self.constraints.constants
        hybrid = self.program.hybrid
        assert hybrid is not None
        self.hybrid: Hybrid = hybrid
        self.count = len(self.program.states.names)
        self.measure(self.magnitude)
        self.places = np.array([c.position for c in hybrid.conditions], dtype=int)
        self.counted = list(hybrid.counted)
        self.strict = np.array([c.strict for c in hybrid.conditions], dtype=bool)
        self.all_strict = bool(self.strict.all())
        self.steers = np.array([c.steers for c in hybrid.conditions], dtype=bool)
        self.floor = np.zeros(len(self.places))  # rounding of roots that were zero at the last instant

    def measure(self, magnitude: Array) -> None:
        """Set the magnitudes of states and unknowns."""
        self.magnitude = magnitude
        self.loops = self.constraints.loops(magnitude)
        # of the last hybrid state: itself, then its roots, their rounding and its flow
        self.last: tuple[object, tuple[Any, Any, tuple[Any, float] | None]] | None = None

    def measure_anew(self, magnitude: Array, at: HybridState) -> None:
        """Set better magnitudes, and what counts as rounding of the roots at this hybrid state by them: where nothing was known, a magnitude was 1."""
        if not self.floor.any() or (magnitude == self.magnitude).all():
            self.measure(magnitude)
            return
        roots = self.roots(at.time, at.state, at.mode)
        before = self.noise(at, roots)
        self.measure(magnitude)
        share = np.minimum(self.noise(at, roots) / nonzero(before), 1.0)
        against = self.truth(roots) != at.mode[self.places]  # the mode was decided, and the root has to leave first
        self.floor = np.maximum(share * self.floor, np.where(against, np.minimum(self.floor, 2 * np.abs(roots)), 0.0))

    def with_values(self, constraints: Constraints, magnitude: Array) -> EventIndicators:
        """Return the same conditions for other inputs, parameters and magnitudes: for `guess`, not for a search, whose bounds stay those of the first."""
        found = copy(self)
        found.constraints, found.inputs, found.constants = constraints, constraints.inputs, constraints.constants
        found.measure(magnitude)
        return found

    def roots(self, time: Array | float, state: Array, mode: Array) -> Any:
        """Return left minus right side of each condition; leading axes as of time and state."""
        return self.hybrid.roots(time, state, self.inputs, self.constants, mode)

    def truth(self, roots: Array) -> Any:
        """Return the truth of the conditions with these roots."""
        below = roots < 0
        return below if self.all_strict else below | ((roots == 0) & ~self.strict)

    def guess(self, at: HybridState) -> Any:
        """Return a mode with the conditions as evaluated at a hybrid state; a root below rounding counts as zero."""
        mode = np.array(at.mode, dtype=float)
        for number in range(len(self.places) + 1):
            roots, noise, _ = self.evaluated(HybridState(at.time, at.state, mode))
            truth = self.truth(np.where(np.abs(roots) <= noise, 0.0, roots))
            if (truth == mode[self.places]).all() and (number or not self.counted):
                break
            mode[self.places] = truth
            self.count_in(HybridState(at.time, at.state, mode))
        return mode

    def count_in(self, at: HybridState) -> None:
        """Put the whole numbers that belong to the conditions of a mode into it."""
        if self.counted:
            at.mode[self.counted] = self.hybrid.counts(at.time, at.state, self.inputs, self.constants, at.mode)

    def triggers(self, at: HybridState) -> Any:
        """Return a mask of the events whose conditions hold."""
        return self.hybrid.triggers(at.time, at.state, self.inputs, self.constants, at.mode) == 1.0

    def actives(self, at: HybridState) -> tuple[str, ...]:
        """Return the switched junctions that are off."""
        active = self.hybrid.actives(at.time, at.state, self.inputs, self.constants, at.mode)
        return tuple(name for (name, _), on in zip(self.hybrid.junctions, active.tolist(), strict=True) if on != 1.0)

    def solved(self, at: HybridState) -> HybridState:
        """Return a hybrid state on the constraints, with the unknowns of loops that belong to it."""
        held = self.constraints.project(at.time, at.state, at.mode)
        return HybridState(at.time, self.loops.solve(at.time, held, at.mode), at.mode)

    def just_after(self, at: HybridState) -> Any:
        """Return the truth of the conditions just after a hybrid state; where rounding hides it, the flow decides."""
        if not len(self.places):
            return np.zeros(0, dtype=bool)
        roots, noise, flow = self.evaluated(at)
        truth = self.truth(roots)
        doubtful = np.abs(roots) <= noise
        self.floor = np.zeros(len(roots))
        if not doubtful.any():
            return truth
        truth[doubtful] = at.mode[self.places][doubtful] == 1.0  # where nothing moves, the truth values stay
        moved, sought = np.zeros(len(roots)), doubtful.copy()
        for reach in REACHES:
            ahead = None if flow is None else self._ahead(at, reach, *flow)
            if ahead is None:
                break
            change, again = (self.roots(m.time, m.state, at.mode) - roots for m in ahead)
            # where iterations disagree on the sign, time constants are shorter than this reach
            found = sought & (np.fmax(np.abs(change), np.abs(again)) > 4 * noise)
            moved[found] = np.where(change * again > 0, change, 0.0)[found]
            sought &= ~found
            if not sought.any():
                break
        truth[moved != 0] = moved[moved != 0] < 0
        # A root that stays at zero must not cross; one that leaves zero must be located when it returns, and be doubtful then. Nor must that of a law
        # which is still on the other side: the law would change again and again.
        still = np.maximum(0.25 * noise, 2 * np.abs(roots))
        behind = self.steers & (truth != self.truth(roots))
        self.floor = np.where(doubtful, np.where((moved != 0) & ~behind, 0.25 * noise, still), 0.0)
        return truth

    def noise(self, at: HybridState, roots: Array) -> Any:
        """Return the rounding error of each root: from the states, in units of their magnitudes, and from the instant: its change along the flow
        during the uncertainty of a located one, with unknowns of loops fixed."""
        return self._rounding(at, roots, self.flow(at))

    def evaluated(self, at: HybridState) -> tuple[Any, Any, tuple[Any, float] | None]:
        """Return the roots, their rounding errors and the flow of a hybrid state; those of the last one are kept."""
        key = at.time, at.state.tobytes(), at.mode.tobytes()
        if self.last is None or self.last[0] != key:
            roots, flow = self.roots(at.time, at.state, at.mode), self.flow(at)
            self.last = key, (roots, self._rounding(at, roots, flow), flow)
        return self.last[1]

    def _rounding(self, at: HybridState, roots: Array, flow: tuple[Any, float] | None) -> Any:
        """Return the same as `noise`; `flow`: that of the hybrid state."""
        n = len(at.state)
        sizes = self.sizes(flow)
        times = np.empty(n + 2)
        times[:] = at.time
        times[n] += SHARE * max(abs(at.time), 1e-300)
        states = np.empty((n + 2, n))
        states[:] = at.state
        states.reshape(-1)[: n * n : n + 1] += SHARE * np.maximum(sizes, np.abs(at.state))
        shares = [NOISE / SHARE, 0.0]
        if flow is not None:
            first, whole = flow
            late = LATE * math.ulp(max(abs(at.time), 1e-300))
            span = max(SHARE * whole, late)
            times[-1] += span
            states[-1, : self.count] += span * first
            shares[1] = late / span
        change = np.abs(self.roots(times, states, at.mode) - roots)
        if not np.isfinite(change).all():
            change = np.where(np.isfinite(change), change, 0.0)
        return shares[0] * change[:-1].sum(axis=0) + shares[1] * change[-1]

    def flow(self, at: HybridState) -> tuple[Any, float] | None:
        """Return the rates of the states, and the time in which the flow moves a state by its magnitude, or the run's length; None without rates."""
        if not self.count:
            return None
        first = self.program.derivative(at.time, at.state, self.inputs, self.constants, at.mode)[: self.count]
        magnitude = self.magnitude[: self.count]
        speed = float((np.abs(first) / np.where(magnitude > 0, magnitude, np.inf)).max())
        return (first, min(self.horizon, 1 / speed if speed > 0 else np.inf)) if np.isfinite(first).all() else None

    def sizes(self, flow: tuple[Any, float] | None) -> Any:
        """Return the magnitudes; where one is not known, how far a flow moves the state in its time: a unit of its own would be a size of no meaning."""
        if flow is None or (self.magnitude[: self.count] > 0).all():
            return self.magnitude
        sizes = np.array(self.magnitude)
        sizes[: self.count] = np.where(sizes[: self.count] > 0, sizes[: self.count], flow[1] * np.abs(flow[0]))
        return sizes

    def _ahead(
        self, at: HybridState, reach: float, first: Array, whole: float
    ) -> tuple[HybridState, HybridState] | None:
        """Return the hybrid state a little later, such that no state moves by more than a fraction `reach`: by Heun's method, and iterated once more."""
        span = reach * whole

        def moved(rates: Array) -> HybridState:
            state = np.concatenate([at.state[: self.count] + span * rates, at.state[self.count :]])
            return HybridState(at.time + span, self.loops.solve(at.time + span, state, at.mode), at.mode)

        def between(later: HybridState) -> Any:
            rates = self.program.derivative(later.time, later.state, self.inputs, self.constants, at.mode)
            return 0.5 * (first + rates[: self.count])

        try:
            heun = moved(between(moved(first)))
            return heun, moved(between(heun))
        except RunFailed:
            return None

    def listed_conditions(self, numbers: Iterable[int]) -> str:
        """Return the conditions with these numbers, and their lines, as words."""
        notes = [self.hybrid.conditions[i] for i in numbers]
        listed = dict.fromkeys(f"`{n.owner}` ({n.span.file_and_line})" for n in notes)
        return f"the condition{'s' * (len(listed) > 1)} in {', '.join(listed)}"


def conditions_of(constraints: Constraints) -> Callable[[float, Array, Array], Any]:
    """Return a function of time, state and mode that returns the mode with the conditions on states as evaluated."""
    indicators = EventIndicators(constraints, np.zeros(len(constraints.magnitude)), 1.0)

    def evaluated(time: float, state: Array, mode: Array) -> Any:
        indicators.measure(np.abs(state))
        return indicators.guess(HybridState(time, state, mode))

    return evaluated
