"""Experiment study: all results of an experiment at each point of its sweeps, that is analyses and a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compiler.api import Analysis, Differentiating, Fitting, Inverting, Linearizing, MonteCarloRequest, Study

from ..analysed_model import AnalysedModel
from ..analysis.outcome import Point
from ..simulation.repetition import simulate
from ..simulation.run_options import RunRequest
from .scalar_study import STEPS, ScalarStudy
from .workers import ALONE, Workers

if TYPE_CHECKING:
    from compiler.api import Analysis

    from ..analysed_model import AnalysedModel
    from ..keywords import ExperimentKeywords
    from ..results.result import Result
    from ..simulation.settings import Settings
    from .fitted import Fit
    from .scalar_study import ScalarStudy
    from .workers import Workers


def _fitted(model: AnalysedModel, step: Fitting, experiment: str | None, settings: Settings) -> Fit:
    from .fit import fit

    sought = {s.name: s for s in step.sought}
    folder = model.source.path.parent if model.source.path is not None else Path()
    return fit(model, [folder / f for f in step.files], sought, experiment, settings, step.explain)


def _inverted(model: AnalysedModel, step: Inverting, experiment: str | None, settings: Settings) -> Any:
    wanted = {w.output: w.text or w.value for w in step.wanted}
    if step.stop is None:
        return model.invert(wanted, step.inputs, experiment, settings)
    return model.invert(
        wanted, step.inputs, experiment, settings, to=step.stop, start=step.start, points=step.points, moving=step.moving,
        limits=dict(step.limits),
    )  # fmt: skip


# The result of a step that needs no other, by its word: model, step, experiment, settings, outputs -> noun. Raises as the call.
RESULTS: dict[str, Callable[[AnalysedModel, Any, str | None, Settings, tuple[str, ...] | None], Any]] = {
    "equilibrium": lambda m, s, *given: m.equilibrium(*given),
    "modes": lambda m, s, e, at, o: m.modes(e, at),
    "bode": lambda m, s, e, at, o: m.response(None, o, points=s.points or 400, experiment=e, settings=at),
    "response": lambda m, s, e, at, o: m.response(s.given, s.seen, s.low, s.high, s.points, experiment=e, settings=at),
    "linearize": lambda m, s, e, at, o: m.linearize(s.inputs or None, s.outputs or o, experiment=e, settings=at),
    "continue": lambda m, s, e, at, o: m.continuation(
        s.name, s.low, s.high, s.points, s.most, o, s.branches, experiment=e, settings=at
    ),
    "invert": lambda m, s, e, at, o: _inverted(m, s, e, at),
    "fit": lambda m, s, e, at, o: _fitted(m, s, e, at),
}


def differentiated(
    model: AnalysedModel, step: Differentiating, beside: Sequence[Analysis], study: ScalarStudy
) -> list[tuple[str, Any]]:
    """Return derivatives of the results of the other steps, each with its word: at equilibrium, along the run, of linear models and responses."""
    by, of, run, word = step.by or None, study.of, study.run, step.role
    outputs = run.outputs
    given: ExperimentKeywords = {"experiment": run.experiment, "settings": run.settings}
    linear: list[tuple[str, Any]] = []
    for other in beside:
        match other:
            case Linearizing():
                some = other.inputs or None, other.outputs or outputs
                linear.append((f"{word} of {other.role}", model.sensitivity_of_linearization(by, *some, **given)))
            case Study(role="response"):
                over = other.given, other.seen, other.low, other.high, other.points
                linear.append((f"{word} of {other.role}", model.sensitivity_of_response(by, *over, **given)))
    found: list[tuple[str, Any]] = []
    at_rest = tuple(s for s in of if s in ("equilibrium", "modes"))
    if at_rest or not (linear or "simulate" in of):
        found.append((word, model.sensitivity(by, at_rest or ("equilibrium", "modes"), outputs, **given)))
    if "simulate" in of:
        end, points = run.options.to, run.options.points or 101
        found.append((word, model.sensitivity_of_run(by, to=end, points=points, outputs=outputs, **given)))
    return [*found, *linear]


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
            from .montecarlo import montecarlo

            return Point(point, analyses=((chance.role, montecarlo(model, chance, study, workers)),))
        return self._point(model, Point(point), studies, study)

    @property
    def only_run(self) -> RunRequest | None:
        """Run of an experiment without analyses."""
        return self.run if self.simulates and not self.studies else None

    def of_run(self, point: Mapping[str, float], run: Result) -> Point:
        """Return the point with its run."""
        return Point(point, run=run)

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
