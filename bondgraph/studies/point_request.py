"""Question of a study: the request at each point, as workers get it, and the key of the model that it is put to."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from ..analysed_model import AnalysedModel
from ..results.result import Result
from ..simulation.run_options import RunRequest

Answers = dict[int, Any]  # results by the index of the point
TimedReport = tuple[Answers, float]  # results of a worker, and the time in s that they took
Progress = Callable[[int, int], None]  # called with the number of finished points, and of all


class PointRequest(Protocol):
    """Request at each point; it is sent to other processes. An exception at a point is its result (`result_at`)."""

    def answer(self, model: AnalysedModel, point: Any) -> Any: ...


@runtime_checkable
class BatchRequest(PointRequest, Protocol):
    """Request that may be a run alone at each point: such runs are stepped together, in threads of this process."""

    @property
    def only_run(self) -> RunRequest | None:
        """Run that is all the request asks for; None if it asks for more."""
        ...

    def of_run(self, point: Any, run: Result) -> Any:
        """Return the result at a point from its run."""
        ...


def key_of(model: AnalysedModel) -> str:
    """Return a unique key of a model's text."""
    source = model.source
    text = f"{source.name}\0{source.path}\0{model.model}\0{source.text}"
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
