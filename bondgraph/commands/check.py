"""`bondgraph check`."""

from __future__ import annotations

import gc
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from ..compiled_model import certify
from .error_reporting import WRONG
from .options import file_or_text, model_option

if TYPE_CHECKING:
    from compiler.api import Diagnostic

CHECK_SCHEMA = "bondgraph-check/1"


@click.command("check")
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON (schema bondgraph-check/1).")
@model_option
def command(files: Sequence[str], as_json: bool, model: str | None) -> None:
    """Tell everything that is wrong with some files; of fine ones, what kind of equations a run solves."""
    examined = [certify(file_or_text(file), model) for file in files]
    found = [d for diagnostics, _ in examined for d in diagnostics]
    if not gc.isenabled():  # the process ends with this: what was made need not be walked through at its end
        gc.freeze()
    if as_json:
        click.echo(json.dumps(_check_json(files, found), indent=2))
    elif found:
        from compiler.api import render

        click.echo("\n\n".join(render(d) for d in found), err=True)
    else:
        for certificate in (c for _, c in examined if c is not None):
            click.echo("\n".join([certificate.line, *(f"  note: {n}" for n in certificate.notes)]))
        click.echo(f"{len(files)} file{'s' * (len(files) > 1)} fine")
    if found:
        raise click.exceptions.Exit(WRONG)


def _check_json(files: Sequence[str], found: Sequence[Diagnostic]) -> dict[str, Any]:
    """`bondgraph-check/1`: {schema, files, diagnostics: [{file, line, column, code, message, help}]}."""
    return {"schema": CHECK_SCHEMA, "files": list(files), "diagnostics": [d.to_json() for d in found]}
