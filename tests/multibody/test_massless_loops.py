"""Bodies without mass in closed loops, whose motion depends on the masses beyond the loop's last joint.

Each mechanism with massless links against one without them that moves the same: rods, gears, joints of one piece, nothing at all; then
against itself with a little mass, and a four-bar with a massless coupler against a formula.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.errors import CompilationFailed

PLANE = """
model A {
  parameter little = 1e-3 kg
  multibody m : planar {
    gravity = (0.3 [m/s^2], -9.81 [m/s^2])
    %s
  }
  output x = m.p.x, y = m.p.y, phi = m.q.phi
}
"""
SPACE = """
model A {
  multibody m : spatial {
    gravity = (0.3 [m/s^2], -9.81 [m/s^2], 0.5 [m/s^2])
    body p { mass = 2 kg, inertia = (0.2 [kg*m^2], 0.3 [kg*m^2], 0.15 [kg*m^2]), at = (1 m, 0, 0) }
    body q { mass = 1 kg, inertia = (0.2 [kg*m^2], 0.3 [kg*m^2], 0.15 [kg*m^2]), at = (1 m, 1 m, 0.2 m) }
    ball top : ground to p { at = (0, 0, 0) }
    ball far : ground to q { at = (0, 1 m, 0) }
    frame e : p { at = (1.3 m, 0.1 m, 0.1 m) }
    frame f : q { at = (1.2 m, 0.9 m, 0.2 m) }
    %s
  }
  output x = m.p.x, y = m.p.y, phi = m.q.z
}
"""
HUNG = """
    body p { mass = 2 kg, inertia = 0.2 [kg*m^2], at = (1 m, 1 m) }
    frame q : p { at = (1 m, 1 m) }
    frame l : p { at = (0.5 m, 1.1 m) }
    frame r : p { at = (1.6 m, 1 m) }
    frame g : ground { at = (0, 0) }
    frame h : ground { at = (2 m, 0.1 m) }
"""
STRUTS = """
    body s { at = (0.2 m, 0.5 m) }
    body t { at = (1.8 m, 0.5 m) }
    hinge a1 : ground to s { at = (0, 0) }
    hinge a2 : s to p { at = (0.5 m, 1.1 m) }
    hinge b1 : ground to t { at = (2 m, 0.1 m) }
    hinge b2 : t to p { at = (1.6 m, 1 m) }
"""
PENDULUM = """
    body p { mass = 2 kg, inertia = 0.2 [kg*m^2], at = (1 m, 0) }
    frame q : p { at = (1 m, 0) }
    hinge top : ground to p { at = (0, 0) }
"""
GUIDED = """
    body s; body t
    slide a : ground to s { along = 0 }
    slide b : s to t { along = 90 deg }
    hinge c : t to p { at = (1.5 m, 0.2 m) }
"""
WHEELS = """
    body p { mass = 2 kg, inertia = 0.2 [kg*m^2], at = (1 m, 0) }
    body q { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (3.3 m, 0) }
    hinge top : ground to p { at = (0, 0) }
    hinge far : ground to q { at = (3 m, 0) }
"""
IDLER = """
    body w { at = (2 m, 0) }
    hinge axle : ground to w { at = (2 m, 0) }
    gear one : top to axle { ratio = -2 }
    gear two : axle to far { ratio = -1.5 }
"""
TRUSS = """
    body a { at = (1 m, 0.5 m) }
    body b { at = (1.5 m, 1 m) }
    hinge j1 : p to a { at = (1.2 m, 0) }
    hinge j2 : a to b { at = (1.2 m, 1 m) }
    hinge j3 : p to b { at = (1.6 m, 0) }
"""
LEG = """
    body s { at = (1.25 m, 0.5 m, 0.15 m) }
    ball b1 : p to s { at = (1.3 m, 0.1 m, 0.1 m) }
    universal b2 : s to q { at = (1.2 m, 0.9 m, 0.2 m), about = (1, 0, 0), then = (0, 0, 1) }
"""
TABLE = """
    body s; body t
    slide a1 : p to s { along = (1, 0, 0) }
    slide a2 : s to t { along = (0, 1, 0) }
    hinge a3 : t to q { at = (1 m, 1 m, 0.2 m), about = (0, 0, 1) }
"""
CROSS = """
    body s { at = (1 m, 0.5 m, 0) }
    hinge a1 : p to s { at = (1 m, 0.5 m, 0), about = (1, 0, 0) }
    hinge a3 : s to q { at = (1 m, 0.5 m, 0), about = (0, 0, 1) }
"""
SAME = {
    "struts are rods": (PLANE % (HUNG + STRUTS), PLANE % (HUNG + "rod one : g to l; rod two : h to r")),
    "slide, slide and hinge hold nothing in the plane": (PLANE % (PENDULUM + GUIDED), PLANE % PENDULUM),
    "an idler turns the other way": (PLANE % (WHEELS + IDLER), PLANE % (WHEELS + "gear g : top to far { ratio = 3 }")),
    "a truss without mass is not there": (PLANE % (PENDULUM + TRUSS), PLANE % PENDULUM),
    "a leg between ball and universal joint is a rod": (SPACE % LEG, SPACE % "rod r : e to f"),
    "slide, slide and hinge are a planar joint": (SPACE % TABLE, SPACE % "planar j : p to q { at = (1 m, 1 m, 0.2 m) }"),
    "two hinges on a cross are a universal joint": (
        SPACE % CROSS,
        SPACE % "universal j : p to q { at = (1 m, 0.5 m, 0), about = (1, 0, 0), then = (0, 0, 1) }",
    ),
}  # fmt: skip


def loaded(folder: Path, text: str) -> Any:
    path = folder / "model.bg"
    path.write_text(text, encoding="utf-8")
    return bondgraph.load(path)


@pytest.mark.few(3)
@pytest.mark.parametrize("name", SAME)
def test_massless_links_move_as_what_they_stand_for(name: str, tmp_path: Path) -> None:
    runs = [
        loaded(tmp_path, text).simulate(to=0.4, rtol=1e-8, points=3, energy=True, target="numpy") for text in SAME[name]
    ]
    assert np.ptp([runs[1][o] for o in ("x", "y", "phi")], axis=1).max() > 0.02, "it moves"
    for output in ("x", "y", "phi"):
        assert np.abs(runs[0][output] - runs[1][output]).max() < 1e-8
    assert all(run.energy is not None and abs(run.energy.residual) < 1e-7 for run in runs)


def test_what_moves_nothing_even_through_the_loop_is_told(tmp_path: Path) -> None:
    """A leg between two balls turns about itself; a link that hangs on a loop without mass; a loop of massless bars with freedom left."""
    cases = {
        "b[12].r[xyz]": SPACE % LEG.replace("universal b2", "ball b2").replace(", about = (1, 0, 0), then = (0, 0, 1)", ""),
        "tail.phi": PLANE % (HUNG + STRUTS + "body w { at = (0.2 m, 0) }\n hinge tail : s to w { at = (0.1 m, 0.3 m) }"),
        "[abcd].phi": PLANE % (PENDULUM + "body s; body t; body u\n hinge a : p to s { at = (1 m, 0) }\n hinge b : s to t { at = (1 m, 1 m) }"
        "\n hinge c : t to u { at = (2 m, 1 m) }\n hinge d : u to p { at = (2 m, 0.2 m) }"),
    }  # fmt: skip
    for coordinate, text in cases.items():
        with pytest.raises(CompilationFailed, match=f"BG202: Nothing with (mass|inertia) moves along `{coordinate}`"):
            _ = loaded(tmp_path, text).certificate


BARS = """
model Bars {{
  multibody m : planar {{
    gravity = (0, -9.81 [m/s^2])
    body a {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.2 m, 0.5 m) }}
    body b {{ mass = 2 kg, inertia = 0.3 [kg*m^2], at = (2.2 m, 0.6 m) }}
    body c {{ mass = {mass} kg, inertia = {mass}*0.3 [kg*m^2], at = (1 m, 1.2 m) }}
    hinge one   : ground to a {{ at = (0, 0), start phi.omega = 1 [rad/s] }}
    hinge two   : a to c      {{ at = (0.3 m, 1 m) }}
    hinge three : b to c      {{ at = (2.1 m, 1.4 m) }}
    hinge four  : ground to b {{ at = (2 m, 0) }}
  }}
  output x = m.a.phi, y = m.b.phi, f = m.three.reaction.x, g = m.three.reaction.y
}}
"""


def coupled(time: float, state: Any) -> Any:
    """The angles of two bars, held by a rod without mass between their ends, by hand: one multiplier, no projection."""
    arms = [np.array([[0.2, 0.5], [0.3, 1.0]]), np.array([[0.2, 0.6], [0.1, 1.4]])]  # centre of mass, end
    mass, inertia = (1.0, 2.0), (0.1, 0.3)
    turned, swept, dynamic, load = [], [], [], []
    for k in range(2):
        c, s = np.cos(state[k]), np.sin(state[k])
        arm = arms[k] @ np.array([[c, s], [-s, c]])
        turned.append(arm[1] + (0.0 if k == 0 else np.array([2.0, 0.0])))
        swept.append(np.array([-arm[1][1], arm[1][0]]))
        dynamic.append(inertia[k] + mass[k] * arm[0] @ arm[0])
        load.append(-9.81 * mass[k] * arm[0][0])
    d = turned[1] - turned[0]
    slopes = np.array([-d @ swept[0], d @ swept[1]])
    slip = swept[1] * state[3] - swept[0] * state[2]
    ends = [turned[0], turned[1] - np.array([2.0, 0.0])]
    rest = slip @ slip + d @ (ends[0] * state[2] ** 2 - ends[1] * state[3] ** 2)
    inverse = 1 / np.array(dynamic)
    force = -(rest + slopes @ (inverse * load)) / (slopes @ (inverse * slopes))
    return np.array([state[2], state[3], *(inverse * (load + slopes * force))])


def test_a_four_bar_with_a_massless_coupler_against_a_formula(tmp_path: Path) -> None:
    from scipy.integrate import solve_ivp

    found = loaded(tmp_path, BARS.format(mass=0)).simulate(to=0.6, rtol=1e-10, points=4)
    d, end, other = np.array([1.8, 0.4]), np.array([-1.0, 0.3]), np.array([-1.4, 0.1])
    start = [0.0, 0.0, 1.0, (d @ end) / (d @ other)]
    known = solve_ivp(coupled, (0, 0.6), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=found.time)
    assert np.abs(known.y[0]).max() > 0.1
    assert np.abs([found["x"] - known.y[0], found["y"] - known.y[1]]).max() < 1e-8
    ends = [np.array([[np.cos(p), -np.sin(p)], [np.sin(p), np.cos(p)]]) for p in known.y[:2, -1]]
    along = ends[1] @ [0.1, 1.4] + [2.0, 0.0] - ends[0] @ [0.3, 1.0]
    force = np.array([found.final("f"), found.final("g")])
    across = along[0] * force[1] - along[1] * force[0]
    assert abs(across) < 1e-9 * np.linalg.norm(force) * np.linalg.norm(along), "a massless bar pulls along itself"


def test_a_little_mass_changes_as_little(tmp_path: Path) -> None:
    """In proportion, down to 1e-7 of the others: nothing is lost by digits."""
    runs = {
        mass: loaded(tmp_path, BARS.format(mass=mass)).simulate(to=0.5, rtol=1e-11, points=3)
        for mass in (0, 1e-7, 1e-5, 1e-3)
    }
    off = {m: max(abs(runs[m].final(o) - runs[0].final(o)) for o in ("x", "y")) for m in runs if m}
    assert off[1e-3] > 1e-5
    assert off[1e-5] == pytest.approx(1e-2 * off[1e-3], rel=1e-2)
    assert off[1e-7] == pytest.approx(1e-4 * off[1e-3], rel=2e-2)
