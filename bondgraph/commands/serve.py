"""`bondgraph serve`."""

from __future__ import annotations

from pathlib import Path

import click

from . import completion
from .options import model_option


@click.command("serve")
@click.argument("file", metavar="FILE|FOLDER", shell_complete=completion.files)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="N",
    help="The port to listen on; any free one if left out.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    metavar="ADDRESS",
    help="Listen on this address instead of this machine's own: others can then look, too.",
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
@model_option
def command(file: str, port: int, host: str, opens: bool, model: str | None) -> None:
    """Show a model, or all of a folder, live in the browser: edit and save the text, see its errors, run it by sliders, compare runs. Ctrl-C ends."""
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
