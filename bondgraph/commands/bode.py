"""`bondgraph bode`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    analysed_option,
    check_target,
    echo,
    file_argument,
    inputs_option,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    seconds_of,
    setting,
    settings_option,
    state_option,
    time_option,
)
from .telling import problems_told


@click.command("bode")
@file_argument
@inputs_option
@outputs_option
@click.option(
    "--over", metavar='"LOW .. HIGH"', help="Frequencies, as `100 Hz .. 10 kHz`; a decade around the modes if left out."
)
@click.option("--points", default=400, metavar="N", help="How many frequencies, besides those of resonances (400).")
@state_option
@analysed_option
@settings_option
@time_option
@click.option("--plot", metavar="B.png", help="Draw magnitude and phase (.png, .svg or .pdf).")
@json_option
@model_option
def command(
    file: str, inputs: Sequence[str], outputs: Sequence[str], over: str | None, points: int, state: str, experiment: str,
    settings: Sequence[str], time: str | None, plot: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Print the frequency response of the linear model at rest or at the start."""
    with problems_told():
        if plot is not None:
            check_target(plot, (".png", ".svg", ".pdf"), "--plot")
        low, high = (None, None) if over is None else _range(over)
        found = load(file, model).response(
            tuple(inputs) or None, tuple(outputs) or None, low, high, points, named(experiment),
            dict(map(setting, settings)), state, seconds_of(time),
        )  # fmt: skip
        if plot is not None:
            found.plot(plot)
        echo(found, as_json)


def _range(text: str) -> tuple[float, float]:
    from ..quantities import quantity

    low, dots, high = text.partition("..")
    if not dots:
        raise click.UsageError(f"--over takes a range, as in `100 Hz .. 10 kHz`; this is `{text}`")
    return quantity(low, "Hz", "--over"), quantity(high, "Hz", "--over")
