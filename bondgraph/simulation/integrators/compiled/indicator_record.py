"""Record of the event indicators of a program: machine code, or Python where there is none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array, Program, zeros_of

from ...segments.timeline import mode_size
from ..acceptance.event_indicators import IndicatorWorkspace
from ..acceptance.first_crossing import SUSPICIOUS
from .plain import Plain, functions_of, record_for
from .record_layout import RecordArray

SHARED = "inputs", "constants", "horizon"
# what `evaluate` leaves behind for `look_ahead`
EVALUATED = "time", "until", "state", "mode", "root", "noise", "flows", "rate", "whole", "sought", "moved"


def _room(program: Program, constants: Array) -> dict[str, Any]:
    assert program.hybrid is not None
    conditions, count = program.hybrid.conditions, len(program.states.names)
    of_conditions = {
        name: np.array([getattr(c, own) for c in conditions], dtype=np.int64)
        for name, own in (("places", "position"), ("strict", "strict"), ("steers", "steers"))
    }
    fields = zeros_of(
        IndicatorWorkspace, n=count + len(program.unknowns.names), count=count, root_count=len(conditions)
    )
    more = {"until": np.inf, "mode": np.zeros(mode_size(program, constants)), "bracket": {}, "most_parts": SUSPICIOUS}
    return fields | of_conditions | more


def indicator_record(program: Program, inputs: Array, constants: Array, horizon: float) -> RecordArray | Plain:
    """Return the record of the conditions of a program with these values."""
    given = {"inputs": inputs, "constants": constants, "horizon": horizon}
    native = program.native is not None
    return record_for(IndicatorWorkspace, program, "", lambda: _room(program, constants), given, native)


def interpreted_record(program: Program, of: RecordArray | Plain, functions: dict[str, Callable[..., None]]) -> Plain:
    """Return a record of Python with the hybrid state that another one has evaluated, and with functions that only Python has."""
    constants = of["constants"]
    evaluated = {name: of[name] for name in (*SHARED, *EVALUATED, "magnitude", "said", "floor", "low", "high")}
    room = _room(program, constants)
    return Plain(IndicatorWorkspace, {**functions_of(IndicatorWorkspace, program), **room, **evaluated, **functions})
