"""Trials: tests of a room in one warm process, a fork for each mutant, so that each begins as if nothing had run."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import signal
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.mutation.switches import Installed, Switch, allow_switches_in_compiled_functions

PATIENCE, ALLOWANCE = 10, 10.0  # a test that takes 10 times as long as it does, and 10 s more, does not end
SLOW, SLOW_FILE = 5.0, 12.0  # seconds; tests that take longer are not asked, nor those of a file after that time
WALL = 900  # seconds after which a fork that waits for something is ended
Passing = dict[str, Any]  # of a test: seconds, passed, numbers of the mutants


@dataclass(slots=True)
class Outcomes:
    """A plugin that remembers whether the reports of the test that runs failed, or it was left out."""

    failed: bool = False
    skipped: bool = False

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.failed |= report.failed
        self.skipped |= report.skipped


def forked(work: Callable[[], None], wall: float = WALL) -> int:
    """Do the work in a fork; its exit status, less than 0 if a signal ended it."""
    child = os.fork()
    if child == 0:
        os.setsid()
        try:
            work()
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    ends = time.monotonic() + wall
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            break
        if time.monotonic() > ends:
            os.killpg(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            break
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # workers that a test left
    return os.waitstatus_to_exitcode(status)


def processor() -> float:
    used, below = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime + below.ru_utime + below.ru_stime


def too_slow(*_: object) -> None:
    raise TimeoutError


def passed_in(items: Sequence[pytest.Item], outcomes: Outcomes, switch: Switch, book: Path) -> None:
    """Run tests of sound code; write for each its time and the mutants that it passes."""
    signal.signal(signal.SIGPROF, too_slow)
    ends = processor() + SLOW_FILE
    with book.open("a", encoding="utf-8") as stream:
        for item, following in zip(items, [*items[1:], None], strict=True):
            switch.passed.clear()
            outcomes.failed = outcomes.skipped = False
            began = processor()
            signal.setitimer(signal.ITIMER_PROF, SLOW)
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            signal.setitimer(signal.ITIMER_PROF, 0)
            entry = {
                "test": item.nodeid,
                "seconds": round(processor() - began, 3),
                "sound": not outcomes.failed and not outcomes.skipped,
                "mutants": sorted(switch.passed),
            }
            stream.write(json.dumps(entry) + "\n")
            stream.flush()
            if processor() > ends:
                break
    os._exit(0)


def noticed(
    items: Sequence[pytest.Item], sound: dict[str, float], outcomes: Outcomes, seconds: float, book: Path
) -> None:
    """Run tests, quickest first, until one fails or the time is used up."""
    ordered = sorted(items, key=lambda item: sound[item.nodeid])
    began = processor()
    for item, following in zip(ordered, [*ordered[1:], None], strict=True):
        used, usual = processor(), sound[item.nodeid]
        if used - began + usual > seconds:
            break
        outcomes.failed = False
        limit = int(used + PATIENCE * usual + ALLOWANCE) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))
        book.write_text(item.nodeid, encoding="utf-8")
        item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
        if outcomes.failed:
            os._exit(2)
    os._exit(0)


def mentions(path: Path, words: set[str]) -> int:
    """Number of the words that a file has."""
    return len(words & set(re.findall(r"[a-z]\w+", path.read_text(encoding="utf-8"))))


@dataclass(slots=True)
class Trials:
    """A plugin that runs the collected tests in its own way."""

    installed: Installed
    loop: Callable[[Trials, Sequence[pytest.Item]], None]
    outcomes: Outcomes

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        allow_switches_in_compiled_functions()
        session.config._tmp_path_factory.getbasetemp()  # one for all forks
        self.loop(self, session.items)
        return True

    def passing(
        self, items: Sequence[pytest.Item], book: Path, words: set[str], enough: Callable[[list[Passing]], bool]
    ) -> list[Passing]:
        """Time and mutants of each test, a fork for each file, those first that have most of the words; files that are in the book and have not changed are not run."""
        files: dict[str, list[pytest.Item]] = {}
        for item in items:
            files.setdefault(f"{item.path} {item.path.stat().st_mtime_ns}", []).append(item)
        known = json.loads(book.read_text(encoding="utf-8")) if book.exists() else {}
        found: list[Passing] = [entry for name in files for entry in known.get(name, ())]
        nearest = sorted(files, key=lambda name: -mentions(files[name][0].path, words))
        for name, own in ((name, files[name]) for name in nearest):
            if name in known:
                continue
            if enough(found):
                break
            lines = book.with_suffix(".part")
            lines.unlink(missing_ok=True)
            forked(lambda own=own, lines=lines: passed_in(own, self.outcomes, self.installed.switch, lines))
            known[name] = (
                [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()] if lines.exists() else []
            )
            found += known[name]
            book.write_text(json.dumps(known), encoding="utf-8")
        return found
