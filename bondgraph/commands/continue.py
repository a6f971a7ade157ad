"""`bondgraph continue`."""

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
    outputs_option,
    setting,
    settings_option,
)
from .telling import problems_told


@click.command("continue")
@file_argument
@click.option(
    "--along", required=True, metavar='"NAME=A .. B"', help="The parameter or input, and between which values."
)
@click.option("--points", type=click.IntRange(2), default=50, metavar="N", help="The range over the first step (50).")
@click.option("--most", type=click.IntRange(2), default=2000, metavar="N", help="Points after which it ends (2000).")
@click.option("--branch", "branches", is_flag=True, help="Follow the branches that cross it, too.")
@outputs_option
@click.option("--plot", metavar="B.png", help="Draw the branch over the parameter (.png, .svg or .pdf).")
@analysed_option
@settings_option
@json_option
@model_option
def command(
    file: str, along: str, points: int, most: int, branches: bool, outputs: Sequence[str], plot: str | None, experiment: str,
    settings: Sequence[str], as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Follow a branch of states of rest against a parameter, round its folds: pull-in, snap-through, buckling."""
    with problems_told():
        if plot is not None:
            check_target(plot, (".png", ".svg", ".pdf"), "--plot")
        name, value = setting(along)
        low, dots, high = value.partition("..")
        if not dots:
            raise click.UsageError(f"--along takes `NAME = A .. B`; this is `{along}`")
        found = load(file, model).continuation(
            name,
            low,
            high,
            points,
            most,
            named(experiment),
            dict(map(setting, settings)),
            tuple(outputs) or None,
            branches,
        )
        if plot is not None:
            found.plot(plot)
        echo(found, as_json)
