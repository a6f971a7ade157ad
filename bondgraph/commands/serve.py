"""`bondgraph serve`."""

from __future__ import annotations

from pathlib import Path

import click

from .options import file_argument, model_option


@click.command("serve")
@file_argument
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
    """Show the page of a model live: it follows the file, and sliders run it. Ctrl-C ends."""
    from compiler.api import read_source

    from ..presentation.page.serve import Server, Session

    read_source(file)  # what is no file is told here
    server = Server(Session(Path(file), model), host, port)
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
