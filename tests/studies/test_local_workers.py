"""Our own workers: a free one takes the next point, and answers are reported soon. No test looks at a clock: points wait for each other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import bondgraph
from bondgraph.studies import local_workers
from bondgraph.studies.local_workers import Points
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
    assert [here for _, here in answered[1:]].count(True) == 1


def test_others_go_on_while_this_process_is_at_a_long_point(kind: str) -> None:
    """It is at its first until all others are made."""
    made, points = CONTEXT.Semaphore(0), 700

    def call(point: int, here: bool) -> bool:
        if here and point:
            assert all(made.acquire(timeout=LONG) for _ in range(points - 2))
        elif point:
            made.release()
        return here

    assert found(call, points, 2).count(True) == 2  # the very first, and that one


def test_this_process_looks_between_its_points() -> None:
    """Answers of others are passed on before the next point of this process."""
    log: list[str] = []

    class Others:
        asked, waiting = 3, 2

        def told(self) -> bool:
            return self.waiting > 0

        def next(self) -> dict[int, str]:
            self.asked, self.waiting = self.asked - 1, max(self.waiting - 1, 0)
            return {self.asked + 10: "theirs"}

    def call(point: int, here: bool) -> str:
        log.append(f"at {point}")
        return "own"

    shared = Points(bondgraph.load(TEXT), Asked(call), range(3), range(3), False)
    for some in local_workers._reports(shared, Others()):  # type: ignore[arg-type]
        log.append(f"told {sorted(some)}")
    assert log == ["at 0", "told [12]", "told [11]", "at 1", "at 2", "told [0, 1, 2]", "told [10]"]


@pytest.mark.parametrize("count", [1, 2])
def test_what_takes_long_is_told_at_once(kind: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a few points: if each takes longer than the interval of reports, each is reported."""
    monkeypatch.setattr(local_workers, "OFTEN", 0.0)
    monkeypatch.setattr(local_workers, "perf_counter", iter(range(10**9)).__next__)
    told: list[int] = []
    assert found(lambda point, here: point, 20, count, progress=lambda done, total: told.append(done)) == [*range(20)]
    assert told == [*range(1, 21)]


def test_a_report_has_an_answer_as_long_as_there_are_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """However late it is: a report without answers ends the work of the worker that sent it."""
    monkeypatch.setattr(local_workers, "OFTEN", 0.0)
    shared = Points(bondgraph.load(TEXT), Asked(lambda point, here: point), range(3), range(3), False)
    assert [shared.report() for _ in range(5)] == [{0: 0}, {1: 1}, {2: 2}, {}, {}]


def test_each_point_is_made_once(kind: str) -> None:
    assert found(lambda point, here: point**2, 3000, 3) == [i**2 for i in range(3000)]


def test_an_interruption_waits_for_no_more_than_a_point_and_keeps_what_is_done(kind: str, tmp_path: Path) -> None:
    """This process is interrupted in its second point, when another has made ten and reported none yet."""
    begun, made, points = CONTEXT.Value("q", 0), CONTEXT.Semaphore(0), 5000

    def call(point: int, here: bool) -> int:
        with begun.get_lock():
            begun.value += 1
        if here and point:
            assert all(made.acquire(timeout=LONG) for _ in range(10))
            raise KeyboardInterrupt
        made.release()
        if not here and begun.value > 20:
            interrupted.wait(LONG)  # one point takes long
        return point

    interrupted = CONTEXT.Event()
    plain, journal = Points.stop, bondgraph.Journal(tmp_path / "j")

    def stop(self: Points) -> None:
        plain(self)
        interrupted.set()

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt) as caught:
        patch.setattr(Points, "stop", stop)
        patch.setattr(local_workers, "OFTEN", LONG)
        found(call, points, 2, journal=journal)
    journal.close()
    done = begun.value - 1  # all but its own
    assert done <= 21 and str(caught.value) == f"interrupted when {done} of {points} were done"
    kept = journal.begun(bondgraph.load(TEXT), Asked(call), range(points))
    journal.close()
    assert len(kept) == done and all(answer == point for point, answer in kept.items())


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
def test_workers_end_with_this_process() -> None:
    """None waits for work of one that was killed, and holds what is printed open."""
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run("""
def call(point, here):
    if here and point:
        os.kill(os.getpid(), signal.SIGKILL)
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
