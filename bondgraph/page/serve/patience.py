"""Work that can be stopped: a run that a slider made endless must not keep all later ones waiting.

Python stops a thread by raising an exception in it, which is what Ctrl-C does in the first one; runs know it, and leave nothing half done.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from typing import Any


class Stopped(Exception):
    """The work was stopped before its end."""


class Patience:
    """Does one thing at a time, and no longer than some seconds."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._thread: int | None = None
        self._began = 0.0

    def within(self, seconds: float, work: Callable[[], Any]) -> Any:
        """What some work gives. Raises `Stopped`."""
        timer = threading.Timer(seconds, self.stop)
        timer.daemon = True
        try:
            with self._guard:
                self._thread, self._began = threading.get_ident(), time.monotonic()
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
        """Stop what is being done, if it has been for so many seconds; whether there was such a thing."""
        with self._guard:
            if self._thread is None or time.monotonic() - self._began < longer_than:
                return False
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self._thread), ctypes.py_object(KeyboardInterrupt)
            )
            return True
