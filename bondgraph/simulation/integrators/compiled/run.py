"""Steps of a method: runs the loop `advance.advance` as machine code, or as Python where there is none.

The other checks of a step (events, limits, state selection, work) belong to that loop. Machine code returns where Python must decide, and every few
tens of milliseconds, so that a run can be interrupted; Python returns after each step.
"""

from __future__ import annotations

import ctypes
import time as clock
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from compiler.api import Array, Program, address_of, record_of, zeros_of

from ...monitors.state_selection import Choice
from ...segments.timeline import Segment, Signals
from .. import dop853, radau, rodas
from ..linear_algebra.sparse import FINE, Pattern
from ..methods import METHODS, THROUGH_ENDS
from ..outcomes import ABSENT, FAILURES, LOOK, MORE, NEWTON, ORDER
from ..radau import StepFailed
from ..workspace import IntegratorWorkspace
from .code import POINTER, WHOLE, called, link_step
from .fields import UNMEASURED, fields_at, given_at, is_sparse, room_of
from .ordering import DIAGONAL, on_diagonal, ordered, room_in
from .plain import Plain, Unordered, record_for
from .record_layout import RecordArray, form_of
from .selection_record import selection_record

if TYPE_CHECKING:
    from ...segments.trajectory import SegmentContext
    from .constraint_functions import CompiledConstraints

SMALL_MODEL = 64  # states; steps of smaller ones take some microseconds
AT_ONCE = 0.05  # s that machine code runs before Python may be interrupted
OFTEN = ("state", "end_time", "end_state", "error", "greatest", "left", "missed")  # fields that are read often
WRITTEN = "state", "absolute", "peak", "mode"  # given arrays into which machine code writes
KEPT_STEPS, KEPT_NUMBERS = 512, 1 << 20  # most steps, and numbers, that are stored before Python looks at them
SMALL = 1e-3  # ratio of a pivot to the largest number that it divides, below which another order is chosen


def obstacle(program: Program) -> str:
    """Return the reason why the steps of this program are not made in machine code; empty if they are."""
    if program.native is None:
        return "no machine code"
    if program.invariants.names and (program.solved is None) != ("solved" not in program.native.addresses):
        return "closed loops are held on their constraints"
    return ""


Advance = Callable[[int], int]  # most steps -> an answer of `outcomes.py`


class PassedSteps(Protocol):
    """Events that machine code passes, seen from the loop over steps; `record` has the steps of segments that have ended."""

    record: Any

    def advance(self, most: int) -> int:
        """Make steps, through events."""


class Ordered:
    """Pattern of sparse factors, and choice of another order where the numbers need it."""

    def __init__(self, program: Program, small: float) -> None:
        n = len(program.states.names) + len(program.unknowns.names)
        self.pattern = (*program.pattern, len(program.states.names), n)

        def values() -> dict[str, Any]:
            return {name: np.zeros(0) for name in record_of(Pattern).fields} | zeros_of(Pattern, n=n)

        self._kept, self._small = program.kept, small
        self.values = RecordArray(form_of(Pattern, program, "", values), {"small": small})
        self.record = self.values.record

    def choose(self, shift: float, entries: Array) -> bool:
        """Choose an order for these numbers; return False if there is none."""
        if self._on_diagonal(shift, entries):
            return True
        factors = ordered(*self.pattern, shift, entries)
        if factors is None:
            self.record.ready = 0
            return False
        self._take(factors, self._small)
        return True

    def _on_diagonal(self, shift: float, entries: Array) -> bool:
        """Choose the order that depends on the program alone, if its pivots are not small; return True if it is used."""
        key = "order", len(entries), self.pattern[-1]
        if key not in self._kept:
            self._kept[key] = on_diagonal(*self.pattern)
        order = self._kept[key]
        if order is None:
            return False
        self._take(order | room_in(order), DIAGONAL)
        factorise = called("real_factors", WHOLE, POINTER, ctypes.c_double, POINTER)
        fits: bool = factorise(self.values.address, shift, address_of(np.ascontiguousarray(entries))) == FINE
        self.record.small = self._small
        return fits

    def _take(self, found: Mapping[str, Any], small: float) -> None:
        self.values.put(found)
        for name in ("x", "xi"):
            self.values[name][:] = 0.0
        self.record.ready, self.record.small, self.record.tolerant = 1, small, 0


def order_of(program: Program) -> Ordered:
    """Return a new order for sparse factors. Where they are dense no step reads it, so all runs share one."""
    if is_sparse(program):
        return Ordered(program, SMALL)
    shared: Ordered = program.kept.get("no order") or Ordered(program, SMALL)
    program.kept["no order"] = shared
    return shared


class CompiledMethod:
    """Steps of a method over one segment, in machine code if `native`."""

    def __init__(
        self, context: SegmentContext, stretch: Segment, state: Array, longest: float, constraints: CompiledConstraints, signals: Signals, method: int
    ) -> None:  # fmt: skip
        program = context.program
        self.program, self.constraints, self.native = program, constraints, constraints.native
        self.order = order_of(program) if self.native else Unordered(program)
        fields = given_at(context, stretch, state, longest, signals)
        fields |= {"closed": constraints.values, "redundant": int(constraints.redundant), "pattern": self.order.values}

        def room() -> dict[str, Any]:
            at = stretch.start, state, context.inputs, context.constants, stretch.mode
            bends, peaks = (0 if f is None else len(f(*at)) for f in (program.bends, program.peaks))
            return room_of(program, method, len(signals.allowed), bends, peaks)

        self.values = record_for(IntegratorWorkspace, program, method, room, fields, self.native)
        if not self.native:  # Python examines many instants at once
            self.values.put({"root_narrow": 1, "always": int(program.watched)})
        self.fixed_size: float | None = None  # size of all steps, for a method with equal steps
        self._mode: Any = None  # the mode set last
        self._selection: RecordArray | Plain | None = None
        self.record = self.values.record  # it has the scalar fields
        self._advance: Advance = partial(self.values.call, "advance")

    def report(self, instants: Array, position: int, states: Array) -> None:
        """Set the array for states at the reported instants, from the index `position` on."""
        self.values.put(
            {"instants": instants, "instant_count": len(instants), "position": position, "reported": states.reshape(-1)}
        )

    def keep_places(self, places: Array) -> None:
        """Store the states at these fractions of each step, until `kept_steps` takes them."""
        n = self.record.n
        room = len(places) * max(1, min(KEPT_STEPS, KEPT_NUMBERS // (len(places) * max(n, 1))))
        values = {"kept_time": np.zeros(room), "kept_state": np.zeros(room * n)}
        self.values.put({"places": places, "place_count": len(places), "kept": 0, "kept_room": room} | values)

    def kept_steps(self) -> tuple[Any, Any]:
        """Return the instants (steps, places) and states (steps, places, n) in SI that are stored, and forget them."""
        count, width, n = self.record.kept, self.record.place_count, self.record.n
        self.record.kept = 0
        times, states = self.values["kept_time"][:count], self.values["kept_state"][: count * n]
        return times.reshape(-1, width), states.reshape(-1, width, n)

    def choose(self, choice: Choice) -> None:
        """Stop where other states should be integrated."""
        if choice and self._selection is None:
            self._selection = selection_record(choice)
            self.values.put({"selection": self._selection})
        elif self._selection is not None:
            self._selection.put({"peak": choice.peak})

    def measure(self, work: Array, traffic: float) -> None:
        """Add up the work at all ports, starting from these values."""
        room = {"power": np.zeros(len(work)), "partial": np.zeros(2 * len(work))}
        self.values.put({"power_count": len(work), "work": work, "traffic": traffic} | room)

    def begin(self) -> None:
        """Evaluate the rates at the start of the segment."""
        self.put_mode(self.values["mode"])
        self.__dict__ |= {name: self.values[name] for name in OFTEN}
        self.values.call("begin")
        if self.fixed_size is not None:
            self.record.size = self.fixed_size

    def save(self) -> None:
        """Save the workspace as it begins, for `begin_once_more`."""
        assert isinstance(self.values, RecordArray)
        self._saved = self.values.saved(WRITTEN)

    def begin_once_more(self, mode: Array) -> None:
        """Begin the same segment in another run."""
        assert isinstance(self.values, RecordArray)
        self.values.restore(self._saved)
        self.put_mode(mode)

    def begin_at(self, stretch: Segment, state: Array, signals: Signals, method: int, automatic: int) -> None:
        """Go on with another segment, or after an event, as a new solver would."""
        self.put_mode(stretch.mode)
        self.values["si"][:] = state
        self.values.put(fields_at(stretch, signals, method, automatic))
        self.values.call("begin_segment")

    def doubt(self, floor: Array | None) -> None:
        """Set the level below which roots of conditions are rounding."""
        if floor is not None:
            self.values["root_floor"][:] = floor

    def end_at(self, time: float) -> None:
        """End the last step at an event: its remaining processing goes up to this time."""
        self.record.until = time

    def put_mode(self, mode: Array) -> None:
        """Set the conditions and discrete variables from now on."""
        self._mode = mode
        self.values["mode"][:] = mode
        self.constraints.values["mode"][:] = mode
        hybrid = self.program.hybrid
        if hybrid is not None:
            self.values["root_said"][:] = [mode[c.position] == 1.0 for c in hybrid.conditions]

    def begin_again(self, time: float, state: Array, size: float) -> None:
        """Go on from another state, with a first step no longer than this."""
        record, values = self.record, self.values
        values["state"][:], values["absolute"][:] = state / values["magnitude"], values["resting"]
        record.time = time
        values.call("begin")
        record.size = min(size, record.stop - time)

    def repeat(self, size: float) -> None:
        """Repeat the last step, no longer than this."""
        record, values, n = self.record, self.values, self.record.n
        before = record.ends - 2
        record.time = float(values["end_time"][before])
        values["state"][:] = values["end_state"][before * n : (before + 1) * n]
        values.put(UNMEASURED)
        values.call("begin")
        record.size = size

    def go_on_with(self, method: int) -> None:
        """Let another method go on from here."""
        self.record.method, self.record.automatic = method, 0
        self.values.call("begin")

    def went_on(self, position: int, work: Array | None, traffic: float) -> Any:
        """Return the array of accumulated work, after setting position, work and energy turnover reached by other means."""
        self.record.position, self.record.traffic = position, traffic
        if work is not None:
            self.values["work"][:] = work
        return None if work is None else self.values["work"]

    def forget_mode(self) -> None:
        """Put the mode again at its next use: machine code has another one."""
        self._mode = None

    def advance(self, most: int, through: Advance | None = None) -> int:
        """Make up to `most` steps; return the reason for the stop, one of the numbers of `outcomes.py`. `through`: the loop that passes events. Raises
        `StepFailed`."""
        advance = through or self._advance
        answer = advance(most)
        while answer == ABSENT:
            link_step(self.record.method)
            answer = advance(most)
        self.order.record.tolerant = 0
        while answer == ORDER:
            # With an order computed for just these numbers, small pivots are accepted.
            if self.order.choose(self._shift / self.factorised_size, self.jacobian):
                self.order.record.tolerant = 1
                answer = advance(1)
            else:
                answer = NEWTON
            self.order.record.tolerant = 0
        if answer in FAILURES:
            raise StepFailed(FAILURES[answer])
        return answer

    @property
    def _shift(self) -> float:
        """Return the shift of the real matrix, times the step size."""
        return 1 / rodas.GAMMA if METHODS[self.method].word == "rodas" else float(radau.MU_REAL)

    def step(self) -> None:
        """Make one step. Raises `StepFailed`."""
        self.advance(1)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in record_of(IntegratorWorkspace).fields:
            raise AttributeError(name)
        return self.values[name]

    @property
    def finished(self) -> bool:
        """True if the end is reached."""
        return bool(self.time >= self.stop)

    @property
    def last_step(self) -> tuple[float, float]:
        """Start and end of the last step."""
        count = self.record.ends
        return float(self.end_time[count - 2]), float(self.end_time[count - 1])

    @property
    def evaluations(self) -> dict[str, int]:
        """Number of evaluations, by kind."""
        record = self.record
        return {"derivative": record.derivatives, "jacobian": record.jacobians, "factorisation": record.factorisations}

    @property
    def inner(self) -> tuple[float, ...]:
        """Fractions of a step at which the limits of a model are checked."""
        return radau.INNER if THROUGH_ENDS[self.method] else dop853.INNER

    def sample(self, times: Array) -> Any:
        """Return states at instants within the last step; shape (times, n)."""
        return self._along("scaled_along", times, self.record.n)

    def roots(self, times: Array, mode: Array) -> Any:
        """Return the roots of the conditions at instants within the last step, under a mode; shape (times, conditions)."""
        return self._all("roots_along", times, mode, self.record.root_count)

    def states(self, times: Array, mode: Array) -> Any:
        """Return the states in SI there, with the multipliers that belong to them; shape (times, n)."""
        return self._all("states_along", times, mode, self.record.n)

    def narrow(self, indicators: RecordArray | Plain, times: Array, roots: Array, mode: Array) -> int:
        """Call `crossing_search.narrow` for the last step, under a mode."""
        if mode is not self._mode:
            self.put_mode(mode)
        return int(indicators.call("narrow", self.values.address, 0, len(times), times, roots))

    def _all(self, source: str, times: Array, mode: Array, width: int) -> Any:
        if mode is not self._mode:
            self.put_mode(mode)
        return self._along(source, times, width)

    def _along(self, source: str, times: Array, width: int) -> Any:
        times = np.ascontiguousarray(times, dtype=float)
        out = np.empty((len(times), width))
        self.values.call(source, len(times), times, out)
        return out


def steps(
    solver: CompiledMethod,
    look: Callable[[], list[int]],
    most: int,
    pause: float = np.inf,
    passed: PassedSteps | None = None,
) -> int:
    """Step to the end of the segment, or to a change of states or a singular pose; return the reason, a number of `outcomes.py`.

    `MORE` after `pause` steps of the segment, in Python after each step. `look` checks the limits of the model in the last step, and returns the
    violated ones. `passed`: the events that machine code passes, with the steps of segments that they end. Raises `StepFailed`.
    """
    answer, record = MORE, solver.record
    several = 1 if not solver.native else 1024 if record.n <= SMALL_MODEL else 64
    through = None if passed is None else passed.advance
    while answer == LOOK or (answer == MORE and record.steps < pause):
        count = record.steps if passed is None else record.steps + passed.record.steps
        if count >= most:
            raise StepFailed("steps")
        began = clock.perf_counter()
        answer = solver.advance(max(1, int(min(several, most - count, pause - record.steps))), through)
        if answer == LOOK:
            solver.left[look()] = 1
        elif not solver.native:
            break
        elif clock.perf_counter() - began < AT_ONCE:
            several = min(2 * several, 1 << 20)
        else:
            several = max(1, several // 2)
    return answer
