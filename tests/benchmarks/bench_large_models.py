"""Large models from text to result, and their solving beside CVODE with KLU on equations written by hand in C.

    python tests/benchmarks/bench_large_models.py [--quick | --stages]

`--stages`: only time and memory of each stage of the compiler against the number of sections, into results/large_model_stages.md; some 6 GB. `--quick`: up to 3000 sections, without the largest networks; the table says so. It writes results/large_models.md and, with matplotlib, results/large_models.png. Times are CPU times (the machine may be shared), medians
of three, but of what takes long. The peer needs a C compiler and Debian's libsundials-dev and libsuitesparse-dev; without them its columns stay empty.
"""

from __future__ import annotations

import gc
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT)]

import bondgraph  # noqa: E402
from bondgraph.errors import RunFailed  # noqa: E402
from bondgraph.simulation import phase  # noqa: E402
from bondgraph.simulation.integrators.compiled import run as compiled  # noqa: E402
from tests.benchmarks import large_models  # noqa: E402

RESULTS = HERE / "results"
SECTIONS = (300, 1000, 3000, 10_000)
LADDERS: dict[str, Callable[[int], str]] = {
    "RC ladder, flat": large_models.rc_ladder, "RC ladder, array": large_models.rc_ladder_array, "LC ladder, flat": large_models.lc_ladder,
}  # fmt: skip
STAGED: dict[str, tuple[int, ...]] = {"rc_ladder_array": (1000, 10_000, 100_000), "rc_ladder": (1000, 10_000, 25_000)}
TIMES = 3
OURS, THEIRS = (1e-3, 1e-4, 1e-5, 1e-6), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
QUICK = ("ladder of 1000", "mesh 60 x 60", "star of 2000")
REFERENCE = 1e-11  # of the peer; ours at 1e-9 where there is none
LONG = 5.0  # s, after which nothing is run once more
ERROR = 1e-5  # at which times are compared
END, INSTANTS = 1e-3, 501
LIBRARIES = "-lsundials_cvode -lsundials_sunlinsolklu -lsundials_sunmatrixsparse -lsundials_nvecserial -lklu -lm"


@dataclass(frozen=True)
class Network:
    """Nodes and edges (ends and ohms); node 1 is fed, `first` and the last node are reported."""

    name: str
    text: str
    nodes: int
    edges: list[tuple[int, int, float]]
    first: int


def networks() -> list[Network]:
    found = []
    for count in (1000, 10_000):
        edges = [(i, i + 1, 10.0) for i in range(1, count)]
        found.append(Network(f"ladder of {count}", large_models.rc_ladder_array(count), count, edges, 1 + count // 10))
    for name, edges_of, count in (
        ("mesh 60 x 60", large_models.mesh_edges(60), 3600),
        ("star of 2000", large_models.star_edges(2000), 2001),
        ("random, 5000", large_models.random_edges(5000, 2500), 5000),
    ):
        ohms = [(a, b, 10.0 + k % 7) for k, (a, b) in enumerate(edges_of, 1)]
        found.append(Network(name, large_models.network(edges_of, count), count, ohms, 2))
    return found


# ---------------------------------------------------------------- from text to result


def process(text: str, folder: Path) -> tuple[float, float]:
    """CPU and elapsed seconds of `bondgraph run` on a text that was never seen before; of the code itself Python keeps what it compiled."""
    path = folder / "model.bg"
    path.write_text(f"# {time.time_ns()}\n{text}", encoding="utf-8")
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "bondgraph", "run", str(path)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True, env=environment)
    after, took = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, took


def medians(text: str, folder: Path, times: int) -> tuple[float, float]:
    both: list[tuple[float, float]] = []
    while len(both) < times and sum(b[0] for b in both) < LONG:
        both.append(process(text, folder))
    return statistics.median(b[0] for b in both), statistics.median(b[1] for b in both)


def exponent(sizes: tuple[int, ...], times: list[float]) -> float:
    """The slope of a straight line through the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def stages(kind: str, sections: int) -> dict[str, tuple[float, float]]:
    """CPU seconds and peak memory in MB of each stage of the compiler, and in all."""
    command = [sys.executable, str(HERE / "large_model_stages.py"), kind, str(sections)]
    done = subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True)
    rows = [line.split() for line in done.stdout.splitlines()]
    found = {name: (float(took), float(peak)) for name, took, peak in rows}
    return found | {"in all": (sum(took for took, _ in found.values()), max(peak for _, peak in found.values()))}


def staged() -> str:
    """Tables of the stages, with the exponent of their time between the two largest models."""
    lines = [
        "# Large models, stage by stage", "",
        f"`bench_large_models.py --stages`; CPU time, and peak memory of the process up to the end of the stage, on {os.cpu_count()} cores that others used too "
        f"(load {os.getloadavg()[2]:.1f}). A section of a ladder is 8 parts as an array (instance, quantity, three elements, junction, a round of two loops), 4 as flat text.",
    ]  # fmt: skip
    for kind, sizes in STAGED.items():
        columns = [stages(kind, n) for n in sizes]
        head = " | ".join(f"{n} sections" for n in sizes)
        lines += ["", f"| {kind.replace('_', ' ')} | {head} | exponent |", "|---" * (len(sizes) + 2) + "|"]
        for name in columns[0]:
            times = [column[name][0] for column in columns]
            cells = " | ".join(f"{column[name][0]:.2f} s, {column[name][1]:.0f} MB" for column in columns)
            lines.append(f"| {name} | {cells} | {exponent(sizes[-2:], times[-2:]):.2f} |")
    return "\n".join(lines) + "\n"


# ---------------------------------------------------------------- solving alone


class Clock:
    """CPU time of a run after its program is there, of its steps alone, and of finding orders; the fill of the factors."""

    def __init__(self) -> None:
        self.whole = self.stepping = self.ordering = 0.0
        self.fill = 0
        for owner, name, word in (
            (phase.Phase, "__init__", "whole"), (phase.Phase, "go", "whole"), (compiled.CompiledMethod, "advance", "stepping"),
        ):  # fmt: skip
            self._time(owner, name, word)
        choose = compiled.Ordered.choose

        def filled(order: Any, *given: Any) -> bool:
            began = time.process_time()
            done = choose(order, *given)
            self.ordering += time.process_time() - began
            self.fill = sum(len(order.values[n]) for n in ("l_row", "u_row")) + order.values["n"]
            return done

        compiled.Ordered.choose = filled  # type: ignore[method-assign]

    def _time(self, owner: Any, name: str, word: str) -> None:
        original = getattr(owner, name)

        def timed(*given: Any, **named: Any) -> Any:
            began = time.process_time()
            try:
                return original(*given, **named)
            finally:
                setattr(self, word, getattr(self, word) + time.process_time() - began)

        setattr(owner, name, timed)


@dataclass(frozen=True)
class Solved:
    values: Any  # (instants, 2)
    whole: float
    stepping: float
    steps: int
    factorisations: int
    fill: int


def ours(model: bondgraph.Model, clock: Clock, rtol: float, times: int) -> Solved:
    found: list[tuple[float, float]] = []
    while len(found) < times and sum(f[0] for f in found) < LONG:
        clock.whole = clock.stepping = 0.0
        result = model.simulate(rtol=rtol, target="native")
        found.append((clock.whole, clock.stepping))
    values = np.array([result["first"], result["last"]]).T
    whole, stepping = (statistics.median(f[i] for f in found) for i in (0, 1))
    return Solved(values, whole, stepping, result.steps, result.evaluations.get("factorisation", 0), clock.fill)


def peer(folder: Path) -> Path | None:
    """The peer's program, if it can be made here."""
    program = folder / "peer"
    command = f"gcc -O2 -march=native -I/usr/include/suitesparse {HERE / 'peer_networks.c'} -o {program} {LIBRARIES}"
    try:
        done = subprocess.run(command.split(), capture_output=True, check=False)
    except OSError:
        return None
    return program if done.returncode == 0 else None


def theirs(program: Path, network: Network, rtol: float) -> Solved:
    lines = [f"{rtol} {END} {INSTANTS} {network.nodes} {len(network.edges)}"]
    lines += [f"{a} {b} {ohm}" for a, b, ohm in network.edges]
    lines += [f"{network.first} {network.nodes}", *(large_models.start(i) for i in range(1, network.nodes + 1))]
    found: list[list[str]] = []
    while len(found) < TIMES and sum(float(f[0]) for f in found) < LONG:
        done = subprocess.run([str(program)], input="\n".join(lines), text=True, capture_output=True, check=True)
        head, *rows = done.stdout.splitlines()
        found.append(head.split())
    took = statistics.median(float(f[0]) for f in found)
    values = np.array([list(map(float, row.split())) for row in rows])
    return Solved(values, took, took, int(found[0][1]), int(found[0][3]), int(found[0][4]))


def error(solved: Solved, reference: Any) -> float:
    return float(np.abs(solved.values - reference).max() / np.abs(reference).max())


def at_equal_error(points: list[tuple[float, float]]) -> float:
    """The time at `ERROR`, from the line through the logarithms of (error, time) next to it; not a number outside of them."""
    rising = sorted(points)
    for (e1, t1), (e2, t2) in pairwise(rising):
        if e1 <= ERROR <= e2 and e1 < e2:
            share = math.log(ERROR / e1) / math.log(e2 / e1)
            return math.exp((1 - share) * math.log(t1) + share * math.log(t2))
    return math.nan


def compare(network: Network, clock: Clock, program: Path | None, folder: Path, times: int) -> dict[str, Any]:
    path = folder / "network.bg"
    path.write_text(network.text, encoding="utf-8")
    model = bondgraph.load(path)
    clock.ordering = 0.0
    model.simulate(target="native")
    ordering = clock.ordering
    gc.freeze()  # as the command line does: what the compiler made is not walked through while a run is timed
    reference = (ours(model, clock, 1e-9, times) if program is None else theirs(program, network, REFERENCE)).values
    here, failed = [], []
    for rtol in OURS:
        try:
            here.append((rtol, ours(model, clock, rtol, times)))
        except RunFailed as problem:
            failed.append(f"{network.name} at rtol {rtol:g}: {problem}")
    usual = dict(here)[1e-6]
    row: dict[str, Any] = {
        "name": network.name, "states": network.nodes, "failed": failed, "usual": usual, "error": error(usual, reference), "ordering": ordering,
        "stepping": at_equal_error([(error(s, reference), s.stepping) for _, s in here]),
        "whole": at_equal_error([(error(s, reference), s.whole) for _, s in here]),
        "ours": [(error(s, reference), s.stepping) for _, s in here],
    }  # fmt: skip
    if program is not None:
        there = [theirs(program, network, rtol) for rtol in THEIRS]
        row |= {
            "theirs": [(error(s, reference), s.whole) for s in there], "peer": there[THEIRS.index(1e-6)],
            "peer error": error(there[THEIRS.index(1e-6)], reference),
            "peer time": at_equal_error([(error(s, reference), s.whole) for s in there]),
        }  # fmt: skip
    return row


# ---------------------------------------------------------------- what is written


def main(quick: bool = False) -> None:
    RESULTS.mkdir(exist_ok=True)
    sections = SECTIONS[:3] if quick else SECTIONS
    chosen = [network for network in networks() if not quick or network.name in QUICK]
    times = TIMES  # a first run may have to tidy up after the compiler
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        process(
            large_models.rc_ladder_array(120), folder
        )  # the kernels of stepping and Python's own code are there from now on
        clock, program = Clock(), peer(folder)
        rows = []
        for network in chosen:
            rows.append(compare(network, clock, program, folder, times))
            gc.unfreeze()
            gc.collect()
        growth = {name: [medians(make(n), folder, times) for n in sections] for name, make in LADDERS.items()}
        wholes = {network.name: medians(network.text, folder, times) for network in chosen}
    text = table(sections, growth, wholes, rows, quick)
    (RESULTS / "large_models.md").write_text(text, encoding="utf-8")
    print(text)
    draw(sections, growth, rows)


def table(sections: tuple[int, ...], growth: dict[str, list[tuple[float, float]]], wholes: dict[str, tuple[float, float]], rows: list[dict[str, Any]], quick: bool) -> str:  # fmt: skip
    lines = [
        "# Large models", "",
        f"`bench_large_models.py`; CPU times (elapsed in brackets), medians of {TIMES} (one of what takes longer than {LONG:g} s){', `--quick`' if quick else ''}, on {os.cpu_count()} cores that others used too "
        f"(load {os.getloadavg()[2]:.1f}).", "",
        "## From text to result", "",
        "The whole process `bondgraph run`, on a text never seen before (our own code has run before): 1 ms of a ladder whose capacitors leak as the cube, 501 instants. "
        "The exponent is that of CPU time from 1000 sections on.", "",
        "| sections | " + " | ".join(f"{n}" for n in sections) + " | exponent |", "|---" * (len(sections) + 2) + "|",
    ]  # fmt: skip
    for name, times in growth.items():
        cells = " | ".join(f"{cpu:.2f} s ({wall:.2f})" for cpu, wall in times)
        lines.append(f"| {name} | {cells} | {exponent(sections[1:], [t[0] for t in times[1:]]):.2f} |")
    lines += [
        "", "## Solving alone", "",
        "Our steps are Radau IIA 5 with sparse factors, real and complex; `run` has the search for magnitudes and the reported values in it. "
        "Runs go on with the order of the factors that the first run of a program found in `order, s`; the peer finds its own each time. "
        f"The peer is CVODE (BDF) with KLU over C by hand. Errors are those of two voltages at 501 instants; times at error {ERROR:g} come "
        "from the curve.", "",
        "| network | states | text to result | order, s | steps | fill | error at 1e-6 | steps, s | run, s | peer: steps | fill | error at 1e-6 | s | "
        f"at error {ERROR:g}: steps, s | run, s | peer, s | steps / peer | run / peer |",
        "|---" * 18 + "|",
    ]  # fmt: skip
    for row in rows:
        usual, other = row["usual"], row.get("peer")
        cpu, wall = wholes[row["name"]]
        told = (
            ["-"] * 4
            if other is None
            else [str(other.steps), str(other.fill), f"{row['peer error']:.1e}", f"{other.whole:.3f}"]
        )
        peer_time = row.get("peer time", math.nan)
        equal = [row["stepping"], row["whole"], peer_time]
        ratios = [row["stepping"] / peer_time, row["whole"] / peer_time]
        cells = [
            row["name"], str(row["states"]), f"{cpu:.2f} s ({wall:.2f})", f"{row['ordering']:.3f}", str(usual.steps), str(usual.fill), f"{row['error']:.1e}",
            f"{usual.stepping:.3f}", f"{usual.whole:.3f}", *told, *(_number(t, ".3f") for t in equal), *(_number(r, ".2f") for r in ratios),
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        f"Errors are measured from the peer at rtol {REFERENCE:g}. Fill: nonzeros of L and U; the peer counts the diagonal twice.",
        "",
    ]
    lines += [f"Failed: {failed}." for row in rows for failed in row["failed"]]
    lost = [row["name"] for row in rows if row["stepping"] > row.get("peer time", math.inf)]
    if lost:
        lines.append(f"Where the peer is faster at equal error: {', '.join(lost)}.")
    return "\n".join(lines) + "\n"


def _number(value: float, how: str) -> str:
    return "-" if math.isnan(value) else format(value, how)


def draw(sections: tuple[int, ...], growth: dict[str, list[tuple[float, float]]], rows: list[dict[str, Any]]) -> None:
    try:
        import matplotlib
    except ImportError:
        print("no picture: matplotlib is missing")
        return
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for name, times in growth.items():
        left.loglog(sections, [t[0] for t in times], marker="o", label=name)
    left.set_xlabel("sections")
    left.set_ylabel("CPU time from text to result, s")
    for number, row in enumerate(rows):
        for word, style in (("ours", "o-"), ("theirs", "x--")):
            if word in row:
                points = sorted(row[word])
                label = f"{row['name']}{'' if word == 'ours' else ', CVODE + KLU'}"
                right.loglog([p[0] for p in points], [p[1] for p in points], style, color=f"C{number}", label=label)
    right.set_xlabel("error")
    right.set_ylabel("CPU time of solving, s")
    for axes in (left, right):
        axes.grid(True, which="both", linewidth=0.4)
        axes.legend(frameon=False, fontsize=7)
    figure.savefig(RESULTS / "large_models.png", dpi=120)


if __name__ == "__main__":
    if "--stages" in sys.argv[1:]:
        (RESULTS / "large_model_stages.md").write_text(staged(), encoding="utf-8")
    else:
        main("--quick" in sys.argv[1:])
