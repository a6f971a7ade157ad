"""Starts of mechanisms in space: attitudes, rotation vectors and angular velocities of bodies on joints."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

TEXT = """
model Top {{
  multibody space : spatial {{
    body disc {{ mass = 0.5 kg, inertia = 1 [kg*m^2]*(7, 7, 12), at = (0, 0, 1 m) {starts} }}
    ball foot : ground to disc {{ at = (0, 0, 0) {joint} }}
    frame tip : disc {{ at = (0, 0, 2 m) {frame} }}
  }}
  output rx = space.disc.rx, ry = space.disc.ry, rz = space.disc.rz, spin = space.disc.rz.omega
  output w = space.disc.attitude.w, x = space.disc.attitude.x, y = space.disc.attitude.y, z = space.disc.attitude.z
  output height = space.tip.z, aside = space.tip.y, vx = space.tip.x.v
}}
"""


def start_of(starts: str = "", joint: str = "", frame: str = "") -> dict[str, float]:
    """Outputs at the start."""
    model = bondgraph.load(TEXT.format(**{k: f", {v}" if v else "" for k, v in (("starts", starts), ("joint", joint), ("frame", frame))}))  # fmt: skip
    result = model.simulate(to="1 us")
    return {name: float(result[name][0]) for name in result.names}


def test_an_attitude_of_a_body_on_a_joint() -> None:
    """Half the angle in the quaternion, the whole one in the rotation vector; a spin about an axis of the world."""
    found = start_of("start attitude = (cos(10 deg), sin(10 deg), 0, 0), start rz.omega = 200 [1/s]")
    turned = np.radians(20)
    assert (found["rx"], found["ry"], found["rz"]) == pytest.approx((turned, 0, 0), abs=1e-12)
    assert (found["w"], found["x"], found["y"], found["z"]) == pytest.approx((np.cos(turned / 2), np.sin(turned / 2), 0, 0), abs=1e-12)  # fmt: skip
    assert found["spin"] == pytest.approx(200, rel=1e-12)
    assert (found["height"], found["aside"]) == pytest.approx((2 * np.cos(turned), -2 * np.sin(turned)), rel=1e-12)


@pytest.mark.parametrize("where", ["starts", "joint"])
def test_a_rotation_vector_of_body_or_joint(where: str) -> None:
    """The same here: the joint is on the ground and was drawn upright."""
    found = start_of(**{where: "start rx = 0.3, start ry = -0.2, start rz = 0.1"})
    assert (found["rx"], found["ry"], found["rz"]) == pytest.approx((0.3, -0.2, 0.1), rel=1e-9)
    r = np.array([0.3, -0.2, 0.1])
    angle = np.linalg.norm(r)
    n, up = r / angle, np.array([0.0, 0.0, 2.0])
    tip = up * np.cos(angle) + np.cross(n, up) * np.sin(angle) + n * (n @ up) * (1 - np.cos(angle))  # Rodrigues
    assert (found["aside"], found["height"]) == pytest.approx(tuple(tip[1:]), rel=1e-9)


def test_a_frame_says_how_it_moves() -> None:
    """The tip 2 m above the joint moves at 3 m/s: 1.5 rad/s about y."""
    assert start_of(frame="start x.v = 3 [m/s]")["vx"] == pytest.approx(3, rel=1e-12)


@pytest.mark.parametrize(
    "joint",
    [
        "",
        "free j : ground to top",
        "free j : ground to top { turn = (0, 1, 0) }",
        "ball j : ground to top { at = (0, 0, 0) }",
    ],
)
@pytest.mark.parametrize("started", ["", ", start rx.omega = 1 [1/s]", ", start x = 0.5 m"])
def test_a_turned_body_starts_where_it_is_drawn(joint: str, started: str) -> None:
    if "ball" in joint and " x" in started:
        return
    text = f"""model Drawn {{
      multibody s : spatial {{
        body top {{ mass = 2 kg, inertia = [1, 2, 3]*1 [kg*m^2], at = (0.5 m, 0, 0), turn = (0.3, -1.1, 2){started} }}
        frame tip : top {{ at = (2 m, 1 m, 0) }}
        {joint}
      }}
      output rx = s.top.rx, ry = s.top.ry, rz = s.top.rz, x = s.tip.x, y = s.tip.y, z = s.tip.rz
    }}"""
    found = bondgraph.load(text).simulate(to="1 ms", points=2)
    drawn = {"rx": 0.3, "ry": -1.1, "rz": 2, "x": 2, "y": 1, "z": 0}
    assert {name: found[name][0] for name in drawn} == pytest.approx(drawn, abs=1e-12)


def test_axes_of_a_turned_body_are_its_own() -> None:
    """Velocities of a frame are read, and a force acts, along the axes that `turn` gives, as the inertia does."""
    text = """model Turned {
      multibody s : spatial {
        body top { mass = 2 kg, inertia = [1, 2, 3]*1 [kg*m^2], turn = (0, 0, 30 deg), start x.v = 1 [m/s], start ry.omega = 2 [1/s] }
        frame own : top { at = (0, 0, 0), axes = body }
      }
      Se push : F = 4 N
      push -> s.own.y
      output vx = s.own.x.v, vy = s.own.y.v, omega = s.own.rx.omega, ax = der(s.top.x.v), ay = der(s.top.y.v)
    }"""
    found = bondgraph.load(text).simulate(to="1 ms", points=2)
    c, s = np.sqrt(3) / 2, 1 / 2
    at_first = {"vx": c, "vy": -s, "omega": 2 * s, "ax": -2 * s, "ay": 2 * c}
    assert {name: found[name][0] for name in at_first} == pytest.approx(at_first, rel=1e-12)
