"""Mechanisms and modes on a page: the points of the drawing, and amplitudes that satisfy the laws of the elements."""

from __future__ import annotations

import itertools
from base64 import b64decode
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.presentation.diagram.mechanism_geometry import RIGHT, UP, mechanism_geometry_of
from bondgraph.presentation.page.document import modes_data
from bondgraph.presentation.page.runs import PageModel, scenes_of
from compiler.api import MechanismNode, write_text
from tests.compiling import MODELS

MECHANISMS = ["manipulator", "crane", "car", "robot_arm", "six_axes", "four_bar", "gyroscope", "end_stops"]


@pytest.mark.parametrize("name", MECHANISMS)
def test_points_are_those_of_the_drawing(name: str) -> None:
    graph = bondgraph.load(MODELS / f"{name}.bg").compilation().whole_graph
    nodes = [n for n in graph.nodes if isinstance(n, MechanismNode)]
    told = scenes_of(graph).told
    assert len(told) == len(nodes)
    for node, scene in zip(nodes, told, strict=True):
        drawn = mechanism_geometry_of(graph, node)

        right, up = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if scene["planar"] else (RIGHT, UP)

        def flat(point: Any, right: Any = right, up: Any = up) -> tuple[float, float]:
            return float(np.dot(right, point)), float(np.dot(up, point))

        assert [b["name"] for b in scene["bodies"]] == [x.name for x in drawn.limbs]
        for body, limb in zip(scene["bodies"], drawn.limbs, strict=True):
            assert flat(body["centre"]) == pytest.approx(limb.centre, abs=1e-15)
            assert [flat(p) for p in body["points"]] == [pytest.approx(p, abs=1e-15) for p in limb.points]
        for link, seen in zip(scene["links"], drawn.links, strict=True):
            ends = [flat(end["at"]) for end in link["ends"]]
            assert ends == [pytest.approx(seen.first, abs=1e-15), pytest.approx(seen.second, abs=1e-15)]
            assert (link["kind"], link["grounded"], tuple(link["sprung"])) == (seen.kind, seen.grounded, seen.sprung)
        assert [(m["name"], flat(m["at"])) for m in scene["marks"]] == [(n, pytest.approx(p)) for n, p in drawn.marks]


SOLIDS = """model Solids {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 0)
    body brick { mass = 2 kg, inertia = 1 [kg*m^2]*(2*(0.04 + 0.09)/12, 2*(0.01 + 0.09)/12, 2*(0.01 + 0.04)/12), turn = (0, 0, 90 deg), at = (1 m, 0, 0) }
    body disc  { mass = 3 kg, inertia = 1 [kg*m^2]*(3*0.25/2, 3*0.25/4, 3*0.25/4), at = (2 m, 0, 0) }
    body globe { mass = 5 kg, inertia = 1 [kg*m^2]*(0.4*5*0.04, 0.4*5*0.04, 0.4*5*0.04), at = (3 m, 0, 0) }
    body point { mass = 1 kg, at = (4 m, 0, 0) }
    free a : ground to brick
    free b : ground to disc
    free c : ground to globe
    free d : ground to point
  }
}"""


def test_solids_have_the_mass_and_inertia_of_their_bodies() -> None:
    """A brick of 0.1 x 0.2 x 0.3 m turned by 90 deg, a thin disc of radius 0.5 m about x, a ball of radius 0.2 m; a point has no extent."""
    (scene,) = scenes_of(bondgraph.load(SOLIDS).compilation().whole_graph).told
    brick, disc, globe, point = (body["solid"] for body in scene["bodies"])
    sides = {int(np.argmax(np.abs(s))): float(np.abs(s).max()) for s in brick["axes"]}
    assert brick["round"] == 0 and sides == pytest.approx({1: 0.05, 0: 0.10, 2: 0.15})
    assert disc["round"] == 2 and [np.linalg.norm(s) for s in disc["axes"]] == pytest.approx([0.5, 0.5, 0], abs=1e-7)
    assert all(abs(s[0]) < 1e-12 for s in disc["axes"][:2])
    assert globe["round"] == 3 and [np.linalg.norm(s) for s in globe["axes"]] == pytest.approx([0.2] * 3)
    assert point is None and [body["heavy"] for body in scene["bodies"]] == [True] * 4
    assert scene["up"] == pytest.approx([0, 1, 0])


def numbers(packed: dict[str, str]) -> Any:
    ((kind, text),) = packed.items()
    return np.frombuffer(b64decode(text), f"<{kind}")


def test_amplitudes_keep_the_laws() -> None:
    """In each mode of the motor: u = R i at the winding, M = b omega at the bearing, efforts sum up around the armature."""
    watched = PageModel(bondgraph.load(MODELS / "dc_motor.bg"))
    names = {n.name: i for i, n in enumerate(watched.graph.nodes)}

    def bond(node: str) -> int:
        return watched.graph.incident[names[node]][0]

    for mode in modes_data(watched):
        amplitudes = numbers(mode["bonds"]["re"]) + 1j * numbers(mode["bonds"]["im"])
        size = float(np.abs(amplitudes).max())
        effort, flow = (
            {n: amplitudes[watched.bonds.places[bond(n)][k]] for n in ("supply", "winding", "coil", "motor", "bearing")}
            for k in (0, 1)
        )
        assert effort["winding"] == pytest.approx(1.0 * flow["winding"], abs=1e-6 * size)
        assert effort["bearing"] == pytest.approx(1e-3 * flow["bearing"], abs=1e-6 * size)
        assert effort["supply"] == pytest.approx(0, abs=1e-6 * size)
        assert effort["winding"] + effort["coil"] + effort["motor"] == pytest.approx(0, abs=1e-6 * size)


SHAPES = """model Shapes {
  parameter l = 30 cm
  multibody arm : spatial {
    body link { mass = 1 kg, at = (l/2, 0 m, 0 m), turn = (0, 0, 90 deg), shape = box(l, 4 cm, 2 cm), colour = red }
    body tip  { mass = 1 kg, at = (l, 0 m, 0 m), shape = cylinder(1 cm, (0 m, 20 cm, 0 m)) }
    body end  { mass = 1 kg, shape = sphere(3 cm), colour = blue }
    body none { mass = 1 kg, colour = grey }
    free a : ground to link; free b : ground to tip; free c : ground to end; free d : ground to none
  }
  multibody flat {
    body plate { mass = 1 kg, angle = 30 deg, shape = box(l, 4 cm) }
    body disc  { mass = 1 kg, shape = sphere(5 cm) }
    free a : ground to plate; free b : ground to disc
  }
}"""


def test_shapes_are_those_of_the_text() -> None:
    compilation = bondgraph.load(SHAPES).compilation()
    arm, flat = scenes_of(compilation.whole_graph).told
    link, tip, end, none = arm["bodies"]
    sizes = [
        [float(np.linalg.norm(axis)) for axis in body["solid"]["axes"]] for body in (link, tip, end, *flat["bodies"])
    ]
    assert sizes == [
        pytest.approx(s)
        for s in ([0.15, 0.02, 0.01], [0.01, 0.01, 0.1], [0.03] * 3, [0.15, 0.02, 0.004], [0.05, 0.05, 0.01])
    ]
    assert [body["solid"]["round"] for body in (link, tip, end, *flat["bodies"])] == [0, 2, 3, 0, 2]
    assert link["solid"]["axes"][0] == pytest.approx((0, 0.15, 0)) and tip["solid"]["axes"][2] == pytest.approx(
        (0, 0.1, 0)
    )
    assert flat["bodies"][0]["solid"]["axes"][0] == pytest.approx((0.15 * np.cos(np.pi / 6), 0.075, 0))
    assert (link["colour"], end["colour"], tip["colour"]) == ("#e57368", "#74a9dc", None)
    assert (none["given"], none["solid"], none["colour"]) == (False, None, "#b4bbc2")
    again = scenes_of(bondgraph.load(write_text(compilation.whole_graph)).compilation().whole_graph).told
    assert again == (arm, flat)


@pytest.mark.parametrize("name", ["arm", "flat"])
def test_a_shape_is_drawn_where_its_corners_are(name: str) -> None:
    graph = bondgraph.load(SHAPES).compilation().whole_graph
    node = next(n for n in graph.nodes if n.name == name)
    assert isinstance(node, MechanismNode)
    first, _, *more = mechanism_geometry_of(graph, node).limbs
    turn, half = (np.pi / 2, (0.15, 0.02, 0.01)) if name == "arm" else (np.pi / 6, (0.15, 0.02))
    c, s = np.cos(turn), np.sin(turn)
    right, up = (RIGHT, UP) if name == "arm" else ((1, 0, 0), (0, 1, 0))
    expected = set()
    for signs in itertools.product((1, -1), repeat=len(half)):
        x, y, z = (*(h * sign for h, sign in zip(half, signs, strict=True)), 0.0)[:3]
        point = ((0.15 if name == "arm" else 0) + c * x - s * y, s * x + c * y, z)
        expected.add(tuple(np.round([np.dot(right, point), np.dot(up, point)], 9) + 0.0))
    assert {tuple(np.round(p, 9) + 0.0) for line in first.edges for p in line} == expected
    assert [limb.radius for limb in more] == ([0.03, 0] if name == "arm" else [])


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ("shape = box(l, 4 cm)", "BG111", "box(20 cm, 4 cm, 2 cm)"), ("shape = 3", "BG111", "sphere(3 cm)"), ("shape = cone(1 m)", "BG111", "cylinder(1 cm"),
        ("shape = box(l, 0 m, 2 cm)", "BG140", "positive"), ("shape = sphere(-1 m)", "BG140", "positive"), ("shape = cylinder(1 cm, 2 cm)", "BG111", "cylinder(1 cm, (20 cm"),
        ("shape = cylinder(1 cm, (0 m, 0 m, 0 m))", "BG140", "positive"), ("shape = sphere(1 kg)", "BG103", ""), ("colour = pink", "BG1", "red, orange"), ("shape = sphere(time*1 [m/s])", "BG106", ""),
    ],
)  # fmt: skip
def test_other_shapes_are_refused(given: str, code: str, words: str) -> None:
    found = bondgraph.check(SHAPES.replace("shape = sphere(3 cm), colour = blue", given))
    assert [d.code[: len(code)] for d in found] == [code] and words in found[0].help
