"""Pilot run for magnitudes: implicit Euler over the whole time in about 60 steps; L-stable, so fast modes only follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from compiler.api import Array, Program

from ...numerics.scales import largest_of_group
from ..constraints.constraints import Constraints
from ..integrators.compiled.pilot_run import CompiledPilotRun, CompiledPilotStep
from ..integrators.pilot import schedule as pilot
from ..integrators.pilot.schedule import Conditions, StepSchedule, unit_numbers
from ..loops.loops import Eliminated, LoopSolver
from ..segments.timeline import Segment, always, follower, signals_on
from .free_response import LARGEST, FreeResponse, free_response, in_whole_state

STEPS = 60  # steps of the pilot run
COARSE = 1000  # factor on the part of a signal that a step of the run may overlook
EXPLODED = 1e3  # growth factor in the second half of the run that counts as explosion
STIFFER = 1e4  # ratio of rates to those at the start beyond which the free linear motion is not valid
SMALLEST_STEP = 1e-12  # fraction of the whole run: with shorter steps the pilot run ends
SMALLEST_ANGLE = 1e-12  # rad, and rad/s: smaller values that symmetry leaves are rounding


class PilotObservation(Protocol):
    """Monitor of states on the way; once it reports, later states are not valid any more."""

    def look(self, time: float, state: Array, mode: Array) -> object | None: ...

    def conditions(self, mode: Array) -> Conditions | None:
        """Return the conditions of the program with their truth in a mode, if it observes these and nothing else; else None."""
        ...


@dataclass(frozen=True, slots=True)
class PilotObserver:
    """Result of a pilot run: the largest magnitudes, those from the motion at the beginning, shape (n,), and the time at which it gave up."""

    largest: Any
    beginning: Any
    stopped: float | None


def smallest_angles(program: Program, mechanisms: Sequence[str] = ()) -> Any:
    """Return the rounding level of angles of mechanisms and of their rates, for all states and unknowns; 0 for others.

    Other states with unit 1, as all in a model of bare numbers, may be as small as they like.
    """
    kept, key = program.kept, ("angles", tuple(mechanisms))
    if key not in kept:
        names, units = program.variables.names, program.variables.units
        owned = [any(name.startswith(f"{m}.") for m in mechanisms) for name in names]
        angles = [o and unit in ("1", "1/s") for o, unit in zip(owned, units, strict=True)]
        kept[key] = np.where(angles, SMALLEST_ANGLE, 0.0)
    return kept[key]


def smallest_speeds(program: Program, constraints: Constraints, state: Array, first: Segment) -> Any:
    """Return the rounding level of speeds of what rolls, as of a ball that turns in its place on a turntable; 0 for others."""
    speed = constraints.rolling_speed(first.start, state, first.mode)
    result, places = np.zeros(len(state)), constraints.speeds
    result[places] = np.where(np.array(program.variables.units)[places] == "m/s", SMALLEST_ANGLE * speed, 0.0)
    return result


class PilotRun:
    """Pilot run by implicit Euler in about 60 steps; a step is halved where Newton's method fails."""

    def __init__(
        self, program: Program, constants: Array, inputs: Array, state: Array, constraints: Constraints | None = None,
        smallest: Array | None = None,
    ) -> None:  # fmt: skip
        """`smallest`: rounding levels, shape (n,)."""
        self.constraints = constraints
        self.program, self.constants, self.inputs = program, constants, inputs
        self.state, self.largest = np.array(state, dtype=float), np.abs(state)
        self.stopped: float | None = None  # time at which it gave up
        self.beginning = self.largest  # magnitudes with the reach of the motion by the forces at the start
        self.free: list[Any] = []  # that reach, and these magnitudes, where another run from this state has found them
        self.differential = np.arange(len(state)) < len(program.states.names)
        self.smallest = np.zeros(len(state)) if smallest is None else smallest
        self.kinds = unit_numbers(program)
        self.found = self.state  # result of the last step, before projection
        self.noted = 0  # number of records of time and magnitudes
        self.far, self.until = np.zeros(pilot.NOTES), np.zeros((pilot.NOTES, len(state)))
        self.eliminated = Eliminated(program)
        self.rows, self.columns = program.pattern
        self.compiled = CompiledPilotStep(program, inputs, constants, self.smallest)

    def peak(self, stretches: Sequence[Segment], choice: PilotObservation | None) -> Any:
        """Return the largest magnitudes on the way, as far as the pilot run gets."""
        first = stretches[0]
        if not self.free:
            self.free += [self._reach(first), self.beginning]
        reach, self.beginning = self.free
        whole, taken = stretches[-1].stop - first.start, 0
        if not whole > 0:  # a part that is shorter than rounding
            return self.largest
        loop = None if choice and choice.conditions(first.mode) is None else self._loop(reach)
        for stretch in stretches:
            length = stretch.stop - stretch.start
            usual = length / max(2, min(STEPS, round(STEPS * length / whole)))
            pace = StepSchedule(stretch.start, usual, taken, usual, SMALLEST_STEP * whole, stretch.stop)
            follows = self._follows(stretch, len(stretches), whole)
            while pace.size > pace.smallest and not follows(pace.time, pace.time + pace.size):
                pace.size *= 0.25
            conditions = choice.conditions(stretch.mode) if choice else None
            if loop is not None and conditions is not None:
                loop.observe(conditions)
            while pace.time < stretch.stop and pace.taken < pilot.MOST_STEPS:
                if loop is not None:
                    if loop.go(self, pace, first.start, stretch.mode):  # all but the last step of a segment
                        return self.largest
                    if not choice and _ends(pace, follows) and loop.finish(self, pace):
                        continue
                if not self._further(pace, follows, stretch.mode):
                    if pace.size < pace.smallest:
                        return self._given_up(first.start, pace.time)
                    continue
                if choice and choice.look(pace.time, self.found, stretch.mode) is not None:
                    return self.largest
                if reach is not None:
                    self.largest = np.maximum(self.largest, reach(self.found))
                self._note(pace.time - first.start)
            if pace.time < stretch.stop:
                return self._given_up(first.start, pace.time)
            taken = pace.taken
        return self.largest

    def _reach(self, first: Segment) -> Callable[[Any], Any] | None:
        """Return a function for the reach of a free motion from a state, or None if unknown; set the beginning from the forces at the start."""
        fixed, count = (self.inputs, self.constants, first.mode), int(self.differential.sum())
        if self.differential.all():
            if len(self.state) > LARGEST:  # a large matrix is not even formed
                return None
            jacobian, basis = self.program.jacobian(first.start, self.state, *fixed), None
        elif self.constraints is not None and len(self.eliminated.places) == len(self.state) - count:
            basis = self.constraints.tangents(first.start, self.state, first.mode)
            jacobian = self._on_constraints(first, basis)
        else:
            return None
        reach = None if jacobian is None else free_response(jacobian, self.program.native is not None)
        if jacobian is None or reach is None:
            return None
        slope = self.eliminated.rates(first.start, self.state, *fixed)[:count]
        away = reach.rest(slope if basis is None else basis.T @ slope)
        found = in_whole_state(reach, basis, len(self.state))
        if basis is None and self._stiffens(first, reach):
            return None
        if np.isfinite(away).all():
            whole = away if basis is None else np.concatenate([basis @ away, np.zeros(len(self.state) - count)])
            self.beginning = np.maximum(self.largest, np.abs(self.state + whole) + found(whole))
        return found

    def _stiffens(self, first: Segment, reach: FreeResponse) -> bool:
        """Return True if the rates grow so much along a free linear motion that it never gets there: a reaction whose product decays by its square."""
        far = reach(self.state)
        there = np.array([self.state + far, self.state - far])
        found = self.program.jacobian(first.start, there, self.inputs, self.constants, first.mode)
        return reach.fastest > 0 and not reach.is_slower_than(STIFFER * reach.fastest, found)

    def _loop(self, reach: Callable[[Any], Any] | None) -> CompiledPilotRun | None:
        """Return the loop over steps of the source, if the steps need no projection; else None."""
        if self.constraints or not self.differential.all():
            return None
        assert reach is None or isinstance(reach, FreeResponse)
        return CompiledPilotRun(
            self.compiled, None if reach is None else (reach.amplitudes, reach.inverse, reach.scale)
        )

    def _further(self, pace: StepSchedule, follows: Callable[[float, float], bool], mode: Array) -> bool:
        """Make one step and return True; if it fails, shorten the next one."""
        pace.taken += 1
        if pace.taken == pilot.CAREFUL:  # a state grows all the time, as at the foot of a pulse: go on with usual steps
            pace.size = pace.usual
        if pace.time + 1.001 * pace.size >= pace.stop:
            pace.size = pace.stop - pace.time
            if pace.size > pace.smallest and not follows(pace.time, pace.stop):
                pace.size *= 0.75
        found = self._sure_step(pace.time, pace.size, mode, pace.taken < pilot.CAREFUL)
        if found is None:
            pace.size *= 0.25
            return False
        pace.time = pace.stop if pace.time + 1.001 * pace.size >= pace.stop else pace.time + pace.size
        pace.size = min(pace.usual, 2 * pace.size)
        self.found = found
        self.state = found if self.constraints is None else self.constraints.project(pace.time, found, mode)
        self.largest = np.maximum(self.largest, np.abs(found))
        return True

    def _note(self, far: float) -> None:
        """Record the magnitudes up to the time `far`."""
        if self.noted < pilot.NOTES and (not self.noted or far >= pilot.AGAIN * self.far[self.noted - 1]):
            self.far[self.noted], self.until[self.noted] = far, self.largest
            self.noted += 1

    def _given_up(self, start: float, time: float) -> Any:
        """Return the magnitudes where the pilot run ends before the run does.

        A state that has grown without bound in the second half counts with its earlier magnitude: the tolerance of an exploding state would be useless
        for everything that the run reports before.
        """
        self.stopped = time
        half = int((self.far[: self.noted] <= 0.5 * (time - start)).sum())
        before = self.until[half - 1] if half else self.largest
        return np.where((before > 0) & (self.largest > EXPLODED * before), before, self.largest)

    def _follows(self, stretch: Segment, stretches: int, whole: float) -> Callable[[float, float], bool]:
        """Return the test that a step resolves the signals of time, also at the ends of a segment, which may be the crest of a pulse."""
        if not 1 < stretches <= STEPS:
            return always
        known = signals_on(self.program, self.inputs, self.constants, stretch, whole)
        return follower(self.program, self.inputs, self.constants, stretch, known, COARSE)

    def _on_constraints(self, first: Segment, basis: Array) -> Any:
        """Return the Jacobian of the motions that loop joints allow, with multipliers eliminated; None if the multipliers are not determined."""
        count, size = len(basis), len(self.state)
        whole = np.zeros((size, size))
        whole[self.rows, self.columns] = self.eliminated.entries(
            first.start, self.state, self.inputs, self.constants, first.mode
        )
        try:
            follow = np.linalg.solve(whole[count:, count:], whole[count:, :count])
        except np.linalg.LinAlgError:
            return None
        return basis.T @ (whole[:count, :count] - whole[:count, count:] @ follow) @ basis

    def _sure_step(self, time: float, size: float, mode: Array, careful: bool) -> Any:
        """Return the state after a step; where a state grows fast, two half steps must agree, because implicit Euler overshoots growth."""
        found = self._step(self.state, time + size, size, mode)
        if found is None or not careful:
            return found
        # A state that stays within its earlier magnitude needs no check.
        beyond = np.maximum(pilot.GROWN * np.abs(self.state), pilot.SAME * self.largest)
        sizes = np.where(self.differential, np.maximum(np.abs(found), self.largest), 0.0)
        peers = pilot.SLIGHT * largest_of_group(sizes, self.kinds)
        least = np.maximum(peers, self.smallest)
        grows = self.differential & (np.abs(found) > np.maximum(beyond, least)) & (self.state != 0)
        if not grows.any():
            return found
        middle = self._step(self.state, time + 0.5 * size, 0.5 * size, mode)
        end = None if middle is None else self._step(middle, time + size, 0.5 * size, mode)
        return None if end is None or (np.abs(found) > pilot.SAME * np.abs(end))[grows].all() else found

    def _step(self, begin: Array, time: float, size: float, mode: Array) -> Any:
        """Return the state at the end of a step; None if Newton's method fails."""
        x = self._guess(time, begin, mode) if len(self.program.unknowns.names) else begin
        return self.compiled.step(begin, x, self.largest, (time, size), mode)

    def _guess(self, time: float, begin: Array, mode: Array) -> Any:
        """Return the state at the start of a step, with the unknowns of loops for the end of the step if they are near the known ones.

        The step solves for them anyway, and a search from far away would cost more than the whole pilot run.
        """
        loops = LoopSolver(self.program, self.constants, self.inputs, self.largest)
        if loops.affine:
            return loops.solve(time, begin, mode)
        found = loops.newton(time, begin, mode, begin[loops.count :])
        return begin if found is None else np.concatenate([begin[: loops.count], found])


def _ends(pace: StepSchedule, follows: Callable[[float, float], bool]) -> bool:
    """Return True if the next step ends the segment, and resolves the signals of time."""
    if pace.taken + 1 == pilot.CAREFUL or pace.time + 1.001 * pace.size < pace.stop:
        return False
    return pace.stop - pace.time <= pace.smallest or follows(pace.time, pace.stop)
