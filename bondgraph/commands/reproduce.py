"""`bondgraph reproduce`."""

from __future__ import annotations

import click

from .error_reporting import FAILED
from .options import check_target, echo, json_option


@click.command("reproduce")
@click.argument("folder", metavar="FOLDER")
@click.option("--page", metavar="PAGE.md", help="Write the comparison as a page.")
@click.option("--pictures", type=click.Choice(["svg", "png"]), help="Draw the figures, too, beside the page.")
@json_option
def command(folder: str, page: str | None, pictures: str | None, as_json: bool) -> None:
    """Compute again what a folder's `published.toml` lists, and say how well it agrees with print; exit 3 if something does not."""
    from ..files import write_text
    from ..reproduction import reproduce as reproduced

    if page is not None:
        check_target(page, (".md",), "--page")
    if pictures is not None and page is None:
        raise click.UsageError("--pictures are drawn beside a page: name it with --page")
    found = reproduced(folder, page, pictures or "")
    if page is not None:
        write_text(page, found.page())
    echo(found, as_json)
    if not found.agrees:
        raise click.exceptions.Exit(FAILED)
