"""`bondgraph lsp`."""

from __future__ import annotations

import gc

import click


@click.command("lsp")
@click.option("--stdio", is_flag=True, help="Speak over standard input and output, as it does anyway.")
def command(stdio: bool) -> None:
    """Serve an editor: errors as you type, completion, texts about what is under the cursor, renaming, formatting.

    An editor starts it, as the server of files that end in `.bg`.
    """
    from ..errors import MissingPackage

    try:
        from ..language_server.server import serve
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] not in ("pygls", "lsprotocol"):
            raise
        raise MissingPackage(
            "BR690", "the language server needs pygls 2:", 'pip install "bondgraph-lang[lsp]"'
        ) from missing
    gc.enable()
    serve()
