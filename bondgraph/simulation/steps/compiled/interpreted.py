"""Source of the compiled steps run as Python, for the loop over steps in `one_by_one.py`: without machine code, and for delays.

It makes the steps only; `one_by_one.py` handles limits, events, work and samples.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Program

from ...segments.timeline import Segment, Signals
from .. import pair
from ..methods import ENERGY, RODAS
from ..radau import StepFailed
from .advance import begin, one_step
from .along import densify
from .between import bring_back, has_steep_states, is_unsure
from .conserving import sample_step
from .factors import Factors, room_for
from .fields import fields_at
from .holding import Held
from .run import FAILURES
from .stepper import Stepper

if TYPE_CHECKING:
    from ...segments.trajectory import Tolerances

OF_STATES = ("derivative", "entries", "holds", "dependent", "sensitivities", "powers")


class Interpreted:
    """Steps of all methods except Radau over one segment, with the interface of `radau.Radau`."""

    def __init__(
        self, program: Program, inputs: Any, constants: Any, tolerances: Tolerances, stretch: Segment, state: Any, longest: float,
        signals: Signals, method: int, size: float = np.inf,
    ) -> None:  # fmt: skip
        values = fields_at(program, inputs, constants, tolerances, stretch, state, longest, signals, method)
        values |= {name: _into(values[name]) for name in OF_STATES} | {"signals": _of_time(values["signals"])}
        if program.bends is not None:
            values["bends"] = _into(program.bends)
        if program.stored_energy is not None:
            values["stored_energy"] = _into(program.stored_energy)
        values |= {"closed": _open(), "redundant": 0, "pattern": None, "stop": float(stretch.stop)}
        if method == RODAS and values["sparse"]:  # no order of pivots is computed here
            values |= {"sparse": 0, "real": room_for(Factors, values["n"])}
        self.record = Stepper(**values)
        begin(self.record)
        if size < np.inf:
            self.record.size = size

    def step(self) -> None:
        """Make one accepted step. Raises `StepFailed`."""
        failed = one_step(self.record)
        if failed:
            raise StepFailed(FAILURES[failed])

    def put_mode(self, mode: Any) -> None:
        """Set the mode from now on."""
        self.record.mode[:] = mode  # type: ignore[index]

    def begin_with(self, size: float) -> None:
        """Limit the next step to this size."""
        self.record.size = size

    def hold_to(self, absolute: Any) -> None:
        """Set the absolute tolerances from now on."""
        self.record.absolute[:] = absolute  # type: ignore[index]

    @property
    def is_stiff(self) -> bool:
        """True if stability limits the last steps."""
        return self.record.held_by_stability >= pair.OFTEN

    @property
    def finished(self) -> bool:
        """True if the end is reached."""
        return self.record.time >= self.record.stop

    @property
    def time(self) -> float:
        """Current time."""
        return self.record.time

    @property
    def state(self) -> Any:
        """Current scaled states."""
        return self.record.state

    @property
    def error(self) -> Any:
        """Error of the last step, in units of its tolerance."""
        return self.record.error

    @property
    def last_step(self) -> tuple[float, float]:
        """Start and end of the last step."""
        times, count = self.record.end_time, self.record.ends
        return float(times[count - 2]), float(times[count - 1])

    parts = pair.PARTS

    @property
    def inner(self) -> tuple[float, ...]:
        """Fractions of a step at which the limits of a model are checked."""
        return pair.INNER

    @property
    def evaluations(self) -> dict[str, int]:
        """Number of evaluations, by kind."""
        record = self.record
        return {"derivative": record.derivatives, "jacobian": record.jacobians, "factorisation": record.factorisations}

    def sample(self, times: Any) -> Any:
        """Return states at instants within the last step; shape (times, n)."""
        record = self.record
        if record.method == ENERGY:
            found = np.empty((len(times), record.n))
            for time, row in zip(np.asarray(times).tolist(), found, strict=True):
                sample_step(record, time, row)
            return found
        if not record.dense_known:
            densify(record)
        rows, states = (np.asarray(a).reshape(-1, record.n) for a in (record.dense, record.end_state))
        return pair.polynomial(rows, states[record.ends - 2], *self.last_step, times)

    def settled(self, times: Any) -> Any:
        """Return states at reported instants, with stiff states corrected by their equations: see `within.sample`."""
        record, found = self.record, self.sample(times)
        if has_steep_states(record):
            for time, row in zip(np.asarray(times).tolist(), found, strict=True):
                if time < record.time and is_unsure(record, time):
                    row *= record.magnitude
                    bring_back(record, time, row)
                    row /= record.magnitude
        return found

    collocation = sample  # integrals along the step agree with its states to the order of its polynomial


def sampled(solver: Any, times: Any) -> Any:
    """Return states within the last step of the energy-conserving method, from the data of its machine code."""
    names = (
        "n",
        "ends",
        "end_time",
        "end_state",
        "magnitude",
        "slope",
        "inputs",
        "constants",
        "mode",
        "energy",
        "peak",
    )
    known = SimpleNamespace(**{name: getattr(solver, name) for name in names})
    known.dense_known, known.dense = 0, np.zeros(7 * known.n)
    known.si, known.energies = np.zeros(known.n), np.zeros(1 + known.n)
    known.stored_energy = _into(solver.program.stored_energy)
    found = np.empty((len(times), known.n))
    for time, row in zip(np.asarray(times).tolist(), found, strict=True):
        sample_step(known, time, row)  # type: ignore[arg-type]
    return found


def _into(function: Callable[..., Any]) -> Callable[..., None]:
    """Wrap a function of a program for the call by the steps: values go into an argument."""

    def call(time: float, state: Any, inputs: Any, constants: Any, mode: Any, out: Any) -> None:
        found = function(time, state, inputs, constants, mode)
        out[: len(found)] = found

    return call


def _of_time(function: Callable[..., Any]) -> Callable[..., None]:
    def call(time: float, state: Any, inputs: Any, constants: Any, mode: Any, out: Any) -> None:
        found = function(time, inputs, constants, mode)
        out[: len(found)] = found

    return call


def _open() -> Held:
    """Return an empty `Held`: no constraints."""
    held = object.__new__(Held)
    held.gaps = held.multipliers = 0
    return held
