"""Experiments of a model as data: single runs are plotted over time, others over their swept values, or described in words.

Curves are over what is swept, a frequency, the parameter of a branch, the share of random points, the lines of measured data. Units are those of
the author: the one behind the colon of a quantity, else that of the first number of the same kind.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from compiler.api import Array, CompilationFailed

from ...author_units import author_units
from ...compiled_scene import many_runs
from ...errors import MissingPackage, RunFailed, UsageError
from ...results.records import EnergyBalance
from ...results.result import Result
from ...simulation.run_options import RunRequest
from ...studies.experiment import run
from ..text.tables import short, shown_unit, visible
from .markup import Html, preformatted, table, tag
from .runs import OUTPUTS, PageModel, packed, run_data

if TYPE_CHECKING:
    from ...analysed_model import AnalysedModel
    from ...analysis.branch import Branch
    from ...analysis.outcome import Outcome
    from ...analysis.response import Response
    from ...studies.fitted import Fit
    from ...studies.tolerances import MonteCarlo

PROBLEMS = (CompilationFailed, UsageError, RunFailed, MissingPackage)
Curve = tuple[str, str, Array]  # name, unit, values
SHARES = 201  # points of a distribution


Axis = tuple[str, str, bool] | None  # name, unit, logarithmic; None: the time
Plot = tuple[Axis, Any, list[Curve]]  # what curves are drawn over, its values, the curves
NOTHING: Plot = (None, (), [])


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
    return preformatted(run(watched.model, RunRequest(name, settings or {})).summary())


def experiment_data(watched: PageModel, name: str, settings: Mapping[str, float] | None = None) -> dict[str, Any]:
    """Return an experiment as data; errors are shown in its place."""
    try:
        if one_run(watched, name):
            result = watched.simulate(name, settings, energy=True, error=True)
            balance = _balance(result.energy) if result.energy is not None else ""
            told = Html(beside_run(watched, name, settings) + _errors(result, watched.outputs(name)) + balance)
            return {"name": name, "kind": "run", "run": run_data(watched, name, result), "told": told}
        outcome = run(watched.model, RunRequest(name, settings or {}))
        told = preformatted(outcome.summary())
        return {"name": name, "kind": "told", "told": told, **outcome_plot(watched.model, outcome)}
    except PROBLEMS as problem:
        return {"name": name, "kind": "failed", "told": preformatted(str(problem))}


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


def outcome_plot(model: AnalysedModel, outcome: Outcome) -> dict[str, Any]:
    """Return `{"plot": …}` of a sweep over one name, or of the first analysis that has curves; nothing without one."""
    axis, values, curves = _swept(outcome) if outcome.swept else _analysed(model, outcome)
    curves = curves[:OUTPUTS]
    if not curves:
        return {}
    axis_data = {"name": short(axis[0]), "unit": shown_unit(axis[1]), "log": axis[2]} if axis else None
    return {
        "plot": {
            "axis": axis_data, "time": packed(values, single=False),
            "outputs": [{"name": visible(n), "unit": shown_unit(u)} for n, u, _ in curves],
            "values": packed([v for _, _, v in curves], single=False),
        }
    }  # fmt: skip


def _swept(outcome: Outcome) -> Plot:
    """Return the runs of a sweep over time, if they have equal instants, else what each point gives over the swept values."""
    import numpy as np

    if len(outcome.swept) != 1 or len(outcome.points) < 2:
        return NOTHING
    ((swept, unit),) = outcome.swept.items()
    _, unit, values = _curve(outcome, swept, outcome(swept), unit)
    runs = [(f"{short(swept)} = {outcome.in_words(p.settings)[swept]}", p.run) for p in outcome.points]
    finished = [(at, run) for at, run in runs if run is not None]
    if not finished or any(not np.array_equal(run.time, finished[0][1].time) for _, run in finished):
        return (swept, unit, False), values, [_curve(outcome, n, outcome(n)) for n in outcome.names if n != swept]
    items = [item for item, _ in finished[0][1].shown()[: max(1, OUTPUTS // len(finished))]]
    curves = [
        (f"{short(i.name, 30)}, {at}", i.unit, run[i.name] * i.scale + i.offset) for i in items for at, run in finished
    ]
    return None, finished[0][1].time, curves


def _curve(outcome: Outcome | MonteCarlo, name: str, values: Array, unit: str = "1") -> Curve:
    """Return values in SI as they are reported."""
    unit, scale, offset = outcome.shown.get(name, (outcome.units.get(name, unit), 1.0, 0.0))
    return short(name), unit, values * scale + offset


def _analysed(model: AnalysedModel, outcome: Outcome) -> Plot:
    """Return the first analysis that has curves."""
    from ...analysis.branch import Branch
    from ...analysis.inversion.feed_forward import FeedForward
    from ...analysis.modes import Modes
    from ...analysis.response import Response
    from ...studies.fitted import Fit
    from ...studies.tolerances import MonteCarlo
    from ..plots.bode import stems
    from ..plots.over_time import along_path

    for result in (
        x for p in outcome.points for x in (*p.responses, *(analysis for _, analysis in p.analyses), p.modes)
    ):
        if isinstance(result, Response):
            return ("frequency", "Hz", True), result.frequencies, list(_response(result))
        if isinstance(result, Branch):
            name = result.parameter
            unit, scale = author_units(model, {name: result.units.get(name, "1")})[name]
            return (name, unit, False), [scale.from_si(v) for v in result.values], list(_branch(outcome, result))
        if isinstance(result, MonteCarlo):
            return _shares(result)
        if isinstance(result, FeedForward):
            groups = along_path(result).items()
            return None, result.time, [(short(n), unit, v) for (_, unit), some in groups for n, v in some]
        if isinstance(result, Fit):
            return _fitted(outcome, result)
        if isinstance(result, Modes):
            frequencies, damping = stems(result)
            return ("frequency", "Hz", True), frequencies, [("damping ratio", "1", damping)][: len(damping)]
    return NOTHING


def _response(found: Response) -> Iterator[Curve]:
    """Yield magnitudes in dB, and phases."""
    import numpy as np

    from ..plots.bode import with_cut_dips

    phase = found.phase
    for j, given in enumerate(found.inputs):
        for i, seen in enumerate(found.outputs):
            magnitude, cut = with_cut_dips(found.magnitude[:, i, j])
            with np.errstate(divide="ignore"):
                decibels = 20 * np.log10(magnitude)
            yield f"{short(given)} to {short(seen)}{cut}", f"dB of {found.unit(given, seen)}", decibels
            yield f"phase of {short(given)} to {short(seen)}", "deg", phase[:, i, j]


def _branch(outcome: Outcome, found: Branch) -> Iterator[Curve]:
    """Yield the outputs along a branch, where they are unstable as curves of their own."""
    import numpy as np

    for name, values in found.outputs.items():
        label, unit, shown = _curve(outcome, name, values, found.units.get(name, "1"))
        yield label, unit, np.where(found.unstable, np.nan, shown)
        if found.unstable.any():
            yield f"{label}, unstable", unit, np.where(found.unstable, shown, np.nan)


def _shares(found: MonteCarlo) -> Plot:
    """Return the value below which a share of the random points lies, for each quantity."""
    import numpy as np

    shares, curves = np.linspace(0, 100, SHARES), []
    for name in found.quantities:
        values = found(name)[np.isfinite(found(name))]
        if len(values):
            curves.append(_curve(found, name, np.percentile(values, shares), "Hz"))
    return ("share of the points below", "%", False), shares, curves


def _fitted(outcome: Outcome, found: Fit) -> Plot:
    """Return measured and computed values over the lines of the data."""
    import numpy as np

    lines = np.arange(1 + max(max(one.rows) for one in found.series))
    curves = []
    for one, computed in zip(found.series, found.computed, strict=True):
        for word, values in (("measured", one.measured), ("computed", computed)):
            column = np.full(len(lines), np.nan)
            column[list(one.rows)] = values
            label, unit, shown = _curve(outcome, one.name, column, one.unit)
            curves.append((f"{label}, {word}", unit, shown))
    return ("line of the data", "", False), lines + 1.0, curves
