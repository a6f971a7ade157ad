"""Distribution of many points of one model to workers: those of this machine, of an executor, or of a Dask cluster.

Each point is computed independently, so that results do not depend on the worker or on the number of points. A task contains the text of the
model; a worker compiles it once. Our own workers have it already (`local_workers.py`).
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from operator import index
from queue import SimpleQueue
from time import perf_counter
from typing import TYPE_CHECKING, Any, Protocol
from warnings import warn

from ..analysed_model import AnalysedModel
from ..batch.together import is_together, simulate_together
from ..errors import RunFailed, UsageError
from .local_workers import LocalWorkers, local_workers, started_together
from .point_failure import OF_ALL, OURS, kept
from .point_request import Answers, BatchRequest, PointRequest, Progress, TimedReport, key_of

if TYPE_CHECKING:
    from compiler.api import Source

    from .journal import Journal

MOST_AT_ONCE = 64  # most points of one task
MOST_TOGETHER = 512  # the same where points are answered together
LEAST_TOGETHER = 24  # least points of such a task, if they do not take long
OFTEN = 0.25  # s: longest time between reports, unless a point takes longer, or points are answered together
AHEAD = 3  # tasks submitted in advance for each of our own workers, and number of tasks in a worker's share of the remaining points
FEW = 3  # points that are first answered together
MORE = 32  # largest factor on their number from one time to the next
MOST_KEPT = 8  # most models that a worker keeps compiled

thread_time = getattr(time, "thread_time", time.process_time)  # a browser has one thread, and no clock of it

_MODELS: dict[str, AnalysedModel] = {}  # models of this process
_OWNERS: dict[str, int] = {}  # number of studies of each that run from here
_FIRST, _OWNING = threading.Lock(), threading.Lock()


@dataclass(frozen=True, slots=True)
class Task:
    """Some points by their indices, with all that a worker needs."""

    key: str
    source: Source
    model: str | None
    question: PointRequest
    points: dict[int, Any]


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
        count, executor = self.count, self.executor
        if count is not None:
            try:
                count = index(count)
            except TypeError:
                raise UsageError("BR457", f"workers = {count!r}: a whole number is needed") from None
            if count < 1:
                raise UsageError("BR458", f"workers = {count}: at least one is needed")
        if hasattr(executor, "get_executor"):
            executor = executor.get_executor()
        if not isinstance(executor, Executor | None):
            raise UsageError(
                "BR459", f"an executor has the interface of `concurrent.futures`, or is a Dask client; this is {type(executor).__name__}",
            )  # fmt: skip
        return Workers(count, executor, self.progress, self.journal)


ALONE = Workers(1)  # this process computes all points


def workers_of(given: Workers | Submitting | int | None, default: Workers) -> Workers:
    """Return the workers of a call: as they are, or a number of our own, or those of an executor or a Dask client; `default` for None."""
    if isinstance(given, Workers):
        return given
    if given is None:
        return default
    return Workers(executor=given) if hasattr(given, "submit") else Workers(given)


def answers(model: AnalysedModel, question: PointRequest, points: Sequence[Any], workers: Workers) -> list[Any]:
    """Return the result at each point, in order. Raises `UsageError` for invalid workers, `RunFailed` if workers died."""
    workers = workers.checked()
    found: Answers = {} if workers.journal is None else workers.journal.begun(model, question, points)
    missing, total = [i for i in range(len(points)) if i not in found], len(points)
    if workers.progress is not None and found:
        workers.progress(len(found), total)
    try:
        with closing(_reports(model, question, points, missing, workers)) as reports:
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
    model: AnalysedModel, question: PointRequest, points: Sequence[Any], missing: Sequence[int], workers: Workers
) -> Generator[Answers]:
    """Yield the missing results as soon as they are known.

    With several workers of our own the first point is computed here: then the program exists, and copies of this process have it.
    """
    count = cores() if workers.count is None else workers.count
    executor = workers.executor
    if executor is not None:
        with _ready(model) as key:
            task = partial(Task, key, model.source, model.model, question)
            yield from _collected(
                lambda numbers: executor.submit(work, task({i: points[i] for i in numbers})), missing, count
            )
        return
    some = partial(answered, model, question, points)
    if count > 1:
        yield from some(missing[:1])
        missing = missing[1:]
        count = min(count, len(missing))
    if count <= 1:
        yield from some(missing)
        return
    run = question.only_run if isinstance(question, BatchRequest) else None
    in_threads = run is not None and is_together(model, run, points[missing[0]])
    together = MOST_TOGETHER if in_threads else 1  # their tasks are no larger than they may be
    own = local_workers(lambda numbers: first_of(some(numbers, together)), count, in_threads)
    try:
        yield from _collected(own.submit, missing, count, own, FEW if in_threads else 1)
    finally:
        own.end()


def work(task: Task) -> TimedReport:
    """Return the first report on the points of a task, and its time."""
    model = _MODELS.get(task.key)
    first: Answers = {}
    if model is None:
        with _FIRST:  # one thread compiles, the others wait
            model = _MODELS.get(task.key)
            if model is None:
                model, first = _begun(task)
    report, time = first_of(answered(model, task.question, task.points, [i for i in task.points if i not in first]))
    return first | report, time


def _begun(task: Task) -> tuple[AnalysedModel, Answers]:
    """Return a worker's own model, and the first result, after which it is compiled."""
    model = AnalysedModel(task.source, task.model)
    number, point = next(iter(task.points.items()))
    first = {number: result_at(model, task.question, point)}
    with _OWNING:
        kept = [key for key in _MODELS if key not in _OWNERS]
        for key in kept[: max(0, len(kept) - MOST_KEPT + 1)]:
            del _MODELS[key]
        _MODELS[task.key] = model
    return model, first


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


def result_at(model: AnalysedModel, question: PointRequest, point: Any) -> Any:
    """Return the result at one point, or its exception. Raises errors that concern all points."""
    try:
        return question.answer(model, point)
    except Exception as problem:
        return kept(problem)


def _results_at(model: AnalysedModel, question: PointRequest, points: Sequence[Any]) -> list[Any]:
    """Return the results at some points that are answered together; None at the others, and at all if that fails.

    An error with a message is that of each point alone, too. Warns of a defect, which costs time and no result.
    """
    if len(points) == 1 or not isinstance(question, BatchRequest) or question.only_run is None:
        return [None] * len(points)
    try:
        runs = simulate_together(model, question.only_run, points)
        return [None if run is None else question.of_run(point, run) for point, run in zip(points, runs, strict=True)]
    except Exception as problem:
        if not isinstance(problem, (*OURS, *OF_ALL, MemoryError)):
            text = f"a defect of ours: runs together ended ({type(problem).__name__}: {problem}); each is made alone"
            warn(text, RuntimeWarning, stacklevel=2)
        return [None] * len(points)


def answered(
    model: AnalysedModel, question: PointRequest, points: Sequence[Any] | Mapping[int, Any], numbers: Iterable[int], together: int = 1
) -> Iterator[Answers]:  # fmt: skip
    """Yield the results at the points with these indices, in reports: of several points, or of those of some time. An error ends a report, too.

    `together`: number of points that are first answered together, if they can be; later as many as take `FEW` times that time: many cost little more
    than few.
    """
    report: Answers = {}
    several, left = isinstance(question, BatchRequest), iter(numbers)
    until, size = perf_counter() + OFTEN, max(together, FEW) if several else 1
    try:
        while some := list(islice(left, min(size, MOST_TOGETHER if several else MOST_AT_ONCE - len(report)))):
            began = thread_time()  # others on the machine do not make batches smaller
            results = _results_at(model, question, [points[number] for number in some])
            for number, result in zip(some, results, strict=True):
                report[number] = result_at(model, question, points[number]) if result is None else result
            several = several and (len(some) == 1 or any(result is not None for result in results))
            took = max(thread_time() - began, 1e-6)
            most = max(int(len(some) * FEW * OFTEN / took), FEW if took < len(some) * OFTEN else 1)
            size = min(most, MORE * len(some)) if several else 1
            if len(report) >= MOST_AT_ONCE or perf_counter() > until:
                full, report = report, {}
                yield full
                until = perf_counter() + OFTEN
    finally:
        if report:
            yield report


def first_of(reports: Iterator[Answers]) -> TimedReport:
    """Return the first report, empty if there is none, and its time in s."""
    begin = perf_counter()
    return next(reports, {}), perf_counter() - begin


def _collected(
    submit: Callable[[Sequence[int]], Future[TimedReport]], numbers: Sequence[int], count: int, own: LocalWorkers | None = None, first: int = 1
) -> Iterator[Answers]:  # fmt: skip
    """Yield the results of tasks as they are finished; the rest of a task that was too long for one report is distributed again.

    A task has at most a fraction of a worker's share of the remaining points, so that the last one does not delay the end, unless those are few
    (`LEAST_TOGETHER`). Our own workers get a few tasks in advance, at least of `first` points, about as many as are computed in that many times of a
    report; an executor, whose size is not known, gets all at once.
    """
    left, waiting = deque(numbers), dict[Future[TimedReport], list[int]]()
    finished: SimpleQueue[Future[TimedReport]] = SimpleQueue()
    most, ahead = (first, AHEAD * count) if own else (MOST_AT_ONCE, len(left))
    least, largest = (1, MOST_AT_ONCE) if first == 1 else (LEAST_TOGETHER, MOST_TOGETHER)

    def submit_some() -> None:
        while left and len(waiting) < ahead:
            share = max(len(left) // (AHEAD * count), least)
            task = [left.popleft() for _ in range(min(most, share, len(left)))]
            future = submit(task)
            waiting[future] = task
            future.add_done_callback(finished.put)

    try:
        with started_together() if own else nullcontext():
            submit_some()
        while waiting:
            future = finished.get()
            report, time = future.result()
            most = max(first, min(largest, int(len(report) * first * OFTEN / max(time, 1e-6))))
            left.extendleft(reversed(waiting[future][len(report) :]))
            submit_some()
            yield report
            del waiting[future]
    except (BrokenExecutor, KeyboardInterrupt) as ended:  # finished results are kept
        if own:
            own.end()
        for future in waiting:
            if future.done() and not future.cancelled() and future.exception() is None and future.result()[0]:
                yield future.result()[0]
        if isinstance(ended, KeyboardInterrupt):
            raise
        raise RunFailed(
            "BR460", f"a worker died ({ended});", "with a journal, the same call goes on with what is missing"
        ) from ended
    finally:
        for future in waiting:
            future.cancel()
