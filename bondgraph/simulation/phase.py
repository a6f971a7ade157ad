"""One phase of a run (`Phase`): a program with one choice of states, from the initialization or from the transition of the phase before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, Array

from ..errors import NotLossless, RateNotFinite, StepsCollapsed
from ..results.checkpoint import Checkpoint
from ..results.records import EnergyBalance, EventRecord, ToleranceDoubt
from .constraints.constraints import Constraints
from .integration.integration_state import PhaseProblem
from .integration.segment_integrator import SegmentIntegrator
from .magnitudes.nominal_magnitudes import least_tolerances
from .magnitudes.pilot_run import smallest_angles
from .monitors.extremes import ExtremesMonitor
from .monitors.state_selection import Choice
from .monitors.validity import ValidityMonitor
from .phases.cancellation import (
    OutputTerms,
    RowsOfTerms,
    places_of_terms,
    rows_of_terms,
    terms_of_outputs,
)  # fmt: skip
from .phases.failures import explained, modes_in
from .phases.notes import phase_doubts, phase_notes
from .phases.run_program import RunProgram
from .phases.solution import PhaseSolution, phase_energy
from .phases.start import PhaseInitialization, StartOfPhase, settled_with_history
from .phases.tolerances import MagnitudeSearch, PhaseMagnitudes, given_tolerances, put_thresholds
from .segments.run_values import run_values
from .segments.timeline import Timeline, aligned, rest_of, timeline_in_parts
from .segments.trajectory import PhaseTransition, Tolerances, Trajectory, empty

if TYPE_CHECKING:
    from compiler.api import Plan, Program, Scene

    from ..compiled_scene import CompiledScene
    from ..results.truncation import TruncationReport
    from .events.complementarity import Companion
    from .events.events import Events
    from .events.history import History
    from .truncation.mode_truncation import Leaving


BESIDE = 1e-12  # fraction of a run: a reported instant this close to its end by a condition is that end


@dataclass(frozen=True, slots=True)
class PhaseOptions:
    """Options that all phases of a run have in common; `energy`: the balance is wanted; `values`: parameters set when the run begins."""

    plan: Plan
    rtol: float
    atol: float | None
    energy: bool
    values: Mapping[str, float] = field(default_factory=dict)
    solver: str = AUTOMATIC
    bandwidth: float | None = None  # Hz
    parts: int = 1  # of each segment
    extremes: bool = False  # those of the outputs are searched between the reported instants

    def at(self, values: Mapping[str, float]) -> PhaseOptions:
        """Return the same with other values."""
        if values == self.values:
            return self
        others = self.solver, self.bandwidth, self.parts, self.extremes
        return PhaseOptions(self.plan, self.rtol, self.atol, self.energy, values, *others)


# Junctions that are off, and discrete variables by name, with which a run begins.
SwitchedStart = tuple[tuple[str, ...], tuple[tuple[str, float], ...]]


class Phase:
    """State of one phase of a run: one program with one choice of states."""

    def __init__(
        self, compilation: CompiledScene, instants: Array, options: PhaseOptions, begin: PhaseTransition | None = None, companion: Companion | None = None,
        modes: Mapping[str, float] | None = None, known: dict[Program, RunProgram] | None = None,
    ) -> None:  # fmt: skip
        """`companion`, `modes`: of the ideal valves; `known`: programs of the run so far."""
        self.compilation, self.instants, self.options, self.begin = compilation, instants, options, begin
        self.companion, self.modes_at_start = companion, modes or {}  # modes of the ideal valves
        hybrid = compilation.program.hybrid
        self.off = compilation.compilation.off if hybrid is not None and hybrid.junctions else ()
        self.history = None if compilation.program.delays is None else self._history(compilation.program)
        self.program = program = compilation.program if self.history is None else self.history.program
        ends = instants[0] if begin is None else begin.time, float(instants[-1])
        known = {} if known is None else known
        again = program in known or self.history is not None  # its pilot runs show nothing new
        known[program] = self.shared = known.get(program) or self._run_program(program, ends)
        values, size = self.shared.values, np.ones(len(program.states.names))
        self.inputs = values.inputs
        self.constraints = Constraints(program, values.parameters, values.inputs, size, values)
        self.stretches = rest_of(self.shared.course.segments, ends[0])
        start = self._start()
        # a start finds redundant constraints and leaves them out
        self.parameters, self.constants = self.constraints.parameters, self.constraints.constants
        self.stretches[0] = start.first
        self.state, self.start_notes, self.events, self.jumps = start.state, start.notes, start.events, start.jumps
        if self.events is not None:
            self.events.relative = options.rtol
            self.shared.events = None if self.constraints else self.events
        self.begins_without, self.goes_on_without = start.begins_without, start.goes_on_without
        magnitudes, guessed = ({}, frozenset[str]()) if begin is None else (begin.magnitudes, begin.guessed)
        self.guessed = guessed if again else frozenset[str]()  # names of what nothing has moved
        self.known: Mapping[str, float] = {n: m for n, m in magnitudes.items() if again or n not in guessed}
        self.looked_from = self.state  # state from which a pilot run starts
        self.leaving: Leaving | None = None  # modal truncation at the bandwidth
        self.left_out: TruncationReport | None = None
        self.notes: tuple[str, ...] = ()
        self.doubts: tuple[ToleranceDoubt, ...] = ()  # about tolerances
        self.trajectory = Trajectory(np.empty((0, 0)))
        self.watch = ValidityMonitor(program, self.constants, self.inputs, options.rtol)
        # stored quantities at the end of the phase before, later those at the end of this phase
        self.held: Mapping[str, Any] | None = None
        self.scene: Scene = compilation.scene
        self.whole = False  # True once the phase has reached its end
        self.moved: Mapping[str, float] | None = None  # magnitudes of what moves, if they were needed
        self.values: Any = None  # outputs, shape (points, outputs)
        self.extremes: ExtremesMonitor | None = None
        self.balance: EnergyBalance | None = None
        self.stepper: SegmentIntegrator | None = None  # the integrator, if another run may go through this phase again
        self.remarks: tuple[Any, ...] = ((), ())  # notes and doubts before the end
        self.modes: list[tuple[Any, int, int]] = []  # of the reported instants
        self.rows: RowsOfTerms | None = None  # at which terms of outputs are looked for

    def left(self) -> Phase | None:
        """Return this finished phase without its results, for `begun_again`; None if another run cannot go through it."""
        stepper = self.stepper
        if stepper is None or stepper.begins is None or self.begin is not None or self.trajectory.handover is not None:
            return None
        self.values, self.trajectory = None, Trajectory(np.empty((0, 0)))
        stepper.result, stepper.choice = self.trajectory, None
        return self

    def begun_again(self, instants: Array) -> Phase:
        """Return this phase as it began, for another run with the same values and options."""
        self.instants, self.whole, (self.notes, self.doubts) = instants, False, self.remarks
        self.watch = ValidityMonitor(self.program, self.constants, self.inputs, self.options.rtol)
        return self

    def _history(self, program: Program) -> History | None:
        from .events.history import history_of

        return history_of(program, self._given(program), None if self.begin is None else self.begin.past)

    def _given(self, program: Program) -> Any:
        """Return the parameters of this run, shape (P,)."""
        parameters = np.array(program.defaults, dtype=float)
        places = program.kept.get("parameters") or {n: place for place, n in enumerate(program.parameters.names)}
        program.kept["parameters"] = places
        for name, value in self.options.values.items():
            if name in places:
                parameters[places[name]] = value
        return parameters

    def _run_program(self, program: Program, ends: tuple[float, float]) -> RunProgram:
        """Return what this phase shares with others of its program. Its segments are those of the whole run: searched from elsewhere, an instant would
        differ by its rounding, and programs that take turns at it would disagree on what holds there."""
        plan, parts, values = self.options.plan, self.options.parts, run_values(program, self._given(program))
        whole = (ends[0] if self.history is not None else plan.start), ends[1]

        def find() -> Timeline:
            return timeline_in_parts(program, values.constants, whole, parts)

        delayed = program.delays is not None
        course = (
            find() if delayed else values.recall("timeline", (*whole, parts), find, lambda course: len(course.segments))
        )
        course = Timeline(aligned(course.segments, self.instants), course.notes)
        return RunProgram(values, course, given_tolerances(plan, program, self.compilation.facts))

    def _start(self) -> StartOfPhase:
        """Return the start of this phase. Raises `RunFailed`."""
        plan, first = self.options.plan, self.stretches[0]
        problem = PhaseInitialization(
            self.compilation, self.constraints, plan, self.off, self.begin, self.companion, self.modes_at_start, self.shared.events
        )  # fmt: skip
        start = problem.start(first, self.stretches[-1].stop - plan.start)
        if self.history is None or self.begin is not None:
            return start

        def again() -> StartOfPhase:
            ends = (first.start, float(self.instants[-1]))
            course = timeline_in_parts(self.program, self.constraints.constants, ends, self.options.parts)
            self.stretches = aligned(course.segments, self.instants)
            return problem.start(self.stretches[0], self.stretches[-1].stop - plan.start)

        return settled_with_history(start, self.history, self.inputs, again)

    def begins_again(self, settled: bool) -> SwitchedStart | None:
        """Return the start with other junctions off that this phase calls for, else None. `settled`: after the events at the start."""
        if self.begins_without != self.off:
            return self.begins_without, tuple(sorted(self.modes_at_start.items()))
        if not settled or self.goes_on_without == self.off:
            return None
        return self.goes_on_without, tuple(sorted(modes_in(self.constraints, self.stretches[0].mode).items()))

    def tolerances(self) -> Tolerances:
        """Return absolute tolerances per state: the given value, else rtol times the magnitude."""
        magnitude, last = self._magnitudes(), self.shared.tolerances
        if last is not None and not self.constraints and last.magnitude.tobytes() == magnitude.tobytes():
            return last
        rtol, atol = self.options.rtol, self.options.atol
        absolute = np.full(len(self.state), atol) if atol is not None else rtol * magnitude
        if atol is None and self.constraints:
            mechanisms, first = self.compilation.facts.mechanisms, self.stretches[0]
            least = least_tolerances(mechanisms, self.constraints, self.looked_from, first, magnitude)
            absolute = np.maximum(absolute, least)
        held = np.full(len(self.state), atol is not None)
        for place in self.program.eliminated:  # of multipliers, which have no bound near a singular pose
            absolute[len(self.program.states.names) + place] = np.inf
        for index, value in self.shared.given.items():
            absolute[index], held[index] = value, True
        if self.events is not None and len(self.events.places) and not self.constraints:
            put_thresholds(self.events, self.stretches[0].start, self.stretches[0].mode, magnitude, absolute, rtol)
        guessed = np.array([n in self.guessed for n in self.program.variables.names], dtype=bool)
        self.shared.tolerances = Tolerances(rtol, absolute, magnitude, held, guessed)
        return self.shared.tolerances

    def _magnitudes(self) -> Any:
        """Return magnitudes of all states and unknowns."""
        if self.begin is not None or (self.companion is not None and self.companion.valves):
            return self._with_doubts(self._searched_magnitudes())
        first, last = self.stretches[0], self.stretches[-1]
        on = () if self.events is None else (self.events.horizon, *sorted(self.events.on.items()))
        options = self.options.parts, self.options.rtol
        key = *first.key, last.stop, *options, self.looked_from.tobytes(), self.state.tobytes(), on
        values = self._with_doubts(self.constraints.recall("magnitudes", key, self._searched_magnitudes))
        if self.events is not None:
            from .events.indicators import HybridState

            moved = np.array([self.known.get(n, 0.0) for n in self.program.variables.names])
            self.events.measure_anew(moved, HybridState(first.start, self.state, first.mode))
        return values.copy()

    def _with_doubts(self, found: PhaseMagnitudes) -> Any:
        """Keep what is known of magnitudes and the doubts about them; return the values."""
        self.doubts = self.doubts if found.doubts is None else found.doubts
        self.known, self.moved = found.known, found.moved
        self.guessed |= frozenset(found.guessed)
        return found.values

    def _searched_magnitudes(self) -> PhaseMagnitudes:
        """Return the magnitudes of this phase as its states, events and pilot runs give them."""
        begin, names = self.begin, self.program.variables.names
        peaks = np.zeros(len(names)) if begin is None else np.array([begin.peaks.get(n, 0.0) for n in names])
        search = MagnitudeSearch(
            self.constraints, self.compilation.facts.mechanisms, self.looked_from, self.stretches, self.known, peaks, self._choice, self._pilot,
            self.options.rtol,
        )  # fmt: skip
        return search.magnitudes(self.events)

    def _pilot(self, magnitude: Array) -> tuple[Array, float]:
        """Return the largest values of a coarse run through the events of this phase, and the time at which other junctions go on or off."""
        from .integration.event_integrator import pilot

        assert self.events is not None
        saved = None if self.history is None else self.history.saved()
        companion = None if self.companion is None else self.companion.ahead()
        units = None if self.events.units is None else self.events.units.ahead()
        copied = replace(self.events, on=dict(self.events.on), log=[], companion=companion, units=units)
        found = pilot(self._problem(copied, None), self.state, self.stretches, magnitude)
        if self.history is not None and saved is not None:
            self.history.restore(saved)
        return found

    def _choice(self) -> Choice:
        return Choice(self.program, self.constants, self.inputs, self.compilation.facts.storages, self.begin)

    def _problem(self, events: Events | None, choice: Choice | None) -> PhaseProblem:
        """Return the integration of this phase, with its events or a copy of them."""
        return PhaseProblem(
            self.program, self.constants, self.inputs, self.instants, self.tolerances,
            self._solution().powers if self.options.energy else None, self.watch, self.constraints, choice, self.compilation.certificate.linear,
            events, self.off, self.history, self.options.solver, self.leaving, self.extremes,
            all(loop.linear or loop.unique for loop in self.compilation.certificate.loops),
        )  # fmt: skip

    def _solution(self) -> PhaseSolution:
        return PhaseSolution(self.constraints, self.instants, self.trajectory, self.stretches)

    def terms_of_outputs(self) -> Callable[[], OutputTerms]:
        """Return the function that finds the terms of the outputs. It keeps no trajectory in memory."""
        program, inputs, constants, trajectory = self.program, self.inputs, self.constants, self.trajectory
        rows = self.rows if self.whole else None
        if rows is None:
            rows = self.rows = rows_of_terms(self.instants, trajectory.states, trajectory.pieces or self.stretches)
        places = places_of_terms(self.instants, trajectory.states, rows)
        rtol, mechanisms = self.options.rtol, self.compilation.facts.mechanisms
        tolerances = None if trajectory.exact else self.shared.tolerances
        of_steps = None if tolerances is None else (tolerances.absolute, tolerances.guessed, tolerances.held)

        def output(times: Array, states: Array, mode: Array) -> Any:
            return program.output(times, states, inputs, constants, mode)

        def terms() -> OutputTerms:
            least = np.zeros(len(program.states.names))
            fixed = least > 0
            if of_steps is not None:
                absolute, rests, fixed = of_steps
                levels = smallest_angles(program, mechanisms, ("1", "1/s", "m", "m/s"))
                rests = rests if places is None else rests | (np.abs(places[1]).max(axis=0) <= levels)
                least = np.where(rests, 0.0, absolute)[: len(least)]
                fixed = (fixed | (levels > 0))[: len(least)]
            return terms_of_outputs(program, output, places, least, rtol, fixed)

        return terms

    def go(self) -> None:
        """Integrate and evaluate the outputs, up to the end or to the instant from which other states should be integrated.

        After any exception, `cut` keeps the part of the result that is certain.
        """
        program = self.program
        self.choice = self._choice()
        settled, self.trajectory = self.trajectory.settled, empty(program, self.instants)
        self.trajectory.settled = settled
        if self.begin is None and self.events is not None and self.events.stops_at_start(self.stretches[0].start):
            self.trajectory.stopped = self.stretches[0].start
        self.leaving = self._leaving()
        if self.options.extremes:
            self.extremes = ExtremesMonitor(self._solution().output, len(program.outputs.names))
        self.integrate(self.choice)
        self.remarks = self.notes, self.doubts
        self._end_where_stopped()
        self._finish()
        solution = self._solution()
        self.modes = self.modes or solution.modes()
        self.values = solution.outputs(self.modes, self.watch)
        if self.extremes is not None:
            self.extremes.look_at_values(self.instants[: len(self.values)], self.values)
        self.whole = True
        if not isfinite(np.add.reduce(self.values, axis=None)):
            from .monitors.finite import check_finite

            space = self.compilation.state_space
            check_finite(program, space, self.instants, self.values, self.trajectory.states, self.parameters)
        if self.options.energy:
            self._find_energy()

    def integrate(self, choice: Choice | None) -> None:
        """Integrate into the trajectory; to the end with the states of the start, if there is no choice. Raises `RunFailed`."""
        try:
            stepper = self.stepper
            if stepper is None:
                stepper = self._integrator()(self._problem(self.events, choice), self.trajectory)
            else:
                stepper.begin_again(self.instants, self.watch, choice, self.trajectory)
            stepper.through(self.state, self.stretches)
            self.stepper = stepper if stepper.begins is not None else None
        except (RateNotFinite, StepsCollapsed, NotLossless) as failed:
            raise explained(failed, self.constraints, self.compilation.state_space) from None

    def _integrator(self) -> type[SegmentIntegrator]:
        if self.events is None:
            return SegmentIntegrator
        from .integration.event_integrator import EventIntegrator

        return EventIntegrator

    def _end_where_stopped(self) -> None:
        """Report the instant at which a condition has ended the run, in the place of all later ones."""
        trajectory = self.trajectory
        if trajectory.stopped is not None:
            rounding = BESIDE * float(self.instants[-1] - self.instants[0])
            count = int(self.instants.searchsorted(trajectory.stopped - rounding))
            self.instants = np.append(self.instants[:count], trajectory.stopped)
            trajectory.states = np.concatenate([trajectory.states[:count], trajectory.final[None]])

    def _leaving(self) -> Leaving | None:
        """Return the modal truncation of this phase; None without a bandwidth, or with events or delayed signals."""
        bandwidth = self.options.bandwidth
        if bandwidth is None or self.program.hybrid is not None or self.history is not None:
            return None
        from .truncation.mode_truncation import Leaving

        def restart(state: Array) -> None:
            self.looked_from = state

        return Leaving(bandwidth, float(self.instants[-1] - self.instants[0]), restart)

    def cut(self) -> None:
        """Keep the part that is certain: up to the last accepted step, or up to the last finite output."""
        kept = self.trajectory.kept
        if not self.whole:
            kept = self.trajectory.cut(self.stretches)
            if kept is not None and self.events is not None:
                del self.events.log[kept.happened :]
            self._finish()
            self.values = np.empty((0, len(self.program.outputs.names)))
            if kept is not None:
                self.values = self._solution().outputs(self._solution().modes(), self.watch)
        wrong = np.flatnonzero(~np.isfinite(self.values).all(axis=1))
        if len(wrong):
            self.instants, self.values = self.instants[: wrong[0]], self.values[: wrong[0]]
            self.trajectory.kept = None  # its instant lies beyond the last finite output
        elif self.options.energy and kept is not None:
            self._find_energy()

    def _finish(self) -> None:
        if self.history is not None:
            self.history.window = (-np.inf, np.inf)
        assembled = self.constraints.assembled if self.begin is None else None  # only of the first phase
        undetermined, solution = self.compilation.facts.undetermined, self._solution()
        self.notes += phase_notes(solution, self.shared.course.notes, self.events, undetermined, assembled)
        self.doubts += phase_doubts(solution, self.options.rtol, self.events, self.compilation)
        self.instants = self.instants[: len(self.trajectory.states)]
        if self.options.bandwidth is not None:
            from .truncation.report import left_out_of

            self.left_out = left_out_of(
                self.options.bandwidth, self.program, self.leaving, self.instants, self.trajectory, self.stretches
            )

    def _find_energy(self) -> None:
        """Find the energy balance, and note the laws that create energy."""
        removals = () if self.leaving is None else self.leaving.removals
        space, rtol = self.compilation.state_space, self.options.rtol
        energy = phase_energy(self._solution(), space, self.state, removals, self.held, rtol)
        self.balance, self.held = energy.balance, energy.held
        self.notes += energy.notes

    def end(self, until: float) -> Callable[[], Checkpoint | None]:
        """Return the function that makes the checkpoint at the end of this phase, from which another run can go on; None if no step was accepted.
        It keeps no trajectory in memory."""
        kept, program, choice, parameters = self.trajectory.kept, self.program, self.choice, self.parameters
        if kept is None:
            return lambda: None
        identity, off, preferences = self.compilation.facts.identity, self.off, self.scene.preferences
        sizes, modes = self.known if self.moved is None else self.moved, modes_in(self.constraints, kept.mode)
        past = None if self.history is None else self.history.past(kept.remembered)

        def checkpoint() -> Checkpoint:
            stored, peaks = choice.stored(kept.time, kept.state, kept.mode)
            count = len(program.states.names)
            return Checkpoint(
                identity, dict(zip(program.parameters.names, parameters.tolist(), strict=True)), kept.time, until, stored, peaks,
                dict(zip(program.unknowns.names, kept.state[count:].tolist(), strict=True)), dict(sizes), modes,
                tuple((owner, place, on) for (owner, place), on in kept.on.items()), off, preferences, past,
            )  # fmt: skip

        return checkpoint

    def occurrences(self) -> Callable[[], list[EventRecord]]:
        """Return the function that makes the records of the events that acted."""
        if self.events is None:
            return list
        log, notes, cache = self.events.log, self.events.hybrid.events, self.program.kept

        def records() -> list[EventRecord]:
            acted = [(h.time, i) for h in log for i in h.events if not notes[i].sampled]
            places = cache.setdefault("places of events", {})
            places |= {i: notes[i].span.file_and_line for i in {i for _, i in acted} - places.keys()}
            return [EventRecord(t, notes[i].words, notes[i].owner, places[i], notes[i].stops) for t, i in acted]

        return records
