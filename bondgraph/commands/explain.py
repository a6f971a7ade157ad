"""`bondgraph explain`."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click

from .error_reporting import problems_told
from .options import experiment_option, file_argument, load, model_option, outputs_option


@click.command("explain")
@file_argument
@experiment_option
@outputs_option
@model_option
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-explanation/1).")
def command(file: str, experiment: str, outputs: Sequence[str], model: str | None, as_json: bool) -> None:
    """Tell what a run leaves out and why, what remains, and what is expensive."""
    with problems_told():
        from ..presentation.text.explanation import explain as explanation

        chosen = load(file, model)
        scene = chosen.scene(None if experiment == "none" else experiment, outputs=tuple(outputs) or None)
        found = explanation(chosen.compilation(scene))
        click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.text())
