"""Duration of answers to an editor in a file of 2000 lines that imports another one: errors after a key press, completion, hover.

    python tests/benchmarks/bench_language_service.py [FOLDER]

writes `language_service.md` into FOLDER (this one). Times are medians of CPU time, warm; a key press is a character more, then one less.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1])]

from bondgraph.language_service.colours import marked_words  # noqa: E402
from bondgraph.language_service.completion import completion  # noqa: E402
from bondgraph.language_service.hover import hover  # noqa: E402
from bondgraph.language_service.workspace import Workspace, problems  # noqa: E402

ROUNDS = 31
PARTS = """model Damped {
  port end: translation
  parameter k: N/m = 100, r: N*s/m = 1
  C spring : F = k*x
  R damper : F = r*v
  end -> 1(spring, damper)
  output x = spring.x
}
"""
MODEL = """model Axle{n} {{
  "A mass on a damped spring, and the part of the import on it"
  parameter m = {n} kg, k: N/m = 1e3
  port road: translation
  0  tyre
  1  hub
  C  rubber : F = k*x
  I  mass   : p = m*v
  Damped strut {{ k = 200 [N/m] }}
  signal load = rubber.F
  road -> tyre -> rubber
  tyre -> hub -> mass
  hub -> strut.end
  output travel = strut.x, force = load
}}

"""
MAIN = """model Train {{
  input push = 1 N
  MSe pull : F = push
  1  body
{instances}
  pull -> body -> {ends}
  output first = axle1.travel
  experiment go {{ simulate 0 .. 1 s }}
}}
"""


def text_of(lines: int) -> str:
    """A file of so many lines: small models, and one that has an instance of every tenth."""
    count = (lines - 10) * 10 // (10 * MODEL.count("\n") + 1)
    used = range(1, count + 1, 10)
    instances = "\n".join(f"  Axle{n} axle{n}" for n in used)
    main = MAIN.format(instances=instances, ends=", ".join(f"axle{n}.road" for n in used))
    return 'import Damped from "parts.bg"\n\n' + "".join(MODEL.format(n=n) for n in range(1, count + 1)) + main


BESIDE = "No server of Modelica or Stan stands beside it: PyPI, npm and Debian have none (the Modelica compiler rumoca of PyPI comes without its server)."


def median(action: Callable[[int], object]) -> float:
    """Median CPU time in ms; the first two rounds warm up."""
    times = []
    for number in range(ROUNDS + 2):
        began = time.process_time()
        action(number)
        times.append(time.process_time() - began)
    return 1e3 * statistics.median(times[2:])


def main(folder: Path = HERE / "results") -> None:
    with tempfile.TemporaryDirectory() as work:
        (Path(work) / "parts.bg").write_text(PARTS, encoding="utf-8")
        path, text, workspace = Path(work) / "train.bg", text_of(2000), Workspace()
        middle = text.index("signal load", len(text) // 2)
        workspace.open(path, text)
        assert problems(workspace, path, True) == ([], True)
        rubber = text.index("rubber.F", middle)

        def press(number: int, complete: bool) -> None:
            workspace.open(path, text if number % 2 else f"{text[:rubber]}x{text[rubber:]}")
            assert bool(problems(workspace, path, complete)[0]) == (number % 2 == 0)

        rows = {
            "errors of the model, after a key press": median(lambda n: press(n, False)),
            "errors of all models and of the equations, after a key press": median(lambda n: press(n, True)),
        }
        dotted = rubber + len("rubber.")

        def completed(number: int) -> None:
            workspace.open(path, text if number % 2 else f"{text[:dotted]}F + {text[dotted:]}")
            assert "F" in [s.label for s in completion(workspace, path, dotted)]

        rows["completion, after a key press"] = median(completed)
        workspace.open(path, text)
        rows["completion"] = median(lambda n: completion(workspace, path, dotted))
        rows["hover"] = median(lambda n: hover(workspace, path, rubber + 2))
        rows["colours of the whole file"] = median(lambda n: list(marked_words(workspace, path)))
        head = f"| {text.count(chr(10))} lines, {len(text) // 1000} kB, one import | median |\n|---|---|\n"
    table = head + "".join(f"| {name} | {value:.1f} ms |\n" for name, value in rows.items()) + f"\n{BESIDE}\n"
    (folder / "language_service.md").write_text(table, encoding="utf-8")
    print(table)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
