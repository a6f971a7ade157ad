"""`bondgraph sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    analysed_option,
    echo,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    seconds_of,
    setting,
    settings_option,
    time_option,
)
from .telling import problems_told


@click.command("sensitivity")
@file_argument
@click.option(
    "--by",
    "by",
    multiple=True,
    metavar="NAME",
    help="By this parameter or input (several times: these); all parameters if left out.",
)
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]),
    help="Of what; rest and modes if left out; `simulate`: of a run, at every instant.",
)  # fmt: skip
@outputs_option
@analysed_option
@settings_option
@time_option
@click.option("--to", metavar="TIME", help="Where the run ends.")
@click.option("--points", type=click.IntRange(2), default=101, metavar="N", help="Instants of the run (101).")
@json_option
@model_option
def command(
    file: str, by: Sequence[str], of: Sequence[str], outputs: Sequence[str], experiment: str, settings: Sequence[str],
    time: str | None, to: str | None, points: int, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Tell how outputs at rest or over a run, frequencies and damping move with parameters: exact derivatives."""
    with problems_told():
        if "simulate" in of:
            if len(of) > 1:
                raise click.UsageError("--of simulate stands alone")
            run = load(file, model).sensitivity_of_run(
                tuple(by) or None, named(experiment), dict(map(setting, settings)), to, points, tuple(outputs) or None
            )
            echo(run, as_json)
            return
        found = load(file, model).sensitivity(
            tuple(by) or None, tuple(of) or ("equilibrium", "modes"), named(experiment), dict(map(setting, settings)),
            tuple(outputs) or None, seconds_of(time),
        )  # fmt: skip
        echo(found, as_json)
