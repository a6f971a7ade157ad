"""Experiments of a model as data: single runs are plotted over time, others over their swept values, or described in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from compiler.api import CompilationFailed

from ...compiled_scene import many_runs
from ...errors import MissingPackage, RunFailed, UsageError
from ...results.records import EnergyBalance
from ...results.result import Result
from ...simulation.run_options import RunRequest
from ...studies.experiment import run
from ..text.tables import short, shown_unit
from .markup import Html, table, tag
from .outcome_plots import outcome_plot
from .runs import PageModel, run_data

PROBLEMS = (CompilationFailed, UsageError, RunFailed, MissingPackage)


def one_run(watched: PageModel, name: str) -> bool:
    """Return True if an experiment is a single run over time, whatever is analysed beside it; a fit is many."""
    scene = watched.model.scene(name)
    plan = watched.model.compilation(scene).plan
    fits = any(study.role == "fit" for study in plan.studies)
    return many_runs(plan, scene) is None and plan.stop is not None and not fits


def beside_run(watched: PageModel, name: str, settings: Mapping[str, float] | None = None) -> Html:
    """Return in words what an experiment analyses beside its run."""
    if not watched.model.compilation(watched.model.scene(name)).plan.studies:
        return Html("")
    return tag("pre", run(watched.model, RunRequest(name, settings or {})).summary())


def experiment_data(watched: PageModel, name: str, settings: Mapping[str, float] | None = None) -> dict[str, Any]:
    """Return an experiment as data; errors are shown in its place."""
    try:
        if one_run(watched, name):
            result = watched.simulate(name, settings, energy=True, error=True)
            balance = _balance(result.energy) if result.energy is not None else ""
            told = Html(beside_run(watched, name, settings) + _errors(result, watched.outputs(name)) + balance)
            return {"name": name, "kind": "run", "run": run_data(watched, name, result), "told": told}
        outcome = run(watched.model, RunRequest(name, settings or {}))
        told = tag("pre", outcome.summary())
        return {"name": name, "kind": "told", "told": told, **outcome_plot(watched.model, outcome)}
    except PROBLEMS as problem:
        return {"name": name, "kind": "failed", "told": tag("pre", str(problem))}


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
