"""Event loop: an integrator that locates the events of its steps, lets them act and goes on; and a pilot run with events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, BoolArray

from ...errors import RunFailed, StepsCollapsed
from ..events.indicators import HybridState
from ..events.locate import Flip, StateAt, first_flip
from ..integrators.acceptance.event_passing import HARMLESS, SHORT
from ..monitors.validity import ValidityMonitor
from ..segments.timeline import Segment, discrete_variables, mode_after, with_time_of
from ..segments.trajectory import Tolerances, Trajectory
from .integration_state import PhaseProblem
from .segment_integrator import SegmentIntegrator

if TYPE_CHECKING:
    from ..events.events import Events
    from ..integrators.compiled.run import CompiledMethod

PILOT, PILOT_STEPS, PILOT_EVENTS = 1e-3, 1000, 40  # relative tolerance, most steps and events of a pilot run
CLOSE = 1e-8  # fraction of the run: a zero crossing this soon after collapsed steps is their cause
MANY_EVENTS = 2000  # of a segment, from which on a sampled loop is looked at that grows
# Least factor of a segment, and of one such factor to the next; number of segments in a row that show a growth without bound.
GROWN, STEADY, GROWING = 1.5, 0.9, 4


class EventIntegrator(SegmentIntegrator):
    """Integrator over segments that events end."""

    def __init__(self, problem: PhaseProblem, into: Trajectory | None = None) -> None:
        super().__init__(problem, into)
        assert problem.events is not None
        self.events: Events = problem.events
        self.switched = False  # True if other junctions are off now
        self.came: HybridState | None = None  # before the last events that were located
        # segments in a row in which the states have grown as powers do, the last factor, and their largest size in magnitudes
        self.growing, self.factor, self.size = 0, 0.0, np.inf
        self.has_conditions = len(self.events.places) > 0
        self.linear = self.linear and not self.has_conditions

    def run_to_end(self, stretch: Segment, x: Array, first: bool) -> Any:
        """Integrate one segment, from event to event; return the state at its end."""
        events, result = self.events, self.result
        events.record.record.until = stretch.stop
        now = HybridState(stretch.start, x, stretch.mode)
        if first:
            self._stop_at(now.time)
        else:
            now = self._happen(HybridState(stretch.start, x, with_time_of(self.program, stretch.mode, self.mode)), None)
        self._note_growth(now.state)
        began = len(events.log)
        while True:
            self.mode = now.mode
            if self.result.stopped is not None or self._switched(now) or now.time >= stretch.stop:
                return now.state
            stop = stretch.stop if self.history is None else self.history.next_cut(now.time, stretch.stop)
            self.piece = stretch.up_to(now.time, stop, now.mode)
            x = self.run(self.piece, now.state)
            flip, self.flip, self.mode = self.flip, None, self.piece.mode
            stop = self.reached if flip is None else flip.time
            if result.handover is not None:
                result.handover = replace(result.handover, **self._carried(self.off))
                stop = result.handover.time
            result.pieces.append(Segment(self.piece.start, stop, self.mode))
            if result.handover is not None or (flip is None and stop >= stretch.stop):
                return x
            if flip is None:
                now = HybridState(stop, x, self.mode)
                continue
            if len(events.log) - began >= MANY_EVENTS:
                self.check_runaway(stop, flip.state)
            if len(events.log) >= self.most_events:
                raise RunFailed("BR764", f"more than {self.most_events} events act before t = {stop:.9g} s")
            now = self._happen(HybridState(flip.time, flip.state, self.mode), flip.conditions)

    def finish(self, last: Segment, x: Array) -> tuple[Any, Any]:
        """Return the state and the mode after the events at the very end of a run: values hold from a jump on."""
        if self.result.handover is not None:
            return x, self.mode
        if self.result.stopped is not None:
            self.result.pieces.append(Segment(self.result.stopped, self.result.stopped, self.mode))
            return x, self.mode
        events, stop = self.events, last.stop
        mode = mode_after(self.program, self.constants, stop, replace(last, mode=self.mode))
        roots = events.roots(stop, x, mode)
        equal = (roots == 0) & (events.truth(roots) != (mode[events.places] == 1.0))  # no step follows that would tell
        if (mode == self.mode).all() and not events.due(stop) and not equal.any():
            return x, self.mode
        now = self._happen(HybridState(stop, x, mode), None)
        self.result.pieces.append(Segment(stop, stop, now.mode))
        self.mode = now.mode
        return now.state, now.mode

    def _happen(self, at: HybridState, flipped: BoolArray | None) -> HybridState:
        events, powers = self.events, self.powers
        now = events.happen(at, flipped, events.due(at.time) if flipped is None else ())
        self.came = None if flipped is None else at
        if 0 < events.relative < self.tolerances.relative:
            share = events.relative / self.tolerances.relative
            self.__dict__["tolerances"] = replace(
                self.tolerances, relative=events.relative, absolute=share * self.tolerances.absolute, kept={}
            )
        self.check_forced(at.time, at.mode, now.mode, at.state)
        if powers is not None and events.log[-1].events:
            both = (powers(m.time, m.state, m.mode) for m in (at, now))
            self.result.jumps.append((next(both), next(both)))
        self._stop_at(now.time)
        return now

    def _stop_at(self, time: float) -> None:
        """End the run if a `stop when` is among the events that acted last."""
        log, events = self.events.log, self.events.hybrid.events
        if log and any(events[i].stops for i in log[-1].events):
            self.result.stopped = time

    def _switched(self, now: HybridState) -> bool:
        """Return True if the junctions that are off differ from those of this program, so that another program must go on."""
        events, choice = self.events, self.choice
        if not events.hybrid.junctions or (off := events.actives(now)) == self.off:
            return False
        self.switched = True
        if choice is None:
            return True
        left = None if self.came is None else (events, self.came)
        self.result.handover = choice.transition(now.time, now.state, now.mode, left=left, **self._carried(off))
        return True

    def _carried(self, off: tuple[str, ...]) -> dict[str, Any]:
        """Return the fields of a transition with the junctions that are off, the discrete variables, and the truth of the events' conditions."""
        events, modes = self.events, discrete_variables(self.events.hybrid, self.mode)
        return {"off": off, "modes": modes, "on": dict(events.on), "units": events.units}

    def flips_just_ahead(self, told: StepsCollapsed, stretch: Segment) -> bool:
        """Return True if a condition crosses zero so soon that no step can resolve it: a law ends there (`sqrt(x) if x > 0`)."""
        events, said = self.events, np.asarray(stretch.mode)[self.events.places] == 1.0
        for time, state in told.ahead:
            if time - told.time > CLOSE * max(self.whole, abs(told.time)) or time >= stretch.stop:
                return False
            roots = events.roots(time, state, stretch.mode)
            wrong = np.isfinite(roots) & (events.truth(roots) != said)
            if wrong.any():
                self.flip = Flip(time, state, wrong)
                self.grow(state)
                return True
        return False

    def _note_growth(self, x: Array) -> None:
        """Count a segment in which the states grow by a factor as large as before: a motion in t^n grows by ever less."""
        size = float(np.abs(x / self.tolerances.magnitude)[: len(self.program.states.names)].max(initial=0.0))
        factor = size / self.size if self.size > 0 else np.inf
        self.growing = self.growing + 1 if factor > max(GROWN, STEADY * self.factor) else 0
        self.size, self.factor = size, factor

    def check_runaway(self, time: float, x: Array) -> None:
        """Raise `RunFailed` if the states have grown from sample to sample for long: then ever more steps and events lead to the next one."""
        if self.growing >= GROWING:
            sizes = np.abs(x / self.tolerances.magnitude)[: len(self.program.states.names)]
            name = self.program.states.names[int(np.argmax(sizes))]
            raise RunFailed(
                "BR795", f"at t = {time:.9g} s a sampled loop grows without bound, `{name}` most of all: thousands of steps or events do not lead to the next "
                "sample;", "give it a smaller gain or a shorter period",
            )  # fmt: skip

    def marked(self) -> Any:
        """Return the current segment, the number of segments, and the truth of the events' conditions."""
        return self.piece, len(self.result.pieces), dict(self.events.on)

    def go_back(self, mark: Any) -> None:
        """Restore the data that `marked` returned."""
        self.piece, count, self.events.on = mark
        del self.result.pieces[count:]
        self.flip = None

    def follow(self, start: float, stop: float, stretch: Segment, state_at: StateAt, within: CompiledMethod | None = None) -> Segment:  # fmt: skip
        """Find the first event of a step, which ends it.

        Conditions that only events read change on the way, and so do those that have no effect yet.
        """
        events = self.events
        if within is not None:
            events.floor = within.values["root_floor"].copy()
        while start < stop:
            flip = first_flip(events, start, stop, stretch.mode, state_at, within)
            if flip is None or self._is_at_sample(flip.time, stretch.stop):
                break
            mode = np.array(stretch.mode)
            mode[events.places[flip.conditions]] = 1.0 - mode[events.places[flip.conditions]]
            after = HybridState(flip.time, flip.state, mode)
            events.count_in(after)
            # a root that reads the branch of another condition did not cross in the new one
            old, new = (events.roots(after.time, after.state, m) for m in (stretch.mode, mode))
            moves = not np.array_equal(old, new, equal_nan=True)
            if moves or events.rising(after) or (events.hybrid.junctions and events.actives(after) != self.off):
                self.flip = flip
                break
            if events.steers[flip.conditions].any() and not self._passes(flip, stretch.mode, mode, state_at):
                self.flip = flip
                break
            self.check_forced(flip.time, stretch.mode, mode, flip.state)
            self.result.pieces.append(Segment(self.piece.start, flip.time, stretch.mode))
            self.piece = stretch = stretch.up_to(flip.time, stretch.stop, mode)
            start = flip.time
        return stretch

    def _is_at_sample(self, time: float, stop: float) -> bool:
        """Return True if a zero crossing is at the sample that ends a segment, but for rounding: what becomes true there acts with it."""
        return stop - time <= SHORT * abs(stop) and len(self.events.due(stop)) > 0

    def _passes(self, flip: Flip, before: Array, after: Array, state_at: StateAt) -> bool:
        """Return True if the laws of both sides agree, far below the tolerance, up to the end of the step: then it need not end where they change.

        Not where a whole number of states changes: its conditions come back to zero at the next integer.

        So a continuous law runs through a state that is at rest at its condition except for rounding. A condition that changes back within this distance
        is not located: at most what the tolerance moves it by, as the sides may differ when the state comes back from farther (a damper that only pushes).
        """
        events, tolerances, count = self.events, self.tolerances, len(self.program.states.names)
        if not count:  # no step gets shorter by it, and outputs are to be those of the side that holds
            return False
        if (after[events.counted] != before[events.counted]).any():
            return False
        start, stop = self.followed
        early = np.array([start, 0.5 * (start + flip.time)])
        for time, old in zip(early, state_at(early, True), strict=True):
            if not self._kept_alike(time, (old, before), (old, after)):
                return False
        times, reach = np.array([0.5 * (flip.time + stop), stop]), np.zeros(len(events.floor))
        limit = np.zeros(len(events.floor))
        for time, old in zip(times, state_at(times, True), strict=True):
            allowed = tolerances.absolute + tolerances.relative * np.abs(old)
            beside = allowed * (np.arange(len(old)) < count)
            for state, share in ((old, HARMLESS), (old + beside, 1.0), (old - beside, 1.0)):
                both = self._under(time, state, before), self._under(time, state, after)
                if not self._are_alike(time, stop - start, both, share * allowed):
                    return False
                if state is old:
                    if (self._contradicts(time, *both[1]) & ~flip.conditions).any():
                        return False
                    reach = np.fmax(reach, np.abs([events.roots(time, *x) for x in both]).max(axis=0))
            limit = np.fmax(limit, self._moves(time, old, after, allowed))
        events.floor = np.where(flip.conditions, np.fmax(events.floor, np.fmin(reach, limit)), events.floor)
        return True

    def _moves(self, time: float, state: Array, mode: Array, allowed: Array) -> Any:
        """Return by how much the roots of conditions change at most where each state changes by what is allowed."""
        beside = np.vstack([state, state + np.diag(allowed)])
        roots = self.events.roots(np.full(len(beside), time), beside, mode)
        return np.abs(roots[1:] - roots[0]).sum(axis=0)

    def _contradicts(self, time: float, state: Array, mode: Array) -> Any:
        """Return a mask of the conditions that differ from the mode, as they read the result of a changed one: a damper that acts where its spring does."""
        events = self.events
        roots = events.roots(time, state, mode)
        wrong = np.isfinite(roots) & (events.truth(roots) != (mode[events.places] == 1.0))
        return wrong & (np.abs(roots) > events.floor)

    def _under(self, time: float, state: Array, mode: Array) -> tuple[Any, Any]:
        """Return a state with the unknowns that belong to it under a mode, if there are any; and the mode."""
        try:
            return self.loops.solve(time, state, mode), mode
        except RunFailed:
            return np.full(len(state), np.nan), mode

    def _are_alike(self, time: float, size: float, both: Sequence[tuple[Any, Any]], allowed: Array) -> bool:
        """Return True if rates, over a time, and unknowns of two states and modes differ by no more than is allowed."""
        count = len(self.program.states.names)
        self.count({"derivative": len(both)})
        before, after = (self.program.derivative(time, x, self.inputs, self.constants, m)[:count] for x, m in both)
        moved = np.concatenate([size * (after - before), (both[1][0] - both[0][0])[count:]])
        return bool((np.abs(moved) <= allowed).all()) and self._kept_alike(time, *both)

    def _kept_alike(self, time: float, before: tuple[Any, Any], after: tuple[Any, Any]) -> bool:
        """Return True if what is kept of a whole step, under one mode, agrees for two states and modes: the powers at all ports, and delayed signals."""
        history = self.history
        if history is not None and not history.are_alike(time, (before, after), self.inputs, self.tolerances.relative):
            return False
        if self.powers is None:
            return True
        one, two = (self.powers(time, *x) for x in (before, after))
        most = float(np.abs(np.concatenate([one, two])).max(initial=0.0))
        return bool((np.abs(two - one) <= HARMLESS * self.tolerances.relative * most).all())


def pilot(problem: PhaseProblem, state: Array, stretches: Sequence[Segment], magnitude: Array) -> tuple[Array, float]:
    """Return the largest magnitudes of states and unknowns in a pilot run through the events, as far as this program goes, and the time to which it goes;
    infinite if no junction goes on or off."""
    program, constants, inputs = problem.program, problem.constants, problem.inputs
    tolerances = Tolerances(PILOT, PILOT * magnitude, magnitude, np.zeros(len(state), dtype=bool))
    bare = replace(problem, powers=None, choice=None, linear=False, solver="radau", leaving=None, extremes=None)
    instants, watch = np.array([stretches[-1].stop]), ValidityMonitor(program, constants, inputs, PILOT)
    stepper = EventIntegrator(replace(bare, instants=instants, tolerances=lambda: tolerances, watch=watch))
    stepper.most_steps, stepper.most_events = PILOT_STEPS, PILOT_EVENTS
    x = np.array(state, dtype=float)
    try:
        for number, stretch in enumerate(stretches):
            x = stepper.run_to_end(stretch, x, not number)
            if stepper.switched or stepper.result.stopped is not None:
                break
    except RunFailed:
        pass  # the run itself will raise the error
    stepper.let_go()
    largest = stepper.result.peak
    pieces = stepper.result.pieces
    until = (pieces[-1].stop if pieces else stretches[0].start) if stepper.switched else np.inf
    return np.abs(state) if largest is None else np.maximum(np.abs(state), largest), until
