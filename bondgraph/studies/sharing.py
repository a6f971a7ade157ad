"""Distribution of many points of one model to workers: those of this machine, of an executor, or of a Dask cluster.

Each point is computed independently, so that results do not depend on the worker or on the number of points. A task contains the text of the
model; a worker compiles it once. Our own workers have it already (`workers.py`).
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from operator import index
from typing import TYPE_CHECKING, Any

from ..analysed_model import AnalysedModel
from ..errors import RunFailed, UsageError
from .question import Answers, Progress, Question, key_of
from .workers import made

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
    question: Question
    first: int
    points: tuple[Any, ...]


@dataclass(frozen=True)
class Sharing:
    """Workers of a study.

    `workers`: number of our own (None: number of cores); `executor`: an external one, with the interface of `concurrent.futures`, or a Dask client;
    `progress` is called with the number of finished points and of all; `journal` stores results.
    """

    workers: int | None = None
    executor: Any = None
    progress: Progress | None = None
    journal: Journal | None = field(default=None, compare=False)

    def checked(self) -> Sharing:
        """Return the same with an executor of the standard interface. Raises `UsageError`."""
        workers = self.workers
        if workers is not None:
            try:
                workers = index(workers)
            except TypeError:
                raise UsageError("BR457", f"workers = {workers!r}: a whole number is needed") from None
            if workers < 1:
                raise UsageError("BR458", f"workers = {workers}: at least one is needed")
        return Sharing(workers, standard(self.executor), self.progress, self.journal)


def standard(executor: Any) -> Executor | None:
    """Return an executor unchanged; for a Dask client its executor. Raises `UsageError`."""
    if executor is None or isinstance(executor, Executor):
        return executor
    if hasattr(executor, "get_executor"):
        made: Executor = executor.get_executor()
        return made
    raise UsageError(
        "BR459",
        f"an executor has the interface of `concurrent.futures`, or is a Dask client; this is {type(executor).__name__}",
    )


def answers(model: AnalysedModel, question: Question, points: Sequence[Any], sharing: Sharing) -> list[Any]:
    """Return the result at each point, in order. Raises `UsageError` for invalid workers, `RunFailed` if workers died."""
    sharing = sharing.checked()
    found: Answers = {} if sharing.journal is None else sharing.journal.begun(model, question, points)
    total = len(points)
    if sharing.progress is not None and found:
        sharing.progress(len(found), total)
    try:
        with closing(_reports(model, question, points, found, sharing)) as reports:
            for some in reports:
                found |= some
                if sharing.journal is not None:
                    sharing.journal.add(some)
                if sharing.progress is not None:
                    sharing.progress(len(found), total)
    except KeyboardInterrupt:  # within a run, whose partial result is not needed, or between runs
        raise KeyboardInterrupt(f"interrupted when {len(found)} of {total} were done") from None
    return [found[i] for i in range(total)]


def _reports(
    model: AnalysedModel, question: Question, points: Sequence[Any], found: Answers, sharing: Sharing
) -> Generator[Answers]:
    """Yield the missing results as soon as they are known."""
    missing = [i for i in range(len(points)) if i not in found]
    if not missing:
        return
    count = cores() if sharing.workers is None else sharing.workers
    if sharing.executor is None:
        yield from made(model, question, points, missing, count)
        return
    with _ready(model) as key:
        whole = Task(key, model.source, model.model, question, 0, tuple(points))
        yield from _through(sharing.executor, whole, _pieces(_gaps(found, len(points)), len(missing), count))


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
