"""Many points of one model, shared out among workers: those of this machine, of an executor, or of a Dask cluster.

A question is asked at every point by itself, so that answers do not depend on who found them, or with how many others. A task carries the
text of the model; a worker compiles it once. Where a process can be copied as it stands (Linux, no other threads in it), workers of our
own are copies of this one, which has compiled already; else they are threads.
"""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from ..errors import RunFailed, UsageError

if TYPE_CHECKING:
    from ..door import Source
    from ..model import Model
    from .journal import Journal

MOST_AT_ONCE = 64  # points of one task
TASKS = 8  # for each worker, so that none waits long for the last
MOST_KEPT = 8  # models that a worker keeps ready

Progress = Callable[[int, int], None]

_MODELS: dict[str, Model] = {}  # ready in this process, and in copies of it
_FIRST = threading.Lock()


class Question(Protocol):
    """What is asked at each point; it goes to other processes. What goes wrong at a point is part of its answer."""

    def answer(self, model: Model, point: Any) -> Any: ...


@dataclass(frozen=True, slots=True)
class Task:
    """Some points: the first of them has the number `first`."""

    key: str
    source: Source | None  # None where the worker is a copy of this process, which has the model
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
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"workers = {self.workers}: at least one is needed")
        return Sharing(self.workers, standard(self.executor), self.progress, self.journal)


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
    found: dict[int, Any] = {} if sharing.journal is None else sharing.journal.begun(model, question, points)
    total = len(points)
    if sharing.progress is not None and found:
        sharing.progress(len(found), total)
    with _ready(model) as key:
        whole = Task(key, None, model.model, question, 0, tuple(points))
        for first, some in _shared_out(whole, model.source, _gaps(found, total), sharing):
            found |= dict(enumerate(some, first))
            if sharing.journal is not None:
                sharing.journal.add(first, some)
            if sharing.progress is not None:
                sharing.progress(len(found), total)
    return [found[i] for i in range(total)]


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

    assert task.source is not None
    model = Model(task.source, task.model)
    found = [task.question.answer(model, task.points[0])]
    while len(_MODELS) >= MOST_KEPT:
        _MODELS.pop(next(iter(_MODELS)), None)
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
    """The model under a key by which tasks find it."""
    key = key_of(model)
    before = _MODELS.get(key)
    _MODELS[key] = model
    try:
        yield key
    finally:
        if before is None:
            _MODELS.pop(key, None)
        else:
            _MODELS[key] = before


def key_of(model: Model) -> str:
    """What tells a model's text from all others."""
    source = model.source
    text = f"{source.name}\0{source.path}\0{model.model}\0{source.text}"
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _shared_out(
    whole: Task, source: Source, gaps: list[tuple[int, int]], sharing: Sharing
) -> Iterator[tuple[int, list[Any]]]:
    """The first number and the answers of each task, as they are done. With workers of our own the first point is made here: then the
    program is there."""
    left = sum(end - begin for begin, end in gaps)
    if not left:
        return
    count = cores() if sharing.workers is None else sharing.workers
    if sharing.executor is not None:
        yield from _through(sharing.executor, whole, _pieces(gaps, left, count), source)
        return
    begin, end = gaps[0]
    yield begin, work(_part(whole, begin, begin + 1, None))
    gaps = [(begin + 1, end), *gaps[1:]]
    count = min(count, left - 1)
    if count <= 1:
        for begin, end in _pieces(gaps, left, 1):
            yield begin, work(_part(whole, begin, end, None))
        return
    with _workers(count) as (own, copied):
        yield from _through(own, whole, _pieces(gaps, left, count), None if copied else source)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _pieces(gaps: list[tuple[int, int]], left: int, count: int) -> list[tuple[int, int]]:
    """Where tasks begin and end."""
    size = max(1, min(MOST_AT_ONCE, -(-left // (TASKS * count))))
    return [(i, min(i + size, end)) for begin, end in gaps for i in range(begin, end, size)]


def _part(whole: Task, begin: int, end: int, source: Source | None) -> Task:
    return Task(whole.key, source, whole.model, whole.question, begin, whole.points[begin:end])


def _through(
    executor: Executor, whole: Task, pieces: list[tuple[int, int]], source: Source | None
) -> Iterator[tuple[int, list[Any]]]:
    waiting: dict[Future[list[Any]], int] = {}
    try:
        with warnings.catch_warnings():
            # a copy of a process whose only threads are those of its linear algebra, which expects it
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            for begin, end in pieces:
                waiting[executor.submit(work, _part(whole, begin, end, source))] = begin
        while waiting:
            for done in wait(waiting, return_when=FIRST_COMPLETED).done:
                yield waiting.pop(done), done.result()
    except BrokenExecutor as broken:
        raise RunFailed(
            f"a worker died ({broken}); with a journal, the same call goes on with what is missing"
        ) from broken
    finally:
        for future in waiting:
            future.cancel()


def _leave_interruptions() -> None:
    """Ctrl-C is for the process that shares out the work; it ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _workers(count: int) -> Iterator[tuple[Executor, bool]]:
    """Workers of our own, and whether they are copies of this process."""
    own: Executor
    copied = sys.platform == "linux" and threading.active_count() == 1
    if copied:
        import multiprocessing

        own = ProcessPoolExecutor(count, multiprocessing.get_context("fork"), _leave_interruptions)
    else:
        own = ThreadPoolExecutor(count)
    try:
        yield own, copied
    finally:
        own.shutdown(cancel_futures=True)
