"""`bondgraph plot`."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click

from .options import PICTURES, check_target


@click.command("plot")
@click.argument("files", metavar="R.npz [OTHER.npz|DATA.csv]...", nargs=-1, required=True)
@click.option("-o", "--out", metavar="X.png", help="Draw them (.png, .svg or .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print the differences as JSON (schema bondgraph-comparison/1).")
def command(files: Sequence[str], out: str | None, as_json: bool) -> None:
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
