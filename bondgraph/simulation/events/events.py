"""Event iteration at an instant: conditions change, events reset stored quantities, until nothing changes any more.

The truth of a condition *just after* an instant counts: where its root is zero to rounding, the flow that follows decides the side. If under
each truth value the flow leads back to the other, no motion on either side is possible: the model slides along the condition, which is
reported, not integrated (sticking needs a law of its own; Filippov, Differential Equations with Discontinuous Righthand Sides, 1988, describes
the possible interpretations). Events that accumulate are reported as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, EventNote, Hybrid, IntArray

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..constraints.constraints import Constraints
from ..initialization.initial_equations import fulfil
from ..segments.sampling import due_at, sampling_of
from ..segments.timeline import discrete_variables
from .bounds import bounds_of
from .complementarity import Companion, Instant

NOISE = 1e-13  # relative to the magnitudes: rounding in a root that is zero
REACHES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)  # relative to the magnitudes: how far the flow is followed to find a sign
SHORT = 1e-12  # relative to the time: events closer than this count as simultaneous
MOST_AT_ONCE = 60  # most simultaneous events
MOST_ROUNDS = 100  # most rounds of events that cause each other at one instant
LEFT = 3  # times in a row that an event makes its condition false before it is expected to
SHRUNK = 1e-2  # fraction of the longest interval between events: a shorter one shows that they accumulate
ALIKE = 4  # largest quotient of the factors by which the intervals between accumulating events shrink
BEYOND = 2  # in units of the rounding of a root: a crossing that the flow contradicts counts from there on
SHARE = 1e-7  # of a magnitude, and of the time in which the flow moves a state by one: steps by which rounding of roots is found
LATE = 32  # units in the last place of a time: the change of a root within it counts as zero
CLOSE = 1e-9  # relative accuracy with which a reset value must hold
UPHELD = 1e4  # in units of rounding: largest violation of a valve's sign


@dataclass(slots=True)
class EventInstant:
    """Record of an instant: the conditions that changed and the events that acted."""

    time: float
    conditions: tuple[int, ...]
    events: tuple[int, ...]


@dataclass(slots=True)
class HybridState:
    """Hybrid state of a run: time, state and mode."""

    time: float
    state: Any
    mode: Any


@dataclass(eq=False)
class Events:
    """Events of a program in a run. `magnitude`: of states and unknowns."""

    constraints: Constraints  # constraints of the program, with the program itself
    magnitude: Any
    horizon: float  # length of the run, s
    on: dict[tuple[str, int], bool] = field(default_factory=dict)  # truth of the events' conditions
    log: list[EventInstant] = field(default_factory=list)
    companion: Companion | None = None  # companion of the ideal valves, if there are any

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
        self.keys = [(e.owner, e.span.start) for e in hybrid.events]
        self.floor = np.zeros(len(self.places))  # rounding of roots that were zero at the last instant
        self.left: dict[tuple[str, int], int] = {}  # times in a row that an event made its condition false
        self.owners = np.repeat(np.arange(len(hybrid.events)), [len(e.settings) for e in hybrid.events])
        self.sampled = np.array([i for i, e in enumerate(hybrid.events) if e.sampled], dtype=int)
        self.sampling = sampling_of(hybrid.sampling(self.constants))
        delays = zip(self.sampled.tolist(), self.sampling[:, 2].tolist(), strict=True)
        self.at_once = frozenset(i for i, delay in delays if hybrid.events[i].late and not delay)
        self.settings = [s for e in hybrid.events for s in e.settings]
        self.bounds = bounds_of(self.program, self.inputs, self.constants, len(self.places))
        self.reach = np.zeros(len(self.places))  # largest range of each narrow condition that a part of a step has had
        self.spacing = np.inf  # length of the part of a step in which the last zero crossing was found, s
        # narrow conditions that a step could not be searched for to the end
        self.crowded = np.zeros(len(self.places), dtype=bool)
        # first instant, s, at which a condition that only events read comes within rounding of its threshold
        self.touches: dict[int, float] = {}
        self._find_valves()

    def _find_valves(self) -> None:
        """Store the indices of the valves' modes, events and conditions; rows are valves, columns conducting and blocking."""
        valves = () if self.companion is None else self.companion.valves
        names = self.hybrid.modes.names
        self.valve_modes = np.array([names.index(v.mode) for v in valves], dtype=int)
        self.conducts = np.array([v.conducting for v in valves])
        self.valve_events = np.array([[self.keys.index(k) for k in v.events] for v in valves], dtype=int).reshape(-1, 2)
        own = [(c.owner, c.span.start) for c in self.hybrid.conditions]
        chosen = [self.keys[i] for i in self.valve_events.ravel()]
        self.valve_conditions = np.array([k for k, key in enumerate(own) if key in chosen], dtype=int)

    def measure(self, magnitude: Array) -> None:
        """Set the magnitudes of states and unknowns."""
        self.magnitude = magnitude
        self.loops = self.constraints.loops(magnitude)
        # of the last hybrid state: itself, then its roots, their rounding and its flow
        self.last: tuple[object, tuple[Any, Any, tuple[Any, float] | None]] | None = None

    def with_values(self, constraints: Constraints, magnitude: Array) -> Events:
        """Return the same conditions for other inputs, parameters and magnitudes: for `guess`, not for a search, whose bounds stay those of the first."""
        found = copy(self)
        found.constraints, found.inputs, found.constants = constraints, constraints.inputs, constraints.constants
        found.measure(magnitude)
        return found

    # ------------------------------------------------------------ truth
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
            roots, noise, _ = self._evaluated(HybridState(at.time, at.state, mode))
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

    def stops_at_start(self, time: float) -> bool:
        """Return True if a `stop when` holds where a run begins, and see that it is recorded there: at a rest nothing becomes true."""
        stops = tuple(i for i, e in enumerate(self.hybrid.events) if e.stops and self.on.get(self.keys[i], False))
        if stops and not any(i in record.events for record in self.log for i in stops):
            self.log.append(EventInstant(time, (), stops))
        return bool(stops)

    def actives(self, at: HybridState) -> tuple[str, ...]:
        """Return the switched junctions that are off."""
        active = self.hybrid.actives(at.time, at.state, self.inputs, self.constants, at.mode)
        return tuple(name for (name, _), on in zip(self.hybrid.junctions, active.tolist(), strict=True) if on != 1.0)

    # ------------------------------------------------------------ an instant
    def due(self, time: float) -> list[int]:
        """Return the sampled events that act at an instant."""
        return [int(i) for i in self.sampled[due_at(self.sampling, time)]] if len(self.sampled) else []

    def happen(self, at: HybridState, flipped: BoolArray | None = None, due: Sequence[int] = ()) -> HybridState:
        """Return the hybrid state after all events at an instant.

        `flipped`: the conditions whose zero crossings are located there; `due`: the events sampled there. A condition that is true where a run begins
        becomes true there. Raises `RunFailed` if the events do not end.
        """
        mode = np.array(at.mode, dtype=float)
        changed = np.flatnonzero(flipped) if flipped is not None else np.array([], dtype=int)
        mode[self.places[changed]] = 1.0 - mode[self.places[changed]]
        acted: list[int] = []
        floor = self.floor
        self.count_in(HybridState(at.time, at.state, mode))
        now = self.settled(HybridState(at.time, at.state, mode))
        for _ in range(MOST_ROUNDS):
            triggers = self.triggers(now)
            triggers[self.valve_events] = False
            holds = dict(zip(self.keys, triggers.tolist(), strict=True))
            rising = [*due, *(i for i, key in enumerate(self.keys) if holds[key] and not self.on.get(key, False))]
            due = ()
            self.on |= holds
            if not rising:
                now, switching = self._with_valves(now, at)
                acted += switching
                break
            acted += rising
            now = self.set(now, [i for i in rising if i not in self.at_once])
            now = self.set(now, [i for i in rising if i in self.at_once])
            now = self.settled(self._read_anew(now))
        else:
            names = self._listed([self.hybrid.events[i] for i in acted[-4:]])
            raise RunFailed(
                "BR774", f"at t = {at.time:.9g} s {names} cause each other without end;", "let one of them ask for more"
            )
        if not acted and len(changed):
            places = self.places[changed]
            self._contradict(now, changed[now.mode[places] == at.mode[places]], floor)
        self._record(EventInstant(at.time, tuple(map(int, changed)), tuple(acted)))
        self._check_left(at.time, acted)
        return now

    def _contradict(self, at: HybridState, conditions: IntArray, floor: Array) -> None:
        """Keep conditions as they are that the flow leads back within rounding of a located zero crossing, until they are beyond doubt.

        `floor`: before this instant; it stays where conditions change again and again at an instant, each as the rounding of the others lets it.
        """
        for number in conditions[~self.steers[conditions]]:
            self.touches.setdefault(int(number), at.time)
        again = self.log and at.time - self.log[-1].time <= SHORT * abs(at.time)
        if again or len(conditions):
            most = BEYOND * self._evaluated(at)[1]
            least = np.minimum(floor, most) if again else np.zeros(len(most))
            least[conditions] = most[conditions]
            self.floor = np.maximum(self.floor, least)

    def _with_valves(self, at: HybridState, before: HybridState) -> tuple[HybridState, list[int]]:
        """Return the hybrid state with all valves as they are just after, and the events of those that switch: then another program goes on.

        `before`: the state before the instant. If other junctions have switched since, this program cannot contradict the set: the next one can.
        """
        companion = self.companion
        if companion is None or not len(self.valve_modes):
            return at, []
        instant = self._instant(at)
        said = at.mode[self.valve_modes] == self.conducts
        found = companion.conducting(instant, said)
        if (found == said).all():
            if self.actives(at) != self.actives(before) or not self._contradicted(at):
                return at, []
            other = companion.another(instant, said)
            if other is None:
                if not self._upheld(at):
                    raise companion.without_a_set(at.time)
                companion.against = at.time, frozenset()
                return at, []
            found = other
        companion.switched(at.time)
        mode = at.mode.copy()
        mode[self.valve_modes] = np.where(found, self.conducts, 1.0 - self.conducts)
        changed = np.flatnonzero(found != said)
        return HybridState(at.time, at.state, mode), [int(self.valve_events[k, 0 if found[k] else 1]) for k in changed]

    def tell_valves(self, mode: Array) -> None:
        """Add to the first record the events of the valves whose state differs from the written start."""
        if not len(self.valve_modes):
            return
        written = np.asarray(self.hybrid.start(self.constants))[self.valve_modes] == self.conducts
        on = np.asarray(mode)[self.valve_modes] == self.conducts
        acted = (int(self.valve_events[k, 0 if on[k] else 1]) for k in np.flatnonzero(on != written))
        self.log[-1] = replace(self.log[-1], events=(*self.log[-1].events, *acted))

    def _instant(self, at: HybridState) -> Instant:
        """Return all stored quantities and discrete variables, by name."""
        assert self.companion is not None
        program = self.program
        fixed = (self.inputs, self.constants, at.mode)
        stored = self.companion.stored
        stored.update(zip(program.states.names, at.state.tolist(), strict=False))
        if program.dependents.names:
            stored.update(
                zip(program.dependents.names, program.dependent(at.time, at.state, *fixed).tolist(), strict=True)
            )
        off = tuple(name for name in self.actives(at) if name not in self.companion.junctions)
        return Instant(at.time, stored, discrete_variables(self.hybrid, at.mode), off)

    def _contradicted(self, at: HybridState) -> bool:
        """Return True if the switching condition of a conducting or blocking valve holds just after this hybrid state."""
        return bool(self.triggers(at)[self.valve_events].any())

    def _upheld(self, at: HybridState) -> bool:
        """Return True if no valve has a positive effort while it blocks, or a negative flow while it conducts, beyond rounding.

        Violations below rounding are ignored, and not taken for a zero crossing later.
        """
        places = self.valve_conditions
        roots = self.roots(at.time, at.state, at.mode)
        against = np.zeros(len(roots), dtype=bool)
        against[places] = self.truth(roots)[places]
        limit = UPHELD * self.noise(at, roots)
        if (np.abs(roots[against]) > limit[against]).any():
            return False
        at.mode[self.places[against]] = 0.0
        self.floor[against] = np.maximum(self.floor[against], 2 * np.abs(roots[against]))
        return True

    def _check_left(self, time: float, acted: Sequence[int]) -> None:
        """Raise `RunFailed` if an event no longer makes its own condition false: its reset has become too small to be resolved."""
        for i in acted:
            key = self.keys[i]
            if i in self.valve_events:
                continue
            if not self.on[key]:
                self.left[key] = self.left.get(key, 0) + 1
            else:
                if self.left.get(key, 0) >= LEFT:
                    own = [h for h in self.log if i in h.events]
                    if _shrinks(np.diff([h.time for h in own])):
                        raise self._piled(time, own[-LEFT:])
                self.left[key] = 0

    def rising(self, at: HybridState) -> bool:
        """Return True if an event would act under this mode; otherwise store the truth of the conditions."""
        holds = dict(zip(self.keys, self.triggers(at).tolist(), strict=True))
        if any(held and not self.on.get(key, False) for key, held in holds.items()):
            return True
        self.on |= holds
        return False

    # ------------------------------------------------------------ just after
    def settled(self, at: HybridState) -> HybridState:
        """Return the mode in which all conditions are as just after, with the matching unknowns of loops."""
        seen: dict[bytes, int] = {}
        trail: list[Any] = []
        now = self._solved(at)
        while True:
            key = now.mode.tobytes()
            if key in seen:
                loop = np.array(trail[seen[key] :])[:, self.places]
                flipping = np.flatnonzero(np.ptp(loop, axis=0) > 0)
                between = self._between(now, flipping)
                if between is None and self._is_alike(now, trail[seen[key] :]):
                    self.floor[flipping] = 4 * self.noise(now, self.roots(now.time, now.state, now.mode))[flipping]
                    return now
                if between is None:
                    raise self._sliding(at.time, flipping)
                return between
            seen[key] = len(trail)
            trail.append(now.mode)
            truth = self._just_after(now)
            mode = now.mode.copy()
            mode[self.places] = truth
            self.count_in(HybridState(at.time, now.state, mode))
            if (mode == now.mode).all():
                return now
            now = self._solved(HybridState(at.time, now.state, mode))

    def _read_anew(self, at: HybridState) -> HybridState:
        """Return a hybrid state that events have set, with the truth of conditions whose two sides are equal there: nothing else may move them."""
        if not len(self.places):
            return at
        now = self._solved(at)
        roots, noise, _ = self._evaluated(now)
        equal = np.abs(roots) <= noise
        if not equal.any():
            return now
        mode = now.mode.copy()
        mode[self.places[equal]] = self.truth(np.zeros(len(roots)))[equal]
        return HybridState(now.time, now.state, mode)

    def _between(self, at: HybridState, conditions: IntArray) -> HybridState | None:
        """Return the mode in which each of these conditions is as where its two sides are equal, if the motion stays there.

        A law that goes through zero (a valve without pressure) ends there; one that jumps (dry friction) does not.
        """
        mode = at.mode.copy()
        mode[self.places[conditions]] = self.truth(np.zeros(len(self.places)))[conditions]
        self.count_in(HybridState(at.time, at.state, mode))
        rest = self._solved(HybridState(at.time, at.state, mode))
        if (self._just_after(rest) == (mode[self.places] == 1.0)).all():
            return rest
        return rest if self._stands(rest, conditions) else None

    def _stands(self, at: HybridState, conditions: IntArray) -> bool:
        """Return True if the rates, as they are now, leave the roots of these conditions zero but for rounding. What moves them later, such as
        a pump that is about to feed an empty tank, is an event of its own."""
        flow = self._flow(at)
        if flow is None:
            return False
        first, whole = flow
        state = np.array(at.state)
        state[: self.count] += REACHES[-1] * whole * first
        before, after = self.roots(at.time, at.state, at.mode), self.roots(at.time, state, at.mode)
        limit = self.noise(at, before)
        if not (np.maximum(np.abs(before), np.abs(after)) <= limit)[conditions].all():
            return False
        self.floor[conditions] = np.maximum(0.25 * limit, 2 * np.abs(before))[conditions]
        return True

    def _is_alike(self, at: HybridState, modes: Sequence[Any]) -> bool:
        """Return True if the rates and unknowns are equal under all these modes, as for a law that is continuous at its condition."""
        flow = self._flow(at)
        if flow is None:
            return False
        for mode in modes:
            other = self._solved(HybridState(at.time, at.state, mode))
            changed = self._flow(other)
            if changed is None:
                return False
            moved = np.concatenate([flow[1] * (changed[0] - flow[0]), (other.state - at.state)[self.count :]])
            if not (np.abs(moved) <= CLOSE * self.magnitude).all():
                return False
        return True

    def _solved(self, at: HybridState) -> HybridState:
        held = self.constraints.project(at.time, at.state, at.mode)
        return HybridState(at.time, self.loops.solve(at.time, held, at.mode), at.mode)

    def _just_after(self, at: HybridState) -> Any:
        """Return the truth of the conditions just after a hybrid state; where rounding hides it, the flow decides."""
        if not len(self.places):
            return np.zeros(0, dtype=bool)
        roots, noise, flow = self._evaluated(at)
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
        return self._rounding(at, roots, self._flow(at))

    def _evaluated(self, at: HybridState) -> tuple[Any, Any, tuple[Any, float] | None]:
        """Return the roots, their rounding errors and the flow of a hybrid state; those of the last one are kept."""
        key = at.time, at.state.tobytes(), at.mode.tobytes()
        if self.last is None or self.last[0] != key:
            roots, flow = self.roots(at.time, at.state, at.mode), self._flow(at)
            self.last = key, (roots, self._rounding(at, roots, flow), flow)
        return self.last[1]

    def _rounding(self, at: HybridState, roots: Array, flow: tuple[Any, float] | None) -> Any:
        """Return the same as `noise`; `flow`: that of the hybrid state."""
        n = len(at.state)
        times = np.empty(n + 2)
        times[:] = at.time
        times[n] += SHARE * max(abs(at.time), 1e-300)
        states = np.empty((n + 2, n))
        states[:] = at.state
        states.reshape(-1)[: n * n : n + 1] += SHARE * np.maximum(self.magnitude, np.abs(at.state))
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

    def _flow(self, at: HybridState) -> tuple[Any, float] | None:
        """Return the rates of the states, and the time in which the flow moves a state by its magnitude, or the run's length; None without rates."""
        if not self.count:
            return None
        first = self.program.derivative(at.time, at.state, self.inputs, self.constants, at.mode)[: self.count]
        speed = float((np.abs(first) / self.magnitude[: self.count]).max())
        return (first, min(self.horizon, 1 / speed if speed > 0 else np.inf)) if math.isfinite(speed) else None

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

    # ------------------------------------------------------------ what events set
    def set(self, at: HybridState, acting: Sequence[int]) -> HybridState:
        """Return the hybrid state after these events have acted, each with the values before them. Raises `RunFailed`."""
        if not acting:
            return at
        values = self.hybrid.values(at.time, at.state, self.inputs, self.constants, at.mode)
        chosen = [i for i, owner in enumerate(self.owners) if owner in acting]
        self._check(at.time, chosen, values)
        state, mode = np.array(at.state), at.mode.copy()
        free = np.ones(self.count, dtype=bool)
        for i in chosen:
            setting = self.settings[i]
            if setting.kind == "mode":
                mode[setting.position] = values[i]
            elif setting.kind == "state":
                state[setting.position], free[setting.position] = values[i], False
        now = HybridState(at.time, state, mode)
        computed = [i for i in chosen if self.settings[i].kind == "computed"]
        return self._followed(now, computed, values, free) if computed else now

    def _followed(self, at: HybridState, computed: Sequence[int], values: Array, free: BoolArray) -> HybridState:
        """Return the states after the least change that gives computed quantities the values that events set."""
        places = [self.settings[i].position for i in computed]
        wanted = values[computed]

        def missed(x: Array) -> Any:
            full = self.loops.solve(at.time, np.concatenate([x, at.state[self.count :]]), at.mode)
            return self.hybrid.targets(at.time, full, self.inputs, self.constants, at.mode)[places] - wanted

        before = missed(at.state[: self.count])
        x = fulfil(missed, at.state[: self.count], free)
        rest = np.abs(missed(x))
        size = np.maximum(np.abs(wanted), np.abs(before))
        bad = [i for i, r, s in zip(computed, rest, size, strict=True) if not r <= CLOSE * max(s, 1e-300)]
        if bad:
            names = ", ".join(f"`{self.settings[i].words}` ({self.settings[i].span.file_and_line})" for i in bad)
            raise RunFailed(
                "BR775", f"at t = {at.time:.9g} s events cannot set {names}: the model ties it to what stays as it is"
            )
        return HybridState(at.time, np.concatenate([x, at.state[self.count :]]), at.mode)

    def _check(self, time: float, chosen: Sequence[int], values: Array) -> None:
        """Raise `RunFailed` if a reset value is not finite, or if a quantity is reset twice."""
        owner: dict[tuple[str, int], int] = {}
        for i in chosen:
            setting = self.settings[i]
            if not np.isfinite(values[i]):
                raise RunFailed(
                    "BR776", f"at t = {time:.9g} s the new value of `{setting.words}` ({setting.span.file_and_line}) is not finite",
                )  # fmt: skip
            before = owner.setdefault((setting.kind, setting.position), i)
            if before != i:
                both = self._listed([self.hybrid.events[self.owners[j]] for j in (before, i)])
                raise RunFailed(
                    "BR777", f"at t = {time:.9g} s {both} set `{setting.words}` at one instant;",
                    "make one event of them, or let one of them ask that the other does not hold",
                )  # fmt: skip

    # ------------------------------------------------------------ messages
    def _record(self, happening: EventInstant) -> None:
        self.log.append(happening)
        if len(self.log) > MOST_AT_ONCE:
            first = self.log[-MOST_AT_ONCE]
            if happening.time - first.time <= SHORT * max(abs(happening.time), 1e-300):
                raise self._piled(happening.time, self.log[-MOST_AT_ONCE:])

    def _piled(self, time: float, last: Sequence[EventInstant]) -> RunFailed:
        events = dict.fromkeys(i for h in last for i in h.events)
        conditions = dict.fromkeys(i for h in last for i in h.conditions)
        what = self._listed([self.hybrid.events[i] for i in events]) if events else self.listed_conditions(conditions)
        root = "" if events else "; a root that goes through zero is written `sign(x)*sqrt(abs(x))`, without `if`"
        return RunFailed(
            "BR779", f"at t = {time:.9g} s {what} {'act' if events else 'change'} again and again in no time, {len(last)} times within "
            f"{last[-1].time - last[0].time:.3g} s:",
            f"end it by a `mode` that an event sets where little is left, and a junction that is `active` without it{root}",
        )  # fmt: skip

    def _sliding(self, time: float, conditions: IntArray) -> RunFailed:
        return RunFailed(
            "BR780", f"at t = {time:.9g} s {self.listed_conditions(conditions)} cannot hold and cannot fail: on either side the motion leads "
            "back to the other, and the model slides along between them.",
            "Give it a law for that: a `mode` that sticks and the events that set it, a hysteresis, or a smooth law (tanh) in place of the jump",
        )  # fmt: skip

    def listed_conditions(self, numbers: Iterable[int]) -> str:
        notes = [self.hybrid.conditions[i] for i in numbers]
        listed = dict.fromkeys(f"`{n.owner}` ({n.span.file_and_line})" for n in notes)
        return f"the condition{'s' * (len(listed) > 1)} in {', '.join(listed)}"

    @staticmethod
    def _listed(events: Sequence[EventNote]) -> str:
        return " and ".join(dict.fromkeys(f"`{e}` ({e.span.file_and_line})" for e in events))


def conditions_of(constraints: Constraints) -> Callable[[float, Array, Array], Any]:
    """Return a function of time, state and mode that returns the mode with the conditions on states as evaluated."""
    events = Events(constraints, np.ones(len(constraints.magnitude)), 1.0)

    def evaluated(time: float, state: Array, mode: Array) -> Any:
        events.measure(nonzero(np.abs(state)))
        return events.guess(HybridState(time, state, mode))

    return evaluated


def _shrinks(intervals: Array) -> bool:
    """Return True if intervals between events get shorter each time, by nearly one factor, and are much shorter than the longest one.

    Events that accumulate do so geometrically. Two crossings that are near each other by chance do not.
    """
    last = intervals[-LEFT:]
    if len(last) < LEFT or not (np.diff(last) < 0).all() or last[-1] >= SHRUNK * intervals.max():
        return False
    factors = last[1:] / last[:-1]
    return bool(factors.max() < ALIKE * factors.min())
