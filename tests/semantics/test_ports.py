"""Ports of models: a reading of one is the effort or flow of the bond that passes through it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from compiler.errors import CompilationFailed
from compiler.unparse import write_text
from tests.compiling import Running, compiled, mistakes, outputs_of

LEG = """model Phase {
  port foot: translation
  parameter k: N/m = 7, r: N*s/m = 2
  C spring : F = k*x
  R oil    : F = r*v
  1 knee
  foot -> knee -> spring, oil
  signal power = foot.F*foot.v
}
"""


def test_effort_and_flow_outside_and_inside() -> None:
    """At x = 0.5 m and v = 0.25 m/s the leg takes 3.5 N + 0.5 N, 1 W."""
    text = (
        LEG
        + "model A {\n  I mass : p = 4 kg*v\n  Phase leg\n  1(mass) -> leg.foot\n  output F = leg.foot.F, v = leg.foot.v, e = leg.foot.e, P = leg.power\n}\n"
    )
    found = outputs_of(compiled(text), {"leg.spring.x": 0.5, "mass.p": 1.0})
    assert found == {"F": 4.0, "v": 0.25, "e": 4.0, "P": 1.0}


def test_the_sign_is_the_arrow_s() -> None:
    """The same leg with its arrows the other way: power counts out of it, and with it the flow."""
    turned = LEG.replace("foot -> knee -> spring, oil", "knee -> spring, oil, foot")
    text = (
        turned
        + "model A {\n  I mass : p = 4 kg*v\n  Phase leg\n  leg.foot -> 1(mass)\n  output F = leg.foot.F, v = leg.foot.v\n}\n"
    )
    found = outputs_of(compiled(text), {"leg.spring.x": 0.5, "mass.p": 1.0})
    assert found == {"F": -4.0, "v": 0.25}


def test_walls_within_walls_see_one_bond() -> None:
    text = (
        LEG
        + "model Shoe { port sole: translation; Phase leg; sole -> leg.foot }\nmodel A {\n  I mass : p = 4 kg*v\n  Shoe shoe\n  1(mass) -> shoe.sole\n  output F = shoe.sole.F - shoe.leg.foot.F, v = shoe.sole.v\n}\n"
    )
    assert outputs_of(compiled(text), {"shoe.leg.spring.x": 0.5, "mass.p": 1.0}) == {"F": 0.0, "v": 0.25}


def test_what_is_read_stays_though_it_gives_nothing() -> None:
    """A lone resistor of zero behind a port: its bond is read, so both ends of it stay."""
    text = "model Oil { port end: translation; parameter r: N*s/m = 0; R oil : F = r*v; end -> oil }\nmodel A {\n  I mass : p = 4 kg*v\n  1 hub\n  Oil first\n  Oil oil\n  C spring : F = 2 [N/m]*x\n  hub -> mass, first.end, oil.end, spring\n  output v = oil.end.v, F = oil.end.F\n}\n"
    graph = compiled(text).graph
    assert {n.name for n in graph.nodes} == {"mass", "hub", "oil.oil", "spring"}
    assert outputs_of(compiled(text), {"mass.p": 1.0}) == {"v": 0.25, "F": 0.0}


def test_a_law_may_read_a_port() -> None:
    """A brake that pulls with 3 N*s/m times the speed of its model's port: 4 kg slow down as exp(-3/4 t)."""
    text = "model Brake { port end: translation; MSe pull : F = -3 [N*s/m]*end.v; pull -> end }\nmodel A {\n  I mass : p = 4 kg*v { start v = 1 [m/s] }\n  Brake brake\n  brake.end -> mass\n  output v = mass.v\n  experiment e { simulate 0 .. 2 s { rtol = 1e-9 } }\n}\n"
    found = bondgraph.load(text).simulate()
    assert found["v"] == pytest.approx(np.exp(-0.75 * found.time), abs=1e-8)


def test_components_of_a_multibond() -> None:
    text = "model Flex { port ends: planar; C spring(x, y, phi) : energy = 50 [N/m]*x^2 + 100 [N/m]*y^2 + 3 [N*m]*phi^2; ends => spring }\nmodel A {\n  Flex flex\n  I plate(x, y, phi) : energy = (x^2 + y^2)/(2*4 kg) + phi^2/(2*0.5 [kg*m^2])\n  splitter hand(x, y, phi)\n  1(plate.x) -> hand.x\n  1(plate.y) -> hand.y\n  1(plate.phi) -> hand.phi\n  hand => flex.ends\n  output F = flex.ends.y.F, v = flex.ends.y.v, M = flex.ends.phi.M, w = flex.ends.phi.omega\n}\n"
    state = {"flex.spring.y": 0.5, "flex.spring.phi": 0.25, "plate.y": 2.0, "plate.phi": 3.0}
    assert outputs_of(compiled(text), state) == {"F": 100.0, "v": 0.5, "M": 1.5, "w": 6.0}


def test_between_a_body_and_a_field() -> None:
    """At a mechanism's port the bond's signs hold too: the arrow leaves the joint, so the force is the spring's."""
    text = (
        LEG
        + "model A {\n  multibody m : planar { body a { mass = 4 kg, inertia = 1 [kg*m^2] }; slide rail : ground to a { along = 0 deg } }\n  Phase leg\n  m.rail -> leg.foot\n  output F = leg.foot.F, v = leg.foot.v, a = m.rail.v\n}\n"
    )
    found = outputs_of(compiled(text), {"m.rail.x": 0.5, "m.rail.x.v": 0.25})
    assert found == {"F": 4.0, "v": 0.25, "a": 0.25}


def test_a_plain_model_reads_e_and_f() -> None:
    text = "plain model Phase { port foot; C spring : e = 7*q; foot -> spring }\nplain model A {\n  I mass : p = 4*f\n  Phase leg\n  1(mass) -> leg.foot\n  output e = leg.foot.e, f = leg.foot.f\n}\n"
    assert outputs_of(compiled(text), {"leg.spring.q": 0.5, "mass.p": 1.0}) == {"e": 3.5, "f": 0.25}


def test_a_part_by_itself() -> None:
    """A model with an open port is valid alone, and a wrong letter in it is reported."""
    assert mistakes(LEG) == ()
    (found,) = mistakes(LEG.replace("foot.F*foot.v", "foot.x*foot.v"))
    assert found.code == "BG101" and "F, v" in found.help


class TestBackToText:
    def test_as_a_node_that_shows_the_same(self) -> None:
        text = (
            LEG
            + "model A {\n  I mass : p = 4 kg*v\n  Phase leg\n  mass_side -> leg.foot\n  0 mass_side\n  1(mass) -> mass_side\n  output F = leg.foot.F, v = leg.foot.v\n}\n"
        )
        flat = write_text(compiled(text).whole_graph)
        state = {"leg.spring.x": 0.5, "mass.p": 1.0}
        found = Running(compiled(flat)).outputs({"leg_spring.x": 0.5, "mass.p": 1.0})
        assert found == outputs_of(compiled(text), state) == {"F": 4.0, "v": 0.25}

    def test_what_no_node_shows_is_refused(self) -> None:
        """Between two 1-junctions nothing shows the effort."""
        text = (
            LEG + "model A {\n  I mass : p = 4 kg*v\n  Phase leg\n  1(mass) -> leg.foot\n  output F = leg.foot.F\n}\n"
        )
        with pytest.raises(CompilationFailed, match=r"BG705.*`F`.*`leg\.foot\.F`"):
            write_text(compiled(text).whole_graph)


def test_a_reading_runs_as_the_physics_says() -> None:
    """The work through the port over half a swing of an undamped leg is zero; over a quarter it is the kinetic energy."""
    text = (
        LEG
        + "model A {\n  I mass : p = 7 kg*v { start v = 2 [m/s] }\n  Phase leg { r = 0 }\n  1(mass) -> leg.foot\n  output W = integral(leg.foot.F*leg.foot.v, 0 J)\n  experiment e { simulate 0 .. 3.141592653589793 s { rtol = 1e-9, points = 3 } }\n}\n"
    )
    found = bondgraph.load(text).simulate()
    assert found["W"][1] == pytest.approx(14.0, rel=1e-7) and abs(found["W"][2]) < 1e-6
    assert math.isclose(found.time[1], math.pi / 2)


STAR = """model Star {
  "A mass with one soft leg for each port."
  parameter n = 3
  I mass : p = 2 kg*v
  1 centre
  centre -> mass
  for i in 1..n {
    port leg[i]: translation
    C pad[i] : F = i*5 [N/m]*x
    leg[i] -> 0(pad[i]) -> centre
  }
}
"""


class TestArrays:
    def test_a_port_in_each_round_of_a_loop(self) -> None:
        """The force through leg i is that of its pad, and moves the mass."""
        text = (
            STAR
            + "model A {\n  Star star { n = 2 }\n  for i in 1..2 {\n    Sf push[i] : v = i*0.1 [m/s]\n    push[i] -> star.leg[i]\n  }\n  output F1 = star.leg[1].F, F2 = star.leg[2].F, v = star.leg[2].v\n}\n"
        )
        running = Running(compiled(text))
        state = {"star.pad[1].x": 1.0, "star.pad[2].x": 2.0, "star.mass.p": 3.0}
        assert running.outputs(state) == {"F1": 5.0, "F2": 20.0, "v": 0.2}
        rates = Running(compiled(text, everything=True)).rates(state)
        assert rates["star.mass.p"] == 25.0 and rates["star.pad[2].x"] == pytest.approx(0.2 - 1.5)

    def test_ports_of_an_array_of_instances(self) -> None:
        text = (
            STAR
            + "model A {\n  for i in 1..2 { Star star[i] { n = 2 } }\n  star[1].leg[1] -> star[2].leg[2]\n  Sf a : v = 1 [m/s]\n  Sf b : v = 2 [m/s]\n  a -> star[1].leg[2]\n  b -> star[2].leg[1]\n  output F = star[2].leg[2].F, G = star[1].leg[1].F\n}\n"
        )
        assert [d.code for d in mistakes(text)] == ["BG121"]  # both arrows run into their stars: head-on in the first
        text = text.replace("star[1].leg[1] -> star[2].leg[2]", "R link : F = 3 [N*s/m]*v\n  1(link) -> star[1].leg[1], star[2].leg[2]")  # fmt: skip
        found = outputs_of(compiled(text), {"star[1].pad[1].x": 2.0, "star[2].pad[2].x": 0.5})
        assert found == {"F": 5.0, "G": 10.0}

    def test_multibonds_and_more_indices(self) -> None:
        text = "model Grid {\n  for i in 1..2 { for j in 1..2 {\n    port end[i, j]: planar\n    C spring[i, j](x, y, phi) : energy = i*j*(x^2 + y^2)*1 [N/m] + phi^2*1 [N*m]\n    end[i, j] => spring[i, j]\n  } }\n}\nmodel A {\n  Grid grid\n  for i in 1..2 { for j in 1..2 {\n    I plate[i, j](x, y, phi) : energy = (x^2 + y^2)/(2*1 kg) + phi^2/(2*1 [kg*m^2])\n    splitter hand[i, j](x, y, phi)\n    1(plate[i, j].x) -> hand[i, j].x\n    1(plate[i, j].y) -> hand[i, j].y\n    1(plate[i, j].phi) -> hand[i, j].phi\n    hand[i, j] => grid.end[i, j]\n  } }\n  output F = grid.end[2, 1].y.F\n}\n"
        assert mistakes(text) == ()
        names = compiled(text).program.states.names
        (state,) = [n for n in names if n.startswith("grid.spring[2") and n.endswith("1].y")]
        assert outputs_of(compiled(text), {state: 3.0}) == {"F": 12.0}

    def test_in_a_slot(self) -> None:
        """A model with an array of ports replaces another with one."""
        text = (
            STAR
            + STAR.replace("Star", "Hard").replace("i*5", "i*50")
            + "model A {\n  parameter Kind: model = Star\n  Kind part { n = 1 }\n  Sf push : v = 1 [m/s]\n  push -> part.leg[1]\n  output F = part.leg[1].F\n}\n"
        )
        assert outputs_of(compiled(text, model="A"), {"part.pad[1].x": 1.0}) == {"F": 5.0}
        assert outputs_of(compiled(text, {"Kind": "Hard"}, model="A"), {"part.pad[1].x": 1.0}) == {"F": 50.0}

    def test_a_file_of_parts_with_ports_in_loops(self) -> None:
        assert mistakes(STAR) == ()
