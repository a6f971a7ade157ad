"""`bondgraph sweep`."""

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


@click.command("sweep")
@file_argument
@click.option(
    "--over", "over", multiple=True, required=True, metavar='"NAME=V, V…"',
    help="Values of a parameter or input: `k=1 N/m, 2 N/m`, or `k=1 N/m .. 2 N/m : 11`; several times: a grid.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]), help="What is made at each point (simulate)."
)  # fmt: skip
@click.option("--together", is_flag=True, help="No grid: the first values of all, the second ones and so on.")
@outputs_option
@analysed_option
@settings_option
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="S.csv|.npz|.nc|.mat", help="Write the table.")
@click.option("--plot", metavar="S.png", help="Draw what was found over what was swept last (.png, .svg or .pdf).")
@json_option
@model_option
def command(
    file: str, over: Sequence[str], of: Sequence[str], together: bool, outputs: Sequence[str], experiment: str, settings: Sequence[str],
    to: str | None, jobs: int | None, journal: str | None, out: str | None, plot: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Make equilibria, modes or runs at many values of parameters and inputs."""
    with problems_told():
        for path, endings, option in ((out, TABLES, "--out"), (plot, (".png", ".svg", ".pdf"), "--plot")):
            if path is not None:
                check_target(path, endings, option)
        values = dict(map(setting, over))
        with shared_out(jobs, journal, "points") as sharing:
            found = load(file, model).sweep(
                values, tuple(of) or "simulate", together, named(experiment), dict(map(setting, settings)), to,
                outputs=tuple(outputs) or None, sharing=sharing,
            )  # fmt: skip
        if out is not None:
            found.write(out)
        if plot is not None:
            found.plot(plot)
        echo(found, as_json)
