"""State selection in the subset that becomes machine code: see `monitors/state_selection.py`."""

from __future__ import annotations

from compiler.api import Floats, Ints, Record, sized

from .projection.projection import Function


class StateSelection(Record):
    """Dependent storages that might be states instead, and the largest values so far."""

    dependent: Function
    sensitivities: Function
    count: int  # states
    dependent_count: int
    slope_count: int  # 0: none is examined
    rows: Ints  # slope_count
    columns: Ints  # slope_count
    chosen: Ints  # slope_count: 1: these can be exchanged
    slopes: Floats = sized("slopes_room")
    stored: Floats = sized("stored_room")
    peak: Floats  # count + dependent_count
    worst: float


def is_steep(c: StateSelection, time: float, state: Floats, inputs: Floats, constants: Floats, mode: Floats) -> bool:
    """Return True if other states should be integrated from here on, as `Choice.look` does."""
    for i in range(c.count):
        c.stored[i] = state[i]
    c.dependent(time, state, inputs, constants, mode, c.stored[c.count :])
    for i in range(c.count + c.dependent_count):
        c.peak[i] = max(c.peak[i], abs(c.stored[i]))
    c.sensitivities(time, state, inputs, constants, mode, c.slopes)
    for k in range(c.slope_count):
        scale = c.peak[c.count + c.rows[k]]
        if c.chosen[k] != 0 and scale > 0.0 and abs(c.slopes[k]) * c.peak[c.columns[k]] / scale > c.worst:
            return True
    return False
