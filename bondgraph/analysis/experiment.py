"""An experiment as its author wrote it: every point of its sweeps, with the analyses and the run that it says.

Points are independent of each other: with an executor of the standard interface (`submit`, whose future has a `result`) they go to its
workers, and come back in order. A worker gets the text and compiles it for itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from ..door import Source, Study
from ..errors import UsageError
from ..simulation.run import Wanted, simulate
from .outcome import Outcome, Point

if TYPE_CHECKING:
    from ..model import Model

STEPS = ("equilibrium", "modes", "simulate")
MOST_POINTS = 1_000_000
Settings = Mapping[str, str | float]


@dataclass(frozen=True, slots=True)
class Options(Wanted):
    """What a call says of the runs of an experiment; as `Model.simulate` takes it."""

    outputs: tuple[str, ...] | None = None


@dataclass(frozen=True, eq=False)
class Job:
    """One point, for whichever process makes it."""

    source: Source
    model: str | None
    experiment: str | None
    settings: Settings  # of the call
    swept: Mapping[str, float]
    studies: tuple[Study, ...]
    simulates: bool
    options: Options


def run(model: Model, experiment: str, settings: Settings, options: Options, executor: Any = None) -> Outcome:
    """The experiment of that name ("" the first). Raises as `Model.simulate`."""
    first = model.compilation(model.scene(experiment, settings, outputs=options.outputs))
    plan = first.plan
    left = [s for s in plan.sweeps if s.name not in settings]  # what a call sets is not swept
    grid = [
        dict(zip([s.name for s in left], values, strict=True))
        for values in itertools.product(*(s.values for s in left))
    ]
    simulates = plan.stop is not None or not plan.studies
    jobs = [
        Job(model.source, model.model, plan.experiment, settings, at, plan.studies, simulates, options) for at in grid
    ]  # fmt: skip
    shown = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
    return Outcome(
        first.whole_graph.name, plan.experiment, {s.name: s.unit for s in left}, _made(model, jobs, executor), shown
    )


def sweep(
    model: Model, values: Mapping[str, str | Sequence[str | float]], of: tuple[str, ...], together: bool, experiment: str | None,
    settings: Settings, options: Options, executor: Any = None,
) -> Outcome:  # fmt: skip
    """A grid of values, or (`together`) the first of each, the second of each and so on."""
    unknown = [step for step in of if step not in STEPS]
    if unknown or not of:
        raise UsageError(f"a sweep is of {', '.join(STEPS)}; not of `{(*unknown, 'nothing')[0]}`")
    compilation = model.compilation(model.scene(experiment, settings, outputs=options.outputs))
    quantities, plan = compilation.whole_graph.quantities, compilation.plan
    for name in values:
        if name not in quantities:  # the compiler says what there is instead
            _ = model.compilation(model.scene(experiment, {**settings, name: 0.0})).whole_graph
    units = {name: quantities[name].unit for name in values}
    numbers = {name: _numbers(some, units[name], name) for name, some in values.items()}
    lengths = {len(some) for some in numbers.values()}
    if together and len(lengths) > 1:
        raise UsageError("values that go together are as many for each name")
    rows = list(
        zip(*numbers.values(), strict=True)
        if together
        else itertools.islice(itertools.product(*numbers.values()), MOST_POINTS)
    )
    studies = tuple(Study(step) for step in of if step != "simulate")
    jobs = [
        Job(
            model.source,
            model.model,
            experiment,
            settings,
            dict(zip(numbers, row, strict=True)),
            studies,
            "simulate" in of,
            options,
        )
        for row in rows
    ]
    shown = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
    return Outcome(compilation.whole_graph.name, plan.experiment, units, _made(model, jobs, executor), shown)


def _numbers(values: str | Sequence[str | float], unit: str, name: str) -> tuple[float, ...]:
    """In SI, of the unit's kind. Raises `UsageError`."""
    from ..quantities import quantities, quantity

    if isinstance(values, str):
        return tuple(quantities(values, unit, name))
    return tuple(quantity(v, unit, name) if isinstance(v, str) else float(v) for v in values)


def _made(model: Model, jobs: Sequence[Job], executor: Any) -> tuple[Point, ...]:
    if executor is None:
        return tuple(_point(model, job) for job in jobs)
    futures = [executor.submit(make, job) for job in jobs]
    return tuple(future.result() for future in futures)


def make(job: Job) -> Point:
    """One point, in any process."""
    return _point(_model(job.source, job.model), job)


@lru_cache(maxsize=4)
def _model(source: Source, model: str | None) -> Model:
    from ..model import Model

    return Model(source, model)


def _point(model: Model, job: Job) -> Point:
    settings = {**job.settings, **job.swept}
    found = Point(job.swept)
    outputs = job.options.outputs
    for study in job.studies:
        match study.role:
            case "equilibrium":
                found = replace(found, equilibrium=model.equilibrium(job.experiment, settings, outputs))
            case "modes":
                found = replace(found, modes=model.modes(job.experiment, settings))
            case "response":
                made = model.response(
                    study.given, study.seen, study.low, study.high, study.points, job.experiment, settings
                )  # fmt: skip
                found = replace(found, responses=(*found.responses, made))
    if job.simulates:
        found = replace(found, run=simulate(model, job.experiment, settings, outputs, job.options))
    return found
