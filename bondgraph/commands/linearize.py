"""`bondgraph linearize`."""

from __future__ import annotations

from collections.abc import Sequence

from ..keywords import PointKeywords
from .analysis import AnalysisCall, analysis
from .options import inputs_option, seconds_of, state_option, time_option


@analysis("linearize")
@inputs_option
@state_option
@time_option
def command(asked: AnalysisCall, inputs: Sequence[str], state: str, time: str | None) -> None:
    """Print A, B, C, D of the linear model at rest or at the start."""
    options: PointKeywords = {"state": state, "time": seconds_of(time), **asked.keywords}
    asked.answer(asked.model.linearize(tuple(inputs) or None, asked.outputs, **options))
