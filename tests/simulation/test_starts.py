"""Starts: those of an experiment in place of the model's, and those of variables that depend on other coordinates."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph
from bondgraph import CompilationFailed
from bondgraph.errors import RunFailed
from tests.compiling import MODELS, compiled, mistakes


def at_start(text: str, experiment: str, *outputs: str) -> list[float]:
    """Outputs at the first instant of an experiment."""
    found = bondgraph.load(text).simulate(experiment, points=2)
    return [float(found[name][0]) for name in outputs]


STORAGES = """model Cell {
  port end: translation
  parameter rest = 1 mm
  C spring : F = 3 [N/m]*x { start x = rest }
  end -> spring
}
model A {
  parameter far = 3 mm
  for i in 1..2 { Cell cell[i] }
  I mass(a, b) : energy = a^2/(2*2 kg) + b^2/(2*4 kg) { start a = 7 [N*s], start b = 8 [N*s] }
  1(mass.a) -> cell[1].end
  1(mass.b) -> cell[2].end
  signal place = integral(mass.a.v, 5 m)
  output x1 = cell[1].spring.x, x2 = cell[2].spring.x, a = mass.a, b = mass.b, at = place
  experiment plain { simulate 0 .. 1 s }
  experiment other {
    start cell[2].spring.x = 2*far
    start mass.b.p = 12 [N*s]
    start place = far
    simulate 0 .. 1 s
  }
  experiment by_effort { start cell[1].spring.F = 6 mN; simulate 0 .. 1 s }
}
"""


class TestExperiments:
    def test_the_model_s_own_hold_where_nothing_is_said(self) -> None:
        assert at_start(STORAGES, "plain", "x1", "x2", "a", "b", "at") == [0.001, 0.001, 7.0, 8.0, 5.0]

    def test_storages_field_ports_and_integrals(self) -> None:
        assert at_start(STORAGES, "other", "x1", "x2", "a", "b", "at") == [0.001, 0.006, 7.0, 12.0, 0.003]

    def test_by_what_the_law_turns_into_the_stored_one(self) -> None:
        assert at_start(STORAGES, "by_effort", "x1", "x2") == [pytest.approx(0.002, rel=1e-14), 0.001]

    def test_a_value_may_read_what_is_set(self) -> None:
        found = bondgraph.load(STORAGES).simulate("other", {"far": "4 mm"}, points=2)
        assert found["x2"][0] == 0.008 and found["at"][0] == 0.004

    def test_a_run_from_there(self) -> None:
        """A mass of 2 kg on 3 N/m from 2 mm at rest: 2 mm cos(w t)."""
        text = "model A {\n  C spring : F = 3 [N/m]*x\n  I mass : p = 2 kg*v { start v = 9 [m/s] }\n  1(mass) -> spring\n  output x = spring.x\n  experiment e { start spring.x = 2 mm; start mass.v = 0; simulate 0 .. 4 s { rtol = 1e-9 } }\n}\n"
        found = bondgraph.load(text).simulate()
        assert found["x"] == pytest.approx(2e-3 * np.cos(math.sqrt(1.5) * found.time), abs=1e-10)

    @pytest.mark.parametrize(
        ("step", "code", "word"),
        [
            ("start spring.y = 1 mm", "BG101", "x"), ("start sprnig.x = 1 mm", "BG101", "spring"), ("start spring.x = 1 N", "BG103", "m"),
            ("start spring.v = 1 [m/s]", "BG150", "start spring.x"), ("start mass.F = 1 N", "BG150", "start mass.p"), ("start loss.v = 1 [m/s]", "BG150", "stores nothing"),
            ("start body.v = 1 [m/s]", "BG150", "stores nothing"), ("start k = 1 [N/m]", "BG150", "set"), ("start twice = 1 m", "BG150", "integral"),
            ("start spring.x = 1 m; start spring.F = 2 N", "BG150", "one of the two"), ("start spring.x = time*1 [m/s]", "BG106", ""),
            ("start arm.pin.M = 1 [N*m]", "BG150", "phi"), ("start arm.rod = 1 m", "BG111", ""), ("start arm.pin.phi = 1 m", "BG103", ""),
        ],
    )  # fmt: skip
    def test_wrong_ones(self, step: str, code: str, word: str) -> None:
        text = (
            "model A {\n  parameter k: N/m = 3\n  C spring : F = k*x\n  I mass : p = 2 kg*v\n  R loss : F = 1 [N*s/m]*v\n  1 body : translation\n"
            "  body -> mass, spring, loss\n  signal twice = 2*spring.x\n  output x = twice\n"
            "  multibody arm : planar { body rod { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }; hinge pin : ground to rod { at = (0, 0) } }\n"
            f"  experiment e {{ {step}; simulate 0 .. 1 s }}\n}}\n"
        )
        found = mistakes(text)
        assert [d.code for d in found] == [code], [d.sentence for d in found]
        assert word in found[0].help and found[0].span.line == 11


CHAIN = """model A {
  multibody m : planar {
    body a { mass = 1 kg, inertia = 1 [kg*m^2] }
    body b { mass = 1 kg, inertia = 1 [kg*m^2] }
    slide first  : ground to a { along = 0 deg }
    slide second : ground to b { along = 0 deg }
    free gap     : a to b      { start x = 4 mm, start x.v = 6 [m/s] }
  }
  output a = m.first.x, b = m.second.x, va = m.first.v, vb = m.second.v
  experiment least { simulate 0 .. 1 ms }
  experiment held { start m.first.x = 1 mm; start m.second.v = 2 [m/s]; simulate 0 .. 1 ms }
  experiment never { start m.first.x = 1 mm; start m.second.x = 2 mm; simulate 0 .. 1 ms }
}
"""

ARM = """model A {
  multibody m : planar {
    body rod { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }
    body bob { mass = 1 kg, inertia = 1 [kg*m^2], at = (2 m, 0) }
    hinge pin   : ground to rod { at = (0, 0) }
    hinge elbow : rod to bob    { at = (1.5 m, 0) }
    frame tip   : bob           { at = (2.5 m, 0), start x = 0.5 m, start y = 1.2 m, start y.v = 1 [m/s] }
  }
  output x = m.tip.x, y = m.tip.y, vx = m.tip.x.v, vy = m.tip.y.v, pin = m.pin.phi, elbow = m.elbow.phi
  experiment reach { start m.tip.x.v = 0; simulate 0 .. 1 ms }
  experiment too_far { start m.tip.y = 2.7 m; simulate 0 .. 1 ms }
}
"""


class TestMechanisms:
    def test_two_carts_share_what_their_distance_asks(self) -> None:
        """4 mm between two carts that were drawn in one place: 2 mm each, the least movement."""
        found = at_start(CHAIN, "least", "a", "b", "va", "vb")
        assert found == pytest.approx([-0.002, 0.002, -3.0, 3.0], rel=1e-12)

    def test_what_is_given_stays(self) -> None:
        found = at_start(CHAIN, "held", "a", "b", "va", "vb")
        assert found == pytest.approx([0.001, 0.005, -4.0, 2.0], rel=1e-12) and found[0] == 0.001 and found[3] == 2.0

    def test_contradictions_are_named(self) -> None:
        with pytest.raises(RunFailed, match=r"`m\.gap\.x`.*line 7.*`m\.first\.x`.*`m\.second\.x`"):
            bondgraph.load(CHAIN).simulate("never")

    @pytest.mark.machine_code
    def test_a_frame_at_the_end_of_an_arm_that_was_drawn_stretched_out(self) -> None:
        """Angles from the law of cosines; the straight pose, where nothing moves the tip inwards, is no obstacle."""
        x, y, vx, vy, pin, elbow = at_start(ARM, "reach", "x", "y", "vx", "vy", "pin", "elbow")
        assert (x, y, vy) == pytest.approx((0.5, 1.2, 1.0), rel=1e-10) and vx == pytest.approx(0, abs=1e-10)
        bend = math.pi - math.acos((1.5**2 + 1 - 1.3**2) / (2 * 1.5))
        assert abs(elbow) == pytest.approx(bend, rel=1e-10)
        aim = math.atan2(1.2, 0.5) - math.atan2(math.sin(elbow), 1.5 + math.cos(elbow))
        assert pin == pytest.approx(aim, rel=1e-10)

    @pytest.mark.machine_code
    def test_out_of_reach(self) -> None:
        with pytest.raises(RunFailed, match=r"the start of .*`m\.tip\.y`"):
            bondgraph.load(ARM).simulate("too_far")

    def test_a_single_constraint_holds_at_the_start(self) -> None:
        """A bob on a rod of 1 m, drawn at 3 : 4 and started at 4 : 3."""
        text = "model A {\n  multibody m : planar { body bob { mass = 1 kg, at = (0.8 m, -0.6 m), start x = 0.6 m }; frame pin : ground { at = (0, 0) }; rod line : pin to bob }\n  output x = m.bob.x, y = m.bob.y\n  experiment e { simulate 0 .. 1 ms }\n}\n"
        assert at_start(text, "e", "x", "y") == pytest.approx([0.6, -0.8], rel=1e-12)

    def test_many_contradictions_have_four_numbers(self) -> None:
        frames = "; ".join(f"frame f{i} : a {{ at = (0, 0), start x = {i} mm }}" for i in range(7))
        text = "model A {\n  multibody m : planar { body a { mass = 1 kg, inertia = 1 [kg*m^2] }; slide rail : ground to a { along = 0 deg }; FRAMES }\n  output x = m.a.x\n}\n"
        with pytest.raises(RunFailed, match="cannot hold together") as caught:
            bondgraph.load(text.replace("FRAMES", frames)).simulate(to="1 ms")
        told = str(caught.value)
        assert told.count("` = ") == 4 and all(f"`m.f{i}.x`" in told for i in range(7))

    def test_a_direction_in_which_nothing_can_move(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body a { mass = 1 kg, inertia = 1 [kg*m^2], start y = 2 mm }\n    slide rail : ground to a { along = 0 deg }\n  }\n  output x = m.a.x\n  experiment e { simulate 0 .. 1 ms }\n}\n"
        with pytest.raises(RunFailed, match=r"`m\.a\.y` \(line 3\) cannot hold"):
            bondgraph.load(text).simulate()

    def test_a_mass_that_hangs_on_a_joint_brings_it_along(self) -> None:
        """Its momentum follows from the joint's rate, which nobody gave: so the rate follows from the momentum."""
        text = "model A {\n  multibody m : planar {\n    body a { mass = 1 kg, inertia = 1 [kg*m^2] }\n    slide rail : ground to a { along = 30 deg }\n  }\n  I load : p = 3 kg*v { start v = 2 [m/s] }\n  m.rail -> load\n  output v = m.rail.v, vx = m.a.x.v\n  experiment e { simulate 0 .. 1 s }\n}\n"
        found = bondgraph.load(text).simulate()
        assert found["v"] == pytest.approx(2.0, rel=1e-12)
        assert found["vx"] == pytest.approx(2 * math.cos(math.pi / 6), rel=1e-12)

    def test_legs_follow_the_platform_of_a_manipulator(self, tmp_path: Path) -> None:
        """The platform's pose and motion are given, and the flexures have no offset across the legs, which gives the positions of the shuttles.

        The position of a leg is the platform's shift at its attachment, along the guide: exactly, for a finite turn.
        """
        text = (MODELS / "manipulator.bg").read_text(encoding="utf-8").rstrip().removesuffix("}")
        pose = {"x": 3e-6, "y": -2e-6, "phi": 5e-3, "x.v": 1e-3, "y.v": 2e-3, "phi.omega": 4.0}
        steps = [f"start stage.platform.{n} = {v!r}{units(n)}" for n, v in pose.items()]
        steps += [f"start stage.flex[{i}].y = 0; start stage.flex[{i}].y.v = 0" for i in (1, 2, 3)]
        text += f"  experiment pose {{ {'; '.join(steps)}; simulate 0 .. 1 us; report stage.guide[1].x, stage.guide[2].x, stage.guide[3].x, stage.guide[1].v, stage.guide[2].v, stage.guide[3].v }}\n}}\n"
        shutil.copy(MODELS / "mems.bg", tmp_path)
        file = tmp_path / "manipulator.bg"
        file.write_text(text, encoding="utf-8")
        found = bondgraph.load(file).simulate("pose", points=2)
        graph = compiled(file, experiment="pose").graph
        a, s = (graph.quantities[n].value for n in ("a", "s"))
        assert a is not None and s is not None
        turn = np.array([[math.cos(5e-3), -math.sin(5e-3)], [math.sin(5e-3), math.cos(5e-3)]])
        for i in (1, 2, 3):
            arm = 2 * math.pi / 3 * (i - 1)
            along = np.array([-math.sin(arm), math.cos(arm)])
            point = a * np.array([math.cos(arm), math.sin(arm)]) - s * along
            lever = turn @ point
            shift = np.array([3e-6, -2e-6]) + lever - point
            speed = np.array([1e-3 - 4.0 * lever[1], 2e-3 + 4.0 * lever[0]])
            assert found.values[0][i - 1] == pytest.approx(along @ shift, rel=1e-9)
            assert found.values[0][i + 2] == pytest.approx(along @ speed, rel=1e-9)


def units(name: str) -> str:
    return {"phi": "", "phi.omega": " [1/s]"}.get(name, " [m/s]" if name.endswith(".v") else " m")


def test_an_unknown_experiment_start_does_not_run() -> None:
    with pytest.raises(CompilationFailed, match="BG101"):
        bondgraph.load("model A {\n  C c : F = 1 [N/m]*x\n  Sf s : v = 0\n  s -> c\n  output x = c.x\n  experiment e { start d.x = 1 m; simulate 0 .. 1 s }\n}\n").simulate()  # fmt: skip


CURVED_START = """model Curved {{
  parameter s = 1, t = 1
  C near : u = t*q/1 [F] + s*3 V*(t*q/(s*1 [C]))^3 {{ start u = s*{start} [V] }}
  R load : i = 1/t*u/2 [ohm]
  0 node : electric
  node -> near, load
  output u = near.u, q = near.q
}}"""


@pytest.mark.parametrize("start", [0.3, 30])
@pytest.mark.parametrize(
    ("s", "t"), [(1.0, 1.0), (1e-15, 1.0), (1e-20, 1e9), (1e12, 1.0), (1e6, 1e-9), (1e12, 1e-9), (1.0, 1e-9)]
)
def test_a_start_of_a_curved_law_has_no_size_of_its_own(start: float, s: float, t: float) -> None:
    """Charges from 1e-29 C to 1e21 C: a difference over 1e-9 C found no slope, and the start was refused."""
    run = bondgraph.load(CURVED_START.format(start=start)).simulate(settings={"s": s, "t": t}, to=1.2, points=2)
    charge = brentq(lambda q: q + 3 * q**3 - start, 0, 10, xtol=1e-15)
    assert run["u"][0] / s == pytest.approx(start, rel=1e-9) and run["q"][0] / s * t == pytest.approx(charge, rel=1e-9)


@pytest.mark.parametrize(
    "starts, momenta",
    [
        ("start x.v = 1 [m/s]", (1.0, 0.0)), ("start y.v = 1 [m/s]", (0.0, 1.0)), ("start x.v = 1 [m/s], start y.p = 0", (1.0, 0.0)),
        ("start x.v = 1 [m/s], start y.p = 2 [N*s]", (-0.2, 2.0)), ("start x.v = 1 [m/s], start y.v = 0", (1 / 0.64, -0.6 / 0.64)),
        ("start x.v = 1 [m/s], start y.v = 3 [m/s]", (-1.25, 3.75)), ("start x.p = 1 [N*s]", (1.0, 0.0)),
    ],
)  # fmt: skip
def test_the_start_of_a_port_of_a_field_moves_that_port_alone(starts: str, momenta: tuple[float, float]) -> None:
    """v = (px + 0.6 py, 0.6 px + py)/(1 kg): what a port is not said to have is zero, and not shared with another."""
    text = f"""model A {{
      I body(x: translation, y: translation) : energy = 0.5*(x^2 + y^2 + 1.2*x*y)/(1 kg) {{ {starts} }}
      Se a, b : F = 0 N
      a -> body.x
      b -> body.y
      output px = body.x.p, py = body.y.p
      experiment e {{ simulate 0 .. 1 ms }}
    }}"""
    assert at_start(text, "e", "px", "py") == pytest.approx(momenta, rel=1e-12, abs=1e-15)


def test_a_start_that_the_port_alone_cannot_have_is_refused() -> None:
    """vx = py/(1 kg): px does not change it, and py is zero as nothing says otherwise."""
    text = """model A {
      I body(x: translation, y: translation) : energy = x*y/(1 kg) { start x.v = 1 [m/s] }
      Se a, b : F = 0 N
      a -> body.x
      b -> body.y
      output px = body.x.p, py = body.y.p
      experiment e { simulate 0 .. 1 ms }
    }"""
    with pytest.raises(RunFailed, match=r"the start of `body` \(line 2\) cannot hold"):
        at_start(text, "e", "px")
    assert at_start(text.replace("1 [m/s]", "1 [m/s], start y.v = 2 [m/s]"), "e", "px", "py") == pytest.approx(
        [2.0, 1.0]
    )


@pytest.mark.parametrize(("volt", "total"), [(0.1, 1.0), (0.1, 1e9), (0.5, 1.0)])
def test_a_start_that_holds_but_for_rounding_has_no_size(volt: float, total: float) -> None:
    """0.1 V + 0.2 V are not 0.3 V: the residual of 6e-17 V was taken for what the states have to move, and the other start was refused."""
    text = """model T {
  parameter v = 0.1 V, sum = 1 V
  Se s : u = v + 0.2 V
  C c1 : u = q/1 [F]
  C c2 : u = q/2 [F]
  C a : u = q/1 [F] { start u = 0.3 V; prefer = derivative }
  C b : u = q/1 [F] { start u = sum; prefer = derivative }
  TF t : u1 = u2
  0 n1, n2 : electric
  1 la, lb : electric
  s -> la -> a
  n1 -> c1
  n2 -> c2
  n1 -> la -> n2
  n2 -> t -> lb
  n1 -> lb -> b
  output u1 = c1.u, u2 = c2.u
}"""
    found = bondgraph.load(text).simulate(settings={"v": volt, "sum": total}, to=1e-9, points=2, target="numpy")
    assert found["u1"][0] == pytest.approx((total + 0.1 - volt) / 2, rel=1e-8)
    assert found["u2"][0] == pytest.approx((total - 0.1 + volt) / 2, rel=1e-8)


@pytest.mark.parametrize(
    ("condition", "end"),
    [(c, math.exp(-1)) for c in ("c.q > level", "level < c.q", "not c.q <= level")]
    + [(c, 5 - 4 * math.exp(-2)) for c in ("c.q >= level", "not c.q < level")],
)
def test_a_junction_on_its_threshold_begins_as_it_is_written(condition: str, end: float) -> None:
    """Off, the charge falls; on, it rises: either goes on as it begins, so the letter of the condition decides."""
    text = f"""plain model Tie {{
  parameter level = 0.3
  C c : e = q {{ start q = 0.3 }}
  R leak : e = f
  R feed : e = f
  Se supply : e = 3
  1 w {{ active = {condition} }}
  supply -> w -> feed
  0 node
  w -> node -> c, leak
  output q = c.q/0.3
}}
"""
    found = bondgraph.load(text).simulate(to=1, points=2, rtol=1e-9)
    assert found["q"][-1] == pytest.approx(end, rel=1e-7)


@pytest.mark.parametrize(("operator", "end"), [(">", math.exp(-0.5)), (">=", 5 - 4 * math.exp(-1))])
@pytest.mark.parametrize("start", [0.5, 1.5])
def test_a_junction_that_an_event_sets_onto_its_threshold(operator: str, end: float, start: float) -> None:
    """What rounding hides is for the program of the junctions that the letter of the condition calls for, not for that before."""
    text = f"""plain model Tie {{
  C c : e = q {{ start q = {start} }}
  R leak : e = f
  R feed : e = f
  Se supply : e = 10
  1 w {{ active = c.q {operator} 1 }}
  supply -> w -> feed
  0 node
  w -> node -> c, leak
  every 1 offset 0.5 {{ c.q = 1 }}
  output q = c.q
}}
"""
    found = bondgraph.load(text).simulate(to=1, points=2, solver="explicit", rtol=1e-9)
    assert found["q"][-1] == pytest.approx(end, rel=1e-7)
