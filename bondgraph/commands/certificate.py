"""`bondgraph certificate`."""

from __future__ import annotations

import json

import click

from .error_reporting import problems_told
from .options import file_argument, load, model_option


@click.command("certificate")
@file_argument
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-certificate/1).")
@model_option
def command(file: str, as_json: bool, model: str | None) -> None:
    """Tell what kind of equations a model has: form, index, states, loops, what was left out."""
    with problems_told():
        told = load(file, model).certificate
        click.echo(json.dumps(told.to_json(), indent=2) if as_json else str(told))
