"""`bondgraph equilibrium`."""

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


@click.command("equilibrium")
@file_argument
@analysed_option
@outputs_option
@settings_option
@time_option
@json_option
@model_option
def command(
    file: str, experiment: str, outputs: Sequence[str], settings: Sequence[str], time: str | None, as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Find the state of rest that is reached from the start, and whether it is stable."""
    with problems_told():
        chosen = load(file, model)
        found = chosen.equilibrium(
            named(experiment), dict(map(setting, settings)), tuple(outputs) or None, seconds_of(time)
        )
        echo(found, as_json)
