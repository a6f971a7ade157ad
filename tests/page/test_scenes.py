"""Mechanisms and modes on a page: the points of the drawing, and amplitudes that satisfy the laws of the elements."""

from __future__ import annotations

from base64 import b64decode
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.presentation.diagram.mechanism_geometry import RIGHT, UP, mechanism_geometry_of
from bondgraph.presentation.page.runs import PageModel
from bondgraph.presentation.page.scene import scenes_of
from bondgraph.presentation.page.shapes import modes_data
from compiler.api import MechanismNode
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
