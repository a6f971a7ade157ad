"""Every model drawn, and the drawing read back: no two things overlap, and every stroke is where the causal graph says."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path

import pytest

import bondgraph
from bondgraph.model import Model
from bondgraph.presentation.diagram import svg_text
from bondgraph.presentation.diagram.diagram_model import diagram_model_of
from compiler.api import Scene
from compiler.causality.assign import CausalGraph
from tests.benchmarks.bench_diagrams import MASSES, SECTIONS
from tests.compiling import MODELS
from tests.conftest import Golden
from tests.diagram.reading import Read, cross, middle, overlap, read, segments, through

FILES = sorted(p for p in [*MODELS.glob("*.bg"), *(MODELS / "published").glob("*.bg")] if p.name != "mems.bg")
EVERYTHING = frozenset({"*"})
# Bonds that cross: graphs that have no drawing without, or for which none was found.
CROSSINGS = {"hires": 6, "transistor_amplifier": 4, "rectifier": 3, "stiffness_frames": 1, "side_instability": 1}


def name(path: Path) -> str:
    return path.stem


@cache
def loaded(path: Path) -> Model:
    return bondgraph.load(path)


@cache
def drawn(path: Path, closed: bool = False, numbers: bool = False) -> Read:
    return read(svg_text(loaded(path).draw(closed=closed, numbers=numbers)))


def causal(path: Path) -> CausalGraph:
    return loaded(path).compilation(Scene(None, None, free=EVERYTHING)).causal


@pytest.mark.few(13)
@pytest.mark.parametrize("path", FILES, ids=name)
def test_nothing_overlaps(path: Path) -> None:
    assert_clear(drawn(path), CROSSINGS.get(path.stem, 0))


@pytest.mark.parametrize("model", ["manipulator", "six_axes", "robot_arm", "car"])
def test_nothing_overlaps_with_boxes_and_numbers(model: str) -> None:
    assert_clear(drawn(MODELS / f"{model}.bg", closed=True), 4)
    assert_clear(drawn(MODELS / f"{model}.bg", numbers=True), 0)


def assert_clear(picture: Read, crossings: int) -> None:
    """Texts overlap neither each other nor bonds, bonds pass through no box and do not lie on each other, all is on the page."""
    for (_, a, first), (_, b, second) in combinations(picture.texts, 2):
        assert not overlap(first, second), f"`{a}` and `{b}`"
    parts = list(segments(picture))
    for look, text, box in picture.texts:
        for number, start, end in parts:
            assert not through(start, end, box), f"bond of `{picture.bonds[number].head}` and {look} `{text}`"
    for title, box in picture.boxes.items():
        for number, start, end in parts:
            assert not through(start, end, box), f"bond of `{picture.bonds[number].head}` and box `{title}`"
        assert not any(overlap(box, letter) for letter in picture.letters.values())
        assert not any(overlap(box, other) for n, other in picture.boxes.items() if n != title)
    lines = [(n, a, b) for n, bond in enumerate(picture.bonds) for a, b in pairwise(bond.ways[0])]
    found = {(n, m) for (n, a, b), (m, c, d) in combinations(lines, 2) if n != m and cross(a, b, c, d)}
    assert len(found) <= crossings, [(picture.bonds[n].head, picture.bonds[m].head) for n, m in found]
    for (n, a, b), (m, c, d) in combinations(lines, 2):
        assert n == m or not lie_on_each_other(a, b, c, d), (picture.bonds[n], picture.bonds[m])
    for _, text, (left, top, right, bottom) in picture.texts:
        assert left >= 0 and top >= 0 and right <= picture.size[0] and bottom <= picture.size[1], text


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("text", [MASSES, SECTIONS], ids=["masses", "sections"])
def test_a_long_chain_goes_back_and_forth(text: str, closed: bool) -> None:
    """Rows of about a page's width (a straight one is 1800 to 2900 px wide); every bond stays one straight line."""
    picture = read(svg_text(bondgraph.load(text).draw(closed=closed)))
    assert_clear(picture, 0)
    assert picture.size[0] < 1250
    assert all(len(way) == 2 for bond in picture.bonds for way in bond.ways)


@pytest.mark.few(10)
@pytest.mark.parametrize("path", FILES, ids=name)
def test_names_keep_clear_of_strokes(path: Path) -> None:
    for bond in (picture := drawn(path)).bonds:
        (x, y), (u, v) = bond.stroke
        stroke = (min(x, u) - 3, min(y, v) - 3, max(x, u) + 3, max(y, v) + 3)
        assert not any(overlap(stroke, box) for look, _, box in picture.texts if look == "name")


def lie_on_each_other(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]
) -> bool:
    """Return True if two axis-parallel lines run along each other, nearer than 3 px."""
    for x, y in ((0, 1), (1, 0)):
        if abs(a[x] - b[x]) < 0.5 and abs(c[x] - d[x]) < 0.5 and abs(a[x] - c[x]) < 3:
            return min(max(a[y], b[y]), max(c[y], d[y])) - max(min(a[y], b[y]), min(c[y], d[y])) > 1
    return False


@pytest.mark.few(13)
@pytest.mark.parametrize("path", FILES, ids=name)
def test_strokes_and_half_arrows(path: Path) -> None:
    """Every bond is drawn once, but for those inside of one multibond transducer. Its stroke is across the end that receives the effort, its barb at the head, on the side of the flow."""
    picture, graph = drawn(path), causal(path)
    homes = [getattr(node, "bundle", "") or number for number, node in enumerate(graph.graph.nodes)]
    outside = (n for n, bond in enumerate(graph.graph.bonds) if homes[bond.tail.node] != homes[bond.head.node])
    assert Counter(n for b in picture.bonds for n in b.numbers) == Counter(outside)
    for bond in picture.bonds:
        ends = bond.ends
        for number in bond.numbers:
            wanted = 1 - graph.effort_from[number]
            assert math.dist(middle(*bond.stroke), ends[wanted]) < 0.5, bond
            assert bond.said == ("tail", "head")[wanted]
        at = 0 if bond.said == "tail" else -1
        beside = bond.ways[0][1] if at == 0 else bond.ways[0][-2]
        assert across(bond.stroke, (bond.ways[0][at], beside))
        tip, end = bond.barb
        assert math.dist(tip, ends[1]) < 3
        x, y = direction(*bond.ways[0][-2:])
        u, v = end[0] - tip[0], end[1] - tip[1]
        assert u * x + v * y < 0, "the barb points backwards"
        aside = u - (u * x + v * y) * x, v - (u * x + v * y) * y
        assert aside[1] > 1 or (abs(aside[1]) <= 1 and aside[0] > 1), (
            "flow is written below a bond, or right of an upright one"
        )


def direction(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    length = math.dist(start, end)
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length


def across(stroke: tuple[tuple[float, float], ...], bond: tuple[tuple[float, float], ...]) -> bool:
    (a, b), (c, d) = stroke, bond
    dot = (b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1])
    return abs(dot) < 0.02 * math.dist(a, b) * math.dist(c, d) and 12 < math.dist(a, b) < 18


@pytest.mark.few(30)
@pytest.mark.parametrize("path", FILES, ids=name)
def test_bonds_end_at_their_nodes(path: Path) -> None:
    """Tail and head are nearer to the border of their own node than to any other."""
    picture = drawn(path)
    borders = picture.letters | picture.boxes
    for bond in picture.bonds:
        for owner, end in zip((bond.tail, bond.head), bond.ends, strict=True):
            near = min(borders, key=lambda n: distance(end, borders[n]))
            assert near == owner, (bond.tail, bond.head)
            assert distance(end, borders[owner]) < 15


def distance(point: tuple[float, float], box: tuple[float, float, float, float]) -> float:
    x, y = point
    return math.hypot(max(box[0] - x, x - box[2], 0), max(box[1] - y, y - box[3], 0))


def test_derivative_storage_and_loops_are_marked() -> None:
    """The load of the motor is in derivative form; the rectifier's loop goes over the winding and a diode's resistance."""
    motor = drawn(MODELS / "dc_motor.bg")
    assert [b.head for b in motor.bonds if b.mark == "derivative"] == ["load"]
    assert "storage in derivative form" in [t for _, t, _ in motor.texts]
    loop = drawn(MODELS / "rectifier.bg")
    assert {"winding", "d_1.series"} <= {b.head for b in loop.bonds if b.mark == "loop"}
    assert not any(b.mark for b in drawn(MODELS / "oscillator.bg").bonds)


def test_multibonds_are_double_lines() -> None:
    """The manipulator's flexures hang on the stage by three bonds each, in one double line."""
    picture = drawn(MODELS / "manipulator.bg")
    double = [b for b in picture.bonds if len(b.ways) == 2]
    assert len(double) == 9 and all(len(b.numbers) == 3 for b in double)
    assert sorted(b.tail for b in double if b.tail == "stage") == ["stage"] * 3
    assert all(len(b.numbers) == 1 for b in picture.bonds if len(b.ways) == 1)
    assert {"flex[1]", "guide[2].x", "platform.phi"} <= {t for look, t, _ in picture.texts if look == "port"}


def test_multibonds_of_a_width_are_drawn_as_they_are_declared() -> None:
    """A plate on four feet: a transformer of many ports is one, and a bond of four a double line, of three single ones each single."""
    picture = drawn(Path("tests/metamorphic/circuits/multibonds.bg"))
    double = {(b.tail, b.head): len(b.numbers) for b in picture.bonds if len(b.ways) == 2}
    inner = "feet.1(loss)"
    pairs = (("ends", "foot"), ("foot", inner), (inner, "feet.loss"), (inner, "feet.pad"))
    assert double == dict.fromkeys(pairs, 4)


def test_signals() -> None:
    """A grip reads the tyre's spring and its slip; an input comes from outside; a source of time alone has none."""
    assert {(s, t) for s, t, _ in drawn(MODELS / "car.bg").signals if t == "tyre[1].grip"} == {
        ("tyre[1].spring", "tyre[1].grip"), ("tyre[1].forward", "tyre[1].grip"),
    }  # fmt: skip
    motor = drawn(MODELS / "dc_motor.bg")
    assert [(s, t) for s, t, _ in motor.signals] == [("", "supply")]
    assert ("kind", "volt") in [(look, t) for look, t, _ in motor.texts]
    assert drawn(MODELS / "oscillator.bg").signals == ()


@pytest.mark.few(25)
@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_signal_has_a_way(path: Path) -> None:
    """It begins and ends at its own nodes, and passes through no text and no box."""
    picture = drawn(path)
    wanted = diagram_model_of(loaded(path).compilation(Scene(None, None, free=EVERYTHING))).signals
    assert len(picture.signals) == len(wanted)
    borders = picture.letters | picture.boxes
    for source, target, way in picture.signals:
        assert not source or distance(way[0], borders[source]) < 8
        assert distance(way[-1], borders[target]) < 8
        for start, end in pairwise(way):
            for _, text, box in picture.texts:
                assert not through(start, end, box), (source, target, text)
            for title, box in picture.boxes.items():
                assert not through(start, end, box), (source, target, title)


def test_instances_as_boxes() -> None:
    picture = drawn(MODELS / "manipulator.bg", closed=True)
    assert set(picture.boxes) == {"stage", *(f"{n}[{i}]" for n in ("comb", "flexure") for i in (1, 2, 3))}
    assert {b.tail for b in picture.bonds if b.head == "stage"} == {
        "push_x",
        "push_y",
        "twist",
        "comb[1]",
        "comb[2]",
        "comb[3]",
    }
    assert {"CombDrive", "Flexure"} <= {t for look, t, _ in picture.texts if look == "kind"}


@pytest.mark.parametrize("model", ["car", "manipulator", "end_stops", "rectifier"])
def test_instances_of_a_model_have_equal_boxes(model: str) -> None:
    picture = drawn(MODELS / f"{model}.bg", closed=True)
    kinds = {n: g.get("data-letter") for n, g in picture.nodes.items() if n in picture.boxes}
    for kind in set(kinds.values()):
        sizes = {(round(x1 - x0), round(y1 - y0)) for n, (x0, y0, x1, y1) in picture.boxes.items() if kinds[n] == kind}
        assert len(sizes) == 1, kind


def test_ports_of_boxes_have_their_names() -> None:
    """Both tyres, although the pieces of road in them are not drawn."""
    ports = [t for look, t, _ in drawn(MODELS / "car.bg", closed=True).texts if look == "port"]
    assert ports.count("x, turn") == ports.count("y") == 2


def test_frames_hold_their_instances() -> None:
    """Around the nodes of each comb and flexure, and around nothing else; inside, names do not repeat that of the frame."""
    picture = drawn(MODELS / "manipulator.bg")
    assert set(picture.frames) == {f"{n}[{i}]" for n in ("comb", "flexure") for i in (1, 2, 3)}
    for instance, frame in picture.frames.items():
        for node, letter in (picture.letters | picture.boxes).items():
            assert overlap(frame, letter) == node.startswith(f"{instance}."), (instance, node)
        assert not any(overlap(frame, other) for n, other in picture.frames.items() if n != instance)
    assert [t for look, t, _ in picture.texts if look == "name"].count(": folded") == 3
    assert [t for look, t, _ in picture.texts if look == "kind"].count("force") == 3


def test_numbers_of_bonds() -> None:
    numbers = [t for look, t, _ in drawn(MODELS / "manipulator.bg", numbers=True).texts if look == "number"]
    assert len(numbers) == 24 and "4-6" in numbers


def test_as_an_experiment_runs_it() -> None:
    """Without voltage the combs' drives contribute nothing: they are not drawn, and that is reported."""
    figure = loaded(MODELS / "manipulator.bg").draw(experiment="push_x")
    picture = read(svg_text(figure))
    assert "push_x" in picture.nodes and "comb[1].drive" not in picture.nodes
    assert any(t.startswith("not drawn, as they give nothing: comb[1].drive") for _, t, _ in picture.texts)


def test_the_same_bytes() -> None:
    """From a fresh model, and in a notebook."""
    path = MODELS / "robot_arm.bg"
    first = svg_text(loaded(path).draw())
    assert svg_text(bondgraph.load(path).draw()) == first == bondgraph.load(path)._repr_svg_()


def test_the_files_that_the_readme_names_are_there() -> None:
    """Its picture is one of the gallery, which the next test keeps up to date."""
    named = re.findall(r"\]\(([^)]+)\)", (MODELS.parent / "README.md").read_text(encoding="utf-8"))
    assert "models/pictures/dc_motor.svg" in named
    assert [name for name in named if not (MODELS.parent / name).exists()] == []


@pytest.mark.parametrize("path", [p for p in FILES if p.parent == MODELS], ids=lambda p: p.stem)
def test_the_pictures_of_the_gallery_are_up_to_date(golden: Golden, path: Path) -> None:
    golden(MODELS / "pictures" / f"{path.stem}.svg", svg_text(loaded(path).draw(closed=True)))


def test_the_gallery_lists_every_model_with_its_picture() -> None:
    text = (MODELS / "README.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == sorted(p.stem for p in MODELS.glob("*.bg"))
    shown = re.findall(r"^\| `(\w+)` \|.*\| !\[\1\]\(pictures/\1\.svg\) \|$", text, re.MULTILINE)
    assert sorted(shown) == sorted(p.stem for p in (MODELS / "pictures").glob("*.svg"))
    assert set(shown) == {p.stem for p in FILES if p.parent == MODELS}


def test_a_run_loads_nothing_of_it() -> None:
    code = "import sys, bondgraph; bondgraph.load('models/rlc.bg').simulate(points=3).summary(); print([m for m in sys.modules if 'diagram' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=MODELS.parent, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_files(tmp_path: Path, ending: str) -> None:
    """Equal files for equal models, of the size of the figure."""
    figure = loaded(MODELS / "dc_motor.bg").draw(tmp_path / f"a.{ending}")
    loaded(MODELS / "dc_motor.bg").draw(tmp_path / f"b.{ending}")
    data = (tmp_path / f"a.{ending}").read_bytes()
    assert data == (tmp_path / f"b.{ending}").read_bytes()
    if ending == "png":
        from matplotlib.image import imread

        pixels = imread(tmp_path / "a.png")
        assert abs(pixels.shape[1] - 2 * figure.width) <= 2 and abs(pixels.shape[0] - 2 * figure.height) <= 2
        assert 0.005 < (pixels[..., :3].min(axis=-1) < 0.5).mean() < 0.2
    else:
        assert data.startswith(b"%PDF")


SWITCHED = """
model A {
  mode on = false
  when time > 1 s { on = true }
  Se b : u = 10 V
  R r : u = 5 ohm*i
  C first : u = q/1 [mF]
  C second : u = q/2 [mF] { start u = 1 V }
  R load : u = 6 ohm*i
  0 node, k : electric
  1 switch : electric { active = on }
  1 between : electric { active = on }
  0 short : electric { active = on }
  b -> switch -> r
  switch -> node -> first
  node -> between -> k -> second
  k -> 1(load) -> short
  output u = first.u
}
"""


def test_junctions_that_are_off_are_drawn_with_all_their_bonds() -> None:
    """One of kind 1 gives the flow, one of kind 0 the effort, also where pruning removes its sources of zero; none of these is drawn."""
    model = diagram_model_of(bondgraph.load(SWITCHED).compilation())
    names = [n.name for n in model.nodes]
    off = {n.name: n for n in model.nodes if n.label.endswith(" (off)")}
    assert {n: (node.letter, node.shape) for n, node in off.items()} == {
        "switch": ("1", "junction"), "between": ("1", "junction"), "short": ("0", "junction"),
    }  # fmt: skip
    assert "Sf" not in {n.letter for n in model.nodes} and not model.left_out
    ends = {(names[line.tail], names[line.head]): ("tail", "head")[line.stroke] for line in model.lines}
    wanted = {
        ("b", "switch"): "head", ("switch", "r"): "tail", ("switch", "node"): "tail", ("node", "between"): "head",
        ("between", "k"): "tail", ("1(load)", "short"): "tail",
    }  # fmt: skip
    assert {pair: stroke for pair, stroke in ends.items() if {*pair} & {*off}} == wanted


def test_a_box_with_a_junction_that_is_off_has_its_ports() -> None:
    part = "model Part { port a: electric, b: electric; mode on = false; when time > 1 s { on = true }; 1 line : electric { active = on }; a -> line -> b }"
    text = f"{part}\nmodel A {{ Part part; Se s : u = 1 V; C c : u = q/1 [mF]; s -> part.a; part.b -> 0(c); output u = c.u }}"
    model = diagram_model_of(bondgraph.load(text, "A").compilation(), closed=True)
    names = [n.name for n in model.nodes]
    assert sorted(names) == ["0(c)", "c", "part", "s"]
    ends = {(names[line.tail], names[line.head]): line.ports for line in model.lines}
    assert ends[("s", "part")] == ("", "a") and ends[("part", "0(c)")] == ("b", "")
