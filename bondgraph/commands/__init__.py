"""The command line: each command is a module of this room, loaded when it is called.

Exit codes: 0 fine, 1 the file is wrong, 2 usage, 3 the numbers failed, 70 a defect of ours, 130 interrupted.
"""

from __future__ import annotations

import gc
import sys
from importlib import import_module
from typing import Any

import click

from .error_reporting import INTERRUPTED, problems_told

COMMANDS = (
    "benchmark", "bode", "causality", "certificate", "check", "compile", "continue", "draw", "editor", "equations", "equilibrium", "explain", "fit", "fmt",
    "invert", "library", "linearize", "lsp", "modes", "montecarlo", "new", "report", "reproduce", "run", "sensitivity", "serve", "show", "stress", "sweep",
)  # fmt: skip
STAGES = ("causality", "certificate", "compile", "equations", "explain", "show")  # commands of `stages.py`


class Commands(click.Group):
    """A group whose commands are read when somebody asks for them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module, function = ("stages", name) if name in STAGES else (name, "command")
        command = getattr(import_module(f"{__name__}.{module}"), function)
        assert isinstance(command, click.Command)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; its errors become a message and an exit code."""
        with problems_told():
            return super().invoke(ctx)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="bondgraph-lang", message="bondgraph %(version)s")
def commands() -> None:
    """Check, compile and simulate bond graphs written as text."""


def main() -> None:
    """Entry of the `bondgraph` command."""
    from .streams import open_streams, told_at_the_end

    gc.disable()  # what a command reads and makes lives until its end: looking through it for what could go is for nothing
    outlet = open_streams()
    try:
        code = commands.main(prog_name="bondgraph", standalone_mode=False)
    except click.ClickException as problem:
        problem.show()
        code = problem.exit_code
    except click.exceptions.Abort:
        code = INTERRUPTED
    sys.exit(told_at_the_end(outlet, code if isinstance(code, int) else 0))
