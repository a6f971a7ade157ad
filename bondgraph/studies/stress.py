"""Stress test of an experiment by metamorphosis: texts, runs and settings that must give the same results, in turns until the time is over."""

from __future__ import annotations

import itertools
import time as clock
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from compiler.api import TEXT_CHANGES, CompilationFailed, Inapplicable, TextScene, smallest

from ..compiled_model import CompiledModel
from ..errors import RunFailed, UsageError
from ..files import write_text
from ..simulation.run_options import RunRequest
from .stress_bench import StressBench
from .stress_runs import (
    Attempts,
    corners,
    energy_balances,
    finer_events,
    other_solvers,
    other_targets,
    other_tolerances,
    reversed_time,
)
from .stressed import StressBreak, StressRow, StressTest
from .time_limit import TooLong, within

SHARE = 2 / 3  # of the time for trials; the rest is for the search of small files
LONGEST = 20.0  # s: a trial that takes longer, and longer than the whole test may, is stopped
TIGHTER = 1e-3  # every other change of a text is run with this share of the tolerance
TIGHTEST = 1e-10
MOST_UNTRIED = 8  # changes of a kind one after the other that cannot be tried: then none can


@dataclass(frozen=True, slots=True)
class StressRequest:
    """Request of a stress test: the run, `seconds` that it may take, the ranges of settings to `vary`, and the folder `out` for files of breaks."""

    run: RunRequest
    seconds: float = 30.0
    seed: int = 0
    vary: Mapping[str, str] = field(default_factory=dict)
    out: Path | None = None


@dataclass(frozen=True, slots=True)
class Trial:
    """A kind of change: its word, what is changed, and the changes in order; each is compared by a function of a bench, "" if it held."""

    kind: str
    changed: str
    attempts: Callable[[StressRequest], Attempts]


def _texts(kind: str) -> Callable[[StressRequest], Attempts]:
    """Return the changes of a text of one kind: first at the tolerance of the run, then at a tighter one, with one seed after the other."""

    def attempts(request: StressRequest) -> Attempts:
        for seed in itertools.count(request.seed):
            for share in (1.0, TIGHTER):
                yield f"seed {seed}" + ", tighter" * (share < 1), _text_check(kind, seed, share)
            if kind not in SEEDED:
                return

    return attempts


def _text_check(kind: str, seed: int, share: float) -> Callable[[StressBench], str]:
    def check(bench: StressBench) -> str:
        rtol = bench.base().rtol
        base = bench.base(rtol if share == 1 else max(share * rtol, min(TIGHTEST, rtol)))
        return bench.compare_text(base, TEXT_CHANGES[kind][1](bench.scene, seed))

    return check


SEEDED = ("units", "order", "names")
TRIALS = (
    Trial("energy", "balance of supplied, stored and dissipated energy", lambda request: energy_balances()),
    Trial("tolerances", "tolerances over three decades", lambda request: other_tolerances()),
    Trial("events", "events searched in 61 parts of the run", lambda request: finer_events()),
    Trial("solvers", "every other solver that can", lambda request: other_solvers()),
    Trial("targets", "machine code or numpy", lambda request: other_targets()),
    Trial("reversed", "back from the end in reversed time", lambda request: reversed_time()),
    Trial("corners", "other solvers at the corners of the ranges", lambda request: corners(request.vary, request.seed)),
    *(Trial(kind, changed, _texts(kind)) for kind, (changed, _) in TEXT_CHANGES.items()),
)


def stress(model: CompiledModel, request: StressRequest, progress: Callable[[str], None]) -> StressTest:
    """Try an experiment; `progress` is called with what is being tried.

    Raises `UsageError`, `CompilationFailed`, `RunFailed` if the unchanged run fails, OSError if `out` cannot be written.
    """
    if not 0 < request.seconds < float("inf"):
        raise UsageError("BR494", "a stress test takes a positive time")
    if request.out is not None:
        request.out.mkdir(parents=True, exist_ok=True)
    bench = StressBench(model, request.run)
    base = bench.base()
    began = clock.perf_counter()
    share = SHARE if request.out is not None else 1.0
    table = _Table(bench, request, began + share * request.seconds, progress)
    table.fill()
    breaks = tuple(table.breaks)
    if request.out is not None and breaks:
        breaks = tuple(_with_files(table, item, number, began) for number, item in enumerate(breaks, 1))
    estimate = base.error
    assert estimate is not None
    worst = float("nan") if estimate.worst is None else estimate.worst.share
    return StressTest(
        base.model, base.experiment, table.rows, breaks, worst, estimate.failure, clock.perf_counter() - began, request.seed
    )  # fmt: skip


class _Table:
    """Counts of the trials, and the breaks. After its first break a kind is tried no more."""

    def __init__(self, bench: StressBench, request: StressRequest, end: float, progress: Callable[[str], None]) -> None:
        self.bench, self.request, self.end, self.progress = bench, request, end, progress
        self.breaks: list[StressBreak] = []
        self.checks: dict[str, Callable[[StressBench], str]] = {}  # of the kinds that broke
        self.tried: dict[str, int] = defaultdict(int)
        self.untried: dict[str, dict[str, None]] = defaultdict(dict)

    @property
    def rows(self) -> tuple[StressRow, ...]:
        """Rows of the result; without that of corners where no range is given."""
        broken = {item.kind for item in self.breaks}
        return tuple(
            StressRow(t.kind, t.changed, self.tried[t.kind], int(t.kind in broken), tuple(self.untried[t.kind]))
            for t in TRIALS
            if t.kind != "corners" or self.request.vary
        )  # fmt: skip

    def fill(self) -> None:
        """Try one change of each kind in turn until the time is over."""
        waiting: dict[str, Iterator[tuple[str, Callable[[StressBench], str]]]] = {
            t.kind: iter(t.attempts(self.request)) for t in TRIALS
        }
        while waiting:
            for kind in tuple(waiting):
                if not self._turn(kind, waiting[kind]):
                    del waiting[kind]

    def _turn(self, kind: str, attempts: Attempts) -> bool:
        """Try changes until one could be tried; return False if the kind is done."""
        for _ in range(MOST_UNTRIED):
            attempt = next(attempts, None)
            if attempt is None or clock.perf_counter() >= self.end:
                return False
            holds = self._holds(kind, *attempt)
            if holds is not None:
                return holds
        return False

    def _holds(self, kind: str, change: str, check: Callable[[StressBench], str]) -> bool | None:
        """Return None if the change cannot be tried."""
        self.progress(f"{kind}, {change}")
        try:
            with within(max(LONGEST, self.request.seconds)):
                sentence = check(self.bench)
        except (Inapplicable, TooLong) as reason:
            self.untried[kind][str(reason)] = None
            return None
        self.tried[kind] += 1
        if sentence:
            self.breaks.append(StressBreak(kind, change, sentence))
            self.checks[kind] = check
        return not sentence


def _with_files(table: _Table, item: StressBreak, number: int, began: float) -> StressBreak:
    """Return a break with its smallest files, as far as the time allows; without some where the model cannot be written as one text."""
    request = table.request
    end = began + request.seconds * (SHARE + (1 - SHARE) * number / len(table.breaks))
    assert request.out is not None
    try:
        scene = table.bench.scene
    except Inapplicable:
        return item

    def holds(reduced: TextScene) -> bool:
        if clock.perf_counter() > end:
            return False
        bench = table.bench.of_scene(reduced)
        try:
            with within(max(end - clock.perf_counter(), 1e-3)):
                bench.base()
                return bool(table.checks[item.kind](bench))
        except (CompilationFailed, RunFailed, UsageError, Inapplicable, TooLong, ArithmeticError):
            return False

    scene = smallest(scene, holds)
    texts = {"": scene.text}
    if item.kind in TEXT_CHANGES:
        seed = int(item.change.split(",")[0].removeprefix("seed "))
        texts[" changed"] = TEXT_CHANGES[item.kind][1](scene, seed).changed.text
    paths = [request.out / f"{number} {item.kind}{suffix}.bg".replace(" ", "_") for suffix in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        write_text(path, text)
    return replace(item, files=tuple(map(str, paths)))
