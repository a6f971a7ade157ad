"""3. The error follows the tolerance, in every model of the gallery: its slope, its scatter, and where it saturates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from compiler.errors import CompilationFailed
from tests.stress.report import Section, shown
from tests.stress.trial import TooLong, within

MODELS = Path(__file__).resolve().parents[2] / "models"
TOLERANCES = tuple(10.0**-k for k in range(3, 11))
REFERENCE = 1e-12
SLOPES, SCATTER, ROUNDINGS = (0.7, 1.4), 5.0, 100
LONGEST = 120.0
SLIGHT = 1e-2
SHORT = ("duffing", "pendulum", "van_der_pol", "drag")


def section(short: bool, folder: Path) -> Section:
    """All models of the gallery."""
    found = Section("3. The error follows the tolerance")
    found.say(
        f"The error of all outputs against a run at rtol = {REFERENCE:g}, at rtol = 1e-3 … 1e-10, as in section 1 but in itself. The slope is that of a straight "
        f"line through the logarithms of those above {ROUNDINGS} times round-off (the difference of two runs near the reference), the scatter the largest factor "
        f"between an error and that line. Slopes of {SLOPES[0]} to {SLOPES[1]} and a scatter below {SCATTER:g} are wanted; models that are solved exactly have none."
    )
    rows = []
    curves: list[tuple[str, Any]] = []
    for path in sorted(MODELS.glob("*.bg")):
        if short and path.stem not in SHORT:
            continue
        found.tried += 1
        try:
            row, errors = _one(found, path)
        except CompilationFailed as failed:  # a file of parts, which says so
            found.say(f"{path.stem} has no run of its own: {failed.diagnostics[0].sentence}.")
            continue
        except (RunFailed, TooLong) as failed:
            found.refuse(path.stem, str(failed) or f"no end within {LONGEST:g} s")
            continue
        if row is not None:
            print("  ", path.stem, *map(shown, row), flush=True)
            rows.append([path.stem, *row])
            curves.append((path.stem, errors))
    heads = ["model", "solver", "slope", "scatter", "floor", *(f"{t:.0e}" for t in TOLERANCES)]
    found.table(heads, rows)
    if not short:
        picture = _picture(curves, folder)
        if picture is not None:
            found.picture(picture, "errors over the tolerance")
    return found


def _run(model: bondgraph.Model, rtol: float) -> bondgraph.Result:
    with within(LONGEST):
        return model.simulate(rtol=rtol, points=41)


def _references(model: bondgraph.Model) -> tuple[bondgraph.Result, bondgraph.Result]:
    """The reference and a run near it; ten times less where doubles cannot hold it."""
    try:
        return _run(model, REFERENCE), _run(model, 3 * REFERENCE)
    except RunFailed as failed:
        if "round-off" not in str(failed):
            raise
        return _run(model, 10 * REFERENCE), _run(model, 30 * REFERENCE)


def difference(a: bondgraph.Result, b: bondgraph.Result) -> float:
    """The largest difference of outputs, as a share of each output's largest value; b is the reference.

    An output that is the difference of others is measured by a share of theirs: of the largest of the same unit."""
    worst = 0.0
    largest = {name: float(np.abs(b[name]).max(initial=0.0)) for name in b.names}
    for name in a.names:
        size = max(largest[name], SLIGHT * max(v for n, v in largest.items() if b.unit(n) == b.unit(name)))
        if size > 0:
            worst = max(worst, float(np.abs(a[name] - b[name]).max() / size))
    return worst


def _one(found: Section, path: Path) -> tuple[list[Any] | None, Any]:
    """A row of the table and the errors; None for files without a run."""
    model = bondgraph.load(path)
    try:
        reference, near = _references(model)
    except UsageError:
        found.say(f"{path.stem} has no run of its own.")
        return None, None
    floor = max(difference(near, reference), 4e-16)
    if "Radau" not in reference.solver and "Dormand" not in reference.solver:
        return [reference.solver, "", "", floor, *[""] * len(TOLERANCES)], None
    errors = np.array([difference(_run(model, t), reference) for t in TOLERANCES])
    counted = errors > max(ROUNDINGS * 2e-16, 10 * floor)
    slope = scatter = float("nan")
    if counted.sum() >= 3:
        x, y = np.log10(np.array(TOLERANCES)[counted]), np.log10(errors[counted])
        slope, offset = np.polyfit(x, y, 1)
        scatter = float(10 ** np.abs(y - slope * x - offset).max())
        if not SLOPES[0] <= slope <= SLOPES[1]:
            found.fail(f"{path.stem}: slope", f"{slope:.2f}; errors {', '.join(f'{e:.1e}' for e in errors)}")
        if not scatter < SCATTER:
            found.fail(
                f"{path.stem}: scatter", f"a factor of {scatter:.1f}; errors {', '.join(f'{e:.1e}' for e in errors)}"
            )
    return [reference.solver, float(slope), scatter, floor, *map(float, errors)], errors


def _picture(curves: list[tuple[str, Any]], folder: Path) -> Path | None:
    """All errors over the tolerance."""
    try:
        import matplotlib
    except ImportError:
        return None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 5))
    for name, errors in curves:
        if errors is not None:
            axes.loglog(TOLERANCES, np.maximum(errors, 1e-16), marker=".", linewidth=0.8, label=name)
    axes.loglog(TOLERANCES, TOLERANCES, color="black", linewidth=2, label="error = rtol")
    axes.set_xlabel("rtol")
    axes.set_ylabel("largest error")
    axes.grid(True, alpha=0.3)
    axes.legend(fontsize=5, ncol=3)
    figure.tight_layout()
    path = folder / "proportion.png"
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
