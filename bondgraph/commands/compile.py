"""`bondgraph compile`."""

from __future__ import annotations

from pathlib import PurePath

import click

from .error_reporting import problems_told
from .options import check_target, file_argument, load, model_option


@click.command("compile")
@file_argument
@click.option("-o", "--out", required=True, metavar="MODEL.py|MODEL.c", help="The file to write.")
@click.option("--target", metavar="NAME", help="Kind of program: numpy, c, casadi. By default what the ending means.")
@model_option
def command(file: str, out: str, target: str | None, model: str | None) -> None:
    """Write a Python module that needs numpy alone, C that needs nothing, or functions of CasADi."""
    with problems_told():
        from compiler.api import target_of, text_targets

        from ..files import write_text

        known = text_targets()
        chosen = [t for t in known.values() if t.name == target] or known.values()
        check_target(out, tuple(dict.fromkeys(t.ending for t in chosen)), "--out")
        write_text(out, load(file, model).compile(target or target_of(PurePath(out).suffix)))
