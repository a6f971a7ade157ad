"""`bondgraph sweep`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import jobs_option, journal_option, settings_by_name, shared_out


@analysis("sweep")
@click.option(
    "--over", "over", multiple=True, required=True, metavar='"NAME=V, V…"',
    help="Values of a parameter or input: `k=1 N/m, 2 N/m`, or `k=1 N/m .. 2 N/m : 11`; several times: a grid.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]), help="What is made at each point (simulate)."
)  # fmt: skip
@click.option("--together", is_flag=True, help="No grid: the first values of all, the second ones and so on.")
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="S.csv|.npz|.nc|.mat|-", help="Write the table; `-` prints it as CSV.")
@picture_option("S.png", "Draw what was found over what was swept last")
@click.option("--curves", metavar="C.png", help="Draw all runs over time: a curve for each, bands of more than twelve.")
def command(
    asked: AnalysisCall, over: Sequence[str], of: Sequence[str], together: bool, to: str | None, jobs: int | None, journal: str | None
) -> None:  # fmt: skip
    """Make equilibria, modes or runs at many values of parameters and inputs."""
    values = settings_by_name(over, "--over", "k=1 N/m, 2 N/m")
    with shared_out(jobs, journal) as workers:
        found = asked.model.sweep(
            values, tuple(of) or "simulate", together, workers=workers, to=to, outputs=asked.outputs, **asked.keywords
        )  # fmt: skip
    asked.answer(found)
