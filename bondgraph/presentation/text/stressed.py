"""Stress tests as plain text for terminals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .analyses import title
from .tables import aligned, visible

if TYPE_CHECKING:
    from ...studies.stressed import StressTest


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
