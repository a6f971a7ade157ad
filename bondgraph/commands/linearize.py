"""`bondgraph linearize`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    analysed_option,
    echo,
    file_argument,
    inputs_option,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    seconds_of,
    setting,
    settings_option,
    state_option,
    time_option,
)
from .telling import problems_told


@click.command("linearize")
@file_argument
@inputs_option
@outputs_option
@state_option
@analysed_option
@settings_option
@time_option
@json_option
@model_option
def command(
    file: str, inputs: Sequence[str], outputs: Sequence[str], state: str, experiment: str, settings: Sequence[str],
    time: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Print A, B, C, D of the linear model at rest or at the start."""
    with problems_told():
        found = load(file, model).linearize(
            tuple(inputs) or None, tuple(outputs) or None, named(experiment), dict(map(setting, settings)), state, seconds_of(time)
        )  # fmt: skip
        echo(found, as_json)
