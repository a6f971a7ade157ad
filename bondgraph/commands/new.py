"""`bondgraph new`."""

from __future__ import annotations

from pathlib import Path

import click

from .error_reporting import harmless
from .options import check_target


@click.command("new")
@click.argument("file", metavar="NAME.bg")
def command(file: str) -> None:
    """Write a first model to start from; an existing file is never touched."""
    from ..files import write_text
    from ..starter import starter_text

    path = Path(file)
    check_target(file, (".bg",), "new")
    if path.exists():
        raise click.UsageError(f"`{file}` exists already; choose another name")
    write_text(path, starter_text(path.stem))
    click.echo(f"wrote {harmless(file)}; try: bondgraph run {harmless(file)}")
