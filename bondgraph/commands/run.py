"""`bondgraph run`."""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from compiler.api import SOLVERS

from .error_reporting import FAILED, harmless, problems_told
from .options import (
    TABLES,
    check_target,
    experiment_option,
    file_argument,
    jobs_option,
    journal_option,
    load,
    model_option,
    outputs_option,
    settings_by_name,
    shared_out,
)

if TYPE_CHECKING:
    from .. import Model
    from ..results.result import Result


@click.command("run")
@file_argument
@experiment_option
@outputs_option
@model_option
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
    help=", ".join(s.word + f" ({s.purpose})" * bool(s.purpose) for s in SOLVERS.values()) + ".",
)
@click.option(
    "--bandwidth", metavar="FREQUENCY", help="What is faster need not be followed: `50 kHz`, or a number of Hz."
)
@click.option("--target", metavar="TARGET", help="native (machine code) or numpy; the first that this machine has.")
@click.option("--energy", is_flag=True, help="Add the energy balance; then all states are computed.")
@click.option(
    "--check",
    is_flag=True,
    help="Repeat the run by another method, more tightly, and tell what differs; exit code 3 if the tolerance does not cover it.",
)
@click.option("--from", "start", metavar="R.npz", help="Go on from where the run of this result ended.")
@click.option("--out", metavar="R.csv|.npz|.nc|.mat", help="Write all values.")
@click.option("--plot", metavar="R.png", help="Draw the outputs (.png, .svg or .pdf).")
@click.option("--over", metavar="NAME", help="Draw them over this output instead of over time.")
@click.option("--plot-energy", metavar="E.png", help="Draw energy over time, and that of the largest elements.")
@jobs_option
@journal_option
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON (schema bondgraph-result/1).")
def command(
    file: str, experiment: str, outputs: Sequence[str], model: str | None, settings: Sequence[str], to: str | None, points: int | None, rtol: float | None,
    atol: float | None, solver: str | None, bandwidth: str | None, target: str | None, energy: bool, check: bool, start: str | None, out: str | None,
    plot: str | None, over: str | None, plot_energy: str | None, jobs: int | None, journal: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Simulate a model: the first experiment of the file, or the one named with -e."""
    from ..errors import ManyRuns, RunBroken, RunFailed, RunInterrupted

    with problems_told():
        if out is not None:
            check_target(out, TABLES, "--out")
        if plot is not None:
            check_target(plot, (".png", ".svg", ".pdf"), "--plot")
        if over is not None and plot is None:
            raise click.UsageError("--over says over which output --plot draws: name a file with --plot")
        if plot_energy is not None:
            check_target(plot_energy, (".png", ".svg", ".pdf"), "--plot-energy")
        from .. import native

        native.announce = lambda text: click.echo(f"note: {text}", err=True)
        chosen, asked = load(file, model), None if experiment == "none" else experiment
        given = settings_by_name(settings)
        analyses = _make_ready(chosen, asked, given, tuple(outputs) or None, energy, target, journal)
        arguments: dict[str, Any] = {
            "settings": given, "to": to, "points": points, "rtol": rtol, "atol": atol,
            "energy": energy, "outputs": tuple(outputs) or None, "target": target, "solver": solver, "bandwidth": bandwidth,
        }  # fmt: skip
        try:
            if analyses and start is None and over is None and plot_energy is None:
                raise ManyRuns("BR610", "the experiment has analyses besides its simulation")
            result = chosen.simulate(asked, start=start, check=check, **arguments)
        except ManyRuns:
            if start is not None:
                raise
            if over is not None or plot_energy is not None or check:
                raise
            _run_all(chosen, experiment, arguments, (jobs, journal), (out, plot, as_json))
            return
        except (RunFailed, RunInterrupted, RunBroken) as stopped:
            if stopped.result is not None:
                _show(stopped.result, out, plot, over, as_json, isinstance(stopped, RunInterrupted))
                click.echo(harmless(_how_to_go_on(stopped.result, file, out)), err=True)
            raise
        _show(result, out, plot, over, as_json, True)
        if plot_energy is not None:
            from ..analysis.energies import energies

            energies(chosen, asked, given, to, points, rtol).plot(plot_energy)
        if result.check is not None and not result.check.holds:
            raise click.exceptions.Exit(FAILED)


def _make_ready(
    model: Model, experiment: str | None, given: dict[str, str], outputs: tuple[str, ...] | None, energy: bool, target: str | None,
    journal: str | None,
) -> bool:  # fmt: skip
    """Compile before the run, and turn on garbage collection for later objects; return True if the experiment also has analyses."""
    from ..prepared import chosen_target, many_runs
    from ..simulation.settings import settle

    chosen = chosen_target(target)
    scene = settle(model, experiment, given, outputs, energy, chosen).scene
    plan = model.prepared(scene, energy, chosen).plan
    if journal is not None and not plan.studies and many_runs(plan, scene) is None:
        raise click.UsageError(
            "--journal keeps the points of experiments with many runs; this is one run, which --out keeps"
        )
    if not gc.isenabled():  # otherwise the caller controls it
        gc.freeze()
        gc.enable()
    return bool(plan.studies)


def _show(result: Result, out: str | None, plot: str | None, over: str | None, as_json: bool, summary: bool) -> None:
    """Write and print the result of a run."""
    for left in result.warnings:
        click.echo(f"warning: {left}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    if out is not None:
        result.write(out)
    if plot is not None and len(result.time) > 1:
        result.plot(plot, over)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2))
    elif summary and len(result.time):
        click.echo(result.summary(_has_bars()))


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
    model: Model,
    experiment: str,
    arguments: dict[str, Any],
    by: tuple[int | None, str | None],
    shown: tuple[Any, Any, bool],
) -> None:
    """Execute an experiment with sweeps, or with analyses instead of a simulation."""
    out, plot, as_json = shown
    if out is not None:
        check_target(out, TABLES, "--out (of an experiment with a sweep or an analysis)")
    with shared_out(*by, "points") as workers:
        found = model.run(experiment, workers=workers, **arguments)
    if out is not None:
        found.write(out)
    if plot is not None:
        found.plot(plot)
    click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.summary())
