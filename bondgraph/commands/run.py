"""`bondgraph run`."""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from compiler.api import SOLVERS

from ..errors import ManyRuns, RunBroken, RunFailed, RunInterrupted
from . import completion
from .error_reporting import FAILED, harmless, problems_told
from .options import (
    STREAM,
    TABLES,
    OutputFiles,
    check_target,
    echo_readings,
    experiment_option,
    file_argument,
    jobs_option,
    journal_option,
    load,
    model_option,
    named,
    outputs_option,
    settings_by_name,
    shared_out,
    taken,
)

if TYPE_CHECKING:
    from .. import Model
    from ..results.result import Result
    from ..studies.comparison import Other


@dataclass(frozen=True, slots=True)
class Beside:
    """Output over which others are drawn, and results and data beside which they are."""

    over: str | None = None
    against: tuple[Other, ...] = ()

    def opened(self, files: OutputFiles) -> Beside:
        """Return the same with the results read, before any computation. Raises UsageError, OSError."""
        if self.over is not None and files.plot is None:
            raise click.UsageError("--over says over which output --plot draws: name a file with --plot")
        if self.over is not None and self.against:
            raise click.UsageError("--against draws over time: leave out --over")
        if not self.against:
            return self
        from ..studies.comparison import opened

        return replace(self, against=opened([str(file) for file in self.against]))


@click.command("run")
@file_argument
@experiment_option
@outputs_option
@model_option
@click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", shell_complete=completion.settings,
    help="Set a parameter (`a=171 um`) or an input (any expression of time); once for each.",
)  # fmt: skip
@click.option("--to", metavar="TIME", help="Where the run ends: `20 ms`, or a number of seconds.")
@click.option("--points", type=int, metavar="N", help="How many equally spaced instants to report, both ends included (501).")  # fmt: skip
@click.option("--rtol", type=float, metavar="X", help="Relative tolerance (1e-6).")
@click.option("--accuracy", type=float, metavar="X", help="Largest error of an output relative to its magnitude; the tolerance follows.")  # fmt: skip
@click.option("--atol", type=float, metavar="X", help="Absolute tolerance of every state in SI; from magnitudes if left out.")  # fmt: skip
@click.option(
    "--solver", metavar="SOLVER", help=", ".join(s.word + f" ({s.purpose})" * bool(s.purpose) for s in SOLVERS.values()) + "."
)  # fmt: skip
@click.option("--bandwidth", metavar="FREQUENCY", help="What is faster need not be followed: `50 kHz`, or a number of Hz.")  # fmt: skip
@click.option("--target", metavar="TARGET", help="native (machine code) or numpy; the first that this machine has.")
@click.option("--energy", is_flag=True, help="Add the energy balance; then all states are computed.")
@click.option(
    "--check", is_flag=True,
    help="Repeat the run by another method, more tightly, and tell what differs; exit code 3 if the tolerance does not cover it.",
)  # fmt: skip
@click.option("--error", is_flag=True, help="Estimate the error of each output; --json always does.")
@click.option("--from", "start", metavar="R.npz", help="Go on from where the run of this result ended.")
@click.option(
    "--out", metavar="R.csv|.npz|.nc|.mat|-", help="Write all values; `-` prints them as CSV, and nothing else."
)
@click.option("--plot", metavar="R.png", help="Draw the outputs (.png, .svg or .pdf).")
@click.option(
    "--over", metavar="NAME", shell_complete=completion.outputs, help="Draw them over this output instead of over time."
)
@click.option("--against", multiple=True, metavar="R.npz|DATA.csv", help="Tell the differences from these, and draw them, too.")  # fmt: skip
@click.option("--plot-energy", metavar="E.png", help="Draw energy over time, and that of the largest elements.")
@jobs_option
@journal_option
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON (schema bondgraph-result/1).")
def command(
    file: str, experiment: str, model: str | None, settings: Sequence[str], jobs: int | None, journal: str | None, **options: Any
) -> None:  # fmt: skip
    """Simulate a model: the first experiment of the file, or the one named with -e."""
    files, beside = taken(OutputFiles, options), taken(Beside, options)
    error_asked = options["error"]
    options["error"] = error_asked or (files.as_json and options["start"] is None)
    with problems_told():
        files.check()
        beside = beside.opened(files)
        from .. import native

        native.announce = lambda text: click.echo(f"note: {text}", err=True)
        chosen, experiment_name, assignments = load(file, model), named(experiment), settings_by_name(settings)
        options["outputs"] = tuple(options["outputs"]) or None
        analyses = _make_ready(chosen, experiment_name, assignments, journal, options)
        many = options["start"] is None and beside == Beside() and files.plot_energy is None
        try:
            if analyses and many:
                raise ManyRuns("BR610", "the experiment has analyses besides its simulation")
            result = chosen.simulate(experiment_name, assignments, extremes=True, **options)
        except ManyRuns:
            if options.pop("check") or error_asked or not many:
                raise
            del options["start"], options["error"]
            _run_all(chosen, experiment, {"settings": assignments, **options}, (jobs, journal), files)
            return
        except (RunFailed, RunInterrupted, RunBroken) as stopped:
            if stopped.result is not None:
                _show(stopped.result, files, beside, isinstance(stopped, RunInterrupted))
                click.echo(
                    harmless(_how_to_go_on(stopped.result, file, None if files.out == STREAM else files.out)), err=True
                )
            raise
        _show(result, files, beside, True)
        if files.plot_energy is not None:
            from ..analysis.energies import energies

            run = options["to"], options["points"], options["rtol"]
            energies(chosen, experiment_name, assignments, *run).plot(files.plot_energy)
        if result.check is not None and not result.check.holds:
            raise click.exceptions.Exit(FAILED)


def _make_ready(
    model: Model, experiment: str | None, settings: dict[str, str], journal: str | None, options: dict[str, Any]
) -> bool:
    """Compile before the run, and turn on garbage collection for later objects; return True if the experiment also has analyses."""
    from ..compiled_scene import chosen_target, many_runs
    from ..simulation.settings import settle

    chosen, energy = chosen_target(options["target"]), options["energy"]
    scene = settle(model, experiment, settings, options["outputs"], energy, chosen).scene
    plan = model.compiled_scene(scene, energy, chosen).plan
    if journal is not None and not plan.studies and many_runs(plan, scene) is None:
        raise click.UsageError(
            "--journal keeps the points of experiments with many runs; this is one run, which --out keeps"
        )
    if not gc.isenabled():  # otherwise the caller controls it
        gc.freeze()
        gc.enable()
    return bool(plan.studies)


def _show(result: Result, files: OutputFiles, beside: Beside, summary: bool) -> None:
    """Write and print the result of a run, beside others."""
    for left in result.warnings:
        click.echo(f"warning: {left}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    printed = files.write(result)
    comparison = None
    if beside.against:
        from ..studies.comparison import compare

        comparison = compare(result, *beside.against)
    if files.plot is not None and len(result.time) > 1:
        result.plot(files.plot, beside.over) if comparison is None else comparison.plot(files.plot)
    if printed:
        return
    if files.as_json:
        compared = {} if comparison is None else {"against": comparison.to_json()}
        click.echo(json.dumps(result.to_json() | compared, indent=2))
    elif summary and len(result.time):
        click.echo("\n\n".join([result.summary(_has_bars()), *([] if comparison is None else [comparison.summary()])]))


def _how_to_go_on(result: Result, file: str, out: str | None) -> str:
    """Return a message on the part of a run that stopped early, and on how to go on."""
    count = f"{len(result.time)} instant{'s' * (len(result.time) != 1)}"
    if out is None:
        return f"{count} {'were' if len(result.time) != 1 else 'was'} computed; `--out R.npz` keeps what there is"
    written = f"{count} {'are' if len(result.time) != 1 else 'is'} in {out}"
    if not out.endswith(".npz") or result.checkpoint is None:
        return written
    return f"{written}; `bondgraph run {file} --from {out} --out {out}` goes on from t = {result.checkpoint.time:.6g} s"


def _has_bars() -> bool:
    """Return True if the output is a terminal that can show bars; a file or a pipe gets plain tables."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return False
    try:
        "▁█".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _run_all(
    model: Model, experiment: str, options: dict[str, Any], by: tuple[int | None, str | None], files: OutputFiles
) -> None:
    """Execute an experiment with sweeps, or with analyses instead of a simulation."""
    if files.out is not None and files.out != STREAM:
        check_target(files.out, TABLES, "--out (of an experiment with a sweep or an analysis)")
    with shared_out(*by) as workers:
        found = model.run(experiment, workers=workers, **options)
    echo_readings(model, experiment, options["settings"])
    printed = files.write(found)
    if files.plot is not None:
        found.plot(files.plot)
    if not printed:
        click.echo(json.dumps(found.to_json(), indent=2) if files.as_json else found.summary())
