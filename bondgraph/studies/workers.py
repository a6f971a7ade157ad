"""Workers of our own. Whoever is free takes the next point: this process, which is one of them, and copies of it, or threads where it cannot be
copied as it stands (another system than Linux, other threads in it).

What copies share is a number, how many points are taken. So nobody waits while there are points, however long single ones take, and a point is
given to nobody who may not come to it. Answers come in reports: of some points each, or of those of some time.
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
    from ..model import Model
    from .sharing import Question

MOST_TOLD = 64  # answers in one report
OFTEN = 0.25  # s: nobody is longer without a report, but for a point that takes longer
AHEAD = 3  # reports that each of the others is asked for: it need not wait for being asked again
PATIENCE = 1.0  # s: whoever has not told by then which point it takes may be dead

Answers = dict[int, Any]  # by the number of the point


class Points:
    """Points of which everybody takes the next. `numbers`: those that are to be made; `copied`: by copies of this process as well."""

    def __init__(
        self, model: Model, question: Question, points: Sequence[Any], numbers: Sequence[int], copied: bool
    ) -> None:
        self.model, self.question, self.points, self.numbers = model, question, points, numbers
        self._taken: Any = [0, 0]  # how many are, and whether all is over
        self._lock: Any = threading.Lock()
        if copied:
            import multiprocessing

            self._taken = memoryview(mmap.mmap(-1, 16)).cast("q")
            self._lock = multiprocessing.get_context("fork").Lock()

    def taken(self, leaves: Callable[[], bool] = lambda: False) -> int | None:
        """The number of a point, which nobody else makes then; None if there is none, all is over, or nobody else lets go and `leaves`."""
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
        """Nobody takes another point."""
        self._taken[1] = 1

    def answer(self, number: int) -> Any:
        """What is answered at a point."""
        return self.question.answer(self.model, self.points[number])

    def report(self) -> Answers:
        """The answers at some points; none if no point is left."""
        found: Answers = {}
        until = perf_counter() + OFTEN
        while not found or (len(found) < MOST_TOLD and perf_counter() < until):
            number = self.taken()
            if number is None:
                break
            found[number] = self.answer(number)
        return found


class _Others:
    """Those beside this process, who report to it. Whoever has told something is asked for more, whatever this process is at."""

    def __init__(self, executor: Executor, ask: Callable[[], Answers]) -> None:
        self.executor, self.ask = executor, ask
        self.reports: SimpleQueue[tuple[Future[Answers], bool]] = SimpleQueue()
        self.asked = 0  # reports that are still to come

    def begin(self, count: int) -> None:
        """Start `count` of them."""
        with _undisturbed(), _all_or_none():
            for _ in range(AHEAD * count):
                self.executor.submit(self.ask).add_done_callback(self._told)
        self.asked = AHEAD * count

    def _told(self, report: Future[Answers]) -> None:
        """In a thread of the executor."""
        more = not report.cancelled() and report.exception() is None and bool(report.result())
        if more:
            try:
                self.executor.submit(self.ask).add_done_callback(self._told)
            except RuntimeError:  # it is shut down, or one of them died
                more = False
        self.reports.put((report, more))

    def told(self) -> bool:
        """Whether there is a report."""
        return not self.reports.empty()

    def next(self) -> Answers:
        """The next report; waits for it. Raises what was raised there, `BrokenExecutor` if one of them died."""
        report, more = self.reports.get()
        self.asked -= not more
        return report.result()

    def last(self) -> Iterator[Answers]:
        """What they have done when they are told to stop: of each the point that it is at is the last."""
        self.executor.shutdown()
        while not self.reports.empty():
            report, _ = self.reports.get()
            if report.exception() is None:
                yield report.result()


def made(
    model: Model, question: Question, points: Sequence[Any], numbers: Sequence[int], count: int
) -> Iterator[Answers]:
    """The answers at the points of these numbers, in reports, of `count` workers. The first is made here: then the program is there, and
    others are copies of a process that has it. Raises `RunFailed` if one of them died."""
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
                f"a worker died ({broken}); with a journal, the same call goes on with what is missing"
            ) from broken
        except KeyboardInterrupt:  # what is done is not thrown away
            shared.stop()
            yield from others.last()
            raise


def _reports(points: Points, others: _Others | None) -> Iterator[Answers]:
    """All reports, those of this process among them. Between its points it looks for what others have told."""
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
    """Whether copies of this process can work: of one with other threads locks might stay shut, and of some none are allowed."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return False
    import multiprocessing

    return not multiprocessing.current_process().daemon


@contextmanager
def _executor(count: int, points: Points, copied: bool) -> Iterator[Executor]:
    """Workers beside this process, which have ended when it is left."""
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


_COPY: list[Points] = []  # in a copy of a process: what it works at


def _begun_as_copy(points: Points, parent: int) -> None:
    """Ctrl-C is for the process that was copied; it ends the others. Where it is killed, they end with it."""
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
    """While workers begin. Ctrl-C comes afterwards: of one that is half begun nobody would know that it is to be ended."""
    pressed: list[int] = []
    before = signal.getsignal(signal.SIGINT) if threading.current_thread() is threading.main_thread() else None
    if before is not None:  # None: it does not come here, or is not ours to hold back
        signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    try:
        with warnings.catch_warnings():
            # a copy of a process whose only threads are those of its linear algebra, which expects it
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            yield
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
    if pressed:
        signal.raise_signal(signal.SIGINT)


@contextmanager
def _all_or_none() -> Iterator[None]:
    """If not all processes can be made, those that are there are ended: an executor does not end what it has not begun as a whole."""
    import multiprocessing

    before = set(multiprocessing.active_children())
    try:
        yield
    except (OSError, RuntimeError):  # of processes, of threads
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
            process.join()
        raise
