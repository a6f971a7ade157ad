"""`bondgraph equations`."""

from __future__ import annotations

import click

from .error_reporting import problems_told
from .options import file_argument, load, model_option


@click.command("equations")
@file_argument
@click.option("--latex", is_flag=True, help="As LaTeX.")
@model_option
def command(file: str, latex: bool, model: str | None) -> None:
    """Print the equations in the order in which they are computed."""
    with problems_told():
        click.echo(load(file, model).equations(latex))
