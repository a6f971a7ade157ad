"""Pilot run: one step of it, and its loop, in machine code or as Python where there is none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compiler.api import Array, Program, zeros_of

from ...segments.timeline import mode_size
from ..linear_algebra.factorise import is_large
from ..linear_algebra.factors import Factors
from ..linear_algebra.sparse import ANEW
from ..outcomes import REDUNDANT
from ..pilot.loop import PilotWorkspace
from ..pilot.schedule import MOST_STEPS, Conditions, Progress, StepSchedule, unit_numbers
from ..pilot.step import Euler
from .fields import is_sparse
from .plain import Plain, Unordered, record_for
from .record_layout import RecordArray, RecordLayout, form_of
from .run import Ordered

PACE = "time", "size", "taken", "usual", "smallest", "stop"
SMALL = 0.0  # pivots beside what they divide; scales change from one iteration to the next and say little


def keeps_factors(program: Program) -> bool:
    """Return True if the pilot run of a program reuses factors: one with many states and no loop unknowns."""
    return not program.unknowns.names and is_large(len(program.states.names), len(program.pattern[0]))


def _room(program: Program, constants: Array) -> dict[str, Any]:
    """Return the work arrays of steps, and the data of the program that they need."""
    columns, n, sparse = program.pattern[1], len(program.variables.names), is_sparse(program)
    entries, begins = len(columns), np.append(0, np.bincount(columns, minlength=n).cumsum())
    return zeros_of(
        Euler, n=n, differential=len(program.states.names), entry_count=entries, sparse=int(sparse), keeping=int(keeps_factors(program))
    ) | {
        "mode": np.zeros(mode_size(program, constants)), "kinds": unit_numbers(program), "real": zeros_of(Factors, n=0 if sparse else n),
        "by_column": np.argsort(columns, kind="stable"), "begins": begins,
    }  # fmt: skip


def _room_of_loop(program: Program) -> dict[str, Any]:
    """Return the same for the loop over steps."""
    count = 0 if program.hybrid is None else len(program.hybrid.conditions)
    fields = zeros_of(PilotWorkspace, n=len(program.variables.names), conditions=count, most_steps=MOST_STEPS)
    # Python reads `sparse` to choose its version of the source
    return fields | {"loops": {}, "closed": {}, "selection": {"slope_count": 0}, "sparse": int(is_sparse(program))}


def pilot_forms(program: Program, constants: Array) -> tuple[RecordLayout, RecordLayout]:
    """Return the layouts of the records of steps and of their loop; `constants`: any of the program."""
    steps = form_of(Euler, program, "", lambda: _room(program, constants))
    return steps, form_of(PilotWorkspace, program, "", lambda: _room_of_loop(program))


class CompiledPilotStep:
    """Steps of the pilot run."""

    def __init__(self, program: Program, inputs: Array, constants: Array, smallest: Array) -> None:
        rows, columns = program.pattern
        self.program, native = program, program.native is not None
        self.order = Ordered(program, SMALL) if native else Unordered(program)
        fields = {
            "inputs": inputs, "constants": constants, "rows": rows, "columns": columns, "pattern": self.order.values, "smallest": smallest,
        }  # fmt: skip
        self.values = record_for(Euler, program, "", lambda: _room(program, constants), fields, native)
        self.record = self.values.record


class CompiledPilotRun:
    """Loop over these steps."""

    def __init__(
        self, steps: CompiledPilotStep, motion: tuple[Any, Any, Any] | None, others: Mapping[str, RecordArray | Plain], flags: Mapping[str, bool], most: int
    ) -> None:  # fmt: skip
        """`motion`: amplitudes, inverse and scale of the modes of the free motion from the start, if its reach counts; `others`: records of loops, of
        constraints and of the state selection, if there are any; `flags`: what is made of them; `most`: steps of a call."""
        self.euler, self.most, n = steps, most, steps.record.n
        nothing, ones = np.zeros((0, 0)), np.ones(n)
        shapes, inverse, unit = motion or (nothing, nothing, ones)
        fields = {
            "euler": steps.values, "reaching": int(motion is not None), "amplitudes": shapes.ravel(), "inverse_re": inverse.real.ravel(),
            "inverse_im": inverse.imag.ravel(), "unit": unit, **dict.fromkeys(("state", "far", "until"), ones),
        }  # fmt: skip
        fields |= {**flags, **others}
        self.modes = [record["mode"] for record in (steps.values, others.get("closed")) if record is not None]
        program, native = steps.program, steps.program.native is not None
        self.values = record_for(PilotWorkspace, program, "", lambda: _room_of_loop(program), fields, native)
        self._record = self.values.record

    def observe(self, conditions: Conditions) -> None:
        """Return `CROSSED` from `go` where one of these conditions changes."""
        self._record.root_count = len(conditions.holds)
        self.values["root_said"][:], self.values["root_strict"][:] = conditions.holds, conditions.strict

    def go(self, source: str, run: Progress, pace: StepSchedule, begun: float, mode: Array) -> int:
        """Make steps by a function of the source, and return its answer; `begun`: start of the run. Updates state and magnitudes of `run`, and `pace`."""
        record, values, euler, order = self._record, self.values, self.euler.values, self.euler.order
        values.put({"state": run.state, "far": run.far, "until": run.until.ravel(), "begun": begun, "noted": run.noted})
        euler["largest"][:] = run.largest
        for own in self.modes:
            own[:] = mode
        for name in PACE:
            setattr(record, name, getattr(pace, name))
        record.most_steps = min(MOST_STEPS, pace.taken + self.most)
        order.record.tolerant = 0
        while (answer := values.call(source)) == ANEW:
            if not order.choose(1 / self.euler.record.size, euler["scaled"]):
                record.taken += 1
                record.size *= 0.25
                break
            order.record.tolerant = 1
        pace.time, pace.size, pace.taken = record.time, record.size, record.taken
        run.state = values["state" if answer != REDUNDANT else "found"]  # as it was before it was projected
        run.largest, run.noted = euler["largest"].copy(), record.noted
        return answer
