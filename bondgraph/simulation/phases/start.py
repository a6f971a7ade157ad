"""Start of a phase: consistent, at rest where that is required, and after the events at its first instant; or carried over from the phase before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed
from ..constraints.constraints import Constraints
from ..initialization.consistent_start import consistent_start
from ..segments.timeline import Segment
from ..segments.trajectory import PhaseTransition
from ..segments.units import refuse_units

if TYPE_CHECKING:
    from compiler.api import Array, Plan, Program

    from ...compiled_scene import CompiledScene
    from ..events.complementarity import Companion
    from ..events.events import Events
    from ..events.history import History
    from ..events.impulse import StorageJump

DIVERGED = 1e6  # growth of the change from one iteration to the next after which these do not converge
MOST_SETTLING = 400  # most iterations between delayed signals and an initialization that reads them
SETTLED = 1e-14  # relative change of delayed signals that counts as rounding


def no_rest() -> RunFailed:
    """Return the failure where ideal diodes or switches turn on or off at an equilibrium that was computed in another mode."""
    return RunFailed(
        "BR732", "no equilibrium was found: ideal diodes or switches do not stay as they are where the model would rest;",
        "start it nearer to its rest, or give them resistances",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class StartOfPhase:
    """State with the unknowns of loops, the first segment with its mode, notes, events and jumps of stored quantities.

    `begins_without`, `goes_on_without`: junctions that are off before any event acts, and after those at the start.
    """

    state: Any
    first: Segment
    begins_without: tuple[str, ...]
    goes_on_without: tuple[str, ...]
    notes: tuple[str, ...] = ()
    events: Events | None = None
    jumps: tuple[StorageJump, ...] = ()


@dataclass(frozen=True, slots=True)
class PhaseInitialization:
    """Program of a phase with all that decides its start. `modes`: of the ideal valves; `off`: junctions that are off in the program."""

    compilation: CompiledScene
    constraints: Constraints
    plan: Plan
    off: tuple[str, ...]
    begin: PhaseTransition | None
    companion: Companion | None
    modes: Mapping[str, float]
    before: Events | None = None  # of the last phase of the program in the run

    @property
    def program(self) -> Program:
        """Program of the phase, which reads delayed signals of this run."""
        return self.constraints.program

    def start(self, first: Segment, horizon: float) -> StartOfPhase:
        """Return the start of a phase; `first`: its first segment, `horizon`: length of the run. Raises `RunFailed`."""
        if self.begin is not None:
            again = self.before is not None and not self.program.unknowns.names  # nothing of what is written is read
            return self._continued(self.begin, np.zeros(0) if again else self._written(), first, horizon)
        start = self._consistent(first, horizon)
        return start if self.program.hybrid is None else self._after_events(start, horizon)

    def _written(self) -> Any:
        """Return the start of the program, as the text gives it. Raises `RunFailed`."""
        state = np.asarray(self.program.start(self.constraints.constants), dtype=float)
        if not np.isfinite(state).all():
            bad = [n for n, x in zip(self.program.states.names, state, strict=False) if not np.isfinite(x)]
            raise RunFailed(
                "BR731", f"the start of {', '.join(f'`{b}`' for b in bad)} is not finite: a parameter makes it so"
            )
        return state

    def _continued(self, begin: PhaseTransition, state: Array, first: Segment, horizon: float) -> StartOfPhase:
        """Return the start where the phase before ends. `state`: the start of the program."""
        constraints = self.constraints
        if self.program.hybrid is None:
            from ..events.begin import carried_over

            full = carried_over(constraints, state, first, begin)
            full = constraints.loops().solve(first.start, full, first.mode)
            return StartOfPhase(full, first, self.off, self.off)
        from ..events.begin import continued
        from ..events.impulse import refuse_jumps_of_mechanisms

        events, at, jumps = continued(constraints, state, first, begin, horizon, self.companion, self.before)
        if self.companion is not None and self.companion.valves:
            refuse_jumps_of_mechanisms(jumps, self.compilation.facts.mechanisms, first.start)
        return StartOfPhase(
            at.state, first.up_to(first.start, first.stop, at.mode), self.off, self.off, (), events, jumps
        )

    def _after_events(self, before: StartOfPhase, horizon: float) -> StartOfPhase:
        """Return the start after all events at the first instant."""
        from ..events.begin import begun
        from ..events.indicators import HybridState, junctions_off

        constraints, full, first, hybrid = self.constraints, before.state, before.first, self.program.hybrid
        assert hybrid is not None
        at = HybridState(first.start, full, first.mode)  # before any event acts
        without = junctions_off(hybrid, at, constraints.inputs, constraints.constants)
        if before.events is not None:
            return replace(before, begins_without=without)
        events, at = begun(constraints, full, first, horizon, self.companion)
        goes_on_without = events.actives(at)
        if self.plan.equilibrium and goes_on_without == without:
            _check_rest(events, at.state, full, at.mode, first.mode)
        return StartOfPhase(at.state, replace(first, mode=at.mode), without, goes_on_without, before.notes, events)

    def _consistent(self, first: Segment, horizon: float) -> StartOfPhase:
        """Return the consistent start before any event acts, with the mode that fits it. Raises `RunFailed`."""
        program, constraints, compilation = self.program, self.constraints, self.compilation

        def find() -> tuple[StartOfPhase, Any, Any]:
            segment, state = first, self._written()
            if program.hybrid is not None:
                from ..events.begin import with_mode, with_modes

                segment = with_modes(program, segment, self.modes)
                segment = with_mode(compilation, constraints, state, segment, horizon)
            full, notes = consistent_start(compilation, constraints, state, segment)
            start = StartOfPhase(full, segment, self.off, self.off, notes)
            if self.plan.equilibrium:
                start = self._at_rest(start, horizon)
            return start, constraints.assembled, constraints.taking

        if self.plan.equilibrium and program.hybrid is not None:  # its search prepares the events of this run
            return find()[0]
        key = *first.key, horizon, *sorted(self.modes.items()), self.plan.equilibrium
        start: StartOfPhase
        start, constraints.assembled, taking = constraints.recall("start", key, find)
        if taking.tobytes() != constraints.taking.tobytes():
            constraints.leave_out(taking)
        return StartOfPhase(start.state.copy(), start.first, self.off, self.off, start.notes, start.events)

    def _at_rest(self, start: StartOfPhase, horizon: float) -> StartOfPhase:
        """Return the equilibrium reached from a consistent state, with the mode that holds there. Raises `RunFailed`."""
        from ..equilibrium.conserved import conserved_sums, path_notes, with_sums_kept
        from ..equilibrium.search import equilibrium
        from ..equilibrium.steady import check_steady, steady_rates

        program, constraints, before = self.program, self.constraints, start.state
        refuse_units(program.hybrid)
        sums = conserved_sums(self.compilation, constraints.parameters)
        if program.hybrid is None or self.companion is not None:
            rest = equilibrium(constraints, start.state, start.first, sums)
            start = replace(start, state=with_sums_kept(sums, constraints, start.state, rest, start.first))
        else:
            from ..events.equilibrium import rest_with_events
            from ..events.events import Events

            events = Events(constraints, np.abs(start.state), horizon)
            at = rest_with_events(constraints, start.state, start.first, events, sums)
            start = replace(start, state=at.state, first=replace(start.first, mode=at.mode), events=events)
        first = start.first
        rates = steady_rates(constraints, first.start, start.state, first.mode)
        check_steady(self.compilation, program, rates)
        notes = path_notes(sums, constraints, before, start.state, first)
        return replace(start, notes=(*start.notes, *notes)) if notes else start


def _check_rest(events: Events, state: Array, rest: Array, mode: Array, assumed: Array) -> None:
    """Raise `RunFailed` where ideal diodes or switches turn on or off at an equilibrium that was computed in another mode."""
    changed = np.asarray(mode) != assumed
    changed[events.places[~events.steers]] = False  # those that only events read
    if changed.any() or not np.allclose(state, rest, rtol=1e-9, atol=0.0):
        raise no_rest()


def settled_with_history(
    start: StartOfPhase, history: History, inputs: Array, again: Callable[[], StartOfPhase]
) -> StartOfPhase:
    """Return the start at which the initial state and the delayed signals agree: before it each delayed signal has its value at the start.

    `again`: the start with the signals as they are. Raises `RunFailed` if iterations do not converge.
    """
    time, least = start.first.start, np.inf
    for _ in range(MOST_SETTLING):
        before = np.array(history.first)
        off = history.begin(time, start.state, inputs, start.first.mode)
        change = np.fmax(np.abs(history.first - before), np.abs(off))
        if (change <= SETTLED * np.maximum(np.abs(history.first), np.abs(before))).all():
            return start
        least = min(least, float(change.max()))
        if change.max() > DIVERGED * least:
            break
        start = again()
    raise RunFailed(
        "BR733", f"at t = {time:.9g} s what is delayed and the state at the start do not settle on each other: each makes the other larger, or goes to "
        "and fro;", "give the start itself instead of `equilibrium`, or delay what does not read itself",
    )  # fmt: skip
