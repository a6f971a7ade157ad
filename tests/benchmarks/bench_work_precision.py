"""Run time against error: this compiler beside other programs over the same equations.

    python -m tests.benchmarks work_precision [SCENE …]

writes results/work_precision.md and pictures. Errors are the largest |y - y_ref| over the outputs and 201 equally spaced instants, divided by the
largest magnitude of that kind of quantity (lengths together, angles together) in the reference. Times are processor times of one thread (others may use the
machine), medians of several runs; those at equal error are read from the curve between the tolerances, runs that got stuck included.
"""

from __future__ import annotations

import importlib.util
import json
import math
import multiprocessing
import queue
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from bondgraph.simulation.integrators.compiled import run as compiled
from tests.benchmarks import ngspice, peers, rumoca
from tests.benchmarks.peers import Done
from tests.benchmarks.scenes import POINTS, SCENES, Scene

RESULTS = Path(__file__).parent / "results"
AGAIN, QUICK = 7, 0.4  # runs in a row, as long as together they take less, s
ROUNDS = 3  # through all tolerances: what disturbs the machine for a moment must not be all that the median is of
LAP = 15.0  # s for our curves, up to which they are measured anew after each peer
PATIENCE = 90.0  # s for a whole curve of a peer
OURS, WHOLE = "bondgraph: steps", "bondgraph: whole run"
NAMED = "bondgraph: steps, Rodas5P"  # by name, beside Radau
STUCK = "given up"
DATA = RESULTS / "work_precision.json"  # all points; a run of some scenes replaces theirs
TOLD = (
    "SUNDIALS is CVODE (IDA for M y' = f), backward differentiation, dense, over equations in C written by hand (`hand/`), and like the others it is given "
    "magnitudes; in brackets how often as long as our steps. A whole run of ours finds magnitudes, breakpoints and the start besides, and evaluates the outputs: "
    "some milliseconds of Python whatever the run, which short runs of solvers in C do not have."
)


class Point(NamedTuple):
    setting: str
    error: float  # infinite where the run was given up
    seconds: float
    note: str = ""


Curve = list[Point]


class Reference(NamedTuple):
    """Reference solution: the states at the instants, their groups, and magnitudes of all states that peers integrate."""

    values: Any
    kinds: tuple[tuple[int, ...], ...]
    magnitude: Any

    def error(self, found: Any) -> float:
        if found is None or not np.isfinite(found).all():
            return math.inf
        worst = 0.0
        for kind in self.kinds:
            columns = list(kind)
            off = np.abs(found[:, columns] - self.values[:, columns]).max()
            worst = max(worst, float(off / np.abs(self.values[:, columns]).max()))
        return worst


def reference(scene: Scene) -> Reference:
    """By the closed form where there is one; else by a run of ours at a tolerance of 1e-12, to which all peers converge."""
    tight = 1e-12 if scene.exact is None else 1e-4
    result = scene.load().simulate(to=scene.stop, points=POINTS, rtol=tight, settings=scene.settings)
    values = (
        np.stack([result[n] for n in scene.states], axis=-1) if scene.exact is None else scene.exact(scene.instants)
    )
    units = [n if scene.apart else result.unit(n) for n in scene.states]
    kinds = tuple(
        tuple(i for i in scene.counted if units[i] == u) for u in dict.fromkeys(units[i] for i in scene.counted)
    )
    magnitude = np.abs(values).max(axis=0)
    if len(scene.start) == 2 * len(scene.states):  # speeds beside what they are of, which is unlike from state to state
        grid = np.gradient(values, scene.instants, axis=0)
        magnitude = np.concatenate([magnitude, np.abs(grid).max(axis=0)])
    for kind in kinds:  # none of a kind is held to less than a hundredth of the largest
        for part in (0, len(scene.states)) if len(magnitude) > len(scene.states) else (0,):
            columns = [part + k for k in kind]
            magnitude[columns] = np.maximum(magnitude[columns], 1e-2 * magnitude[columns].max())
    return Reference(values, kinds, magnitude)


class Clock:
    """Sum of the time inside of machine code that steps, for every method that the product may choose; in `exact`, of the marches of exponentials."""

    def __init__(self, exact: ModuleType | None = None) -> None:
        self.total = 0.0
        if exact is not None:
            self._watch(exact, "march")
        for name in dir(compiled):
            kind = getattr(compiled, name)
            if isinstance(kind, type) and kind.__module__ == compiled.__name__ and "advance" in vars(kind):
                self._watch(kind, "advance")

    def _watch(self, owner: Any, name: str) -> None:
        original = getattr(owner, name)

        def timed(*arguments: Any) -> Any:
            began = time.thread_time()
            try:
                return original(*arguments)
            finally:
                self.total += time.thread_time() - began

        setattr(owner, name, timed)


def ours(scene: Scene, tolerances: Sequence[float], right: Reference, clock: Clock) -> dict[str, Curve]:
    """The steps alone (peers are given magnitudes and machine code, too), and all that a run does besides once its program is there."""
    steps, whole = run_at(scene, tolerances, right, clock)
    curves = {OURS: steps, WHOLE: whole}
    if any("Radau" in point.note for point in steps):
        curves[NAMED], _ = run_at(scene, tolerances, right, clock, "rodas")
    return curves


def run_at(
    scene: Scene, tolerances: Sequence[float], right: Reference, clock: Clock, solver: str | None = None
) -> tuple[Curve, Curve]:
    """Time of the steps alone, if they are machine code, and of whole runs."""
    model = scene.load()
    alone: dict[float, Point] = {}
    all_of_it: dict[float, Point] = {}
    steps: dict[float, list[float]] = {}
    solvers: dict[float, str] = {}

    def run(rtol: float) -> Done:
        clock.total = 0.0
        began = time.thread_time()
        found = model.simulate(to=scene.stop, points=POINTS, rtol=rtol, settings=scene.settings, solver=solver)
        seconds = time.thread_time() - began
        steps.setdefault(rtol, []).append(clock.total)
        solvers[rtol] = found.solver
        return Done(np.stack([found[n] for n in scene.states], axis=-1), seconds, found.steps)

    for rtol, done, whole in in_rounds(run, tolerances):
        error, note = right.error(done.values), f"{done.steps} steps, {solvers[rtol]}"
        if any(steps[rtol]):
            alone[rtol] = Point(f"rtol {rtol:g}", error, statistics.median(steps[rtol]), note)
        all_of_it[rtol] = Point(f"rtol {rtol:g}", error, whole, note)
    return list(alone.values()), list(all_of_it.values())


def in_rounds(run: Callable[[float], Done], tolerances: Sequence[float]) -> Iterator[tuple[float, Done, float]]:
    """Runs at each tolerance, round after round: the result of the last of them, and the median of all their times so far."""
    taken: dict[float, list[float]] = {rtol: [] for rtol in tolerances}
    for _ in range(ROUNDS):
        for rtol, seconds in taken.items():
            if sum(seconds) >= QUICK:
                continue
            began = len(seconds)
            while len(seconds) == began or (len(seconds) < began + AGAIN and sum(seconds) < QUICK):
                done = run(rtol)
                seconds.append(done.seconds)
            yield rtol, done, statistics.median(seconds)


def curve(make: Callable[[], Any], tolerances: Sequence[float], right: Reference, tell: Any) -> None:
    """Points of a peer, sent one by one, and again as its median gets more certain; in a process of its own, as it may crash or never end."""
    try:
        run = make()
        if run is None:
            tell.put("none")
            return
        for rtol, done, seconds in in_rounds(run, tolerances):
            note = f"{done.steps} steps" if done.steps else ""
            error = right.error(done.values)
            tell.put(Point(f"rtol {rtol:g}", error, seconds, note if error < math.inf else STUCK))
    except Exception as failed:
        tell.put(f"{type(failed).__name__}: {' '.join(str(failed).split())[:120]}")
    tell.put(None)


def in_process(make: Callable[[], Any], tolerances: Sequence[float], right: Reference) -> tuple[Curve, str]:
    """Curve of a peer, and a word if there is none, or if it ended early."""
    context = multiprocessing.get_context("fork")
    tell = context.Queue()
    child = context.Process(target=curve, args=(make, tolerances, right, tell))
    child.start()
    found: dict[str, Point] = {}
    word, until = "", time.monotonic() + PATIENCE
    while True:
        try:
            item = tell.get(timeout=0.2)
        except queue.Empty:
            if time.monotonic() > until or not child.is_alive():
                word = word or (f"stopped after {PATIENCE:g} s" if child.is_alive() else "its process died")
                break
            continue
        if item is None or item == "none":
            break
        if isinstance(item, str):
            word = item
        else:
            found[item.setting] = item
    child.terminate()
    child.join()
    return list(found.values()), word


PEERS: dict[str, Callable[[Scene, Any], Any]] = {
    "SUNDIALS, order 2": lambda scene, magnitude: peers.sundials(scene, magnitude, 2),
    "SUNDIALS, order 5": lambda scene, magnitude: peers.sundials(scene, magnitude, 5),
    "scipy Radau + lambdify": peers.scipy_radau,
    "casadi": peers.casadi_cvodes,
    "diffsol BDF": lambda scene, magnitude: peers.diffsol(scene, magnitude, "bdf"),
    "diffsol TR-BDF2": lambda scene, magnitude: peers.diffsol(scene, magnitude, "tr_bdf2"),
    "diffsol ESDIRK34": lambda scene, magnitude: peers.diffsol(scene, magnitude, "esdirk34"),
    "rumoca": rumoca.run,
    "ngspice": ngspice.run,
}
PACKAGES = {"SUNDIALS": "sksundae", "casadi": "casadi", "diffsol": "pydiffsol", "rumoca": "rumoca"}
NO_JOB = {
    "casadi": "wants a semi-explicit form",
    "scipy Radau + lambdify": "takes no M y' = f",
    "ngspice": "circuits only",
}


def measured(scene: Scene, wanted: Sequence[str] = tuple(PEERS)) -> tuple[dict[str, Curve], dict[str, str]]:
    """All curves of a scene, and a word for each program that has none or an unfinished one."""
    right = reference(scene)
    clock, began = Clock(), time.monotonic()
    laps = [ours(scene, scene.tolerances, right, clock)]
    is_short = time.monotonic() - began < LAP
    found: dict[str, Curve] = {}
    words: dict[str, str] = {}
    for name, make in PEERS.items():
        if name not in wanted:
            continue
        package = next((p for word, p in PACKAGES.items() if name.startswith(word)), None)
        if (package is not None and not peers.there(package)) or (name == "ngspice" and not ngspice.there()):
            words[name] = "not installed"
            continue
        if name in scene.slow:
            words[name] = "left out: hours"
            continue
        points, word = in_process(lambda make=make: make(scene, right.magnitude), scene.tolerances, right)  # type: ignore[misc]
        if points:
            found[name] = points
        if word or not points:
            nothing = "no equations by hand for it" if not scene.hand else NO_JOB.get(name, "does not take this")
            words[name] = word or nothing
        print(f"{scene.name}: {name}: {len(points)} points {words.get(name, '')}", file=sys.stderr, flush=True)
        if is_short:
            laps.append(ours(scene, scene.tolerances, right, clock))
    own = {name: in_the_mean([lap[name] for lap in laps]) for name, points in laps[0].items() if points}
    return own | found, words


def in_the_mean(laps: Sequence[Curve]) -> Curve:
    """A curve that was measured before and after each peer, if it is short: the machine is not the same over minutes."""
    times = ([point.seconds for point in points] for points in zip(*laps, strict=True))
    return [point._replace(seconds=statistics.mean(t)) for point, t in zip(laps[0], times, strict=True)]


def time_at(points: Curve, goal: float) -> float | None:
    """Seconds at an error, read off between two tolerances that enclose it; from loose to tight, as a user goes. None if it is not reached."""
    previous: Point | None = None
    for point in points:
        if point.error <= goal:
            if previous is None:
                return point.seconds
            low = max(point.error, 1e-300)
            if not math.isfinite(previous.error) or previous.error <= low:
                return point.seconds
            share = math.log(previous.error / goal) / math.log(previous.error / low)
            return math.exp((1 - share) * math.log(previous.seconds) + share * math.log(point.seconds))
        previous = point
    return None


def shown(seconds: float | None) -> str:
    if seconds is None:
        return "not reached"
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"


def table(scene: Scene, found: dict[str, Curve], words: dict[str, str]) -> list[str]:
    """Times at equal error, how often as long as ours, and all points."""
    lines = [
        f"## {scene.title}",
        "",
        "| program | " + " | ".join(f"at {g:.0e}" for g in scene.goals) + " | |",
        "|---" * (len(scene.goals) + 2) + "|",
    ]
    base = found.get(OURS, found.get(WHOLE, []))
    for name in (*found, *(n for n in words if n not in found)):
        cells = []
        for goal in scene.goals:
            mine, theirs = time_at(base, goal), time_at(found.get(name, []), goal)
            ratio = f" ({theirs / mine:.2g})" if theirs and mine and name not in (OURS, WHOLE) else ""
            cells.append(shown(theirs) + ratio if name in found else "-")
        lines.append(f"| {name} | {' | '.join(cells)} | {words.get(name, '')} |")
    lines += [
        "",
        "<details><summary>all runs</summary>",
        "",
        "| program | setting | error | time | |",
        "|---|---|---|---|---|",
    ]
    for name, points in found.items():
        lines += [
            f"| {name} | {p.setting} | {'' if math.isinf(p.error) else f'{p.error:.1e}'} | {shown(p.seconds)} | {p.note} |"
            for p in points
        ]
    return [*lines, "", "</details>", ""]


def losses(scene: Scene, found: dict[str, Curve], own: str) -> list[str]:
    """Cases where a peer is faster than our steps, or than a whole run of ours."""
    base = found.get(own, found.get(WHOLE, []))
    told = []
    for name, points in found.items():
        if name in (OURS, WHOLE, NAMED):
            continue
        for goal in scene.goals:
            mine, theirs = time_at(base, goal), time_at(points, goal)
            if theirs is not None and mine is None:
                told.append(f"{scene.title}: {name} comes to {goal:.0e}, ours does not")
            elif theirs is not None and mine is not None and theirs < mine:
                told.append(f"{scene.title}, error {goal:.0e}: {name} takes {theirs / mine:.2g} of our time")
    return told


def picture(scene: Scene, found: dict[str, Curve]) -> None:
    """Time against error, both on logarithmic axes; runs that were given up at the right edge."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.6, 4.6))
    for name, points in found.items():
        kept = [p for p in points if math.isfinite(p.error)]
        style = "o-" if name == OURS else "o--" if name == WHOLE else "s:" if len(kept) > 1 else "s"
        axes.loglog(
            [max(p.error, 1e-17) for p in kept], [p.seconds * 1e3 for p in kept], style, label=name, markersize=4
        )
    axes.set(xlabel="error", ylabel="processor time, ms", title=scene.title)
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(RESULTS / f"work_precision_{scene.name}.png", dpi=110)
    pyplot.close(figure)


Kept = dict[str, tuple[dict[str, Curve], dict[str, str]]]


def kept() -> Kept:
    """Earlier measurements, scene by scene."""
    if not DATA.is_file():
        return {}
    told = json.loads(DATA.read_text(encoding="utf-8"))
    return {k: ({n: [Point(*p) for p in c] for n, c in v["curves"].items()}, v["words"]) for k, v in told.items()}


def keep(found: Kept) -> None:
    told = {k: {"curves": curves, "words": words} for k, (curves, words) in found.items()}
    DATA.write_text(json.dumps(told, indent=0) + "\n", encoding="utf-8")


def report(found: Kept) -> str:
    """All tables, those of losses first."""
    assert __doc__ is not None
    words = " ".join(__doc__.split("pictures. ")[1].split())
    lines = ["# Run time against error", "", f"`python -m tests.benchmarks work_precision`. {words}", "", TOLD, ""]
    scenes = [s for s in SCENES if s.name in found]
    for own, title in ((OURS, "Where our steps lose"), (WHOLE, "Where a whole run of ours loses")):
        lost = [x for s in scenes for x in losses(s, found[s.name][0], own)]
        lines += [f"## {title}", "", *([f"- {x}" for x in lost] or ["Nowhere in these."]), ""]
    for scene in scenes:
        lines += table(scene, *found[scene.name])
    return "\n".join(lines)


def main(names: Sequence[str] = ()) -> None:
    RESULTS.mkdir(exist_ok=True)
    found = kept()
    for scene in SCENES:
        if not names or scene.name in names:
            found[scene.name] = measured(scene)
            keep(found)
    for scene in SCENES:
        if scene.name in found and importlib.util.find_spec("matplotlib"):
            picture(scene, found[scene.name][0])
    text = report(found)
    (RESULTS / "work_precision.md").write_text(text, encoding="utf-8")
    print(text)
