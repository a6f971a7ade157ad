"""`bondgraph invert`."""

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
    setting,
    settings_option,
)
from .telling import problems_told


@click.command("invert")
@file_argument
@click.option(
    "--want", "targets", multiple=True, required=True, metavar="OUTPUT=VALUE", help="An output at rest: `x=8 um`."
)
@click.option(
    "--by",
    "inputs",
    multiple=True,
    required=True,
    metavar="INPUT|PUSH/PULL",
    help="An input to find, or two of which one is zero.",
)
@analysed_option
@settings_option
@json_option
@model_option
def command(
    file: str, targets: Sequence[str], inputs: Sequence[str], experiment: str, settings: Sequence[str], as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Find inputs that hold outputs at given values, at rest."""
    with problems_told():
        found = load(file, model).invert(
            dict(map(setting, targets)), inputs, named(experiment), dict(map(setting, settings))
        )  # fmt: skip
        echo(found, as_json)
