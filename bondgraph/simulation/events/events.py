"""Event iteration at an instant: conditions change, events reset stored quantities, until nothing changes any more.

Events that accumulate, and events that cause each other without end, are reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from compiler.api import Array, BoolArray, IntArray

from ...errors import RateNotFinite, RunFailed
from ..integrators.acceptance.event_indicators import REACHES
from ..integrators.acceptance.event_passing import MOST_ROUNDS, OFTEN, SHORT
from ..integrators.tolerances import FINEST
from ..segments.sampling import due_at, sampling_of
from .bounds import bounds_of
from .complementarity import Companion
from .indicators import EventIndicators, HybridState
from .mode_iteration import reread, settled
from .resets import listed_events, reset
from .valves import ValveSwitching

MOST_AT_ONCE = 60  # most simultaneous events
LEFT = OFTEN  # times in a row that an event makes its condition false before it is expected to
SHRUNK = 1e-2  # fraction of the longest interval between events: a shorter one shows that they accumulate
BEYOND = 2  # in units of the rounding of a root: a crossing that the flow contradicts counts from there on
TIGHTER = 1e-3  # factor on the tolerance of a run that does not resolve a condition
ALIKE_LAWS = 1e-3  # relative difference of two laws at a condition: less is none
ALIKE = 4  # largest quotient of the factors by which the intervals between accumulating events shrink
POLE = 1e3  # ratio of the rounding of a root to that a little later: it is at a pole


@dataclass(slots=True)
class EventInstant:
    """Record of an instant: the conditions that changed and the events that acted."""

    time: float
    conditions: tuple[int, ...]
    events: tuple[int, ...]


@dataclass(eq=False)
class Events(EventIndicators):
    """Events of a program in a run, with what its search for their instants has seen so far."""

    on: dict[tuple[str, int], bool] = field(default_factory=dict)  # truth of the events' conditions
    log: list[EventInstant] = field(default_factory=list)
    companion: Companion | None = None  # companion of the ideal valves, if there are any

    def __post_init__(self) -> None:
        super().__post_init__()
        hybrid = self.hybrid
        self.keys = [(e.owner, e.span.start) for e in hybrid.events]
        self.sampled = np.array([i for i, e in enumerate(hybrid.events) if e.sampled], dtype=int)
        self.sampling = sampling_of(hybrid.sampling(self.constants))
        delays = zip(self.sampled.tolist(), self.sampling[:, 2].tolist(), strict=True)
        self.at_once = frozenset(i for i, delay in delays if hybrid.events[i].late and not delay)
        self.bounds = bounds_of(self.program, self.inputs, self.constants, len(self.places))
        companion = self.companion
        self.valves = ValveSwitching(self, companion, self.keys) if companion is not None and companion.valves else None

    def _forget(self) -> None:
        super()._forget()
        self.left: dict[tuple[str, int], int] = {}  # times in a row that an event made its condition false
        self.reach = np.zeros(len(self.places))  # largest range of each narrow condition that a part of a step has had
        self.record.record.spacing = np.inf
        # narrow conditions that a step could not be searched for to the end
        self.crowded = np.zeros(len(self.places), dtype=bool)
        # first instant, s, at which a condition that only events read comes within rounding of its threshold
        self.touches: dict[int, float] = {}
        self.infinite: dict[int, HybridState] = {}  # first state at which a condition that decides something is so
        # last instant, s, at which the flow has contradicted each condition, and the rounding of its root there
        self.blurs: dict[int, tuple[float, float]] = {}
        self.again = 0  # times in a row that the flow has contradicted a zero crossing

    @property
    def relative(self) -> float:
        """Relative tolerance of the run, 0 where it is not known."""
        return float(self.record.record.relative)

    @relative.setter
    def relative(self, value: float) -> None:
        self.record.record.relative = value

    def anew(self, magnitude: Array) -> Events:
        other = super().anew(magnitude)
        other.on, other.log = {}, []
        return other

    def stops_at_start(self, time: float) -> bool:
        """Return True if a `stop when` holds where a run begins, and see that it is recorded there: at a rest nothing becomes true."""
        stops = tuple(i for i, e in enumerate(self.hybrid.events) if e.stops and self.on.get(self.keys[i], False))
        if stops and not any(i in record.events for record in self.log for i in stops):
            self.log.append(EventInstant(time, (), stops))
        return bool(stops)

    def due(self, time: float) -> list[int]:
        """Return the sampled events that act at an instant."""
        return self.sampled[due_at(self.sampling, time)].tolist() if len(self.sampled) else []

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
        now = settled(self, HybridState(at.time, at.state, mode))
        for _ in range(MOST_ROUNDS):
            triggers = self.triggers(now)
            acting = triggers
            if self.valves is not None:
                acting = triggers.copy()
                acting[self.valves.own] = False
            holds = dict(zip(self.keys, acting.tolist(), strict=True))
            rising = [*due, *[i for i, key in enumerate(self.keys) if holds[key] and not self.on.get(key, False)]]
            due = ()
            self.on |= holds
            if not rising:
                if self.valves is not None:
                    now, switching = self.valves.after(self, now, at, triggers)
                    acted += switching
                break
            acted += rising
            before = now
            now = reset(self, now, [i for i in rising if i not in self.at_once])
            now = reset(self, now, [i for i in rising if i in self.at_once])
            now = self._settled_again(reread(self, before, now), self.actives(before))
        else:
            names = listed_events([self.hybrid.events[i] for i in acted[-4:]])
            raise RunFailed(
                "BR774", f"at t = {at.time:.9g} s {names} cause each other without end;", "let one of them ask for more"
            )
        if len(changed):
            self._hold_slow(changed[now.mode[self.places[changed]] != at.mode[self.places[changed]]])
        if not acted and len(changed):
            places = self.places[changed]
            self._contradict(now, changed[now.mode[places] == at.mode[places]], floor)
        self._leave_poles(now)
        self._record(EventInstant(at.time, tuple(map(int, changed)), tuple(acted)))
        self._check_left(at.time, acted)
        self.check_values(now)
        return now

    def check_values(self, at: HybridState) -> None:
        """Raise `RateNotFinite` if a condition that decides something has no value, and keep the first such state of each that is infinite."""
        roots = self.evaluated(at)[0]
        for number in np.flatnonzero(~np.isfinite(roots)).tolist():
            if number not in self.infinite and self._decides(number, at):
                if np.isnan(roots[number]):
                    what = self.listed_conditions([number])
                    raise RateNotFinite("BR797", f"at t = {at.time:.9g} s {what} has no value").at(
                        at.time, at.state, at.mode
                    )
                self.infinite[number] = HybridState(at.time, at.state.copy(), at.mode.copy())

    def _decides(self, number: int, at: HybridState) -> bool:
        """Return True if anything reads a condition in this state: one beside it may leave it without effect."""
        other, fixed = at.mode.copy(), (self.inputs, self.constants)
        other[self.places[number]] = 1.0 - other[self.places[number]]
        program, hybrid = self.program, self.hybrid
        reads = hybrid.triggers, hybrid.actives, hybrid.roots, program.derivative, program.output
        here, there = ([read(at.time, at.state, *fixed, mode) for read in reads] for mode in (at.mode, other))
        return not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(here, there, strict=True))

    def jumps(self, number: int, time: float, state: Array, mode: Array) -> bool:
        """Return True if what happens, a rate or an output jumps where a condition changes: else a tolerance decides on nothing."""
        other, fixed = mode.copy(), (self.inputs, self.constants)
        other[self.places[number]] = 1.0 - other[self.places[number]]
        program, hybrid = self.program, self.hybrid
        reads = hybrid.triggers, hybrid.actives, program.derivative, program.output
        here, there = ([np.asarray(read(time, state, *fixed, m)) for read in reads] for m in (mode, other))
        return not all(
            np.allclose(a, b, rtol=ALIKE_LAWS, atol=0, equal_nan=True) for a, b in zip(here, there, strict=True)
        )

    def _hold_slow(self, changed: IntArray) -> None:
        """Keep changed conditions that are in doubt even so, as no look ahead shows them, until they are beyond the tolerance."""
        slow = changed[self.record["sought"][changed] > 0]
        if len(slow):
            self.floor[slow] = np.fmax(self.floor, self.tolerated(self.record["noise"]))[slow]

    def _contradict(self, at: HybridState, conditions: IntArray, floor: Array) -> None:
        """Keep conditions as they are that the flow leads back within rounding of a located zero crossing, until they are beyond doubt.

        After some such crossings in a row the step's polynomial makes them, where a law is stiff: the tolerance becomes tighter, so that it resolves what
        decides, and in the end they are kept until they are beyond it.

        `floor`: before this instant; it stays where conditions change again and again at an instant, each as the rounding of the others lets it.
        """
        for number in conditions[~self.steers[conditions]]:
            self.touches.setdefault(int(number), at.time)
        self.again = self.again + 1 if len(conditions) else 0
        again = self.log and at.time - self.log[-1].time <= SHORT * abs(at.time)
        if again or len(conditions):
            noise = self.evaluated(at)[1]
            most = BEYOND * noise
            self.blurs |= {int(i): (at.time, float(noise[i])) for i in conditions}
            if self.again >= LEFT and noise[conditions].any():
                self.relative = min(self.relative, max(FINEST, TIGHTER * self.relative))
                most = most if self.relative > FINEST else np.fmax(most, self.tolerated(noise))
            least = np.minimum(floor, most) if again else np.zeros(len(most))
            least[conditions] = most[conditions]
            self.floor = np.maximum(self.floor, least)

    def _settled_again(self, at: HybridState, off: Sequence[str]) -> HybridState:
        """Return the settled state after events. Where they call for other junctions than `off`, what rounding hides is for the program of these to decide."""
        after = settled(self, at)
        if self.hybrid.junctions and tuple(off) == self.actives(after) != self.actives(at):
            roots, noise, _ = self.evaluated(at)
            hidden = self.places[np.abs(roots) <= noise]
            after = replace(after, mode=after.mode.copy())
            after.mode[hidden] = at.mode[hidden]
        return after

    def _leave_poles(self, at: HybridState) -> None:
        """Lower the rounding levels that roots do not reach a little later either: at a pole, as of `1/x > 3`, rounding is larger than any root beside it."""
        flow = self.flow(at) if self.floor.any() else None
        if flow is None:
            return
        state = np.array(at.state)
        state[: self.count] += REACHES[-1] * flow[1] * flow[0]
        beside = HybridState(at.time, state, at.mode)
        if not (self.floor > np.abs(self.roots(at.time, state, at.mode))).any():
            return
        here, there = self.noise(at), self.noise(self.solved(beside))
        self.floor = np.where(here > POLE * there, np.fmin(self.floor, there), self.floor)

    def tell_valves(self, mode: Array) -> None:
        """Add to the first record the events of the valves whose state differs from the written start."""
        if self.valves is not None:
            acted = self.valves.switched(self.hybrid.start(self.constants), mode)
            self.log[-1] = replace(self.log[-1], events=(*self.log[-1].events, *acted))

    def _check_left(self, time: float, acted: Sequence[int]) -> None:
        """Raise `RunFailed` if an event no longer makes its own condition false: its reset has become too small to be resolved."""
        for i in acted:
            key = self.keys[i]
            if self.valves is not None and i in self.valves.events:
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

    def _record(self, happening: EventInstant) -> None:
        self.log.append(happening)
        if len(self.log) > MOST_AT_ONCE:
            first = self.log[-MOST_AT_ONCE]
            if happening.time - first.time <= SHORT * max(abs(happening.time), 1e-300):
                raise self._piled(happening.time, self.log[-MOST_AT_ONCE:])

    def _piled(self, time: float, last: Sequence[EventInstant]) -> RunFailed:
        events = dict.fromkeys(i for h in last for i in h.events)
        conditions = dict.fromkeys(i for h in last for i in h.conditions)
        what = listed_events([self.hybrid.events[i] for i in events]) if events else self.listed_conditions(conditions)
        root = "" if events else "; a root that goes through zero is written `sign(x)*sqrt(abs(x))`, without `if`"
        return RunFailed(
            "BR779", f"at t = {time:.9g} s {what} {'act' if events else 'change'} again and again in no time, {len(last)} times within "
            f"{last[-1].time - last[0].time:.3g} s:",
            f"end it by a `mode` that an event sets where little is left, and a junction that is `active` without it{root}",
        )  # fmt: skip


def _shrinks(intervals: Array) -> bool:
    """Return True if intervals between events get shorter each time, by nearly one factor, and are much shorter than the longest one.

    Events that accumulate do so geometrically. Two crossings that are near each other by chance do not.
    """
    last = intervals[-LEFT:]
    if len(last) < LEFT or not (np.diff(last) < 0).all() or last[-1] >= SHRUNK * intervals.max():
        return False
    factors = last[1:] / last[:-1]
    return bool(factors.max() < ALIKE * factors.min())
