"""The command line: each command is a module of this room, loaded when it is called.

Exit codes: 0 fine, 1 the file is wrong, 2 usage, 3 the numbers failed, 70 a defect of ours, 130 interrupted.
"""

from __future__ import annotations

import gc
import sys
from importlib import import_module

import click

COMMANDS = (
    "bode", "causality", "certificate", "check", "compile", "continue", "draw", "equations", "equilibrium", "explain", "fit", "fmt", "invert",
    "linearize", "modes", "montecarlo", "new", "report", "reproduce", "run", "sensitivity", "serve", "show", "sweep",
)  # fmt: skip


class Commands(click.Group):
    """A group whose commands are read when somebody asks for them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        found = import_module(f"{__name__}.{name}").command
        assert isinstance(found, click.Command)
        return found


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
        from .error_reporting import INTERRUPTED

        code = INTERRUPTED
    sys.exit(told_at_the_end(outlet, code if isinstance(code, int) else 0))
