"""Our own workers: all are busy while there are points, and answers are reported soon. No test looks at a clock: points wait for each other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest

import bondgraph
from bondgraph.studies import local_workers, workers
from bondgraph.studies.workers import Workers, answers
from tests.studies.test_workers import TEXT

only_linux = pytest.mark.skipif(sys.platform != "linux", reason="workers are threads there")
LONG = 60.0  # s, after which a point that waits fails
CONTEXT = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")


@pytest.fixture(params=["copies", "threads"])
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    kind = str(request.param)
    if kind == "copies" and not local_workers.can_be_copied():
        pytest.skip("there are threads, or this system has no copies")
    monkeypatch.setattr(local_workers, "can_be_copied", lambda: kind == "copies")
    return kind


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each point takes longer than the interval of reports."""
    monkeypatch.setattr(workers, "OFTEN", 0.0)
    monkeypatch.setattr(workers, "perf_counter", iter(range(10**9)).__next__)


@dataclass(frozen=True)
class Asked:
    """Calls something at each point, which knows whether this process and thread shares out the work."""

    call: Callable[[int, bool], Any] = field(repr=False)
    home: tuple[int, int] = field(default_factory=lambda: (os.getpid(), threading.get_ident()), repr=False)

    def answer(self, model: Any, point: int) -> Any:
        return self.call(point, (os.getpid(), threading.get_ident()) == self.home)


def found(call: Callable[[int, bool], Any], points: int, count: int, **given: Any) -> list[Any]:
    return answers(bondgraph.load(TEXT), Asked(call), range(points), Workers(count, **given))


@pytest.mark.parametrize("count", [2, 3])
def test_few_points_are_made_by_all_at_once(kind: str, count: int) -> None:
    """Behind the first as many points as workers: none of them ends before all have begun."""
    all_are_at_one = CONTEXT.Barrier(count)

    def call(point: int, here: bool) -> tuple[int, bool]:
        if point:
            all_are_at_one.wait(LONG)
        return point, here

    answered = found(call, count + 1, count)
    assert [point for point, _ in answered] == list(range(count + 1))
    assert [here for _, here in answered] == [True] + [False] * count


@pytest.mark.parametrize("count", [2, 3])
def test_others_go_on_while_one_is_at_a_long_point(kind: str, count: int) -> None:
    """It is at its first until all others are made."""
    made, points = CONTEXT.Semaphore(0), 700

    def call(point: int, here: bool) -> bool:
        if point == 1:
            assert all(made.acquire(timeout=LONG) for _ in range(points - 2))
        elif point:
            made.release()
        return here

    assert found(call, points, count) == [True] + [False] * (points - 1)


@pytest.mark.parametrize("long", [300, 617])
def test_no_more_than_one_report_waits_for_a_long_point(kind: str, long: int) -> None:
    """Wherever it is: behind it are the points of its task alone."""
    made, points = CONTEXT.Semaphore(0), 700

    def call(point: int, here: bool) -> int:
        if point == long:
            assert all(made.acquire(timeout=LONG) for _ in range(points - workers.MOST_AT_ONCE))
        else:
            made.release()
        return point

    assert found(call, points, 2) == [*range(points)]


def test_long_points_are_made_one_by_one(kind: str, impatient: None) -> None:
    """Each of two workers has one that takes as long as all the others, which nobody holds up: none waits behind a long one."""
    made, points = CONTEXT.Semaphore(0), 200

    def call(point: int, here: bool) -> int:
        if point == 150:
            assert all(made.acquire(timeout=LONG) for _ in range(points - 1))
        else:
            made.release()
        return point

    assert found(call, points, 2) == [*range(points)]


@pytest.mark.parametrize("count", [1, 2])
def test_what_takes_long_is_told_at_once(kind: str, count: int, impatient: None) -> None:
    """Also of a few points: if each takes longer than the interval of reports, each is reported."""
    told: list[int] = []
    assert found(lambda point, here: point, 20, count, progress=lambda done, total: told.append(done)) == [*range(20)]
    assert told == [*range(1, 21)]


def test_results_are_told_while_others_are_made(kind: str) -> None:
    """The last point ends when 500 others are told, of each worker."""
    told, points = CONTEXT.Semaphore(0), 700

    def call(point: int, here: bool) -> int:
        if point == points - 1:
            assert all(told.acquire(timeout=LONG) for _ in range(500))
        return point

    done: list[int] = []

    def progress(count: int, total: int) -> None:
        for _ in range(count - (done[-1] if done else 0)):
            told.release()
        done.append(count)

    assert found(call, points, 2, progress=progress) == [*range(points)]
    steps = [b - a for a, b in zip([0, *done], done, strict=False)]
    assert done[-1] == points and min(steps) > 0 and max(steps) <= workers.MOST_AT_ONCE


@pytest.mark.parametrize("count", [1, None])
def test_what_is_made_before_an_error_is_kept(count: int | None, tmp_path: Path) -> None:
    """An error that concerns all points ends the study, as it is; here, and in the task of an executor."""

    def call(point: int, here: bool) -> int:
        if point == 300:
            raise FileNotFoundError("data.csv")
        return point

    journal = bondgraph.Journal(tmp_path / "j")
    with ThreadPoolExecutor(1) as executor, pytest.raises(FileNotFoundError, match=r"data\.csv"):
        found(call, 400, count or 2, journal=journal, executor=None if count else executor)
    journal.close()
    kept = journal.begun(bondgraph.load(TEXT), Asked(call), range(400))
    journal.close()
    assert set(range(300)) <= set(kept) and 300 not in kept


def test_each_point_is_made_once(kind: str) -> None:
    assert found(lambda point, here: point**2, 3000, 3) == [i**2 for i in range(3000)]


def test_an_interruption_waits_for_no_more_than_a_point_and_keeps_what_is_done(kind: str, tmp_path: Path) -> None:
    """One worker is in the first point of its task, the other has made ten of another, and has told none of them."""
    ready, interrupted, points = CONTEXT.Event(), CONTEXT.Event(), 5000

    def call(point: int, here: bool) -> int:
        if point == 81:
            ready.set()
        if point in (7, 81):
            assert interrupted.wait(LONG)
        return point

    class Finished(SimpleQueue[Any]):
        """Interrupted at the first report after the six single points with which two workers begin."""

        reports = 0

        def get(self, *given: Any) -> Any:
            self.reports += 1
            if self.reports == 7:
                assert ready.wait(LONG)
                raise KeyboardInterrupt
            return super().get(*given)

    plain, journal = local_workers.LocalWorkers.end, bondgraph.Journal(tmp_path / "j")

    def end(self: local_workers.LocalWorkers) -> None:
        self.stopped[0] = 1
        interrupted.set()
        plain(self)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt) as caught:
        patch.setattr(local_workers.LocalWorkers, "end", end)
        patch.setattr(workers, "OFTEN", LONG)
        patch.setattr(workers, "SimpleQueue", Finished)
        found(call, points, 2, journal=journal)
    journal.close()
    done = [*range(8), *range(71, 82)]
    assert str(caught.value) == f"interrupted when {len(done)} of {points} were done"
    kept = journal.begun(bondgraph.load(TEXT), Asked(call), range(points))
    journal.close()
    assert kept == {point: point for point in done}


def run(code: str) -> str:
    """Output of a separate process without threads, which has to end on its own."""
    begin = "import os, signal\nimport multiprocessing as mp\nimport bondgraph\nfrom tests.studies.test_local_workers import *\n"
    root = Path(bondgraph.__file__).parents[1]
    return subprocess.run(
        [sys.executable, "-c", begin + code], cwd=root, capture_output=True, text=True, check=True, timeout=LONG
    ).stdout


@only_linux
@pytest.mark.parametrize("number", [1, 2, 3])
def test_ctrl_c_while_others_are_started(number: int) -> None:
    """At the start of the first, second or third of three: none is left over, and the interpreter can end."""
    assert (
        run(f"""
import multiprocessing.popen_fork as started
plain, begun = started.Popen._launch, []
def launch(self, what):
    plain(self, what)
    begun.append(1)
    if len(begun) == {number}:
        os.kill(os.getpid(), signal.SIGINT)
started.Popen._launch = launch
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    found(lambda point, here: point, 20, 4)
except KeyboardInterrupt as pressed:
    print(str(pressed).startswith("interrupted when "), mp.active_children())
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
""")
        == "True []\nTrue\n"
    )


@only_linux
def test_where_not_all_can_be_started() -> None:
    """Workers that were started are ended."""
    assert (
        run("""
import multiprocessing.popen_fork as started
plain, begun = started.Popen._launch, []
def launch(self, what):
    if len(begun) == 2:
        raise BlockingIOError("no more processes")
    plain(self, what)
    begun.append(1)
started.Popen._launch = launch
try:
    found(lambda point, here: point, 20, 4)
except BlockingIOError as problem:
    print(problem, len(begun), mp.active_children())
""")
        == "no more processes 2 []\n"
    )


@only_linux
@pytest.mark.parametrize("end", ["os.killpg(0, signal.SIGINT)", "os._exit(1)"])
def test_what_is_made_before_ctrl_c_or_a_death_is_kept(end: str, tmp_path: Path) -> None:
    """The terminal sends Ctrl-C to all processes. The point that brings the end waits until others are told."""
    assert (
        run(f"""
os.setsid()
signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores it
told = mp.get_context("fork").Event()
def call(point, here):
    if point == 700:
        told.wait(LONG)
        {end}
    return point
def progress(done, total):
    if done == 700:
        told.set()
journal = bondgraph.Journal({str(tmp_path / "j")!r})
try:
    found(call, 701, 2, journal=journal, progress=progress)
except (bondgraph.RunFailed, KeyboardInterrupt) as ended:
    print(type(ended).__name__, str(ended).split(" (")[0].rpartition(" of ")[2], mp.active_children())
journal.close()
kept = journal.begun(bondgraph.load(TEXT), Asked(call), range(701))
print(kept.items() >= {{i: i for i in range(700)}}.items())
""")
        == f"{'RunFailed a worker died' if 'exit' in end else 'KeyboardInterrupt 701 were done'} []\nTrue\n"
    )


@only_linux
def test_workers_end_with_this_process() -> None:
    """None goes on with its point when that is killed, and holds what is printed open."""
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run("""
def call(point, here):
    if point == 10:
        os.kill(os.getppid(), signal.SIGKILL)
    if point > 8:
        signal.pause()
    return point
found(call, 100, 3)
""")
    assert caught.value.returncode == -signal.SIGKILL


@only_linux
def test_within_a_worker_of_others() -> None:
    """One of `multiprocessing.Pool` must not have processes of its own."""
    assert (
        run("""
def call(count):
    return found(lambda point, here: (point, os.getpid() == mp.current_process().pid), 20, count)
with mp.get_context("fork").Pool(1) as pool:
    print(pool.map(call, [1, 2, None]) == [[(i, True) for i in range(20)]] * 3)
""")
        == "True\n"
    )
