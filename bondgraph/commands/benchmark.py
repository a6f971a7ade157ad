"""`bondgraph benchmark`."""

from __future__ import annotations

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import show_progress


@analysis("benchmark")
@click.option(
    "--error",
    type=float,
    default=1e-6,
    metavar="X",
    help="The wanted error of each output relative to its magnitude (1e-6).",
)
@click.option("--rounds", type=click.IntRange(1), default=3, metavar="N", help="How often each run is timed (3).")
@click.option("--alone", is_flag=True, help="Without the solvers of other programs over the same equations.")
@click.option("--to", metavar="TIME", help="Where the run ends.")
@picture_option("W.png", "Draw run time against error")
def command(asked: AnalysisCall, error: float, rounds: int, alone: bool, to: str | None) -> None:
    """Run an experiment with every solver at every tolerance: time, error, and which to take."""
    found = asked.model.benchmark(
        error=error, rounds=rounds, peers=not alone, to=to, outputs=asked.outputs, progress=show_progress, **asked.keywords
    )  # fmt: skip
    show_progress("")
    asked.answer(found)
