"""`bondgraph modes`."""

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
@analysed_option
@settings_option
@time_option
@json_option
@model_option
def command(
    file: str, state: str, experiment: str, settings: Sequence[str], time: str | None, as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Print frequencies, damping, and where the energy of each mode is."""
    with problems_told():
        found = load(file, model).modes(named(experiment), dict(map(setting, settings)), state, seconds_of(time))
        echo(found, as_json)
