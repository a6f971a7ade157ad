"""The estimate of a run's error beside the error itself, for every output of the models here, at three tolerances.

    python -m tests.benchmarks errors

The error is the largest difference to a run by another method at a tolerance of 1e-12, if another run as tight differs from that by less than a thirtieth.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from bondgraph.results.result import Result
from bondgraph.simulation.repetition import compare
from compiler.solvers import SOLVERS
from tests.compiling import MODELS

RESULTS = Path(__file__).with_name("results")
TOLERANCES = (1e-4, 1e-6, 1e-8)
TIGHT, CERTAIN = 1e-12, 30.0  # ratio of an error to the disagreement of the references from which on it is one
ROUNDING = 1e-13  # of a magnitude


def references(model: bondgraph.Model, found: Result) -> list[Result]:
    """Runs as tight as possible, by another method first."""
    others = next((row.others for row in SOLVERS.values() if row.name and found.solver.startswith(row.name)), ())
    results: list[Result] = []
    for solver in (*others, None):
        try:
            results.append(model.simulate(rtol=TIGHT, solver=solver))
        except (UsageError, RunFailed):
            continue
    return results[:2]


def ratios(path: Path) -> Iterator[tuple[float, str, float, float]]:
    """Tolerance, output, its error relative to its magnitude, and how often as large the estimate is."""
    model = bondgraph.load(path)
    tight = references(model, model.simulate())
    if len(tight) < 2:
        return
    doubt = {row.name: row.difference for row in compare(*tight, TIGHT).outputs}
    for rtol in TOLERANCES:
        found = model.simulate(rtol=rtol, error=True)
        assert found.error is not None
        for row in compare(found, tight[0], TIGHT).outputs:
            if row.difference > max(CERTAIN * doubt[row.name], ROUNDING * row.magnitude) and not found.error.failure:
                yield rtol, row.name, row.share, found.error.of(row.name) / row.difference


def main() -> None:
    lines = ["# Estimated errors beside true ones", "", " ".join((__doc__ or "").split("\n\n")[2].split()), ""]
    lines += [
        "| model | rtol | outputs | largest error | estimate over error, least and most |",
        "|---|---|---:|---:|---:|",
    ]
    every: list[tuple[float, str]] = []
    for path in [*sorted(MODELS.glob("*.bg")), *sorted((MODELS / "published").glob("*.bg"))]:
        if path.stem == "mems":  # parts of others
            continue
        rows = list(ratios(path))
        every += [(ratio, f"{path.stem} {name} at {rtol:g}") for rtol, name, _, ratio in rows]
        for rtol in dict.fromkeys(r for r, *_ in rows):
            some = [row for row in rows if row[0] == rtol]
            low, high = min(r[3] for r in some), max(r[3] for r in some)
            lines.append(
                f"| {path.stem} | {rtol:g} | {len(some)} | {max(r[2] for r in some):.1e} | {low:.3g}, {high:.3g} |"
            )
        print(path.stem, len(rows), flush=True)
    within = sum(1 / 3 <= ratio <= 3 for ratio, _ in every)
    below = [f"{words} ({ratio:.2g})" for ratio, words in every if ratio < 0.1]
    lines += ["", f"{within} of {len(every)} within a factor of 3; below a tenth: {', '.join(below) or 'none'}."]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "errors.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(lines[-1])
