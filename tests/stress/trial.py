"""One model with a known answer, run in one way: how far off it is, or why there is no answer."""

from __future__ import annotations

import re
import signal
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from compiler.errors import CompilationFailed, render
from tests.stress.report import Section
from tests.stress.ways import Way, loaded

RTOL = 1e-6
ALLOWED = 10.0  # times the tolerance
POINTS = 41
LONGEST = 120.0  # s of computing for one run: what takes longer hangs
NAMED = 10.0  # s for a solver that somebody asked for by name: an explicit one on a stiff model takes years, and may

Expected = Callable[[Any], Mapping[str, Any]]  # times (n,) -> by output (n,)


class TooLong(BaseException):
    """A run did not end in time."""


@dataclass(frozen=True, slots=True)
class Case:
    """A model and its outputs in closed form. `swept` and `size` say what was varied; `rounding` is what doubles leave of the outputs."""

    system: str
    swept: str
    size: float
    text: str
    settings: Mapping[str, float | str]
    stop: float
    expected: Expected
    points: int = POINTS
    experiment: str | None = None
    check: Callable[[bondgraph.Result], str] = lambda result: ""  # what else is wrong with a result
    allowed: float = ALLOWED
    only: Callable[[Way], bool] = lambda way: True
    longest: float = LONGEST  # s of computing

    @property
    def name(self) -> str:
        return f"{self.system}, {self.swept} {self.size:g}" if self.swept else self.system


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a run: the error in units of the tolerance, or the reason why there is none."""

    error: float = float("nan")
    seconds: float = float("nan")
    steps: int = 0
    refused: str = ""
    unsuited: str = ""  # why the solver that was named is not one for this model
    broken: str = ""  # a defect of ours: a traceback, no end
    allowed: float = ALLOWED

    @property
    def fails(self) -> str:
        if self.broken:
            return self.broken
        return (
            ""
            if self.refused or self.unsuited or self.error <= self.allowed
            else f"off by {self.error:.3g} times the tolerance"
        )


def attempt(case: Case, way: Way, rtol: float = RTOL) -> Outcome:
    """Run a case, and catch all failures."""
    began = clock.perf_counter()
    try:
        with within(case.longest if way.chooses else NAMED), np.errstate(all="ignore"):
            result = loaded(case.text).simulate(
                case.experiment, dict(case.settings), to=case.stop, points=case.points, rtol=rtol, **way.arguments
            )
    except (RunFailed, UsageError) as failed:
        seconds = clock.perf_counter() - began
        return (
            Outcome(refused=str(failed), seconds=seconds)
            if way.chooses
            else Outcome(unsuited=str(failed), seconds=seconds)
        )
    except CompilationFailed as failed:
        return Outcome(refused=" ".join(map(render, failed.diagnostics)), seconds=clock.perf_counter() - began)
    except TooLong:
        if not way.chooses:
            return Outcome(unsuited=f"no end within {NAMED:g} s", seconds=clock.perf_counter() - began)
        return Outcome(broken=f"no end within {case.longest:g} s", seconds=clock.perf_counter() - began)
    except Exception as error:  # what it must not do
        return Outcome(broken=f"{type(error).__name__}: {error}", seconds=clock.perf_counter() - began)
    seconds = clock.perf_counter() - began
    wrong = case.check(result)
    return Outcome(
        error_of(result, case.expected(result.time), rtol), seconds, result.steps, broken=wrong, allowed=case.allowed
    )


def error_of(result: bondgraph.Result, expected: Mapping[str, Any], rtol: float) -> float:
    """The largest error of all outputs at all instants (where something is expected), as a share of the output's largest value."""
    worst = 0.0
    for name, values in expected.items():
        values = np.asarray(values, dtype=float)
        known = np.isfinite(values)
        size = float(np.abs(values[known]).max(initial=0.0))
        off = float(np.abs(result[name][known] - values[known]).max(initial=0.0))
        share = off / size if size > 0 else off
        worst = max(worst, share) if np.isfinite(share) else np.inf
    return worst / rtol


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Ends what computes for longer, by `TooLong`."""

    def stop(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def tell(found: Section, outcomes: Mapping[str, Mapping[str, Outcome]], names: Sequence[str]) -> None:
    """Write a table with the error in each way, and the failures."""
    used = [n for n in names if any(n in by_way for by_way in outcomes.values())]
    rows = []
    for name, by_way in outcomes.items():
        row: list[object] = [name]
        for way in used:
            outcome = by_way.get(way)
            if outcome is None:
                row += ["", ""]
                continue
            found.tried += 1
            where = f"{name} ({way})"
            if outcome.refused:
                found.refuse(where, outcome.refused)
            if outcome.unsuited:
                found.unsuited[shortened(outcome.unsuited)] += 1
            if outcome.fails:
                found.fail(where, outcome.fails)
            word = (
                "-"
                if outcome.unsuited
                else "refused"
                if outcome.refused
                else "broken"
                if outcome.broken
                else outcome.error
            )
            row += [word, outcome.steps or ""]
        rows.append(row)
    found.table(["model", *(h for way in used for h in (f"error, {way}", "steps"))], rows)


def shortened(reason: str) -> str:
    """A reason without the numbers of one model."""
    return re.sub(r"`[^`]*`|-?\d[\d.e+-]*", "…", reason)[:160]


def run_all(found: Section, cases: Sequence[Case], chosen: Sequence[Way]) -> None:
    """Run all cases in all ways that apply, and report them in one table."""
    outcomes: dict[str, dict[str, Outcome]] = {}
    for case in cases:
        for way in chosen:
            if case.only(way):
                outcomes.setdefault(case.name, {})[way.name] = attempt(case, way)
    tell(found, outcomes, [w.name for w in chosen])
