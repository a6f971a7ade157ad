"""Commands of pictures and pages: of a model, of a mechanism in a pose, of results."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click

from .error_reporting import problems_told
from .options import PICTURES, check_target, file_argument, load, load_shown, model_option, written

WIDE = 5000  # px: what no screen and no paper shows


@click.command("draw")
@file_argument
@click.option(
    "-o", "--out", required=True, metavar="X.svg|X.png|X.pdf|-", help="The file to write; `-` is the standard output, as SVG."
)  # fmt: skip
@click.option(
    "-e", "--experiment", metavar="NAME", help="As this experiment runs it; else everything that the text says."
)
@click.option("--closed", is_flag=True, help="Instances of the model as boxes.")
@click.option("--numbers", is_flag=True, help="With the numbers of the bonds.")
@click.option("--mechanism", metavar="NAME", help="This mechanism instead, with bodies, joints, springs.")
@click.option("--at", metavar="TIME", help="The mechanism at this time of a run; else as it is described.")
@model_option
def draw(
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


@click.command("plot")
@click.argument("files", metavar="R.npz [OTHER.npz|DATA.csv]...", nargs=-1, required=True)
@click.option("-o", "--out", metavar="X.png", help="Draw them (.png, .svg or .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print the differences as JSON (schema bondgraph-comparison/1).")
def plot(files: Sequence[str], out: str | None, as_json: bool) -> None:
    """Draw the result of a run from its file, beside other results and measured data, and tell the differences."""
    from ..results.archive import read_result
    from ..studies.comparison import compare

    if out is not None:
        check_target(out, PICTURES, "--out")
    first, *others = files
    run = read_result(first)
    comparison = compare(run, *others)
    if out is not None:
        (comparison if others else run).plot(out)
    if as_json:
        click.echo(json.dumps(comparison.to_json(), indent=2))
    else:
        click.echo(comparison.summary() if others else run.summary())


@click.command("report")
@file_argument
@click.option(
    "-o", "--out", required=True, metavar="PAGE.html|-", help="The file to write; `-` is the standard output."
)
@model_option
def report(file: str, out: str, model: str | None) -> None:
    """Write a page of a model: its text, its bond graph, equations, and all its runs, to look at in a browser."""
    from ..files import write_text
    from ..presentation.page import report_text

    with written(out, ".html") as path:
        check_target(path, (".html", ".htm"), "--out")
        write_text(path, report_text(load_shown(file, model)))
