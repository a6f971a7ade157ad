"""`bondgraph mcp`: commands as tools of an assistant, by the Model Context Protocol.

Each tool runs a command of this program in this process, so that an assistant reads the same JSON and the same errors as the command line gives.
"""

from __future__ import annotations

import gc
import io
import json
import sys
import threading
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from mcp.server import MCPServer

INSTRUCTIONS = """Bond-graph models as text (.bg): check, correct, run and analyse them. Each tool takes either `text`, a model, or `file`, its path.
Begin with `language` (no section: the list of sections), write the model, `check` it, apply a correction of `corrections`, then `simulate`."""
BUSY = threading.Lock()  # standard streams are those of the process: one tool at a time


@click.command("mcp")
def command() -> None:
    """Serve an assistant by the Model Context Protocol: check, correct, draw, run and analyse models, search the library.

    An assistant starts it and speaks over standard input and output.
    """
    from ..errors import MissingPackage

    try:
        server = tools()
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != "mcp":
            raise
        raise MissingPackage(
            "BR691", "the server for assistants needs mcp 2:", 'pip install "bondgraph-lang[mcp]"'
        ) from missing
    gc.enable()
    server.run()


def tools() -> MCPServer:
    """Return the server with its tools. Raises ModuleNotFoundError without the package `mcp`."""
    from mcp.server import MCPServer

    server = MCPServer("bondgraph", instructions=INSTRUCTIONS)
    for tool in (check, corrections, draw, simulate, modes, equations, library, language):
        server.add_tool(tool, structured_output=False)
    return server


# ---------------------------------------------------------------- tools; their docstrings are what an assistant reads
def check(text: str = "", file: str = "") -> str:
    """Tell all errors of a model, each with its place, code, sentence and advice (JSON, schema bondgraph-check/1)."""
    return _told(["check", "--json"], text, file)


def corrections(text: str = "", file: str = "") -> str:
    """Return for each error of a model the corrections that are known to mend it: title, code, line, and the whole text after it."""
    from compiler.api import read_text

    from ..language_service.text_answers import TextAnswers

    path = Path(file).resolve() if file else Path("text.bg").resolve()
    return json.dumps(TextAnswers()("corrections", text or read_text(path), path), indent=2)


def draw(text: str = "", file: str = "", mechanism: str = "") -> str:
    """Return the bond graph of a model as SVG, with half arrows and causal strokes; with `mechanism`, that mechanism in its drawn pose."""
    from .. import load
    from ..rendering import text_of
    from .error_reporting import problems_told

    def drawn() -> None:
        with problems_told():
            model = load(Path(file) if file else f"{text}\n")
            figure = model.draw_mechanism(name=mechanism) if mechanism else model.draw()
            click.echo(text_of(figure, "svg"))

    return _captured(drawn)


def simulate(
    text: str = "", file: str = "", experiment: str = "", settings: dict[str, str] | None = None, to: str = "", points: int = 51
) -> str:  # fmt: skip
    """Simulate a model: final values, extremes with their instants, errors (JSON, schema bondgraph-result/1), then the values at `points` instants as CSV.

    `settings`: parameters or inputs with values and units, such as {"R": "10 ohm"}; `to`: where the run ends, such as "20 ms".
    """
    from tempfile import TemporaryDirectory

    options = [f"--set={name}={value}" for name, value in (settings or {}).items()]
    options += [*(["-e", experiment] if experiment else []), *(["--to", to] if to else [])]
    with TemporaryDirectory() as folder:
        values = Path(folder, "values.csv")
        summary = _told(["run", "--json", "--points", str(points), "--out", str(values), *options], text, file)
        return f"{summary}\n{values.read_text(encoding='utf-8')}" if values.exists() else summary


def modes(text: str = "", file: str = "", experiment: str = "") -> str:
    """Return the eigenmodes of a model at rest: frequencies, damping, shapes (JSON, schema bondgraph-modes)."""
    return _told(["modes", "--json", *(["-e", experiment] if experiment else [])], text, file)


def equations(text: str = "", file: str = "") -> str:
    """Return the state equations of a model, and the causality of each bond with its reason."""
    return "\n".join(_told([name], text, file) for name in ("equations", "causality"))


def library(words: str = "") -> str:
    """Search the parts that come with bondgraph by words; one part's name gives its page: law, ports, parameters, validity, example."""
    return _told(["library", *words.split()], "", "")


def language(section: str = "") -> str:
    """Return a section of the reference of the language, by its number or words of its title; without `section`, the titles."""
    parts = (Path(__file__).parents[1] / "language.md").read_text(encoding="utf-8").split("\n## ")[1:]
    wanted = section.strip().casefold()
    if wanted:
        matching = [p for p in parts if p.startswith(f"{wanted}.")] or [
            p for p in parts if wanted in p.partition("\n")[0].casefold()
        ]
        if matching:
            return "\n\n".join(f"## {p}" for p in matching)
    return "\n".join(p.partition("\n")[0] for p in parts)


# ---------------------------------------------------------------- a command in this process
def _told(arguments: list[str], text: str, file: str) -> str:
    """Return what a command prints; its notes or errors behind it."""
    from . import commands

    source = [file or "-"] if text or file else []
    return _captured(lambda: commands.main([*arguments, *source], "bondgraph", standalone_mode=False), text)


def _captured(call: Any, text: str = "") -> str:
    """Return what a call writes to standard output, with what it writes to standard error behind it; `text` is its standard input."""
    out, err = io.StringIO(), io.StringIO()
    with BUSY, redirect_stdout(out), redirect_stderr(err):
        before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8")
        try:
            call()
        except click.ClickException as problem:
            problem.show()
        except click.exceptions.Exit:
            pass  # the command has said why
        finally:
            sys.stdin = before
    return "\n".join(part.rstrip() for part in (out.getvalue(), err.getvalue()) if part.strip())
