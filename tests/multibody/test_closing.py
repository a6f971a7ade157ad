"""Joints of every kind where they close a loop: rates of gaps, accelerations, and forces that do no work, at poses off the drawing.

A state of random coordinates and speeds keeps no constraint; the equations must be consistent there too: gaps change by their rates, rates by
what the multipliers let them accelerate, and the matrix of the multipliers is symmetric, as forces act by the transpose of slopes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled

PLANE = """
model A {
  multibody m : planar {
    gravity = (0.5 [m/s^2], -9.81 [m/s^2])
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0.1 m) }
    body b { mass = 2 kg, inertia = 0.3 [kg*m^2], at = (1.2 m, -0.4 m) }
    hinge one : ground to a { at = (0, 0) }
    %s
    frame p : a { at = (0.9 m, 0.3 m) }
    frame q : b { at = (1.1 m, -0.2 m) }
    %s
  }
  output x = m.b.x, y = m.b.y
}
"""
SPACE = """
model A {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 1 [m/s^2])
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (0.5 m, 0.1 m, 0) }
    body b { mass = 2 kg, inertia = (0.3 [kg*m^2], 0.2 [kg*m^2], 0.25 [kg*m^2]), at = (1.2 m, -0.4 m, 0.3 m) }
    ball one : ground to a { at = (0, 0, 0) }
    frame p : a { at = (0.9 m, 0.3 m, 0.1 m) }
    frame q : b { at = (1.1 m, -0.2 m, 0.2 m) }
    %s
  }
  output x = m.b.x, y = m.b.y, z = m.b.z
}
"""
IN_PLANE = {
    "hinge": ("hinge two : ground to b { at = (2 m, 0) }", "hinge j : a to b { at = (1 m, -0.1 m) }"),
    "slide": ("hinge two : ground to b { at = (2 m, 0) }", "slide j : a to b { along = 30 deg, at = (1 m, -0.1 m) }"),
    "rod": ("hinge two : ground to b { at = (2 m, 0) }", "rod j : p to q"),
    "gear": ("hinge two : ground to b { at = (2 m, 0) }", "gear j : one to two { ratio = -2 }"),
    "rack": ("slide two : ground to b { along = 0 }", "rack j : one to two { radius = 20 mm }"),
}
AXIS = "(0.3, 1, 0.5)"
IN_SPACE = {
    "hinge": f"hinge j : a to b {{ at = (1 m, 0, 0.1 m), about = {AXIS} }}",
    "slide": f"slide j : a to b {{ at = (1 m, 0, 0.1 m), along = {AXIS} }}",
    "cylinder": f"cylinder j : a to b {{ at = (1 m, 0, 0.1 m), along = {AXIS} }}",
    "ball": "ball j : a to b { at = (1 m, 0, 0.1 m) }",
    "universal": f"universal j : a to b {{ at = (1 m, 0, 0.1 m), about = {AXIS}, then = (1, 0, -0.6) }}",
    "screw": f"screw j : a to b {{ at = (1 m, 0, 0.1 m), along = {AXIS}, lead = 60 mm }}",
    "planar": "planar j : a to b { at = (1 m, 0, 0.1 m), turn = (0.3, 0.4, 0) }",
    "rod": "rod j : p to q",
}
TWO = "ball two : ground to b { at = (2 m, 0, 0) }"
LEANING = """
model A {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 0)
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (0.5 m, 0, 0) }
    body b { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (1 m, -0.5 m, 0) }
    planar table : b to ground { at = (1 m, -1 m, 0.2 m), turn = (0.3, 0.2, 0) }
    ball one : ground to a { at = (0, 0, 0) }
    ball j : a to b { at = (1 m, 0, 0) }
  }
  output x = m.b.x, y = m.b.y, z = m.b.z
}
"""  # gravity has a part across the plane of b
CASES = {
    "ball in space, on a leaning plane": LEANING,
    **{f"{kind} in the plane": PLANE % text for kind, text in IN_PLANE.items()},
    **{f"{kind} in space": SPACE % f"{TWO}\n    {text}" for kind, text in IN_SPACE.items()},
}
PLANE_WELD = """body c { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (2.2 m, 0.4 m) }
    body d { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.8 m, 0.4 m) }
    hinge two : ground to c { at = (2 m, 0) }
    hinge three : c to d { at = (2.2 m, 0.7 m) }
    slide four : d to b { along = 30 deg }"""
SPACE_WELD = """body c { mass = 1 kg, inertia = (0.3 [kg*m^2], 0.2 [kg*m^2], 0.25 [kg*m^2]), at = (1.8 m, -0.2 m, 0) }
    ball two : ground to c { at = (2 m, 0, 0) }
    ball three : c to b { at = (1.5 m, -0.4 m, 0.1 m) }"""
WELDS = {
    "weld in the plane": PLANE % (PLANE_WELD, "weld j : a to b"),
    "weld in space": SPACE % f"{SPACE_WELD}\n    weld j : a to b",
}
for (
    name,
    text,
) in WELDS.items():  # a weld that is asked for its reaction is a joint of its own; it closes where all others are read
    others = "q = m.three.phi, s = m.four.x" if "plane" in name else "q = m.three.rx"
    CASES[name] = text.replace("output x", f"output r = m.j.reaction.x, {others}, x")
LOST = {"weld": 6, "screw": 5, "hinge": 5, "slide": 5, "cylinder": 4, "ball": 3, "universal": 4, "planar": 3, "rod": 1}


class Anywhere:
    """A program at a random state, quaternions of length one."""

    def __init__(self, text: str) -> None:
        running = Running(compiled(text, everything=True))
        self.program, self.fixed = running.program, (running.inputs, running.constants, np.zeros(0))
        random = np.random.default_rng(3)
        self.count = len(self.program.states.names)
        self.state = running.start + 0.3 * random.normal(size=len(running.start))
        names = self.program.states.names
        for i, name in enumerate(names):
            if name.endswith("attitude.w"):
                self.state[i : i + 4] /= np.linalg.norm(self.state[i : i + 4])

    def of(self, function: Any, state: Any) -> Any:
        return np.asarray(function(0.0, state, *self.fixed))

    def along(self, function: Any) -> Any:
        """The rate of a function of the state, along the motion, by central differences."""
        rates = self.of(self.program.derivative, self.state)
        step = np.zeros(len(self.state))
        step[: self.count] = 1e-6 * rates[: self.count]
        return (self.of(function, self.state + step) - self.of(function, self.state - step)) / 2e-6


@pytest.mark.few(4)
@pytest.mark.parametrize("name", CASES)
def test_gaps_rates_and_accelerations_belong_together(name: str) -> None:
    at = Anywhere(CASES[name])
    program = at.program
    values, changes = at.of(program.invariant, at.state), at.along(program.invariant)
    bound = [(i, rate, m) for i, (rate, m) in enumerate(zip(program.rates, program.multipliers, strict=True)) if m >= 0]
    kind, _, where = name.partition(" in ")
    if where.startswith("space"):
        assert len(bound) == LOST[kind]
    residuals = at.of(program.derivative, at.state)[at.count :]
    for gap, rate, multiplier in bound:
        assert changes[gap] == pytest.approx(values[rate], rel=1e-6, abs=1e-7)
        assert changes[rate] == pytest.approx(residuals[multiplier], rel=1e-5, abs=1e-5)
    norms = [i for i, m in enumerate(program.multipliers) if m < 0]
    assert np.abs(changes[norms]).max(initial=0.0) < 1e-8


@pytest.mark.few(6)
@pytest.mark.parametrize("name", CASES)
def test_multipliers_do_no_work_of_their_own(name: str) -> None:
    """Their matrix is symmetric and positive, and the program's solution for them makes all residuals zero."""
    at = Anywhere(CASES[name])
    matrix = at.of(at.program.jacobian, at.state)[at.count :, at.count :]
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() > 0
    solved = at.of(at.program.solved, at.state)
    state = at.state.copy()
    state[at.count + np.array(at.program.eliminated)] = solved[len(at.state) :]
    rates = at.of(at.program.derivative, state)
    assert np.abs(rates[at.count :]).max() < 1e-9 * max(1.0, np.abs(state[at.count :]).max())
    assert np.abs(rates[: at.count] - solved[: at.count]).max() < 1e-9 * np.abs(rates).max()


def loaded(folder: Path, text: str) -> Any:
    path = folder / "model.bg"
    path.write_text(text, encoding="utf-8")
    return bondgraph.load(path)


@pytest.mark.few(4)
@pytest.mark.parametrize("name", CASES)
def test_energy_is_kept(name: str, tmp_path: Path) -> None:
    found = loaded(tmp_path, CASES[name]).simulate(to=0.3, rtol=1e-8, points=4, energy=True)
    assert found.energy is not None
    assert abs(found.energy.residual) < 2e-6


# ---------------------------------------------------------------- runs
CRANK = """
model Crank {
  parameter r = 40 mm, l = 130 mm
  multibody m : planar {
    body crank  { mass = 1 kg, inertia = 5e-3 [kg*m^2], at = (0, 0) }
    body rod    { mass = 0.2 kg, inertia = 0.2 kg*l^2/12, at = (r + l/2, 0) }
    body piston { mass = 0.8 kg, at = (r + l, 0) }
    hinge main  : ground to crank  { at = (0, 0), %s }
    hinge pin   : crank to rod     { at = (r, 0) }
    hinge wrist : rod to piston    { at = (r + l, 0) %s }
    slide bore  : ground to piston { along = 0 %s }
    frame end : rod { at = (r + l, 0) }
  }
  output phi = m.crank.phi, w = m.crank.phi.omega, x = m.piston.x, open_x = m.end.x - m.piston.x, open_y = m.end.y
  output slip_x = m.end.x.v - m.piston.x.v, slip_y = m.end.y.v, fx = m.wrist.reaction.x, fy = m.wrist.reaction.y
}
"""


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_what_closing_joints_lock_costs_no_small_steps(kind: str, target: str) -> None:
    """No freedom is left: all that moves is rounding, and shares of that are no tolerance."""
    found = bondgraph.load(CASES[f"{kind} in the plane"]).simulate(to=0.3, rtol=1e-10, points=4, target=target)
    assert found.steps <= 200  # some twenty to ninety, as rounding has it
    np.testing.assert_allclose(found["x"], 1.2, atol=1e-14)
    np.testing.assert_allclose(found["y"], -0.4, atol=1e-14)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_loops_stay_closed_at_every_reported_instant(rtol: float, tmp_path: Path) -> None:
    """Position and velocity, for any tolerance; between steps as well."""
    model = loaded(tmp_path, CRANK % ("start phi.omega = 60 [rad/s]", "", ""))
    found = model.simulate(to=0.3, rtol=rtol, points=307, energy=True)
    assert np.abs([found["open_x"], found["open_y"]]).max() < 1e-12 * 0.17
    assert np.abs([found["slip_x"], found["slip_y"]]).max() < 1e-12 * 60 * 0.17
    assert found.energy is not None
    assert abs(found.energy.residual) < 30 * max(rtol, 1e-9)
    angle, w = found["phi"], found["w"]
    assert np.abs(found["x"] - (0.04 * np.cos(angle) + np.sqrt(0.13**2 - (0.04 * np.sin(angle)) ** 2))).max() < 1e-12
    beta = np.arcsin(0.04 * np.sin(angle) / 0.13)
    piston = -0.04 * w * (np.sin(angle) + np.cos(angle) * np.tan(beta))
    rate = -0.04 * np.cos(angle) * w / (0.13 * np.cos(beta))
    middle_x, middle_y = -0.04 * w * np.sin(angle) + 0.065 * np.sin(-beta) * -rate, 0.02 * w * np.cos(angle)
    kinetic = 0.5 * (5e-3 * w**2 + 0.8 * piston**2 + 0.2 * (middle_x**2 + middle_y**2) + 0.2 * 0.13**2 / 12 * rate**2)
    assert np.abs(kinetic / kinetic[0] - 1).max() < 100 * rtol


def test_the_reaction_of_a_closing_joint(tmp_path: Path) -> None:
    """The force of the wrist on the piston is mass times acceleration, along the bore."""
    found = loaded(tmp_path, CRANK % ("start phi.omega = 60 [rad/s]", "", "")).simulate(to=0.2, rtol=1e-9, points=2001)
    speed = np.gradient(np.gradient(found["x"], found.time, edge_order=2), found.time, edge_order=2)
    assert np.abs(found["fx"] - 0.8 * speed)[5:-5].max() < 2e-3 * np.abs(found["fx"]).max()


class TestAssembly:
    """Starts that the drawing does not have: the rest follows."""

    def test_the_rest_follows_what_is_said(self, tmp_path: Path) -> None:
        found = loaded(tmp_path, CRANK % ("start phi = 50 deg", "", "")).simulate(to=1e-3, rtol=1e-6, points=2)
        angle = np.deg2rad(50)
        assert found["phi"][0] == pytest.approx(angle, abs=1e-14)
        assert found["x"][0] == pytest.approx(
            0.04 * np.cos(angle) + np.sqrt(0.13**2 - (0.04 * np.sin(angle)) ** 2), abs=1e-13
        )

    def test_of_a_closing_or_any_joint(self, tmp_path: Path) -> None:
        text = CRANK % ("start phi = 0.2", "", ", start x.v = -1 [m/s]")
        found = loaded(tmp_path, text).simulate(to=1e-3, rtol=1e-6, points=2)
        beta = np.arcsin(0.04 * np.sin(0.2) / 0.13)
        assert found["w"][0] == pytest.approx(1 / (0.04 * (np.sin(0.2) + np.cos(0.2) * np.tan(beta))), rel=1e-9)

    def test_contradictions_are_told_by_names(self, tmp_path: Path) -> None:
        model = loaded(tmp_path, CRANK % ("start phi = 50 deg", "", ", start x = 10 mm"))
        with pytest.raises(
            bondgraph.RunFailed, match=r"`m.wrist` cannot be closed with the starts of `m.main.phi`, `m.bore.x`"
        ):
            model.simulate(to=1e-3)

    def test_rounded_digits_are_no_contradiction(self, tmp_path: Path) -> None:
        x = 0.04 * np.cos(0.9) + np.sqrt(0.13**2 - (0.04 * np.sin(0.9)) ** 2) - 0.17
        found = loaded(tmp_path, CRANK % ("start phi = 0.9", "", f", start x = {x:.9f} [m]")).simulate(
            to=1e-3, points=2
        )
        assert found["phi"][0] == pytest.approx(0.9, abs=1e-7)
        assert abs(found["open_x"][0]) < 1e-14


BEAM = """
model Beam {
  constant J = 1 kg*(1 m)^2/12
  multibody bars : planar {
    gravity = (0, -9.81 [m/s^2])
    for i in 0..2 {
      body  upright[i] { mass = 1 kg, inertia = J, at = (i*1 m, 0.5 m), angle = 90 deg }
      hinge foot[i] : ground to upright[i] { at = (i*1 m, 0) }
    }
    body beam { mass = 1 kg, inertia = J, at = (1 m, 1 m) }
    for i in 0..2 { hinge top[i] : upright[i] to beam { at = (i*1 m, 1 m) } }
    frame corner : upright[0] { at = (0, 1 m), start x.v = 1 [m/s] }
  }
  output x = bars.corner.x, vx = bars.corner.x.v
}
"""


def test_a_redundant_bar_is_named_and_changes_nothing_else(tmp_path: Path) -> None:
    """Three uprights under one beam: one row follows from the others; I = 3/3 + 1, moment = g (3/2 + 1)."""
    from scipy.integrate import solve_ivp

    found = loaded(tmp_path, BEAM).simulate(to=0.6, rtol=1e-8, points=7)
    run = solve_ivp(
        lambda t, y: (y[1], 9.81 * 2.5 / 2 * np.sin(y[0])),
        (0, 0.6),
        (0.0, 1.0),
        "DOP853",
        found.time,
        rtol=1e-12,
        atol=1e-13,
    )
    assert np.abs(found["x"] - np.sin(run.y[0])).max() < 1e-6
    (note,) = found.notes
    assert (
        note.startswith("1 constraint of closing joints follows from the others")
        and "`bars.top[" in note
        and "mobility 1" in note
    )


def test_a_start_in_a_singular_pose_is_told(tmp_path: Path) -> None:
    """A rhombus that lies in one line: nothing says which way it opens."""
    text = """
model Flat {
  multibody m : planar {
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0) }
    body b { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, 0) }
    body c { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, 0) }
    hinge one : ground to a { at = (0, 0) }
    hinge two : a to b { at = (1 m, 0) }
    hinge three : ground to c { at = (1 m, 0) }
    hinge four : c to b { at = (2 m, 0) }
  }
  output x = m.b.x
}
"""
    with pytest.raises(bondgraph.RunFailed, match=r"starts in a singular pose.*`m.four`"):
        loaded(tmp_path, text).simulate(to=1.0)


def test_stretched_bars_between_two_fixed_points_are_told(tmp_path: Path) -> None:
    text = """
model Stretched {
  multibody m : planar {
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0) }
    body b { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, 0) }
    hinge one : ground to a { at = (0, 0) }
    hinge two : a to b { at = (1 m, 0) }
    hinge three : b to ground { at = (2 m, 0) }
  }
  output x = m.b.x
}
"""
    with pytest.raises(bondgraph.RunFailed, match="drawn in a pose from which it cannot move"):
        loaded(tmp_path, text).simulate(to=1.0)


def test_a_gear_and_a_rack_carry_their_inertias(tmp_path: Path) -> None:
    """A wheel of 0.1 kg m^2 and one of 0.4 at twice its speed, then a rack: known sums."""
    text = """
model Train {
  multibody m : planar {
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2] }
    body b { mass = 1 kg, inertia = 0.4 [kg*m^2], at = (1 m, 0) }
    body c { mass = 3 kg, at = (1 m, 0.2 m) }
    hinge one : ground to a { at = (0, 0) }
    hinge two : ground to b { at = (1 m, 0) }
    slide way : ground to c { along = 0 }
    gear mesh : one to two { ratio = -2 }
    rack teeth : two to way { radius = 0.2 m }
  }
  Se drive : M = 5 [N*m]
  drive -> m.one
  output w = m.one.phi.omega, v = m.way.x.v, f = m.teeth.reaction.x
}
"""
    found = loaded(tmp_path, text).simulate(to=2.0, rtol=1e-8, points=3)
    inertia = 0.1 + 4 * 0.4 + (2 * 0.2) ** 2 * 3
    assert found.final("w") == pytest.approx(5 / inertia * 2, rel=1e-9)
    assert found.final("v") == pytest.approx(-0.4 * 5 / inertia * 2, rel=1e-9)
    assert found.final("f") == pytest.approx(3 * -0.4 * 5 / inertia, rel=1e-9)


DRIVEN = """
model Driven {
  parameter r = 40 mm, l = 130 mm
  multibody m : planar {
    gravity = (0, -9.81 [m/s^2])
    body crank  { mass = 1 kg, inertia = 5e-3 [kg*m^2], at = (0, 0) }
    body rod    { mass = 0.2 kg, inertia = 0.2 kg*l^2/12, at = (r + l/2, 0) }
    body piston { mass = 0.8 kg, at = (r + l, 0) }
    hinge main  : ground to crank  { at = (0, 0) }
    hinge pin   : crank to rod     { at = (r, 0) }
    hinge wrist : rod to piston    { at = (r + l, 0) }
    slide bore  : ground to piston { along = 0 }
  }
  Sf motor : omega = 20 [rad/s]
  motor -> m.main
  C spring : F = 200 [N/m]*x
  m.bore -> spring
  output phi = m.crank.phi, x = m.piston.x, M = motor.M
  experiment go { simulate 0 .. 0.3 s { rtol = 1e-8 } }
}
"""
HANGING = """
model Hang {
  multibody m : planar {
    gravity = (0, -9.81 [m/s^2])
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0) }
    body b { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, -0.5 m) }
    body c { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (2 m, -0.5 m) }
    hinge one : ground to a { at = (0, 0) }
    hinge two : a to b { at = (1 m, 0) }
    hinge three : b to c { at = (2 m, -1 m) }
    hinge four : c to ground { at = (2 m, 0) }
  }
  R damper : M = 1 [N*m*s]*omega
  m.one -> damper
  output x = m.b.x, y = m.b.y, phi = m.a.phi
  experiment rest { equilibrium; simulate 0 .. 1 s }
}
"""


def test_a_driven_crank_takes_what_the_rest_asks_for(tmp_path: Path) -> None:
    """The motor's work is what spring and mechanism gain."""
    found = loaded(tmp_path, DRIVEN).simulate(energy=True, points=11)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-9
    assert found.final("phi") == pytest.approx(6.0, rel=1e-9)


def test_a_loop_at_rest_hangs_where_its_weight_is_lowest(tmp_path: Path) -> None:
    """Three bars between two points, 2 m apart: as is found from nothing, by turning the first and looking for less."""
    from scipy.optimize import minimize_scalar

    found = loaded(tmp_path, HANGING).simulate(points=3)
    assert np.abs(found["y"] - found["y"][0]).max() < 1e-9, "it stays there"
    second, third = np.sqrt(2.0), 1.0

    def knee(angle: float) -> tuple[float, float, float, float]:
        x, y = np.cos(angle), np.sin(angle)
        dx, dy = 2 - x, -y
        far = np.hypot(dx, dy)
        along = (second**2 - third**2 + far**2) / (2 * far)
        down = np.sqrt(max(second**2 - along**2, 0.0))
        return x, y, x + along * dx / far + down * dy / far, y + along * dy / far - down * dx / far

    def weight(angle: float) -> float:
        _, y, _, z = knee(angle)
        return y / 2 + (y + z) / 2 + z / 2

    best = minimize_scalar(weight, bounds=(-1.6, -0.8), method="bounded", options={"xatol": 1e-10})
    assert found.final("phi") == pytest.approx(best.x, abs=1e-6)


TURNTABLE = """
model Turn {
  multibody m : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body t { mass = 1 kg, inertia = (1 [kg*m^2], 1 [kg*m^2], 1 [kg*m^2]) }
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.1 [kg*m^2], 0.1 [kg*m^2]), at = (0.2 m, 0, 0.5 m) }
    body b { mass = 2 kg, inertia = (0.1 [kg*m^2], 0.1 [kg*m^2], 0.1 [kg*m^2]), at = (1 m, 0, 1.2 m) }
    body c { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.1 [kg*m^2], 0.1 [kg*m^2]), at = (2 m, 0, 0.6 m) }
    hinge table : ground to t { at = (0, 0, 0), about = (0, 0, 1), start phi.omega = 2 [1/s] }
    hinge one : t to a { at = (0, 0, 0), about = (0, 1, 0), start phi.omega = 0.5 [1/s] }
    hinge two : a to b { at = (0.3 m, 0, 1 m), about = (0, 1, 0) }
    hinge four : t to c { at = (2 m, 0, 0), about = (0, 1, 0) }
    hinge three : b to c { at = (1.9 m, 0, 1.1 m), about = (0, 1, 0) }
  }
  output x = m.b.x, y = m.b.y, z = m.b.z, phi = m.table.phi, w = m.table.phi.omega
  output ax = m.a.x, ay = m.a.y, cx = m.c.x, cy = m.c.y
}
"""


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_other_rows_take_part_where_the_first_ones_fail(target: str, tmp_path: Path) -> None:
    """A four-bar on a turntable: the independent constraints of its last hinge change as it turns; no pose is singular.

    It keeps its plane, its energy, and its momentum about the table's axis.
    """
    found = loaded(tmp_path, TURNTABLE).simulate(to=2.0, rtol=1e-8, points=21, energy=True, target=target)
    assert np.ptp(found["phi"]) > 1.5 * np.pi
    assert not any("singular" in note for note in found.notes)
    (note,) = found.notes
    assert "3 constraints" in note
    assert "mobility 2" in note
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-6
    inertia = 1.3 + sum(mass * (found[p + "x"] ** 2 + found[p + "y"] ** 2) for mass, p in ((1, "a"), (2, ""), (1, "c")))
    assert np.ptp(inertia) > 1.0
    assert np.abs(inertia * found["w"] / (inertia[0] * 2.0) - 1).max() < 1e-6
    cosine, sine = np.cos(found["phi"]), np.sin(found["phi"])
    assert np.abs(cosine * found["y"] - sine * found["x"]).max() < 1e-12, "it stays in its plane"
    reach = np.hypot(cosine * found["x"] + sine * found["y"], found["z"])
    assert np.ptp(reach) > 0.1
