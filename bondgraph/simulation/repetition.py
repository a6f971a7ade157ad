"""Repetition of a run for `--check`: by a method of another family, with a tenth of the tolerance, in many parts so that events are searched again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import AUTOMATIC, SOLVERS, Array

from ..errors import RunFailed, UsageError
from ..results.run_check import FACTOR, OutputDifference, RunCheck

if TYPE_CHECKING:
    from typing import Any

    from ..results.result import Result
    from .run import RunOptions

PARTS = 61
TIGHTEST = 1e-12
NEAR = 1e-9  # fraction of the run: an instant this near to an event may belong to either side of it


def check_run(result: Result, repeat: Callable[[RunOptions], Result], wanted: RunOptions) -> RunCheck:
    """Compare a finished run with its repetition; `repeat` makes a run of the same model, experiment and settings."""
    rtol = max(result.rtol / 10, TIGHTEST)
    methods = (row.others for row in SOLVERS.values() if row.name and result.solver.startswith(row.name))
    failure = ""
    for solver in next(methods, (AUTOMATIC,)):
        asked = replace(wanted, solver=solver, rtol=rtol, points=len(result.time), energy=False, parts=PARTS)
        try:
            return compare(result, repeat(asked), rtol)
        except UsageError as refused:
            failure = str(refused)
        except RunFailed as failed:
            failure = str(failed)
    return RunCheck("", rtol, PARTS, (), (len(result.events), 0), math.nan, 0.0, failure)


def compare(result: Result, other: Result, rtol: float) -> RunCheck:
    """Return the differences of two runs of one experiment."""
    whole = float(result.time[-1] - result.time[0])
    first, second = (np.array([e.time for e in r.events]) for r in (result, other))
    shift = float(np.abs(first - second).max(initial=0.0)) if len(first) == len(second) else math.nan
    allowed = FACTOR * result.rtol * whole
    margin = NEAR * whole + (0.0 if math.isnan(shift) else min(shift, allowed))
    clear = _clear(result.time, np.concatenate([first, second]), margin)
    rows = []
    for column in result.columns:
        here, there = result[column.name], other[column.name]
        magnitude = float(np.abs(here).max(initial=0.0))
        gap = float(np.abs(here - there)[clear].max(initial=0.0))
        rows.append(OutputDifference(column.name, column.unit, gap, magnitude, FACTOR * result.rtol * magnitude))
    return RunCheck(other.solver, rtol, PARTS, tuple(rows), (len(first), len(second)), shift, allowed)


def _clear(times: Array, events: Array, margin: float) -> Any:
    """Return a mask (n,) of the reported instants that are not near an event."""
    clear = np.ones(len(times), dtype=bool)
    if len(events):
        events = np.sort(events)
        after = np.searchsorted(events, times)
        for place in (after - 1, after):
            inside = (place >= 0) & (place < len(events))
            near = np.abs(times - events[np.clip(place, 0, len(events) - 1)]) <= margin
            clear &= ~(inside & near)
    return clear
