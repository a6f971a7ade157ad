"""Source of the compiled steps run as Python, for the loop over steps in `interpreted_integrator.py`: without machine code, and for delays.

It makes the steps only; `interpreted_integrator.py` handles limits, events, work and samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from compiler.api import Program

from .. import dop853, ends, radau
from ..methods import CONSERVING, PARTS, THROUGH_ENDS
from ..radau import StepFailed
from .advance import begin, one_step
from .constraint_functions import Invariants, fields_of
from .dop853_dense import densify
from .energy_step import sample_step
from .in_numpy import interpreted
from .plain import Unordered, into
from .projection import ProjectionWorkspace, Square
from .radau_step import FAILURES
from .stepper import IntegratorWorkspace
from .stiff_interpolation import bring_back, has_steep_states, is_unsure

OF_STATES = ("derivative", "entries", "holds", "dependent", "sensitivities", "powers", "bends", "stored_energy")


class Interpreted:
    """Steps of a method over one segment, with the interface of `run.CompiledRadau`."""

    def __init__(self, program: Program, values: dict[str, Any], constraints: Invariants, size: float = np.inf) -> None:
        """`values`: fields of a `IntegratorWorkspace` at the start; `size`: of the first step."""
        values |= {name: into(values[name]) for name in OF_STATES if values[name] is not None}
        values |= {"signals": _of_time(values["signals"]), "stop": float(values["stop"])}
        values |= {
            "closed": _constraints(program, constraints, values),
            "redundant": 0,
            "pattern": Unordered(program).record,
        }
        self.record = IntegratorWorkspace(**values)
        self._run(begin)
        if size < np.inf:
            self.record.size = min(size, self.record.stop - self.record.time)

    def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return interpreted(function, self.record.n, self.record.sparse)(self.record, *arguments)

    def step(self) -> None:
        """Make one accepted step. Raises `StepFailed`."""
        failed = self._run(one_step)
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
        return self.record.held_by_stability >= dop853.OFTEN

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

    @property
    def method(self) -> int:
        """Index of the method."""
        return self.record.method

    @property
    def wish(self) -> float:
        """Size of the next step if nothing else limits it."""
        return self.record.size

    @property
    def parts(self) -> int:
        """Parts of a step that are searched for events separately."""
        parts: int = PARTS[self.method]
        return parts

    @property
    def inner(self) -> tuple[float, ...]:
        """Fractions of a step at which the limits of a model are checked."""
        return radau.INNER if THROUGH_ENDS[self.method] else dop853.INNER

    @property
    def evaluations(self) -> dict[str, int]:
        """Number of evaluations, by kind."""
        record = self.record
        return {"derivative": record.derivatives, "jacobian": record.jacobians, "factorisation": record.factorisations}

    def sample(self, times: Any) -> Any:
        """Return states at instants within the last step; shape (times, n)."""
        record = self.record
        if THROUGH_ENDS[record.method]:
            return ends.sampled(record, times)
        if CONSERVING[record.method]:
            found = np.empty((len(times), record.n))
            for time, row in zip(np.asarray(times).tolist(), found, strict=True):
                sample_step(record, time, row)
            return found
        if not record.dense_known:
            self._run(densify)
        rows, states = (np.asarray(a).reshape(-1, record.n) for a in (record.dense, record.end_state))
        return dop853.polynomial(rows, states[record.ends - 2], *self.last_step, times)

    def settled(self, times: Any) -> Any:
        """Return states at reported instants, with stiff states corrected by their equations: see `dense_output.sample`."""
        record, found = self.record, self.sample(times)
        if self._run(has_steep_states):
            for time, row in zip(np.asarray(times).tolist(), found, strict=True):
                if time < record.time and self._run(is_unsure, time):
                    row *= record.magnitude
                    self._run(bring_back, time, row)
                    row /= record.magnitude
        return found

    def collocation(self, times: Any) -> Any:
        """Return the polynomial of the method: integrals along it agree with its states to its order."""
        return ends.collocation(self.record, times) if THROUGH_ENDS[self.method] else self.sample(times)


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
    known.stored_energy = into(solver.program.stored_energy)
    found = np.empty((len(times), known.n))
    for time, row in zip(np.asarray(times).tolist(), found, strict=True):
        sample_step(known, time, row)  # type: ignore[arg-type]
    return found


def _of_time(function: Callable[..., Any]) -> Callable[..., None]:
    def call(time: float, state: Any, inputs: Any, constants: Any, mode: Any, out: Any) -> None:
        found = function(time, inputs, constants, mode)
        out[: len(found)] = found

    return call


def _constraints(program: Program, constraints: Invariants, values: dict[str, Any]) -> ProjectionWorkspace:
    """Return the constraints as a record; for none, an empty one."""
    if not constraints:
        held = object.__new__(ProjectionWorkspace)
        held.gaps = held.multipliers = 0
        return held
    fields = fields_of(program, values["inputs"], values["constants"], values["magnitude"], constraints.taking)
    fields |= {name: _square(fields[name]) for name in ("positions", "speeds")}
    functions = {"invariant": program.invariant, "invariant_slopes": program.invariant_slopes, "solved": program.solved}
    fields |= {name: None if function is None else into(function) for name, function in functions.items()}
    return ProjectionWorkspace(**fields | {"mode": values["mode"], "place": np.array(fields["place"], dtype=int)})


def _square(fields: Mapping[str, Any]) -> Square:
    return Square(**{name: np.array(value) if isinstance(value, list) else value for name, value in fields.items()})
