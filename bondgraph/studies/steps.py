"""Analysis steps of an experiment, executed as calls of `Model`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compiler.api import Differentiating, Fitting, Inverting, Linearizing, MonteCarloRequest, Study

from .distributions import Distribution

if TYPE_CHECKING:
    from compiler.api import Analysis

    from ..analysed_model import AnalysedModel
    from ..keywords import ExperimentKeywords
    from ..simulation.settings import Settings
    from .fitted import Fit
    from .scalar_study import ScalarStudy
    from .tolerances import MonteCarlo
    from .workers import Workers


def _fitted(model: AnalysedModel, step: Fitting, experiment: str | None, settings: Settings) -> Fit:
    from .fit import fit
    from .fit_problem import BoundedParameter

    sought = {s.name: BoundedParameter(s.name, s.low, s.high, s.logarithmic) for s in step.sought}
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


def varied(model: AnalysedModel, step: MonteCarloRequest, study: ScalarStudy, workers: Workers) -> MonteCarlo:
    """Return the Monte Carlo study of the results of the other steps."""
    from .montecarlo import Chance, montecarlo

    vary = {d.name: Distribution(d.kind, d.numbers, d.low, d.high) for d in step.vary}
    chance = Chance(vary, dict(step.correlations), step.samples, step.seed, step.indices)
    return montecarlo(model, chance, study, workers)
