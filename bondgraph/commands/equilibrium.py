"""`bondgraph equilibrium`."""

from __future__ import annotations

from .analysis import AnalysisCall, analysis
from .options import seconds_of, time_option


@analysis("equilibrium")
@time_option
def command(asked: AnalysisCall, time: str | None) -> None:
    """Find the state of rest that is reached from the start, and whether it is stable."""
    asked.answer(asked.model.equilibrium(asked.experiment, asked.settings, asked.outputs, seconds_of(time)))
