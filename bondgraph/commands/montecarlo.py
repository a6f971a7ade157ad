"""`bondgraph montecarlo`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import jobs_option, journal_option, settings_by_name, shared_out


@analysis("montecarlo")
@click.option(
    "--vary", "vary", multiple=True, required=True, metavar='"NAME=DISTRIBUTION"',
    help="`d=normal(2 um, 50 nm)`, lognormal (mean, standard deviation), uniform, triangular (low, most likely, high), truncated(one of these, low, high).",
)  # fmt: skip
@click.option(
    "--correlation", "correlations", multiple=True, metavar='"NAME, NAME=R"', help="Of a Gaussian copula; 0 if left out."
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]), help="What is made at each point (modes)."
)  # fmt: skip
@click.option("--samples", type=int, default=1000, metavar="N", help="How many points (1000).")
@click.option("--seed", type=click.IntRange(0), default=0, metavar="N", help="Of the quasi-random points (0).")
@click.option(
    "--indices", type=int, metavar="N", help="Rows that Sobol indices stand on, a power of two (1024); 0: none."
)
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="M.csv|.npz|.nc|.mat|-", help="Write all points; `-` prints them as CSV.")
@picture_option("H.png", "Draw histograms")
@click.option("--tornado", metavar="T.png", help="Draw what moves each quantity, and how far.")
def command(
    asked: AnalysisCall, vary: Sequence[str], correlations: Sequence[str], of: Sequence[str], jobs: int | None, journal: str | None, **options: Any
) -> None:  # fmt: skip
    """Tell what tolerances of parameters do to rest, frequencies or runs: statistics, Sobol indices, swings."""
    with shared_out(jobs, journal) as workers:
        found = asked.model.montecarlo(
            settings_by_name(vary, "--vary", "d=normal(2 um, 50 nm)"), tuple(of) or "modes", workers=workers,
            correlations=dict(map(_correlation, correlations)), outputs=asked.outputs, **asked.keywords, **options,
        )  # fmt: skip
    asked.answer(found)


def _correlation(text: str) -> tuple[tuple[str, str], float]:
    names, sign, value = text.partition("=")
    one, comma, other = names.partition(",")
    try:
        if sign and comma and one.strip() and other.strip():
            return (one.strip(), other.strip()), float(value)
    except ValueError:
        pass  # no number: the same answer
    raise click.UsageError(f"--correlation takes NAME, NAME=R with R from -1 to 1; this is `{text}`")
