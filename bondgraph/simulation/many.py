"""Many runs of one model, shared out among workers: threads, processes, or what another executor has.

What is set are arguments of one program, so it is compiled once. Machine code runs outside of the interpreter's lock, but what Python does
around it does not: where a process can be copied as it stands (Linux, no other threads in it), workers are copies of this one; else threads.
Each run is by itself, so results do not depend on who made them, or on how many there were.
"""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..door import CompilationFailed
from ..ensembles import Ensemble
from ..errors import RunFailed, UsageError
from ..results import Result
from .run import Wanted, check_wanted, simulate

if TYPE_CHECKING:
    from ..door import Source
    from ..model import Model

MOST_AT_ONCE = 64  # runs of one task
TASKS = 8  # for each worker, so that none waits long for the last
MOST_KEPT = 8  # models that a worker keeps ready
KEPT_ERRORS = (RunFailed, CompilationFailed, UsageError)

Progress = Callable[[int, int], None]
Outcome = Result | Exception

_MODELS: dict[str, Model] = {}  # ready in this process, and in copies of it


@dataclass(frozen=True, slots=True)
class Task:
    """Some runs: the first of them has the number `first`."""

    key: str
    source: Source | None  # None where the worker is a copy of this process, which has the model
    model: str | None
    experiment: str | None
    outputs: tuple[str, ...] | None
    wanted: Wanted
    first: int
    settings: tuple[Mapping[str, str | float], ...]


def simulate_many(
    model: Model, experiment: str | None, settings: Sequence[Mapping[str, str | float]], outputs: tuple[str, ...] | None, wanted: Wanted,
    workers: int | None, executor: Executor | None, progress: Progress | None,
) -> Ensemble:  # fmt: skip
    """Run a model with each of several settings; what goes wrong in a run stays with it. Raises `UsageError` for what is wrong in all."""
    check_wanted(wanted)
    if workers is not None and workers < 1:
        raise UsageError(f"workers = {workers}: at least one is needed")
    outcomes: list[Outcome | None] = [None] * len(settings)
    done = 0
    with _ready(model) as key:
        whole = Task(key, None, model.model, experiment, outputs, wanted, 0, tuple(dict(s) for s in settings))
        for first, found in _shared_out(whole, model.source, workers, executor):
            outcomes[first : first + len(found)] = found
            done += len(found)
            if progress is not None:
                progress(done, len(settings))
    return Ensemble(whole.settings, tuple(o for o in outcomes if o is not None))


def work(task: Task) -> list[Outcome]:
    """The runs of a task, one after the other."""
    model = _MODELS.get(task.key)
    if model is None:
        from ..model import Model

        assert task.source is not None
        while len(_MODELS) >= MOST_KEPT:
            _MODELS.pop(next(iter(_MODELS)), None)
        model = _MODELS[task.key] = Model(task.source, task.model)
    found: list[Outcome] = []
    for settings in task.settings:
        try:
            found.append(simulate(model, task.experiment, settings, task.outputs, task.wanted))
        except KEPT_ERRORS as problem:
            found.append(problem)
    return found


@contextmanager
def _ready(model: Model) -> Iterator[str]:
    """The model under a key by which tasks find it."""
    source = model.source
    digest = hashlib.sha256(
        f"{source.name}\0{source.path}\0{model.model}\0{source.text}".encode("utf-8", "surrogatepass")
    )
    key = digest.hexdigest()
    before = _MODELS.get(key)
    _MODELS[key] = model
    try:
        yield key
    finally:
        if before is None:
            _MODELS.pop(key, None)
        else:
            _MODELS[key] = before


def _shared_out(
    whole: Task, source: Source, workers: int | None, executor: Executor | None
) -> Iterator[tuple[int, list[Outcome]]]:
    """The first number and the outcomes of each task, as they are done. The first run is made here: then the program is there."""
    settings = whole.settings
    if not settings:
        return
    count = min(_cores() if workers is None else workers, max(1, len(settings) - 1))
    if executor is None:
        yield 0, work(_part(whole, 0, 1, None))
        if count == 1:
            for first in range(1, len(settings), MOST_AT_ONCE):
                yield first, work(_part(whole, first, MOST_AT_ONCE, None))
            return
        with _workers(count) as (own, copied):
            yield from _through(own, whole, 1, None if copied else source, count)
        return
    yield from _through(executor, whole, 0, source, count)


def _cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _part(whole: Task, first: int, size: int, source: Source | None) -> Task:
    settings = whole.settings[first : first + size]
    return Task(whole.key, source, whole.model, whole.experiment, whole.outputs, whole.wanted, first, settings)


def _through(
    executor: Executor, whole: Task, begin: int, source: Source | None, count: int
) -> Iterator[tuple[int, list[Outcome]]]:
    size = max(1, min(MOST_AT_ONCE, -(-(len(whole.settings) - begin) // (TASKS * count))))
    waiting: dict[Future[list[Outcome]], int] = {}
    try:
        with (
            warnings.catch_warnings()
        ):  # a copy of a process whose only threads are those of its linear algebra, which expects it
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            for first in range(begin, len(whole.settings), size):
                waiting[executor.submit(work, _part(whole, first, size, source))] = first
        while waiting:
            for done in wait(waiting, return_when=FIRST_COMPLETED).done:
                yield waiting.pop(done), done.result()
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
