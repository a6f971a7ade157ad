"""`bondgraph causality`."""

from __future__ import annotations

import json

import click

from .error_reporting import WRONG, problems_told, stop
from .options import experiment_option, file_argument, load, model_option


@click.command("causality")
@file_argument
@experiment_option
@model_option
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-causality/1).")
def command(file: str, experiment: str, model: str | None, as_json: bool) -> None:
    """Print the strokes, and why there are derivative storages and algebraic loops."""
    with problems_told():
        from ..presentation.text.causality import explain, told

        chosen = load(file, model)
        found = explain(chosen.compilation(chosen.scene(None if experiment == "none" else experiment)))
        click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.text())
        if found.diagnostics:
            stop(told(found.diagnostics), WRONG)
