"""Commands that write texts of models: a first one, one of another language, and formatted ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from .error_reporting import WRONG, harmless
from .options import STREAM, check_target, file_or_text


@click.command("new")
@click.argument("file", metavar="NAME.bg")
def new(file: str) -> None:
    """Write a first model to start from; an existing file is never touched."""
    from ..files import write_text
    from ..starter import starter_text

    path = Path(file)
    check_target(file, (".bg",), "new")
    if path.exists():
        raise click.UsageError(f"`{file}` exists already; choose another name")
    write_text(path, starter_text(path.stem))
    click.echo(f"wrote {harmless(file)}; try: bondgraph run {harmless(file)}")


@click.command("fmt")
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.option("--check", "only_check", is_flag=True, help="Write nothing; exit 1 if a file would change.")
def fmt(files: Sequence[str], only_check: bool) -> None:
    """Format files; comments, blank lines and columns stay. `-` is standard input, whose text goes to standard output."""
    from compiler.api import Source, format_text, read_source

    from ..files import write_text

    changed = []
    for file in files:
        from_stream = file == "-"
        source = Source("text", str(file_or_text(file))) if from_stream else read_source(file, newline="")
        text = format_text(source)
        if from_stream and not only_check:
            click.echo(text, nl=False)
        elif text != source.text:
            changed.append(file)
            if not only_check:
                write_text(file, text)
    for file in changed:
        click.echo(f"{'would change' if only_check else 'formatted'} {harmless(file)}")
    if only_check and changed:
        raise click.exceptions.Exit(WRONG)


@click.command("import")
@click.argument("file", metavar="MODEL.mo")
@click.option("-o", "--out", required=True, metavar="MODEL.bg|-", help="The file to write; `-` is the standard output.")
def import_(file: str, out: str) -> None:
    """Write a model of flat Modelica in this language; what has no equal here is refused by line."""
    from compiler.api import read_source

    from ..exchange.modelica import import_modelica
    from ..files import write_text

    if out != STREAM:
        check_target(out, (".bg",), "--out")
    text = import_modelica(read_source(file))
    if out == STREAM:
        click.echo(text, nl=False)
    else:
        write_text(out, text)
