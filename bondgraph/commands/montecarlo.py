"""`bondgraph montecarlo`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    TABLES,
    analysed_option,
    check_target,
    echo,
    file_argument,
    jobs_option,
    journal_option,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    setting,
    settings_option,
    shared_out,
)
from .telling import problems_told


@click.command("montecarlo")
@file_argument
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
@outputs_option
@analysed_option
@settings_option
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="M.csv|.npz|.nc|.mat", help="Write all points.")
@click.option("--plot", metavar="H.png", help="Draw histograms (.png, .svg or .pdf).")
@click.option("--tornado", metavar="T.png", help="Draw what moves each quantity, and how far.")
@json_option
@model_option
def command(
    file: str, vary: Sequence[str], correlations: Sequence[str], of: Sequence[str], samples: int, seed: int, indices: int | None,
    outputs: Sequence[str], experiment: str, settings: Sequence[str], to: str | None, jobs: int | None, journal: str | None,
    out: str | None, plot: str | None, tornado: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Tell what tolerances of parameters do to rest, frequencies or runs: statistics, Sobol indices, swings."""
    with problems_told():
        pictures = (".png", ".svg", ".pdf")
        for path, endings, option in (
            (out, TABLES, "--out"), (plot, pictures, "--plot"), (tornado, pictures, "--tornado")
        ):  # fmt: skip
            if path is not None:
                check_target(path, endings, option)
        with shared_out(jobs, journal, "points") as sharing:
            found = load(file, model).montecarlo(
                dict(map(setting, vary)), tuple(of) or "modes", samples, dict(map(_correlation, correlations)), seed, indices,
                named(experiment), dict(map(setting, settings)), tuple(outputs) or None, to, sharing=sharing,
            )  # fmt: skip
        if out is not None:
            found.write(out)
        if plot is not None:
            found.plot(plot)
        if tornado is not None:
            found.plot_tornado(tornado)
        echo(found, as_json)


def _correlation(text: str) -> tuple[tuple[str, str], float]:
    names, sign, value = text.partition("=")
    one, comma, other = names.partition(",")
    try:
        if sign and comma and one.strip() and other.strip():
            return (one.strip(), other.strip()), float(value)
    except ValueError:
        pass  # no number: the same answer
    raise click.UsageError(f"--correlation takes NAME, NAME=R with R from -1 to 1; this is `{text}`")
