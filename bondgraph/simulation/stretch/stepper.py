"""What steps through smooth stretches holds and keeps, whatever makes the steps: see `one_by_one.py` and `machine.py`.

States are divided by their magnitudes before the solver sees them, which keeps its linear algebra well scaled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from ...door import Program
from ...errors import RunFailed, StepsCollapsed, UsageError
from ..closed.constraints import Constraints
from ..loops.loops import LoopSolver
from ..segments import Segment, Signals, signals_on, with_time_of
from ..steps.methods import AUTOMATIC, ENERGY, NAMES
from ..steps.radau import INNER, Radau
from ..trajectory import Kept, Tolerances, Trajectory, empty
from ..watch.beyond import notes_of_beyond
from ..watch.choice import Choice
from ..watch.crawling import notes_of
from ..watch.stuck import MOST_STEPS, failure, not_finite
from ..watch.validity import Watch
from .quadrature import work_of
from .stateless import without_states

if TYPE_CHECKING:
    from ..bandwidth.leave import Leaving
    from ..closed.singular import Watcher
    from ..events.history import History
    from ..events.locate import Flip, RootsAt, StateAt
    from ..steps.compiled.interpreted import Interpreted
    from ..steps.compiled.run import CompiledRadau
    from .machine import InMachineCode

Solver = Union["Radau", "Interpreted", "CompiledRadau"]
Powers = Callable[[Any, Any, Any], Any]  # times, states (…, n), mode -> (…, ports)
MOST_KNOWN = 64  # modes whose signals are kept


class Stepper:
    """Steps through one smooth stretch after another and keeps what was asked for."""

    def __init__(
        self,
        program: Program,
        constants: Any,
        inputs: Any,
        instants: Any,
        tolerances: Callable[[], Tolerances],
        powers: Powers | None,
        watch: Watch,
        constraints: Constraints,
        into: Trajectory | None = None,
    ) -> None:
        self.watch, self.constraints = watch, constraints
        self.choice: Choice | None = None
        self.leaving: Leaving | None = None
        self.linear = False
        self.solver = AUTOMATIC  # what the author asks for
        self.steps, self.most_steps = 0, MOST_STEPS  # of all stretches
        self.mode: Any = None  # where the last piece ended
        self.history: History | None = None  # of delayed signals
        self.followed = (-np.inf, -np.inf)  # the step that is looked at
        self.repeated = (-np.inf, np.inf)  # where the last step that was made anew began, and how long it was then
        self.reached = -np.inf  # where the last run ended
        self.flip: Flip | None = None  # where the last stretch ended early
        self.longest = float(min(np.abs(program.periods(constants)), default=np.inf))
        self.program, self.constants, self.inputs = program, constants, inputs
        self.instants, self.powers, self._tolerances = instants, powers, tolerances
        self.whole = float(instants[-1] - instants[0])  # how long the run is
        self.traffic = 0.0  # the work at all ports so far, whatever its sign
        self.position = 0  # the next instant to be reported
        self.machine: InMachineCode | None = None  # what steps in machine code, from its first stretch on
        self._signals: dict[tuple[float, bytes], Signals] = {}
        self.exponentials: dict[bytes, tuple[Any, Any]] = {}  # of linear segments, by their matrices
        self.methods: dict[bytes, int] = {}  # that were chosen, by mode: what is told of a spectrum once
        self.result = into if into is not None else empty(program, instants)

    @cached_property
    def tolerances(self) -> Tolerances:
        found = self._tolerances()
        self.constraints.scale(found.magnitude)
        return found

    def look_anew(self) -> None:
        """Forget magnitudes, and what has them."""
        for name in ("tolerances", "loops"):
            self.__dict__.pop(name, None)

    @cached_property
    def loops(self) -> LoopSolver:
        unknowns = len(self.program.unknowns.names)
        magnitude = self.tolerances.magnitude if unknowns else np.ones(len(self.program.states.names))
        return LoopSolver(self.program, self.constants, self.inputs, magnitude, self.constraints.parameters)

    @cached_property
    def singular(self) -> Watcher:
        from ..closed.singular import Watcher

        return Watcher(self.constraints, self.loops, self.result.poses)

    def signals(self, stretch: Segment) -> Signals:
        """What time alone moves on a stretch, or on a longer one that ends with it: events cut one into many."""
        hybrid, mode = self.program.hybrid, np.asarray(stretch.mode)
        key = stretch.stop, mode.tobytes() if hybrid is None or hybrid.switches_signals else b""
        if key not in self._signals:
            if len(self._signals) >= MOST_KNOWN:
                self._signals.clear()
            self._signals[key] = signals_on(self.program, self.inputs, self.constants, stretch, self.whole)
        return self._signals[key]

    def done(self, x: Any, mode: Any) -> Trajectory:
        """What has been kept, with the state and the mode at the end."""
        if self.result.handover is not None:
            self.result.states = self.result.states[: self.position]
            self.result.kept = None
        self.result.states[self.position :] = x
        self.position = len(self.result.states)
        self.result.final = x
        self.let_go()
        if self.result.handover is None:
            self.keep(float(self.instants[-1]), x, mode, float(self.instants[-1]))
        return self.result

    def let_go(self) -> None:
        """Of what steps in machine code, which knows this stepper: then all that a run holds is free at once, not only when a collector
        looks for circles."""
        self.machine = None

    def keep(self, time: float, x: Any, mode: Any, begun: float, work: Any = None, position: int | None = None) -> None:
        """What is sure so far: a step has been accepted, and all that looks at it has done so."""
        result, history = self.result, self.history
        count, on = self.happened
        result.kept = Kept(
            time, x, mode, begun, self.position if position is None else position, len(result.pieces), len(result.jumps),
            count, 0 if history is None else len(history.starts), result.work if work is None else work, on,
        )  # fmt: skip

    @property
    def happened(self) -> tuple[int, Mapping[tuple[str, int], bool]]:
        """How many events there were, and which events' conditions hold."""
        return 0, {}

    @property
    def floor(self) -> Any:
        """How near to zero roots of conditions are rounding; None if there are none."""
        return None

    def remember(self, history: History | None) -> None:
        """Keep what delayed signals will be; no step is longer than the shortest delay."""
        self.history = history
        if history is not None:
            self.longest = min(self.longest, float(history.lags.min()))

    def run_to_end(self, stretch: Segment, x: Any) -> Any:
        """One stretch; it is cut where a delayed signal jumps, and where something is left out."""
        start = stretch.start
        while True:
            stop = stretch.stop if self.history is None else self.history.next_cut(start, stretch.stop)
            x = self.run(stretch.up_to(start, stop), x)
            start = self.reached
            if start >= stretch.stop or self.result.handover is not None:
                return x

    def run(self, stretch: Segment, x: Any) -> Any:
        """One stretch from state x, or up to the first event in it; returns the state at its end."""
        self.reached = stretch.stop
        if self.history is not None:
            self.history.window = stretch.start, stretch.stop
        x = self.held(stretch.start, x, stretch.mode)
        first = self.position
        if not self.linear:
            x = self._without_ringing(stretch, x)
        self._put_start(stretch, x, first)
        if not len(self.program.states.names):
            return without_states(self, stretch, x)
        self.watch.look(np.array([stretch.start]), stretch.mode, lambda times: np.tile(x, (len(times), 1)))
        if self.linear:
            from .exact import exactly

            end = exactly(self, stretch, x)
            if end is not None:
                return end
        if self.solver == "exponential":
            from .exact import check_driven

            check_driven(self, stretch, x)
            raise UsageError(
                "the matrix exponential takes linear models of up to a few hundred states, without events on states, noise and delays, whose "
                "inputs a few thousand polynomials can follow; leave the solver to choose"
            )
        if self.linear:  # but not to be solved exactly
            x = self._without_ringing(stretch, x)
            self._put_start(stretch, x, first)
        return self._by_steps(stretch, x)

    def _put_start(self, stretch: Segment, x: Any, first: int) -> None:
        """The state in which a stretch starts, at all reported instants from the first on that are no later."""
        self.position = first
        while self.position < len(self.instants) and self.instants[self.position] <= stretch.start:
            self.result.states[self.position] = x
            self.position += 1
        self.keep(stretch.start, x, stretch.mode, stretch.start)

    def _without_ringing(self, stretch: Segment, x: Any) -> Any:
        """The state without what is faster than the bandwidth, if there is one."""
        if self.leaving is None or not len(self.program.states.names):
            return x
        return self.leaving.begin(self, stretch, x)

    def _by_steps(self, stretch: Segment, x: Any) -> Any:
        """One stretch by a method that chooses its steps."""
        obstacle: str | None = "" if self.history is None else " (delays)"
        if self.program.native is not None:
            from .machine import obstacle_of

            obstacle = obstacle_of(self.program)
        from .method import method_of

        compiled = obstacle is None
        method = method_of(self, stretch, x, compiled)
        target = "native" if compiled else f"numpy{obstacle}"
        self.name(method, target)
        self.check_rates(stretch.start, x, stretch.mode)
        size = np.inf
        if method == ENERGY:
            from .conserving import equal_steps

            size = equal_steps(self, stretch, x, compiled)
        if compiled:
            from .machine import in_machine_code

            return in_machine_code(self, stretch, x, method, size)
        from .one_by_one import one_by_one

        return one_by_one(self, stretch, x, method, size, target)

    def held(self, time: float, x: Any, mode: Any) -> Any:
        """A state on its invariants, with the unknowns that belong to it."""
        return self.loops.solve(time, self.constraints.project(time, x, mode), mode)

    def held_all(self, times: Any, states: Any, mode: Any) -> Any:
        """The same for several instants; shape (times, n)."""
        return self.loops.solve_all(times, self.constraints.project_all(times, states, mode), mode)

    def tell_crawling(self, solver: Solver, steps: int, mode: Any) -> None:
        """Tell the result what held the steps, if they were very many, and what went much farther than was seen."""
        self.result.notes += [*notes_of(self, solver, steps, mode), *notes_of_beyond(self, solver)]

    def name(self, method: int, target: str) -> None:
        """Tell the result what steps."""
        self.result.solvers[f"{NAMES[method]}, {target}"] = None

    def count(self, evaluations: Mapping[str, int]) -> None:
        for name, count in evaluations.items():
            if not count:
                continue
            self.result.evaluations[name] = self.result.evaluations.get(name, 0) + count

    def check_forced(self, time: float, before: Any, after: Any, x: Any) -> None:
        """What is differentiated in time must not jump where conditions on time change. `before`, `after`: modes."""
        if self.mode is not None:
            before, after = self.mode, with_time_of(self.program, after, self.mode)
        if (before == after).all():
            return
        fixed = (x, self.inputs, self.constants)
        old, new = (np.asarray(self.program.forced(time, *fixed, mode)) for mode in (before, after))
        bad = np.flatnonzero(np.abs(new - old) > 1e-9 * np.maximum(np.abs(new), np.abs(old)))
        if len(bad):
            raise RunFailed(
                f"at t = {time:.9g} s what forces a storage in derivative form jumps from {old[bad[0]]:.6g} to {new[bad[0]]:.6g}: "
                "its flow would be an impulse; put a resistor between source and storage, or let the source rise within a time"
            )

    def check_rates(self, start: float, x: Any, mode: Any) -> None:
        """A run can only begin where all rates are numbers."""
        slope = self.program.derivative(start, x, self.inputs, self.constants, mode)
        if not np.isfinite(slope).all():
            raise not_finite(self.program, start, slope, x, mode)

    def failed(self, solver: Solver, what: str, mode: Any) -> RunFailed:
        """Why the run ends here."""
        return failure(self, solver, what, mode)

    def grow(self, x: Any) -> None:
        """What an event stepper keeps of a state."""

    def follow(
        self, start: float, stop: float, stretch: Segment, state_at: StateAt, roots_at: RootsAt | None = None
    ) -> Segment:
        """Where an event stepper looks for events in a step."""
        return stretch

    def follow_step(
        self,
        last: tuple[float, float],
        parts: int,
        stretch: Segment,
        state_at: StateAt,
        roots_at: RootsAt | None = None,
    ) -> Segment:
        """The last step through `follow`, in as many parts as its method needs for being looked at as closely as any other."""
        start, stop = self.followed = last
        edges = [start + (stop - start) * k / parts for k in range(parts)] + [stop]
        for a, b in pairwise(edges):
            stretch = self.follow(a, b, stretch, state_at, roots_at)
            if self.flip is not None:
                break
        return stretch

    def marked(self) -> Any:
        """What an event stepper changes where it follows a step."""

    def shortened(self, start: float, size: float) -> float:
        """How long a step is made anew that was to have this size: half of what it was when it was made anew before, so that this comes to an end."""
        before, last = self.repeated
        if start == before:
            size = min(size, 0.5 * last)
        self.repeated = start, size
        return size

    def go_back(self, mark: Any) -> None:
        """The last step is to be made anew, and shorter: an event stepper forgets what it found in it."""

    def flips_just_ahead(self, told: StepsCollapsed, stretch: Segment) -> bool:
        """Whether an event stepper sees an event where steps collapse: beyond it the law of this side may have no value."""
        return False

    def look(self, solver: Solver, stretch: Segment, reported: Any) -> None:
        """Look at the limits of the model at the stages of the last step and at the instants that it passed."""
        start, stop = solver.last_step
        stop = stop if self.flip is None else self.flip.time
        magnitude = self.tolerances.magnitude
        self.watch_limits(start, stop, reported, lambda t: solver.sample(t) * magnitude, stretch, solver.inner)

    def watch_limits(
        self, start: float, stop: float, reported: Any, sample: Callable[[Any], Any], stretch: Segment,
        inner: Sequence[float] = INNER,
    ) -> None:  # fmt: skip
        if self.program.limits:
            times = np.unique(np.concatenate([[start], start + np.array(inner) * (stop - start), [stop], reported]))
            self.watch.look(times, stretch.mode, lambda t: self.held_all(t, sample(t), stretch.mode))

    def add_work(self, start: float, stop: float, sample: Callable[[Any], Any], stretch: Segment) -> None:
        """The work of a step. `sample`: states at instants, with or without the multipliers that belong to them."""
        powers = self.powers
        assert powers is not None

        def at(times: Any) -> Any:
            states = sample(times)
            if len(self.program.multipliers):  # those of a collocation polynomial begin where the step before left them
                states = self.loops.solve_all(times, states, stretch.mode)
            return powers(times, states, stretch.mode)

        self.add(*work_of(at, start, stop, self.traffic, self.tolerances.relative))

    def add(self, work: Any, traffic: float) -> None:
        """Work at all ports, and how much of it there was whatever its sign."""
        self.traffic += traffic
        self.result.work = work if self.result.work is None else self.result.work + work
