"""Work and precision as plain text for terminals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .analyses import title
from .tables import aligned, visible

if TYPE_CHECKING:
    from ...studies.work_precision import WorkPoint, WorkPrecision


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
