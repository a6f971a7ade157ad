"""Scalar study: numbers by name at each point, and the checks of a request before any point is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import ANALYSIS_STEPS, Named

from ..analysis.modes import moving_frequencies
from ..analysis.movable import refuse_choice
from ..analysis.outcome import MODES
from ..analysis.placement import operating_point
from ..compiled_model import CompiledModel
from ..errors import RunFailed, UsageError
from ..keywords import AnalysisRequest
from ..quantities import refuse_two_readings
from ..results.result import Result
from ..simulation.repetition import simulate
from ..simulation.run_options import RunRequest
from ..simulation.settings import Settings, compiled_in
from .point_failure import kept, why

STEPS = (*(word for word, row in ANALYSIS_STEPS.items() if row.scalar), "simulate")


@dataclass(frozen=True, slots=True)
class Failed:
    """Reason why a point has no result."""

    why: str


@dataclass(frozen=True, slots=True)
class ScalarStudy:
    """Scalar study: numbers by name at each point, in SI and Hz.

    `of`: equilibrium (outputs at equilibrium), modes (frequencies), simulate (outputs at the end).
    """

    of: tuple[str, ...]
    run: RunRequest
    most: int = MODES  # most frequencies

    def answer(self, model: CompiledModel, point: Mapping[str, str | float]) -> dict[str, float] | Failed:
        """Return the numbers at one point, or the reason of its failure."""
        try:
            return self._numbers(model, self.run.at(point))
        except Exception as problem:
            return Failed(why(kept(problem)))

    @property
    def only_run(self) -> RunRequest | None:
        """Run, if numbers of runs are all that is asked for."""
        return self.run if self.of == ("simulate",) else None

    def of_run(self, point: Mapping[str, str | float], run: Result) -> dict[str, float] | Failed:
        """Return the numbers of a run, or the reason why it has none."""
        try:
            return checked(numbers_of(run))
        except RunFailed as problem:
            return Failed(why(kept(problem)))

    def _numbers(self, model: CompiledModel, run: RunRequest) -> dict[str, float]:
        found: dict[str, float] = {}
        if "equilibrium" in self.of or "modes" in self.of:
            outputs = run.outputs if "equilibrium" in self.of else None
            at_rest = operating_point(model, AnalysisRequest(run.experiment, run.settings, outputs))
            if "equilibrium" in self.of:
                found |= dict(zip(at_rest.program.outputs.names, map(float, at_rest.outputs), strict=True))
            if "modes" in self.of:
                frequencies = moving_frequencies(at_rest)[: self.most]
                found |= {f"frequency {i}": f for i, f in enumerate(frequencies, 1)}
        if "simulate" in self.of:
            found |= numbers_of(simulate(model, run))
        return checked(found)


def numbers_of(run: Result) -> dict[str, float]:
    """Return the outputs at the end of a run. Raises `RunFailed` where the model does not hold."""
    if run.warnings:
        raise RunFailed("BR448", f"the model does not hold there: {run.warnings[0]}")
    return {name: run.final(name) for name in run.names}


def checked(numbers: dict[str, float]) -> dict[str, float]:
    """Return numbers that are finite. Raises `RunFailed` for others."""
    bad = [name for name, value in numbers.items() if not np.isfinite(value)]
    if bad:
        raise RunFailed("BR449", f"`{bad[0]}` is no number there")
    return numbers


def check_steps(of: tuple[str, ...], what: str) -> None:
    """Raise `UsageError` for steps that are not possible."""
    unknown = [step for step in of if step not in STEPS]
    if unknown or not of:
        raise UsageError("BR450", f"{what} is of {', '.join(STEPS)}; not of `{(*unknown, 'nothing')[0]}`")


def quantities_of(
    model: CompiledModel, values: Mapping[str, Any], experiment: str | None, settings: Settings
) -> dict[str, Named]:
    """Return the quantities of settings. Raises `CompilationFailed` for names that the model does not have, `UsageError` for texts with two readings."""
    compilation = model.compilation(model.scene(experiment, settings))
    quantities = compilation.whole_graph.quantities
    refuse_two_readings(values, quantities)
    for name in values:
        refuse_choice(name, compilation)
        if name not in quantities:  # the compiler's message lists the existing names
            _ = model.compilation(model.scene(experiment, {**settings, name: 0.0})).whole_graph
    return {name: quantities[name] for name in values}


def compilation_notes(
    model: CompiledModel, run: RunRequest, points: Sequence[Mapping[str, str | float]]
) -> tuple[str, ...]:
    """Return notes on names with several values that must be compiled in: each such point takes as long as the compiler."""
    varying = [n for n in (points[0] if points else ()) if len({p[n] for p in points}) > 1]
    if not varying:
        return ()
    why = compiled_in(model, run.experiment, {**run.settings, **points[0]}, varying)
    return tuple(
        f"`{name}` is compiled into the model anew at each of its {len({p[name] for p in points})} values: more than numbers go with it in {place}"
        for name, place in why.items()
    )
