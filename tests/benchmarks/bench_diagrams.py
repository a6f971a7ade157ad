"""Diagrams measured: bends, crossings and length of all lines, names beside strokes, width, and equal instances drawn alike.

    python tests/benchmarks/bench_diagrams.py [FOLDER]

writes `diagrams.md` into FOLDER (results/). Every model here is drawn with its instances open and as boxes, and so are long chains. Lengths are
in px of the SVG, read back from it.
"""

from __future__ import annotations

import math
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import combinations, pairwise
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1])]

import bondgraph  # noqa: E402
from bondgraph.model import Model  # noqa: E402
from bondgraph.presentation.diagram import svg_text  # noqa: E402
from bondgraph.presentation.diagram.diagram_model import diagram_model_of  # noqa: E402
from tests.diagram.reading import Point, Read, cross, overlap, read  # noqa: E402

MODELS = HERE.parents[1] / "models"
PAGE = 1000.0  # px: wider pictures are small print on a page
NEAR = 3.0  # px between a name and a stroke that read as one
SECTIONS = """model Ladder {
  "Twelve sections, each a model."
  0  node[0] : electric
  Se source : u = 1 V*sin(time*1 [1/s])
  source -> node[0]
  for i in 1..12 {
    Section section[i]
    0 node[i] : electric
    node[i-1] -> section[i].near
    section[i].far -> node[i]
  }
  output u_end = section[12].store.u
}
model Section {
  port near, far : electric
  R loss  : u = 10 ohm*f
  C store : q = 1e-6 [F]*u
  0 middle
  near -> 1(loss) -> middle -> store
  middle -> far
}
"""
MASSES = """model Masses {
  "Twelve masses in a row, with springs and dampers between them."
  Se push : F = 1 N
  for i in 1..12 {
    1 at[i]   : translation
    I mass[i] : p = 1 kg*v
    at[i] -> mass[i]
  }
  push -> at[1]
  for i in 1..11 {
    C spring[i] : F = 10 [N/m]*x
    R damper[i] : F = 1 [N*s/m]*v
    0 link[i]   : translation
    at[i] -> link[i] -> at[i+1]
    link[i] -> 1(spring[i], damper[i])
  }
}
"""
COLUMNS = ("lines", "bends", "crossings", "length", "detour", "near", "unlike", "width", "height")


def length(way: tuple[Point, ...]) -> float:
    """Return the length of a way."""
    return sum(math.dist(a, b) for a, b in pairwise(way))


def measured(picture: Read, models: dict[str, str]) -> Counter[str]:
    """Return the measures of a picture: of bonds and signals together."""
    ways = [*(b.ways[0] for b in picture.bonds), *(way for *_, way in picture.signals)]
    parts = [(n, a, b) for n, way in enumerate(ways) for a, b in pairwise(way)]
    crossings = {(n, m) for (n, a, b), (m, c, d) in combinations(parts, 2) if n != m and cross(a, b, c, d)}
    bent = [w for w in ways if len(w) > 2]
    around = sum(length(w) - abs(w[0][0] - w[-1][0]) - abs(w[0][1] - w[-1][1]) for w in bent)
    strokes = [_rectangle(*b.stroke) for b in picture.bonds]
    near = sum(any(overlap(box, s, -NEAR) for s in strokes) for look, _, box in picture.texts if look == "name")
    return Counter(
        lines=len(ways), bends=sum(len(w) - 2 for w in ways), crossings=len(crossings), near=near, detour=round(around),
        length=round(sum(map(length, ways))), unlike=sum(_unlike(picture, models)), width=round(picture.size[0]), height=round(picture.size[1]),
    )  # fmt: skip


def _rectangle(a: Point, b: Point) -> tuple[float, float, float, float]:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])


def _unlike(picture: Read, models: dict[str, str]) -> Iterator[bool]:
    """Yield for each instance whether it is drawn otherwise than the first of its model: its letters, or its box."""
    shapes: dict[str, list[object]] = defaultdict(list)
    for instance, model in models.items():
        inside = {n.removeprefix(instance): b for n, b in picture.letters.items() if n.startswith(f"{instance}.")}
        if instance in picture.boxes:
            left, top, right, bottom = picture.boxes[instance]
            shapes[model].append((round(right - left), round(bottom - top)))
        elif len(inside) > 1:
            x, y = next(iter(inside.values()))[:2]
            shapes[model].append({n: (round(b[0] - x), round(b[1] - y)) for n, b in sorted(inside.items())})
    for alike in shapes.values():
        usual = max(alike, key=alike.count)
        yield from (shape != usual for shape in alike)


def pictures() -> Iterator[tuple[str, Model]]:
    """Yield the models with names."""
    for folder in ("", "published", "thesis"):
        for path in sorted(p for p in (MODELS / folder).glob("*.bg") if p.name != "mems.bg"):  # a file of parts
            yield f"{folder}{'/' * bool(folder)}{path.stem}", bondgraph.load(path)
    yield "ladder of 12 sections", bondgraph.load(SECTIONS)
    yield "chain of 12 masses", bondgraph.load(MASSES)


def table() -> Iterator[str]:
    """Yield the lines of the table, the sums last."""
    yield f"| model | {' | '.join(COLUMNS)} |"
    yield "|" + "---|" * (len(COLUMNS) + 1)
    total = Counter[str]()
    for name, model in pictures():
        for closed in (False, True):
            instances = {n: d for n, d in diagram_model_of(model.compilation()).instances.items() if d}
            if closed and not instances:
                continue
            found = measured(read(svg_text(model.draw(closed=closed))), instances)
            total += found
            total["wide"] += found["width"] > PAGE
            yield f"| {name}{', boxes' * closed} | {' | '.join(str(found[c]) for c in COLUMNS)} |"
    yield f"| **all** | {' | '.join(str(total[c]) for c in COLUMNS[:-2])} | {total['wide']} over {PAGE:g} | |"


def main(folder: Path = HERE / "results") -> None:
    lines = list(table())
    (folder / "diagrams.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
