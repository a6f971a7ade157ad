"""Duration of `check`, parsing and `fmt` for files of up to a megabyte, and its growth: a table and a picture.

    python tests/benchmarks/bench_large_files.py [FOLDER]

writes `large_files.md` and `large_files.svg` into FOLDER (this one). Times are CPU times of the process, the least of three.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE)]

from large_files import KINDS  # noqa: E402

from compiler.api import Source, format_text  # noqa: E402
from compiler.syntax import parse  # noqa: E402

SIZES = (100_000, 250_000, 500_000, 1_000_000)
RUNS = 3


def least(action: Callable[[], object]) -> float:
    """The least CPU time of a few runs."""
    times = []
    for _ in range(RUNS):
        began = time.process_time()
        action()
        times.append(time.process_time() - began)
    return min(times)


def checked(path: Path) -> float:
    """CPU time of the whole process `bondgraph check`, imports and all."""
    code = (
        "import sys, time; from bondgraph.commands import commands; "
        "commands.main(['check', sys.argv[1]], standalone_mode=False); print(time.process_time())"
    )
    command = [sys.executable, "-c", code, str(path)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    outs = [
        subprocess.run(command, check=True, capture_output=True, text=True, cwd=HERE.parents[1], env=environment)
        for _ in range(RUNS)
    ]
    return min(float(o.stdout.split()[-1]) for o in outs)


def exponent(sizes: list[int], times: list[float]) -> float:
    """The slope of a straight line through the logarithms."""
    x, y = [math.log(s) for s in sizes], [math.log(t) for t in times]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    above = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True))
    return above / sum((a - mean_x) ** 2 for a in x)


def main(folder: Path) -> None:
    parse(Source("warm", "model A { 1 b }"))
    rows: dict[str, tuple[list[int], list[float]]] = {}
    with tempfile.TemporaryDirectory() as work:
        for kind, make in KINDS.items():
            for size in SIZES:
                source = Source(kind, make(size))
                path = Path(work) / f"{kind}_{size}.bg"
                path.write_text(source.text, encoding="utf-8")
                for what, took in (
                    ("parse", least(lambda source=source: parse(source))),  # type: ignore[misc]
                    ("check", checked(path)),
                    ("fmt", least(lambda source=source: format_text(source))),  # type: ignore[misc]
                ):
                    sizes, times = rows.setdefault(f"{what} {kind}", ([], []))
                    sizes.append(len(source.text))
                    times.append(took)
    write(folder, rows)


def write(folder: Path, rows: dict[str, tuple[list[int], list[float]]]) -> None:
    head = "| | " + " | ".join(f"{s // 1000} kB" for s in SIZES) + " | exponent |\n"
    table = head + "|---" * (len(SIZES) + 2) + "|\n"
    for name, (sizes, times) in rows.items():
        table += f"| {name} | " + " | ".join(f"{t:.2f} s" for t in times) + f" | {exponent(sizes, times):.2f} |\n"
    (folder / "large_files.md").write_text(table, encoding="utf-8")
    print(table)
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "bondgraph"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for name, (sizes, times) in rows.items():
        axes.loglog([s / 1e6 for s in sizes], times, marker="o", label=name)
    axes.set_xlabel("size of the file in MB")
    axes.set_ylabel("CPU time in s")
    axes.grid(True, which="both", linewidth=0.4)
    axes.legend(frameon=False)
    figure.savefig(folder / "large_files.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
