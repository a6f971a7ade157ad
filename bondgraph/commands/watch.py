"""`bondgraph watch`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import sleep, strftime

import click

from .error_reporting import problems_told
from .options import file_argument

LOOK_EVERY = 0.15  # s between two checks of the files


@click.command("watch", context_settings={"ignore_unknown_options": True})
@file_argument
@click.argument("options", metavar="[OPTIONS OF RUN]...", nargs=-1, type=click.UNPROCESSED)
def command(file: str, options: Sequence[str]) -> None:
    """Check a file at every save, and run it where it is fine: `watch FILE`, then the options of `run`. Ctrl-C ends."""
    from compiler.api import read_source

    from ..files import FollowedFiles

    read_source(file)  # what is no file is told here
    followed, sources = FollowedFiles(), {Path(file)}
    followed.changed(sources)
    try:
        while True:
            sources |= _once(file, options)
            while not followed.changed(sources):
                sleep(LOOK_EVERY)
    except KeyboardInterrupt:
        click.echo("ended")


def _once(file: str, options: Sequence[str]) -> set[Path]:
    """Check the file, or run it where it has an experiment or options ask for one; return the files of its model, none where it is wrong."""
    from compiler.api import CompilationFailed

    from .. import load
    from .check import command as check
    from .run import command as run

    click.echo(f"-- {file}, {strftime('%H:%M:%S')}")
    command, arguments, files = check, [file], set[Path]()
    try:
        model = load(Path(file))
        files = {source.path for source in model.compilation().files if source.path is not None}
        if options or model.experiments:
            command, arguments = run, [file, *options]
    except (CompilationFailed, OSError, UnicodeDecodeError):
        pass  # `check` tells everything that is wrong
    try:
        with problems_told():
            command.main(arguments, f"bondgraph {command.name}", standalone_mode=False)
    except click.ClickException as problem:
        problem.show()
    except click.exceptions.Exit:
        pass  # the command has said why
    return files
