"""Mechanisms in space by calls: the same graph as the text's, refused where a call cannot mean anything."""

from __future__ import annotations

import re

import pytest

import bondgraph
from bondgraph import Graph
from bondgraph.errors import UsageError
from tests.unparse.same_graph import Same

TEXT = """
model Robot {
  parameter l = 0.5 m
  multibody arm : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body a { mass = 2 kg, inertia = 1 [kg*m^2]*(1, 1, 1.5), at = (l, 0, 0), turn = (0, 0, 30 deg), start attitude = (0.6, 0.8, 0, 0) }
    body b { mass = 2 kg, inertia = 1 [kg*m^2]*(1, 1, 1.5, 0.1, 0, 0), at = (2*l, 0, 0), start x = 1 m, start rx.omega = 2 [1/s] }
    frame tip : b { at = (1.5 m, 0, 0), axes = body }
    frame hook : ground { at = (0, 0, 1 m) }
    hinge h : ground to a { about = (0, 0, 1), start phi = 0.1, limits phi = (-1, 1), rest phi = 0.2 }
    slide s : a to b { along = (1, 0, 0), at = (1 m, 0, 0), locked = l > 1 m }
    planar p : a to b { turn = (0, 0.1, 0), limits x = (-1 m, 1 m), rest y = 0.1 m }
    cylinder c : a to b { along = (1, 0, 0), start x.v = 2 [m/s] }
    screw w : a to b { along = (1, 0, 0), lead = 0.002 m }
    universal u : a to b { about = (1, 0, 0), then = (0, 1, 0) }
    ball k : a to b { at = (0, 0, 1 m) }
    free f : ground to b { axes = world, locked = true }
    weld o : a to b
    distance d : hook to tip { limits d = (0 m, 2 m) }
    rod r : hook to tip
    hinge h2 : ground to b { about = (0, 0, 1) }
    gear g : h to h2 { ratio = -2 }
    rack t : h to s { radius = 0.01 m }
    wheel q : ground to a { radius = 0.2 m, about = (0, 1, 0), normal = (0, 0.1, 1), at = (0.5 m, 0, 0) }
    wheel v : ground to b { radius = 0.2 m }
    skate e : ground to b { along = (1, 0, 0), at = (1 m, 0, 0) }
  }
  Se lift : F = 1 N
  lift -> arm.d
  output z = arm.tip.z, Fz = arm.k.reaction.z
}
"""


def robot() -> Graph:
    g = Graph("Robot")
    g.parameter("l", 0.5, "m")
    arm = g.multibody("arm", spatial=True, gravity=(0, 0, -9.81))
    a = arm.body(
        "a", mass=2, inertia=(1, 1, 1.5), at="(l, 0, 0)", turn="(0, 0, 30 deg)", start={"attitude": (0.6, 0.8, 0, 0)}
    )
    b = arm.body(
        "b", mass=2, inertia=(1, 1, 1.5, 0.1, 0, 0), at="(2*l, 0, 0)", start={"x": 1, "rx.omega": 2}
    )  # fmt: skip
    tip = arm.frame("tip", b, at=(1.5, 0, 0), axes="body")
    hook = arm.frame("hook", "ground", at=(0, 0, 1))
    h = arm.hinge("h", "ground", a, about=(0, 0, 1), start={"phi": 0.1}, limits=(-1, 1), rest=0.2)
    s = arm.slide("s", a, b, along=(1, 0, 0), at=(1, 0, 0), locked="l > 1 m")
    arm.planar("p", a, b, turn=(0, 0.1, 0), limits={"x": (-1, 1)}, rest={"y": 0.1})
    arm.cylinder("c", a, b, along=(1, 0, 0), start={"x.v": 2})
    arm.screw("w", a, b, along=(1, 0, 0), lead=0.002)
    arm.universal("u", a, b, about=(1, 0, 0), then=(0, 1, 0))
    ball = arm.ball("k", a, b, at=(0, 0, 1))
    arm.free("f", "ground", b, axes="world", locked=True)
    arm.weld("o", a, b)
    d = arm.distance("d", hook, tip, limits=(0, 2))
    arm.rod("r", hook, tip)
    h2 = arm.hinge("h2", "ground", b, about=(0, 0, 1))
    arm.gear("g", h, h2, ratio=-2)
    arm.rack("t", h, s, radius=0.01)
    arm.wheel("q", "ground", a, radius=0.2, about=(0, 1, 0), normal=(0, 0.1, 1), at=(0.5, 0, 0))
    arm.wheel("v", "ground", b, radius=0.2)
    arm.skate("e", "ground", b, along=(1, 0, 0), at=(1, 0, 0))
    g.Se("lift", "F = 1 N") >> d
    g.output("z", f"{tip}.z")
    g.output("Fz", f"{ball}.reaction.z")
    return g


def test_the_same_graph_as_the_text() -> None:
    built = robot().model().compilation(everything=True).whole_graph
    Same(bondgraph.load(TEXT).compilation(everything=True).whole_graph, built).check()


def test_parts_know_their_ports() -> None:
    g = Graph("M")
    arm = g.multibody("arm", spatial=True)
    a, b = arm.body("a", mass=1), arm.body("b", mass=1)
    assert a.ports == ("x", "y", "z", "rx", "ry", "rz")
    assert arm.universal("u", a, b, about=(1, 0, 0), then=(0, 1, 0)).ports == ("phi1", "phi2")
    ball = arm.ball("k", a, b)
    with pytest.raises(UsageError, match=r"`arm\.k` has no port `phi`; its ports: rx, ry, rz"):
        ball["phi"]


def test_what_a_call_cannot_use() -> None:
    g = Graph("M")
    arm = g.multibody("arm", spatial=True)
    a, b = arm.body("a", mass=1), arm.body("b", mass=1)
    for message, call in [
        (
            "`c` has several coordinates: limits={'x': …}",
            lambda: arm.cylinder("c", a, b, along=(1, 0, 0), limits=(0, 1)),
        ),
        ("the rest of `c`: numbers are of x, y, z", lambda: arm.cylinder("c", a, b, along=(1, 0, 0), rest={"F": 1})),
        ("axes are world or body, not 'to'", lambda: arm.frame("f", a, at=(0, 0, 0), axes="to")),
        ("`arm` already has `a`", lambda: arm.body("a", mass=1)),
        ("`arm` has no body `z`", lambda: arm.gear("g", a, "z", ratio=2)),
    ]:
        with pytest.raises(UsageError, match=re.escape(message)):
            call()  # type: ignore[no-untyped-call]
    assert [line.split()[1] for line in arm.text()[1:-1]] == ["a", "b"], (
        "a call that is refused leaves the graph as it was"
    )


def test_mistakes_of_meaning_are_told_as_for_text() -> None:
    g = Graph("M")
    arm = g.multibody("arm")
    a = arm.body("a", mass=1)
    arm.ball("k", "ground", a)
    arm.slide("s", "ground", a, along=(0, 0))
    found = {d.sentence for d in g.check()}
    assert found == {
        "A `ball` joint leaves the plane, and `arm` is planar",
        "The direction `along` of `s` has the length zero",
    }
