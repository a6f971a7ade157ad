"""`multibody` blocks, from text to the mechanism as it was drawn: numbers first."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import numpy as np
import pytest

import bondgraph
from compiler.algebra.expression import evaluate
from compiler.algebra.formula import Bound
from compiler.compilation import Compilation
from compiler.graph.inertia import inertia_notes, principal_moments
from compiler.graph.mechanism import Body, Frame, Joint, Mechanism, domain_of, freedoms_of, reactions_of
from compiler.graph.network import MechanismNode, Quantity, Reading
from tests.compiling import compiled, mistake, mistakes

BODIES = """
    body a { mass = 1 kg }
    body b { mass = 1 kg, at = (1 m, 0, 0) }
    body c { mass = 1 kg, at = (2 m, 0, 0) }
"""


def built(statements: str, space: str = "spatial", around: str = "") -> Compilation:
    return compiled(f"model M {{\n{around}\n multibody arm : {space} {{\n{statements}\n }}\n}}\n")


def drawn(statements: str, space: str = "spatial", around: str = "") -> tuple[Mechanism, Compilation]:
    """The mechanism of a block."""
    compilation = built(statements, space, around)
    (node,) = [n for n in compilation.whole_graph.nodes if isinstance(n, MechanismNode)]
    return node.mechanism, compilation


def number(bound: Bound, compilation: Compilation) -> float:
    def value(key: int) -> float:
        argument = bound.arguments[key]
        if isinstance(argument, Quantity):
            argument = compilation.whole_graph.quantities[argument.name].value
        assert isinstance(argument, float)
        return argument

    return evaluate(bound.formula.expression, value)


def numbers(bounds: tuple[Bound, ...], compilation: Compilation) -> list[float]:
    return [number(b, compilation) for b in bounds]


def joint(statement: str, space: str = "spatial") -> tuple[Joint, Compilation]:
    """The last joint of a block with three bodies."""
    bodies = BODIES if space == "spatial" else BODIES.replace(", 0)", ")")
    mechanism, compilation = drawn(bodies + statement, space)
    return mechanism.joints[-1], compilation


class TestBodies:
    def test_in_space(self) -> None:
        mechanism, compilation = drawn(
            """
            gravity = (0, 1 [m/s^2], -9.81 [m/s^2])
            body top { mass = m, inertia = J, at = (1 mm, 2 mm, 3 mm), turn = (0, 0, 90 deg), start rx.omega = 3 [1/s], start z = 4 mm }
            body disc { inertia = 2 [kg*m^2]*(1, 1, 2), start attitude = (0.6, 0.8, 0, 0) }
            """,
            around="parameter m = 2 kg, J: kg*m^2 = (1, 2, 2.5, 0.1, 0.2, 0.3)",
        )
        top, disc = mechanism.bodies
        assert not mechanism.planar
        assert numbers(mechanism.gravity, compilation) == [0, 1, -9.81]
        assert number(top.mass, compilation) == 2
        assert numbers(tuple(getattr(top.inertia, n) for n in ("xx", "yy", "zz", "xy", "xz", "yz")), compilation) == [
            1, 2, 2.5, 0.1, 0.2, 0.3,
        ]  # fmt: skip
        assert numbers(top.position, compilation) == [0.001, 0.002, 0.003]
        assert numbers(top.turn, compilation) == pytest.approx([0, 0, math.pi / 2], rel=1e-15)
        assert {k: number(v, compilation) for k, v in top.starts.items()} == {"rx.f": 3, "z": 0.004}
        assert numbers((disc.inertia.xx, disc.inertia.zz, disc.inertia.xy, disc.mass), compilation) == [2, 4, 0, 0]
        assert {k: number(v, compilation) for k, v in disc.starts.items()} == {
            "attitude.w": 0.6, "attitude.x": 0.8, "attitude.y": 0, "attitude.z": 0,
        }  # fmt: skip

    def test_in_the_plane_z_is_zero(self) -> None:
        mechanism, compilation = drawn(
            "gravity = (0, -9.81 [m/s^2])\nbody a { mass = 1 kg, inertia = 3 [kg*m^2], at = (1 m, 2 m), angle = 30 deg }",
            "planar",
        )
        (body,) = mechanism.bodies
        assert mechanism.planar
        assert numbers(mechanism.gravity, compilation) == [0, -9.81, 0]
        assert numbers(body.position, compilation) == [1, 2, 0]
        assert numbers(body.turn, compilation) == pytest.approx([0, 0, math.pi / 6], rel=1e-15)
        assert numbers((body.inertia.xx, body.inertia.yy, body.inertia.zz), compilation) == [0, 0, 3]

    @pytest.mark.parametrize("seed", range(30))
    def test_principal_moments(self, seed: int) -> None:
        """Against numpy, also where two or three are equal."""
        rng = random.Random(seed)
        values = [rng.uniform(0, 3) for _ in range(3)]
        if seed % 3 == 1:
            values[1] = values[0]
        if seed % 10 == 2:
            values = [values[0]] * 3
        matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
        tensor = matrix @ np.diag(values) @ matrix.T
        found = principal_moments([tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]])
        assert all(a <= b + 1e-12 for a, b in pairwise(found))
        assert found == pytest.approx(sorted(values), abs=3e-7)
        assert sum(found) == pytest.approx(sum(values), rel=1e-14)

    @pytest.mark.parametrize(
        ("inertia", "told"),
        [
            ("(1, 1, 2)", 0), ("(0, 0, 1)", 0), ("(0, 0, 0)", 0), ("(1, 1, 1.999999)", 0), ("(1, 1, 2.1)", 1), ("(0.5, 1, 1.6)", 1),
            ("(2, 2, 2, 1, 0, 0)", 0), ("(2, 2, 2, 1.5, 0, 0)", 1),
        ],
    )  # fmt: skip
    def test_a_note_where_no_body_is_so(self, inertia: str, told: int) -> None:
        """One moment is at most the sum of the others; a rotor that has one alone is meant so."""
        _, compilation = drawn("body a { mass = 1 kg, inertia = J }", around=f"parameter J: kg*m^2 = {inertia}")
        found = list(inertia_notes(compilation.whole_graph))
        assert len(found) == told and all("`arm.a`" in note for note in found)

    @pytest.mark.parametrize(
        "inertia", ["(1, 1, -0.1)", "(1, 1, 1, 1.1, 0, 0)", "(1, 2, 3, 0, 0, 3)", "(0, 1, 1, 0.1, 0, 0)"]
    )
    def test_an_inertia_that_takes_negative_energy_is_refused(self, inertia: str) -> None:
        text = f"model M {{ parameter J: kg*m^2 = {inertia}; multibody arm : spatial {{ body a {{ mass = 1 kg, inertia = J }} }} }}"
        found = mistake(text, "BG140")
        assert "`a` is impossible" in found.sentence and found.span.text == "J"


class TestJoints:
    @pytest.mark.parametrize(
        ("statement", "freedoms"),
        [
            ("hinge j : a to b { about = (0, 0, 1) }", "phi"), ("slide j : a to b { along = (1, 0, 0) }", "x"), ("weld j : a to b", ""),
            ("planar j : a to b", "x y phi"), ("cylinder j : a to b { along = (0, 1, 0) }", "x phi"), ("screw j : a to b { along = (0, 1, 0), lead = 2 mm }", "phi"),
            ("universal j : a to b { about = (1, 0, 0), then = (0, 1, 0) }", "phi1 phi2"), ("ball j : a to b", "rx ry rz"), ("free j : a to b", "x y z rx ry rz"),
            ("distance j : a to b", "d"), ("rod j : a to b", ""), ("hinge k : a to b { about = (0, 0, 1) }\n hinge l : b to c { about = (0, 0, 1) }\n gear j : k to l { ratio = 2 }", ""),
        ],
    )  # fmt: skip
    def test_what_it_leaves_are_its_ports(self, statement: str, freedoms: str) -> None:
        """Each freedom can be driven and read, with the units of its domain."""
        found, _ = joint(statement)
        assert found.freedoms == tuple(freedoms.split())
        for freedom in found.freedoms:
            force, unit = ("F = 1 N", "m") if domain_of(f"j.{freedom}") == "translation" else ("M = 1 [N*m]", "1")
            text = (
                f"model M {{\n multibody arm : spatial {{ {BODIES} {statement}\n }}\n Se s : {force}\n s -> arm.j.{freedom}\n"
                f" output q = arm.j.{freedom}, f = arm.j.{freedom}.f, e = arm.j.{freedom}.e\n}}"
            )
            graph = compiled(text).whole_graph
            assert [b.domain for b in graph.bonds] == [domain_of(f"j.{freedom}")]
            assert graph.outputs["q"].unit == unit
            assert graph.outputs["f"].unit == ("m/s" if unit == "m" else "1/s")

    def test_geometry(self) -> None:
        screw, compilation = joint("screw j : a to b { along = (0, 2, 1), lead = 2 mm, at = (1 m, 2 m, 3 m) }")
        assert numbers(screw.axis, compilation) == [0, 2, 1]
        assert numbers(screw.position, compilation) == [1, 2, 3]
        assert number(screw.ratio, compilation) == 0.002
        universal, compilation = joint("universal j : a to b { about = (1, 0, 0), then = (1, 1 , 0) }")
        assert numbers((*universal.axis, *universal.other_axis), compilation) == [1, 0, 0, 1, 1, 0]
        free, compilation = joint("free j : a to b { turn = (0, 1, 0), axes = world }")
        assert numbers(free.turn, compilation) == [0, 1, 0] and free.axes == "world"

    def test_a_direction_may_be_a_difference_of_places(self) -> None:
        mechanism, compilation = drawn(
            "constant P = (1 m, 2 m, 3 m), Q = (1 m, 2 m, 5 m)\nbody a { mass = 1 kg }\nslide s : ground to a { along = Q - P }"
        )
        assert numbers(mechanism.joints[0].axis, compilation) == [0, 0, 2]

    @pytest.mark.parametrize(
        ("along", "angle"),
        [("60 deg", math.pi / 3), ("(1, sqrt(3))", math.pi / 3), ("(-1 mm, 0)", math.pi), ("0", 0.0)],
    )
    def test_in_the_plane_an_angle_or_a_direction(self, along: str, angle: float) -> None:
        slide, compilation = joint(f"slide j : a to b {{ along = {along} }}", "planar")
        x, y, z = numbers(slide.axis, compilation)
        assert (math.atan2(y, x), z) == pytest.approx((angle, 0), rel=1e-15)
        assert number(slide.turn[2], compilation) == pytest.approx(angle, rel=1e-15)

    def test_couplings(self) -> None:
        mechanism, compilation = drawn(
            """
            body wheel { mass = 1 kg }
            body pinion { mass = 1 kg }
            body bar { mass = 1 kg }
            hinge first : ground to wheel
            hinge second : ground to pinion
            slide third : ground to bar { along = 0 }
            gear mesh : first to second { ratio = -n }
            rack teeth : second to third { radius = 10 mm }
            """,
            "planar",
            "parameter n = 3",
        )
        mesh, teeth = mechanism.joints[-2:]
        assert (mesh.kind, mesh.first, mesh.second, number(mesh.ratio, compilation)) == ("gear", "first", "second", -3)
        assert (teeth.kind, teeth.first, teeth.second, number(teeth.ratio, compilation)) == (
            "rack",
            "second",
            "third",
            0.01,
        )

    def test_a_joint_on_a_frame_is_where_the_frame_is(self) -> None:
        mechanism, compilation = drawn(
            BODIES
            + """
            frame pin : a { at = (0.5 m, 0, 0) }
            frame hook : ground { at = (0.5 m, 0, 0) }
            frame eye : b { at = (1.5 m, 0, 0), axes = body }
            hinge first : hook to pin { about = (0, 0, 1) }
            hinge second : pin to b { about = (0, 0, 1), at = (0.7 m, 0, 0) }
            distance gap : pin to eye
            """
        )
        first, second, gap = mechanism.joints
        assert numbers(first.position, compilation) == [0.5, 0, 0]
        assert numbers(second.position, compilation) == [0.7, 0, 0]
        assert [mechanism.body_of(n) for n in ("hook", "pin", "eye", "a", "ground")] == [
            "ground",
            "a",
            "b",
            "a",
            "ground",
        ]
        assert numbers(mechanism.point_of(gap.second), compilation) == [1.5, 0, 0]
        assert numbers(mechanism.point_of("b"), compilation) == [1, 0, 0]
        assert [f.axes for f in mechanism.frames] == ["world", "world", "body"]

    @pytest.mark.parametrize(
        ("stroke", "locked"), [("0 m", True), ("1 mm", False)]
    )  # fmt: skip
    def test_locked_is_settled_before_the_run(self, stroke: str, locked: bool) -> None:
        mechanism, _ = drawn(
            "body a { mass = 1 kg }\nslide s : ground to a { along = 0, locked = stroke == 0 }",
            "planar",
            f"parameter stroke = {stroke}",
        )
        assert mechanism.joints[0].locked is locked

    def test_rest_and_starts_by_coordinate(self) -> None:
        found, compilation = joint(
            "cylinder j : a to b { along = (1, 0, 0), rest x = 2 mm, start phi = 3, start x.v = 4 [m/s] }"
        )
        assert {k: number(v, compilation) for k, v in found.rest.items()} == {"x": 0.002}
        assert {k: number(v, compilation) for k, v in found.starts.items()} == {"phi": 3, "x.f": 4}
        hinge, compilation = joint("hinge j : a to b { about = (0, 0, 1), rest = 90 deg }")
        assert number(hinge.rest["phi"], compilation) == pytest.approx(math.pi / 2)


class TestLimits:
    TEXT = """
        parameter reach = 1 m
        multibody arm : planar {
          body a { mass = 1 kg }
          body b { mass = 1 kg }
          slide s : ground to a { along = 0, limits = (-reach, reach/2) }
          free f : a to b { limits phi = (-30 deg, 45 deg) }
        }
    """

    def test_they_are_requirements_under_the_name_of_the_joint(self) -> None:
        graph = compiled(f"model M {{ {self.TEXT} }}").whole_graph
        slide, free = graph.requirements
        assert (slide.words, slide.text, slide.name) == (
            "-reach <= arm.s.x <= reach/2",
            "limits of the slide `arm.s`",
            "",
        )
        assert free.words == "-30 deg <= arm.f.phi <= 45 deg"
        assert slide.readings == (("arm.s.x", Reading("arm", "s.x", "q"), "m"),)

        def holds(bound: Bound, place: float) -> float:
            values = [1.0 if isinstance(a, Quantity) else place for a in bound.arguments]
            return evaluate(bound.formula.expression, values.__getitem__)

        assert [holds(slide.condition, x) for x in (-1.1, -1.0, 0.0, 0.5, 0.51)] == [0, 1, 1, 1, 0]
        assert [holds(free.condition, x) for x in (-0.53, -0.52, 0.78, 0.79)] == [0, 1, 1, 0]

    def test_of_an_instance(self) -> None:
        text = f"model Part {{ {self.TEXT} }}\nmodel M {{ Part part {{ reach = 2 m }} }}"
        slide, _ = compiled(text, model="M").whole_graph.requirements
        assert (slide.name, slide.words) == ("part", "-reach <= arm.s.x <= reach/2")
        assert slide.stands is not None and slide.stands.text.startswith("part")

    def test_leaving_them_is_a_warning_of_the_result(self) -> None:
        model = bondgraph.load("""
          model M {
            multibody arm : planar {
              body a { mass = 2 kg }
              slide s : ground to a { along = 0, limits = (-1 m, 1 m), start v = 4 [m/s] }
            }
            output x = arm.s.x
          }
        """)
        (left,) = model.simulate(to="1 s").warnings
        assert left.time == pytest.approx(0.25, rel=1e-6)
        assert left.values == (("arm.s.x", pytest.approx(1.0, rel=1e-6), "m"),)
        assert "limits of the slide `arm.s`" in str(left)
        assert model.simulate(to="0.2 s").warnings == ()


class TestReadings:
    def test_attitude_and_reaction(self) -> None:
        graph = compiled(f"""
          model M {{
            multibody arm : spatial {{
              {BODIES}
              ball k : a to b
              rod r : b to c
            }}
            signal turned = arm.a.attitude
            output w = turned[1], z = arm.a.attitude.z, Fx = arm.k.reaction.x, My = arm.k.reaction.ry, rod = arm.r.reaction.z
            output rz = arm.a.rz, spin = arm.a.rz.omega
          }}
        """).whole_graph
        units = {n: o.unit for n, o in graph.outputs.items()}
        assert units == {"w": "1", "z": "1", "Fx": "N", "My": "N*m", "rod": "N", "rz": "1", "spin": "1/s"}
        found = {n: o.definition.arguments for n, o in graph.outputs.items() if o.definition is not None}
        assert found["Fx"] == (Reading("arm", "k.reaction.x", "e"),)
        assert found["z"] == (Reading("arm", "a.attitude.z", "q"),)
        assert found["rz"] == (Reading("arm", "a.rz", "q"),)
        assert found["spin"] == (Reading("arm", "a.rz", "f"),)

    @pytest.mark.parametrize("planar", [True, False])
    def test_what_holds_has_a_reaction(self, planar: bool) -> None:
        pose = "x y phi" if planar else "x y z rx ry rz"
        for kind in (
            "hinge",
            "slide",
            "weld",
            *(() if planar else ("ball", "universal", "cylinder", "screw", "planar")),
        ):
            assert reactions_of(kind, planar) == tuple(pose.split())
        assert reactions_of("rod", planar) == (("x", "y") if planar else ("x", "y", "z"))
        assert (reactions_of("gear", planar), reactions_of("rack", planar)) == (("phi",), ("x",))
        for kind in ("free", "distance", "body", "frame"):
            assert reactions_of(kind, planar) == ()
        assert freedoms_of("body", planar) == freedoms_of("free", planar) == tuple(pose.split())

    def test_multibonds_of_space(self) -> None:
        """All six by name, through a splitter; a universal joint's two."""
        graph = compiled(
            f"""
          model M {{
            multibody arm : spatial {{
              {BODIES}
              universal u : a to b {{ about = (1, 0, 0), then = (0, 1, 0) }}
              free f : ground to c
            }}
            C bend(phi1, phi2) : energy = 1 [N*m]*(phi1^2 + phi2^2)
            R oil(x, y, z, rx, ry, rz) : x.F = 1 [N*s/m]*x.v, y.F = 1 [N*s/m]*y.v, z.F = 0, rx.M = 0, ry.M = 0, rz.M = 1 [N*m*s]*rz.omega
            arm.u => bend
            arm.f => oil
          }}
        """
        ).whole_graph
        node = next(n for n in graph.nodes if isinstance(n, MechanismNode))
        assert [(p.name, p.domain) for p in node.ports] == [
            ("u.phi1", "rotation"), ("u.phi2", "rotation"),
            ("f.x", "translation"), ("f.y", "translation"), ("f.z", "translation"),
            ("f.rx", "rotation"), ("f.ry", "rotation"), ("f.rz", "rotation"),
        ]  # fmt: skip


class TestExperiments:
    def test_starts_of_poses_in_space(self) -> None:
        """They replace the model's; an attitude replaces a rotation vector too."""
        text = """
          model M {
            multibody arm : spatial { body a { mass = 1 kg, start rx = 1, start z = 2 m, start rz.omega = 1 [1/s] } }
            experiment e { start arm.a.attitude = (0, 0, 1, 0); start arm.a.rz.omega = 5 [1/s]; simulate 0 .. 1 s }
          }
        """
        compilation = compiled(text, experiment="e")
        (node,) = compilation.whole_graph.nodes
        assert isinstance(node, MechanismNode)
        starts = {k: number(v, compilation) for k, v in node.mechanism.bodies[0].starts.items()}
        assert starts == {
            "z": 2, "rz.f": 5, "attitude.w": 0, "attitude.x": 0, "attitude.y": 1, "attitude.z": 0,
        }  # fmt: skip


def test_one_mistake_is_told_once() -> None:
    """An error in a part is not reported again where the part is joined or read."""
    found = mistakes("""
      model M {
        multibody arm : planar {
          bodi a { mass = 1 kg }
          frame f : a { at = (1 m, 0, 0) }
          hinge h : ground to a
          hinge k : ground to f
        }
        output x = arm.a.x
      }
    """)
    assert [(d.code, d.span.line) for d in found] == [("BG140", 4)]


def test_parts_keep_their_places() -> None:
    mechanism, _ = drawn(BODIES + "frame tip : a { at = (1 m, 0, 0) }\nball k : a to b")
    parts: list[Body | Frame | Joint] = [*mechanism.bodies, *mechanism.frames, *mechanism.joints]
    assert [(p.name, p.span.text) for p in parts] == [(n, n) for n in ("a", "b", "c", "tip", "k")]


HINGED = """model Pair {
  multibody m {
    body a { mass = 1 kg; inertia = 0.1 [kg*m^2]; at = A }
    body b { mass = 1 kg; inertia = 0.1 [kg*m^2]; at = B }
    hinge wall : ground to a { at = (0, 0) }
    hinge pin : a to b AT
  }
  output phi = m.pin.phi
}
"""


@pytest.mark.parametrize(
    ("a", "b", "at", "told"),
    [
        ("(1 m, 0)", "(3 m, 0)", "", True),
        ("(1 m, 0)", "(3 m, 0)", "{ at = (2 m, 0) }", False),
        ("(1 m, 0)", "(3 m, 0)", "{ at = (0, 0) }", False),
        ("(1 m, 0)", "(0, 0)", "", False),
        ("(0, 0)", "(3 m, 0)", "", False),
    ],
)
def test_a_hinge_without_a_place_is_told_where_neither_body_is_drawn(a: str, b: str, at: str, told: bool) -> None:
    text = HINGED.replace("= A ", f"= {a} ").replace("= B ", f"= {b} ").replace("AT", at)
    found = [n for n in bondgraph.load(text).certificate.notes if "says no `at`" in n]
    assert len(found) == told and all("`m.pin`" in n and "`a`" in n and "`b`" in n for n in found)
