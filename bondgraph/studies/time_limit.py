"""Limit of the time that a run may take."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import RunInterrupted


class TooLong(Exception):
    """A run that was stopped."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Stop what runs longer, as Ctrl-C would. Raises `TooLong`. Without effect in other threads than the first, and where there are no such signals."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    expired = False

    def stop(number: int, frame: object) -> None:
        nonlocal expired
        expired = True
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except (KeyboardInterrupt, RunInterrupted):
        if not expired:
            raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    if expired:
        raise TooLong(f"stopped after {seconds:g} s")
