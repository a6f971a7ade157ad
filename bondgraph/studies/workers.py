"""Distribution of many points of one model to workers: those of this machine, of an executor, or of a Dask cluster.

Each point is computed independently, so that results do not depend on the worker or on the number of points. A task contains the text of the
model; a worker compiles it once. Our own workers have it already (`local_workers.py`).
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from operator import index
from typing import TYPE_CHECKING, Any, Protocol

from ..analysed_model import AnalysedModel
from ..errors import RunFailed, UsageError
from .local_workers import made
from .point_request import Answers, PointRequest, Progress, key_of

if TYPE_CHECKING:
    from compiler.api import Source

    from .journal import Journal

MOST_AT_ONCE = 64  # most points of one task
AHEAD = 3  # number of tasks in a worker's share of the remaining points
MOST_KEPT = 8  # most models that a worker keeps compiled

_MODELS: dict[str, AnalysedModel] = {}  # models of this process
_OWNERS: dict[str, int] = {}  # number of studies of each that run from here
_FIRST, _OWNING = threading.Lock(), threading.Lock()


@dataclass(frozen=True, slots=True)
class Task:
    """Some points; `first` is the index of the first one."""

    key: str
    source: Source
    model: str | None
    question: PointRequest
    first: int
    points: tuple[Any, ...]


class Submitting(Protocol):
    """An executor of `concurrent.futures`, or a Dask client."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any: ...


@dataclass(frozen=True)
class Workers:
    """Workers of a study.

    `count`: number of our own (None: number of cores); `executor`: an external one, with the interface of `concurrent.futures`, or a Dask client;
    `progress` is called with the number of finished points and of all; `journal` stores results.
    """

    count: int | None = None
    executor: Any = None
    progress: Progress | None = None
    journal: Journal | None = field(default=None, compare=False)

    def checked(self) -> Workers:
        """Return the same with an executor of the standard interface. Raises `UsageError`."""
        count = self.count
        if count is not None:
            try:
                count = index(count)
            except TypeError:
                raise UsageError("BR457", f"workers = {count!r}: a whole number is needed") from None
            if count < 1:
                raise UsageError("BR458", f"workers = {count}: at least one is needed")
        return Workers(count, standard(self.executor), self.progress, self.journal)


ALONE = Workers(1)  # this process computes all points


def workers_of(given: Workers | Submitting | int | None, default: Workers) -> Workers:
    """Return the workers of a call: as they are, or a number of our own, or those of an executor or a Dask client; `default` for None."""
    if isinstance(given, Workers):
        return given
    if given is None:
        return default
    return Workers(executor=given) if hasattr(given, "submit") else Workers(given)


def standard(executor: object) -> Executor | None:
    """Return an executor unchanged; for a Dask client its executor. Raises `UsageError`."""
    if executor is None or isinstance(executor, Executor):
        return executor
    if hasattr(executor, "get_executor"):
        made: Executor = executor.get_executor()
        return made
    raise UsageError(
        "BR459", f"an executor has the interface of `concurrent.futures`, or is a Dask client; this is {type(executor).__name__}",
    )  # fmt: skip


def answers(model: AnalysedModel, question: PointRequest, points: Sequence[Any], workers: Workers) -> list[Any]:
    """Return the result at each point, in order. Raises `UsageError` for invalid workers, `RunFailed` if workers died."""
    workers = workers.checked()
    found: Answers = {} if workers.journal is None else workers.journal.begun(model, question, points)
    total = len(points)
    if workers.progress is not None and found:
        workers.progress(len(found), total)
    try:
        with closing(_reports(model, question, points, found, workers)) as reports:
            for some in reports:
                found |= some
                if workers.journal is not None:
                    workers.journal.add(some)
                if workers.progress is not None:
                    workers.progress(len(found), total)
    except KeyboardInterrupt:  # within a run, whose partial result is not needed, or between runs
        raise KeyboardInterrupt(f"interrupted when {len(found)} of {total} were done") from None
    return [found[i] for i in range(total)]


def _reports(
    model: AnalysedModel, question: PointRequest, points: Sequence[Any], found: Answers, workers: Workers
) -> Generator[Answers]:
    """Yield the missing results as soon as they are known."""
    missing = [i for i in range(len(points)) if i not in found]
    if not missing:
        return
    count = cores() if workers.count is None else workers.count
    if workers.executor is None:
        yield from made(model, question, points, missing, count)
        return
    with _ready(model) as key:
        whole = Task(key, model.source, model.model, question, 0, tuple(points))
        yield from _through(workers.executor, whole, _pieces(_gaps(found, len(points)), len(missing), count))


def work(task: Task) -> list[Any]:
    """Return the results of a task, one after the other."""
    model = _MODELS.get(task.key)
    found: list[Any] = []
    if model is None:
        with _FIRST:  # one thread compiles, the others wait
            model = _MODELS.get(task.key)
            if model is None:
                model, found = _begun(task)
    return found + [task.question.answer(model, point) for point in task.points[len(found) :]]


def _begun(task: Task) -> tuple[AnalysedModel, list[Any]]:
    """Return a worker's own model, and the first result, after which it is compiled."""

    model = AnalysedModel(task.source, task.model)
    found = [task.question.answer(model, task.points[0])]
    with _OWNING:
        kept = [key for key in _MODELS if key not in _OWNERS]
        for key in kept[: max(0, len(kept) - MOST_KEPT + 1)]:
            del _MODELS[key]
        _MODELS[task.key] = model
    return model, found


def _gaps(found: dict[int, Any], total: int) -> list[tuple[int, int]]:
    """Return first and last + 1 of each range of points that are still missing."""
    missing = [i for i in range(total) if i not in found]
    begins = [i for i in missing if i == 0 or i - 1 in found]
    ends = [i + 1 for i in missing if i + 1 == total or i + 1 in found]
    return list(zip(begins, ends, strict=True))


@contextmanager
def _ready(model: AnalysedModel) -> Iterator[str]:
    """Provide the model under a key by which tasks find it in this process, as long as a study of this text runs."""
    key = key_of(model)
    with _OWNING:
        _OWNERS[key] = _OWNERS.get(key, 0) + 1
        _MODELS.setdefault(key, model)
    try:
        yield key
    finally:
        with _OWNING:
            _OWNERS[key] -= 1
            if not _OWNERS[key]:
                del _OWNERS[key]
                _MODELS.pop(key, None)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _pieces(gaps: list[tuple[int, int]], left: int, count: int) -> list[tuple[int, int]]:
    """Return the ranges of tasks: each at most a fraction of a worker's share of the remaining points, so that the last task does not delay the end."""
    found = []
    for begin, end in gaps:
        while begin < end:
            stop = min(begin + max(1, min(MOST_AT_ONCE, left // (AHEAD * count))), end)
            found.append((begin, stop))
            left -= stop - begin
            begin = stop
    return found


def _through(executor: Executor, whole: Task, pieces: list[tuple[int, int]]) -> Iterator[Answers]:
    """Yield the results of each task, as they are finished."""
    waiting: dict[Future[list[Any]], int] = {}
    try:
        for begin, end in pieces:
            waiting[executor.submit(work, replace(whole, first=begin, points=whole.points[begin:end]))] = begin
        for done in as_completed(list(waiting)):
            yield dict(enumerate(done.result(), waiting.pop(done)))
    except BrokenExecutor as broken:
        raise RunFailed(
            "BR460", f"a worker died ({broken});", "with a journal, the same call goes on with what is missing"
        ) from broken
    finally:
        for future in waiting:
            future.cancel()
