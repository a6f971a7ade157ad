"""`bondgraph sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from .analysis import AnalysisCall, analysis, frequencies_of, over_option
from .options import inputs_option, seconds_of, time_option


@analysis("sensitivity")
@click.option(
    "--by", "by", multiple=True, metavar="NAME",
    help="By this parameter or input (several times: these); all parameters if left out.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate", "linearize", "response"]),
    help="Of what; rest and modes if left out; `simulate`: of a run, at every instant; `linearize`: of A, B, C, D; `response`: of a frequency response.",
)  # fmt: skip
@inputs_option
@over_option
@time_option
@click.option("--to", metavar="TIME", help="Where the run ends.")
@click.option(
    "--points", type=click.IntRange(2), default=101, metavar="N", help="Instants of the run, or frequencies (101)."
)
def command(
    asked: AnalysisCall, by: Sequence[str], of: Sequence[str], inputs: Sequence[str], over: str | None, time: str | None, to: str | None, points: int
) -> None:  # fmt: skip
    """Tell how rest, frequencies and damping, a run, A, B, C, D or a frequency response move with parameters: exact derivatives."""
    alone = [what for what in of if what not in ("equilibrium", "modes")]
    if alone and len(of) > 1:
        raise click.UsageError(f"--of {alone[0]} stands alone")
    model, names, given = asked.model, tuple(by) or None, (asked.experiment, asked.settings)
    if alone == ["simulate"]:
        found: Any = model.sensitivity_of_run(names, *given, to, points, asked.outputs)
    elif alone == ["linearize"]:
        found = model.sensitivity_of_linearization(
            names, tuple(inputs) or None, asked.outputs, *given, seconds_of(time)
        )
    elif alone:
        found = model.sensitivity_of_response(
            names, tuple(inputs) or None, asked.outputs, *frequencies_of(over), points, *given, seconds_of(time)
        )
    else:
        found = model.sensitivity(names, tuple(of) or ("equilibrium", "modes"), *given, asked.outputs, seconds_of(time))
    asked.answer(found)
