"""The command line: `bondgraph check|certificate|run|explain|causality|draw|show|equations|compile|fmt|new`; analyses in `cli_analyses.py`.

Exit codes: 0 fine, 1 the file is wrong, 2 usage, 3 the numbers failed, 70 a defect of ours, 130 interrupted.
"""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from .door import Diagnostic, Scene
    from .model import Model
    from .results import Result

WRONG, USAGE, FAILED, DEFECT, INTERRUPTED = 1, 2, 3, 70, 130
CHECK_SCHEMA = "bondgraph-check/1"


def main() -> None:
    """Entry of the `bondgraph` command."""
    gc.disable()  # what a command reads and makes lives until its end: looking through it for what could go is for nothing
    try:
        code = commands.main(prog_name="bondgraph", standalone_mode=False)
    except click.ClickException as problem:
        problem.show()
        code = problem.exit_code
    except click.exceptions.Abort:
        code = INTERRUPTED
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    sys.exit(code if isinstance(code, int) else 0)


def _harmless(message: str) -> str:
    """A message whose names of files are data: they cannot rewrite the terminal."""
    from .views.tables import visible

    return "\n".join(map(visible, message.split("\n")))


def _stop(message: str, code: int) -> NoReturn:
    """End the command with a message on stderr."""
    click.echo(_harmless(message), err=True)
    raise click.exceptions.Exit(code)


@contextmanager
def _told() -> Iterator[None]:
    """Turn what can go wrong into a message and an exit code."""
    from .errors import MissingPackage, RunFailed, UsageError

    try:
        yield
    except (click.ClickException, click.exceptions.Exit, BrokenPipeError):
        raise
    except KeyboardInterrupt as interrupted:
        _stop(str(interrupted) or "interrupted", INTERRUPTED)
    except RunFailed as failed:
        _stop(f"the run failed: {failed}", FAILED)
    except (UsageError, MissingPackage) as problem:
        _stop(f"bondgraph: {problem}", USAGE)
    except UnicodeDecodeError as problem:
        _stop(f"bondgraph: a file is not a text in UTF-8 ({problem.reason})", USAGE)
    except OSError as problem:
        _stop(f"bondgraph: {problem.filename or 'file'}: {problem.strerror or problem}", USAGE)
    except Exception as problem:
        from .door import CompilationFailed, render

        if isinstance(problem, CompilationFailed):
            _stop("\n\n".join(render(d) for d in problem.diagnostics), WRONG)
        if os.environ.get("BONDGRAPH_DEBUG"):
            raise
        missing = problem.name if isinstance(problem, ModuleNotFoundError) else None
        if missing is not None and missing.partition(".")[0] not in ("bondgraph", "compiler"):
            _stop(
                f"bondgraph: the package `{missing}` is not installed; `pip install bondgraph-lang` brings what is needed",
                USAGE,
            )
        kind = type(problem).__name__
        advice = "set BONDGRAPH_DEBUG=1 for the traceback and send it with your file"
        _stop(f"bondgraph: a defect of ours, not of your file ({kind}: {problem}); {advice}", DEFECT)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="bondgraph-lang", message="bondgraph %(version)s")
def commands() -> None:
    """Check, compile and simulate bond graphs written as text."""


_model = click.option("--model", metavar="NAME", help="The model to use, if the file has several.")
_file = click.argument("file", metavar="FILE")
_outputs = click.option(
    "--output",
    "outputs",
    multiple=True,
    metavar="NAME",
    help="Only this output (several times: these); what they do not need is left out.",
)
_experiment = click.option(
    "-e", "--experiment", default="", metavar="NAME", help="Which experiment (`none` for none); the first if left out."
)


# ---------------------------------------------------------------- check


@commands.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON (schema bondgraph-check/1).")
@_model
def check(files: Sequence[str], as_json: bool, model: str | None) -> None:
    """Tell everything that is wrong with some files; of fine ones, what kind of equations a run solves."""
    with _told():
        from .model import certify

        gc.disable()  # the process ends with this: what it makes need not be walked through, nor at its end
        examined = [certify(Path(file), model) for file in files]
        found = [d for diagnostics, _ in examined for d in diagnostics]
        gc.freeze()
        if as_json:
            click.echo(json.dumps(_check_json(files, found), indent=2))
        elif found:
            from .door import render

            click.echo("\n\n".join(render(d) for d in found), err=True)
        else:
            for certificate in (c for _, c in examined if c is not None):
                click.echo("\n".join([certificate.line, *(f"  note: {n}" for n in certificate.notes)]))
            click.echo(f"{len(files)} file{'s' * (len(files) > 1)} fine")
    if found:
        raise click.exceptions.Exit(WRONG)


def _check_json(files: Sequence[str], found: Sequence[Diagnostic]) -> dict[str, Any]:
    """`bondgraph-check/1`: {schema, files, diagnostics: [{file, line, column, code, message, help}]}."""
    told = [
        {"file": d.span.source.name, "line": d.span.line, "column": d.span.column, "code": d.code, "message": d.sentence, "help": d.help}
        for d in found
    ]  # fmt: skip
    return {"schema": CHECK_SCHEMA, "files": list(files), "diagnostics": told}


@commands.command()
@_file
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-certificate/1).")
@_model
def certificate(file: str, as_json: bool, model: str | None) -> None:
    """Tell what kind of equations a model has: form, index, states, loops, what was left out."""
    with _told():
        told = _load(file, model).certificate
        click.echo(json.dumps(told.to_json(), indent=2) if as_json else str(told))


# ---------------------------------------------------------------- run


def _make_ready(model: Model, scene: Scene, energy: bool, target: str | None) -> None:
    """Compile before anything runs; a run may be long, and what it leaves behind is collected again, but for what is there now."""
    from .prepared import chosen_target

    _ = model.prepared(scene, energy, chosen_target(target)).plan
    if gc.isenabled():
        return  # somebody else looks after it
    gc.freeze()
    gc.enable()


@commands.command()
@_file
@_experiment
@_outputs
@_model
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Set a parameter (`a=171 um`) or an input (any expression of time).",
)
@click.option("--to", metavar="TIME", help="Where the run ends: `20 ms`, or a number of seconds.")
@click.option(
    "--points", type=int, metavar="N", help="How many equally spaced instants to report, both ends included (501)."
)
@click.option("--rtol", type=float, metavar="X", help="Relative tolerance (1e-6).")
@click.option(
    "--atol", type=float, metavar="X", help="Absolute tolerance of every state in SI; from magnitudes if left out."
)
@click.option(
    "--solver",
    metavar="SOLVER",
    help="automatic, exponential, explicit, radau or energy (keeps that of lossless models).",
)
@click.option("--target", metavar="TARGET", help="native (machine code) or numpy; the first that this machine has.")
@click.option("--energy", is_flag=True, help="Add the energy balance; then all states are computed.")
@click.option("--from", "start", metavar="R.npz", help="Go on from where the run of this result ended.")
@click.option("--out", metavar="R.csv|R.npz", help="Write all values.")
@click.option("--plot", metavar="R.png", help="Draw the outputs (.png, .svg or .pdf).")
@click.option(
    "--jobs", type=click.IntRange(1, 1024), metavar="N", help="How many processes make the points of a sweep (1)."
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON (schema bondgraph-result/1).")
def run(
    file: str, experiment: str, outputs: Sequence[str], model: str | None, settings: Sequence[str], to: str | None, points: int | None, rtol: float | None,
    atol: float | None, solver: str | None, target: str | None, energy: bool, start: str | None, out: str | None, plot: str | None,
    jobs: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Simulate a model: the first experiment of the file, or the one named with -e."""
    from .errors import ManyRuns, RunBroken, RunFailed, RunInterrupted

    with _told():
        if out is not None:
            _check_target(out, (".csv", ".npz"), "--out")
        if plot is not None:
            _check_target(plot, (".png", ".svg", ".pdf"), "--plot")
        from . import native

        native.announce = lambda text: click.echo(f"note: {text}", err=True)
        chosen, asked = _load(file, model), None if experiment == "none" else experiment
        given = dict(map(_setting, settings))
        if not given:  # what is set is an argument, or compiled in: the run finds that out
            _make_ready(chosen, chosen.scene(asked, {}, (), tuple(outputs) or None), energy, target)
        arguments: dict[str, Any] = {
            "settings": given, "to": to, "points": points, "rtol": rtol, "atol": atol,
            "energy": energy, "outputs": tuple(outputs) or None, "target": target, "solver": solver,
        }  # fmt: skip
        try:
            result = chosen.simulate(asked, start=start, **arguments)
        except ManyRuns:
            if start is not None:
                raise
            _run_all(chosen, experiment, arguments, jobs, (out, plot, as_json))
            return
        except (RunFailed, RunInterrupted, RunBroken) as stopped:
            if stopped.result is not None:
                _show(stopped.result, out, plot, as_json, isinstance(stopped, RunInterrupted))
                click.echo(_harmless(_how_to_go_on(stopped.result, file, out)), err=True)
            raise
        _show(result, out, plot, as_json, True)


def _show(result: Result, out: str | None, plot: str | None, as_json: bool, summary: bool) -> None:
    """Write and tell what a run found."""
    for left in result.warnings:
        click.echo(f"warning: {left}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    if out is not None:
        if out.endswith(".csv"):
            result.to_csv(out)
        else:
            result.to_npz(out)
    if plot is not None and len(result.time) > 1:
        result.plot(plot)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2))
    elif summary and len(result.time):
        click.echo(result.summary(_has_bars()))


def _how_to_go_on(result: Result, file: str, out: str | None) -> str:
    """What is left of a run that stopped early, and what can be done with it."""
    count = f"{len(result.time)} instant{'s' * (len(result.time) != 1)}"
    if out is None:
        return f"{count} {'were' if len(result.time) != 1 else 'was'} computed; `--out R.npz` keeps what there is"
    written = f"{count} {'are' if len(result.time) != 1 else 'is'} in {out}"
    if not out.endswith(".npz") or result.end is None:
        return written
    return f"{written}; `bondgraph run {file} --from {out} --out {out}` goes on from t = {result.end.time:.6g} s"


def _has_bars() -> bool:
    """Whether what is printed goes to a terminal that has bars among its letters; a file or a pipe gets plain tables."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return False
    try:
        "▁█".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _run_all(
    model: Model, experiment: str, arguments: dict[str, Any], jobs: int | None, shown: tuple[Any, Any, bool]
) -> None:
    """An experiment that sweeps, or analyses instead of a simulation."""
    out, plot, as_json = shown
    if out is not None:
        _check_target(out, (".csv",), "--out (of an experiment with a sweep or an analysis)")
    with _workers(jobs) as executor:
        found = model.run(experiment, executor=executor, **arguments)
    if out is not None:
        found.to_csv(out)
    if plot is not None:
        found.plot(plot)
    click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.summary())


@contextmanager
def _workers(jobs: int | None) -> Iterator[Any]:
    """Processes that make points of a sweep; None for this one."""
    if not jobs or jobs == 1:
        yield None
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(jobs, get_context("spawn")) as executor:
        yield executor


def _load(file: str, model: str | None) -> Model:
    from .model import load

    return load(Path(file), model)


def _setting(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        raise click.UsageError(f'--set takes NAME=VALUE, as in --set "a=171 um"; this is `{text}`')
    return name.strip(), value.strip()


def _check_target(path: str, endings: tuple[str, ...], option: str) -> None:
    from .files import check_writable

    if not path.endswith(endings):
        raise click.UsageError(f"{option} takes a file that ends in {' or '.join(endings)}; this is `{path}`")
    check_writable(path)


# ---------------------------------------------------------------- stages


@commands.command()
@_file
@click.option(
    "--stage",
    required=True,
    metavar="STAGE",
    help="syntax, graph, causality, equations, reduction, code; or text: back in the language, flat.",
)
@_experiment
@_model
def show(file: str, stage: str, experiment: str, model: str | None) -> None:
    """Print one stage of the compiler."""
    with _told():
        click.echo(_load(file, model).show(stage, None if experiment == "none" else experiment))


@commands.command()
@_file
@click.option("-o", "--out", required=True, metavar="X.svg|X.png|X.pdf", help="The file to write.")
@click.option(
    "-e", "--experiment", metavar="NAME", help="As this experiment runs it; else everything that the text says."
)
@click.option("--closed", is_flag=True, help="Instances of the model as boxes.")
@click.option("--numbers", is_flag=True, help="With the numbers of the bonds.")
@click.option("--mechanism", metavar="NAME", help="This mechanism instead, with bodies, joints, springs.")
@click.option("--at", metavar="TIME", help="The mechanism at this time of a run; else as it is described.")
@_model
def draw(
    file: str, out: str, experiment: str | None, closed: bool, numbers: bool, mechanism: str | None, at: str | None, model: str | None
) -> None:  # fmt: skip
    """Draw the bond graph (half arrows, causal strokes, signals), or a mechanism in a pose."""
    with _told():
        from .diagram.picture import ENDINGS

        _check_target(out, ENDINGS, "--out")
        if at is not None and mechanism is None:
            raise click.UsageError("--at is for a mechanism: name it with --mechanism")
        if mechanism is not None:
            _load(file, model).draw_mechanism(out, mechanism, None if experiment == "none" else experiment or "", at)
        else:
            _load(file, model).draw(out, experiment, closed, numbers)


@commands.command()
@_file
@_experiment
@_model
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-causality/1).")
def causality(file: str, experiment: str, model: str | None, as_json: bool) -> None:
    """Print the strokes, and why there are derivative storages and algebraic loops."""
    with _told():
        from .views.causality import explain, told

        chosen = _load(file, model)
        found = explain(chosen.compilation(chosen.scene(None if experiment == "none" else experiment)))
        click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.text())
        if found.diagnostics:
            _stop(told(found.diagnostics), WRONG)


@commands.command()
@_file
@_experiment
@_outputs
@_model
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-explanation/1).")
def explain(file: str, experiment: str, outputs: Sequence[str], model: str | None, as_json: bool) -> None:
    """Tell what a run leaves out and why, what remains, and what is expensive."""
    with _told():
        from .views.explanation import explain as explanation

        chosen = _load(file, model)
        scene = chosen.scene(None if experiment == "none" else experiment, outputs=tuple(outputs) or None)
        found = explanation(chosen.compilation(scene))
        click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.text())


@commands.command()
@_file
@click.option("--latex", is_flag=True, help="As LaTeX.")
@_model
def equations(file: str, latex: bool, model: str | None) -> None:
    """Print the equations in the order in which they are computed."""
    with _told():
        click.echo(_load(file, model).equations(latex))


@commands.command(name="compile")
@_file
@click.option("-o", "--out", required=True, metavar="MODEL.py|MODEL.c", help="The file to write.")
@_model
def compile_(file: str, out: str, model: str | None) -> None:
    """Write a Python module that needs numpy alone, or C that needs nothing."""
    with _told():
        from .files import write_text

        _check_target(out, (".py", ".c"), "--out")
        write_text(out, _load(file, model).compile("c" if out.endswith(".c") else "numpy"))


# ---------------------------------------------------------------- texts


@commands.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.option("--check", "only_check", is_flag=True, help="Write nothing; exit 1 if a file would change.")
def fmt(files: Sequence[str], only_check: bool) -> None:
    """Format files; comments, blank lines and columns stay."""
    with _told():
        from .door import Source, format_text, read_text
        from .files import write_text

        changed = []
        for file in files:
            source = Source(file, read_text(file, newline=""), Path(file))
            text = format_text(source)
            if text != source.text:
                changed.append(file)
                if not only_check:
                    write_text(file, text)
        for file in changed:
            click.echo(f"{'would change' if only_check else 'formatted'} {_harmless(file)}")
    if only_check and changed:
        raise click.exceptions.Exit(WRONG)


@commands.command()
@click.argument("file", metavar="NAME.bg")
def new(file: str) -> None:
    """Write a first model to start from; an existing file is never touched."""
    with _told():
        from .files import write_text
        from .starter import starter_text

        path = Path(file)
        _check_target(file, (".bg",), "new")
        if path.exists():
            raise click.UsageError(f"`{file}` exists already; choose another name")
        write_text(path, starter_text(path.stem))
        click.echo(f"wrote {_harmless(file)}; try: bondgraph run {_harmless(file)}")


from . import cli_analyses  # noqa: E402  (its commands join those above)

__all__ = ["cli_analyses", "commands", "main"]
