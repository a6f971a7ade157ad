"""Work against precision of N four-bars in a row, through ten singular poses: this compiler, exudyn and pinocchio.

    python tests/benchmarks/bench_fourbars.py

writes results/fourbars.md and, with matplotlib, results/fourbars.png. `pip install bondgraph-lang[bench]` brings the other programs; one that is missing is told. Errors are relative,
the largest of x, y, vx and vy of the first corner after 10 s, where the row is one pendulum exactly. Times are medians of the run alone, without building the model.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import bondgraph
from bondgraph.simulation import phase

try:
    from tests.benchmarks.peers_fourbars import PinocchioRow, exudyn_run
except ModuleNotFoundError:  # run as a file
    import sys

    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    from tests.benchmarks.peers_fourbars import PinocchioRow, exudyn_run
from tests.published.test_closed_loops import PUBLISHED, pendulum

RESULTS = Path(__file__).parent / "results"
LOOPS = (2, 10, 40)
GOALS = (1e-4, 1e-8)
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
STEPS = {2: (1000, 4000, 16000, 64000), 10: (1000, 4000, 16000), 40: (1000, 4000, 16000)}
PROXIMAL = (1e-3, 1e-6)  # pinocchio's regularisation
STEPS_PROXIMAL = {2: (1000, 4000), 10: (1000, 4000), 40: (1000,)}
AGAIN, QUICK = 3, 1.0  # runs of which the median counts, where they take less than this, s
WORDS = (
    "Errors are relative, the largest of x, y, vx and vy of the first corner after 10 s, where the row is one pendulum exactly. Times are medians of the run "
    "alone, without building the model, on one core of a shared machine: ratios hold, not digits. exudyn with the settings of its own IFToMM example; pinocchio's "
    "constrained forward dynamics in a Runge-Kutta method of order 8 with projection. "
    "Its projection by numpy takes two thirds of its time at N = 2, a third at N = 40."
)
Point = tuple[str, float, float]  # what was set, error, s


def error(loops: int, found: Any) -> float:
    """Error of a state at the end; infinite if it has no finite values."""
    exact = pendulum(loops, [0.0, 10.0])[:, -1]
    worst = float(np.abs(np.asarray(found) / exact - 1).max())
    return worst if np.isfinite(worst) else float("inf")


def measured(loops: int, words: str, run: Callable[[], tuple[Any, float]]) -> Point | None:
    """One setting; None if the program gives up."""
    try:
        found, took = run()
        times = [took]
        while took < QUICK and len(times) < AGAIN:
            times.append(run()[1])
    except Exception as failed:
        print(f"{words}: {type(failed).__name__}")
        return None
    return words, error(loops, found), median(times)


def ours(loops: int, tolerance: float) -> tuple[Any, float]:
    """The run from where the mechanism is put together, the choice of magnitudes included."""
    model = bondgraph.load(PUBLISHED / "iftomm_A02_N_fourbar.bg")
    spent: list[float] = []
    original = phase.Phase.go

    def timed(self: phase.Phase) -> None:
        began = time.perf_counter()
        original(self)
        spent.append(time.perf_counter() - began)

    phase.Phase.go = timed  # type: ignore[method-assign]
    try:
        result = model.simulate(settings={"N": str(loops)}, rtol=tolerance, points=2)
    finally:
        phase.Phase.go = original  # type: ignore[method-assign]
    return [result.final(n) for n in ("x", "y", "vx", "vy")], sum(spent)


def curves(loops: int) -> dict[str, list[Point]]:
    """Settings that ran, for each program that is there."""
    found: dict[str, list[Point | None]] = {}
    found["bondgraph"] = [measured(loops, f"rtol {t:g}", lambda t=t: ours(loops, t)) for t in TOLERANCES]
    if importlib.util.find_spec("exudyn"):
        found["exudyn"] = [measured(loops, f"{s} steps", lambda s=s: exudyn_run(loops, s)) for s in STEPS[loops]]
    if importlib.util.find_spec("pinocchio"):
        row = PinocchioRow(loops)
        found["pinocchio"] = [
            measured(loops, f"{s} steps, mu {mu:g}", lambda s=s, mu=mu: row.run(s, mu))
            for mu in PROXIMAL
            for s in STEPS_PROXIMAL[loops]
        ]
    return {name: [p for p in points if p is not None] for name, points in found.items()}


def time_for(name: str, points: list[Point], goal: float) -> str:
    """The time of the first setting that reaches an error; exudyn's last one is carried on with the order of its method, 2."""
    reached = [t for _, e, t in points if e <= goal]
    if reached:
        return f"{min(reached):.3g} s"
    if name != "exudyn" or not points:
        return (
            "not reached"
            if name != "pinocchio"
            else "not reached: beyond singular poses errors scatter with steps and mu"
        )
    _, last, took = points[-1]
    return f"about {took * (last / goal) ** 0.5:.3g} s (carried on with order 2)"


def table(all_curves: dict[int, dict[str, list[Point]]]) -> str:
    lines = [
        "# N four-bars in a row, 10 s, ten singular poses", "", WORDS, "",
        "| N | program | error at most 1e-4 | error at most 1e-8 |", "| --- | --- | --- | --- |",
    ]  # fmt: skip
    for loops, found in all_curves.items():
        for name in ("bondgraph", "exudyn", "pinocchio"):
            cells = [time_for(name, found[name], g) for g in GOALS] if name in found else ["not installed"] * 2
            lines.append(f"| {loops} | {name} | {' | '.join(cells)} |")
    lines += ["", "| N | program | setting | error | time |", "| --- | --- | --- | --- | --- |"]
    for loops, found in all_curves.items():
        for name, points in found.items():
            lines += [f"| {loops} | {name} | {w} | {e:.1e} | {t:.3g} s |" for w, e, t in points]
    return "\n".join([*lines, ""])


def picture(all_curves: dict[int, dict[str, list[Point]]]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(all_curves), figsize=(12, 4), sharey=True)
    for axis, (loops, found) in zip(axes, all_curves.items(), strict=True):
        for name, points in found.items():
            axis.loglog(
                [e for _, e, _ in points], [t for *_, t in points], "o" if name == "pinocchio" else "o-", label=name
            )
        axis.set(title=f"N = {loops}", xlabel="relative error after 10 s")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time of the run, s")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(RESULTS / "fourbars.png", dpi=110)


def main() -> None:
    ours(2, 1e-4)
    found = {loops: curves(loops) for loops in LOOPS}
    text = table(found)
    (RESULTS / "fourbars.md").write_text(text)
    print(text)
    if importlib.util.find_spec("matplotlib"):
        picture(found)


if __name__ == "__main__":
    main()
