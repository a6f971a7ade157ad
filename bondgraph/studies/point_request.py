"""Question of a study: the request at each point, as workers get it, and the key of the model that it is put to."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

from ..analysed_model import AnalysedModel

Answers = dict[int, Any]  # results by the index of the point
TimedReport = tuple[Answers, float]  # results of a worker, and the time in s that they took
Progress = Callable[[int, int], None]  # called with the number of finished points, and of all


class PointRequest(Protocol):
    """Request at each point; it is sent to other processes. An exception at a point is its result (`result_at`)."""

    def answer(self, model: AnalysedModel, point: Any) -> Any: ...


@runtime_checkable
class BatchRequest(PointRequest, Protocol):
    """Request that may be answered at several points together, in threads of this process."""

    def answer_all(self, model: AnalysedModel, points: Sequence[Any]) -> list[Any]:
        """Return the results at some points; None at a point that is to be answered alone."""
        ...

    def is_batch(self, model: AnalysedModel, point: Any) -> bool:
        """Return True if points like this one are answered together."""
        ...


def key_of(model: AnalysedModel) -> str:
    """Return a unique key of a model's text."""
    source = model.source
    text = f"{source.name}\0{source.path}\0{model.model}\0{source.text}"
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
