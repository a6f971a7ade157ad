"""Runs `advance.advance` as machine code, in the place of the loop over steps in `one_by_one.py`.

What a step looks at besides (limits, other choices of states, work) happens in there too; the code comes back where Python must decide, and every
some tens of milliseconds, so that a run can be interrupted.
"""

from __future__ import annotations

import ctypes
import time as clock
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ....door import INTS, Fields, Handed, MachineCode, Program, Record, record_of
from ....native import kernel
from ...segments import Segment, Signals, inside
from ...watch.choice import Choice
from .. import pair, radau
from ..methods import ENERGY, EXPLICIT, RADAU
from ..radau import Radau, StepFailed
from .advance import LOOK, MORE, advance, begin
from .coarse import coarse
from .euler import euler
from .fields import fields_at, signal_fields
from .flipping import roots_along, states_along
from .holding import hold_all, least_all, rates_all
from .ordering import ordered
from .sparse import Pattern
from .step import ERROR, NEWTON, ORDER, ROUND_OFF
from .stepper import Stepper

if TYPE_CHECKING:
    from ...trajectory import Tolerances
    from .held import CompiledConstraints, NothingHeld

AT_ONCE = 0.05  # s that machine code runs before Python may be interrupted
OFTEN = ("state", "end_time", "end_state", "error", "greatest", "left")  # what is asked for again and again
FAILURES = {NEWTON: "newton", ERROR: "error", ROUND_OFF: "round-off"}
OPTIMISED = 2
_ALONG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)
_WHOLE, _DOUBLE = np.dtype(np.int64), np.dtype(float)
SMALL = 1e-3  # pivots beside what they divide, below which another order is chosen


def obstacle(program: Program) -> str:
    """Why the steps of this program are not made in machine code; empty if they are."""
    if program.native is None:
        return "no machine code"
    if program.invariants.names and (program.solved is None) != ("solved" not in program.native.addresses):
        return "closed loops are held on their constraints"
    return ""


@lru_cache
def machine_code() -> MachineCode:
    """The code of the solver, for all models."""

    def text() -> str:
        from ....door import translate

        return translate([begin, advance, euler, coarse, hold_all, least_all, rates_all, roots_along, states_along])

    return MachineCode(kernel("stepping", text, OPTIMISED))


def addresses_of(program: Program) -> Mapping[str, int]:
    """Where the functions of a program lie."""
    assert program.native is not None
    return program.native.addresses


def structure(noun: type, values: dict[str, Any], addresses: Mapping[str, int]) -> tuple[Any, list[Any]]:
    """A record as machine code sees it, and the arrays that it points to, which also take the places of those in `values`.

    `addresses`: of the functions of a program.
    """
    given: list[Any] = []
    kept: list[Any] = []
    for name, kind in record_of(noun).fields.items():
        if kind in ("double", "i64"):
            given.append(values[name])
            continue
        if isinstance(kind, Fields):
            inner = values[name]
            if isinstance(inner, Record):
                inner, arrays = structure(type(inner), vars(inner), addresses)
                kept += arrays
            given.append(ctypes.addressof(inner))
            kept.append(inner)
            continue
        if isinstance(kind, Handed):
            given.append(addresses.get("jacobian_entries" if name == "entries" else name, 0))
            continue
        array, wanted = values[name], _WHOLE if kind == INTS else _DOUBLE
        if type(array) is not np.ndarray or array.dtype != wanted or not array.flags.c_contiguous:
            array = values[name] = np.ascontiguousarray(array, dtype=wanted)
        kept.append(array)
        given.append(address_of(array))
    return _layout(noun)(*given), kept


def address_of(array: Any) -> int:
    """Where a contiguous array lies; somewhere, if it has no items."""
    if not array.size:
        return 0
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # a fourth of what the way below takes
    except TypeError:  # not to be written
        found: int = array.__array_interface__["data"][0]
        return found


@lru_cache
def _layout(noun: type) -> type[ctypes.Structure]:
    """How a record lies in memory."""
    kinds = {"double": ctypes.c_double, "i64": ctypes.c_int64}
    fields = [(n, kinds.get(k, ctypes.c_void_p) if isinstance(k, str) else ctypes.c_void_p) for n, k in record_of(noun).fields.items()]  # fmt: skip
    return type(noun.__name__, (ctypes.Structure,), {"_fields_": fields})


class Ordered:
    """The pattern of sparse factors, and the choice of another order where the numbers ask for it."""

    def __init__(self, program: Program, small: float) -> None:
        n = len(program.states.names) + len(program.unknowns.names)
        self.pattern, self.program = (*program.pattern, len(program.states.names), n), program
        room = ("diagonal", "scale", "diagonal_re", "diagonal_im", "scale_complex", "x", "xi", "y", "yi")
        self.values: dict[str, Any] = {name: np.zeros(0) for name in record_of(Pattern).fields}
        self.values |= {"n": n, "ready": 0, "small": small, "tolerant": 0} | {name: np.zeros(n) for name in room}
        self.record, _ = structure(Pattern, self.values, {})

    def choose(self, shift: float, entries: Any) -> bool:
        """Choose an order for these numbers; false if there is none."""
        found = ordered(*self.pattern, shift, entries)
        if found is None:
            return False
        kinds = record_of(Pattern).fields
        for name, array in found.items():
            self.values[name] = np.ascontiguousarray(array, dtype=np.int64 if kinds[name] == INTS else float)
            setattr(self.record, name, self.values[name].ctypes.data)
        for name in ("x", "xi"):
            self.values[name][:] = 0.0
        self.record.ready = 1
        return True


@lru_cache
def _no_pattern() -> Any:
    """In the place of one where factors are dense."""
    values: dict[str, Any] = {name: np.zeros(0) for name in record_of(Pattern).fields}
    return structure(Pattern, values | {"n": 0, "ready": 0, "small": SMALL, "tolerant": 0}, {})[0]


@lru_cache
def _along(name: str) -> Any:
    """A function that looks at several instants of the last step."""
    return _ALONG(machine_code().address(name))


class CompiledRadau:
    """Steps over one stretch; answers what `one_by_one.py` asks of `radau.Radau`."""

    def __init__(
        self, program: Program, inputs: Any, constants: Any, tolerances: Tolerances, stretch: Segment, state: Any, longest: float,
        constraints: CompiledConstraints | NothingHeld, signals: Signals, method: int = RADAU,
    ) -> None:  # fmt: skip
        self.program, self.constraints = program, constraints
        self.values = fields_at(program, inputs, constants, tolerances, stretch, state, longest, signals, method)
        self.values |= {"closed": constraints.record, "redundant": int(constraints.redundant)}
        self.code = machine_code()
        self.order = Ordered(program, SMALL) if self.values["sparse"] else None
        self.fixed_size: float | None = None  # of all steps, for a method that wants that
        self.values["pattern"] = _no_pattern() if self.order is None else self.order.record
        self._kept: list[Any] = []
        self._mode: Any = None  # that was put last
        self._record: Any = None

    def report(self, instants: Any, position: int, states: Any) -> None:
        """Where states at instants go, from the number `position` on."""
        self.values |= {"instants": instants, "instant_count": len(instants), "position": position, "reported": states}

    def choose(self, choice: Choice) -> None:
        """Stop where other states should go on."""
        if self._record is not None:
            self.values["stored_peak"] = choice.peak
            self._record.stored_peak = address_of(choice.peak)
            return
        count = len(choice.rows)
        self.values |= {
            "slope_count": len(choice.chosen) if count else 0, "slope_rows": self.program.sensitivity_pattern[0],
            "slope_columns": self.program.sensitivity_pattern[1], "slope_chosen": choice.chosen.astype(np.int64),
            "slopes": np.zeros(len(choice.chosen)), "stored_peak": choice.peak,
        }  # fmt: skip

    def measure(self, work: Any, traffic: float) -> None:
        """Add up the work at all ports, on top of this."""
        count = len(work)
        self.values |= {"power_count": count, "work": work, "traffic": traffic}
        self.values |= {"power": np.zeros(count), "partial": np.zeros(2 * count)}

    def begin(self) -> None:
        """Evaluate where the stretch begins."""
        self.put_mode(self.values["mode"])
        self._record, self._kept = structure(Stepper, self.values, addresses_of(self.program))
        self._here = ctypes.addressof(self._record)
        self.__dict__ |= {name: self.values[name] for name in OFTEN}
        self._begin = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(self.code.address("begin"))
        self._begin(self._here)
        if self.fixed_size is not None:
            self._record.size = self.fixed_size
        self._advance = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)(self.code.address("advance"))

    def begin_at(self, stretch: Segment, state: Any, signals: Signals, method: int, automatic: int) -> None:
        """Go on with another stretch, or behind an event, as one that is made anew would."""
        record, values = self._record, self.values
        scaled = state / values["magnitude"]
        values["state"][:], values["absolute"][:], values["greatest"][:] = scaled, values["resting"], 0.0
        values["peak"][:] = np.maximum(np.abs(scaled), 1.0)
        self.put_mode(stretch.mode)
        for name, value in signal_fields(signals, stretch.start).items():
            if isinstance(value, np.ndarray):
                values[name] = value
                value = address_of(value)
            setattr(record, name, value)
        record.time, record.stop, record.until = stretch.start, stretch.stop, stretch.stop
        record.earliest, record.latest = inside(stretch)
        record.method, record.automatic = method, automatic
        record.fastest, record.since_looked, record.held_by_stability, record.free_steps = 0.0, pair.LOOK_AGAIN, 0, 0
        for name in ("steps", "rejected", "derivatives", "jacobians", "factorisations", "negative"):
            setattr(record, name, 0)
        values["error"][:] = 0.0
        self._forget()

    def doubt(self, floor: Any) -> None:
        """Roots of conditions that are nearer to zero than this are rounding."""
        if floor is not None:
            self.values["root_floor"][:] = floor

    def end_at(self, time: float) -> None:
        """An event ends the last step: what is still to be done with it goes as far as that."""
        self._record.until = time

    def put_mode(self, mode: Any) -> None:
        """Conditions and what only events change are like this from now on."""
        self._mode = mode
        self.values["mode"][:] = mode
        self.constraints.put_mode(mode)
        hybrid = self.program.hybrid
        if hybrid is not None:
            self.values["root_said"][:] = [mode[c.position] == 1.0 for c in hybrid.conditions]

    def begin_again(self, time: float, state: Any, size: float) -> None:
        """Go on from elsewhere, with a first step that is not longer than this."""
        record, values = self._record, self.values
        values["state"][:], values["absolute"][:] = state / values["magnitude"], values["resting"]
        record.time = time
        self._forget()
        record.size = min(size, record.stop - time)

    def go_on_with(self, method: int) -> None:
        """Another method goes on from here."""
        self._record.method, self._record.automatic = method, 0
        self._forget()

    def _forget(self) -> None:
        """What steps remember of each other is forgotten."""
        record = self._record
        for name in ("ends", "known", "current", "factorised", "first_sloped", "node_count", "pending"):
            setattr(record, name, 0)
        record.last_size = record.last_error = record.contraction = 0.0
        self._begin(self._here)

    def went_on(self, position: int, work: Any, traffic: float) -> Any:
        """What was reported and added up meanwhile; the array in which work goes on to be added up."""
        self._record.position, self._record.traffic = position, traffic
        if work is not None:
            self.values["work"][:] = work
        return None if work is None else self.values["work"]

    def note_tried(self, ahead: float) -> None:
        """A pose could not be crossed from so far before it."""
        self._record.tried = ahead

    def advance(self, most: int) -> int:
        """Up to `most` steps; what stopped it, one of the numbers of `advance.py`. Raises `StepFailed`."""
        answer: int = self._advance(self._here, most)
        while answer == ORDER:
            assert self.order is not None
            # With an order that was made for just these numbers, small pivots are what there is.
            if self.order.choose(radau.MU_REAL / self.factorised_size, self.jacobian):
                self.order.record.tolerant = 1
                answer = self._advance(self._here, 1)
            else:
                answer = NEWTON
            self.order.record.tolerant = 0
        if answer in FAILURES:
            raise StepFailed(FAILURES[answer])
        return answer

    @property
    def record(self) -> Any:
        """What machine code works on: single numbers are there."""
        return self._record

    def step(self) -> None:
        """One step. Raises `StepFailed`."""
        self.advance(1)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in record_of(Stepper).fields:
            raise AttributeError(name)
        array = self.values[name]
        return array if isinstance(array, np.ndarray) else getattr(self._record, name)

    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return bool(self.time >= self.stop)

    @property
    def last_step(self) -> tuple[float, float]:
        """Its start and its end."""
        count = self._record.ends
        return float(self.end_time[count - 2]), float(self.end_time[count - 1])

    @property
    def evaluations(self) -> dict[str, int]:
        """How often what was evaluated."""
        record = self._record
        return {"derivative": record.derivatives, "jacobian": record.jacobians, "factorisation": record.factorisations}

    @property
    def inner(self) -> tuple[float, ...]:
        """The places of a step where the limits of a model are looked at."""
        return radau.INNER if self.method == RADAU else pair.INNER

    def sample(self, times: Any) -> Any:
        """States at instants within the last step; shape (times, n). As `Radau.sample`."""
        if self.method == ENERGY:
            return self._interpreted(times)
        if self.method == EXPLICIT:
            before = self.end_state.reshape(3, self.n)[self.ends - 2]
            return pair.polynomial(self.dense.reshape(7, self.n), before, *self.last_step, times)
        return self._reference().sample(times)

    def roots(self, times: Any, mode: Any) -> Any:
        """The roots of the conditions at instants within the last step, under a mode; shape (times, conditions)."""
        return self._all("roots_along", times, mode, self._record.root_count)

    def states(self, times: Any, mode: Any) -> Any:
        """The states in SI there, with the multipliers that belong to them; shape (times, n)."""
        return self._all("states_along", times, mode, self._record.n)

    def _all(self, name: str, times: Any, mode: Any, width: int) -> Any:
        if mode is not self._mode:
            self.put_mode(mode)
        times = np.ascontiguousarray(times, dtype=float)
        out = np.empty((len(times), width))
        there, here = address_of(times), address_of(out)
        _along(name)(self._here, len(times), there, here)
        return out

    def _interpreted(self, times: Any) -> Any:
        """The last step, told to the source as Python."""
        from .interpreted import sampled

        return sampled(self, times)

    def _reference(self) -> Radau:
        """The last step, told to the reference: it has the ends, the stages and the tolerances."""
        from ..ends import End
        from ..radau import Problem

        n, count = self.n, self.ends
        known = [count < 3 or bool(self.first_sloped) or k > 0 for k in range(count)]
        known[0] = known[0] and count == 3
        states, slopes = self.end_state.reshape(3, n), self.end_slope.reshape(3, n)
        radau = object.__new__(Radau)
        radau._ends = [End(float(self.end_time[k]), states[k], slopes[k] if known[k] else None) for k in range(count)]
        radau._stages = self.stages.reshape(3, n)
        nothing: Any = None
        radau.problem = Problem(nothing, nothing, nothing, nothing, self.relative, self.absolute, nothing)
        return radau


def steps(solver: CompiledRadau, look: Callable[[], list[int]], most: int, pause: float = np.inf) -> int:
    """Go on to the end of the stretch, or to where other states should go on or a singular pose is near: which of them, as in `advance.py`.
    `MORE` after `pause` steps of the stretch.

    `look` looks at the limits of the model in the last step, and tells which of them are left. Raises `StepFailed`.
    """
    several, answer, record = 64, MORE, solver.record
    while answer == LOOK or (answer == MORE and record.steps < pause):
        if record.steps >= most:
            raise StepFailed("steps")
        began = clock.perf_counter()
        answer = solver.advance(max(1, int(min(several, most - record.steps, pause - record.steps))))
        if answer == LOOK:
            solver.left[look()] = 1
        elif clock.perf_counter() - began < AT_ONCE:
            several = min(2 * several, 1 << 20)
        else:
            several = max(1, several // 2)
    return answer
