"""`bondgraph bode`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import AnalysisCall, analysis, frequencies_of, over_option, picture_option
from .options import inputs_option, seconds_of, state_option, time_option


@analysis("bode")
@inputs_option
@over_option
@click.option("--points", default=400, metavar="N", help="How many frequencies, besides those of resonances (400).")
@state_option
@time_option
@picture_option("B.png", "Draw magnitude and phase")
def command(
    asked: AnalysisCall, inputs: Sequence[str], over: str | None, points: int, state: str, time: str | None
) -> None:
    """Print the frequency response of the linear model at rest or at the start."""
    low, high = frequencies_of(over)
    found = asked.model.response(
        tuple(inputs) or None, asked.outputs, low, high, points, state=state, time=seconds_of(time), **asked.keywords
    )  # fmt: skip
    asked.answer(found)
