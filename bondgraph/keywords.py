"""Keyword options that several calls of a model share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypedDict

from .errors import UsageError


class RunKeywords(TypedDict, total=False):
    """Options of a call that runs a model, beside experiment, settings, end and instants; each overrides the experiment.

    `rtol`, `atol`: tolerances; `accuracy`: largest error of an output relative to its magnitude, which chooses them. `energy` adds the energy balance.
    `outputs`: only these. `target`: native (machine code) or numpy; by default the first that this machine has. `solver`: a word of
    `compiler.solvers.SOLVERS`. `bandwidth`: a frequency as text or in Hz; faster modes need not be followed, and the result's `left_out` reports the
    truncated ones. `extremes`: the least and greatest values of the outputs are searched between the reported instants.
    """

    rtol: float | None
    atol: float | None
    accuracy: float | None
    energy: bool
    outputs: Sequence[str] | None
    target: str | None
    solver: str | None
    bandwidth: str | float | None
    extremes: bool


class SweepKeywords(RunKeywords, total=False):
    """Options of a sweep: those of its runs."""

    to: str | float | None
    points: int | None


class BenchmarkKeywords(TypedDict, total=False):
    """Options of a benchmark."""

    rounds: int
    peers: bool
    outputs: Sequence[str] | None
    progress: Callable[[str], None]


class StressKeywords(TypedDict, total=False):
    """Options of a stress test."""

    vary: Mapping[str, str]
    seed: int
    out: str | Path | None
    outputs: Sequence[str] | None
    progress: Callable[[str], None]


class MonteCarloKeywords(TypedDict, total=False):
    """Options of a Monte Carlo study."""

    correlations: Mapping[tuple[str, str], float] | None
    seed: int
    indices: int | None
    outputs: Sequence[str] | None
    to: str | float | None
    rtol: float | None


class ExperimentKeywords(TypedDict, total=False):
    """Options of an analysis: an experiment (None: none, "": the first), whose settings and start values are used, and more settings by name."""

    experiment: str | None
    settings: Mapping[str, str | float] | None


class AnalysisKeywords(ExperimentKeywords, total=False):
    """Options of an analysis at an equilibrium: its inputs are held as at `time` (s; None: begin of the experiment)."""

    time: float | None


class PointKeywords(AnalysisKeywords, total=False):
    """Options of an analysis at a `state`: "equilibrium", "start", or values of states by name, in SI."""

    state: str | Mapping[str, float]


class PathKeywords(TypedDict, total=False):
    """Options of an inversion along a path.

    `start` of the path (None: 0 s, or the first line of its file), number of `points` (501), `moving`: it need not begin at rest; `limits`: largest inputs.
    """

    start: str | float | None
    points: int
    moving: bool
    limits: Mapping[str, str | float] | None


def check_keywords(call: Callable[..., object], options: Mapping[str, object], known: frozenset[str]) -> None:
    """Raise `UsageError` for an option that a call does not have, with the nearest that it has."""
    unknown = sorted(options.keys() - known)
    if unknown:
        from difflib import get_close_matches
        from inspect import signature

        names = sorted({*signature(call).parameters, *known} - {"self", "options"})
        near = get_close_matches(unknown[0], names, n=1)
        hint = f"did you mean `{near[0]}`?" if near else f"it has {', '.join(names)}"
        raise UsageError("BR614", f"`{call.__name__}` has no option `{unknown[0]}`; {hint}")
