"""Record of the event indicators of a program: machine code, or Python where there is none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ....numerics.indicators import GRID, PLACES
from ...segments.timeline import mode_size
from ..acceptance.event_indicators import IndicatorWorkspace
from .plain import Plain, functions_of, record_for
from .record_layout import RecordArray

MASKS = "converged", "near", "unsure", "shown", "crosses", "dipping"
SHARED = "inputs", "constants", "horizon"
# what `evaluate` leaves behind for `look_ahead`
EVALUATED = "time", "until", "state", "mode", "root", "noise", "flows", "rate", "whole", "sought", "moved"


def _room(program: Program, constants: Array) -> dict[str, Any]:
    assert program.hybrid is not None
    conditions, count = program.hybrid.conditions, len(program.states.names)
    n, m = count + len(program.unknowns.names), len(conditions)
    numbers: dict[str, Any] = {"n": n, "count": count, "root_count": m}
    numbers |= dict.fromkeys(("time", "whole", "low", "high", "found", "relative"), 0.0)
    numbers |= dict.fromkeys(("flows", "near_count", "unsure_count", "clear_count", "suspect_count"), 0)
    numbers["until"] = np.inf
    arrays = {name: np.zeros(n) for name in ("magnitude", "state", "rate", "later", "slope")}
    arrays |= {name: np.zeros(m) for name in ("root", "noise", "moved", "change", "again", "floor", "seen", "scale", "error", "variation")}  # fmt: skip
    arrays |= {
        name: np.zeros(m, dtype=np.int64)
        for name in ("truth", "sought", "said", "flipping", "behind", "touching", *MASKS)
    }
    arrays |= {"values": np.zeros(PLACES * m), "form": np.zeros(PLACES * m), "grid": np.zeros((GRID + 1) * m)}
    arrays |= {"suspects": np.zeros(PLACES + GRID + 1), "at_place": np.zeros(PLACES, dtype=np.int64)}
    arrays |= {"at_grid": np.zeros(GRID + 1, dtype=np.int64), "dips": np.zeros((GRID + 1) * m, dtype=np.int64)}
    bracket = dict.fromkeys(("a", "at_a", "b", "at_b", "c", "at_c", "share"), 0.0)
    places, strict, steers = (
        np.array([getattr(c, name) for c in conditions], dtype=np.int64) for name in ("position", "strict", "steers")
    )
    return (
        numbers
        | arrays
        | {
            "places": places,
            "strict": strict,
            "steers": steers,
            "mode": np.zeros(mode_size(program, constants)),
            "bracket": bracket,
        }
    )


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
