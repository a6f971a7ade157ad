"""State and services common to the methods for smooth segments: see `segment_integrator.py` and `native_integrator.py`.

States are divided by their magnitudes before the solver gets them, which keeps its linear algebra well scaled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from compiler.api import AUTOMATIC, Array, Program

from ...errors import RunFailed, StepsCollapsed
from ...numerics.quadrature import work_of
from ..constraints.constraints import Constraints
from ..integrators.methods import METHODS
from ..integrators.radau import INNER
from ..loops.loops import LoopSolver
from ..monitors.extremes import ExtremesMonitor
from ..monitors.state_selection import Choice
from ..monitors.step_failure import MOST_COMPILED, MOST_STEPS, failure, not_finite
from ..monitors.step_size_diagnosis import growth_notes, is_usual, notes_of
from ..monitors.validity import ValidityMonitor
from ..segments.timeline import Segment, Signals, signals_on
from ..segments.trajectory import Kept, SegmentContext, Tolerances, Trajectory, empty

EPS = float(np.finfo(float).eps)
ROUNDING = 1e3  # a jump below that many times what the last places of time and states do is none

if TYPE_CHECKING:
    from ..constraints.singular import SingularPoseMonitor
    from ..events.events import Events
    from ..events.history import History
    from ..events.locate import Flip, StateAt
    from ..integrators.compiled.run import CompiledMethod
    from ..integrators.exponential import Linear

Powers = Callable[[Any, Any, Any], Any]  # times, states (…, n), mode -> (…, ports)
MOST_KNOWN = 64  # most modes whose signals are cached
MOST_EVENTS = 10_000_000  # most events of one run


class ModeTruncation(Protocol):
    """Truncation of fast modes, seen from an integration."""

    @property
    def pause(self) -> int:
        """Number of steps of a segment after which it is examined."""

    def begin(self, stepper: IntegrationState, stretch: Segment, x: Array) -> Any:
        """Return the state without its fast oscillations."""

    def cuts(self, stepper: IntegrationState, solver: CompiledMethod, steps: int, stretch: Segment) -> bool:
        """Return True if a segment is to be cut after so many steps."""


@dataclass(frozen=True, slots=True)
class PhaseProblem:
    """Integration of one phase, in SI.

    `tolerances` need a pilot run, so they are found on use. `powers` are integrated along the solution, outside the error control. `watch` checks
    each accepted step. `linear`: the rates are affine in the states. `off`: junctions that are off in this program. `solver`: one of
    `compiler.solvers.SOLVERS`. `unique`: loops are proved to have one solution. `leaving`: modal truncation at a bandwidth. `extremes`: monitor of those of
    the outputs, if wanted.
    """

    program: Program
    constants: Any
    inputs: Any
    instants: Any
    tolerances: Callable[[], Tolerances]
    powers: Powers | None
    watch: ValidityMonitor
    constraints: Constraints
    choice: Choice | None = None
    linear: bool = False
    events: Events | None = None
    off: tuple[str, ...] = ()
    history: History | None = None
    solver: str = AUTOMATIC
    leaving: ModeTruncation | None = None
    extremes: ExtremesMonitor | None = None
    unique: bool = False

    @property
    def is_exact(self) -> bool:
        """Return True if the matrix exponential may integrate it, as far as laws, constraints and delays decide that."""
        exact = self.linear and self.solver in (AUTOMATIC, "exponential")
        return exact and not self.constraints and self.history is None


class IntegrationState:
    """State of an integration over successive smooth segments: the requested results so far, and services common to all methods."""

    def __init__(self, problem: PhaseProblem, into: Trajectory | None = None) -> None:
        program, constants, instants = problem.program, problem.constants, problem.instants
        self.watch, self.constraints, self.extremes = problem.watch, problem.constraints, problem.extremes
        self.choice, self.leaving, self.solver = problem.choice, problem.leaving, problem.solver
        self.unique, self.events, self.off = problem.unique, problem.events, problem.off
        self.linear = problem.is_exact  # True if the matrix exponential is tried
        self.steps, self.most_steps, self.most_events = 0, MOST_STEPS, MOST_EVENTS  # in all segments
        self.piece = Segment(-np.inf, -np.inf, None)  # the segment from the last event on
        self.mode: Any = None  # mode at the end of the last segment
        self.history = problem.history  # of delayed signals
        self.followed = (-np.inf, -np.inf)  # the step that is examined
        self.repeated = (-np.inf, np.inf)  # start of the last repeated step, and its size then
        self.reached = -np.inf  # end of the last call of `run`
        self.flip: Flip | None = None  # zero crossing that ended the last segment early
        lags = () if problem.history is None else problem.history.lags
        # no step is longer than a period of a noise, or the shortest delay
        periods = self.constraints.recall("periods", (), lambda: np.abs(program.periods(constants)).tolist())
        self.longest = float(min((*periods, *lags), default=np.inf))
        self.program, self.constants, self.inputs = program, constants, problem.inputs
        self.instants, self.powers, self._tolerances = instants, problem.powers, problem.tolerances
        self.whole = float(instants[-1] - instants[0])  # length of the run, s
        self.traffic = 0.0  # energy turnover: absolute work at all ports so far
        self.position = 0  # index of the next instant to be reported
        self._signals: dict[tuple[float, bytes], Signals] = {}
        self.exponentials: dict[tuple[bytes, bytes], tuple[Any, Any, Any]] = {}  # of linear segments, by their matrices
        self.forms: dict[bytes, Linear] = {}  # linear forms checked so far, by matrix
        self.methods: dict[bytes, int] = {}  # methods chosen, by mode: each spectrum is examined once
        self.result = into if into is not None else empty(program, instants)

    def begin_again(self, instants: Array, watch: ValidityMonitor, choice: Choice | None, into: Trajectory) -> None:
        """Begin another run from the same state with the same values, without events."""
        self.instants, self.watch, self.choice, self.result = instants, watch, choice, into
        self.steps, self.position, self.traffic, self.reached = 0, 0, 0.0, -np.inf
        self.exponentials, self.forms = {}, {}  # how many are found is told of each run
        self.__dict__.pop("loops", None)

    @cached_property
    def tolerances(self) -> Tolerances:
        found = self._tolerances()
        self.constraints.scale(found.magnitude)
        return found

    @property
    def context(self) -> SegmentContext:
        """Unchanging data of this integration, with its present tolerances."""
        return SegmentContext(self.program, self.constants, self.inputs, self.instants, self.tolerances)

    def look_anew(self) -> None:
        """Discard the magnitudes, and all data that depend on them."""
        for name in ("tolerances", "loops"):
            self.__dict__.pop(name, None)

    @cached_property
    def loops(self) -> LoopSolver:
        unknowns = len(self.program.unknowns.names)
        magnitude = self.tolerances.magnitude if unknowns else np.ones(len(self.program.states.names))
        return self.constraints.loops(magnitude)

    @cached_property
    def singular(self) -> SingularPoseMonitor:
        from ..constraints.singular import SingularPoseMonitor

        return SingularPoseMonitor(self.constraints, self.loops, self.result.poses)

    def key_at(self, stretch: Segment, x: Array) -> tuple[object, ...]:
        """Return all that decides, beside the values of the run, how a segment goes from a state."""
        tolerances = self.tolerances
        sizes = (
            tolerances.relative,
            tolerances.absolute.tobytes(),
            tolerances.held.tobytes(),
            tolerances.magnitude.tobytes(),
        )
        return *stretch.key, x.tobytes(), *sizes, self.whole

    def signals(self, stretch: Segment) -> Signals:
        """Return the signals of time on a segment, or on a longer one that ends with it: events cut one segment into many."""
        silent: Signals | None = self.program.kept.get("silent")
        if silent is not None:
            return silent
        hybrid, mode = self.program.hybrid, np.asarray(stretch.mode)
        key = stretch.stop, mode.tobytes() if hybrid is None or hybrid.switches_signals else b""
        if key not in self._signals:
            if len(self._signals) >= MOST_KNOWN:
                self._signals.clear()
            fixed = self.program, self.inputs, self.constants
            self._signals[key] = self.constraints.recall(
                "signals", (*stretch.key, self.whole), lambda: signals_on(*fixed, stretch, self.whole)
            )
            if not len(self._signals[key].allowed):  # there are none
                self.program.kept["silent"] = self._signals[key]
        return self._signals[key]

    def done(self, x: Array, mode: Array) -> Trajectory:
        """Return the trajectory, with the state and the mode at the end."""
        if self.result.handover is not None:
            self.result.states = self.result.states[: self.position].copy()  # the rest needs no memory any more
            self.result.kept = None
        self.result.states[self.position :] = x
        self.position = len(self.result.states)
        self.result.final = x
        self.let_go()
        if self.result.handover is None:
            end = float(self.instants[-1]) if self.result.stopped is None else self.result.stopped
            self.keep(end, x, mode, end)
        return self.result

    def let_go(self) -> None:
        """Release all data that refer to this object."""

    def keep(
        self, time: float, x: Array, mode: Array, begun: float, work: Array | None = None, position: int | None = None
    ) -> None:
        """Store a checkpoint after a step that was accepted and that all monitors have checked."""
        result, history = self.result, self.history
        events, on = ((), {}) if self.events is None else (self.events.log, dict(self.events.on))
        result.kept = Kept(
            time, x, mode, begun, self.position if position is None else position, len(result.pieces), len(result.jumps),
            len(events), 0 if history is None else len(history.starts), result.work if work is None else work, on,
        )  # fmt: skip

    @property
    def floor(self) -> Any:
        """Rounding errors of the roots of conditions; None if there are none."""
        return None if self.events is None else self.events.floor

    def held(self, time: float, x: Array, mode: Array) -> Any:
        """Return a state projected on its invariants, with the unknowns that belong to it."""
        if not self.constraints.all and not self.program.unknowns.names:
            return x
        loops = self.loops if self.program.unknowns.names else None  # they scale the constraints first
        projected = self.constraints.project(time, x, mode)
        return projected if loops is None else loops.solve(time, projected, mode)

    def held_all(self, times: Array, states: Array, mode: Array) -> Any:
        """Return projected states at several instants, with their unknowns; shape (times, n)."""
        return self.loops.solve_all(times, self.constraints.project_all(times, states, mode), mode)

    def tell_crawling(self, solver: CompiledMethod, steps: int, segment: Segment) -> None:
        """Note in the result the cause of very many steps in a segment, and states far beyond their magnitudes."""
        flip, magnitude = self.flip, self.tolerances.magnitude  # what lies behind an event in its step never comes
        time, state = (solver.record.time, solver.state) if flip is None else (flip.time, flip.state / magnitude)
        if is_usual(state, steps):
            return
        context = self.context
        self.result.notes += [
            *notes_of(context, solver, steps, segment, self.solver == "explicit"),
            *growth_notes(context, time, state, self.result.notes),
        ]

    def name(self, method: int, target: str) -> None:
        """Note in the result the method and target of the steps."""
        self.result.solvers[f"{METHODS[method].name}, {target}"] = None

    def count(self, evaluations: Mapping[str, int]) -> None:
        for name, count in evaluations.items():
            if not count:
                continue
            self.result.evaluations[name] = self.result.evaluations.get(name, 0) + count

    def check_forced(self, time: float, before: Array, after: Array, x: Array) -> None:
        """Raise `RunFailed` if what is differentiated jumps where conditions change. `before`, `after`: modes."""
        if not self.program.jumping.names or (before == after).all():
            return

        def values_at(time: float, x: Array) -> Array:
            """Return what is differentiated, in both modes (2, n)."""
            both = (self.program.forced(time, x, self.inputs, self.constants, mode) for mode in (before, after))
            return np.array([np.array(values) for values in both])

        old, new = values = values_at(time, x)
        jump, least = np.abs(new - old), 1e-9 * np.abs(values).max(axis=0)
        if (jump > least).any():  # it may vanish there but for its rounding, as at the end of a smoothstep
            shifts = EPS * np.random.default_rng(0).integers(-2, 3, (8, 1 + len(x)))
            scale = np.fmax(np.abs(x), self.tolerances.magnitude)
            near = [np.abs(values_at(time * (1 + s[0]), x + scale * s[1:]) - values) for s in shifts]
            least = np.fmax(least, ROUNDING * np.fmax.reduce(np.concatenate(near)))
        bad = np.flatnonzero(jump > least)
        if len(bad):
            raise RunFailed(
                "BR765", f"at t = {time:.9g} s `{self.program.jumping.names[bad[0]]}`, which is differentiated, jumps from {old[bad[0]]:.6g} to "
                f"{new[bad[0]]:.6g}: its rate would be an impulse;",
                "let it change within a time, or put a resistor between it and the storage that it forces",
            )  # fmt: skip

    def check_rates(self, start: float, x: Array, mode: Array) -> None:
        """Raise `RunFailed` if a rate is not finite where a run begins."""
        slope = self.program.derivative(start, x, self.inputs, self.constants, mode)
        if not np.isfinite(slope).all():
            raise not_finite(self.program, start, slope, x, mode)

    def failed(self, solver: CompiledMethod, what: str, mode: Array) -> RunFailed:
        """Return the error that explains why the run ends here."""
        most = MOST_COMPILED if solver.native else MOST_STEPS
        return failure(self.context, solver, what, mode, self.solver == "explicit", most)

    def grow(self, x: Array) -> None:
        """Update the largest magnitudes, which only a run with events reads."""
        peak = self.result.peak
        self.result.peak = np.abs(x) if peak is None else np.maximum(peak, np.abs(x))

    def check_runaway(self, time: float, x: Array) -> None:
        """Raise `RunFailed` if a sampled loop grows without bound; only integrators with events do."""

    def follow(self, start: float, stop: float, stretch: Segment, state_at: StateAt, within: CompiledMethod | None = None) -> Segment:  # fmt: skip
        """Search a step for events; only integrators with events do this, here the segment is returned unchanged."""
        return stretch

    def follow_step(
        self, last: tuple[float, float], parts: int, stretch: Segment, state_at: StateAt, within: CompiledMethod | None = None
    ) -> Segment:  # fmt: skip
        """Search the last step for events by `follow`, in as many parts as its method needs."""
        start, stop = self.followed = last
        edges = [start + (stop - start) * k / parts for k in range(parts)] + [stop]
        for a, b in pairwise(edges):
            stretch = self.follow(a, b, stretch, state_at, within)
            if self.flip is not None:
                break
        return stretch

    def marked(self) -> Any:
        """Return the data that `follow` changes; only for integrators with events."""

    def shortened(self, start: float, size: float) -> float:
        """Return the size of a repeated step: `size`, or half of its last size if it was repeated before, so that repetition ends."""
        before, last = self.repeated
        if start == before:
            size = min(size, 0.5 * last)
        self.repeated = start, size
        return size

    def go_back(self, mark: Any) -> None:
        """Restore the data of `marked` before a step is repeated with a shorter size; only for integrators with events."""

    def flips_just_ahead(self, told: StepsCollapsed, stretch: Segment) -> bool:
        """Return True if an event lies where steps collapse: beyond it the law of this side may have no value. Here always False."""
        return False

    def look(self, solver: CompiledMethod, stretch: Segment, reported: Array) -> None:
        """Check the limits of the model at the stages of the last step and at the reported instants within it."""
        start, stop = solver.last_step
        stop = stop if self.flip is None else self.flip.time
        magnitude = self.tolerances.magnitude
        self.watch_limits(start, stop, reported, lambda t: solver.sample(t) * magnitude, stretch, solver.inner)

    def watch_limits(
        self, start: float, stop: float, reported: Array, sample: Callable[[Any], Any], stretch: Segment,
        inner: Sequence[float] = INNER,
    ) -> None:  # fmt: skip
        if self.watch.moves:
            times = np.unique(np.concatenate([[start], start + np.array(inner) * (stop - start), [stop], reported]))
            self.watch.look(times, stretch.mode, lambda t: self.held_all(t, sample(t), stretch.mode))

    def look_at_places(self, extremes: ExtremesMonitor, times: Array, states: Array, mode: Array) -> None:
        """Search steps for the extremes of the outputs; `times` (steps, places), `states` (steps, places, n)."""
        if len(self.program.unknowns.names) and len(times):
            n = states.shape[-1]
            states = self.loops.solve_all(times.reshape(-1), states.reshape(-1, n).copy(), mode).reshape(states.shape)
        extremes.look(times, states, mode)

    def add_work(self, start: float, stop: float, sample: Callable[[Any], Any], stretch: Segment) -> None:
        """Add the work of a step. `sample`: states at instants, with or without the multipliers that belong to them."""
        powers = self.powers
        assert powers is not None

        def at(times: Array) -> Any:
            states = sample(times)
            # multipliers of a collocation polynomial start from those of the step before
            if len(self.program.multipliers):
                states = self.loops.solve_all(times, states, stretch.mode)
            return powers(times, states, stretch.mode)

        self.add(*work_of(at, start, stop, self.traffic, self.tolerances.relative))

    def add(self, work: Array, traffic: float) -> None:
        """Add work at all ports, and the sum of its absolute values."""
        self.traffic += traffic
        self.result.work = work if self.result.work is None else self.result.work + work
