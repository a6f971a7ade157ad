"""One phase of a run (`Phase`): a program with one choice of states, from the initialization or from the transition of the phase before."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, Array

from ..errors import NotLossless, RateNotFinite, RunFailed, StepsCollapsed, UsageError
from ..numerics.scales import nonzero
from ..results.checkpoint import Checkpoint
from ..results.records import EnergyBalance, EventRecord, ToleranceDoubt
from .constraints.constraints import Constraints
from .initialization.consistent_start import consistent_start
from .integration.integrate import integrate
from .integration.integration_state import PhaseProblem
from .magnitudes.nominal_magnitudes import (
    Magnitudes,
    least_tolerances,
    nominal_magnitudes,
    of_what_moved,
    rounding_levels,
)
from .magnitudes.pilot_run import PilotObservation
from .monitors.state_selection import Choice
from .monitors.validity import ValidityMonitor
from .segments.run_values import run_values
from .segments.timeline import Segment, Timeline, aligned, discrete_variables, mode_after, rest_of, timeline_in_parts
from .segments.trajectory import Tolerances, Trajectory, empty
from .segments.transition import PhaseTransition

if TYPE_CHECKING:
    from compiler.api import Plan, Program, Scene, StateSpace

    from ..compiled_scene import CompiledScene
    from ..results.truncation import TruncationReport
    from .events.complementarity import Companion
    from .events.events import Events
    from .events.history import History
    from .events.impulse import StorageJump
    from .truncation.mode_truncation import Leaving, Removal


ROUNDED = 3.0  # tolerances of rounding in a step from which a run warns
DIVERGED = 1e6  # growth of the change from one iteration to the next after which these do not converge
BESIDE = 1e-12  # fraction of a run: a reported instant this close to its end by a condition is that end
MOST_SETTLING = 400  # most iterations between delayed signals and an initialization that reads them
SETTLED = 1e-14  # relative change of delayed signals that counts as rounding


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


# Junctions that are off, and discrete variables by name, with which a run begins.
SwitchedStart = tuple[tuple[str, ...], tuple[tuple[str, float], ...]]


def no_rest() -> RunFailed:
    """Return the failure where ideal diodes or switches turn on or off at an equilibrium that was computed in another mode."""
    return RunFailed(
        "BR732", "no equilibrium was found: ideal diodes or switches do not stay as they are where the model would rest;",
        "start it nearer to its rest, or give them resistances",
    )  # fmt: skip


class Phase:
    """State of one phase of a run: one program with one choice of states."""

    def __init__(
        self, compilation: CompiledScene, instants: Array, options: PhaseOptions, begin: PhaseTransition | None = None, companion: Companion | None = None,
        modes: Mapping[str, float] | None = None, smooth: dict[Program, Timeline] | None = None,
    ) -> None:  # fmt: skip
        """`companion`, `modes`: of the ideal valves; `smooth`: segments of the programs of the run so far."""
        self.solver, self.parts = options.solver, options.parts
        self.bandwidth = options.bandwidth
        self.companion, self.modes_at_start = companion, modes or {}  # modes of the ideal valves
        self.compilation, self.plan, self.begin = compilation, options.plan, begin
        self.set = options.values  # parameters set when a run begins
        hybrid = compilation.program.hybrid
        self.off = compilation.compilation.off if hybrid is not None and hybrid.junctions else ()
        self.begins_without = self.goes_on_without = self.off  # before any event acts, and after those at the start
        self.history = None if compilation.program.delays is None else self._history(compilation.program)
        self.program = program = compilation.program if self.history is None else self.history.program
        self.instants, self.rtol, self.atol, self.energy = instants, options.rtol, options.atol, options.energy
        values = run_values(program, self._given(program))
        self.inputs = values.inputs
        size = np.ones(len(program.states.names))
        self.constraints = Constraints(program, values.parameters, self.inputs, size, values)
        start = instants[0] if begin is None else begin.time
        course = self._timeline(program, (start, float(instants[-1])), {} if smooth is None else smooth)
        self.stretches, self.timed = course.segments, course.notes
        self.events: Events | None = None
        self.jumps: tuple[StorageJump, ...] = ()  # of stored quantities, where junctions went on or off
        self.known = dict(begin.magnitudes) if begin is not None else {}  # magnitudes by name
        self.state, self.start_notes = self._start(program, compilation, self.constraints, self.stretches)
        if self.history is not None and begin is None:
            self._settle_history(self.history, start)
        self.looked_from = self.state  # state from which a pilot run starts
        self.leaving: Leaving | None = None  # modal truncation at the bandwidth
        self.left_out: TruncationReport | None = None
        self.parameters, self.constants = self.constraints.parameters, self.constraints.constants
        self.told = self._told_tolerances()
        self.notes: tuple[str, ...] = ()
        self.doubts: tuple[ToleranceDoubt, ...] = ()  # about tolerances
        self.trajectory = Trajectory(np.empty((0, 0)))
        self.watch = ValidityMonitor(program, self.constants, self.inputs, self.rtol)
        # stored quantities at the end of the phase before, later those at the end of this phase
        self.held: dict[str, Any] | None = None
        self.scene: Scene = compilation.scene
        self.whole = False  # True once the phase has reached its end
        self.used: Any = None  # the magnitudes, if they were needed
        self.values: Any = None  # outputs, shape (points, outputs)
        self.balance: EnergyBalance | None = None

    def _history(self, program: Program) -> History | None:
        from .events.history import history_of

        return history_of(program, self._given(program), None if self.begin is None else self.begin.past)

    def _given(self, program: Program) -> Any:
        """Return the parameters of this run, shape (P,)."""
        if not self.set:
            return np.array(program.defaults, dtype=float)
        return np.array([self.set.get(n, d) for n, d in zip(program.parameters.names, program.defaults, strict=True)])

    def _timeline(self, program: Program, ends: tuple[float, float], known: dict[Program, Timeline]) -> Timeline:
        """Return the segments of this phase; for a program used before in the run, its remaining segments. `known`: timelines of all programs of the run."""
        if self.history is not None or program not in known:
            constants, parts = self.constraints.constants, self.parts
            known[program] = self.constraints.recall(
                "timeline",
                (*ends, parts),
                lambda: timeline_in_parts(program, constants, ends, parts),
                lambda course: len(course.segments),
            )
            return Timeline(aligned(list(known[program].segments), self.instants), known[program].notes)
        return replace(known[program], segments=aligned(rest_of(known[program].segments, ends[0]), self.instants))

    def _start(
        self, program: Program, compilation: CompiledScene, constraints: Constraints, stretches: list[Segment]
    ) -> tuple[Any, tuple[str, ...]]:
        """Return the state at the start, with the unknowns of loops, and notes about it.

        With events, the first segment gets its mode.
        """
        constants = constraints.constants
        state = np.asarray(program.start(constants), dtype=float)
        names = program.states.names
        if not np.isfinite(state).all():
            bad = [n for n, x in zip(names, state, strict=False) if not np.isfinite(x)]
            raise RunFailed(
                "BR731", f"the start of {', '.join(f'`{b}`' for b in bad)} is not finite: a parameter makes it so"
            )
        first, horizon = stretches[0], stretches[-1].stop - self.plan.start
        if self.begin is not None and program.hybrid is not None:
            from .events.begin import continued
            from .events.impulse import refuse_jumps_of_mechanisms

            self.events, moment, self.jumps = continued(constraints, state, first, self.begin, horizon, self.companion)
            if self.companion is not None and self.companion.valves:
                refuse_jumps_of_mechanisms(self.jumps, compilation.facts.mechanisms, first.start)
            stretches[0] = replace(first, mode=moment.mode)
            return moment.state, ()
        if self.begin is not None:
            from .events.begin import carried_over

            full = carried_over(constraints, state, first, self.begin)
            return constraints.loops(np.ones(len(state))).solve(first.start, full, first.mode), ()
        full, first, notes = self._consistent(compilation, constraints, state, first, horizon)
        if program.hybrid is not None:
            from .events.begin import begun, off_in

            self.begins_without = off_in(constraints, full, first)
            if self.events is None:
                self.events, moment = begun(constraints, full, first, horizon, self.companion)
                self.goes_on_without = self.events.actives(moment)
                if self.plan.equilibrium and self.goes_on_without == self.begins_without:
                    self._check_rest(self.events, moment.state, full, moment.mode, first.mode)
                full, first = moment.state, replace(first, mode=moment.mode)
            stretches[0] = first
        return full, notes

    def _consistent(
        self, compilation: CompiledScene, constraints: Constraints, state: Array, first: Segment, horizon: float
    ) -> tuple[Any, Segment, tuple[str, ...]]:
        """Return the consistent state before any event acts, the first segment with the mode that fits it, and notes. Raises `RunFailed`."""
        program = constraints.program

        def find() -> tuple[Any, ...]:
            segment = first
            if program.hybrid is not None:
                from .events.begin import with_mode, with_modes

                segment = with_modes(program, segment, self.modes_at_start)
                segment = with_mode(compilation, constraints, state, segment, horizon)
            fixed = constraints.constants, self.inputs, state
            full, notes = consistent_start(program, compilation, *fixed, segment, constraints)
            if self.plan.equilibrium:
                full, segment = self._at_rest(compilation, constraints, full, segment, horizon)
            return full, segment, notes, constraints.assembled, constraints.taking

        if self.plan.equilibrium and program.hybrid is not None:  # its search prepares the events of this run
            return find()[:3]
        key = *first.key, horizon, *sorted(self.modes_at_start.items()), self.plan.equilibrium
        full, segment, notes, constraints.assembled, taking = constraints.recall("start", key, find)
        if not np.array_equal(taking, constraints.taking):
            constraints.leave_out(taking)
        return full.copy(), segment, notes

    def _at_rest(
        self, compilation: CompiledScene, constraints: Constraints, full: Array, first: Segment, horizon: float
    ) -> tuple[Any, Segment]:  # fmt: skip
        """Return the equilibrium reached from a consistent state, and the first segment with the mode that holds there. Raises `RunFailed`."""
        from .equilibrium.search import equilibrium
        from .equilibrium.steady import check_steady, steady_rates

        program = constraints.program
        if program.hybrid is None or self.companion is not None:
            full = equilibrium(program, constraints, self.inputs, full, first)
        else:
            from .events.equilibrium import rest_with_events
            from .events.events import Events

            self.events = Events(constraints, nonzero(np.abs(full)), horizon)
            moment = rest_with_events(constraints, full, first, self.events)
            full, first = moment.state, replace(first, mode=moment.mode)
        check_steady(
            compilation, program, steady_rates(program, constraints, first.start, full, self.inputs, first.mode)
        )
        return full, first

    @staticmethod
    def _check_rest(events: Events, state: Array, rest: Array, mode: Array, assumed: Array) -> None:
        """Raise `RunFailed` where ideal diodes or switches turn on or off at an equilibrium that was computed in another mode."""
        changed = np.asarray(mode) != assumed
        changed[events.places[~events.steers]] = False  # those that only events read
        if changed.any() or not np.allclose(state, rest, rtol=1e-9, atol=0.0):
            raise no_rest()

    def begins_again(self, settled: bool) -> SwitchedStart | None:
        """Return the start with other junctions off that this phase calls for, else None. `settled`: after the events at the start."""
        if self.begins_without != self.off:
            return self.begins_without, tuple(sorted(self.modes_at_start.items()))
        if not settled or self.goes_on_without == self.off:
            return None
        return self.goes_on_without, tuple(sorted(self._modes(self.stretches[0].mode).items()))

    def _settle_history(self, history: History, start: float) -> None:
        """Iterate the initial state and the delayed signals until they agree: before the start each delayed signal has its value at the start.

        Raises `RunFailed` if they do not converge.
        """
        least = np.inf
        for _ in range(MOST_SETTLING):
            before = np.array(history.first)
            history.begin(start, self.state, self.inputs, self.stretches[0].mode)
            change = np.abs(history.first - before)
            if (change <= SETTLED * np.maximum(np.abs(history.first), np.abs(before))).all():
                return
            least = min(least, float(change.max()))
            if change.max() > DIVERGED * least:
                break
            ends = (start, float(self.instants[-1]))
            course = timeline_in_parts(self.program, self.constraints.constants, ends, self.parts)
            self.stretches = aligned(course.segments, self.instants)
            self.events = None
            self.state, self.start_notes = self._start(self.program, self.compilation, self.constraints, self.stretches)
        raise RunFailed(
            "BR733", f"at t = {start:.9g} s what is delayed and the state at the start do not settle on each other: each makes the other larger, or goes to "
            "and fro;", "give the start itself instead of `equilibrium`, or delay what does not read itself",
        )  # fmt: skip

    def tolerances(self) -> Tolerances:
        """Return absolute tolerances per state: the given value, else rtol times the magnitude."""
        magnitude = self.used = self._magnitudes()
        absolute = np.full(len(self.state), self.atol) if self.atol is not None else self.rtol * magnitude
        if self.atol is None and self.constraints:
            mechanisms, first = self.compilation.facts.mechanisms, self.stretches[0]
            least = least_tolerances(self.program, mechanisms, self.constraints, self.looked_from, first, magnitude)
            absolute = np.maximum(absolute, least)
        held = np.full(len(self.state), self.atol is not None)
        multipliers = [len(self.program.states.names) + m for m in self.program.eliminated]
        absolute[multipliers] = np.inf  # multipliers follow from the states, and have no bound near a singular pose
        for index, value in self.told.items():
            absolute[index], held[index] = value, True
        return Tolerances(self.rtol, absolute, magnitude, held)

    def _told_tolerances(self) -> dict[int, float]:
        """Return the absolute tolerances that the experiment gives, by index of the state or unknown. Raises `UsageError`."""
        result: dict[int, float] = {}
        if not self.plan.tolerances:
            return result
        variables = {n: i for i, n in enumerate(self.program.variables.names)}
        for name, value in self.plan.tolerances.items():
            index = variables.get(name, self.compilation.facts.shown.get(name))
            if index is None:
                index, factor = self.compilation.facts.following.get(name, (-1, None))
                if factor is None:
                    told = f" (it follows `{self.program.states.names[index]}`)" if index >= 0 else ""
                    raise UsageError(
                        "BR719", f"the tolerance of `{name}` cannot be held: it is no state of this run{told}; states are {', '.join(variables)}",
                    )  # fmt: skip
                value /= abs(factor)
            result[index] = min(value, result.get(index, value))
        return result

    def _magnitudes(self) -> Any:
        """Return magnitudes of all states and unknowns."""
        if self.begin is not None or self.companion is not None:
            return self._magnitudes_now()
        first, last = self.stretches[0], self.stretches[-1]
        on = () if self.events is None else (self.events.horizon, *sorted(self.events.on.items()))
        key = *first.key, last.stop, self.parts, self.looked_from.tobytes(), self.state.tobytes(), on
        values, self.doubts, magnitudes = self.constraints.recall(
            "magnitudes", key, lambda: (self._magnitudes_now(), self.doubts, dict(self.known))
        )
        self.known = dict(magnitudes)
        if self.events is not None:
            self.events.measure(values.copy())
        return values.copy()

    def _magnitudes_now(self) -> Any:
        mechanisms = self.compilation.facts.mechanisms

        def found_with(choice: PilotObservation, largest: Array | float = 0.0) -> Magnitudes:
            return nominal_magnitudes(self.constraints, mechanisms, self.looked_from, self.stretches, choice, largest)

        names = self.program.variables.names
        if self.events is not None:
            return self._magnitudes_with_events(found_with)
        if all(n in self.known for n in names):
            return np.array([self.known[n] for n in names])
        found = found_with(self._choice(), self._peaks(names))
        self.doubts = found.doubts
        return found.values

    def _peaks(self, names: Sequence[str]) -> Any:
        """Return the largest absolute values that states have had before this phase."""
        if self.begin is None:
            return np.zeros(len(names))
        return np.array([self.begin.peaks.get(n, 0.0) for n in names])

    def _magnitudes_with_events(self, found_with: Callable[..., Magnitudes]) -> Any:
        """Return magnitudes of all states: from a pilot run up to the first event, then from a coarse run through the events."""
        from .events.begin import UntilEvent

        names = self.program.variables.names
        events = self.events
        assert events is not None
        known = self.known
        mechanisms = self.compilation.facts.mechanisms
        if known and mechanisms:
            levels = rounding_levels(self.program, mechanisms, self.constraints, self.looked_from, self.stretches[0])
            known = of_what_moved(known, self.program, levels)
        if not all(n in known for n in names):
            first = found_with(UntilEvent(events, self._choice()))
            from .integration.event_integrator import pilot

            events.measure(first.values)
            saved = None if self.history is None else self.history.saved()
            companion = None if self.companion is None else self.companion.ahead()
            copied = replace(events, on=dict(events.on), log=[], companion=companion)
            largest = pilot(self._problem(copied, None), self.state, self.stretches, first.values)
            if self.history is not None and saved is not None:
                self.history.restore(saved)
            first = found_with(UntilEvent(events, self._choice()), np.maximum(largest, self._peaks(names)))
            self.doubts = first.doubts
            known = dict(zip(names, map(float, first.values), strict=True)) | known
        events.measure(np.array([known[n] for n in names]))
        self.known = known
        return events.magnitude.copy()

    def _choice(self) -> Choice:
        storages = frozenset(self.compilation.facts.storages)
        return Choice(self.program, self.constants, self.inputs, storages, self.begin)

    def _problem(self, events: Events | None, choice: Choice | None) -> PhaseProblem:
        """Return the integration of this phase, with its events or a copy of them."""
        return PhaseProblem(
            self.program, self.constants, self.inputs, self.instants, self.tolerances,
            self._powers if self.energy else None, self.watch, self.constraints, choice, self.compilation.certificate.linear,
            events, self.off, self.history, self.solver, self.leaving,
        )  # fmt: skip

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
        try:
            integrate(self._problem(self.events, self.choice), self.state, self.stretches, self.trajectory)
        except RateNotFinite as failed:
            from .monitors.finite import cause_of

            modes = self._modes(failed.mode)
            cause = cause_of(program, self.compilation.state_space, failed.time, failed.state, self.parameters, modes)
            raise RunFailed("BR745", f"{failed}: {cause}") from None
        except StepsCollapsed as failed:
            raise self._explained(failed) from None
        except NotLossless as failed:
            raise self._lossy(failed) from None
        self._end_where_stopped()
        self._finish()
        self.values = self._outputs()
        self.whole = True
        if not np.isfinite(self.values).all():
            from .monitors.finite import check_finite

            space = self.compilation.state_space
            check_finite(program, space, self.instants, self.values, self.trajectory.states, self.parameters)
        self.balance = self._balance() if self.energy else None

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
        if self.bandwidth is None or self.program.hybrid is not None or self.history is not None:
            return None
        from .truncation.mode_truncation import Leaving

        def restart(state: Array) -> None:
            self.looked_from = state

        return Leaving(self.bandwidth, float(self.instants[-1] - self.instants[0]), restart)

    def _modes(self, mode: Array) -> dict[str, float]:
        """Return the discrete variables that only events change, by name."""
        hybrid = self.program.hybrid
        return {} if hybrid is None or mode is None else discrete_variables(hybrid, mode)

    def _explained(self, failed: StepsCollapsed) -> RunFailed:
        """Return the failure of collapsed steps, with its cause if a quantity a little ahead has no value."""
        from .monitors.finite import cause_ahead

        space, here = self.compilation.state_space, (failed.time, failed.state)
        for ahead in failed.ahead:
            cause = cause_ahead(self.program, space, here, ahead, self.parameters, self._modes(failed.mode))
            if cause is not None:
                return RunFailed("BR746", f"no step leads on from t = {failed.time:.9g} s: just ahead {cause}")
        return failed

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
                self.values = self._outputs()
        wrong = np.flatnonzero(~np.isfinite(self.values).all(axis=1))
        if len(wrong):
            self.instants, self.values = self.instants[: wrong[0]], self.values[: wrong[0]]
            self.trajectory.kept = None  # its instant lies beyond the last finite output
        elif self.energy and kept is not None:
            self.balance = self._balance()

    def _finish(self) -> None:
        if self.history is not None:
            self.history.window = (-np.inf, np.inf)
        self.notes += tuple(dict.fromkeys(self.trajectory.notes))[:1]
        if self.trajectory.rounded > ROUNDED:
            self.doubts += (self._doubt(self.trajectory.rounded),)
        self.notes += self.timed
        resolutions = {id(s.resolution): s.resolution for s in self.stretches if s.resolution is not None}
        self.notes += tuple(note for resolution in resolutions.values() for note in resolution.notes)
        if self.events is not None:
            from .events.bounds import notes_on_conditions

            self.notes += notes_on_conditions(self.program, self.events.crowded, self.events.touches)
            self.notes += self.compilation.facts.undetermined
        if self.constraints and len(self.trajectory.states):
            from .constraints.singular import doubts_of, told_of

            assembled = self.constraints.assembled if self.begin is None else None  # only of the first phase
            self.notes += told_of(assembled, self.trajectory.poses)
            self.doubts += doubts_of(self.trajectory.poses)
        self.instants = self.instants[: len(self.trajectory.states)]
        if self.bandwidth is not None:
            from .truncation.report import left_out_of

            self.left_out = left_out_of(
                self.bandwidth, self.program, self.leaving, self.instants, self.trajectory, self.stretches
            )

    def _doubt(self, rounded: float) -> ToleranceDoubt:
        """Return the warning that steps were accepted with so many tolerances of rounding."""
        text = (
            f"rtol = {self.rtol:g} is below what rounding leaves: steps were accepted with {rounded:.2g} tolerances of rounding; "
            f"rtol = {self.rtol * rounded:.1g} is about the tightest that can be held"
        )
        return ToleranceDoubt(float(self.instants[0]), "", "tolerance below rounding", text, (), "")

    def end(self, until: float) -> Checkpoint | None:
        """Return the checkpoint at the end of this phase, from which another run can go on; None if no step was accepted."""
        kept, program = self.trajectory.kept, self.program
        if kept is None:
            return None
        stored, peaks = self.choice.stored(kept.time, kept.state, kept.mode)
        count = len(program.states.names)
        names = program.variables.names
        hybrid = program.hybrid
        return Checkpoint(
            self.compilation.facts.identity, dict(zip(program.parameters.names, self.parameters.tolist(), strict=True)),
            kept.time, until, stored, peaks, dict(zip(program.unknowns.names, kept.state[count:].tolist(), strict=True)),
            dict(self.known) if self.used is None else dict(zip(names, self.used.tolist(), strict=True)), self._modes(kept.mode),
            tuple((owner, place, on) for (owner, place), on in kept.on.items()), self.off if hybrid is not None else (), self.scene.preferences,
            None if self.history is None else self.history.past(kept.remembered),
        )  # fmt: skip

    def _lossy(self, failed: NotLossless) -> UsageError:
        """Return the error that names the elements that gain or lose energy, where an energy-conserving method was requested."""
        from compiler.api import letters

        ports = self.compilation.state_space.ports
        powers = self._powers(failed.time, failed.state, failed.mode)[: len(ports)]
        by_element: dict[str, float] = {}
        for port, power in zip(ports, powers, strict=True):
            if port.kind not in letters("storage", "transducer"):
                by_element[port.element] = by_element.get(port.element, 0.0) + float(power)
        told = sorted(by_element.items(), key=lambda item: -abs(item[1]))[:3]
        names = (
            ", ".join(f"`{name}` takes {power:.6g} W" for name, power in told if power)
            or "a law of its storages or joints does"
        )
        return UsageError(
            "BR718", f"no method keeps the energy of this model: at t = {failed.time:.9g} s it is not lossless ({names});",
            "leave the solver to choose, which holds the tolerance",
        )  # fmt: skip

    @property
    def occurrences(self) -> list[EventRecord]:
        """Records of the events that acted."""
        if self.events is None:
            return []
        notes = self.events.hybrid.events
        acted = [(h.time, notes[i]) for h in self.events.log for i in h.events if not notes[i].sampled]
        return [EventRecord(t, n.words, n.owner, n.span.file_and_line, n.stops) for t, n in acted]

    def _outputs(self) -> Any:
        """Return the outputs, shape (points, outputs)."""
        values = np.empty((len(self.instants), len(self.program.outputs.names)))
        pieces = self.trajectory.pieces or self.stretches
        for stretch in pieces:
            part = self._within(stretch)
            if part.start < part.stop:
                values[part] = self._output(self.instants[part], self.trajectory.states[part], stretch.mode)
        if self.trajectory.handover is not None or not len(self.instants):
            return values
        last = pieces[-1]
        if self.instants[-1] < last.stop:
            return values
        if self.instants[-1] < self.stretches[-1].stop:  # the phase was cut off at a reported instant
            mode = last.mode
        else:
            mode = last.mode if last.start == last.stop else mode_after(self.program, self.constants, last.stop, last)
        final = self.trajectory.states[-1:]
        self.watch.look(self.instants[-1:], mode, lambda times: np.repeat(final, len(times), axis=0))
        values[-1] = self._output(self.instants[-1], self.trajectory.states[-1], mode)
        return values

    def _within(self, stretch: Segment) -> slice:
        """Return the slice of the reported instants that lie in a segment."""
        return slice(*self.instants.searchsorted((stretch.start, stretch.stop)).tolist())

    def _output(self, times: Array | float, states: Array, mode: Array) -> Any:
        return self.program.output(times, states, self.inputs, self.constants, mode)

    def _powers(self, times: Array | float, states: Array, mode: Array) -> Any:
        return self.program.powers(times, states, self.inputs, self.constants, mode)

    def _balance(self) -> EnergyBalance:
        from .monitors.energy import added, energy_balance, held_in, impulse_loss

        stretches = self.trajectory.pieces or self.stretches
        space, first, handover = self.compilation.state_space, stretches[0], self.trajectory.handover
        stop = stretches[-1].stop if handover is None else handover.time
        last = next((s for s in stretches if s.start < stop <= s.stop), stretches[-1])
        before = self._powers(first.start, self.state, first.mode)
        after = self._powers(stop, self.trajectory.final, last.mode)
        work = self.trajectory.work if self.trajectory.work is not None else np.zeros(len(before))
        held, self.held = self.held, held_in(space, after)
        arguments = self._arguments()
        left = [] if self.leaving is None else [self._around(removal) for removal in self.leaving.removals]
        found = energy_balance(space, work, before, after, arguments, self.trajectory.jumps, left)
        own = slice(len(space.ports), len(space.ports) + len(space.stored))  # mechanisms: energy exchanged within
        self._audit(space, found, float(np.abs([before[own], after[own]]).sum()))
        passed = None if held is None else impulse_loss(space, held, before, arguments)
        return found if passed is None else added([passed, found]) or found

    def _around(self, removal: Removal) -> tuple[Any, Any]:
        """Return powers and stored energies, before and after a removal of fast modes."""
        before, after = (self._powers(removal.time, state, removal.mode) for state in (removal.before, removal.after))
        return before, after

    def _audit(self, space: StateSpace, found: EnergyBalance, within: float) -> None:
        """Name the laws that create energy: resistors that deliver power, storages whose work differs from their stored energy."""
        from .monitors.energy import givers, unexplained

        turnover = within + sum(abs(e.supplied) + abs(e.dissipated) + abs(e.stored) for e in found.elements)
        powers = []
        for stretch in self.trajectory.pieces or self.stretches:
            part = self._within(stretch)
            if part.start < part.stop:
                powers.append(self._powers(self.instants[part], self.trajectory.states[part], stretch.mode))
        if powers:
            watts = np.concatenate(powers)
            self.notes += tuple(givers(space, self.instants[: len(watts)], watts, turnover))
        self.notes += tuple(unexplained(found, turnover, self.rtol))

    def _arguments(self) -> dict[int, float]:
        """Return the values of the storages' parameters."""
        from compiler.api import Assignment, evaluate

        space = self.compilation.state_space
        known = dict(zip(self.program.parameters.names, self.parameters, strict=True))
        parameters = [(i, v) for i, v in enumerate(space.variables) if v.role == "parameter"]
        values: dict[Any, float] = {i: known.get(v.name, v.value or 0.0) for i, v in parameters}
        for step in space.steps:
            if isinstance(step, Assignment) and all(isinstance(a, float) or a in values for a in step.arguments):
                values[step.target] = evaluate(step.expression, values.__getitem__)
        return values
