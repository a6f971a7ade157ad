"""Equilibria, modes or runs over a grid of values."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

from compiler.api import Study

from ..analysed_model import AnalysedModel
from ..analysis.outcome import Outcome
from ..errors import UsageError
from .experiment import made, with_texts
from .experiment_study import ExperimentStudy
from .scalar_study import ScalarStudy, check_steps, compilation_notes, quantities_of
from .workers import ALONE, Workers

MOST_POINTS = 1_000_000


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
    shown = {r.name: (r.unit, r.scale, r.offset) for r in plan.report}
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
        raise UsageError("BR499", f"`{name}` cannot be `{wrong[0]}`;", f"it can be {', '.join(words)}")
    return tuple(numbers[v] for v in stripped)


def _texts(values: str | Sequence[str | float], name: str) -> tuple[str, ...]:
    """Return the texts that stand in quotation marks. Raises `UsageError`."""
    some = re.findall(r'"[^"]*"|[^\s,][^,]*', values) if isinstance(values, str) else values
    if wrong := [v for v in some if not re.fullmatch(r'\s*"[^"]+"\s*', str(v))]:
        raise UsageError("BR499", f"`{name}` cannot be `{wrong[0]}`;", "it can be texts in quotation marks")
    return tuple(str(v).strip().strip('"') for v in some)


def _numbers(values: str | Sequence[str | float], unit: str, name: str) -> tuple[float, ...]:
    """Return values in SI, of the unit's kind. Raises `UsageError`."""
    from ..quantities import quantities, quantity

    if isinstance(values, str):
        return tuple(quantities(values, unit, name))
    return tuple(quantity(v, unit, name) for v in values)
