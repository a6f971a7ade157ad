"""Experiments of a model as data: single runs are plotted over time, others over their swept values, or described in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from compiler.api import CompilationFailed

from ...compiled_scene import many_runs
from ...errors import MissingPackage, RunFailed, UsageError
from ...studies.experiment import run
from ...studies.options import Options
from ..text.tables import short, shown_unit, visible
from .author_units import author_units
from .markup import Html, table, tag
from .numbers import packed
from .runs import OUTPUTS, PageModel, run_data

if TYPE_CHECKING:
    from ...analysed_model import AnalysedModel
    from ...analysis.outcome import Outcome
    from ...results.records import EnergyBalance
    from ...results.result import Result

PROBLEMS = (CompilationFailed, UsageError, RunFailed, MissingPackage)


def one_run(watched: PageModel, name: str) -> bool:
    """Return True if an experiment is a single run over time."""
    scene = watched.model.scene(name)
    plan = watched.model.compilation(scene).plan
    return many_runs(plan, scene) is None and plan.stop is not None


def experiment_data(watched: PageModel, name: str, settings: Mapping[str, float] | None = None) -> dict[str, Any]:
    """Return an experiment as data; errors are shown in its place."""
    try:
        if one_run(watched, name):
            result = watched.simulate(name, settings, energy=True, error=True)
            balance = _balance(result.energy) if result.energy is not None else ""
            told = Html(_errors(result, watched.outputs(name)) + balance)
            return {"name": name, "kind": "run", "run": run_data(watched, name, result), "told": told}
        outcome = run(watched.model, name, settings or {}, Options())
        return {"name": name, "kind": "told", "told": _pre(outcome.summary()), **_plotted(watched.model, outcome)}
    except PROBLEMS as problem:
        return {"name": name, "kind": "failed", "told": _pre(visible_lines(str(problem)))}


def visible_lines(words: str) -> str:
    """Return text of several lines without characters that would change the reading direction."""
    return "\n".join(map(visible, words.split("\n")))


def _pre(words: str) -> Html:
    return tag("pre", words)


def _errors(result: Result, names: Sequence[str]) -> Html:
    """Return the estimated error of each output in the units of the report, and relative to its magnitude."""
    error = result.error
    if error is None or error.failure:
        return tag("p", f"No estimate of the error: {error.failure}") if error is not None else Html("")
    share = {row.name: row.share for row in error.outputs}
    rows = [
        (short(i.name), shown_unit(i.unit), f"{error.of(i.name) * i.scale:.2g}", f"{share[i.name]:.2g}")
        for i, _ in result.shown()
        if i.name in names
    ]
    worst = max((share[name] for name in names if name in share), default=0.0)
    summary = tag("summary", f"estimated errors of the outputs; the largest is {worst:.2g} of the output's magnitude")
    return tag("details", summary, table(rows, ("output", "unit", "error", "of its magnitude")))


def _balance(balance: EnergyBalance) -> Html:
    """Return the supplied, stored and dissipated energy, element by element."""
    rows = [
        (e.name, e.kind, *(f"{v:.4g}" if v else "" for v in (e.supplied, e.stored, e.dissipated)))
        for e in balance.elements[:200]
    ]
    rows.append(("sum", "", *(f"{v:.6g}" for v in (balance.supplied, balance.stored, balance.dissipated))))
    summary = tag("summary", f"energy balance of the whole run; what it leaves unexplained: {balance.residual:.3g} J")
    return tag("details", summary, table(rows, ("element", "", "supplied, J", "stored, J", "dissipated, J")))


def _plotted(model: AnalysedModel, outcome: Outcome) -> dict[str, Any]:
    """Return a sweep over one name as curves over it, or the runs of its points over time."""
    import numpy as np

    if len(outcome.swept) != 1 or len(outcome.points) < 2:
        return {}
    ((swept, (unit, scale)),) = author_units(model, outcome.swept).items()
    values = [float(f"{scale.from_si(p.settings[swept]):.12g}") for p in outcome.points]
    names = [f"{short(swept)} = {v:.4g} {visible(unit)}".rstrip() for v in values]
    runs = [(at, p.run) for at, p in zip(names, outcome.points, strict=True) if p.run is not None]
    family = bool(runs) and all(np.array_equal(r.time, runs[0][1].time) for _, r in runs)
    curves = list(_runs(runs) if family else _values(outcome, swept))
    if not curves:
        return {}
    return {
        "plot": {
            "axis": None if family else {"name": short(swept), "unit": visible(unit)},
            "time": packed(runs[0][1].time if family else values, single=False),
            "outputs": [{"name": n, "unit": "" if u == "1" else u} for n, u, _ in curves],
            "values": packed([v for _, _, v in curves], single=False),
        }
    }


def _runs(runs: Sequence[tuple[str, Result]]) -> Iterator[tuple[str, str, Any]]:
    """Yield each output of each run over time, if they are few; the runs are named and have equal instants."""
    for item, _ in runs[0][1].shown()[: max(1, OUTPUTS // len(runs))]:
        for at, result in runs[:OUTPUTS]:
            yield (
                f"{short(item.name, 30)}, {at}",
                visible(item.unit),
                result[item.name] * item.scale + item.offset,
            )


def _values(outcome: Outcome, swept: str) -> Iterator[tuple[str, str, Any]]:
    units = outcome.units
    for name in [n for n in outcome.names if n != swept][:OUTPUTS]:
        unit, scale, offset = outcome.shown.get(name, (units[name], 1.0, 0.0))
        yield short(name), visible(unit), outcome(name) * scale + offset
