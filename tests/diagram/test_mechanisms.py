"""Mechanisms drawn: the places of the drawn parts are compared with the drawing's own numbers and with a run."""

from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.model import Model
from bondgraph.presentation.diagram import svg_text
from bondgraph.presentation.diagram.mechanism_geometry import RIGHT, UP
from tests.compiling import MODELS
from tests.diagram.reading import SVG, measured, overlap

Point = tuple[float, float]


def model(name: str) -> Model:
    return bondgraph.load(MODELS / f"{name}.bg")


def circles(svg: str) -> dict[str, Point]:
    """The middle of the first circle of each body and joint."""
    found = {}
    for group in ElementTree.fromstring(svg).iter(f"{SVG}g"):
        if group.get("class") in ("limb", "link"):
            circle = next((c for c in group.iter(f"{SVG}circle") if float(c.get("r", 0)) < 8), None)
            if circle is not None:
                found[group.get("data-name", "")] = (float(circle.get("cx", 0)), float(circle.get("cy", 0)))
    return found


def test_the_bars_of_a_four_bar_have_their_lengths() -> None:
    """0.5, 0.15, 0.45, 0.35 m between the hinges, and the masses half way."""
    found = circles(svg_text(model("four_bar").draw_mechanism()))
    scale = math.dist(found["shaft"], found["pivot"]) / 0.5
    for a, b, length in (("shaft", "left", 0.15), ("left", "right", 0.45), ("right", "pivot", 0.35)):
        assert math.dist(found[a], found[b]) == pytest.approx(length * scale, rel=2e-4)
    for a, b, bar in (("shaft", "left", "bar_a"), ("left", "right", "bar_b"), ("right", "pivot", "bar_c")):
        middle = [(p + q) / 2 for p, q in zip(found[a], found[b], strict=True)]
        assert found[bar] == pytest.approx(middle, abs=0.02)


def test_a_pendulum_hangs_as_the_run_has_it() -> None:
    """Its arms at the angles of the run after 0.7 s, its lower mass at x and y, with 1 m between the hinges."""
    pendulum = model("pendulum")
    found = circles(svg_text(pendulum.draw_mechanism(at="0.7 s")))
    run = pendulum.simulate(to="0.7 s", points=2)
    scale = math.dist(found["top"], found["middle"])
    (x0, y0), (x1, y1), (x2, y2) = found["top"], found["middle"], found["lower"]
    assert math.remainder(math.atan2(y0 - y1, x1 - x0) - run.final("upper"), 2 * math.pi) == pytest.approx(0, abs=1e-4)
    assert ((x2 - x0) / scale, (y0 - y2) / scale) == pytest.approx((run.final("x"), run.final("y")), abs=1e-4)


def test_a_body_in_space_stands_where_the_run_has_it() -> None:
    """The arm's tool as the picture's side sees it, from its foot on: its direction there is that of x, y, z in the run."""
    arm = model("robot_arm")
    svg = svg_text(arm.draw_mechanism(at="0.3 s"))
    (cross,) = (g for g in ElementTree.fromstring(svg).iter(f"{SVG}g") if g.get("class") == "frame")
    ends = [p.get("d", "")[1:].split("L")[0].split() for p in cross.iter(f"{SVG}path")]
    tool, foot = (float(ends[1][0]), float(ends[0][1])), circles(svg)["j[1]"]
    run = arm.simulate(to="0.3 s", points=2)
    place = [run.final(c) for c in "xyz"]
    seen = [sum(a * b for a, b in zip(place, axis, strict=True)) for axis in (RIGHT, UP)]
    drawn = tool[0] - foot[0], foot[1] - tool[1]
    assert math.atan2(drawn[1], drawn[0]) == pytest.approx(math.atan2(seen[1], seen[0]), abs=2e-3)


@pytest.mark.parametrize(
    "name", ["manipulator", "car", "crane", "six_axes", "gyroscope", "published/andrews", "robot_arm"]
)
def test_names_are_clear_of_each_other(name: str) -> None:
    figure = model(name).draw_mechanism()
    texts = [(t.text, measured(t)) for t in ElementTree.fromstring(svg_text(figure)).iter(f"{SVG}text")]
    assert texts
    for (a, first), (b, second) in combinations(texts, 2):
        assert not overlap(first, second), (a, b)
    for text, (left, top, right, bottom) in texts:
        assert left >= 0 and top >= 0 and right <= figure.width and bottom <= figure.height, text


def test_springs_hang_where_the_graph_says() -> None:
    """Andrews' squeezer has one spring, from hook to anchor; the manipulator's guides and flexures are all sprung, the crane's rail is not."""
    (spring,) = springs(model("published/andrews"))
    assert spring == "gap"
    assert sorted(springs(model("manipulator"))) == sorted(f"{n}[{i}]" for n in ("guide", "flex") for i in (1, 2, 3))
    assert springs(model("crane")) == []


def springs(chosen: Model) -> list[str]:
    root = ElementTree.fromstring(svg_text(chosen.draw_mechanism()))
    return [
        g.get("data-name", "") for g in root.iter(f"{SVG}g")
        if g.get("class") == "link" and any(p.get("class") == "spring" for p in g.iter(f"{SVG}path"))
    ]  # fmt: skip


def test_what_cannot_be_drawn() -> None:
    with pytest.raises(UsageError, match="it has none"):
        model("oscillator").draw_mechanism()
    with pytest.raises(UsageError, match=r"it has `world\.arm`, `body\.arm`"):
        model("flexure").draw_mechanism()


def test_the_command(tmp_path: Path) -> None:
    file, out = str(MODELS / "pendulum.bg"), str(tmp_path / "x.svg")
    run = CliRunner().invoke(commands, ["draw", file, "-o", out, "--mechanism", "chain", "--at", "0.7 s"])
    assert run.exit_code == 0, run.output
    assert "at 0.7 s" in (tmp_path / "x.svg").read_text(encoding="utf-8")
    assert CliRunner().invoke(commands, ["draw", file, "-o", out, "--at", "1 s"]).exit_code == 2
    assert CliRunner().invoke(commands, ["draw", file, "-o", str(tmp_path / "x.gif")]).exit_code == 2
