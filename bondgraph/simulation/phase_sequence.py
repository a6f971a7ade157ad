"""Sequence of the phases of a run: the beginning of each from the end of the one before, and all as one result."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import CompilationFailed

from ..errors import RunFailed
from ..quantities import behind
from ..results.later import later
from ..results.records import EnergyBalance, EventRecord, Extremes, LimitLeft, widest
from ..results.result import Result
from .monitors.state_selection import WORST
from .monitors.step_size_diagnosis import BEYOND
from .phase import Phase, PhaseOptions, SwitchedStart
from .phases.cancellation import EXACT, doubts_on_outputs, largest_outputs
from .phases.start import no_rest
from .segments.trajectory import PhaseTransition

if TYPE_CHECKING:
    from compiler.api import Array, Program, Scene

    from ..compiled_scene import CompiledScene
    from ..results.truncation import TruncationReport
    from .events.complementarity import Companion
    from .events.impulse import StorageJump
    from .phases.run_program import RunProgram

MOST_CHOICES = 1000  # changes of the state selection in one run
MOST_AT_ONCE = 100  # phases that begin at one instant
RECENT = 4  # phases back within which one of the same program decides the method that goes on


class PhaseSequence:
    """One run: its phases so far, and the beginning of the next one."""

    def __init__(
        self, made: Callable[[Scene, bool], CompiledScene], scene: Scene, options: PhaseOptions, instants: Array, began: float
    ) -> None:  # fmt: skip
        self.made, self.scene, self.options, self.began = made, scene, options, began
        self.plan, self.values, self.energy = options.plan, options.values, options.energy
        self.instants, self.stop = instants, float(instants[-1])
        self.legs: list[Phase] = []
        self.leg: Phase | None = None  # the phase that is being integrated
        self.begin: PhaseTransition | None = None
        self.begins_now: PhaseTransition | None = None  # transition into the next phase
        self.accuracy: float | None = None
        self.before: Result | None = None  # the result from which this run goes on
        self.again: Phase | None = None  # all of it, as an earlier run with the same values has left it

    def go(self) -> None:
        """Integrate all phases, to the end. Raises `RunFailed`."""
        wishes, tried = dict(self.scene.preferences), set[SwitchedStart]()
        begin, left, legs = self.begin, self.instants, self.legs
        companion, modes = self._companion(), dict[str, float]()
        known: dict[Program, RunProgram] = {}  # programs used before
        scenes: dict[tuple[str, ...], Scene] = {}  # by the junctions that are off
        while not legs or begin is not None:
            self.leg = None
            preferences = tuple(sorted(wishes.items()))
            chosen = (
                self.scene if preferences == self.scene.preferences else replace(self.scene, preferences=preferences)
            )
            try:
                if self.again is None:
                    leg = Phase(self.made(chosen, self.energy), left, self.options, begin, companion, modes, known)
                else:
                    leg, self.again = self.again.begun_again(left), None
            except RunFailed:
                if legs or modes or begin is not None or companion is None or not companion.valves:
                    raise
                # with the valves blocked as written, the start values may be impossible
                from .events.begin import conducting_at_start

                modes, off = conducting_at_start(self.made(self.scene, self.energy), companion, self.plan.start)
                self.scene = replace(self.scene, off=off)
                continue
            again = None if legs else leg.begins_again(self.plan.equilibrium)
            if again is not None and again not in tried:  # the first guess was wrong: start again
                tried.add(again)
                self.scene, modes = replace(self.scene, off=again[0]), dict(again[1])
                continue
            if again is not None and self.plan.equilibrium:
                raise no_rest()
            leg.held = legs[-1].held if legs else None
            alike = (other.trajectory.settled for other in reversed(legs[-RECENT:]) if other.program is leg.program)
            leg.trajectory.settled = next(alike, None)
            self.leg = leg
            leg.go()
            legs.append(leg)
            if leg.trajectory.pieces:  # not each of many phases is to keep the rest of the run
                del leg.stretches[1:-1]
            before, begin, left = begin, leg.trajectory.handover, left[len(leg.values) :]
            if begin is None:
                break
            if begin.dependent:
                wishes |= {begin.dependent: "integral", begin.state: "derivative"}
                _check_choice(self.made, self.scene, wishes, begin, len(legs))
            self.begins_now = begin
            if begin.off is not None:
                self.scene = scenes[begin.off] = scenes.get(begin.off) or replace(self.scene, off=begin.off)
            self._check_progress(begin)
            begin = _with_earlier(begin, before, leg)

    def _check_progress(self, begin: PhaseTransition) -> None:
        """Raise `RunFailed` where junctions go on and off without end at one instant."""
        last = self.legs[-MOST_AT_ONCE:]
        if len(last) == MOST_AT_ONCE and last[0].stretches[0].start == begin.time:
            names = ", ".join(f"`{n}`" for n in sorted({*(begin.off or ())} | {n for leg in last for n in leg.off}))
            raise RunFailed(
                "BR707", f"at t = {begin.time:.9g} s junctions go on and off without end ({names}): no set of them agrees with its own conditions;",
                "give them a hysteresis, or put a resistor or a storage beside them",
            )  # fmt: skip

    def _companion(self) -> Companion | None:
        """Return the companion model of the switched junctions, if valves or integrals need it."""
        facts = self.made(self.scene, self.energy).facts
        if not facts.valves and not facts.integrals:
            return None
        from .events.begin import companion_of

        return companion_of(self.made, self.scene, facts, self.values, (self.plan.start, self.stop))

    def cut(self, why: str) -> Result | None:
        """Return the certain part of a run that broke off; None if it had not begun."""
        leg = self.leg
        if leg is not None and (not self.legs or self.legs[-1] is not leg):
            try:
                with np.errstate(all="ignore"):
                    leg.cut()
            except RunFailed:
                leg.values = None
            if leg.values is not None:
                self.legs.append(leg)
        return self.result(why) if self.legs else None

    @property
    def reached(self) -> float:
        """Time that the run has reached."""
        kept = self.legs[-1].trajectory.kept if self.legs else None
        return self.plan.start if kept is None else kept.time

    def result(self, stopped: str) -> Result:
        """Return all phases as one result, joined with the result from which the run went on."""
        legs, plan = self.legs, self.plan
        program = legs[0].program
        columns = legs[0].compilation.columns
        evaluations: dict[str, int] = {}
        for leg in legs:
            for kind, count in leg.trajectory.evaluations.items():
                evaluations[kind] = evaluations.get(kind, 0) + count
        values = legs[0].values if len(legs) == 1 else np.concatenate([leg.values for leg in legs])
        now = any(leg.history is not None for leg in legs)  # what is delayed is this run's alone
        end, warnings = (
            later(legs[-1].end(self.stop), now),
            later(_warnings(legs, values, self.options.rtol, plan.start), now),
        )
        time, halted = self.instants[: len(values)], legs[-1].trajectory.stopped
        if halted is not None:
            time = np.append(time[:-1], halted)
        if 2 * len(time) < len(self.instants):  # the run broke off: do not keep the memory of the others
            time = time.copy()
        balance = None
        if self.energy:
            from .monitors.energy import added

            balance = added([leg.balance for leg in legs if leg.balance is not None])
        lacking = None if self.options.bandwidth is None else _left_out(legs, balance)
        records = [leg.occurrences() for leg in legs]
        acted = later(lambda: tuple(chain.from_iterable(find() for find in records)), halted is not None)
        ends = [] if halted is None else _halts(acted)
        told = () if lacking is None else (lacking.sentence({column.name: column.unit for column in columns}),)
        found = Result(
            program.name, plan.experiment, time, columns, values, plan.report, _solver(program, legs),
            sum(leg.trajectory.steps for leg in legs), evaluations, self.options.rtol, clock.perf_counter() - self.began,
            balance, warnings, legs[0].compilation.certificate,
            tuple(dict.fromkeys([*(note for leg in legs for note in (*leg.start_notes, *leg.notes)), *told, *_impulses(legs), *ends])),
            acted, stopped, end, lacking, accuracy=self.accuracy, searched=_extremes(legs) if self.options.extremes else (),
        )  # fmt: skip
        if self.before is None:
            return found
        from .resume import joined

        return joined(self.before, found)


def _extremes(legs: Sequence[Phase]) -> tuple[Extremes, ...]:
    """Return the extremes of each output over all phases; empty if they were not searched to the end."""
    if not all(leg.whole for leg in legs):
        return ()
    phases = [leg.extremes.extremes() for leg in legs if leg.extremes is not None]
    return tuple(map(widest, zip(*phases, strict=True)))


def _halts(acted: Sequence[EventRecord]) -> list[str]:
    """Return a note on each condition that ended the run."""
    return [f"at t = {e.time:.9g} s `stop when {e.condition}` ({e.place}) ended the run" for e in acted if e.stops]


def _left_out(legs: Sequence[Phase], balance: EnergyBalance | None) -> TruncationReport | None:
    """Return the joined truncation report of all phases, with the removed energy; None if nothing was truncated."""
    if all(leg.left_out is None for leg in legs):
        return None
    from ..results.truncation import joined

    found = None
    for leg in legs:
        found = joined(found, leg.left_out)
    if found is None or balance is None:
        return found
    from .monitors.energy import LEFT_OUT

    return replace(found, energy=sum(e.dissipated for e in balance.elements if e.name == LEFT_OUT))


def _with_earlier(begin: PhaseTransition, before: PhaseTransition | None, leg: Phase) -> PhaseTransition:
    """Return a handover completed by data of earlier programs: a state that is constant in one program may move in the next."""
    stored, peaks = {**dict.fromkeys(leg.compilation.certificate.unexcited, 0.0), **begin.stored}, begin.peaks
    if before is not None:
        stored, peaks = {**before.stored, **stored}, {**before.peaks, **peaks}
    past = None if leg.history is None else leg.history.past()
    # what has got so far is told once
    known = {n: peaks[n] if n in peaks and peaks[n] > BEYOND * m else m for n, m in leg.known.items()}
    return replace(begin, stored=stored, peaks=peaks, magnitudes=known, guessed=leg.guessed, past=past)


def _impulses(legs: Sequence[Phase]) -> Iterator[str]:
    """Yield a note on each stored quantity that jumped where junctions went on or off, at its first instant."""
    told: dict[str, tuple[StorageJump, float, int]] = {}
    for leg in legs:
        for jump in leg.jumps:
            first, time, count = told.get(jump.name, (jump, leg.stretches[0].start, 0))
            told[jump.name] = first, time, count + 1
    for jump, time, count in told.values():
        often = f" ({count} times in all)" if count > 1 else ""
        unit = behind(jump.unit)
        yield (
            f"at t = {time:.9g} s an impulse takes `{jump.name}` from {jump.before:.6g}{unit} to {jump.after:.6g}{unit}"
            f"{often}: a junction that goes on or off ties it to other storages, or holds it"
        )


def _check_choice(
    made: Callable[[Scene, bool], CompiledScene],
    scene: Scene,
    wishes: Mapping[str, str],
    begin: PhaseTransition,
    times: int,
) -> None:
    """Raise `RunFailed` if the other state selection is not possible."""
    try:
        chosen = made(replace(scene, preferences=tuple(sorted(wishes.items()))), False)
        possible = times <= MOST_CHOICES and begin.dependent not in chosen.state_space.dependent
    except CompilationFailed:
        possible = False
    if not possible:
        raise RunFailed(
            "BR708", f"at t = {begin.time:.9g} s `{begin.dependent}` follows from `{begin.state}` so steeply that its error would be {WORST:g} times "
            f"that of `{begin.state}`, and no other choice of states is possible there",
        )  # fmt: skip


def _warnings(legs: Sequence[Phase], values: Array, rtol: float, begin: float) -> Callable[[], tuple[LimitLeft, ...]]:
    """Return the function that finds each violated limit once, at its first instant, the first doubt about tolerances, and outputs that are less than the
    tolerance leaves of their terms."""
    limits = [w for leg in legs for w in (*leg.doubts, *leg.watch.warnings)]
    exact = all(leg.trajectory.exact for leg in legs)
    accuracy, names = EXACT if exact else max(rtol, EXACT), legs[0].program.outputs.names
    terms = [leg.terms_of_outputs() for leg in legs]

    def warnings() -> tuple[LimitLeft, ...]:
        first: dict[tuple[str, str, str], LimitLeft] = {}
        for item in limits:
            first.setdefault((item.owner, item.condition, item.place), item)
        return *first.values(), *doubts_on_outputs(
            names, largest_outputs(values), [find() for find in terms], accuracy, begin
        )

    return warnings


def _solver(program: Program, legs: Sequence[Phase]) -> str:
    if program.states.names:
        return " and ".join(dict.fromkeys(name for leg in legs for name in leg.trajectory.solvers))
    return "Newton" if program.unknowns.names else "none"
