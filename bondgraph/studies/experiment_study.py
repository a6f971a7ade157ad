"""Experiment study: all results of an experiment at each point of its sweeps, that is analyses and a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from compiler.api import Analysis, Differentiating, MonteCarloRequest, Study

from ..analysed_model import AnalysedModel
from ..analysis.outcome import Point
from ..batch.together import is_together, simulate_together
from ..simulation.repetition import simulate
from ..simulation.run_options import RunRequest
from .scalar_study import STEPS, ScalarStudy
from .steps import RESULTS, differentiated, varied
from .workers import ALONE, Workers


@dataclass(frozen=True, slots=True)
class ExperimentStudy:
    """Experiment study: all results of an experiment or a sweep at a point, that is analyses and a run."""

    run: RunRequest
    studies: tuple[Analysis, ...]
    simulates: bool

    def answer(self, model: AnalysedModel, point: Mapping[str, float], workers: Workers = ALONE) -> Point:
        """Return the results at one point; `workers`: the workers for the points of a Monte Carlo study in it."""
        run = self.run.at(point)
        studies = self._at(model, run) if point else self.studies
        chance = next((s for s in studies if isinstance(s, MonteCarloRequest)), None)
        of = tuple(dict.fromkeys(s.role for s in studies if s.role in STEPS)) + ("simulate",) * self.simulates
        study = ScalarStudy(of, run)
        if chance is not None:  # Monte Carlo evaluates all other steps
            return Point(point, analyses=((chance.role, varied(model, chance, study, workers)),))
        return self._point(model, Point(point), studies, study)

    def answer_all(self, model: AnalysedModel, points: Sequence[Mapping[str, float]]) -> list[Point | None]:
        """Return the results at points where there is a run only, for runs that are stepped together; None for the others."""
        if self.studies or not self.simulates:
            return [None] * len(points)
        runs = simulate_together(model, self.run, points)
        return [None if run is None else Point(point, run=run) for point, run in zip(points, runs, strict=True)]

    def is_batch(self, model: AnalysedModel, point: Mapping[str, float]) -> bool:
        """Return True if such runs are stepped together."""
        return not self.studies and self.simulates and is_together(model, self.run, point)

    def _at(self, model: AnalysedModel, run: RunRequest) -> tuple[Analysis, ...]:
        """Return the steps, whose numbers may depend on swept values."""
        if all(isinstance(s, Study) for s in self.studies):
            return self.studies
        return run.compilation(model).plan.studies

    def _point(self, model: AnalysedModel, found: Point, studies: Sequence[Analysis], study: ScalarStudy) -> Point:
        run = study.run
        for step in studies:
            if isinstance(step, Differentiating):
                found = replace(found, analyses=(*found.analyses, *differentiated(model, step, studies, study)))
            else:
                one = RESULTS[step.role](model, step, run.experiment, run.settings, run.outputs)
                match step.role:
                    case "equilibrium" | "modes":
                        found = replace(found, **{step.role: one})
                    case "response" | "bode":
                        found = replace(found, responses=(*found.responses, one))
                    case _:
                        found = replace(found, analyses=(*found.analyses, (step.role, one)))
        if self.simulates:
            found = replace(found, run=simulate(model, run))
        return found
