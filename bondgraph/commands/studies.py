"""Commands of studies, which run a model many times: benchmarks, stress tests, sweeps, Monte Carlo, fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import click

from . import completion
from .analysis import AnalysisCall, analysis, picture_option
from .error_reporting import FAILED
from .options import Command, jobs_option, journal_option, setting, settings_by_name, shared_out, show_progress


@analysis("benchmark")
@click.option("--error", type=float, default=1e-6, metavar="X", help="The wanted error of each output relative to its magnitude (1e-6).")  # fmt: skip
@click.option("--rounds", type=click.IntRange(1), default=3, metavar="N", help="How often each run is timed (3).")
@click.option("--alone", is_flag=True, help="Without the solvers of other programs over the same equations.")
@click.option("--to", metavar="TIME", help="Where the run ends.")
@picture_option("W.png", "Draw run time against error")
def benchmark(asked: AnalysisCall, error: float, rounds: int, alone: bool, to: str | None) -> None:
    """Run an experiment with every solver at every tolerance: time, error, and which to take."""
    found = asked.model.benchmark(
        error=error, rounds=rounds, peers=not alone, to=to, outputs=asked.outputs, progress=show_progress, **asked.keywords
    )  # fmt: skip
    show_progress("")
    asked.answer(found)


@analysis("stress", checked=False)
@click.option("--for", "duration", default="30 s", metavar="TIME", help="How long to try (30 s).")
@click.option(
    "--vary", multiple=True, metavar='"NAME=LOW .. HIGH"', shell_complete=completion.settings,
    help="Try the corners of this range, also of a start (`start x`).",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, metavar="N", help="Seed of what is drawn (0).")
@click.option("--out", metavar="FOLDER", help="Write the smallest files that show what broke; a third of the time is for them.")  # fmt: skip
@click.option("--to", metavar="TIME", help="Where the run ends.")
def stress(asked: AnalysisCall, duration: str, vary: Sequence[str], seed: int, to: str | None) -> None:
    """Try a model with changes that must keep its results; exit code 3 if one of them does not."""
    from ..simulation.run_options import seconds

    ranges = settings_by_name(vary, "--vary", "k=1 N/m .. 2 N/m")
    test = asked.model.stress(
        seconds=seconds(duration), to=to, outputs=asked.outputs, vary=ranges, seed=seed, out=asked.files.out, progress=show_progress, **asked.keywords
    )  # fmt: skip
    show_progress("")
    asked.print(test)
    if not test.holds:
        raise click.exceptions.Exit(FAILED)


def of_option(usual: str) -> Callable[[Command], Command]:
    """Return the option for what a study makes at each of its points."""
    kinds = click.Choice(["equilibrium", "modes", "simulate"])
    return click.option("--of", "of", multiple=True, type=kinds, help=f"What is made at each point ({usual}).")


@analysis("sweep")
@click.option(
    "--over", "over", multiple=True, required=True, metavar='"NAME=V, V…"', shell_complete=completion.settings,
    help="Values of a parameter or input: `k=1 N/m, 2 N/m`, or `k=1 N/m .. 2 N/m : 11`; several times: a grid.",
)  # fmt: skip
@of_option("simulate")
@click.option("--together", is_flag=True, help="No grid: the first values of all, the second ones and so on.")
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="S.csv|.npz|.nc|.mat|-", help="Write the table; `-` prints it as CSV.")
@picture_option("S.png", "Draw what was found over what was swept last")
@click.option("--curves", metavar="C.png", help="Draw all runs over time: a curve for each, bands of more than twelve.")
def sweep(
    asked: AnalysisCall, over: Sequence[str], of: Sequence[str], together: bool, to: str | None, jobs: int | None, journal: str | None
) -> None:  # fmt: skip
    """Make equilibria, modes or runs at many values of parameters and inputs."""
    values = settings_by_name(over, "--over", "k=1 N/m, 2 N/m")
    with shared_out(jobs, journal) as workers:
        found = asked.model.sweep(
            values, tuple(of) or "simulate", together, workers=workers, to=to, outputs=asked.outputs, **asked.keywords
        )  # fmt: skip
    asked.answer(found)


@analysis("montecarlo")
@click.option(
    "--vary", "vary", multiple=True, required=True, metavar='"NAME=DISTRIBUTION"', shell_complete=completion.settings,
    help="`d=normal(2 um, 50 nm)`, lognormal (mean, standard deviation), uniform, triangular (low, most likely, high), truncated(one of these, low, high).",
)  # fmt: skip
@click.option(
    "--correlation", "correlations", multiple=True, metavar='"NAME, NAME=R"', help="Of a Gaussian copula; 0 if left out."
)  # fmt: skip
@of_option("modes")
@click.option("--samples", type=int, default=1000, metavar="N", help="How many points (1000).")
@click.option("--seed", type=click.IntRange(0), default=0, metavar="N", help="Of the quasi-random points (0).")
@click.option(
    "--indices", type=int, metavar="N", help="Rows that Sobol indices stand on, a power of two (1024); 0: none."
)
@click.option("--to", metavar="TIME", help="Where simulations end.")
@jobs_option
@journal_option
@click.option("--out", metavar="M.csv|.npz|.nc|.mat|-", help="Write all points; `-` prints them as CSV.")
@picture_option("H.png", "Draw histograms")
@click.option("--tornado", metavar="T.png", help="Draw what moves each quantity, and how far.")
def montecarlo(
    asked: AnalysisCall, vary: Sequence[str], correlations: Sequence[str], of: Sequence[str], jobs: int | None, journal: str | None, **options: Any
) -> None:  # fmt: skip
    """Tell what tolerances of parameters do to rest, frequencies or runs: statistics, Sobol indices, swings."""
    with shared_out(jobs, journal) as workers:
        found = asked.model.montecarlo(
            settings_by_name(vary, "--vary", "d=normal(2 um, 50 nm)"), tuple(of) or "modes", workers=workers,
            correlations=dict(map(_correlation, correlations)), outputs=asked.outputs, **asked.keywords, **options,
        )  # fmt: skip
    asked.answer(found)


def _correlation(text: str) -> tuple[tuple[str, str], float]:
    names, sign, value = text.partition("=")
    one, comma, other = names.partition(",")
    try:
        if sign and comma and one.strip() and other.strip():
            return (one.strip(), other.strip()), float(value)
    except ValueError:
        pass  # no number: the same answer
    raise click.UsageError(f"--correlation takes NAME, NAME=R with R from -1 to 1; this is `{text}`")


@analysis("fit", of_outputs=False)
@click.option(
    "--data", "data", multiple=True, required=True, metavar="D.csv",
    help="Measured: `fx [uN],x [um],sigma x [um]`, `frequency 1 [Hz]`, or outputs over `time [s]` (several times: all of them).",
)  # fmt: skip
@click.option(
    "--parameter", "parameters", multiple=True, required=True, metavar='"NAME=LOW .. HIGH"', shell_complete=completion.settings,
    help="What to find: `d=1.5 um .. 2.5 um`, `k=log 1 N/m .. 100 N/m`, or its name alone.",
)  # fmt: skip
@click.option("--explain/--no-explain", default=None, help="Tell which few parameters would explain the data alone.")
@click.option("--out", metavar="F.csv|.npz|.nc|.mat|-", help="Write measured and computed; `-` prints them as CSV.")
@picture_option("F.png", "Draw measured and computed")
def fit(asked: AnalysisCall, data: Sequence[str], parameters: Sequence[str], explain: bool | None) -> None:
    """Find the parameters that explain measured data, and how sure they are."""
    names = [p.partition("=")[0].strip() for p in parameters]
    for name in names:
        if names.count(name) > 1:
            raise click.UsageError(f"--parameter has `{name}` twice: leave one out")
    sought = dict(setting(p, "--parameter", "k=1 N/m .. 2 N/m") if "=" in p else (p.strip(), "") for p in parameters)
    asked.answer(asked.model.fit(list(data), sought, asked.experiment, asked.settings, explain))
