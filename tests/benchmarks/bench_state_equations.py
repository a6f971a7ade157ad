"""From text to state equations: RC ladders and meshes, beside BondGraphTools where that is installed.

    python tests/benchmarks/bench_state_equations.py [--rival SECTIONS ...]

Writes state_equations.csv and state_equations.png into the folder where it is called. A rival's ladder of 80 sections takes minutes;
`pip install BondGraphTools` in the same environment puts it beside ours.
"""

from __future__ import annotations

import argparse
import csv
import math
import statistics
import time
from collections.abc import Callable
from importlib.util import find_spec

import bondgraph

LADDERS = (10, 20, 40, 80, 160, 320, 640, 1000)
MESHES = (5, 10, 15, 20, 30)


def ladder(sections: int) -> str:
    """A voltage source and RC sections in a row."""
    lines = ["model Ladder {", "  Se s : u = 1 V", "  0 k[0] : electric", "  s -> k[0]"]
    for i in range(1, sections + 1):
        lines.append(f"  R r[{i}] : u = {1 + 0.001 * i} ohm*i; C c[{i}] : q = {1 + 0.002 * i} F*u; 0 k[{i}] : electric")
        lines.append(f"  k[{i - 1}] -> 1(r[{i}]) -> k[{i}] -> c[{i}]")
    return "\n".join([*lines, f"  output y = c[{sections}].u", "}", ""])


def mesh(side: int) -> str:
    """A square of nodes with a capacitor each and a resistor to each neighbour."""
    lines = ["model Mesh {", "  Se s : u = 1 V", "  R source : u = 1 ohm*i"]
    for i in range(side):
        for j in range(side):
            lines.append(f"  C c[{i},{j}] : q = 1 F*u; 0 k[{i},{j}] : electric; k[{i},{j}] -> c[{i},{j}]")
            if i:
                lines.append(f"  R a[{i},{j}] : u = 1 ohm*i; k[{i - 1},{j}] -> 1(a[{i},{j}]) -> k[{i},{j}]")
            if j:
                lines.append(f"  R b[{i},{j}] : u = 1 ohm*i; k[{i},{j - 1}] -> 1(b[{i},{j}]) -> k[{i},{j}]")
    return "\n".join([*lines, "  s -> 1(source) -> k[0,0]", "  output y = c[0,0].u", "}", ""])


def ours(text: str) -> int:
    """State equations in sympy, from nothing but the text; their number."""
    return len(bondgraph.load(text).state_equations())


def rival(sections: int) -> int:
    """The same ladder in BondGraphTools, up to its relations."""
    import BondGraphTools as tools

    model = tools.new(name="ladder")
    source, before = tools.new("Se", value=1), tools.new("0")
    tools.add(model, source, before)
    tools.connect(source, before)
    for i in range(1, sections + 1):
        r, c = tools.new("R", value=1 + 0.001 * i), tools.new("C", value=1 + 0.002 * i)
        one, zero = tools.new("1"), tools.new("0")
        tools.add(model, r, c, one, zero)
        for tail, head in ((before, one), (one, r), (one, zero), (zero, c)):
            tools.connect(tail, head)
        before = zero
    return len(model.constitutive_relations)


def measured(function: Callable[[], object], runs: int = 3) -> float:
    """The median of the CPU times, s."""
    times = []
    for _ in range(runs):
        began = time.process_time()
        function()
        times.append(time.process_time() - began)
    return statistics.median(times)


def exponent(points: list[tuple[float, float]]) -> float:
    """The slope of log time over log size from the middle of the sizes on."""
    (a, s), (b, t) = points[len(points) // 2], points[-1]
    return math.log(t / s) / math.log(b / a)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rival", type=int, nargs="*", default=[5, 10, 20], help="sections for BondGraphTools")
    sizes = parser.parse_args().rival
    ours(ladder(5))  # sympy is imported
    rows: list[tuple[str, int, float]] = []
    for n in LADDERS:
        rows.append(("ladder", 4 * n + 2, measured(lambda n=n: ours(ladder(n)))))  # type: ignore[misc]
    for m in MESHES:
        rows.append(("mesh", m * m * 4, measured(lambda m=m: ours(mesh(m)))))  # type: ignore[misc]
    if find_spec("BondGraphTools"):
        for n in sizes:
            rows.append(("ladder, BondGraphTools", 4 * n + 2, measured(lambda n=n: rival(n), 1)))  # type: ignore[misc]
    with open("state_equations.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("graph", "elements", "seconds"), *rows])
    kinds = list(dict.fromkeys(r[0] for r in rows))
    for kind in kinds:
        points = [(float(n), t) for k, n, t in rows if k == kind]
        for n, t in points:
            print(f"{kind:24} {n:6.0f} elements {t:10.4f} s")
        if len(points) > 2:
            print(f"{kind:24} grows with the power {exponent(points):.2f}")
    known = {(k, n): t for k, n, t in rows}
    for (kind, n), t in known.items():
        if kind.endswith("Tools") and ("ladder", n) in known:
            print(f"at {n} elements {t / known['ladder', n]:.0f} times as fast as BondGraphTools")
    _draw(rows, kinds)


def _draw(rows: list[tuple[str, int, float]], kinds: list[str]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for kind in kinds:
        axes.loglog(*zip(*((n, t) for k, n, t in rows if k == kind), strict=True), "o-", label=kind)
    axes.set(xlabel="elements", ylabel="CPU time, s", title="From text to state equations")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig("state_equations.png", dpi=110)


if __name__ == "__main__":
    main()
