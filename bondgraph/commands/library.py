"""`bondgraph library`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ..catalogue import LibraryPart

LIBRARY_SCHEMA = "bondgraph-library/1"


@click.command("library")
@click.argument("words", metavar="[WORD...]", nargs=-1)
@click.option(
    "-o", "--out", metavar="X.bg|X.svg|X.png|X.pdf|X.html|-",
    help="Write the example of the part: its text (also `-`, the standard output), its bond graph, its page.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-library/1).")
def command(words: Sequence[str], out: str | None, as_json: bool) -> None:
    """List the parts that come with bondgraph, those that all WORDs describe, or show the page of one PART."""
    from ..catalogue import found_by, library_parts

    parts = library_parts()
    named = [p for p in parts if len(words) == 1 and p.name.casefold() == words[0].casefold()]
    chosen = named or list(found_by(parts, words))
    if not chosen:
        raise click.UsageError(f"no part of the library is described by `{' '.join(words)}`{_near(parts, words)}")
    if out is not None:
        if len(chosen) > 1:
            raise click.UsageError(
                f"--out is for one part, and these are {len(chosen)}: name one, as in `bondgraph library {chosen[0].name}`"
            )
        _write(chosen[0], parts, out)
    elif as_json:
        click.echo(json.dumps({"schema": LIBRARY_SCHEMA, "parts": [_json(p, parts) for p in chosen]}, indent=2))
    elif len(chosen) == 1:
        from ..catalogue import example_of, interface_of
        from ..presentation.text.parts import page_text

        click.echo(page_text(chosen[0], interface_of(chosen[0]), example_of(chosen[0], parts)))
    else:
        from ..presentation.text.parts import list_text

        click.echo(list_text(chosen))


def _near(parts: Sequence[LibraryPart], words: Sequence[str]) -> str:
    """Advice with the names that are written much alike."""
    names = {p.name.casefold(): p.name for p in parts}
    close = [names[n] for w in words for n in get_close_matches(w.casefold(), names, 3)]
    return f"; there is {', '.join(close)}" if close else "; `bondgraph library` lists all"


def _json(part: LibraryPart, parts: Sequence[LibraryPart]) -> dict[str, Any]:
    """Return a part as in `bondgraph-library/1`: its documentation, ports, quantities, limits, and its example as a file."""
    from ..catalogue import example_of, interface_of

    entry = {k: v for k, v in asdict(part).items() if k != "text"}
    return {**entry, **asdict(interface_of(part)), "example": example_of(part, parts)}


def _write(part: LibraryPart, parts: Sequence[LibraryPart], out: str) -> None:
    """Write the example of a part by the ending of the file. Raises OSError, `click.UsageError`."""
    from .. import load
    from ..catalogue import example_of
    from ..files import write_text
    from .options import PICTURES, STREAM, check_target

    if out != STREAM:
        check_target(out, (".bg", *PICTURES, ".html"), "--out")
    text = example_of(part, parts)
    if not text:
        raise click.UsageError(f"`{part.name}` has no example")
    if out == STREAM:
        click.echo(text, nl=False)
    elif out.endswith(".bg"):
        write_text(out, text)
    elif out.endswith(".html"):
        from ..presentation.page import report_text

        write_text(out, report_text(load(text)))
    else:
        load(text).draw(out)
