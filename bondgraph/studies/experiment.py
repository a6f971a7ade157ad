"""Execution of an experiment as written: every point of its sweeps, with its analyses and its run; and sweeps over a grid of values."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compiler.api import Analysis, Differentiating, Fitting, Inverting, Linearizing, MonteCarloRequest, Plan, Study

from ..analysed_model import AnalysedModel
from ..analysis.outcome import Outcome, Point
from ..errors import UsageError
from ..simulation.repetition import simulate
from ..simulation.run_options import RunRequest
from ..simulation.settings import Settings
from .point_failure import check_some_stand, why
from .point_request import PointRequest
from .scalar_study import STEPS, ScalarStudy, check_steps, compilation_notes, quantities_of
from .workers import ALONE, Workers, answers

if TYPE_CHECKING:
    from ..keywords import ExperimentKeywords
    from ..results.result import Result
    from .fitted import Fit

MOST_POINTS = 1_000_000


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
    units = {s.name: s.unit for s in left}
    shown = _shown(model, plan, units)
    notes = compilation_notes(model, asked.run, with_texts(grid, texts))
    return Outcome(first.whole_graph.name, plan.experiment, units, points, shown, notes, words)


def _shown(
    model: AnalysedModel, plan: Plan, units: Mapping[str, str], written: Mapping[str, Any] | None = None
) -> dict[str, tuple[str, float, float]]:
    """Return unit, scale and offset of what is reported, and of swept names: in the unit of the first text among values of a call, else the author's."""
    from ..author_units import author_units, quantities_in

    scales = author_units(model, units)
    for name, some in (written or {}).items():
        text = some if isinstance(some, str) else next((v for v in some if isinstance(v, str)), "")
        if units[name] != "1":
            scales[name] = next(((unit, scale) for _, unit, scale in quantities_in(text)), scales[name])
    reported = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
    return reported | {n: (u or "1", s.from_si(1.0) - s.from_si(0.0), s.from_si(0.0)) for n, (u, s) in scales.items()}


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


def sweep(
    model: AnalysedModel, values: Mapping[str, str | Sequence[str | float]], study: ScalarStudy, together: bool, workers: Workers | None = None
) -> Outcome:  # fmt: skip
    """Compute the steps of a study at a grid of values, or (`together`) at the first of each name, the second of each and so on."""
    check_steps(study.of, "a sweep")
    compilation = study.run.compilation(model)
    plan, words = compilation.plan, {n: compilation.choices[n] for n in values if n in compilation.choices}
    texts = {n: _texts(values[n], n) for n, some in words.items() if not some}
    words |= texts
    counted = {name: dict(zip(some, itertools.count(1.0))) for name, some in words.items()}
    counted |= {name: {"false": 0.0, "true": 1.0} for name in values if name in compilation.truths}
    quantities = quantities_of(
        model, {n: some for n, some in values.items() if n not in counted}, study.run.experiment, study.run.settings
    )
    numbers = {
        name: tuple(1.0 + texts[name].index(t) for t in texts[name])
        if name in texts
        else _places(some, counted[name], name)
        if name in counted
        else _numbers(some, quantities[name].kind, name)
        for name, some in values.items()
    }
    units = {name: quantities[name].unit if name in quantities else "1" for name in values}
    lengths = {len(some) for some in numbers.values()}
    if together and len(lengths) > 1:
        raise UsageError("BR461", "values that go together are as many for each name")
    rows = list(
        zip(*numbers.values(), strict=True)
        if together
        else itertools.islice(itertools.product(*numbers.values()), MOST_POINTS)
    )
    studies = tuple(Study(step) for step in study.of if step != "simulate")
    asked = ExperimentStudy(study.run, studies, "simulate" in study.of)
    grid = [dict(zip(numbers, row, strict=True)) for row in rows]
    points = made(model, asked, grid, workers or ALONE, texts)
    shown = _shown(model, plan, units, values)
    notes = compilation_notes(model, study.run, with_texts(grid, texts))
    return Outcome(compilation.whole_graph.name, plan.experiment, units, points, shown, notes, words)


def _places(values: str | Sequence[str | float], words: Mapping[str, float], name: str) -> tuple[float, ...]:
    """Return the numbers of words. Raises `UsageError`."""
    some = values.split(",") if isinstance(values, str) else values
    numbers: dict[str | float, float] = {}
    for word, number in words.items():
        numbers |= {word: number, f"{number:g}": number, number: number}
    stripped = [v.strip() if isinstance(v, str) else v for v in some]
    if wrong := [v for v in stripped if v not in numbers]:
        raise _not_one_of(name, wrong[0], ", ".join(words))
    return tuple(numbers[v] for v in stripped)


def _texts(values: str | Sequence[str | float], name: str) -> tuple[str, ...]:
    """Return the texts that stand in quotation marks. Raises `UsageError`."""
    some = re.findall(r'"[^"]*"|[^\s,][^,]*', values) if isinstance(values, str) else values
    if wrong := [v for v in some if not re.fullmatch(r'\s*"[^"]+"\s*', str(v))]:
        raise _not_one_of(name, wrong[0], "texts in quotation marks")
    return tuple(str(v).strip().strip('"') for v in some)


def _not_one_of(name: str, value: str | float, choices: str) -> UsageError:
    return UsageError("BR499", f"`{name}` cannot be `{value}`;", f"it can be {choices}")


def _numbers(values: str | Sequence[str | float], unit: str, name: str) -> tuple[float, ...]:
    """Return values in SI, of the unit's kind. Raises `UsageError`."""
    from ..quantities import quantities, quantity

    if isinstance(values, str):
        return tuple(quantities(values, unit, name))
    return tuple(quantity(v, unit, name) for v in values)
