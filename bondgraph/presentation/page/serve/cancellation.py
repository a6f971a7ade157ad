"""Cancellation of work: a run that a slider made endless must not block all later ones.

Python stops a thread by raising an exception in it, as Ctrl-C does in the main thread; runs handle that, and leave nothing incomplete.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any


class Stopped(Exception):
    """Raised if the work was stopped before its end."""


class TimedExecutor:
    """Executor of one task at a time, with a time limit."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._thread: int | None = None
        self._began = 0.0

    def within(self, seconds: float, work: Callable[[], Any]) -> Any:
        """Return the result of some work. Raises `Stopped` after `seconds`."""
        timer = threading.Timer(seconds, self.stop)
        timer.daemon = True
        try:
            with self._guard:
                self._thread, self._began = threading.get_ident(), time.monotonic()
            with suppress(RuntimeError):  # no thread can start in a browser: no limit there
                timer.start()
            try:
                return work()
            finally:
                with self._guard:
                    self._thread = None
        except KeyboardInterrupt as stopped:
            raise Stopped(str(stopped)) from None
        finally:
            timer.cancel()

    def stop(self, longer_than: float = 0.0) -> bool:
        """Stop the current task if it has run for `longer_than` seconds; return True if there was one."""
        with self._guard:
            if self._thread is None or time.monotonic() - self._began < longer_than:
                return False
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self._thread), ctypes.py_object(KeyboardInterrupt)
            )
            return True
