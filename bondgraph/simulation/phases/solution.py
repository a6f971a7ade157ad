"""Solution of a phase: states at the reported instants, with the outputs, the powers and the energy balance that follow from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import dataclass

from ...quantities import listed
from ...results.records import EnergyBalance
from ..constraints.constraints import Constraints
from ..monitors.validity import ValidityMonitor
from ..segments.timeline import Segment, mode_after
from ..segments.trajectory import Trajectory

if TYPE_CHECKING:
    from compiler.api import Array, StateSpace

    from ..truncation.mode_truncation import Removal


MANY_CHANGES = 8  # of the mode, from which on one call for all instants is faster than one for each mode


@dataclass(frozen=True, slots=True)
class PhaseSolution:
    """Trajectory of a phase at its reported instants. `constraints`: with the program and its values; `planned`: the segments of the phase."""

    constraints: Constraints
    instants: Any
    trajectory: Trajectory
    planned: Sequence[Segment]

    @property
    def segments(self) -> Sequence[Segment]:
        """Segments with their modes, as they were integrated."""
        return self.trajectory.pieces or self.planned

    @property
    def reaches_end(self) -> bool:
        """True if the last instant is the end of the last segment: its mode is that just after it, which no segment has."""
        return (
            self.trajectory.handover is None
            and len(self.instants) > 0
            and not self.instants[-1] < self.segments[-1].stop
        )

    def modes(self) -> list[tuple[Any, int, int]]:
        """Return successive modes of the reported instants, each with the first and the end of their indices."""
        modes, ends = [s.mode for s in self.segments], [s.stop for s in self.segments]
        places = self.instants.searchsorted((self.segments[0].start, *ends)).tolist()
        if self.reaches_end:
            modes.append(self._mode_at_end(self.segments[-1]))
            places.append(len(self.instants))
        keys = [mode.tobytes() for mode in modes]  # events return to a mode
        last = [k for k, (key, after) in enumerate(zip(keys, [*keys[1:], None], strict=True)) if key != after]
        return [(modes[k], places[k0 + 1], places[k + 1]) for k0, k in zip([-1, *last], last, strict=False)]

    def outputs(self, modes: Sequence[tuple[Any, int, int]], watch: ValidityMonitor) -> Any:
        """Return the outputs in their `modes`, shape (points, outputs). `watch` looks at the last instant."""
        instants, states = self.instants, self.trajectory.states
        values = np.empty((len(instants), len(self.constraints.program.outputs.names)))
        if self.reaches_end:
            watch.look(instants[-1:], modes[-1][0], lambda times: np.repeat(states[-1:], len(times), axis=0))
        if self.constraints.program.native is not None and len(modes) > MANY_CHANGES:
            of_each = np.repeat([mode for mode, _, _ in modes], [end - begin for _, begin, end in modes], axis=0)
            modes = [(of_each, modes[0][1], modes[-1][2])]
        for mode, begin, end in modes:
            if begin < end:
                values[begin:end] = self.output(instants[begin:end], states[begin:end], mode)
        return values

    def _mode_at_end(self, last: Segment) -> Any:
        """Return the mode of the last instant, which no segment has."""
        if self.instants[-1] < self.planned[-1].stop or last.start == last.stop:  # first: cut off at a reported one
            return last.mode
        return mode_after(self.constraints.program, self.constraints.constants, last.stop, last)

    def output(self, times: Array | float, states: Array, mode: Array) -> Any:
        """Return the outputs at instants."""
        return self.constraints.program.output(times, states, self.constraints.inputs, self.constraints.constants, mode)

    def powers(self, times: Array | float, states: Array, mode: Array) -> Any:
        """Return the powers at all ports, and the stored quantities."""
        return self.constraints.program.powers(times, states, self.constraints.inputs, self.constraints.constants, mode)

    def reported_powers(self) -> list[Any]:
        """Return the powers at the reported instants, segment by segment."""
        instants, states = self.instants, self.trajectory.states
        ends = ((segment, instants.searchsorted((segment.start, segment.stop)).tolist()) for segment in self.segments)
        return [self.powers(instants[i:j], states[i:j], segment.mode) for segment, (i, j) in ends if i < j]


@dataclass(frozen=True, slots=True)
class PhaseEnergy:
    """Energy balance of a phase, what it holds at its end, and notes on laws that create energy."""

    balance: EnergyBalance
    held: Mapping[str, Any]
    notes: tuple[str, ...]


def phase_energy(
    solution: PhaseSolution, space: StateSpace, start: Array, removals: Sequence[Removal], held: Mapping[str, Any] | None, rtol: float
) -> PhaseEnergy:  # fmt: skip
    """Return the energies of a phase. `start`: its first state; `removals`: of fast modes; `held`: stored quantities at the end of the phase before."""
    from ..monitors.energy import added, energy_balance, held_in, impulse_loss

    trajectory, segments = solution.trajectory, solution.segments
    first, stop = segments[0], segments[-1].stop if trajectory.handover is None else trajectory.handover.time
    last = next((s for s in segments if s.start < stop <= s.stop), segments[-1])
    before = solution.powers(first.start, start, first.mode)
    after = solution.powers(stop, trajectory.final, last.mode)
    work = trajectory.work if trajectory.work is not None else np.zeros(len(before))
    arguments = _arguments(solution.constraints, space)
    left = [(solution.powers(r.time, r.before, r.mode), solution.powers(r.time, r.after, r.mode)) for r in removals]
    balance = energy_balance(space, work, before, after, arguments, trajectory.jumps, left)
    own = slice(len(space.ports), len(space.ports) + len(space.stored))  # mechanisms: energy exchanged within
    notes = _audit(solution, space, balance, float(np.abs([before[own], after[own]]).sum()), rtol)
    passed = None if held is None else impulse_loss(space, held, before, arguments)
    whole = balance if passed is None else added([passed, balance]) or balance
    return PhaseEnergy(whole, held_in(space, after), notes)


def _audit(
    solution: PhaseSolution, space: StateSpace, balance: EnergyBalance, within: float, rtol: float
) -> tuple[str, ...]:
    """Name the laws that create energy: resistors that deliver power, storages whose work differs from their stored energy."""
    from ..monitors.energy import givers, unbalanced, unexplained

    turnover = within + sum(abs(e.supplied) + abs(e.dissipated) + abs(e.stored) for e in balance.elements)
    notes, powers = unexplained(balance, turnover, rtol), solution.reported_powers()
    if powers:
        watts = np.concatenate(powers)
        notes = givers(space, solution.instants[: len(watts)], watts, turnover) + notes
    others = unbalanced(space)
    if others:
        notes.append(f"effort times flow is no power at {listed(others)}: the energy balance leaves that out")
    return tuple(notes)


def _arguments(constraints: Constraints, space: StateSpace) -> dict[int, float]:
    """Return the values of the storages' parameters."""
    from compiler.api import Assignment, evaluate

    known = dict(zip(constraints.program.parameters.names, constraints.parameters, strict=True))
    parameters = [(i, v) for i, v in enumerate(space.variables) if v.role == "parameter"]
    values: dict[Any, float] = {i: known.get(v.name, v.value or 0.0) for i, v in parameters}
    for step in space.steps:
        if isinstance(step, Assignment) and all(isinstance(a, float) or a in values for a in step.arguments):
            values[step.target] = evaluate(step.expression, values.__getitem__)
    return values
