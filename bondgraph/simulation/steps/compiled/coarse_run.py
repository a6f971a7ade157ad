"""The coarse run in machine code: one step of it, and its loop."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

from ...segments import mode_size
from ...start.coarse import smallest_angles
from ...start.kept import keeps_factors
from .coarse import Coarse
from .euler import Euler
from .factors import Factors, room_for
from .fields import is_sparse
from .run import Ordered, addresses_of, machine_code, structure
from .sparse import ANEW, FINE

if TYPE_CHECKING:
    from ....door import Program
    from ...start.coarse import Pace
    from ...start.motion import FreeMotion

SMALL = 0.0  # pivots beside what they divide; scales change from one iteration to the next and say little


class CompiledEuler:
    """Steps of the coarse run: `start.coarse.CoarseRun._step` from where the unknowns of loops are known."""

    def __init__(self, program: Program, inputs: Any, constants: Any) -> None:
        rows, columns = program.pattern
        n, differential = len(program.states.names) + len(program.unknowns.names), len(program.states.names)
        self.program = program
        self.values: dict[str, Any] = {
            "inputs": inputs, "constants": constants, "mode": np.zeros(mode_size(program, constants)), "n": n,
            "differential": differential, "entry_count": len(rows), "rows": rows, "columns": columns, "time": 0.0, "size": 0.0,
            "jacobian": np.zeros(len(rows)), "scaled": np.zeros(len(rows)), "sparse": int(is_sparse(program)), "kept": 0.0, "factorised": 0,
            "keeping": int(keeps_factors(program)),
            "real": room_for(Factors, 0 if is_sparse(program) else n),
        } | {name: np.zeros(n) for name in ("largest", "start", "x", "slope", "scale", "reached")}  # fmt: skip
        self.values["smallest"] = smallest_angles(program)
        self.order = Ordered(program, SMALL)
        self.values["pattern"] = self.order.record
        self.record, self._kept = structure(Euler, self.values, addresses_of(program))
        self._here = ctypes.addressof(self.record)
        self.code = machine_code()
        self._step = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(self.code.address("euler"))

    def step(self, start: Any, guess: Any, largest: Any, at: tuple[float, float], mode: Any) -> Any:
        """The state at the end of a step, None if it is not found; `at`: when that is, and how long the step."""
        values, record, order = self.values, self.record, self.order
        record.time, record.size = at
        order.record.tolerant = 0
        while True:
            values["start"][:], values["x"][:], values["largest"][:], values["mode"][:] = start, guess, largest, mode
            answer = self._step(self._here)
            if answer != ANEW:
                return values["x"].copy() if answer == FINE else None
            if order.record.tolerant or not order.choose(1 / at[1], values["scaled"]):
                return None
            order.record.tolerant = 1


class CompiledCoarse:
    """The loop over these steps, for a program whose states are all differential and on no constraints."""

    def __init__(self, euler: CompiledEuler, motion: FreeMotion | None) -> None:
        n = euler.values["n"]
        self.euler = euler
        self.values: dict[str, Any] = {
            "euler": euler.record, "n": n, "time": 0.0, "size": 0.0, "usual": 0.0, "smallest": 0.0, "stop": 0.0, "note": 0.0, "taken": 0,
            "reaching": int(motion is not None),
        } | {name: np.zeros(n) for name in ("state", "found", "modes")}  # fmt: skip
        nothing, ones = np.zeros((0, 0)), np.ones(n)
        shapes, inverse, unit = (
            (nothing, nothing, ones) if motion is None else (motion.amplitudes, motion.inverse, motion.scale)
        )
        self.values |= {
            "amplitudes": shapes.ravel(), "inverse_re": inverse.real.ravel(), "inverse_im": inverse.imag.ravel(), "unit": unit,
        }  # fmt: skip
        self._record, self._kept = structure(Coarse, self.values, addresses_of(euler.program))
        self._run = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(euler.code.address("coarse"))

    def go(self, pace: Pace, note: float, state: Any, largest: Any, mode: Any) -> tuple[Any, Any]:
        """On until `note`, to where Python should look; `pace` is where it is then. The state there and the largest magnitudes."""
        record, values, order = self._record, self.values, self.euler.order
        values["state"][:], self.euler.values["largest"][:], self.euler.values["mode"][:] = state, largest, mode
        for name in ("time", "size", "taken", "usual", "smallest", "stop"):
            setattr(record, name, getattr(pace, name))
        record.note = note
        order.record.tolerant = 0
        while self._run(ctypes.addressof(record)) == ANEW:
            if not order.choose(1 / self.euler.record.size, self.euler.values["scaled"]):
                break
            order.record.tolerant = 1
        pace.time, pace.size, pace.taken = record.time, record.size, record.taken
        return values["state"].copy(), self.euler.values["largest"].copy()
