"""`bondgraph report`."""

from __future__ import annotations

import click

from .options import check_target, file_argument, load_shown, model_option, written


@click.command("report")
@file_argument
@click.option(
    "-o", "--out", required=True, metavar="PAGE.html|-", help="The file to write; `-` is the standard output."
)
@model_option
def command(file: str, out: str, model: str | None) -> None:
    """Write a page of a model: its text, its bond graph, equations, and all its runs, to look at in a browser."""
    from ..files import write_text
    from ..presentation.page import report_text

    with written(out, ".html") as path:
        check_target(path, (".html", ".htm"), "--out")
        write_text(path, report_text(load_shown(file, model)))
