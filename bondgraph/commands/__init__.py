"""The command line: each command is a module of this room, loaded when it is called.

Exit codes: 0 fine, 1 the file is wrong, 2 usage, 3 the numbers failed, 70 a defect of ours, 130 interrupted.
"""

from __future__ import annotations

import gc
import os
import re
import sys
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from textwrap import shorten
from typing import Any

import click

from ..version import VERSION
from .error_reporting import INTERRUPTED, problems_told

# Commands by what they are for, each with an example of its options.
GROUPS = {
    "Write and read models": {
        "new": "first.bg",
        "check": "models/oscillator.bg models/rlc.bg",
        "fmt": "models/oscillator.bg",
        "import": "motor.mo -o motor.bg",
        "draw": "models/manipulator.bg -o manipulator.svg",
        "report": "models/oscillator.bg -o oscillator.html",
        "serve": "models",
        "library": "diode bridge",
    },
    "Stages and reasons": {
        "causality": "models/crane.bg",
        "certificate": "models/four_bar.bg",
        "equations": "models/rlc.bg",
        "explain": "models/manipulator.bg",
        "show": "models/rlc.bg --stage state_equations",
        "compile": "models/rlc.bg -o rlc.py",
        "exercise": "models/rlc.bg strokes --answer answer.txt",
    },
    "Runs": {
        "watch": "models/oscillator.bg --plot x.png",
        "run": 'models/manipulator.bg --set "a=171 um" --to "20 ms" --plot x.png',
        "plot": "before.npz after.npz measured.csv -o both.png",
        "benchmark": "models/van_der_pol.bg --error 1e-6",
        "stress": 'models/rlc.bg --for "10 s"',
    },
    "Analyses": {
        "equilibrium": "models/crane.bg",
        "continue": 'models/plates.bg --along "volt = 0 V .. 5 V"',
        "linearize": "models/rlc.bg",
        "modes": "models/chain.bg",
        "bode": "models/active_filter.bg --plot bode.svg",
        "sensitivity": "models/rlc.bg --by R",
        "invert": 'models/manipulator.bg --want "x=8 um" --by push1/pull1',
    },
    "Many runs": {
        "sweep": 'models/oscillator.bg --over "k = 50 N/m .. 200 N/m : 4"',
        "montecarlo": 'models/oscillator.bg --vary "k = normal(100 N/m, 5 N/m)"',
        "fit": 'models/oscillator.bg --data measured.csv --parameter "k = 50 N/m .. 200 N/m"',
        "reproduce": "models/thesis",
    },
    "Editors and assistants": {"editor": "vscode -o bondgraph.vsix", "lsp": "", "mcp": ""},
    "Pages about it": {"manual": "tearing"},
}
EXAMPLES = {name: example for commands in GROUPS.values() for name, example in commands.items()}
COMMANDS = tuple(sorted(EXAMPLES))
# Modules with several commands; each other command has a module of its name.
SHARED = {
    "texts": ("fmt", "import", "new"),
    "pictures": ("draw", "plot", "report"),
    "editors": ("editor", "lsp"),
    "stages": ("causality", "certificate", "compile", "equations", "explain", "show"),
    "analyses": tuple(GROUPS["Analyses"]),
    "studies": ("benchmark", "fit", "montecarlo", "stress", "sweep"),
}


class Commands(click.Group):
    """A group whose commands are read when somebody asks for them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module = import_module(f"{__name__}.{next((m for m, names in SHARED.items() if name in names), name)}")
        command = next(c for c in vars(module).values() if isinstance(c, click.Command) and c.name == name)
        command.epilog = f"Example: bondgraph {name} {EXAMPLES[name]}"
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; for a name that none has, tell those that are near it."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            near = [f"run {args[0]}"] if Path(args[0]).is_file() else get_close_matches(args[0], COMMANDS, n=2)
            near = ["run"] if args[0] == "simulate" else near
            hint = f"did you mean `{'` or `'.join(near)}`?" if near else "`bondgraph --help` lists the commands"
            ctx.fail(f"there is no command `{args[0]}`: {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by what they are for."""
        width = max(map(len, COMMANDS))
        for title, examples in GROUPS.items():
            with formatter.section(title):
                limit = formatter.width - 6 - width
                found = [(name, self.get_command(ctx, name)) for name in examples]
                texts = ((name, re.split("[:;(]", c.get_short_help_str(1000))[0].strip(" .")) for name, c in found if c)
                formatter.write_dl(
                    [(name.ljust(width), shorten(text, limit, placeholder=" …")) for name, text in texts]
                )

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; its errors become a message and an exit code."""
        with problems_told():
            try:
                return super().invoke(ctx)
            except click.UsageError as problem:
                raise click.UsageError(f"{problem.format_message()}{_hint(problem)}", problem.ctx) from problem


def _hint(problem: click.UsageError) -> str:
    """Return what may stand in a missing option, as it is completed, and the command's example; where an experiment is named."""
    context, parameter = problem.ctx, problem.param if isinstance(problem, click.MissingParameter) else None
    if context is None:
        return ""
    if problem.message.startswith("Got unexpected extra") and "experiment" in context.params:
        return "\nAn experiment is named with `-e`."
    if parameter is None:
        return ""
    names = [item.value.rstrip("=") for item in parameter.shell_complete(context, "") if item.type == "plain"]
    listed = f"\nIt takes one of {', '.join(names[:12])}{' …' if names[12:] else ''}" if names else ""
    return f"{listed}\nExample: bondgraph {context.info_name} {EXAMPLES[context.info_name or '']}"


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, message="bondgraph %(version)s")
def commands() -> None:
    """Check, compile and simulate bond graphs written as text."""


def main() -> None:
    """Entry of the `bondgraph` command."""
    from .streams import open_streams, told_at_the_end

    gc.disable()  # what a command reads and makes lives until its end: looking through it for what could go is for nothing
    outlet = open_streams()
    if "_BONDGRAPH_COMPLETE" in os.environ:
        from . import completion  # noqa: F401  what each shell is given
    try:
        code = commands.main(prog_name="bondgraph", standalone_mode=False)
    except click.ClickException as problem:
        problem.show()
        code = problem.exit_code
    except click.exceptions.Abort:
        code = INTERRUPTED
    sys.exit(told_at_the_end(outlet, code if isinstance(code, int) else 0))
