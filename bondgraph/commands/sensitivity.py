"""`bondgraph sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from ..keywords import AnalysisKeywords
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
    asked: AnalysisCall, by: Sequence[str], of: Sequence[str], inputs: Sequence[str], over: str | None, time: str | None, **run: Any
) -> None:  # fmt: skip
    """Tell how rest, frequencies and damping, a run, A, B, C, D or a frequency response move with parameters: exact derivatives."""
    alone = [what for what in of if what not in ("equilibrium", "modes")]
    if alone and len(of) > 1:
        raise click.UsageError(f"--of {alone[0]} stands alone")
    model, names, input_names = asked.model, tuple(by) or None, tuple(inputs) or None
    options: AnalysisKeywords = {"time": seconds_of(time), **asked.keywords}
    if alone == ["simulate"]:
        found: Any = model.sensitivity_of_run(names, outputs=asked.outputs, **asked.keywords, **run)
    elif alone == ["linearize"]:
        found = model.sensitivity_of_linearization(names, input_names, asked.outputs, **options)
    elif alone:
        low, high = frequencies_of(over)
        found = model.sensitivity_of_response(names, input_names, asked.outputs, low, high, run["points"], **options)
    else:
        found = model.sensitivity(names, tuple(of) or ("equilibrium", "modes"), asked.outputs, **options)
    asked.answer(found)
