"""`bondgraph modes`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    analysed_option,
    check_target,
    echo,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    seconds_of,
    setting,
    settings_option,
    state_option,
    time_option,
)
from .telling import problems_told


@click.command("modes")
@file_argument
@state_option
@click.option(
    "--plot", metavar="M.svg", help="Draw the shapes on the mechanism, rest behind them (.svg, .png or .pdf)."
)
@click.option("--mechanism", metavar="NAME", help="Of this mechanism, if there are several.")
@click.option("--shapes", type=click.IntRange(1, 60), default=6, metavar="N", help="How many shapes are drawn (6).")
@analysed_option
@settings_option
@time_option
@json_option
@model_option
def command(
    file: str, state: str, plot: str | None, mechanism: str | None, shapes: int, experiment: str, settings: Sequence[str], time: str | None,
    as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Print frequencies, damping, and where the energy of each mode is; draw their shapes."""
    with problems_told():
        if plot is not None:
            check_target(plot, (".svg", ".png", ".pdf"), "--plot")
            if settings or state != "equilibrium" or time is not None:
                raise click.UsageError("--plot draws the modes at rest: set in an experiment what is to be set")
            load(file, model).draw_mechanism(plot, mechanism, named(experiment), modes=shapes)
        found = load(file, model).modes(named(experiment), dict(map(setting, settings)), state, seconds_of(time))
        echo(found, as_json)
