"""Common options of several commands, and their processing."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from . import completion

if TYPE_CHECKING:
    from .. import Model
    from ..studies.point_request import Progress
    from ..studies.workers import Workers

TABLES = (".csv", ".npz", ".nc", ".mat")  # endings of files for tables
PICTURES = (".png", ".svg", ".pdf")

Command = Callable[..., None]
Noun = TypeVar("Noun")

model_option = click.option("--model", metavar="NAME", help="The model to use, if the file has several.")
file_argument = click.argument("file", metavar="FILE", shell_complete=completion.files)
outputs_option = click.option(
    "--output", "outputs", multiple=True, metavar="NAME", shell_complete=completion.outputs,
    help="Only this output (several times: these); what they do not need is left out.",
)  # fmt: skip


def _a_name(context: click.Context, parameter: click.Parameter, value: str) -> str:
    """Return the name of an experiment; refuse one without letters on the command line, which would be taken for none said."""
    if not value.strip() and context.get_parameter_source("experiment") is ParameterSource.COMMANDLINE:
        raise click.BadParameter("an experiment has a name; leave the option out for the one that is taken then")
    return value


experiment_option = click.option(
    "-e", "--experiment", default="", callback=_a_name, metavar="NAME", shell_complete=completion.experiments,
    help="Which experiment (`none` for none); the first of the model if left out.",
)  # fmt: skip
settings_option = click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", shell_complete=completion.settings,
    help="Set a parameter (`a=171 um`) or an input; once for each.",
)  # fmt: skip
json_option = click.option("--json", "as_json", is_flag=True, help="Print it as JSON, in SI and Hz.")
inputs_option = click.option(
    "--input", "inputs", multiple=True, metavar="NAME", shell_complete=completion.inputs, help="From this input, parameter or signal (several times: these)."
)  # fmt: skip
state_option = click.option(
    "--at", "state", default="equilibrium", type=click.Choice(["equilibrium", "start"]), help="At rest, or at the start."
)  # fmt: skip
time_option = click.option(
    "--time", "time", metavar="TIME", help="Inputs as they are then; where the experiment begins if left out."
)

journal_option = click.option(
    "--journal", metavar="FILE", help="Keep what is done in this file: after a crash the same command goes on from there."
)  # fmt: skip
jobs_option = click.option(
    "--jobs", type=click.IntRange(1, 1024), metavar="N", help="How many processes make the points (as many as cores)."
)  # fmt: skip


STREAM = "-"  # in place of a file: standard input, or standard output


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Files that a command writes, and the form of what it prints."""

    out: str | None = None
    plot: str | None = None
    plot_energy: str | None = None
    tornado: str | None = None
    curves: str | None = None
    as_json: bool = False

    def check(self) -> None:
        """Check before any computation that they can be written."""
        pictures = (
            (self.plot, "--plot"),
            (self.plot_energy, "--plot-energy"),
            (self.tornado, "--tornado"),
            (self.curves, "--curves"),
        )
        out = None if self.out == STREAM else self.out
        check_targets((out, TABLES, "--out"), *((path, PICTURES, option) for path, option in pictures))
        if self.out == STREAM and self.as_json:
            raise click.UsageError("--json and `--out -` both print on the standard output: leave one out")

    def write(self, found: Any) -> bool:
        """Write the table of a result; return True if it went to the standard output, where nothing else is printed then."""
        if self.out is not None:
            with written(self.out, ".csv") as path:
                found.write(path)
        return self.out == STREAM


def taken(kind: type[Noun], options: dict[str, Any]) -> Noun:
    """Return a record of those of the options that are its fields, and remove them."""
    names = [f.name for f in fields(kind) if f.name in options]  # type: ignore[arg-type]
    return kind(**{n: options.pop(n) for n in names})


def file_or_text(file: str) -> Path | str:
    """Return the file; for `-` the text of standard input. Raises `UnicodeDecodeError`, `click.UsageError`."""
    if file != STREAM:
        return Path(file)
    stream = sys.stdin
    if stream is None:
        raise click.UsageError("`-` reads standard input, which is closed")
    text = stream.buffer.read().decode("utf-8-sig").replace("\r\n", "\n")
    return text if "\n" in text else text + "\n"  # what has no line break would be the name of a file


def load(file: str, model: str | None) -> Model:
    from .. import load

    return load(file_or_text(file), model)


def load_shown(file: str, model: str | None) -> Model:
    """Load a model to look at. One that is a part with open ports, and documents an example, stands in its example."""
    from compiler.api import CompilationFailed

    from .. import Model
    from ..catalogue import example_source

    whole = load(file, model)
    try:
        part = whole.compilation().open_part
    except CompilationFailed:
        return whole  # what looks at it tells the errors
    source = example_source(Path(file), part) if part is not None and file != STREAM else None
    if source is None:
        return whole
    click.echo(f"note: `{part}` has open ports: this is its example", err=True)
    return Model(source, None)


def setting(text: str, option: str = "--set", example: str = "a=171 um") -> tuple[str, str]:
    """Both sides of `NAME=VALUE`. Raises `click.UsageError`."""
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        form = "NAME=VALUE" if option == "--set" else "a name and what it takes"
        raise click.UsageError(f'{option} takes {form}, as in {option} "{example}"; this is `{text}`')
    return name.strip(), value.strip()


def settings_by_name(texts: Sequence[str], option: str = "--set", example: str = "a=171 um") -> dict[str, str]:
    """Names and values of an option that may stand several times. Raises `click.UsageError`, also for a name that stands twice."""
    result: dict[str, str] = {}
    for name, value in (setting(text, option, example) for text in texts):
        if name in result:
            raise click.UsageError(f"{option} has `{name}` twice, as `{result[name]}` and as `{value}`: leave one out")
        result[name] = value
    return result


@contextmanager
def written(out: str, ending: str) -> Iterator[str]:
    """Provide the file that an option names; for `-` a temporary one with this ending, whose bytes then go to the standard output."""
    if out != STREAM:
        yield out
        return
    with TemporaryDirectory() as folder:
        path = Path(folder, f"output{ending}")
        yield str(path)
        click.echo(path.read_bytes(), nl=False)


def check_target(path: str, endings: tuple[str, ...], option: str) -> None:
    from ..files import check_writable

    if not path.endswith(endings):
        raise click.UsageError(f"{option} takes a file that ends in {' or '.join(endings)}; this is `{path}`")
    check_writable(path)


def check_targets(*targets: tuple[str | None, tuple[str, ...], str]) -> None:
    """Check before any computation that files can be written: paths, their endings, the options that name them."""
    for path, endings, option in targets:
        if path is not None:
            check_target(path, endings, option)


@contextmanager
def shared_out(jobs: int | None, journal: str | None) -> Iterator[Workers]:
    """Provide processes for many points (None: one for each core), with a progress bar on the terminal, and a journal to go on from."""
    from ..studies.journal import Journal
    from ..studies.workers import Workers, cores

    count = cores() if jobs is None else jobs
    book = None if journal is None else Journal(journal)
    try:
        with bar("points") as progress:
            if count == 1 or sys.platform == "linux":
                yield Workers(count, None, progress, book)
                return
            from concurrent.futures import ProcessPoolExecutor
            from multiprocessing import get_context

            with ProcessPoolExecutor(count, get_context("spawn")) as executor:
                yield Workers(count, executor, progress, book)
    finally:
        if book is not None:
            book.close()


def named(experiment: str) -> str | None:
    return None if experiment == "none" else experiment


def seconds_of(time: str | None) -> float | None:
    if time is None:
        return None
    from ..simulation.run_options import seconds

    return seconds(time)


def echo(found: Any, as_json: bool) -> None:
    click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.summary())


def echo_readings(model: Model, experiment: str | None, settings: Mapping[str, str]) -> None:
    """Write notes on units that are read as names of the model."""
    for note in model.compilation(model.scene(experiment, settings)).readings:
        click.echo(f"note: {note}", err=True)


def show_progress(text: str) -> None:
    """Write a text over the last one on a terminal; "" clears it."""
    if sys.stderr.isatty():
        click.echo(f"\r\x1b[K{text}", nl=False, err=True)


@contextmanager
def bar(words: str) -> Iterator[Progress | None]:
    """Yield a function that shows the number of finished points, without a thread, as a process with threads cannot be copied.

    None if the error stream is no terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False) as shown:
        task = shown.add_task(words, total=None)

        def told(done: int, total: int) -> None:
            shown.update(task, completed=done, total=total)
            shown.refresh()

        yield told
