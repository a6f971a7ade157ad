"""Mechanisms back to text: every kind of joint, in the plane and in space, with all that may be said of it."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.unparse import write_text
from tests.unparse.same_graph import Same
from tests.unparse.test_round_trip import without_comments

PARTS = """
    gravity = (0, 0, -g)
    body a { mass = m, inertia = J, at = (l, 0, 0), turn = (0, 0, 30 deg), start attitude = (0.6, 0.8, 0, 0) }
    body b { mass = 2*m, inertia = (J[1], J[1], 2*J[1]), at = (2*l, 0, 0), start rx = 0.1, start rz.omega = 2 [1/s] }
    body c { mass = m, at = (l, l, l) }
    frame pin : a { at = (1.5*l, 0, 0) }
    frame eye : b { at = (1.5*l, 0, 0), axes = body, start z.v = 1 [m/s] }
    frame hook : ground { at = (0, 0, 3*l) }
"""


def there_and_back(text: str) -> str:
    """The flat text of a text, once it has been seen to give the same graph."""
    original = bondgraph.load(text).compilation(everything=True).whole_graph
    flat = write_text(original)
    reread = bondgraph.load(flat).compilation(everything=True).whole_graph
    Same(original, reread).check()
    assert without_comments(write_text(reread)) == without_comments(flat), "writing it again changes it"
    return flat


def model(joints: str, outputs: str = "", space: str = "spatial", parts: str = PARTS) -> str:
    return f"""
      model M {{
        parameter l = 1 m, m = 2 kg, g = 9.81 [m/s^2], J: kg*m^2 = (1, 2, 2.5, 0.1, 0, 0), angle = 20 deg
        multibody arm : {space} {{
          {parts}
          {joints}
        }}
        {outputs}
      }}
    """


@pytest.mark.parametrize(
    ("joint", "written"),
    [
        ("hinge j : ground to a { about = (0, 1, 0), rest = angle, start phi = 1, start omega = 2 [1/s] }", "about = (0, 1, 0), rest = angle, start phi = 1, start phi.omega = 2 [1/s]"),
        ("slide j : a to b { along = (l, 0, 2*l), at = (0, 0, l), locked = l > 0 m }", "at = (0, 0, l), along = (l, 0, 2*l), locked = true"),
        ("planar j : a to b { turn = (angle, 0, 0), rest x = 1 mm, rest phi = 2 }", "turn = (angle, 0, 0), rest x = 0.001 m, rest phi = 2"),
        ("cylinder j : a to b { along = (1, 0, 0), start x = 1 mm, start phi = 1 }", "along = (1, 0, 0), start x = 0.001 m, start phi = 1"),
        ("screw j : a to b { along = (1, 0, 0), lead = 2 mm }", "along = (1, 0, 0), lead = 0.002 m"),
        ("universal j : a to b { about = (1, 0, 0), then = (0, 1, 0), rest phi2 = 1 }", "about = (1, 0, 0), then = (0, 1, 0), rest phi2 = 1"),
        ("ball j : pin to eye", "at = (1.5*l, 0, 0)"),
        ("ball j : pin to c { at = (0, 0, 0), start rx = 1 }", "at = (0, 0, 0), start rx = 1"),
        ("free j : a to b { turn = (0, 0, 1), axes = middle, start z = 1 mm, rest z = 2 mm }", "turn = (0, 0, 1), axes = middle, rest z = 0.002 m, start z = 0.001 m"),
        ("free j : a to b { axes = world }", "axes = world"),
        ("weld j : a to b { at = (l, 0, 0) }", "at = (l, 0, 0)"),
        ("wheel j : ground to c { radius = 2*l, about = (0, l, 0) }", "at = (l, l, l), about = (0, l, 0), radius = 2*l"),
        ("wheel j : a to c { radius = 10 mm, normal = (0, 1, 0), at = (0, 0, l) }", "at = (0, 0, l), normal = (0, 1, 0), radius = 0.01 m"),
        ("skate j : ground to c { along = (1, 0, 0), normal = (0, 0, 1) }", "at = (l, l, l), along = (1, 0, 0)"),
        ("distance j : hook to c { start d = 4 m }", "start d = 4 m"),
        ("rod j : hook to c", ""),
    ],
)  # fmt: skip
def test_joints_in_space(joint: str, written: str) -> None:
    flat = there_and_back(model(joint))
    link = joint.partition("{")[0].strip()
    assert f"    {link} {{ {written} }}\n" in flat if written else f"    {link}\n" in flat


@pytest.mark.parametrize(
    ("joint", "written"),
    [
        ("wheel j : ground to a { radius = l, normal = (0, 1) }", "radius = l"),
        ("wheel j : ground to a { radius = l, normal = (-1, 1) }", "normal = (-1, 1), radius = l"),
        ("skate j : ground to a { along = angle, at = (l, 0) }", "at = (l, 0), along = angle"),
    ],
)
def test_rolling_in_the_plane(joint: str, written: str) -> None:
    flat = there_and_back(model(joint, space="planar", parts="body a { mass = m, inertia = J[1] }"))
    assert f"    {joint.partition('{')[0].strip()} {{ {written} }}\n" in flat


def test_bodies_and_frames_in_space() -> None:
    flat = there_and_back(model(""))
    lines = [line.strip() for line in flat.splitlines()]
    inertia = ", ".join(f"J[{i}]" for i in range(1, 7))
    assert f"body a {{ mass = m, inertia = ({inertia}), at = (l, 0, 0), turn = (0, 0, 0.5235987755982988), start attitude = (0.6, 0.8, 0, 0) }}" in lines  # fmt: skip
    assert "body b { mass = 2*m, inertia = (J[1], J[1], 2*J[1]), at = (2*l, 0, 0), start rx = 0.1, start rz.omega = 2 [1/s] }" in lines  # fmt: skip
    assert "frame eye : b { at = (1.5*l, 0, 0), axes = body, start z.v = 1 [m/s] }" in lines
    assert "gravity = (0, 0, -g)" in lines


def test_couplings_limits_and_what_is_read() -> None:
    """Limits come back as requirements, readings under their names."""
    flat = there_and_back(
        model(
            """
            hinge first : ground to a { about = (0, 0, 1), limits = (-angle, 90 deg) }
            hinge d : ground to b { about = (0, 0, 1) }
            slide rail : ground to c { along = (1, 0, 0), limits = (0, l) }
            gear mesh : first to d { ratio = -J[2]/J[1] }
            rack teeth : d to rail { radius = l/10 }
            """,
            """
            Se push : F = 1 N
            push -> arm.rail
            signal q = arm.a.attitude
            output w = q[1], d = arm.d.reaction.rx, M = arm.mesh.reaction.phi, turned = arm.b.rx, spin = arm.eye.rx.omega, torque = arm.first.M
            """,
        )
    )
    for line in (
        "hinge d_2 : ground to b { about = (0, 0, 1) }  # d",
        "gear mesh : first to d_2 { ratio = -J[2]/J[1] }",
        "rack teeth : d_2 to rail { radius = l/10 }",
        'require -angle <= arm.first.phi and arm.first.phi <= 1.5707963267948966 "limits of the hinge `arm.first`"',
        'require 0 <= arm.rail.x and arm.rail.x <= l "limits of the slide `arm.rail`"',
        "output d: N*m = arm.d_2.reaction.rx",
        "output M: N*m = arm.mesh.reaction.phi",
        "output spin: 1/s = arm.eye.rx.omega",
        "signal q[1] = arm.a.attitude.w",
    ):
        assert line in [x.strip() for x in flat.splitlines()], flat


PLANE = "body a { mass = m }\nbody b { mass = m, at = (l, 0) }\nframe p : a { at = (0, l), axes = body }"


@pytest.mark.parametrize(
    ("joint", "written"),
    [
        ("slide j : ground to a { along = angle }", "along = angle"),
        ("slide j : ground to a { along = (l, 2*l) }", "along = (l, 2*l)"),
        ("slide j : ground to a { along = (0, 1) }", "along = 1.5707963267948966"),
        ("slide j : ground to a { along = 90 deg, rest = 1 mm }", "along = 1.5707963267948966, rest = 0.001 m"),
        ("hinge j : p to b { start phi = 1 }", "at = (0, l), start phi = 1"),
        ("distance j : p to b", ""),
        ("rod j : p to b", ""),
        ("free j : a to b { angle = angle, axes = to }", "angle = angle, axes = to"),
    ],
)
def test_joints_in_the_plane(joint: str, written: str) -> None:
    flat = there_and_back(model(joint, space="planar", parts=PLANE))
    link = joint.partition("{")[0].strip()
    assert f"    {link} {{ {written} }}\n" in flat if written else f"    {link}\n" in flat
