"""Many points of one model, shared out among workers: those of this machine, of an executor, or of a Dask cluster.

A question is asked at every point by itself, so that answers do not depend on who found them, or with how many others. A task carries the
text of the model; a worker compiles it once. Workers of our own have it already (`workers.py`).
"""

from __future__ import annotations

import hashlib
import os
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from operator import index
from typing import TYPE_CHECKING, Any, Protocol

from ..errors import RunFailed, UsageError
from .workers import Answers, made

if TYPE_CHECKING:
    from ..door import Source
    from ..model import Model
    from .journal import Journal

MOST_AT_ONCE = 64  # points of one task
AHEAD = 3  # tasks that are a worker's share of what is left
MOST_KEPT = 8  # models that a worker keeps ready

Progress = Callable[[int, int], None]

_MODELS: dict[str, Model] = {}  # ready in this process
_OWNERS: dict[str, int] = {}  # how many share out points of them from here
_FIRST, _OWNING = threading.Lock(), threading.Lock()


class Question(Protocol):
    """What is asked at each point; it goes to other processes. What goes wrong at a point is part of its answer."""

    def answer(self, model: Model, point: Any) -> Any: ...


@dataclass(frozen=True, slots=True)
class Task:
    """Some points: the first of them has the number `first`."""

    key: str
    source: Source
    model: str | None
    question: Question
    first: int
    points: tuple[Any, ...]


@dataclass(frozen=True)
class Sharing:
    """Who makes the points. `workers`: how many of our own (None: as many as cores); `executor`: another's, of the interface of
    `concurrent.futures`, or a Dask client; `progress` is told how many are done, and of how many; `journal` keeps what is done."""

    workers: int | None = None
    executor: Any = None
    progress: Progress | None = None
    journal: Journal | None = field(default=None, compare=False)

    def checked(self) -> Sharing:
        """With an executor of the standard interface. Raises `UsageError`."""
        workers = self.workers
        if workers is not None:
            try:
                workers = index(workers)
            except TypeError:
                raise UsageError(f"workers = {workers!r}: a whole number is needed") from None
            if workers < 1:
                raise UsageError(f"workers = {workers}: at least one is needed")
        return Sharing(workers, standard(self.executor), self.progress, self.journal)


def standard(executor: Any) -> Executor | None:
    """An executor as it is; of a client of Dask the executor that it makes of itself. Raises `UsageError`."""
    if executor is None or isinstance(executor, Executor):
        return executor
    if hasattr(executor, "get_executor"):
        made: Executor = executor.get_executor()
        return made
    raise UsageError(
        f"an executor has the interface of `concurrent.futures`, or is a Dask client; this is {type(executor).__name__}"
    )


def answers(model: Model, question: Question, points: Sequence[Any], sharing: Sharing) -> list[Any]:
    """The answer at each point, in order. Raises `UsageError` for what is wrong with the sharing, `RunFailed` where workers died."""
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
    except KeyboardInterrupt:  # of one run, which is nobody's concern, or between them
        raise KeyboardInterrupt(f"interrupted when {len(found)} of {total} were done") from None
    return [found[i] for i in range(total)]


def _reports(
    model: Model, question: Question, points: Sequence[Any], found: Answers, sharing: Sharing
) -> Generator[Answers]:
    """Answers at the points that have none, as they are there."""
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
    """The answers of a task, one after the other."""
    model = _MODELS.get(task.key)
    found: list[Any] = []
    if model is None:
        with _FIRST:  # of many threads one compiles, and the others wait
            model = _MODELS.get(task.key)
            if model is None:
                model, found = _begun(task)
    return found + [task.question.answer(model, point) for point in task.points[len(found) :]]


def _begun(task: Task) -> tuple[Model, list[Any]]:
    """A worker's own model, and the first answer, after which it is compiled."""
    from ..model import Model

    model = Model(task.source, task.model)
    found = [task.question.answer(model, task.points[0])]
    with _OWNING:
        kept = [key for key in _MODELS if key not in _OWNERS]
        for key in kept[: max(0, len(kept) - MOST_KEPT + 1)]:
            del _MODELS[key]
        _MODELS[task.key] = model
    return model, found


def _gaps(found: dict[int, Any], total: int) -> list[tuple[int, int]]:
    """First and last + 1 of each row of points that are still to be made."""
    missing = [i for i in range(total) if i not in found]
    begins = [i for i in missing if i == 0 or i - 1 in found]
    ends = [i + 1 for i in missing if i + 1 == total or i + 1 in found]
    return list(zip(begins, ends, strict=True))


@contextmanager
def _ready(model: Model) -> Iterator[str]:
    """The model under a key by which tasks find it in this process; as long as one of those who share out points of this text needs it."""
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


def key_of(model: Model) -> str:
    """What tells a model's text from all others."""
    source = model.source
    text = f"{source.name}\0{source.path}\0{model.model}\0{source.text}"
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _pieces(gaps: list[tuple[int, int]], left: int, count: int) -> list[tuple[int, int]]:
    """Where tasks begin and end. Some of them are a worker's share of what is left, at most, so that nobody waits long for the last."""
    found = []
    for begin, end in gaps:
        while begin < end:
            stop = min(begin + max(1, min(MOST_AT_ONCE, left // (AHEAD * count))), end)
            found.append((begin, stop))
            left -= stop - begin
            begin = stop
    return found


def _through(executor: Executor, whole: Task, pieces: list[tuple[int, int]]) -> Iterator[Answers]:
    """The answers of each task, as they are done."""
    waiting: dict[Future[list[Any]], int] = {}
    try:
        for begin, end in pieces:
            waiting[executor.submit(work, replace(whole, first=begin, points=whole.points[begin:end]))] = begin
        for done in as_completed(list(waiting)):
            yield dict(enumerate(done.result(), waiting.pop(done)))
    except BrokenExecutor as broken:
        raise RunFailed(
            f"a worker died ({broken}); with a journal, the same call goes on with what is missing"
        ) from broken
    finally:
        for future in waiting:
            future.cancel()
