"""`bondgraph compile`."""

from __future__ import annotations

import click

from .options import check_target, file_argument, load, model_option
from .telling import problems_told


@click.command("compile")
@file_argument
@click.option("-o", "--out", required=True, metavar="MODEL.py|MODEL.c", help="The file to write.")
@model_option
def command(file: str, out: str, model: str | None) -> None:
    """Write a Python module that needs numpy alone, or C that needs nothing."""
    with problems_told():
        from ..files import write_text

        check_target(out, (".py", ".c"), "--out")
        write_text(out, load(file, model).compile("c" if out.endswith(".c") else "numpy"))
