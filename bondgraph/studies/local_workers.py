"""Our own workers: copies of this process, or threads if it cannot be copied (another system than Linux, other threads in it).

A copy has the model, its program, the request and the points: it receives indices only.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .point_request import TimedReport

_COPY: list[Callable[[Sequence[int]], TimedReport]] = []  # in a copy of a process: how it computes points


@dataclass(frozen=True, slots=True)
class LocalWorkers:
    """Workers of this machine. `report`: their function; `stopped`: a byte shared with copies, 1 when no further point is to be computed."""

    executor: Executor
    report: Callable[[Sequence[int]], TimedReport]
    stopped: mmap.mmap

    def submit(self, numbers: Sequence[int]) -> Future[TimedReport]:
        """Let a worker compute the first report on the points with these indices."""
        return self.executor.submit(self.report, numbers)

    def end(self) -> None:
        """End the workers: each finishes its current point and reports."""
        self.stopped[0] = 1
        self.executor.shutdown(cancel_futures=True)


def local_workers(
    first_report: Callable[[Iterable[int]], TimedReport], count: int, in_threads: bool = False
) -> LocalWorkers:
    """Return workers that start with their first task. `first_report` computes some points by their indices; `in_threads`: without Python, mostly."""
    stopped = mmap.mmap(-1, 1)

    def report(numbers: Sequence[int]) -> TimedReport:
        return first_report(takewhile(lambda number: not stopped[0], numbers))

    if in_threads or not can_be_copied():
        return LocalWorkers(ThreadPoolExecutor(count), report, stopped)
    from concurrent.futures import ProcessPoolExecutor  # which Python in a browser does not have

    fork = multiprocessing.get_context("fork")
    copies = ProcessPoolExecutor(count, fork, _begun_as_copy, (report, os.getpid()))
    return LocalWorkers(copies, _report_of_copy, stopped)


def can_be_copied() -> bool:
    """Return True if copies of this process can work: with other threads locks might stay closed, and daemons may have no copies."""
    return sys.platform == "linux" and threading.active_count() == 1 and not multiprocessing.current_process().daemon


def _begun_as_copy(report: Callable[[Sequence[int]], TimedReport], parent: int) -> None:
    """Prepare a copy: it ignores Ctrl-C, which the original process handles, and ends if that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(1)
    gc.freeze()  # a collection would copy all memory of the original process
    _COPY[:] = [report]


def _report_of_copy(numbers: Sequence[int]) -> TimedReport:
    return _COPY[0](numbers)


@contextmanager
def started_together() -> Iterator[None]:
    """Start all workers or none, and delay Ctrl-C meanwhile: a worker interrupted in its start could not be ended."""
    pressed: list[int] = []
    before = signal.getsignal(signal.SIGINT) if threading.current_thread() is threading.main_thread() else None
    if before is not None:  # None: the signal does not arrive here, or must not be delayed
        signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    others = set(multiprocessing.active_children())
    try:
        with warnings.catch_warnings():
            # the only threads of the copied process are those of its linear algebra, which supports copying
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            yield
    except (OSError, RuntimeError):  # from processes, from threads
        for process in set(multiprocessing.active_children()) - others:  # an executor does not end them
            process.terminate()
            process.join()
        raise
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
    if pressed:
        signal.raise_signal(signal.SIGINT)
