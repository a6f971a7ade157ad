"""Steps of a batch: segment by segment the method of each run, and its steps in machine code, as `SegmentIntegrator` makes them for one run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array, IntArray

from ..simulation.constraints.constraints import Constraints
from ..simulation.integration.method import TRIAL, UNCLEAR, after_trial, clear_method, scaled_entries, spectrum
from ..simulation.integrators.compiled.code import link_step
from ..simulation.integrators.compiled.fields import fields_at, given_at, room_of
from ..simulation.integrators.compiled.record_layout import RecordBatch, form_of
from ..simulation.integrators.compiled.run import order_of
from ..simulation.integrators.compiled.selection_record import selection_batch
from ..simulation.integrators.methods import EXPLICIT, METHODS, RADAU
from ..simulation.integrators.outcomes import ABSENT, FAILURES, FINISHED, MORE, STIFF
from ..simulation.integrators.workspace import IntegratorWorkspace
from ..simulation.monitors.step_size_diagnosis import BEYOND, MANY
from ..simulation.phases.notes import MISSED, ROUNDED
from ..simulation.phases.tolerances import given_tolerances
from ..simulation.segments.timeline import Segment, Signals, signals_on
from ..simulation.segments.trajectory import SegmentContext, Tolerances
from .runs import BatchCourse, BatchTrajectories, Runs, goes_on
from .scope import BatchScene

SEVERAL = 1024  # steps of a run between two chances to interrupt it
EVALUATIONS = {"derivative": "derivatives", "jacobian": "jacobians", "factorisation": "factorisations"}


class BatchIntegrator:
    """Integration of runs with equal segments; those that need more than steps are not `sound` any more."""

    def __init__(self, scene: BatchScene, runs: Runs, course: BatchCourse, magnitude: Array) -> None:
        self.scene, self.runs, self.course = scene, runs, course
        program, options, count = scene.program, scene.options, len(runs)
        fixed = options.atol is not None
        absolute = np.full(magnitude.shape, options.atol) if fixed else options.rtol * magnitude
        held = np.full(magnitude.shape[1], fixed)
        for index, value in given_tolerances(options.plan, program, scene.compiled_scene.facts).items():
            absolute[:, index], held[index] = value, True
        self.tolerances = Tolerances(options.rtol, absolute, magnitude, held)
        self.choice = scene.state_selection(runs.constants)
        self.longest = float(min(np.abs(program.periods(course.constants)), default=np.inf))
        self.sound, self.position = np.ones(count, dtype=bool), np.zeros(count, dtype=int)
        self.settled = np.full(count, UNCLEAR)
        self.steps, self.evaluations = np.zeros(count, dtype=int), np.zeros((count, len(EVALUATIONS)), dtype=int)
        self.methods: list[dict[int, None]] = [{} for _ in range(count)]
        self.states = np.empty((count, len(scene.instants), magnitude.shape[1]))
        self.solvers: list[tuple[IntArray, RecordBatch]] = []  # with the runs that each steps
        self.closed = Constraints(
            program, runs.parameters[0], scene.inputs, np.ones(magnitude.shape[1])
        ).always_compiled(True)

    def through(self) -> BatchTrajectories:
        """Integrate over all segments."""
        x, before = self.runs.state, None
        for stretch in self.course.segments:
            if before is not None:
                self.sound &= goes_on(self.scene, self.runs, x, before, stretch)
            self._put_start(stretch, x)
            x = self._segment(stretch, x)
            before = stretch
        for row in np.flatnonzero(self.position < len(self.scene.instants)):
            self.states[row, self.position[row] :] = x[row]
        evaluations = dict(zip(EVALUATIONS, self.evaluations.T, strict=True))
        solvers = [" and ".join(f"{METHODS[m].name}, native" for m in methods) for methods in self.methods]
        return BatchTrajectories(
            self.states,
            self.sound,
            self.steps,
            evaluations,
            solvers,
            self.choice,
            self.tolerances.absolute,
            self.tolerances.held,
        )

    def _at(self, stretch: Segment, x: Array) -> tuple[Any, ...]:
        return stretch.start, x, self.scene.inputs, self.runs.constants, stretch.mode

    def _put_start(self, stretch: Segment, x: Array) -> None:
        """Store the state at the start of a segment at the reported instants that are no later."""
        passed = int(np.searchsorted(self.scene.instants, stretch.start, "right"))
        for row in np.flatnonzero(self.position < passed):
            self.states[row, self.position[row] : passed] = x[row]
        self.position = np.maximum(self.position, passed)

    def _segment(self, stretch: Segment, x: Array) -> Any:
        """Return the states at the end of a segment."""
        program = self.scene.program
        signals = signals_on(program, self.scene.inputs, self.course.constants, stretch, self.scene.whole)
        methods = self._methods(stretch, x, signals)
        self.sound &= np.isfinite(program.derivative(*self._at(stretch, x))).all(axis=1)
        if self.solvers:
            self._go_on(stretch, x, signals, methods)
        else:
            for method in (EXPLICIT, RADAU):
                rows = np.flatnonzero(self.sound & (methods == method))
                if len(rows):
                    solver = self._solver(stretch, x, signals, rows, method)
                    self.solvers.append((rows, solver))
                    self._choose(rows, solver)
        end = x.copy()
        for row in np.flatnonzero(self.sound):
            self.methods[row][int(methods[row])] = None
        for members, solver in self.solvers:
            end[members] = self._stepped(members, solver)
        return end

    # ------------------------------------------------------------ choice of the method
    def _methods(self, stretch: Segment, x: Array, signals: Signals) -> Any:
        """Return the method of each run on a segment."""
        program, methods = self.scene.program, self.settled.copy()
        if program.bends is not None:
            return np.full(len(methods), RADAU)
        entries = scaled_entries(program, program.jacobian_entries(*self._at(stretch, x)), self.tolerances.magnitude)
        self.sound &= np.isfinite(entries).all(axis=1)
        unclear = np.flatnonzero(self.sound & (methods == UNCLEAR))
        if not len(unclear):
            return methods
        try:
            methods[unclear] = clear_method(spectrum(program, entries[unclear]), stretch.stop - stretch.start)
        except np.linalg.LinAlgError:
            self.sound[unclear] = False
        rows = np.flatnonzero(self.sound & (methods == UNCLEAR))
        if len(rows):
            methods[rows] = self._tried(stretch, x, signals, rows)
        return methods

    def _tried(self, stretch: Segment, x: Array, signals: Signals, rows: IntArray) -> Any:
        """Return the methods of runs from trial steps."""
        solver = self._solver(stretch, x, signals, rows, EXPLICIT)
        every = np.arange(len(rows))
        answers = solver.call("advance", every, TRIAL)
        failed = np.isin(answers, tuple(FAILURES))
        methods, settled = after_trial(answers == STIFF, answers == FINISHED)
        methods[failed] = RADAU
        self.evaluations[rows[~failed]] += _evaluations(solver)[~failed]
        self.settled[rows[settled & ~failed]] = methods[settled & ~failed]
        return methods

    # ------------------------------------------------------------ steps
    def _solver(self, stretch: Segment, x: Array, signals: Signals, rows: IntArray, method: int) -> RecordBatch:
        """Return the records of a method for runs at the start of a segment."""
        program, tolerances, runs = self.scene.program, self.tolerances, self.runs.those(rows)
        some = Tolerances(tolerances.relative, tolerances.absolute[rows], tolerances.magnitude[rows], tolerances.held)
        context = SegmentContext(program, runs.constants, self.scene.inputs, self.scene.instants, some)
        fields = given_at(context, stretch, x[rows], self.longest, signals)
        fields |= {
            "closed": self.closed.values,
            "redundant": int(self.closed.redundant),
            "pattern": order_of(program).values,
        }
        at = self._at(stretch, x)
        bends, peaks = (0 if f is None else f(*at).shape[-1] for f in (program.bends, program.peaks))
        form = form_of(IntegratorWorkspace, program, method, _room(program, method, len(signals.allowed), bends, peaks))
        solver = RecordBatch(form, len(rows), fields)
        solver.put({"automatic": int(method == EXPLICIT)})
        solver.call("begin", np.arange(len(rows)))
        return solver

    def _choose(self, rows: IntArray, solver: RecordBatch) -> None:
        """Let steps end where other states should be integrated."""
        if self.choice:
            solver.put({"selection": selection_batch(self.choice, self.choice.peak[rows])})

    def _go_on(self, stretch: Segment, x: Array, signals: Signals, methods: IntArray) -> None:
        """Let all solvers go on with another segment, as `CompiledMethod.begin_at` does."""
        for rows, solver in self.solvers:
            solver["si"][:] = x[rows]
            fields = fields_at(stretch, signals, 0, 0)
            solver.put(fields | {"mode": stretch.mode, "method": methods[rows], "automatic": methods[rows] == EXPLICIT})
            solver.call("begin_segment", np.flatnonzero(self.sound[rows]))

    def _stepped(self, rows: IntArray, solver: RecordBatch) -> Any:
        """Step runs to the end of the segment; return their states there."""
        instants = self.scene.instants
        solver.put({"instants": instants, "instant_count": len(instants), "position": self.position[rows]})
        solver.point("reported", self.states.reshape(len(self.states), -1), rows)
        going = np.flatnonzero(self.sound[rows])
        while len(going):
            answers = solver.call("advance", going, SEVERAL)
            stiff, more = answers == STIFF, (answers == MORE) & (solver["steps"][going] < MANY)
            self._go_on_with_radau(solver, rows, going[stiff])
            absent = answers == ABSENT
            for method in set(solver["method"][going[absent]].tolist()):
                link_step(method)
            self.sound[rows[going[(answers != FINISHED) & ~stiff & ~more & ~absent]]] = False
            going = going[stiff | more | absent]
        if self.choice:
            self.choice.peak[rows] = solver["selection"]["peak"]
        self.position[rows] = solver["position"]
        self.steps[rows] += solver["steps"]
        self.evaluations[rows] += _evaluations(solver)
        followed = (solver["missed"] <= MISSED).all(axis=1) & (np.abs(solver["state"]) <= BEYOND).all(axis=1)
        plain = (solver["steps"] < MANY) & (solver["rounded"] <= ROUNDED) & followed
        self.sound[rows] &= plain
        return solver["state"] * solver["magnitude"]

    def _go_on_with_radau(self, solver: RecordBatch, rows: IntArray, stiff: IntArray) -> None:
        """Let Radau go on where only stability limits the steps, in this segment and all others."""
        solver["method"][stiff], solver["automatic"][stiff] = RADAU, 0
        solver.call("begin", stiff)
        self.settled[rows[stiff]] = RADAU
        for row in rows[stiff]:
            self.methods[row][RADAU] = None


def _evaluations(solver: RecordBatch) -> Any:
    return np.stack([solver[name] for name in EVALUATIONS.values()], axis=1)


def _room(program: Any, method: int, signals: int, bends: int, peaks: int) -> Callable[[], dict[str, Any]]:
    return lambda: room_of(program, method, signals, bends, peaks)
