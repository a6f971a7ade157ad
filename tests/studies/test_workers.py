"""Results do not depend on the workers: threads, processes, a Dask cluster that loses a worker, or a second attempt after a crash."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph import UsageError
from bondgraph.studies import workers
from bondgraph.studies.journal import SCHEMA, Journal
from bondgraph.studies.workers import Workers, answers

TEXT = """
model Oscillator {
  parameter k: N/m = 100, m = 1 kg
  I mass : p = m*v
  C spring : F = k*x + 1e3 [N/m^3]*x^3
  Se push : F = 4 N
  push -> 1(mass, spring)
  output x = spring.x
}
"""
VARY = {"k": "uniform(50 N/m, 150 N/m)", "m": "normal(1 kg, 0.05 kg)"}


def study(crew: Workers, samples: int = 64) -> Any:
    return bondgraph.load(TEXT).montecarlo(VARY, of=("equilibrium", "modes"), samples=samples, indices=32, workers=crew)


@pytest.fixture(scope="module")
def alone() -> Any:
    return study(Workers(1))


def same(found: Any, alone: Any) -> bool:
    """To the last bit."""
    assert found.quantities == ("x", "frequency 1")
    pairs = [(found.values, alone.values), (found.samples, alone.samples), (found.swing.ends, alone.swing.ends)]
    pairs += [(found.indices.first, alone.indices.first), (found.indices.total_interval, alone.indices.total_interval)]
    return all((a == b).all() and not np.isnan(a).any() for a, b in pairs)


def test_workers_of_our_own_and_threads(alone: Any) -> None:
    assert same(study(Workers(2)), alone)
    with ThreadPoolExecutor(3) as executor:
        assert same(study(Workers(executor=executor)), alone)


@dataclass(frozen=True)
class Counting:
    """Notes each point that it is asked at."""

    asked: list[int] = field(default_factory=list, compare=False, repr=False)
    until: int = 10**9

    def answer(self, model: Any, point: int) -> dict[str, float]:
        if len(self.asked) >= self.until:
            raise KeyboardInterrupt
        self.asked.append(point)
        return {"square": float(point) ** 2}


POINTS = list(range(1000))


def made(question: Counting, path: Path, points: list[int] = POINTS) -> list[Any]:
    journal = Journal(path)
    try:
        return answers(bondgraph.load(TEXT), question, points, Workers(1, journal=journal))
    finally:
        journal.close()


def test_after_a_crash_nothing_is_made_twice_and_nothing_is_lost(tmp_path: Path) -> None:
    path, asked = tmp_path / "j", list[int]()
    for until in (300, 700):
        with pytest.raises(KeyboardInterrupt):
            made(replaced(asked, until), path)
    kept = path.stat().st_size
    found = made(replaced(asked, 10**9), path)
    assert [x["square"] for x in found] == [float(i) ** 2 for i in POINTS]
    assert set(asked) == set(POINTS) and len(asked) < 1000 + 2 * 64  # of each crash the task that was on its way
    assert path.stat().st_size > kept
    again = list[int]()
    assert made(replaced(again, 10**9), path) == found and again == []


def replaced(asked: list[int], until: int) -> Counting:
    """As a question that differs in nothing that a journal looks at."""
    found = Counting(asked)
    object.__setattr__(found, "until", until)
    return _Quiet(found)  # type: ignore[return-value]


@dataclass(frozen=True)
class _Quiet:
    inner: Counting = field(repr=False)

    def answer(self, model: Any, point: int) -> dict[str, float]:
        return self.inner.answer(model, point)


@pytest.mark.parametrize("cut", [1, 40, 500])
def test_a_tail_that_is_not_whole_is_made_again(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "j"
    found = made(Counting(), path)
    content = path.read_bytes()
    for tail in (content[:-cut], content[:-cut] + bytes(cut)):
        path.write_bytes(tail)
        again = Counting()
        assert made(again, path) == found
        assert again.asked == POINTS[-len(again.asked) :] and 0 < len(again.asked) <= 64
        last = Counting()
        assert made(last, path) == found and last.asked == []


def test_a_journal_of_something_else(tmp_path: Path) -> None:
    path = tmp_path / "j"
    made(Counting(), path)
    for wrong in (lambda: made(Counting(), path, POINTS[:-1]), lambda: made(Counting(until=5), path)):
        with pytest.raises(UsageError, match="journal of another study"):
            wrong()
    (tmp_path / "text").write_text("model A {}")
    with pytest.raises(UsageError, match="is no journal"):
        made(Counting(), tmp_path / "text")
    (tmp_path / "begun").write_bytes(SCHEMA[:5])
    assert len(made(Counting(), tmp_path / "begun")) == 1000


def test_a_journal_runs_nothing(tmp_path: Path) -> None:
    """A record that would call something when it is read."""
    import hashlib

    class Evil:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(tmp_path / "made"),)

    path = tmp_path / "j"
    made(Counting(), path)
    content = path.read_bytes()
    body = pickle.dumps([Evil()])
    head = (0).to_bytes(8, "little") + len(body).to_bytes(8, "little")
    path.write_bytes(content[: len(SCHEMA) + 32] + head + hashlib.sha256(head + body).digest() + body)
    with pytest.raises(UsageError, match="holds what no study writes"):
        made(Counting(), path)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    "name", ["subprocess.Popen", "bondgraph.studies.local_workers.ThreadPoolExecutor", "pathlib.os"]
)
def test_a_journal_reads_no_other_nouns(name: str) -> None:
    """Nor those that modules of ours use."""
    import io

    from bondgraph.studies.journal import _JournalUnpickler

    module, _, noun = name.rpartition(".")
    with pytest.raises(pickle.UnpicklingError):
        _JournalUnpickler(io.BytesIO(f"c{module}\n{noun}\n.".encode())).load()


def test_a_journal_of_what_does_not_compile_in_a_file(tmp_path: Path) -> None:
    """The message names the file."""
    (tmp_path / "m.bg").write_text(
        "model B {\n  parameter n = 2\n  Se pull : F = 1 N\n  1 top : translation\n  pull -> top\n"
        "  for i in 1..n { R drag[i] : F = 2 [N*s/m]*v\n    top -> drag[i] }\n  output v = top.v\n}\n"
    )
    kept: list[list[str]] = []
    for _ in range(2):
        journal = Journal(tmp_path / "j")
        many = bondgraph.load(tmp_path / "m.bg").simulate_many(
            [{"n": 1.0}, {"n": 1.5}], to=1, points=11, workers=Workers(1, journal=journal)
        )
        journal.close()
        kept.append([str(x) for x in many])
    assert kept[0] == kept[1] and str(tmp_path / "m.bg") in kept[0][1]
    assert list(many.failures) == [1] and type(many.failures[1]) is bondgraph.CompilationFailed


def test_what_others_tell_pickle_is_not_in_a_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dask changes how exceptions go from process to process, for all of them."""
    import copyreg

    monkeypatch.setitem(copyreg.dispatch_table, bondgraph.RunFailed, lambda failed: (eval, ("1",)))
    for _ in range(2):
        journal = Journal(tmp_path / "j")
        found = journal.begun(bondgraph.load(TEXT), Counting(), POINTS)
        journal.add({3: bondgraph.RunFailed("BR748", "at t = 1 s")})
        journal.close()
    assert type(found[3]) is bondgraph.RunFailed and str(found[3]) == "at t = 1 s"


def test_what_no_journal_can_read_is_kept_in_words(tmp_path: Path) -> None:
    class Strange(Exception):
        """Of nobody's module."""

    journal = Journal(tmp_path / "j")
    journal.begun(bondgraph.load(TEXT), Counting(), POINTS)
    journal.add({3: Strange("it was strange"), 4: {"square": 16.0}})
    journal.close()
    journal = Journal(tmp_path / "j")
    found = journal.begun(bondgraph.load(TEXT), Counting(), POINTS)
    journal.close()
    assert type(found[3]) is bondgraph.RunFailed and str(found[3]) == "it was strange" and found[4] == {"square": 16.0}


def test_one_at_a_time(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    first = Journal(tmp_path / "j")
    first.begun(bondgraph.load(TEXT), Counting(), POINTS)
    with pytest.raises(UsageError, match="in use by another process"):
        made(Counting(), tmp_path / "j")
    first.close()
    assert len(made(Counting(), tmp_path / "j")) == 1000


def test_sweeps_and_runs_go_on_from_a_journal(tmp_path: Path) -> None:
    """A journal can hold whole results as well, which come back unchanged."""
    model = bondgraph.load(TEXT)
    for _ in range(2):
        journal = Journal(tmp_path / "runs")
        many = model.simulate_many(
            [{"k": 80.0 + i} for i in range(5)], None, 0.2, workers=Workers(1, journal=journal), target="numpy"
        )
        journal.close()
        np.testing.assert_array_equal(many["x"][2], model.simulate(None, {"k": 82.0}, 0.2, target="numpy")["x"])
        journal = Journal(tmp_path / "sweep")
        found = model.sweep(
            {"k": "80 N/m .. 90 N/m : 5"}, ("equilibrium", "modes"), workers=Workers(1, journal=journal)
        )
        journal.close()
        assert found[2].modes is not None and found[2].modes[-1].energy == model.modes(settings={"k": 85.0})[-1].energy


def test_a_dead_worker_is_told(alone: Any) -> None:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with (
        ProcessPoolExecutor(1, get_context("spawn")) as executor,
        pytest.raises(bondgraph.RunFailed, match="a worker died"),
    ):
        answers(bondgraph.load(TEXT), _Dying(), [0, 1], Workers(executor=executor))


@dataclass(frozen=True)
class _Dying:
    def answer(self, model: Any, point: Mapping[str, float]) -> None:
        os._exit(1)


@dataclass(frozen=True)
class _Elsewhere:
    """Answer with the number of the process. If `deadly`, any process but `home` dies of it."""

    home: int
    deadly: bool = False

    def answer(self, model: Any, point: int) -> int:
        if self.deadly and os.getpid() != self.home:
            os._exit(1)
        time.sleep(1e-3)
        return os.getpid()


def _made(count: int, deadly: bool = False) -> str:
    """Number of 200 answers made in this process, and number of processes in all, or the error.

    In a process without other threads, as those of tests may have.
    """
    code = f"""
import os
import bondgraph
from bondgraph.studies.workers import Workers, answers
from tests.studies.test_workers import TEXT, _Elsewhere
try:
    found = answers(bondgraph.load(TEXT), _Elsewhere(os.getpid(), {deadly}), range(200), Workers({count}))
    print(found.count(os.getpid()), len(set(found)))
except bondgraph.RunFailed as failed:
    print(failed)
"""
    root = Path(bondgraph.__file__).parents[1]
    return subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True).stdout


def test_two_who_share_out_the_same_text(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first to end leaves the other its model, and the last leaves nothing behind."""
    monkeypatch.setattr(workers, "_begun", None)  # nobody compiles it again
    models, met, ended = [bondgraph.load(TEXT) for _ in range(2)], threading.Barrier(2), threading.Event()
    found: dict[int, list[Any]] = {}

    def share(number: int, points: int) -> None:
        with ThreadPoolExecutor(1) as executor:
            asked = _Meeting(met, ended, number)
            found[number] = answers(models[number], asked, range(points), Workers(executor=executor))
        ended.set()

    threads = [threading.Thread(target=share, args=given) for given in ((0, 2), (1, 300))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == {0: [0, 1], 1: [*range(300)]}
    assert workers._MODELS == {} and workers._OWNERS == {}


@dataclass(frozen=True)
class _Meeting:
    """Both begin, then the first ends; only then the other goes on."""

    met: threading.Barrier = field(repr=False)
    ended: threading.Event = field(repr=False)
    number: int

    def answer(self, model: Any, point: int) -> int:
        if point == 0:
            self.met.wait(60)
        elif self.number == 1:
            assert self.ended.wait(60)
        return point


@pytest.mark.skipif(sys.platform != "linux", reason="workers are threads there")
@pytest.mark.parametrize("count", [2, 3])
def test_this_process_makes_the_first_point_and_its_copies_the_others(count: int) -> None:
    """Then the program exists that the copies have. With one worker there is no copy."""
    here, processes = map(int, _made(count).split())
    assert here == 1 and 1 < processes <= count + 1
    assert _made(1) == "200 1\n"


@pytest.mark.skipif(sys.platform != "linux", reason="workers are threads there")
def test_a_dead_worker_of_our_own_is_told() -> None:
    assert "a worker died" in _made(2, deadly=True)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_tasks_become_smaller(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker with one task in progress and two ahead has no more than its share of the remaining points."""
    monkeypatch.setattr(
        workers, "OFTEN", 60.0
    )  # s: on a busy machine no task reports a part of itself, whose rest is another
    tasks: list[list[int]] = []

    class Sizes(ThreadPoolExecutor):
        def submit(self, function: Any, task: Any) -> Any:  # type: ignore[override]
            tasks.append([*task.points])
            return super().submit(function, task)

    journal, points = Journal(tmp_path / "j"), range(2010)
    known = {i: {"square": float(i) ** 2} for i in (*range(5), *range(1900, 2000), *range(2007, 2010))}
    journal.begun(bondgraph.load(TEXT), Counting(), points)
    journal.add(known)
    journal.close()
    with Sizes(1) as executor:
        found = answers(bondgraph.load(TEXT), Counting(), points, Workers(count, executor, journal=journal))
    journal.close()
    assert found == [{"square": float(i) ** 2} for i in points]
    left = 1902
    assert [i for task in tasks for i in task] == [*range(5, 1900), *range(2000, 2007)]
    assert max(map(len, tasks)) == workers.MOST_AT_ONCE
    for task in tasks:
        assert len(task) == 1 or 3 * len(task) * count <= left
        left -= len(task)


@pytest.mark.parametrize(("each", "least"), [(1e-4, workers.LEAST_TOGETHER), (0.2, 1)])
def test_tasks_of_points_that_are_answered_together_are_not_small(each: float, least: int) -> None:
    """Many cost little more than few; but if each takes long, no worker waits for the last task of another."""
    sizes: list[int] = []

    class Own:
        def submit(self, numbers: Sequence[int]) -> Future[Any]:
            sizes.append(len(numbers))
            done = Future[Any]()
            done.set_result(({i: i for i in numbers}, each * len(numbers)))
            return done

    own: Any = Own()
    reports = workers._collected(own.submit, range(2000), 2, own, workers.FEW)
    assert sorted(i for report in reports for i in report) == [*range(2000)]
    begun = workers.AHEAD * 2  # before anything is known of their time
    assert sizes[:begun] == [workers.FEW] * begun
    assert max(sizes) <= workers.MOST_TOGETHER and min(sizes[begun:-1]) >= least
    assert (max(sizes) > workers.MOST_AT_ONCE) == (least > 1)


def test_what_is_too_long_for_one_report_goes_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each point takes longer than the interval of reports: every task tells its first, and the others are tasks of one."""
    monkeypatch.setattr(workers, "OFTEN", 0.0)
    told: list[int] = []
    with ThreadPoolExecutor(3) as executor:
        many = Workers(3, executor, progress=lambda done, total: told.append(done))
        assert answers(bondgraph.load(TEXT), Counting(), range(200), many) == [
            {"square": float(i) ** 2} for i in range(200)
        ]
    assert told == [*range(1, 201)]


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    import dask

    quiet = {"distributed.worker.profile.enabled": False, "distributed.admin.system-monitor.gil.enabled": False}
    with (
        dask.config.set(quiet),
        distributed.LocalCluster(
            2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        yield client


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_that_loses_a_worker(cluster: Any, alone: Any) -> None:
    pids = list(cluster.run(os.getpid).values())
    done: list[int] = []

    def watch(count: int, total: int) -> None:
        if not done:
            os.kill(pids[0], signal.SIGKILL)
        done.append(count)

    assert len(pids) == 2 and same(study(Workers(executor=cluster, progress=watch)), alone)
    assert done[-1] == 64 + 32 * 3 + 5 and sorted(set(done)) == done
    assert pids[0] not in cluster.run(os.getpid).values()
