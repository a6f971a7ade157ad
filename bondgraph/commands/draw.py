"""`bondgraph draw`."""

from __future__ import annotations

import click

from .error_reporting import problems_told
from .options import check_target, file_argument, load, load_shown, model_option, written

WIDE = 5000  # px: what no screen and no paper shows


@click.command("draw")
@file_argument
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="X.svg|X.png|X.pdf|-",
    help="The file to write; `-` is the standard output, as SVG.",
)
@click.option(
    "-e", "--experiment", metavar="NAME", help="As this experiment runs it; else everything that the text says."
)
@click.option("--closed", is_flag=True, help="Instances of the model as boxes.")
@click.option("--numbers", is_flag=True, help="With the numbers of the bonds.")
@click.option("--mechanism", metavar="NAME", help="This mechanism instead, with bodies, joints, springs.")
@click.option("--at", metavar="TIME", help="The mechanism at this time of a run; else as it is described.")
@model_option
def command(
    file: str, out: str, experiment: str | None, mechanism: str | None, at: str | None, model: str | None, **shown: bool
) -> None:
    """Draw the bond graph (half arrows, causal strokes, signals), or a mechanism in a pose."""
    from ..presentation.diagram.picture import ENDINGS

    with problems_told(), written(out, ENDINGS[0]) as path:
        check_target(path, ENDINGS, "--out")
        if at is not None and mechanism is None:
            raise click.UsageError("--at is for a mechanism: name it with --mechanism")
        if mechanism is not None:
            load(file, model).draw_mechanism(path, mechanism, None if experiment == "none" else experiment or "", at)
        else:
            figure = load_shown(file, model).draw(path, experiment, **shown)
            if max(figure.width, figure.height) > WIDE:
                told = "" if shown["closed"] else "; with --closed instances are boxes"
                click.echo(f"note: the picture has {figure.width:g} x {figure.height:g} px{told}", err=True)
