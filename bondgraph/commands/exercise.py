"""`bondgraph exercise`."""

from __future__ import annotations

import click

from .error_reporting import WRONG, harmless, stop
from .options import experiment_option, file_argument, load, model_option, named


@click.command("exercise")
@file_argument
@click.argument("what", metavar="[strokes|equations]", type=click.Choice(["strokes", "equations"]), default="strokes")
@click.option("--answer", metavar="TEXT", help="A file with the exercise filled in: mark its lines.")
@experiment_option
@model_option
def command(file: str, what: str, answer: str | None, experiment: str, model: str | None) -> None:
    """Print a model's bonds without strokes, or its state equations without right sides, to be filled in; with --answer, mark what was filled in."""
    from compiler.api import read_source

    from .. import exercises

    chosen = load(file, model)
    if answer is None:
        click.echo(exercises.exercise(chosen, what, named(experiment)))
        return
    marked = exercises.mark(chosen, what, read_source(answer), named(experiment))
    click.echo(harmless(marked.text()))
    if not marked.right:
        stop(marked.count, WRONG)
    click.echo(marked.count)
