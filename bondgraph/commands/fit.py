"""`bondgraph fit`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    TABLES,
    analysed_option,
    check_target,
    echo,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    setting,
    settings_option,
)
from .telling import problems_told


@click.command("fit")
@file_argument
@click.option(
    "--data", "data", multiple=True, required=True, metavar="D.csv",
    help="Measured: `fx [uN],x [um],sigma x [um]`, `frequency 1 [Hz]`, or outputs over `time [s]` (several times: all of them).",
)  # fmt: skip
@click.option(
    "--parameter", "parameters", multiple=True, required=True, metavar='"NAME=LOW .. HIGH"',
    help="What to find: `d=1.5 um .. 2.5 um`, `k=log 1 N/m .. 100 N/m`, or its name alone.",
)  # fmt: skip
@click.option("--explain/--no-explain", default=None, help="Tell which few parameters would explain the data alone.")
@analysed_option
@settings_option
@click.option("--out", metavar="F.csv|.npz|.nc|.mat", help="Write measured and computed.")
@click.option("--plot", metavar="F.png", help="Draw measured and computed (.png, .svg or .pdf).")
@json_option
@model_option
def command(
    file: str, data: Sequence[str], parameters: Sequence[str], explain: bool | None, experiment: str, settings: Sequence[str], out: str | None,
    plot: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Find the parameters that explain measured data, and how sure they are."""
    with problems_told():
        for path, endings, option in ((out, TABLES, "--out"), (plot, (".png", ".svg", ".pdf"), "--plot")):
            if path is not None:
                check_target(path, endings, option)
        sought = dict(setting(p) if "=" in p else (p.strip(), "") for p in parameters)
        found = load(file, model).fit(list(data), sought, named(experiment), dict(map(setting, settings)), explain)
        if out is not None:
            found.write(out)
        if plot is not None:
            found.plot(plot)
        echo(found, as_json)
