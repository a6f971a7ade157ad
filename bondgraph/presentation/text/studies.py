"""Studies as plain text for terminals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .analyses import ReportedUnits, title
from .tables import aligned, digits_of_time, short, visible

if TYPE_CHECKING:
    from ...analysis.run_sensitivity import RunSensitivity
    from ...studies.comparison import CurveComparison
    from ...studies.fitted import Fit
    from ...studies.stressed import StressTest
    from ...studies.tolerances import MonteCarlo
    from ...studies.work_precision import WorkPoint, WorkPrecision

STRONGEST = 8  # most parameters of a quantity
SLIGHT = 0.05  # smaller weights in a direction are not shown
VAGUE = 0.3  # relative standard deviation from which on a direction is reported


def comparison_text(comparison: CurveComparison) -> str:
    """Return the differences of each output from the run, in the units that the run shows."""
    shown = {item.name: item for item, _ in comparison.run.shown()}
    rows: list[tuple[str, ...]] = [
        ("", "against", "largest difference", "at [s]", "of magnitude", "root mean square", "unit")
    ]
    for d in comparison.differences:
        scale, unit = shown[d.output].scale, shown[d.output].unit
        share = f"{d.largest / d.magnitude:.2g}" if d.magnitude else ""
        numbers = (
            f"{d.largest * scale:.6g}",
            f"{d.at:.{digits_of_time(comparison.run.time)}g}",
            share,
            f"{d.root_mean_square * scale:.6g}",
        )
        rows.append((short(d.output), short(d.other), *numbers, "" if unit == "1" else visible(unit)))
    if len(rows) == 1:
        return "no instant of the others lies within the run"
    return aligned(rows, "<<>>>><")


def montecarlo_text(found: MonteCarlo) -> str:
    """Return statistics of each quantity, then its strongest parameters."""
    count = f"{len(found)} points, seed {found.seed}"
    parts = [title(found.model, found.experiment, count), _statistics(found)]
    parts += [_shares(found, i) for i in range(len(found.quantities))]
    parts += [visible(note) for note in found.notes]
    return "\n\n".join(parts)


def _statistics(found: MonteCarlo) -> str:
    rows: list[tuple[str, ...]] = [("", "unit", "mean", "standard deviation", "2.5 %", "median", "97.5 %")]
    for name in found.quantities:
        told = found.statistics(name)
        unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
        numbers = [told.get(w, np.nan) * scale + offset for w in ("mean", "2.5 %", "50 %", "97.5 %")]
        mean, *quantiles = (f"{x:.7g}" for x in numbers)
        deviation = told.get("standard deviation", np.nan) * scale
        spread = f"{deviation:.4g}" if np.isfinite(deviation) else "not determined"
        rows.append((short(name), "" if unit == "1" else visible(unit), mean, spread, *quantiles))
    return aligned(rows, "<<>>>>>")


def _shares(found: MonteCarlo, i: int) -> str:
    """Return the parameters in the order of their swing of a quantity."""
    name = found.quantities[i]
    low, high = (f"{100 * t:g} %" for t in found.swing.tails)
    head = [f"what moves {short(name)}", f"at {low}", f"at {high}"]
    if found.indices is not None:
        head += ["alone", "in all", "+-"]
    ends = found.swing.ends[i] - found.swing.middle[i]
    order = np.argsort(-np.nan_to_num(np.abs(ends).max(axis=1), nan=-1.0), kind="stable")[:STRONGEST]
    scale = found.shown.get(name, ("", 1.0, 0.0))[1]
    rows = [tuple(head)]
    for j in order:
        row = [short(found.parameters[j]), *(f"{x * scale:+.4g}" for x in ends[j])]
        if found.indices is not None:
            around = found.indices.total_interval[i, j]
            row += [_share(found.indices.first[i, j]), _share(found.indices.total[i, j])]
            row += [f"{50 * (around[1] - around[0]):.1f} %" if np.isfinite(found.indices.total[i, j]) else ""]
        rows.append(tuple(row))
    return aligned(rows, "<" + ">" * (len(head) - 1))


def _share(value: float) -> str:
    return f"{100 * value:.1f} %" if np.isfinite(value) else "not determined"


def fit_text(found: Fit) -> str:
    """Return parameters, quality of the fit, undetermined directions, explanations."""
    parts = [title(found.model, found.experiment, "fitted"), _parameters(found), _met(found)]
    if any(d.open or d.deviation > VAGUE for d in found.directions):
        parts.append(_open(found))
    if found.explanations:
        parts.append(_explanations(found))
    return "\n\n".join([*parts, *map(visible, found.notes)])


def _parameters(found: Fit) -> str:
    rows = [("", "value", "", "standard error", "from (95 %)", "to", "change")]
    for p in found.parameters:
        change = f"{100 * (p.value / p.start - 1):+.3g} %" if p.start else ""
        numbers = (f"{p.error:.3g}", f"{p.low:.6g}", f"{p.high:.6g}")
        rows.append((short(p.name), f"{p.value:.9g}", "" if p.unit == "1" else visible(p.unit), *numbers, change))
    return aligned(rows, "<><>>>>")


def _met(found: Fit) -> str:
    rows = [("", "data", "root mean square of differences", "")]
    for one, computed in zip(found.series, found.computed, strict=True):
        left = float(np.sqrt(np.mean((computed - one.measured) ** 2)))
        size = float(np.sqrt(np.mean(one.measured**2)))
        told = f"{left:.4g}{'' if one.unit == '1' else f' {visible(one.unit)}'}"
        rows.append((short(one.name), f"{len(one.rows)}", told, f"{100 * left / size:.3g} %" if size else ""))
    return aligned(rows, "<>>>")


def _open(found: Fit) -> str:
    lines = ["what the data hardly tell (relative changes that go together):"]
    for direction in found.directions:
        if direction.open or direction.deviation > VAGUE:
            named = ", ".join(
                f"{short(n, 24)} {w:+.2f}" for n, w in list(direction.weights.items())[:STRONGEST] if abs(w) > SLIGHT
            )
            how = "nothing" if direction.open else f"known to {100 * direction.deviation:.3g} %"
            lines.append(f"  {named}: {how}")
    return "\n".join(lines)


def _explanations(found: Fit) -> str:
    rows = [("explained by", "changes", "left over")]
    for one in found.explanations:
        changes = ", ".join(f"{100 * x:+.3g} %" for x in one.changes.values())
        names = ", ".join(short(n, 24) for n in one.changes) or "(as it is)"
        rows.append((names, changes, f"{100 * one.left:.3g} %"))
    return aligned(rows, "<<>")


def run_sensitivity_text(found: RunSensitivity) -> str:
    """Return for each output the effect of one percent of a parameter: at the end, and at most during the run."""
    rows = [("", "by", "at the end", "", "1 % moves it by", "at most", "at")]
    reported = ReportedUnits(found)
    for i, name in enumerate(found.outputs):
        unit, scale, _ = reported(name)
        for j, parameter in enumerate(found.parameters):
            column = found.slopes[:, i, j] * scale
            share, peak = 0.01 * found.at[j], int(np.argmax(np.abs(column)))
            moved = (
                f"{share * column[-1]:.4g}",
                f"{share * column[peak]:.4g}",
                f"{found.time[peak]:.{digits_of_time(found.time)}g} s",
            )
            rows.append(
                (
                    short(name),
                    short(parameter),
                    f"{column[-1]:.7g}",
                    f"[{visible(unit)}]/[{visible(found.units[parameter])}]",
                    *moved,
                )
            )
    return f"{title(found.model, found.experiment, 'sensitivity of a run')}\n\n{aligned(rows, '<<><>>>')}"


def stress_text(test: StressTest) -> str:
    """Return a table with a row for each kind of change, the breaks with their files, and the conclusion."""
    rows = [("", "tried", "held", "broke", "")]
    for row in test.rows:
        untried = "" if row.tried or not row.untried else f" ({row.untried[0]})"
        rows.append((row.kind, str(row.tried), str(row.held), str(row.broke), visible(row.changed + untried)[:120]))
    estimate = (
        f"no estimate of the error: {test.doubt}" if test.doubt else f"estimated error of the run: {test.error:.1e}"
    )
    parts = [title(test.model, test.experiment, "stress test"), aligned(rows, "<>>><"), visible(estimate)]
    for item in test.breaks:
        files = f"\n  smallest files that show it: {', '.join(item.files)}" * bool(item.files)
        parts.append(visible(f"{item.kind}, {item.change}: {item.sentence}") + files)
    return "\n\n".join([*parts, f"{test.sentence} ({test.seconds:.0f} s, seed {test.seed})"])


def work_precision_text(found: WorkPrecision) -> str:
    """Return a table with a row for each solver and tolerance, the references, and the recommendation."""
    best = found.recommended
    rows: list[tuple[str, ...]] = [("solver", "rtol", "error", "time, ms", "steps", "evaluations", "")]
    for solver in found.solvers:
        points = [point for point in found.points if point.solver == solver]
        rows += [_row(point, solver if point is points[0] else "", point is best) for point in points]
    agree = "" if math.isnan(found.agreement) else f", which differ by {found.agreement:.1e}"
    parts = [
        title(found.model, found.experiment, "work and precision"), aligned(rows, "<>>>>><"),
        f"errors beside {' and '.join(found.references)}{agree}; of outputs, relative to their largest magnitudes",
        "times of a repeated run: program, magnitudes and start are known, to the solvers of other programs, too",
        *(visible(f"{solver}: {reason}") for solver, reason in found.refused.items()), found.sentence,
    ]  # fmt: skip
    return "\n\n".join(parts)


def _row(point: WorkPoint, solver: str, best: bool) -> tuple[str, ...]:
    if point.failure:
        return solver, f"{point.rtol:g}", "", "", "", "", visible(point.failure)[:60]
    rtol = "" if point.solver == "exponential" else f"{point.rtol:g}"
    return (
        solver, rtol, f"{point.error:.1e}", f"{1e3 * point.seconds:.3g}", str(point.steps or ""), str(point.evaluations or ""), "<- recommended" * best,
    )  # fmt: skip
