"""Limit of time of a run: it ends even where the signal arrives in a place that cannot raise."""

from __future__ import annotations

import signal
import sys
import threading
import time

import pytest

from bondgraph.studies.time_limit import TooLong, within

LONG = 60.0  # s
needs_signals = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there are no such signals")


def wait(event: threading.Event) -> None:
    until = time.monotonic() + LONG
    while time.monotonic() < until and not event.is_set():
        pass


class Ending:
    """Object that waits at its end until a signal has been lost there."""

    def __init__(self, lost: threading.Event) -> None:
        self.lost = lost

    def __del__(self) -> None:
        try:
            wait(threading.Event())
        finally:
            self.lost.set()


@needs_signals
def test_what_takes_too_long_is_stopped() -> None:
    before = signal.getsignal(signal.SIGALRM), sys.unraisablehook
    with pytest.raises(TooLong, match=r"stopped after 0\.05 s"), within(0.05):
        wait(threading.Event())
    assert (signal.getsignal(signal.SIGALRM), sys.unraisablehook) == before


@needs_signals
def test_the_end_of_an_object_does_not_swallow_it(capsys: pytest.CaptureFixture[str]) -> None:
    """Python reports an exception in `__del__` and goes on: the limit is raised again behind it."""
    lost = threading.Event()
    with pytest.raises(TooLong), within(0.05):
        ending = Ending(lost)
        del ending
        assert lost.is_set()
        wait(threading.Event())
    assert capsys.readouterr().err == ""


@needs_signals
def test_other_errors_at_the_end_of_an_object_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def __del__(self) -> None:
            raise ValueError("broken")

    reported: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: reported.append(unraisable.exc_value))
    with within(LONG):
        broken = Broken()
        del broken
    assert [str(value) for value in reported] == ["broken"]


@needs_signals
def test_ctrl_c_is_no_limit() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores it
    try:
        with pytest.raises(KeyboardInterrupt), within(LONG):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_in_another_thread_it_has_no_effect() -> None:
    results: list[str] = []

    def work() -> None:
        with within(0.0001):
            time.sleep(0.01)
        results.append("done")

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert results == ["done"]
