"""`bondgraph stress`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import AnalysisCall, analysis
from .error_reporting import FAILED
from .options import settings_by_name, show_progress


@analysis("stress", checked=False)
@click.option("--for", "duration", default="30 s", metavar="TIME", help="How long to try (30 s).")
@click.option("--vary", multiple=True, metavar='"NAME=LOW .. HIGH"', help="Try the corners of this range, also of a start (`start x`).")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, metavar="N", help="Seed of what is drawn (0).")
@click.option("--out", metavar="FOLDER", help="Write the smallest files that show what broke; a third of the time is for them.")  # fmt: skip
@click.option("--to", metavar="TIME", help="Where the run ends.")
def command(asked: AnalysisCall, duration: str, vary: Sequence[str], seed: int, to: str | None) -> None:
    """Try a model with changes that must keep its results; exit code 3 if one of them does not."""
    from ..simulation.run_options import seconds

    ranges = settings_by_name(vary, "--vary", "k=1 N/m .. 2 N/m")
    test = asked.model.stress(
        seconds=seconds(duration), to=to, outputs=asked.outputs, vary=ranges, seed=seed, out=asked.files.out, progress=show_progress, **asked.keywords
    )  # fmt: skip
    show_progress("")
    asked.print(test)
    if not test.holds:
        raise click.exceptions.Exit(FAILED)
