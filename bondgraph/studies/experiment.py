"""Execution of an experiment as written: every point of its sweeps, with its analyses and its run."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from compiler.api import MonteCarloRequest

from ..analysed_model import AnalysedModel
from ..analysis.outcome import Outcome, Point
from ..simulation.run_options import RunRequest
from ..simulation.settings import Settings
from .experiment_study import ExperimentStudy
from .point_failure import check_some_stand, why
from .point_request import PointRequest
from .scalar_study import compilation_notes
from .workers import ALONE, Workers, answers


def run(model: AnalysedModel, request: RunRequest, workers: Workers | None = None) -> Outcome:
    """Run the requested experiment. Raises as `Model.simulate`."""
    first = request.compilation(model)
    plan = first.plan
    left = [s for s in plan.sweeps if s.name not in request.settings]  # names set by a call are not swept
    grid = [
        dict(zip([s.name for s in left], values, strict=True))
        for values in itertools.product(*(s.values for s in left))
    ]
    simulates = plan.stop is not None or not plan.studies
    asked = ExperimentStudy(replace(request, experiment=plan.experiment), plan.studies, simulates)
    chosen = workers or ALONE
    # The workers share the points of a Monte Carlo step that stands alone.
    alone = not left and any(isinstance(s, MonteCarloRequest) for s in plan.studies)
    words = {s.name: s.words for s in left if s.words}
    texts = {n: some for n, some in words.items() if not first.choices[n]}
    points = (asked.answer(model, {}, chosen),) if alone else made(model, asked, grid, chosen, texts)
    shown = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
    notes = compilation_notes(model, asked.run, with_texts(grid, texts))
    return Outcome(first.whole_graph.name, plan.experiment, {s.name: s.unit for s in left}, points, shown, notes, words)


def with_texts(grid: Sequence[Mapping[str, float]], texts: Mapping[str, Sequence[str]]) -> list[Settings]:
    """Return settings in which texts stand in the place of their numbers, from 1."""
    return [{n: f'"{texts[n][int(v) - 1]}"' if n in texts else v for n, v in at.items()} for at in grid]


def made(
    model: AnalysedModel, asked: PointRequest, grid: Sequence[Mapping[str, float]], workers: Workers, texts: Mapping[str, Sequence[str]] | None = None
) -> tuple[Point, ...]:  # fmt: skip
    """Return the points of a grid; failed ones with the reason. `texts` by name: its values are places among them, from 1.

    Raises the error of the first point if all have failed.
    """
    found: list[Any] = answers(model, asked, with_texts(grid, texts or {}), workers)
    check_some_stand(found)
    problems = [x for x in found if isinstance(x, Exception)]
    if problems and len(problems) == len(found):
        raise problems[0].with_traceback(None)
    return tuple(
        Point(at, failure=why(x)) if isinstance(x, Exception) else replace(x, settings=at)
        for at, x in zip(grid, found, strict=True)
    )
