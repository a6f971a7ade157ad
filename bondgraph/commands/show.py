"""`bondgraph show`."""

from __future__ import annotations

import click

from .error_reporting import problems_told
from .options import experiment_option, file_argument, load, model_option


@click.command("show")
@file_argument
@click.option(
    "--stage",
    required=True,
    metavar="STAGE",
    help="syntax, graph, causality, equations, reduction, state_equations, code; or text: back in the language, flat.",
)
@experiment_option
@model_option
def command(file: str, stage: str, experiment: str, model: str | None) -> None:
    """Print one stage of the compiler."""
    with problems_told():
        click.echo(load(file, model).show(stage, None if experiment == "none" else experiment))
