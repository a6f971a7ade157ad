"""Many runs of one model. Settings are arguments of one program, so it is compiled once; machine code runs outside the interpreter's lock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..analysed_model import AnalysedModel
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

    @property
    def only_run(self) -> RunRequest:
        """Run that is all there is at a point."""
        return self.run

    def of_run(self, point: Mapping[str, str | float], run: Result) -> Result:
        return run


def simulate_many(
    model: AnalysedModel, run: RunRequest, settings: Sequence[Mapping[str, str | float]], workers: Workers
) -> Ensemble:
    """Run a model with each of several settings. Raises `UsageError` for an error common to all, `RunBroken` for a defect in all."""
    check_run_options(run.options)
    points = tuple(dict(s) for s in settings)
    found = answers(model, RunStudy(run), points, workers)
    check_some_stand(found)
    return Ensemble(points, tuple(found))
