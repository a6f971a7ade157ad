"""`bondgraph modes`."""

from __future__ import annotations

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import seconds_of, state_option, time_option


@analysis("modes")
@state_option
@picture_option("M.svg", "Draw the shapes on the mechanism, rest behind them")
@click.option("--mechanism", metavar="NAME", help="Of this mechanism, if there are several.")
@click.option("--shapes", type=click.IntRange(1, 60), default=6, metavar="N", help="How many shapes are drawn (6).")
@time_option
def command(asked: AnalysisCall, state: str, mechanism: str | None, shapes: int, time: str | None) -> None:
    """Print frequencies, damping, and where the energy of each mode is; draw their shapes."""
    model, plot = asked.model, asked.files.plot
    if plot is not None:
        if asked.settings or asked.outputs or state != "equilibrium" or time is not None:
            raise click.UsageError("--plot draws all modes at rest: set in an experiment what is to be set")
        model.draw_mechanism(plot, mechanism, asked.experiment, modes=shapes)
    asked.print(model.modes(asked.experiment, asked.settings, state, seconds_of(time), asked.outputs))
