"""Error reporting: errors become a message and an exit code."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import NoReturn

import click

WRONG, USAGE, FAILED, DEFECT, INTERRUPTED = 1, 2, 3, 70, 130


def harmless(message: str) -> str:
    """Return a message with names of files made harmless: they cannot change the terminal."""
    from ..presentation.text.tables import visible

    return "\n".join(map(visible, message.split("\n")))


def stop(message: str, code: int) -> NoReturn:
    """End the command with a message on stderr."""
    click.echo(harmless(message), err=True)
    raise click.exceptions.Exit(code)


def _near(name: str) -> str:
    """Return the file whose name is near one that is missing; empty if there is none."""
    if os.path.isfile(f"{name}.bg"):
        return f"{name}.bg"
    folder, last = os.path.split(name)
    others = os.listdir(folder or ".") if os.path.isdir(folder or ".") else []
    return next((os.path.join(folder, near) for near in get_close_matches(last, others, 1)), "")


@contextmanager
def problems_told() -> Iterator[None]:
    """Convert errors into a message and an exit code."""
    from ..errors import MissingPackage, RunFailed, UsageError

    try:
        yield
    except (click.ClickException, click.exceptions.Exit):
        raise
    except KeyboardInterrupt as interrupted:
        stop(str(interrupted) or "interrupted", INTERRUPTED)
    except RunFailed as failed:
        stop(f"the run failed: {failed}", FAILED)
    except (UsageError, MissingPackage) as problem:
        stop(f"bondgraph: {problem}", USAGE)
    except UnicodeDecodeError as problem:
        stop(f"bondgraph: a file is not a text in UTF-8 ({problem.reason})", USAGE)
    except OSError as problem:
        name = problem.filename or "file"
        hint = f"; did you mean `{near}`?" if isinstance(problem, FileNotFoundError) and (near := _near(name)) else ""
        stop(f"bondgraph: {name}: {problem.strerror or problem}{hint}", USAGE)
    except Exception as problem:
        from compiler.api import CompilationFailed, render

        if isinstance(problem, CompilationFailed):
            stop("\n\n".join(render(d) for d in problem.diagnostics), WRONG)
        if os.environ.get("BONDGRAPH_DEBUG"):
            raise
        missing = problem.name if isinstance(problem, ModuleNotFoundError) else None
        if missing is not None and missing.partition(".")[0] not in ("bondgraph", "compiler"):
            stop(
                f"bondgraph: the package `{missing}` is not installed; `pip install bondgraph-lang` brings what is needed",
                USAGE,
            )
        kind = type(problem).__name__
        advice = "set BONDGRAPH_DEBUG=1 for the traceback and send it with your file"
        stop(f"bondgraph: a defect of ours, not of your file ({kind}: {problem}); {advice}", DEFECT)
