"""Benchmark of an experiment: each solver at each tolerance, beside a reference of two of them, and beside other programs over the same equations."""

from __future__ import annotations

import math
import statistics
import time as clock
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from compiler.api import AUTOMATIC, SOLVERS, CompilationFailed

from ..analysed_model import AnalysedModel
from ..errors import RunFailed, UsageError
from ..results.result import Result
from ..results.run_check import ErrorEstimate
from ..simulation.repetition import compare
from ..simulation.run import simulate_once
from ..simulation.run_options import LEAST_RTOL, RunRequest
from .peers import peers_of
from .time_limit import TooLong, within
from .work_precision import WorkPoint, WorkPrecision

TOLERANCES = tuple(10.0**-k for k in range(3, 13))
REFERENCES = ("exponential", "explicit", "radau13", "radau", "rodas")  # the first two that can
PATIENCE = 20.0  # s: a run that takes longer is stopped, and its solver gets no tighter tolerance
OFTEN = 1.0  # s: a point that takes longer is run once

Run = Callable[[float], "Result"]  # tolerance -> result


@dataclass(frozen=True, slots=True)
class BenchmarkRequest:
    """Request of a benchmark: the run, the wanted `error`, `rounds` of each run, and whether solvers of other programs take part (`peers`)."""

    run: RunRequest
    error: float = 1e-6
    rounds: int = 3
    peers: bool = True


def benchmark(model: AnalysedModel, request: BenchmarkRequest, progress: Callable[[str], None]) -> WorkPrecision:
    """Run an experiment with every solver at every tolerance; `progress` is called with what is being run.

    Raises `UsageError` if no solver can, `CompilationFailed`, `RunFailed` if no run at a tight tolerance succeeds.
    """
    if not 0 < request.error < 1 or request.rounds < 1:
        raise UsageError("BR490", "a benchmark takes a wanted error between 0 and 1, and at least one round")

    def run_by(solver: str) -> Run:
        options = replace(request.run.options, solver=solver, accuracy=None)
        return lambda rtol: simulate_once(model, replace(request.run, options=replace(options, rtol=rtol)))

    with suppress(RunFailed):
        run_by(AUTOMATIC)(TOLERANCES[0])  # errors that are no matter of the solver
    refused: dict[str, str] = {}
    runs: dict[str, Run] = {}
    for word in [word for word in SOLVERS if word != AUTOMATIC]:
        progress(word)
        with suppress(RunFailed):  # a tighter tolerance may succeed
            try:
                with within(PATIENCE):
                    run_by(word)(TOLERANCES[0])
            except (UsageError, CompilationFailed, TooLong) as refusal:
                refused[word] = str(refusal)
        if word not in refused:
            runs[word] = run_by(word)
    if not runs:
        raise UsageError("BR491", f"no solver can run this: {'; '.join(refused.values())}")
    references, agreement = _references(runs)
    reference = references[0]
    peers, missing = peers_of(model, request.run, reference) if request.peers else ({}, {})
    for run in peers.values():
        with suppress(RunFailed, TooLong), within(PATIENCE):
            run(TOLERANCES[0])  # what is loaded at the first run is not timed
    points = (replace(p, peer=p.solver in peers) for p in _measured(runs | peers, reference, request.rounds, progress))
    return WorkPrecision(
        reference.model, reference.experiment, tuple(f"{r.solver}, rtol {r.rtol:g}" for r in references), agreement, tuple(points),
        refused | missing, request.error,
    )  # fmt: skip


def _references(runs: Mapping[str, Run]) -> tuple[list[Result], float]:
    """Return the results of two solvers at the tightest tolerance, and the largest relative difference of the two."""
    results: list[Result] = []
    failure: RunFailed | None = None
    for word in [w for w in REFERENCES if w in runs]:
        try:
            results.append(runs[word](LEAST_RTOL))
        except RunFailed as failed:
            failure = failed
        if len(results) == 2:
            return results, _error(results[1], results[0])[0]
    if not results:
        raise failure or RunFailed("BR492", "no solver that a reference can be made of takes this model")
    return results, math.nan


def _error(result: Result, reference: Result) -> tuple[float, dict[str, float]]:
    """Return the largest relative error, and that of each output."""
    rows = compare(result, reference, reference.rtol).outputs
    worst = ErrorEstimate(reference.rtol, rows).worst
    return 0.0 if worst is None else worst.share, {row.name: row.share for row in rows}


def _measured(
    runs: Mapping[str, Run], reference: Result, rounds: int, progress: Callable[[str], None]
) -> list[WorkPoint]:
    """Return all points; times are medians over the rounds, in each of which all take turns."""
    points: dict[tuple[str, float], WorkPoint] = {}
    times: dict[tuple[str, float], list[float]] = {}
    for turn in range(rounds):
        for solver, run in runs.items():
            progress(f"{solver}, round {turn + 1} of {rounds}")
            for rtol in TOLERANCES if solver != "exponential" else TOLERANCES[:1]:
                key = solver, rtol
                if turn and (key not in times or times[key][0] > OFTEN):  # it failed, or once is enough
                    continue
                began = clock.perf_counter()
                try:
                    with within(PATIENCE):
                        result = run(rtol)
                except TooLong as failed:
                    points.setdefault(key, WorkPoint(solver, rtol, failure=str(failed)))
                    break
                except (RunFailed, UsageError, ArithmeticError) as failed:
                    points.setdefault(key, WorkPoint(solver, rtol, failure=str(failed)))
                    continue
                times.setdefault(key, []).append(clock.perf_counter() - began)
                if not turn:
                    error, errors = _error(result, reference)
                    points[key] = WorkPoint(
                        solver, rtol, error, math.nan, result.steps, sum(result.evaluations.values()), errors
                    )
    return [p if p.failure else replace(p, seconds=statistics.median(times[key])) for key, p in points.items()]
