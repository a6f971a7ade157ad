"""`bondgraph serve`."""

from __future__ import annotations

from pathlib import Path

import click

from . import completion
from .manual import free_folder
from .options import model_option


@click.command("serve")
@click.argument("file", metavar="FILE|FOLDER", shell_complete=completion.files)
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="The port to listen on; any free one if left out.")  # fmt: skip
@click.option(
    "--host", default="127.0.0.1", metavar="ADDRESS", help="Listen on this address instead of this machine's own: others can then look, too."
)  # fmt: skip
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
@click.option(
    "--playground", metavar="OUT",
    help="Serve nothing: write the page of FOLDER into the folder OUT, for any web host; Python runs in the reader's browser.",
)  # fmt: skip
@model_option
def command(file: str, port: int, host: str, opens: bool, playground: str | None, model: str | None) -> None:
    """Show a model, or all of a folder, live in the browser: edit and save the text, see its errors, run it by sliders, compare runs. Ctrl-C ends."""
    if playground is not None:
        _write_playground(Path(file), Path(playground), model)
        return
    from compiler.api import read_source

    from ..language_service.text_answers import TextAnswers
    from ..presentation.page.serve import Server, Session

    if not Path(file).is_dir():
        read_source(file)  # what is no file is told here
    server = Server(Session(Path(file), model, TextAnswers()), host, port)
    try:
        server.start()
        click.echo(f"{file} is at {server.guard.address} (Ctrl-C ends)")
        if opens:
            click.launch(server.guard.address)
        server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        click.echo("ended")
    finally:
        server.session.ended.set()
        server.server_close()


def _write_playground(folder: Path, out: Path, model: str | None) -> None:
    """Write a playground, and print what is to be added. Raises `click.UsageError`."""
    from ..presentation.page.serve.files import models_in
    from ..presentation.page.serve.playground import write_playground

    if model is not None or not folder.is_dir() or not models_in(folder):
        raise click.UsageError(
            "a playground is of a FOLDER of models, and of all in its files: `bondgraph serve models --playground site`"
        )
    lacking = write_playground(folder, free_folder(out.absolute(), "worker.js"))
    click.echo(f"{out} has the page")
    if lacking:
        click.echo(
            "\n".join([f"still to be put into {out / 'pyodide'}, from a release of Pyodide (0.27 or newer):", *lacking])
        )
