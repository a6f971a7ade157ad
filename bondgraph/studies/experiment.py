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
    points = (asked.answer(model, {}, chosen),) if alone else made(model, asked, grid, chosen)
    shown = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
    notes = compilation_notes(model, asked.run, grid)
    words = {s.name: first.choices[s.name] for s in left if s.name in first.choices}
    return Outcome(first.whole_graph.name, plan.experiment, {s.name: s.unit for s in left}, points, shown, notes, words)


def made(
    model: AnalysedModel, asked: PointRequest, grid: Sequence[Mapping[str, float]], workers: Workers
) -> tuple[Point, ...]:
    """Return the points of a grid; failed ones with the reason. Raises the error of the first point if all have failed."""
    found: list[Any] = answers(model, asked, grid, workers)
    check_some_stand(found)
    problems = [x for x in found if isinstance(x, Exception)]
    if problems and len(problems) == len(found):
        raise problems[0].with_traceback(None)
    return tuple(
        Point(at, failure=why(x)) if isinstance(x, Exception) else x for at, x in zip(grid, found, strict=True)
    )
