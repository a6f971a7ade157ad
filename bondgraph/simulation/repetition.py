"""Repetition of a run with a tenth of its tolerance.

For `--check` by a method of another family and in many parts, so that events are searched again; for the estimate of the error by the same method, whose
error falls with the tolerance: of 167 errors of outputs of the models here that a reference tells, 166 were estimated within a factor of 3, by another
method 107 of 115.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, SOLVERS, Array

from ..errors import RunFailed, RunInterrupted, UsageError
from ..results.run_check import FACTOR, ErrorEstimate, OutputDifference, RunCheck
from . import run
from .run_options import LEAST_RTOL, RunOptions, RunRequest

if TYPE_CHECKING:
    from ..compiled_model import CompiledModel
    from ..results.result import Result

    Repeat = Callable[[RunOptions], Result]

PARTS = 61
TIGHTEST = 1e-12  # for another method
NEAR = 1e-9  # fraction of the run: an instant this near to an event, reported with ten digits, may belong to either side of it


def simulate(model: CompiledModel, request: RunRequest, start: Result | None = None) -> Result:
    """Run a model as requested, and again for a check, an estimate of the error, or an accuracy. `start`: a result from which the run goes on.

    A `RunFailed` or `RunInterrupted` carries the result up to the instant at which it was raised, or the finished run if that was repeated.
    """

    def repeat(options: RunOptions) -> Result:
        return run.simulate_once(model, replace(request, options=options))

    wanted, result = request.options, run.simulate_once(model, request, start)
    if start is not None:
        note = "the accuracy was not checked, as the run goes on from another: its tolerance is a tenth of it"
        return result if result.accuracy is None else replace(result, notes=(*result.notes, note))
    try:
        if wanted.error or result.accuracy is not None:
            result = with_error(result, repeat, wanted)
        return replace(result, check=check_run(result, repeat, wanted)) if wanted.check else result
    except RunInterrupted as stopped:
        stopped.result = result
        raise


def check_run(result: Result, repeat: Repeat, wanted: RunOptions) -> RunCheck:
    """Compare a finished run with its repetition; `repeat` makes a run of the same model, experiment and settings."""
    rtol = max(result.rtol / 10, TIGHTEST)
    methods = (row.others for row in SOLVERS.values() if row.name and result.solver.startswith(row.name))
    failure = ""
    for solver in next(methods, (AUTOMATIC,)):
        asked = replace(
            wanted, solver=solver, rtol=rtol, points=_points(result, wanted), energy=False, extremes=False, parts=PARTS
        )
        try:
            return compare(result, repeat(asked), rtol)
        except UsageError as refused:
            failure = str(refused)
        except RunFailed as failed:
            failure = str(failed)
    return RunCheck("", rtol, PARTS, (), (len(result.events), 0), math.nan, 0.0, failure)


def with_error(result: Result, repeat: Repeat, wanted: RunOptions) -> Result:
    """Return a run with an estimate of its error; where an accuracy is wanted, the first of more and more accurate runs that has it.

    Raises `RunFailed`, with the most accurate run, if none has it.
    """
    accuracy = result.accuracy
    while True:
        rtol = max(result.rtol / 10, LEAST_RTOL)
        failure, closer = "", None
        try:
            # the matrix exponential has rounding errors only: other parts of time have others
            parts = PARTS if result.solver.startswith(SOLVERS["exponential"].name) or rtol == result.rtol else 1
            closer = repeat(
                replace(wanted, rtol=rtol, points=_points(result, wanted), energy=False, extremes=False, parts=parts)
            )
        except RunFailed as failed:
            failure = str(failed)
        if closer is not None and len(closer.events) != len(result.events):
            failure = f"{len(result.events)} events acted in the run and {len(closer.events)} in its repetition with a tenth of the tolerance"
        rows = () if closer is None else compare(result, closer, rtol).outputs
        estimate = ErrorEstimate(rtol, rows, failure)
        result = replace(result, error=estimate)
        if accuracy is None or estimate.reaches(accuracy):
            return result
        if rtol == result.rtol:
            raise _inaccurate(result, estimate, accuracy)
        worst = estimate.worst
        if not failure and worst is not None and math.isfinite(worst.share):
            rtol = max(min(rtol, result.rtol * accuracy / (2 * worst.share)), LEAST_RTOL)
        if closer is None or parts != 1 or closer.rtol != rtol or wanted.energy or wanted.extremes:
            closer = repeat(replace(wanted, rtol=rtol))
        result = closer


def _points(result: Result, wanted: RunOptions) -> int | None:
    """Return the number of instants of a repetition: those of the run, or as asked where a condition has ended it."""
    return len(result.time) if result.stopped_by is None else wanted.points


def _inaccurate(result: Result, estimate: ErrorEstimate, accuracy: float) -> RunFailed:
    reason, worst = estimate.failure, estimate.worst
    if not reason and worst is not None:
        reason = f"the error of `{worst.name}` is about {worst.share:.2g} of its magnitude at rtol = {result.rtol:g}"
    failed = RunFailed(
        "BR787", f"no tolerance gives the accuracy {accuracy:g}: {reason};", "ask for less, or for the outputs that matter (`--output`)"
    )  # fmt: skip
    failed.result = result
    return failed


def compare(result: Result, other: Result, rtol: float) -> RunCheck:
    """Return the differences of two runs of one experiment, and the magnitudes of the outputs of the `other`, the more accurate one."""
    whole = float(result.time[-1] - result.time[0])
    first, second = (np.array([e.time for e in r.events]) for r in (result, other))
    shift = float(np.abs(first - second).max(initial=0.0)) if len(first) == len(second) else math.nan
    allowed = FACTOR * result.rtol * whole
    margin = NEAR * whole + (0.0 if math.isnan(shift) else min(shift, allowed))
    ended = [result.stopped_by is not None, other.stopped_by is not None]
    count = min(len(result.time), len(other.time)) - any(ended)
    clear = _clear(result.time[:count], np.concatenate([first, second]), margin)
    rows = []
    for column in result.columns:
        here, there = result[column.name][:count], other[column.name][:count]
        magnitude = float(np.abs(there).max(initial=0.0))
        gap = float(np.abs(here - there)[clear].max(initial=0.0))
        if all(ended):
            gap = max(gap, abs(result.final(column.name) - other.final(column.name)))
            magnitude = max(magnitude, abs(other.final(column.name)))
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
