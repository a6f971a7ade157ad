"""Many runs of one model. Settings are arguments of one program, so it is compiled once; machine code runs outside the interpreter's lock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..analysed_model import AnalysedModel
from ..batch.together import is_together, simulate_together
from ..results.ensemble import Ensemble
from ..results.result import Result
from ..simulation.repetition import simulate
from ..simulation.run_options import RunRequest, check_run_options
from .point_failure import check_some_stand
from .workers import Workers, answers


@dataclass(frozen=True, slots=True)
class RunStudy:
    """Run at each point; a point is a mapping of settings."""

    run: RunRequest

    def answer(self, model: AnalysedModel, point: Mapping[str, str | float]) -> Result:
        """Return the result of a run."""
        return simulate(model, self.run.at(point))

    def answer_all(self, model: AnalysedModel, points: Sequence[Mapping[str, str | float]]) -> list[Result | None]:
        """Return the results of runs that are stepped together; None for the others."""
        return simulate_together(model, self.run, points)

    def is_batch(self, model: AnalysedModel, point: Mapping[str, str | float]) -> bool:
        """Return True if such runs are stepped together."""
        return is_together(model, self.run, point)


def simulate_many(
    model: AnalysedModel, run: RunRequest, settings: Sequence[Mapping[str, str | float]], workers: Workers
) -> Ensemble:
    """Run a model with each of several settings. Raises `UsageError` for an error common to all, `RunBroken` for a defect in all."""
    check_run_options(run.options)
    points = tuple(dict(s) for s in settings)
    found = answers(model, RunStudy(run), points, workers)
    check_some_stand(found)
    return Ensemble(points, tuple(found))
