"""Mechanisms and modes on a page: the points of the drawing, and amplitudes that satisfy the laws of the elements."""

from __future__ import annotations

from base64 import b64decode
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.presentation.diagram.mechanism_geometry import mechanism_geometry_of
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

        def flat(point: Any, scene: dict[str, Any] = scene) -> tuple[float, float]:
            return float(np.dot(scene["right"], point)), float(np.dot(scene["up"], point))

        assert [b["name"] for b in scene["bodies"]] == [x.name for x in drawn.limbs]
        for body, limb in zip(scene["bodies"], drawn.limbs, strict=True):
            assert flat(body["centre"]) == pytest.approx(limb.centre, abs=1e-15)
            assert [flat(p) for p in body["points"]] == [pytest.approx(p, abs=1e-15) for p in limb.points]
        for link, seen in zip(scene["links"], drawn.links, strict=True):
            ends = [flat(end["at"]) for end in link["ends"]]
            assert ends == [pytest.approx(seen.first, abs=1e-15), pytest.approx(seen.second, abs=1e-15)]
            assert (link["kind"], link["grounded"], tuple(link["sprung"])) == (seen.kind, seen.grounded, seen.sprung)
        assert [(m["name"], flat(m["at"])) for m in scene["marks"]] == [(n, pytest.approx(p)) for n, p in drawn.marks]


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
