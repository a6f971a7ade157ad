"""`bondgraph fit`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import setting


@analysis("fit", of_outputs=False)
@click.option(
    "--data", "data", multiple=True, required=True, metavar="D.csv",
    help="Measured: `fx [uN],x [um],sigma x [um]`, `frequency 1 [Hz]`, or outputs over `time [s]` (several times: all of them).",
)  # fmt: skip
@click.option(
    "--parameter", "parameters", multiple=True, required=True, metavar='"NAME=LOW .. HIGH"',
    help="What to find: `d=1.5 um .. 2.5 um`, `k=log 1 N/m .. 100 N/m`, or its name alone.",
)  # fmt: skip
@click.option("--explain/--no-explain", default=None, help="Tell which few parameters would explain the data alone.")
@click.option("--out", metavar="F.csv|.npz|.nc|.mat|-", help="Write measured and computed; `-` prints them as CSV.")
@picture_option("F.png", "Draw measured and computed")
def command(asked: AnalysisCall, data: Sequence[str], parameters: Sequence[str], explain: bool | None) -> None:
    """Find the parameters that explain measured data, and how sure they are."""
    names = [p.partition("=")[0].strip() for p in parameters]
    for name in names:
        if names.count(name) > 1:
            raise click.UsageError(f"--parameter has `{name}` twice: leave one out")
    sought = dict(setting(p, "--parameter", "k=1 N/m .. 2 N/m") if "=" in p else (p.strip(), "") for p in parameters)
    asked.answer(asked.model.fit(list(data), sought, asked.experiment, asked.settings, explain))
