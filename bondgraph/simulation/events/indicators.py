"""Event indicators of a program: their rounding, and the truth of the conditions at and just after an instant.

The truth of a condition *just after* an instant counts: where its root is zero to rounding, the flow that follows decides the side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from compiler.api import Array, Hybrid, rounding_of

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..constraints.constraints import Constraints
from ..integrators.acceptance.event_indicators import NOISE, SLOWLY
from ..integrators.compiled.indicator_record import indicator_record, interpreted_record
from ..integrators.compiled.record_layout import RecordArray

if TYPE_CHECKING:
    from ..segments.units import CoSimulatedUnits

CERTAIN = 4.0  # in units of the bound on the rounding of its terms: a larger root is none
SOLVED = 2.0  # in units of the rounding of a root: error of solved loops
UNMEASURED = 0.25  # of the rounding of a root: as `decide` has it, where nothing was known when the mode was decided
Flow = tuple[Any, float] | None  # rates, and the time in which they move a state by its magnitude; None without rates


@dataclass(slots=True)
class HybridState:
    """Hybrid state of a run: time, state and mode."""

    time: float
    state: Any
    mode: Any


def junctions_off(hybrid: Hybrid, at: HybridState, inputs: Array, constants: Array) -> tuple[str, ...]:
    """Return the switched junctions that are off."""
    active = hybrid.actives(at.time, at.state, inputs, constants, at.mode).tolist()
    return tuple([name for (name, _), on in zip(hybrid.junctions, active, strict=True) if on != 1.0])


@dataclass(eq=False)
class EventIndicators:
    """Conditions of a program in a run, with its inputs and parameters. `magnitude`: of states and unknowns, 0 where it is not known."""

    constraints: Constraints  # constraints of the program, with the program itself
    magnitude: Any
    horizon: float  # length of the run, s
    units: CoSimulatedUnits | None = None  # imported ones, in a run

    def __post_init__(self) -> None:
        self.program, self.inputs = self.constraints.program, self.constraints.inputs
        self.constants = self.constraints.constants
        hybrid = self.program.hybrid
        assert hybrid is not None
        self.hybrid: Hybrid = hybrid
        self.count = len(self.program.states.names)
        self.record = indicator_record(self.program, self.inputs, self.constants, self.horizon)
        self.measure(self.magnitude)
        self.places = np.array([c.position for c in hybrid.conditions], dtype=int)
        self.counted = list(hybrid.counted)
        self.all_sampled = all(event.sampled for event in hybrid.events)
        self.strict = np.array([c.strict for c in hybrid.conditions], dtype=bool)
        self.all_strict = bool(self.strict.all())
        self.steers = np.array([c.steers for c in hybrid.conditions], dtype=bool)
        self.fresh: Any = None  # the record as it begins, for other phases
        self._forget()

    def _forget(self) -> None:
        """Begin as if nothing had been seen yet."""
        self.floor = np.zeros(len(self.places))  # rounding of roots that were zero at the last instant
        # roots that leave zero more slowly than a look ahead shows at once
        self.slow = np.zeros(len(self.places), dtype=bool)
        self.terms = np.full(len(self.places), np.inf)  # rounding of their terms, where it was asked for last

    def anew(self, magnitude: Array) -> Self:
        """Return the indicators of another phase, which takes over the record."""
        other = object.__new__(type(self))  # as `copy`, of which each phase would feel the time
        other.__dict__.update(self.__dict__)
        if isinstance(other.record, RecordArray) and other.fresh is not None:
            other.record.restore(other.fresh)
        else:
            other.record = indicator_record(self.program, self.inputs, self.constants, self.horizon)
            other.fresh = other.record.saved(()) if isinstance(other.record, RecordArray) else None
        other._forget()
        other.measure(magnitude)
        return other

    def measure(self, magnitude: Array) -> None:
        """Set the magnitudes of states and unknowns."""
        self.magnitude = magnitude
        self.loops = self.constraints.loops(magnitude)
        self.record["magnitude"][: len(magnitude)] = magnitude
        # of the last hybrid state: itself, then its roots, their rounding and its flow
        self.last: tuple[object, tuple[Any, Any, Flow]] | None = None

    def measure_anew(self, magnitude: Array, at: HybridState) -> None:
        """Set better magnitudes, and what counts as rounding of the roots at this hybrid state by them: where nothing was known, a magnitude was 1."""
        if (magnitude == self.magnitude).all() and not self.slow.any():
            return
        before = self.noise(at)
        same = (before.all() and not self.floor.any()) or (magnitude == self.magnitude).all()
        if same and not self.slow.any():
            self.measure(magnitude)
            return
        self.measure(magnitude)
        roots, noise, _ = self.evaluated(at)
        share = np.minimum(noise / nonzero(before), 1.0)
        against = self.truth(roots) != at.mode[self.places]  # the mode was decided, and the root has to leave first
        tolerated = self.tolerated(noise)
        least = np.where(before > 0, np.minimum(self.floor, 2 * np.abs(roots)), UNMEASURED * noise)
        least = np.maximum(np.where(against, least, 0.0), np.where(self.slow, tolerated, 0.0))
        self.floor = np.maximum(share * self.floor, least)

    def tolerated(self, noise: Array) -> Any:
        """Return how far the tolerance of the run moves the roots with these rounding errors; loops beside no states are solved to rounding."""
        return (self.record.record.relative / NOISE if self.program.states.names else SOLVED) * noise

    def with_values(self, constraints: Constraints, magnitude: Array) -> EventIndicators:
        """Return the same conditions for other inputs, parameters and magnitudes: for `guess`, not for a search, whose bounds stay those of the first."""
        found = copy(self)
        found.constraints, found.inputs, found.constants = constraints, constraints.inputs, constraints.constants
        found.record = indicator_record(found.program, found.inputs, found.constants, found.horizon)
        found.record.put({"until": self.record["until"]})
        found.measure(magnitude)
        return found

    def roots(self, time: Array | float, state: Array, mode: Array) -> Any:
        """Return left minus right side of each condition; leading axes as of time and state."""
        return self.hybrid.roots(time, state, self.inputs, self.constants, mode)

    def truth(self, roots: Array) -> Any:
        """Return the truth of the conditions with these roots."""
        below = roots < 0
        return below if self.all_strict else below | ((roots == 0) & ~self.strict)

    def guess(self, at: HybridState) -> Any:
        """Return a mode with the conditions as evaluated at a hybrid state; a root below rounding counts as zero."""
        mode = np.array(at.mode, dtype=float)
        for number in range(len(self.places) + 1):
            roots, noise, _ = self.evaluated(HybridState(at.time, at.state, mode))
            truth = self.truth(np.where(np.abs(roots) <= noise, 0.0, roots))
            if (truth == mode[self.places]).all() and (number or not self.counted):
                break
            mode[self.places] = truth
            self.count_in(HybridState(at.time, at.state, mode))
        return mode

    def count_in(self, at: HybridState) -> None:
        """Put the whole numbers that belong to the conditions of a mode into it."""
        if self.counted:
            at.mode[self.counted] = self.hybrid.counts(at.time, at.state, self.inputs, self.constants, at.mode)

    def triggers(self, at: HybridState) -> Any:
        """Return a mask of the events whose conditions hold; those of samples never do."""
        if self.all_sampled:
            return np.zeros(len(self.hybrid.events), dtype=bool)
        return self.hybrid.triggers(at.time, at.state, self.inputs, self.constants, at.mode) == 1.0

    def actives(self, at: HybridState) -> tuple[str, ...]:
        """Return the switched junctions that are off."""
        return junctions_off(self.hybrid, at, self.inputs, self.constants)

    def solved(self, at: HybridState) -> HybridState:
        """Return a hybrid state on the constraints, with the unknowns of loops that belong to it."""
        held = self.constraints.project(at.time, at.state, at.mode)
        return HybridState(at.time, self.loops.solve(at.time, held, at.mode), at.mode)

    def just_after(self, at: HybridState) -> Any:
        """Return the truth of the conditions just after a hybrid state; where rounding hides it, the flow decides."""
        if not len(self.places):
            return np.zeros(0, dtype=bool)
        self.evaluated(at)
        record = self.record
        for discounted in (False, True):
            if not record.call("doubt"):
                break
            ahead = record
            if self.program.unknowns.names:
                ahead = interpreted_record(self.program, record, {"solve": self._solve})
            with suppress(RunFailed):  # loops may have no solution there
                ahead.call("look_ahead")
            if not record.call("decide") or discounted:
                break
            self._discount_terms(at)
            self.evaluated(at)[1][:] = record["noise"]
        self.floor, self.slow = np.array(record["floor"]), record["sought"] == SLOWLY
        return record["truth"] != 0

    def _solve(self, time: float, state: Array, inputs: Array, constants: Array, mode: Array, out: Array) -> None:
        out[:] = self.loops.solve(time, state, mode)

    def noise(self, at: HybridState) -> Any:
        """Return the rounding error of each root."""
        return self.evaluated(at)[1]

    def rounding_of_terms(self, times: Array, states: Array, mode: Array) -> Any:
        """Return up to which size roots at instants are rounding of terms that cancel, which no magnitude of a state tells, as in a sum of the three
        phases of a star; shape (instants, roots), 0 where it is not known."""
        functions = self.program.time_functions
        assert functions is not None
        given = {"constant": self.constants, "input": self.inputs, "mode": mode}
        bounds = CERTAIN * rounding_of(functions, times, states, self.magnitude, given)
        return np.where(np.isfinite(bounds), bounds, 0.0)

    def _discount_terms(self, at: HybridState) -> None:
        """Let the rounding of the roots that are evaluated contain that of their terms."""
        terms = self.rounding_of_terms(np.array([at.time]), at.state[None, :], at.mode)[0]
        self.record["noise"][:] = np.maximum(self.record["noise"], terms)

    def flow(self, at: HybridState) -> Flow:
        """Return the rates of the states, and the time in which the flow moves a state by its magnitude, or the run's length; None without rates."""
        return self.evaluated(at)[2]

    def evaluated(self, at: HybridState) -> tuple[Any, Any, Flow]:
        """Return the roots, their rounding errors and the flow of a hybrid state; those of the last one are kept."""
        key = at.time, at.state.tobytes(), at.mode.tobytes()
        if self.last is None or self.last[0] != key:
            record = self.record
            record.record.time = at.time
            record["state"][:], record["mode"][:] = at.state, at.mode
            if record.call("evaluate"):
                self._discount_terms(at)
            flow = (np.array(record["rate"][: self.count]), record.record.whole) if record.record.flows else None
            self.last = key, (np.array(record["root"]), np.array(record["noise"]), flow)
        return self.last[1]

    def sizes(self, flow: Flow) -> Any:
        """Return the magnitudes; where one is not known, how far a flow moves the state in its time: a unit of its own would be a size of no meaning."""
        if flow is None or (self.magnitude[: self.count] > 0).all():
            return self.magnitude
        sizes = np.array(self.magnitude)
        sizes[: self.count] = np.where(sizes[: self.count] > 0, sizes[: self.count], flow[1] * np.abs(flow[0]))
        return sizes

    def listed_conditions(self, numbers: Iterable[int]) -> str:
        """Return the conditions with these numbers, and their lines, as words."""
        notes = [self.hybrid.conditions[i] for i in numbers]
        listed = dict.fromkeys(f"`{n.owner}` ({n.span.file_and_line})" for n in notes)
        return f"the condition{'s' * (len(listed) > 1)} in {', '.join(listed)}"


def conditions_of(constraints: Constraints) -> Callable[[float, Array, Array], Any]:
    """Return a function of time, state and mode that returns the mode with the conditions on states as evaluated."""
    indicators = EventIndicators(constraints, np.zeros(len(constraints.magnitude)), 1.0)

    def evaluated(time: float, state: Array, mode: Array) -> Any:
        indicators.measure(np.abs(state))
        return indicators.guess(HybridState(time, state, mode))

    return evaluated
