"""Record of the state selection for the source of the steps, whose largest values are those of its monitor."""

from __future__ import annotations

from functools import partial
from typing import Any

from compiler.api import Array, zeros_of

from ...monitors.state_selection import WORST, Choice
from ..selection import StateSelection
from .plain import Plain, record_for
from .record_layout import RecordArray, RecordBatch, form_of


def _room(choice: Choice) -> dict[str, Any]:
    program, (rows, columns) = choice.program, choice.program.sensitivity_pattern
    count, dependents = len(program.states.names), len(program.dependents.names)
    sizes = zeros_of(
        StateSelection, count=count, dependent_count=dependents, slopes_room=len(rows), stored_room=count + dependents
    )
    return sizes | {
        "slope_count": len(rows) if choice else 0, "rows": rows, "columns": columns, "chosen": choice.chosen, "worst": WORST,
    }  # fmt: skip


def selection_record(choice: Choice) -> RecordArray | Plain:
    """Return the record of a run."""
    program, key = choice.program, choice.chosen.tobytes()
    given = {"peak": choice.peak}
    return record_for(StateSelection, program, key, partial(_room, choice), given, program.native is not None)


def selection_batch(choice: Choice, peak: Array) -> RecordBatch:
    """Return the records of several runs, with the largest values of each."""
    form = form_of(StateSelection, choice.program, choice.chosen.tobytes(), partial(_room, choice))
    return RecordBatch(form, len(peak), {"peak": peak})
