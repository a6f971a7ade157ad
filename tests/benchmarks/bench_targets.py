"""Performance targets, measured: the manipulator beside other solvers, its code beside C by hand, start-up, many runs, operation counts.

    python -m tests.benchmarks targets

writes results/targets.md, and keeps the remarks below its table. Times are processor times (others may use the machine), except where the table says otherwise.
"""

from __future__ import annotations

import ctypes
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.simulation.integrators import exponential
from compiler.api import cost
from tests.benchmarks import peers
from tests.benchmarks.bench_work_precision import OURS, WHOLE, Clock, kept, measured, time_at
from tests.benchmarks.scenes import MANIPULATOR, ROOT, SCENES

RESULTS = Path(__file__).parent / "results"
GOAL = 1e-5
CALLS, BATCHES = 20_000, 101
SETS, ROUNDS = 1000, 7
Row = tuple[str, str, str, str]  # what, measured, target, met


def row(what: str, found: float | None, target: float, words: str = "{:.3g}", least: bool = False) -> Row:
    """A line of the table. `least`: the target is a lower bound."""
    if found is None:
        return what, "not measured", f"{'at least' if least else 'at most'} {words.format(target)}", "?"
    met = found >= target if least else found <= target
    return (
        what,
        words.format(found),
        f"{'at least' if least else 'at most'} {words.format(target)}",
        "yes" if met else "**no**",
    )


def solvers() -> Iterator[Row]:
    """1: times at an error of 1e-5, from the measurements of `work_precision`; measured here where it has none."""
    wanted = ("SUNDIALS, order 2", "SUNDIALS, order 5", "scipy Radau + lambdify")
    for scene in SCENES[:2]:
        found = kept()[scene.name][0] if scene.name in kept() else measured(scene, wanted)[0]
        for name, most in zip(wanted, (0.15, 1.0, 1 / 60), strict=True):
            for own in (OURS, WHOLE):
                mine, theirs = time_at(found[own], GOAL), time_at(found.get(name, []), GOAL)
                ratio = mine / theirs if mine and theirs else None
                yield row(f"1. {scene.title}, error 1e-5: {own.partition(': ')[2]} / {name}", ratio, most)


def code() -> Iterator[Row]:
    """2: right side and Jacobian beside gcc -O2 on C by hand; the least of many batches."""
    model = bondgraph.load(MANIPULATOR)
    program = model.compiled_scene(model.scene(), False, "native").program
    assert program.native is not None
    hand, loops = peers.by_hand(), peers.compiled("loops")
    constants = np.asarray(program.constants(np.array(program.defaults)))
    state = np.asarray(program.start(constants)) + 1e-7
    inputs, mode = np.array([*program.input_defaults, 0.0]), np.append(program.switches(1e-3, constants), 0.0)
    out, pointer, number, count = np.zeros(1000), ctypes.c_void_p, ctypes.c_double, ctypes.c_int64

    def batch(function: Any, *arguments: Any) -> float:
        began = time.thread_time()
        function(*arguments)
        return (time.thread_time() - began) / CALLS * 1e9

    arrays = [pointer(a.ctypes.data) for a in (state, inputs, constants, mode, out)]
    for ours, name, words in (("derivative", "f", "right side"), ("jacobian_entries", "j", "Jacobian")):
        mine, theirs = [], []
        for _ in range(BATCHES):
            mine.append(
                batch(
                    loops.loop_generated, pointer(program.native.addresses[ours]), count(CALLS), number(1e-3), *arrays
                )
            )
            theirs.append(
                batch(
                    loops.loop_written,
                    peers.address(hand, f"manipulator_{name}"),
                    count(CALLS),
                    number(1e-3),
                    arrays[0],
                    arrays[-1],
                )
            )
        a, b = min(mine), min(theirs)  # others on the machine only add
        yield row(
            f"2. {words}: {a:.0f} ns, gcc -O2 by hand {b:.0f} ns",
            a / b,
            1.3,
        )


def _process(arguments: Sequence[str], environment: dict[str, str], again: int) -> tuple[float, float]:
    """The least processor time and wall time of a whole process, in s."""
    spent, walls = [], []
    for _ in range(again):
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True, cwd=ROOT, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        walls.append(time.perf_counter() - began)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(spent), min(walls)


def startup() -> Iterator[Row]:
    """3: whole processes; Python keeps its byte code, as it does where nobody forbids it."""
    with tempfile.TemporaryDirectory() as place:
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {
            "BONDGRAPH_CACHE": f"{place}/kept",
            "PYTHONPYCACHEPREFIX": f"{place}/bytes",
            "PYTHONPATH": str(ROOT),
        }
        run = ["-m", "bondgraph", "run", str(MANIPULATOR)]
        _process(["-m", "bondgraph", "check", str(MANIPULATOR)], environment, 1)
        first, _ = _process(run, environment, 1)
        again, _ = _process(run, environment, 9)
        numpy, _ = _process(["-c", "import numpy"], environment, 9)
        fresh = []
        for number in range(3):
            model = Path(place) / f"other{number}.bg"
            model.write_text(MANIPULATOR.read_text())
            (Path(place) / "mems.bg").write_text((MANIPULATOR.parent / "mems.bg").read_text())
            fresh.append(_process(["-m", "bondgraph", "run", str(model)], environment, 1)[0])
        yield row(f"3. seen before: {again * 1e3:.0f} ms, import numpy {numpy * 1e3:.0f} ms", again / numpy, 3.0)
        yield row("3. never seen before, s", min(fresh), 2.5)
        yield row("3. with the first build of the stepping code, s", first, 20.0)


def ensembles() -> Iterator[Row]:
    """5: 1000 parameter sets on one worker and on two, in turns; medians."""
    random = np.random.default_rng(0)
    sets = [
        {"a": 170e-6 * (1 + 0.02 * x), "r": 2.5e-5 * (1 + 0.1 * y), "d[1]": 1.95e-6 * (1 + 0.01 * z)}
        for x, y, z in random.standard_normal((SETS, 3))
    ]
    found: dict[int, Any] = {}
    walls: dict[int, list[float]] = {1: [], 2: []}
    shares: dict[int, list[float]] = {1: [], 2: []}  # processor time, by worker
    for workers in (1, 2) * ROUNDS:
        model = bondgraph.load(MANIPULATOR)
        model.simulate(settings=sets[0], points=201)
        before, own, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.process_time(), time.perf_counter()
        found[workers] = model.simulate_many(sets, points=201, workers=workers)
        walls[workers].append(time.perf_counter() - began)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        children = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        shares[workers].append((time.process_time() - own + children) / workers)
    same = all(np.array_equal(a.values, b.values) for a, b in zip(found[1], found[2], strict=True))
    alone = all(
        np.array_equal(bondgraph.load(MANIPULATOR).simulate(settings=sets[i], points=201).values, found[2][i].values)
        for i in (0, 500, 999)
    )
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    one, two = (statistics.median(shares[workers]) for workers in (1, 2))
    yield row(
        f"5. {SETS} sets, processor time of one worker ({one:.3g} s) over half of that of two",
        one / two,
        1.8,
        least=True,
    )
    one, two = (statistics.median(walls[workers]) for workers in (1, 2))
    yield row(
        f"5. the same in wall time ({one:.3g} s; load of the machine {load:.1f})",
        one / two,
        1.8,
        least=True,
    )
    yield (
        "5. bit-identical, to each other and to single runs",
        str(same and alone),
        "True",
        "yes" if same and alone else "**no**",
    )


KINDS: tuple[tuple[str, str, str, float], ...] = (  # model, its parameter that varies, and the value
    ("linear", "models/rlc.bg", "R", 10.0),
    ("linear, 400 segments", "models/step_down.bg", "load", 2.0),
    ("bouncing ball", "tests/acceptance/defects/elastic_ball.bg", "h", 1.0),
    ("slider-crank", "models/slider_crank.bg", "m", 0.8),
    ("closed four-bar", "models/four_bar.bg", "k", 200.0),
    ("diode rectifier", "models/rectifier.bg", "load", 200.0),
    ("transistor amplifier", "models/published/transistor_amplifier.bg", "R", 9000.0),
    ("Robertson", "models/published/robertson.bg", "k1", 0.04),
    ("manipulator", "models/manipulator.bg", "h", 38e-6),
)
EACH, CALLED = 65, 31  # sets of a batch, and calls of one run


@contextmanager
def neighbour(busy: bool) -> Iterator[None]:
    """Keep a core busy with another process."""
    other = subprocess.Popen([sys.executable, "-c", "while True: pass"]) if busy else None
    try:
        yield
    finally:
        if other is not None:
            other.kill()
            other.wait()


def calls() -> Iterator[Row]:
    """8: whole calls and batches of each kind of model, in units of the bare steps of one run, without and with a busy neighbour."""
    clock = Clock(exponential)
    for kind, path, name, value in KINDS:
        model = bondgraph.load(ROOT / path)
        sets = [{name: value * (1 + 1e-3 * i / EACH)} for i in range(EACH)]
        times: list[tuple[float, float, float]] = []
        for busy in (False, True):
            with neighbour(busy):
                model.simulate_many(sets[:5], workers=1)
                steps, whole = [], []
                for _ in range(CALLED):
                    clock.total, began = 0.0, time.thread_time()
                    model.simulate(settings=sets[0])
                    whole.append(time.thread_time() - began)
                    steps.append(clock.total)
                began = time.process_time()
                model.simulate_many(sets, workers=1)
                batch = (time.process_time() - began) / EACH
            times.append((statistics.median(steps), statistics.median(whole), batch))
        (steps_of, call, each), (_, busy_call, busy_each) = times
        yield row(f"8. {kind}: whole call / its steps, {steps_of * 1e3:.3g} ms", call / steps_of, 1.5)
        yield row(f"8. {kind}: a run among {EACH} sets / the steps of one", each / steps_of, 1.3)
        yield row(f"8. {kind}: call with a busy neighbour / without", busy_call / call, 1.3)
        yield row(f"8. {kind}: sets with a busy neighbour / without", busy_each / each, 1.3)


OFF = """
  experiment quiet { simulate 0 .. 20 ms; set fx = 30 uN*smoothstep5(time, 0 s, 5 ms) }
  experiment off { simulate 0 .. 20 ms; set fx = 30 uN*smoothstep5(time, 0 s, 5 ms); start stage.platform.x = 1 nm; bandwidth 50 kHz }
"""


def bandwidths() -> Iterator[Row]:
    """6: whole calls of a manipulator whose platform starts 1 nm off, beside those of an undisturbed one, in turns."""
    with tempfile.TemporaryDirectory() as place:
        for name in ("mems.bg", "manipulator.bg"):
            text = (MANIPULATOR.parent / name).read_text(encoding="utf-8")
            (Path(place) / name).write_text(text.replace("  experiment ", f"{OFF}\n  experiment ", 1), encoding="utf-8")
        model = bondgraph.load(Path(place) / "manipulator.bg")
        took: dict[str, list[float]] = {"quiet": [], "off": []}
        for _ in range(31):
            for experiment, times in took.items():
                began = time.thread_time()
                model.simulate(experiment)
                times.append(time.thread_time() - began)
    quiet, off = (statistics.median(t) for t in took.values())
    yield row(f"6. 1 nm off with a bandwidth of 50 kHz, whole call {off * 1e3:.3g} ms / undisturbed", off / quiet, 2.0)


def counts() -> Iterator[Row]:
    """7: operations of an evaluation, additional ones of the Jacobian and of the outputs, by requested outputs."""
    model = bondgraph.load(MANIPULATOR)
    before: tuple[int, int] | None = None
    for outputs in (None, ("x", "c1"), ("x",)):
        scene = model.scene("push_x", outputs=outputs)
        told = cost(model.compilation(scene).lowered)
        words = "all outputs" if outputs is None else f"outputs {', '.join(outputs)}"
        total = told.rates + told.jacobian, told.outputs
        fine = before is None or (total[0] <= before[0] and total[1] <= before[1])
        before = total
        yield (
            f"7. manipulator, {words}",
            f"{told.rates} + {told.jacobian} for the Jacobian + {told.outputs} for outputs; {len(model.compilation(scene).certificate.states)} states",
            "not rising: all its states hang together",
            "yes" if fine else "**no**",
        )
    text = MANIPULATOR.read_text(encoding="utf-8")
    assert "r      = 2.5e-5" in text
    with tempfile.TemporaryDirectory() as place:  # beside its import
        (Path(place) / "mems.bg").write_text(
            (MANIPULATOR.parent / "mems.bg").read_text(encoding="utf-8"), encoding="utf-8"
        )
        folded = Path(place) / "folded.bg"
        folded.write_text(text.replace("r      = 2.5e-5", "r      = 0"), encoding="utf-8")
        one = bondgraph.load(folded).simulate(rtol=1e-9, to=2e-3, points=21).values
    other = model.simulate(settings={"r": 0.0}, rtol=1e-9, to=2e-3, points=21).values
    yield row(
        "7. manipulator, r = 0 set against r = 0 in the text, relative",
        float(np.abs(other - one).max() / np.abs(one).max()),
        1e-8,
    )


def main(names: Sequence[str] = ()) -> None:
    rows: list[Row] = []
    for part in (counts, code, startup, ensembles, bandwidths, calls, solvers):
        if names and part.__name__ not in names:
            continue
        for found in part():
            print(" | ".join(found), file=sys.stderr, flush=True)
            rows.append(found)
    rows.sort(key=lambda r: r[0][0])
    lines = [
        "# What was promised in numbers",
        "",
        "`python -m tests.benchmarks targets`. Processor times of one thread or process, where nothing else is said.",
        "",
    ]
    lines += ["| what | measured | target | met |", "|---|---|---|---|", *(f"| {' | '.join(r)} |" for r in rows), ""]
    lines += [
        "`steps` are the solver alone, beside solvers that are given magnitudes and machine code as well; `whole run` is `Model.simulate` with a program that is",
        "there: outputs besides, and what the calls before have not found yet. Calls of 8 follow each other with the same values; on a busy machine their Python is",
        "slower than alone, the steps hardly are. The Jacobian by hand fills a dense matrix.",
        "",
    ]
    RESULTS.mkdir(exist_ok=True)
    if names:  # some parts are shown, all of them are kept
        print("\n".join(lines))
        return
    place = RESULTS / "targets.md"
    before = place.read_text(encoding="utf-8") if place.exists() else ""
    place.write_text("\n".join(lines) + before.partition(f"{lines[-2]}\n")[2], encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
