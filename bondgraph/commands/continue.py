"""`bondgraph continue`."""

from __future__ import annotations

import click

from .analysis import AnalysisCall, analysis, bounds, picture_option
from .options import setting


@analysis("continue")
@click.option(
    "--along", required=True, metavar='"NAME=A .. B"', help="The parameter or input, and between which values."
)
@click.option("--points", type=click.IntRange(2), default=50, metavar="N", help="The range over the first step (50).")
@click.option("--most", type=click.IntRange(2), default=2000, metavar="N", help="Points after which it ends (2000).")
@click.option("--branch", "branches", is_flag=True, help="Follow the branches that cross it, too.")
@picture_option("B.png", "Draw the branch over the parameter")
def command(asked: AnalysisCall, along: str, points: int, most: int, branches: bool) -> None:
    """Follow a branch of states of rest against a parameter, round its folds: pull-in, snap-through, buckling."""
    name, value = setting(along, "--along", "k=1 N/m .. 2 N/m")
    low, high = bounds(value, "--along", "`NAME = A .. B`")
    found = asked.model.continuation(name, low, high, points, most, asked.outputs, branches, **asked.keywords)
    asked.answer(found)
