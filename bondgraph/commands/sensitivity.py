"""`bondgraph sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import Asked, analysis
from .options import seconds_of, time_option


@analysis("sensitivity")
@click.option(
    "--by", "by", multiple=True, metavar="NAME",
    help="By this parameter or input (several times: these); all parameters if left out.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]),
    help="Of what; rest and modes if left out; `simulate`: of a run, at every instant.",
)  # fmt: skip
@time_option
@click.option("--to", metavar="TIME", help="Where the run ends.")
@click.option("--points", type=click.IntRange(2), default=101, metavar="N", help="Instants of the run (101).")
def command(asked: Asked, by: Sequence[str], of: Sequence[str], time: str | None, to: str | None, points: int) -> None:
    """Tell how outputs at rest or over a run, frequencies and damping move with parameters: exact derivatives."""
    if "simulate" in of and len(of) > 1:
        raise click.UsageError("--of simulate stands alone")
    if "simulate" in of:
        asked.answer(
            asked.model.sensitivity_of_run(
                tuple(by) or None, asked.experiment, asked.settings, to, points, asked.outputs
            )
        )
        return
    asked.answer(
        asked.model.sensitivity(
            tuple(by) or None, tuple(of) or ("equilibrium", "modes"), asked.experiment, asked.settings, asked.outputs, seconds_of(time)
        )
    )  # fmt: skip
