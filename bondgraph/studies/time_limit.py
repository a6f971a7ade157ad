"""Limit of the time that a run may take."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import RunInterrupted

AGAIN = 0.01  # s: where nothing can be raised, as in the end of an object, it is tried again after this time


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

    def go_on(unraisable: sys.UnraisableHookArgs) -> None:
        if expired and unraisable.exc_type is KeyboardInterrupt:
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            report(unraisable)

    before, report = signal.signal(signal.SIGALRM, stop), sys.unraisablehook
    sys.unraisablehook = go_on
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except (KeyboardInterrupt, RunInterrupted):
        if not expired:
            raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        sys.unraisablehook = report
    if expired:
        raise TooLong(f"stopped after {seconds:g} s")
