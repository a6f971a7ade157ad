"""The table "Decisions" of the language's tour, row by row, where this version covers it; rows about units, letters, names and
instances have their own files beside this one."""

from __future__ import annotations

import math

import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.segments.timeline import segments
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from tests.compiling import Running, compiled, mistake, mistakes


def running(text: str) -> Running:
    return Running(compiled(text, everything=True))


class TestSignOfEffortAndFlow:
    """Those of the bond; e*f is the power along its arrow."""

    @pytest.mark.parametrize(("arrow", "sign"), [("push -> body", 1.0), ("body -> push", -1.0)])
    def test_a_source(self, arrow: str, sign: float) -> None:
        text = f"model A {{\n  Se push : F = 5 N\n  1 body\n  I mass : p = 2 kg*v\n  {arrow}\n  body -> mass\n  output F = push.F, v = push.v, power = push.F*push.v\n}}\n"
        assert running(text).outputs({"mass.p": 6.0}) == {"F": 5.0, "v": 3.0, "power": 15.0}
        assert running(text).rates({"mass.p": 6.0}) == {"mass.p": sign * 5.0}

    def test_a_law_into_storage_and_loss_means_the_same_everywhere(self) -> None:
        text = "model A {\n  1 body\n  I mass : p = 2 kg*v\n  C spring : F = 8 [N/m]*x\n  R damper : F = 3 [N*s/m]*v\n  0 wall : translation\n  Sf hold : v = 0 [m/s]*1\n  hold -> wall\n  body -> mass\n  wall -> 1(damper2)\n  R damper2 : F = 1 [N*s/m]*v\n  body -> spring, damper\n}\n"
        rates = running(text).rates({"mass.p": 4.0, "spring.x": 1.0})
        assert rates["mass.p"] == -8.0 - 6.0

    def test_power_is_conserved_at_junctions(self) -> None:
        text = "model A {\n  Se s : u = 6 V\n  1 a\n  0 b\n  R r, t : u = 2 ohm*i\n  C c : u = q/1 F\n  I l : lambda = 3 H*i\n  s -> a -> r, b\n  b -> c, t, 1(l)\n  output total = s.u*s.i - r.u*r.i - c.u*c.i - t.u*t.i - l.u*l.i\n}\n"
        assert running(text).outputs({"c.q": 1.3, "l.lambda": 0.7})["total"] == pytest.approx(0.0, abs=1e-14)


class TestNamesOfStates:
    """Path and letter: `spring.x`, `mass.p`, `comb[2].folded.x`, `flexure[1].spring.phi`, `stage.guide[1].x`."""

    def test_all_of_them(self) -> None:
        text = """
model Comb {
  port end: translation
  C folded : F = 2 [N/m]*x
  end -> folded
}
model Flexure {
  port ends: planar
  C spring(x, y, phi) : energy = 1/2*(1 [N/m]*x^2 + 1 [N/m]*y^2 + 1 [N*m]*phi^2)
  ends => spring
}
model A {
  1 body, other
  I mass, more : p = 2 kg*v
  body -> mass
  other -> more
  for i in 1..2 {
    Comb comb[i]
  }
  body -> comb[1].end
  other -> comb[2].end
  Flexure flexure[1]
  1 a, b : translation
  1 c : rotation
  I m, n : p = 1 kg*v
  I j : p = 1 [kg*m^2]*omega
  a -> m, flexure[1].ends.x
  b -> n, flexure[1].ends.y
  c -> j, flexure[1].ends.phi
  multibody stage : planar {
    body shuttle[1] { mass = 1 kg }
    slide guide[1] : ground to shuttle[1] { along = 0 }
    body loose { mass = 1 kg, inertia = 1 [kg*m^2] }
  }
}
"""
        names = running(text).program.states.names
        assert {
            "mass.p",
            "comb[1].folded.x",
            "comb[2].folded.x",
            "flexure[1].spring.x",
            "flexure[1].spring.phi",
        } <= set(names)
        assert {
            "stage.guide[1].x",
            "stage.guide[1].x.v",
            "stage.loose.x",
            "stage.loose.phi",
            "stage.loose.phi.omega",
        } <= set(names)

    def test_q_and_p_are_always_accepted(self) -> None:
        text = "model A {\n  1 body\n  I mass : p = 2 kg*v\n  C spring : F = 8 [N/m]*x\n  body -> mass, spring\n  output a = spring.q - spring.x, b = mass.p\n}\n"
        assert running(text).outputs({"spring.x": 2.0, "mass.p": 3.0}) == {"a": 0.0, "b": 3.0}


class TestStarts:
    """Storage: zero; storage on a joint: unstressed in the reference; joints: at rest where they were drawn."""

    MECHANISM = "model A {{\n  multibody stage : planar {{\n    body shuttle {{ mass = 2 kg, at = (0.3 m, 0) }}\n    slide guide : ground to shuttle {{ along = 0{guide} }}\n  }}\n  C spring : F = 8 [N/m]*x {spring}\n  stage.guide -> spring\n  output x = stage.guide.x, F = spring.F, pose = stage.shuttle.x, stretch = spring.x\n}}\n"

    def test_what_is_not_said(self) -> None:
        found = running(self.MECHANISM.format(guide="", spring=""))
        assert found.starts() == {"stage.guide.x": 0.0, "stage.guide.x.v": 0.0}
        assert found.outputs() == {"x": 0.0, "F": 0.0, "pose": 0.3, "stretch": 0.0}

    def test_a_spring_on_a_joint_stores_its_coordinate(self) -> None:
        """It is not integrated a second time."""
        found = running(self.MECHANISM.format(guide="", spring=""))
        assert found.program.states.names == ("stage.guide.x", "stage.guide.x.v")
        assert found.rates({"stage.guide.x": 0.5}) == {"stage.guide.x": 0.0, "stage.guide.x.v": -2.0}

    def test_a_start_on_it_is_a_preload(self) -> None:
        found = running(self.MECHANISM.format(guide="", spring="{ start x = 10 mm }"))
        assert found.outputs() == {"x": 0.0, "F": pytest.approx(0.08), "pose": 0.3, "stretch": pytest.approx(0.01)}
        assert found.rates()["stage.guide.x.v"] == pytest.approx(-0.04)

    def test_a_start_of_the_joint(self) -> None:
        found = running(self.MECHANISM.format(guide=", start x = 20 mm, start x.v = 3 [m/s]", spring=""))
        assert found.starts() == {"stage.guide.x": 0.02, "stage.guide.x.v": 3.0}
        assert found.outputs()["F"] == pytest.approx(0.16)

    def test_contradictory_starts_are_told(self) -> None:
        """Two masses on one flow that start differently."""
        text = "model A {\n  1 body\n  I m : p = 2 kg*v { start v = 1 [m/s] }\n  I n : p = 3 kg*v { start v = 2 [m/s] }\n  body -> m, n\n}\n"
        with pytest.raises(RunFailed, match="cannot hold"):
            bondgraph.load(text).simulate(to=1)


class TestFrames:
    """A body's frame is in its centre of mass; its pose is absolute, a joint's coordinate relative."""

    def test_pose_absolute_coordinate_relative(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body arm { mass = 1 kg, inertia = 1 [kg*m^2], at = (2 m, 1 m), angle = 90 deg }\n    hinge pin : ground to arm { at = (1 m, 1 m) }\n    frame tip : arm { at = (3 m, 1 m) }\n  }\n  output phi = m.pin.phi, x = m.arm.x, y = m.arm.y, turn = m.arm.phi, tx = m.tip.x, ty = m.tip.y\n}\n"
        found = running(text)
        assert found.outputs() == pytest.approx(
            {"phi": 0.0, "x": 2.0, "y": 1.0, "turn": math.pi / 2, "tx": 3.0, "ty": 1.0}, abs=1e-15
        )
        turned = found.outputs({"m.pin.phi": math.pi / 2})
        assert turned == pytest.approx(
            {"phi": math.pi / 2, "x": 1.0, "y": 2.0, "turn": math.pi, "tx": 1.0, "ty": 3.0}, abs=1e-15
        )

    def test_the_moment_of_inertia_is_about_the_centre(self) -> None:
        """A rod on a pin through its end: Steiner adds m r^2."""
        text = "model A {\n  multibody m : planar {\n    body arm { mass = 3 kg, inertia = 5 [kg*m^2], at = (2 m, 0) }\n    hinge pin : ground to arm { at = (0, 0) }\n  }\n  Se push : M = 34 [N*m]\n  push -> m.pin\n}\n"
        assert running(text).rates()["m.pin.phi.omega"] == pytest.approx(34.0 / (5 + 3 * 4))

    @pytest.mark.parametrize(
        ("axes", "expected"), [("from", (0.0, 1.0)), ("to", (1.0, 0.0)), ("middle", (math.sqrt(0.5), math.sqrt(0.5)))]
    )
    def test_axes_of_a_free_joint(self, axes: str, expected: tuple[float, float]) -> None:
        """The second body one metre up and turned by a quarter: up is y of the first, x of the second, both of the middle."""
        text = (
            "model A {\n  multibody m : planar {\n    body b { mass = 1 kg, inertia = 1 [kg*m^2] }\n    free chord : ground to b { axes = %s }\n  }\n  output x = m.chord.x, y = m.chord.y, phi = m.chord.phi\n}\n"
            % axes
        )
        found = running(text).outputs({"m.b.y": 1.0, "m.b.phi": math.pi / 2})
        assert (found["x"], found["y"]) == pytest.approx(expected, abs=1e-15)
        assert found["phi"] == pytest.approx(math.pi / 2)

    @pytest.mark.parametrize("axes", ["from", "to", "middle"])
    def test_the_effort_of_a_free_joint_is_dual_to_its_rates(self, axes: str) -> None:
        """An energy in its coordinates is exact: the spring stores what the body loses, at any pose."""
        text = (
            "model A {\n  multibody m : planar {\n    body b { mass = 2 kg, inertia = 3 [kg*m^2] }\n    free chord : ground to b { at = (1 m, 2 m), angle = 30 deg, axes = %s }\n  }\n"
            "  C leaf(x, y, phi) : energy = 1/2*(5 [N/m]*x^2 + 7 [N/m]*y^2 + 11 [N*m]*phi^2) + 2 [N/m]*x*y\n  m.chord => leaf\n"
            "  output power = leaf.x.F*leaf.x.v + leaf.y.F*leaf.y.v + leaf.phi.M*leaf.phi.omega\n}\n" % axes
        )
        found = running(text)
        state = {"m.b.x": 0.3, "m.b.y": -0.4, "m.b.phi": 0.7, "m.b.x.v": 1.1, "m.b.y.v": -0.6, "m.b.phi.omega": 0.9}
        rates = found.rates(state)
        kinetic = 2 * (1.1 * rates["m.b.x.v"] - 0.6 * rates["m.b.y.v"]) + 3 * 0.9 * rates["m.b.phi.omega"]
        assert found.outputs(state)["power"] == pytest.approx(-kinetic, rel=1e-12)

    def test_a_is_pushed_back_where_b_is_pushed_forward(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body a { mass = 2 kg }\n    body b { mass = 3 kg }\n    slide one : ground to a { along = 0 }\n    slide two : a to b { along = 0 }\n  }\n  Se push : F = 6 N\n  push -> m.two\n  output va = m.a.x.v, vb = m.b.x.v, v = m.two.x.v\n}\n"
        rates = running(text).rates()
        a, relative = rates["m.one.x.v"], rates["m.two.x.v"]
        assert (2 * a, 3 * (a + relative)) == pytest.approx((-6.0, 6.0))


class TestStructureByParameters:
    def test_ranges_and_lengths_set_from_outside(self) -> None:
        text = "model A {\n  parameter n = 2, k: N/m = (1, 2, 3, 4)\n  1 body\n  I mass : p = 1 kg*v\n  body -> mass\n  for i in 1..n {\n    C c[i] : F = k[i]*x\n    body -> c[i]\n  }\n}\n"
        assert len(running(text).program.states.names) == 2
        assert len(compiled(text).state_space.following) == 1
        more = Running(compiled(text, {"n": "4"}, everything=True))
        assert more.rates({"c[1].x": 1.0})["mass.p"] == -10.0  # whose state the others share


class TestConditions:
    """Known instants of conditions on time; both sides of a condition in laws and signals."""

    def test_instants_of_time(self) -> None:
        text = "model A {\n  parameter t1 = 2 s\n  input u = 1 N*step(time - 0.5 s) + 2 N*pulse(time, 1 s, t1) + 1 N*ramp(time, 3 s, 4 s) + (1 N if 2*time > 10 s else 0)\n  output y = u\n}\n"
        running = Running(compiled(text))
        found = segments(running.program, running.constants, 0.0, 10.0)
        assert [s.stop for s in found] == pytest.approx([0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 10.0], rel=1e-14)
        values = [running.outputs(time=t)["y"] for t in (0.4, 0.6, 1.5, 2.5, 3.5, 4.5, 6.0)]
        assert values == [0.0, 1.0, 3.0, 1.0, 1.5, 2.0, 3.0]

    def test_a_choice_on_a_state(self) -> None:
        text = "model A {\n  1 body\n  I mass : p = 1 kg*v\n  C tyre : F = 8 [N/m]*x if x > 0 else 0\n  body -> mass, tyre\n}\n"
        assert running(text).rates({"tyre.x": 2.0})["mass.p"] == -16.0
        assert running(text).rates({"tyre.x": -2.0})["mass.p"] == 0.0


class TestNothingIsDroppedInSilence:
    @pytest.mark.parametrize(
        "statement",
        [
            "when mass.v > 1 [m/s] { mass.v = 0 [m/s] }", "mode resting = false", "multibody m : spatial { body b { mass = 1 kg, inertia = 1 [kg*m^2]*(1, 1, 1) } }", "function f(x) = x",
            "multibody m : planar {\n body a { mass = 1 kg, inertia = 1 [kg*m^2] }\n body b { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }\n distance d : a to b\n }",
        ],
    )  # fmt: skip
    def test_what_is_not_supported_yet_is_an_error_with_its_place(self, statement: str) -> None:
        """Or it is supported by now: then it compiles."""
        text = f"model A {{\n  1 body : translation\n  I mass : p = 1 kg*v\n  body -> mass\n  {statement}\n}}\n"
        found = mistakes(text)
        if found:
            assert {d.code for d in found} <= {"BG130", "BG201"} and all(d.span.line >= 5 and d.help for d in found)
        else:
            assert compiled(text, everything=True).program.states.names

    def test_a_loop_of_bodies_that_needs_constraints(self) -> None:
        text = "model A {\n  multibody bars : planar {\n    body a { mass = 1 kg, inertia = 1 [kg*m^2] }\n    body b { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }\n    hinge h1 : ground to a { at = (0, 0) }\n    hinge h2 : a to b { at = (1 m, 0) }\n    hinge h3 : b to ground { at = (2 m, 0) }\n  }\n  output x = bars.b.x\n}\n"
        assert mistakes(text) == ()
        assert compiled(text).program.invariants.names  # its gaps


def test_an_unsupported_joint_is_told_with_those_that_exist() -> None:
    text = "model A {\n  multibody m : planar {\n    body a { mass = 1 kg }\n    hing pin : ground to a { at = (0, 0) }\n  }\n  output y = 1\n}\n"
    assert "`hinge`" in mistake(text, "BG140").help


def test_all_errors_of_a_file_are_reported_together() -> None:
    text = "model Part {\n  parameter k = 1 kg + 1 m\n  output y = k\n}\nmodel A {\n  Part p\n  parameter a = b\n  1 body : translation\n  I m : p = 2*v\n  body -> m, nothing\n  output z = 2 m + 3 s\n  experiment e { simulate 0 .. 1 m }\n}\n"
    assert sorted({d.span.line for d in mistakes(text)}) == [2, 7, 9, 10, 11, 12]


def test_one_mistake_in_a_definition_is_told_once() -> None:
    text = "model Part {\n  parameter k = 1\n  output y = k + 1 m\n}\nmodel A {\n  for i in 1..5 { Part p[i] }\n  output z = p[1].k\n}\n"
    assert [d.span.line for d in mistakes(text)] == [3]


def test_a_compilation_raises_all_that_check_finds() -> None:
    text = "model A {\n  parameter a = b, c = d\n  output y = a\n}\n"
    with pytest.raises(CompilationFailed) as failed:
        _ = Compilation(compiled(text).source, compiled(text).scene).whole_graph
    assert [d.span.text for d in failed.value.diagnostics] == [d.span.text for d in mistakes(text)] == ["b", "d"]
