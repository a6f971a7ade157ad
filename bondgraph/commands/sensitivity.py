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
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes"]), help="Of what; both if left out."
)
@outputs_option
@analysed_option
@settings_option
@time_option
@json_option
@model_option
def command(
    file: str, by: Sequence[str], of: Sequence[str], outputs: Sequence[str], experiment: str, settings: Sequence[str],
    time: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Tell how outputs at rest, frequencies and damping move with parameters: exact derivatives."""
    with problems_told():
        found = load(file, model).sensitivity(
            tuple(by) or None, tuple(of) or ("equilibrium", "modes"), named(experiment), dict(map(setting, settings)),
            tuple(outputs) or None, seconds_of(time),
        )  # fmt: skip
        echo(found, as_json)
