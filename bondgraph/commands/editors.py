"""Commands for editors: what an editor needs to know the language, and the language server."""

from __future__ import annotations

import gc
import shlex
import sys
from pathlib import Path

import click

from ..errors import MissingPackage
from .error_reporting import harmless
from .manual import free_folder
from .options import check_target

EDITORS = ("vscode", "neovim", "helix", "emacs", "zed", "tree-sitter", "textmate", "pygments")


@click.command("editor")
@click.argument("editor", type=click.Choice(EDITORS))
@click.option(
    "-o", "--out", metavar="FILE", help="The file to write; of vscode it ends in .vsix, of tree-sitter it is a folder."
)
@click.option(
    "--command", "words", metavar="COMMAND", help="Start the server so, instead of by the Python that runs this."
)
def editor_(editor: str, out: str | None, words: str | None) -> None:
    """Write what an editor needs to know the language: an extension, colours, or a configuration that starts `bondgraph lsp`."""
    from ..files import replacing, write_text

    server = [sys.executable or "python", "-P", "-m", "bondgraph", "lsp"] if words is None else _words(words)
    if editor == "vscode":
        from ..editors.extension import write_extension

        if out is None:
            raise click.UsageError("vscode takes a file: bondgraph editor vscode -o bondgraph.vsix")
        check_target(out, (".vsix",), "--out")
        with replacing(out) as stream:
            write_extension(stream, server)
        click.echo(f"wrote {harmless(out)}; next: code --install-extension {harmless(out)}")
        return
    if editor == "tree-sitter":
        from ..editors.tree_sitter_grammar import tree_sitter_files

        if out is None:
            raise click.UsageError("tree-sitter takes a folder: bondgraph editor tree-sitter -o FOLDER")
        folder = free_folder(Path(out).absolute(), "grammar.js")
        for name, text in tree_sitter_files().items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_text(folder / name, text)
        click.echo(
            f"wrote {harmless(out)}; next, in it: tree-sitter generate; then what `bondgraph editor neovim`, helix, emacs or zed says"
        )
        return
    from ..editors.configurations import CONFIGURATIONS

    text = CONFIGURATIONS[editor](server)
    if out is None:
        click.echo(text, nl=False)
    else:
        write_text(out, text)


def _words(text: str) -> list[str]:
    try:
        words = shlex.split(text, posix=sys.platform != "win32")
    except ValueError as problem:
        raise click.UsageError(f"--command `{text}` cannot be read: {problem}") from None
    if not words:
        raise click.UsageError('--command is empty; for example --command "bondgraph lsp"')
    return words


@click.command("lsp")
@click.option("--stdio", is_flag=True, help="Speak over standard input and output, as it does anyway.")
def lsp(stdio: bool) -> None:
    """Serve an editor: errors as you type, completion, texts about what is under the cursor, renaming, formatting.

    An editor starts it, as the server of files that end in `.bg`.
    """
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
