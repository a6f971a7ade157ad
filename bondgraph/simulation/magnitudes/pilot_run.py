"""Pilot run for magnitudes: implicit Euler over the whole time in about 60 steps; L-stable, so fast modes only follow.

Its magnitudes are reliable up to a horizon: steps much longer than a period make them wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...numerics.scales import largest_of_group
from ..constraints.constraints import Constraints
from ..integrators.compiled.pilot_run import CompiledPilotRun, CompiledPilotStep
from ..integrators.compiled.selection_record import selection_record
from ..integrators.linear_algebra.sparse import FINE
from ..integrators.outcomes import CROSSED, REDUNDANT
from ..integrators.pilot import schedule as pilot
from ..integrators.pilot.schedule import Conditions, StepSchedule, unit_numbers
from ..loops.loops import Eliminated, LoopSolver
from ..monitors.state_selection import Choice
from ..segments.timeline import Segment, always, follower, signals_on
from .free_response import LARGEST, FreeResponse, free_response, in_whole_state, slopes_of

STEPS = 60  # steps of the pilot run
COARSE = 1000  # factor on the part of a signal that a step of the run may overlook
EXPLODED = 1e3  # growth factor in the second half of the run that counts as explosion
STIFFER = 1e4  # ratio of rates to those at the start beyond which the free linear motion is not valid
SMALLEST_STEP = 1e-12  # fraction of the whole run: with shorter steps the pilot run ends
LEFT = 1e-2  # relative to rounding levels: least absolute tolerance of what only rounding moves
SMALLEST_ANGLE = 1e-12  # rad, and rad/s: smaller values that symmetry leaves are rounding
ASTRAY = 1e3  # factor on the magnitudes of the beginning above which the run is suspect
FAR = 2.0  # factor on steady growth up to which a part is accepted
PARTS, SHORTER = 6, 0.1  # number of parts of the run examined then, and ratio of their lengths
SLIGHT = 1e-4  # relative to the largest state of one unit: smaller magnitudes are ignored
MOST_EXAMINED = 200  # most states for which parts of the run are examined


@dataclass(frozen=True, slots=True)
class PilotObservation:
    """Changes that end a pilot run: of the state selection, and of the conditions of events, with their truth in a mode; `rtol`: tolerance of the run."""

    choice: Choice
    conditions: Callable[[Array], Conditions] | None = None
    rtol: float = LEFT


@dataclass(frozen=True, slots=True)
class PilotObserver:
    """Result of a pilot run: the largest magnitudes, those from the motion at the beginning, shape (n,), and the time at which it gave up.

    `sure`: the largest without the step that ended behind a condition, where the mode before it may have led anywhere.
    """

    largest: Any
    beginning: Any
    stopped: float | None
    sure: Any


def smallest_angles(program: Program, mechanisms: Sequence[str] = (), kinds: Sequence[str] = ("1", "1/s")) -> Any:
    """Return the rounding level of angles of mechanisms and of their rates, or of other `kinds`, for all states and unknowns; 0 for others.

    Other states with unit 1, as all in a model of bare numbers, may be as small as they like.
    """
    kept, key = program.kept, ("angles", tuple(mechanisms), kinds)
    if key not in kept:
        names, units = program.variables.names, program.variables.units
        owned = [any(name.startswith(f"{m}.") for m in mechanisms) for name in names]
        angles = [o and unit in kinds for o, unit in zip(owned, units, strict=True)]
        kept[key] = np.where(angles, SMALLEST_ANGLE, 0.0)
    return kept[key]


def smallest_speeds(constraints: Constraints, state: Array, first: Segment) -> Any:
    """Return the rounding level of speeds of what rolls, as of a ball that turns in its place on a turntable; 0 for others."""
    speed = constraints.rolling_speed(first.start, state, first.mode)
    result, places = np.zeros(len(state)), constraints.speeds
    result[places] = np.where(
        np.array(constraints.program.variables.units)[places] == "m/s", SMALLEST_ANGLE * speed, 0.0
    )
    return result


class PilotRun:
    """Pilot run by implicit Euler in about 60 steps; a step is halved where Newton's method fails."""

    def __init__(
        self, constraints: Constraints, state: Array, smallest: Array | None = None, before: PilotRun | None = None
    ) -> None:
        """`smallest`: rounding levels, shape (n,); `before`: another run from this state, with what it looks at."""
        self.constraints, self.program = constraints, constraints.program
        self.constants, self.inputs = constraints.constants, constraints.inputs
        self.state, self.largest = np.array(state, dtype=float), np.abs(state)
        self.sure = self.largest  # without the step that changed a condition
        self.stopped: float | None = None  # time at which it gave up
        self.beginning = self.largest  # magnitudes with the reach of the motion by the forces at the start
        # that reach, and these magnitudes, where another run from this state has found them
        self.free: list[Any] = [] if before is None else before.free
        self.differential = np.arange(len(state)) < constraints.count
        self.smallest = np.zeros(len(state)) if smallest is None else smallest
        self.noted = 0  # number of records of time and magnitudes
        self.far, self.until = np.zeros(pilot.NOTES), np.zeros((pilot.NOTES, len(state)))
        self.eliminated = Eliminated(self.program)
        self.rows, self.columns = self.program.pattern
        steps, loop = (None, None) if before is None else (before.compiled, before.loop)
        if steps is None or steps.record.sparse:  # factors of another run are of no use
            steps, loop = CompiledPilotStep(self.program, self.inputs, self.constants, self.smallest), None
        self.compiled: CompiledPilotStep = steps
        self.loop: CompiledPilotRun | None = loop

    def peak(self, stretches: Sequence[Segment], ends: PilotObservation | None) -> Any:
        """Return the largest magnitudes on the way, as far as the pilot run gets."""
        first = stretches[0]
        whole, taken = stretches[-1].stop - first.start, 0
        if not self.free:
            self.free += [self._reach(first, whole), self.beginning]
        reach, self.beginning = self.free
        if not whole > 0:  # a part that is shorter than rounding
            return self.largest
        one_by_one = bool(self.constraints) and self.constraints.compiled is None
        loop = self.loop or self._loop(
            reach, None if ends is None else ends.choice, 1 if one_by_one else pilot.MOST_STEPS
        )
        self.loop = loop
        for stretch in stretches:
            length = stretch.stop - stretch.start
            usual = length / max(2, min(STEPS, round(STEPS * length / whole)))
            pace = StepSchedule(stretch.start, usual, taken, usual, SMALLEST_STEP * whole, stretch.stop)
            follows = self._follows(stretch, len(stretches), whole)
            while pace.size > pace.smallest and not follows(pace.time, pace.time + pace.size):
                pace.size *= 0.25
            if ends is not None and ends.conditions is not None:
                loop.observe(ends.conditions(stretch.mode))
            while pace.time < stretch.stop and pace.taken < pilot.MOST_STEPS:
                before = pace.time
                answer = loop.go(
                    "pilot_step" if _ends(pace, follows) else "coarse", self, pace, first.start, stretch.mode
                )
                self.sure = self.largest
                if answer == CROSSED:
                    return np.maximum(self.largest, np.abs(self.state))
                if answer not in (FINE, REDUNDANT) and pace.size < pace.smallest:
                    return self._given_up(first.start, pace.time)
                if answer == REDUNDANT or (one_by_one and pace.time > before):
                    self.state = self.constraints.project(pace.time, self.state, stretch.mode)
            if pace.time < stretch.stop:
                return self._given_up(first.start, pace.time)
            taken = pace.taken
        return self.largest

    def _reach(self, first: Segment, length: float) -> FreeResponse | None:
        """Return the free motion from a state, or None if unknown; set the beginning from the forces at the start."""
        fixed, count = (self.inputs, self.constants, first.mode), int(self.differential.sum())
        if self.differential.all():
            if len(self.state) > LARGEST:  # a large matrix is not even formed
                return None
            jacobian, basis = slopes_of(self.program, first.start, self.state, *fixed, self.smallest), None
        elif len(self.eliminated.places) == len(self.state) - count:
            basis = self.constraints.tangents(first.start, self.state, first.mode)
            jacobian = self._on_constraints(first, basis)
        else:
            return None
        reach = None if jacobian is None else free_response(jacobian, self.program.native is not None, length)
        if jacobian is None or reach is None:
            return None
        slope = self.eliminated.rates(first.start, self.state, *fixed)[:count]
        away = reach.rest(slope if basis is None else basis.T @ slope, length)
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
        return bool(reach.fastest > 0 and not reach.is_slower_than(STIFFER * reach.fastest, found))

    def _loop(self, reach: FreeResponse | None, choice: Choice | None, most: int) -> CompiledPilotRun:
        """Return the loop over steps of the source, which returns after `most` of them; in machine code it projects each on the constraints."""
        others, flags = {}, dict.fromkeys(("guessing", "multiplying", "projecting"), False)
        flags["projecting"] = self.constraints.compiled is not None
        if not self.differential.all():
            loops = LoopSolver(self.program, self.constants, self.inputs, self.largest)
            flags["multiplying"], flags["guessing"] = loops.affine, not loops.affine
            if not loops.affine:
                others["loops"] = loops.system(0.0, self.state, self.compiled.values["mode"], slice(None))
        if flags["multiplying"] or flags["projecting"]:
            others["closed"] = self.constraints.always_compiled(self.program.native is not None).values
        if choice:
            others["selection"] = selection_record(choice)
        motion = None if reach is None else (reach.amplitudes, reach.inverse, reach.scale)
        return CompiledPilotRun(self.compiled, motion, others, flags, most)

    def _given_up(self, start: float, time: float) -> Any:
        """Return the magnitudes where the pilot run ends before the run does."""
        self.stopped = time
        return before_explosion(self.largest, self.far, self.until, np.array(self.noted), np.array(time - start))

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


def before_explosion(largest: Array, far: Array, until: Array, noted: Array, reached: Array) -> Any:
    """Return magnitudes (…, n) of pilot runs that gave up at a time (…,) after their beginning; records as in `Progress`, with the same leading axes.

    A state that has grown without bound in the second half counts with its earlier magnitude: the tolerance of an exploding state would be useless
    for everything that the run reports before.
    """
    half = ((far <= 0.5 * reached[..., None]) & (np.arange(far.shape[-1]) < noted[..., None])).sum(axis=-1)
    last = np.take_along_axis(until, np.maximum(half - 1, 0)[..., None, None], axis=-2)[..., 0, :]
    before = np.where(half[..., None] > 0, last, largest)
    return np.where((before > 0) & (largest > EXPLODED * before), before, largest)


def _ends(pace: StepSchedule, follows: Callable[[float, float], bool]) -> bool:
    """Return True if the next step may end the segment; its size resolves the signals of time."""
    size = pace.usual if pace.taken + 1 == pilot.CAREFUL else pace.size
    if pace.time + 1.001 * size < pace.stop:
        return False
    pace.size = pace.stop - pace.time
    if pace.size > pace.smallest and not follows(pace.time, pace.stop):
        pace.size *= 0.75
    return True


def trusted(
    look_along: Callable[[Sequence[Segment]], PilotObserver], program: Program, stretches: Sequence[Segment], driven: bool
) -> PilotObserver:  # fmt: skip
    """Return a coarse run over the segments, or over their beginning only. `driven`: some input depends on time.

    A motion without drive swings about as far as its forces take it at first, or grows gradually; then its tolerances grow with it. Where states
    get much farther, they must do so proportionally on a tenth, a hundredth … of the run as well. The longest part that passes this test counts, or
    the shortest that passes it on its own tenth, together with the magnitudes of the beginning.
    """
    looks = [look_along(stretches)]
    found, first, beginning = looks[0].largest, stretches[0], looks[0].beginning
    if driven or len(stretches) > 1 or len(found) > MOST_EXAMINED:
        return looks[0]
    if not goes_astray(program, found, beginning):
        return looks[0]

    def largest(part: int) -> Any:
        while len(looks) <= part:
            stop = first.start + (first.stop - first.start) * SHORTER ** len(looks)
            looks.append(look_along((replace(first, stop=stop),)))
        return looks[part].largest

    def is_sound(part: int, most: int) -> bool:
        shorter = range(1, most + 1)
        return all(_follows_from(program, largest(part), largest(part + k), FAR * SHORTER**-k) for k in shorter)

    parts = [(part, PARTS - 1) for part in range(PARTS)] + [(part, 1) for part in reversed(range(PARTS))]
    sound = next((looks[part] for part, most in parts if is_sound(part, most)), looks[0])
    return replace(sound, largest=np.maximum(sound.largest, beginning), sure=np.maximum(sound.sure, beginning))


def goes_astray(program: Program, largest: Array, beginning: Array) -> Any:
    """Return True where magnitudes, shape (…, n), are far above those of the beginning."""
    return ~(largest <= ASTRAY * np.maximum(beginning, SLIGHT * _most_alike(program, beginning))).all(axis=-1)


def _follows_from(program: Program, found: Array, before: Array, times: float) -> bool:
    """Return True if magnitudes are at most `times` those of a part of the run."""
    most = times * np.maximum(before, SLIGHT * _most_alike(program, before))
    return bool((found <= np.where(most > 0, most, np.inf)).all())


def _most_alike(program: Program, values: Array) -> Any:
    """Return for every state and unknown the largest value of its unit."""
    return largest_of_group(values, unit_numbers(program))
