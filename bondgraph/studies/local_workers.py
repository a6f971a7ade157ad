"""Our own workers. A free worker takes the next point: this process, which is one of them, and copies of it, or threads if it cannot be copied
(another system than Linux, other threads in it).

Copies share one number, the count of points taken. So no worker waits while there are points, however long single ones take, and a point is never
assigned to a worker that may not reach it. Results come in reports of several points each, or of those of some time.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from time import perf_counter
from typing import TYPE_CHECKING, Any

from ..errors import RunFailed

if TYPE_CHECKING:
    from ..analysed_model import AnalysedModel
    from .point_request import Answers, PointRequest

MOST_TOLD = 64  # most results in one report
OFTEN = 0.25  # s: longest time between reports, unless a point takes longer
AHEAD = 3  # reports requested in advance from each worker, so that it does not wait
PATIENCE = 1.0  # s: a worker that has not announced its point by then may be dead


class Points:
    """Points from which every worker takes the next. `numbers`: indices of the missing points; `copied`: copies of this process take part."""

    def __init__(
        self, model: AnalysedModel, question: PointRequest, points: Sequence[Any], numbers: Sequence[int], copied: bool
    ) -> None:
        self.model, self.question, self.points, self.numbers = model, question, points, numbers
        self._taken: Any = [0, 0]  # number of points taken, and 1 when the study has ended
        self._lock: Any = threading.Lock()
        if copied:
            import multiprocessing

            self._taken = memoryview(mmap.mmap(-1, 16)).cast("q")
            self._lock = multiprocessing.get_context("fork").Lock()

    def taken(self, leaves: Callable[[], bool] = lambda: False) -> int | None:
        """Take a point that no other worker computes; None if there is none, the study has ended, or the lock is not released and `leaves` is True."""
        while not self._lock.acquire(timeout=PATIENCE):
            if self._taken[1] or leaves():
                return None
        try:
            count = int(self._taken[0])
            if self._taken[1] or count >= len(self.numbers):
                return None
            self._taken[0] = count + 1
        finally:
            self._lock.release()
        return self.numbers[count]

    def stop(self) -> None:
        """Let no worker take another point."""
        self._taken[1] = 1

    def answer(self, number: int) -> Any:
        """Return the result at a point."""
        return self.question.answer(self.model, self.points[number])

    def report(self) -> Answers:
        """Return the results at some points; empty if no point is left."""
        found: Answers = {}
        until = perf_counter() + OFTEN
        while not found or (len(found) < MOST_TOLD and perf_counter() < until):
            number = self.taken()
            if number is None:
                break
            found[number] = self.answer(number)
        return found


class _Others:
    """Workers besides this process, with their reports. A worker that has reported gets a new request at once."""

    def __init__(self, executor: Executor, ask: Callable[[], Answers]) -> None:
        self.executor, self.ask = executor, ask
        self.reports: SimpleQueue[tuple[Future[Answers], bool]] = SimpleQueue()
        self.asked = 0  # number of outstanding reports

    def begin(self, count: int) -> None:
        """Start `count` workers."""
        with _undisturbed(), _all_or_none():
            for _ in range(AHEAD * count):
                self.executor.submit(self.ask).add_done_callback(self._told)
        self.asked = AHEAD * count

    def _told(self, report: Future[Answers]) -> None:
        """Store a report and request the next one; called in a thread of the executor."""
        more = not report.cancelled() and report.exception() is None and bool(report.result())
        if more:
            try:
                self.executor.submit(self.ask).add_done_callback(self._told)
            except RuntimeError:  # the executor is shut down, or a worker died
                more = False
        self.reports.put((report, more))

    def told(self) -> bool:
        """Return True if there is a report."""
        return not self.reports.empty()

    def next(self) -> Answers:
        """Wait for the next report and return it. Raises the worker's exception, `BrokenExecutor` if a worker died."""
        report, more = self.reports.get()
        self.asked -= not more
        return report.result()

    def last(self) -> Iterator[Answers]:
        """Yield the last reports after the workers were told to stop: each finishes its current point."""
        self.executor.shutdown()
        while not self.reports.empty():
            report, _ = self.reports.get()
            if report.exception() is None:
                yield report.result()


def made(
    model: AnalysedModel, question: PointRequest, points: Sequence[Any], numbers: Sequence[int], count: int
) -> Iterator[Answers]:
    """Yield the results at the points with these indices, in reports, by `count` workers.

    The first point is computed here: then the program exists, and the other workers are copies of a process that has it. Raises `RunFailed` if a worker
    died.
    """
    yield {numbers[0]: question.answer(model, points[numbers[0]])}
    numbers = numbers[1:]
    count = min(count, len(numbers))
    if count <= 1:
        yield from _reports(Points(model, question, points, numbers, False), None)
        return
    copied = can_be_copied()
    shared = Points(model, question, points, numbers, copied)
    with _executor(count - 1, shared, copied) as executor:
        others = _Others(executor, _report if copied else shared.report)
        try:
            others.begin(count - 1)
            yield from _reports(shared, others)
        except BrokenExecutor as broken:
            shared.stop()
            yield from others.last()
            raise RunFailed(
                "BR460", f"a worker died ({broken});", "with a journal, the same call goes on with what is missing"
            ) from broken
        except KeyboardInterrupt:  # finished results are kept
            shared.stop()
            yield from others.last()
            raise


def _reports(points: Points, others: _Others | None) -> Iterator[Answers]:
    """Yield all reports, including those of this process, which collects the others' between its points."""
    own: Answers = {}
    until = perf_counter() + OFTEN
    try:
        while True:
            number = points.taken() if others is None else points.taken(others.told)
            if number is not None:
                own[number] = points.answer(number)
            if own and (number is None or len(own) == MOST_TOLD or perf_counter() > until):
                told, own = own, {}
                yield told
                until = perf_counter() + OFTEN
            while others is not None and others.asked and (number is None or others.told()):
                found = others.next()
                if found:
                    yield found
            if number is None:
                return
    except (BrokenExecutor, KeyboardInterrupt):
        if own:
            yield own
        raise


def can_be_copied() -> bool:
    """Return True if copies of this process can work: with other threads locks might stay closed, and daemons may have no copies."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return False
    import multiprocessing

    return not multiprocessing.current_process().daemon


@contextmanager
def _executor(count: int, points: Points, copied: bool) -> Iterator[Executor]:
    """Provide the other workers; they have ended when the context is left."""
    if not copied:
        executor: Executor = ThreadPoolExecutor(count)
    else:
        import multiprocessing

        executor = ProcessPoolExecutor(
            count, multiprocessing.get_context("fork"), _begun_as_copy, (points, os.getpid())
        )
    try:
        yield executor
    finally:
        points.stop()
        executor.shutdown(cancel_futures=True)


_COPY: list[Points] = []  # in a copy of a process: its points


def _begun_as_copy(points: Points, parent: int) -> None:
    """Prepare a copy: it ignores Ctrl-C, which the original process handles, and ends if that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(1)
    _COPY[:] = [points]


def _report() -> Answers:
    return _COPY[0].report()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Delay Ctrl-C while workers start: a worker interrupted in its start could not be ended."""
    pressed: list[int] = []
    before = signal.getsignal(signal.SIGINT) if threading.current_thread() is threading.main_thread() else None
    if before is not None:  # None: the signal does not arrive here, or must not be delayed
        signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    try:
        with warnings.catch_warnings():
            # the only threads of the copied process are those of its linear algebra, which supports copying
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            yield
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
    if pressed:
        signal.raise_signal(signal.SIGINT)


@contextmanager
def _all_or_none() -> Iterator[None]:
    """End the processes already created if not all can be: an executor does not end processes of an incomplete start."""
    import multiprocessing

    before = set(multiprocessing.active_children())
    try:
        yield
    except (OSError, RuntimeError):  # from processes, from threads
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
            process.join()
        raise
