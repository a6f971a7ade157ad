"""Wheels and skates: rolling without slip, against closed forms and against Newton's and Euler's equations written by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.loops.loops import LoopSolver
from compiler.errors import CompilationFailed
from compiler.examination import check
from compiler.source import Source
from tests.compiling import MODELS
from tests.gallery.reference import integrated
from tests.multibody.newton_euler import of_quaternion, skew

TARGETS = [pytest.param("native", marks=pytest.mark.machine_code), "numpy"]


# ---------------------------------------------------------------- skates
SLEIGH = """model Sleigh {{
  multibody s : planar {{
    body sled {{ mass = 2 kg, inertia = 0.5 [kg*m^2], at = (0.3 m, 0), start x.v = 1 [m/s], start phi.omega = 0.5 [1/s] }}
    frame edge : sled {{ at = (0, 0), axes = body }}
    {skates}
  }}
  output along = s.edge.x.v, across = s.edge.y.v, phi = s.sled.phi, omega = s.sled.phi.omega, F = s.{read}.reaction.y
  experiment go {{ simulate 0 .. 8 s {{ rtol = 1e-9, points = 41 }} }}
}}
"""
ONE = "skate blade : ground to edge { along = 0 }"
# on one line across the sled: the second follows from the first
TWO = "skate blade : ground to sled { along = 0, at = (0, 0.2 m) }\n    skate other : ground to sled { along = 180 deg, at = (0, -0.4 m) }"


def sleigh(times: Any) -> tuple[Any, Any, Any]:
    """Chaplygin's sleigh in closed form: speed u of the blade, angular velocity and angle (u' = a w^2, (J + m a^2) w' = -m a u w)."""
    m, a, whole, u, w = 2.0, 0.3, 0.5 + 2.0 * 0.3**2, 1.0, 0.5
    top, fastest = math.sqrt(u**2 + whole / m * w**2), math.sqrt(w**2 + m / whole * u**2)
    begins, rate = math.atanh(u / top), a * fastest**2 / top

    def gudermann(x: Any) -> Any:
        return 2 * np.arctan(np.tanh(x / 2))

    x = rate * times + begins
    return top * np.tanh(x), fastest / np.cosh(x), fastest / rate * (gudermann(x) - gudermann(begins))


@pytest.mark.few(2)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("skates", [ONE, TWO], ids=["one", "two, of which one follows"])
def test_chaplygin_s_sleigh(target: str, skates: str) -> None:
    run = bondgraph.load(SLEIGH.format(skates=skates, read="blade")).simulate(target=target, energy=True)
    u, w, phi = sleigh(run.time)
    for name, exact in (("along", u), ("omega", w), ("phi", phi)):
        np.testing.assert_allclose(run[name], exact, atol=2e-8, err_msg=name)
    assert np.abs(run["across"]).max() < 1e-14, "no drift"
    assert abs(run.energy.residual) < 1e-8
    followed = [note for note in run.notes if "follow" in note and "mobility 2" in note]
    assert bool(followed) is (skates is TWO)
    assert all("a `reaction` reads 0 there" in note for note in followed)
    a, rate = 0.3, -2.0 * 0.3 * u * w / (0.5 + 2.0 * 0.3**2)
    if skates is ONE:  # force across the blade, in world axes
        np.testing.assert_allclose(run["F"], 2.0 * (u * w + a * rate) * np.cos(phi), atol=1e-7)


def test_a_skate_on_a_slope_does_not_slide_down() -> None:
    """Closed form: at rest and turning by w it runs along a cycloid across the slope: x = g sin(a) sin(w t)^2/(2 w^2)."""
    text = """model M {
  parameter slope = 25 deg, w = 3 [1/s]
  multibody s : spatial {
    gravity = 9.81 [m/s^2]*(sin(slope), 0, -cos(slope))
    body sled { mass = 1.5 kg, inertia = 0.2 [kg*m^2]*(1, 1, 1), start rz.omega = w }
    planar ice : ground to sled
    skate blade : ground to sled { along = (2, 0, 0) }
  }
  output x = s.sled.x, y = s.sled.y, N = s.ice.reaction.z
  experiment go { simulate 0 .. 2 s { rtol = 1e-9, points = 21 } }
}
"""
    run = bondgraph.load(text).simulate()
    size, angle = 9.81 * math.sin(math.radians(25)) / (2 * 9), 3 * run.time
    np.testing.assert_allclose(run["x"], size * np.sin(angle) ** 2, atol=1e-8)
    np.testing.assert_allclose(run["y"], size * (angle - np.sin(2 * angle) / 2), atol=1e-8)
    np.testing.assert_allclose(run["N"], 1.5 * 9.81 * math.cos(math.radians(25)), rtol=1e-9)


def test_a_steered_skate_that_follows_only_as_drawn_is_refused() -> None:
    """Straight ahead both skates hold the same; turned they do not."""
    text = """model M {
  multibody s : planar {
    body sled { mass = 2 kg, inertia = 0.5 [kg*m^2], at = (0.3 m, 0), start x.v = 1 [m/s] }
    body fork { mass = 0.1 kg, inertia = 0.01 [kg*m^2] }
    hinge head : sled to fork { at = (0, 0)STEERED }
    skate blade : ground to sled { along = 0, at = (0, 0) }
    skate other : ground to fork { along = 0, at = (0, 0) }
  }
  output x = s.sled.x
  experiment go { simulate 0 .. 1 s }
}
"""
    with pytest.raises(RunFailed, match=r"singular pose.*s\.blade.*s\.other.*beside"):
        bondgraph.load(text.replace("STEERED", "")).simulate()
    still = bondgraph.load(
        text.replace("STEERED", ", start phi = 10 deg").replace(", start x.v = 1 [m/s]", "")
    ).simulate()
    assert still.final("x") == pytest.approx(0.3, abs=1e-12), (
        "two skates that cross hold a point: only a turn is left, from rest none"
    )


# ---------------------------------------------------------------- wheels in the plane
def test_a_wheel_on_a_wedge_that_slides() -> None:
    """Closed form, by Lagrange: the wheel rolls down the wedge, which slides away; their centre of mass stays where it is sideways."""
    text = """model M {
  parameter a = 20 deg, r = 0.1 m
  multibody s : planar {
    gravity = (0, -9.81 [m/s^2])
    body wedge { mass = 2 kg, at = (1 m, -0.2 m) }
    body roller { mass = 1 kg, inertia = 0.005 [kg*m^2], at = (-r*sin(a), r*cos(a)) }
    slide rail : ground to wedge { along = 0 }
    wheel w : wedge to roller { at = (-r*sin(a), r*cos(a)), radius = r, normal = 3*(-sin(a), cos(a)) }
  }
  output x = s.roller.x, y = s.roller.y, phi = s.roller.phi, X = s.wedge.x, Fx = s.w.reaction.x, Fy = s.w.reaction.y
  experiment go { simulate 0 .. 1 s { points = 11 } }
}
"""
    run, a = bondgraph.load(text).simulate(), math.radians(20)
    masses = np.array(
        [[3.0, math.cos(a)], [math.cos(a), 1.5]]
    )  # of the wedge's way X and the way s down the slope: J/r^2 = m/2
    away, down = np.linalg.solve(
        masses, [0.0, 9.81 * math.sin(a)]
    )  # signs: s is along (-cos a, -sin a), so X goes to the right
    half = run.time**2 / 2
    np.testing.assert_allclose(run["X"] - 1, -away * half, atol=1e-12)
    np.testing.assert_allclose(run["phi"], down * half / 0.1, atol=1e-10)
    np.testing.assert_allclose(run["y"] - run["y"][0], -down * math.sin(a) * half, atol=1e-12)
    np.testing.assert_allclose(run["x"] - run["x"][0] + 2 * (run["X"] - 1), 0, atol=1e-12)
    np.testing.assert_allclose(run["Fx"], -down * math.cos(a) - away, atol=1e-10)
    np.testing.assert_allclose(run["Fy"], 9.81 - down * math.sin(a), atol=1e-10)


def test_in_the_plane_the_way_is_that_of_the_rim() -> None:
    """It is a constraint on positions there: a start says both, and the way does not drift."""
    text = """model M {
  multibody s : planar {
    body roller { mass = 1 kg, inertia = 0.005 [kg*m^2], at = (0, 0.1 m), start x = 0.5 m, start x.v = 3 [m/s] }
    wheel w : ground to roller { at = (0, 0.1 m), radius = 0.1 m }
    hinge crank : roller to bob { at = (0.05 m, 0.1 m) }
    body bob { mass = 1 kg, inertia = 0.001 [kg*m^2], at = (0.25 m, 0.1 m) }
  }
  output x = s.roller.x, phi = s.roller.phi, y = s.roller.y
  experiment go { simulate 0 .. 5 s { points = 11, rtol = 1e-4 } }
}
"""
    run = bondgraph.load(text).simulate(energy=True)
    assert run["x"][0] == pytest.approx(0.5, abs=1e-15)
    assert np.abs(run["x"] + 0.1 * run["phi"]).max() < 1e-13 * 20 and np.abs(run["y"] - 0.1).max() < 1e-15


def test_a_wheel_whose_mass_is_in_its_centre() -> None:
    """Its turn follows from its way, so it needs no inertia: it goes as if it slid. In space nothing says how a point spins about the normal."""
    text = """model M {
  multibody s : planar {
    gravity = (1 [m/s^2], -9.81 [m/s^2])
    body b { mass = 3 kg, at = (0, 0.1 m) }
    wheel w : ground to b { at = (0, 0.1 m), radius = 0.1 m }
  }
  output x = s.b.x, turn = s.b.phi, F = s.w.reaction.x
  experiment go { simulate 0 .. 1 s { points = 3 } }
}
"""
    run = bondgraph.load(text).simulate()
    assert run.final("x") == pytest.approx(0.5, rel=1e-12) and run.final("turn") == pytest.approx(-5, rel=1e-12)
    assert np.abs(run["F"]).max() < 1e-12
    space = text.replace("planar", "spatial").replace("], -9", "], 0, -9").replace("(0, 0.1 m)", "(0, 0, 0.1 m)")
    with pytest.raises(CompilationFailed, match=r"BG202: Nothing with inertia moves along `b\.r[xyz]`"):
        bondgraph.load(space.replace("b.phi", "b.ry")).simulate()


# ---------------------------------------------------------------- wheels and spheres in space
def test_a_ball_on_a_turntable_goes_round_in_a_circle() -> None:
    """Closed form (Routh): about a table with angular velocity W its velocity turns with J W/(J + m r^2); the table moves, so both sides do."""
    text = """model M {
  parameter r = 0.1 m, W = 3 [1/s]
  multibody s : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body table { inertia = 1 [kg*m^2]*(1, 1, 1) }
    body marble { mass = 2 kg, inertia = 0.4*2 kg*r^2*(1, 1, 1), at = (0.5 m, 0, r), start x.v = 0.3 [m/s], start y.v = 0.2 [m/s] }
    hinge axis : ground to table { about = (0, 0, 1) }
    wheel w : table to marble { at = (0.5 m, 0, r), radius = r }
  }
  Sf motor : omega = W
  motor -> s.axis
  output x = s.marble.x, y = s.marble.y, z = s.marble.z, N = s.w.reaction.z
  experiment go { simulate 0 .. 7.330382858376184 s { rtol = 1e-8, points = 29 } }
}
"""
    run = bondgraph.load(text).simulate(energy=True)
    turn = np.exp(1j * 3 * 2 / 7 * run.time)
    exact = 0.5 + (0.3 + 0.2j) * (turn - 1) / (1j * 3 * 2 / 7)
    np.testing.assert_allclose(run["x"] + 1j * run["y"], exact, atol=2e-7)
    np.testing.assert_allclose(run["z"], 0.1, atol=1e-14)
    np.testing.assert_allclose(run["N"], 2 * 9.81, rtol=1e-9)
    assert abs(run.energy.residual) < 1e-6


def test_a_ball_that_turns_in_its_place_on_a_turntable() -> None:
    """At rest it stays at rest (Routh), at any size: its speeds are the rounding of what rolling makes of its spin, and no step follows that."""
    text = """model M {
  parameter r = 0.1 m, W = 3 [1/s]
  multibody s : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body table { inertia = 1 [kg*m^2]*(1, 1, 1) }
    body marble { mass = 2 kg, inertia = 0.4*2 kg*r^2*(1, 1, 1), at = (5*r, 0, r), start x.v = 0, start y.v = 0 }
    hinge axis : ground to table { about = (0, 0, 1) }
    wheel w : table to marble { at = (5*r, 0, r), radius = r }
  }
  Sf motor : omega = W
  motor -> s.axis
  output x = s.marble.x, y = s.marble.y, spin = s.marble.rx.omega
}
"""
    model = bondgraph.load(text)
    for size, speed in ((0.1, 3.0), (1e-6, 3e4)):
        run = model.simulate(settings={"r": size, "W": speed}, to=1 / speed, points=3)
        assert run.steps < 100
        np.testing.assert_allclose([run["x"] / size - 5, run["y"] / size], 0, atol=1e-12)
        np.testing.assert_allclose(run["spin"] / speed, 5, rtol=1e-9)


def disc_rates(m: float, r: float, across: float, axial: float, axle: Any) -> Any:
    """Rates of (centre, quaternion, angular velocity in world axes) of a disc that rolls on z = 0: Newton and Euler, the force eliminated."""
    n, g = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -9.81])

    def rates(_: float, y: Any) -> Any:
        p, w = y[3:7], y[7:]
        turn = of_quaternion(p)
        a = turn @ axle
        tensor = across * np.eye(3) + (axial - across) * np.outer(a, a)
        lean = n @ a
        u = n - lean * a
        s = math.sqrt(1 - lean**2)
        arm = -r / s * u
        da = np.cross(w, a)
        du = -(n @ da) * a - lean * da
        darm = -r * (du / s + u * lean * (n @ da) / s**3)
        # m (v' - g) = F, J w' + w x J w = arm x F, v = -w x arm
        left = tensor - m * skew(arm) @ skew(arm)
        right = -np.cross(w, tensor @ w) + np.cross(arm, m * (-np.cross(w, darm) - g))
        dw = np.linalg.solve(left, right)
        dp = 0.5 * np.array([-w @ p[1:], *(p[0] * w + np.cross(w, p[1:]))])
        return np.concatenate([-np.cross(w, arm), dp, dw])

    return rates


def test_a_tumbling_disc_against_newton_and_euler() -> None:
    """A hoop with its axle drawn aslant, on a slanted start: all terms of the row's derivative take part."""
    text = """model M {
  parameter r = 0.2 m, m = 3 kg
  multibody s : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body disc { mass = m, inertia = m*r^2*(0.3, 0.7, 0.3), at = (0, 0, r), start rx = 0.3, start rx.omega = 0.5 [1/s], start ry.omega = 6 [1/s], start rz.omega = 0.8 [1/s] }
    wheel rim : ground to disc { at = (0, 0, r), about = (0, -2, 0), radius = r }
    frame top : ground { at = (0, 0, 1 m) }
  }
  output x = s.disc.x, y = s.disc.y, z = s.disc.z, w = s.disc.attitude.w, wx = s.disc.rx.omega, wy = s.disc.ry.omega, wz = s.disc.rz.omega
  output N = s.rim.reaction.z
  experiment go { simulate 0 .. 2 s { rtol = 1e-9, points = 21 } }
}
"""
    run = bondgraph.load(text).simulate(energy=True)
    start = [0, 0, 0.2 * math.cos(0.3), math.cos(0.15), math.sin(0.15), 0, 0, 0.5, 6, 0.8]
    exact = integrated(disc_rates(3.0, 0.2, 0.036, 0.084, np.array([0.0, 1.0, 0.0])), start, run.time)
    for column, name in ((0, "x"), (1, "y"), (2, "z"), (3, "w"), (7, "wx"), (8, "wy"), (9, "wz")):
        np.testing.assert_allclose(run[name], exact[:, column], atol=3e-7, err_msg=name)
    assert abs(run.energy.residual) < 1e-7 and run["N"].min() > 0


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_an_upright_disc_is_stable_above_the_limit(share: float) -> None:
    """Eigenvalues in closed form: A (A + m r^2) s^2 = A m g r - C (C + m r^2) W^2; for a thin disc the limit is W^2 = g/(3 r)."""
    model = bondgraph.load(MODELS / "coin.bg")
    speed = share * math.sqrt(9.81 / (3 * 0.012))
    modes = model.modes("straight", settings={"lean": 0.0, "turn": 0.0, "spin": speed}, state="start")
    square = (0.25 * 9.81 / 0.012 - 0.5 * 1.5 * speed**2) / (0.25 * 1.25)
    found = np.array([mode.eigenvalue for mode in modes])
    for exact in (complex(square) ** 0.5, -(complex(square) ** 0.5)):
        if exact.imag >= 0:
            assert np.abs(found - exact).min() < 1e-8 * abs(exact)
    assert bool(found.real.max() > 1) is (share < 1) and modes.note == ""


def test_inclined_planes_and_ceilings_are_normals() -> None:
    """A sphere rolls down any plane with 5/7 of a sliding one's acceleration, and under a ceiling of reversed gravity too."""
    text = """model M {
  constant n = (0.3, -0.2, 0.9)
  multibody s : spatial {
    gravity = SIGN*9.81 [m/s^2]*(0, 0, -1)
    body marble { mass = 1 kg, inertia = 0.4e-2 [kg*m^2]*(1, 1, 1) }
    wheel w : ground to marble { radius = 0.1 m, normal = SIGN*n }
  }
  output x = s.marble.x, y = s.marble.y, z = s.marble.z
  experiment go { simulate 0 .. 1 s { points = 3 } }
}
"""
    n = np.array([0.3, -0.2, 0.9]) / math.sqrt(0.94)
    g = np.array([0, 0, -9.81])
    exact = 5 / 7 * (g - (g @ n) * n) / 2
    for sign in (1, -1):
        run = bondgraph.load(text.replace("SIGN", f"({sign})")).simulate(rtol=1e-9)
        np.testing.assert_allclose([run.final(c) for c in "xyz"], sign * exact, atol=1e-8)


def test_a_wheel_stands_where_its_body_is_drawn() -> None:
    """A push P at the centre of a disc: a = P/(m + J/r^2), and the contact carries -J a/r^2 and the weight."""
    text = """model Disc {
  multibody c : planar {
    gravity = (0, -9.81 [m/s^2])
    body disc { mass = 1 kg, inertia = 5e-3 [kg*m^2], at = (0.7 m, 0.1 m) }
    wheel rolls : ground to disc { radius = 0.1 m }
  }
  Se push : F = 10 N
  push -> c.disc.x
  output x = c.disc.x - 0.7 m, T = c.rolls.reaction.x, N = c.rolls.reaction.y
  experiment go { simulate 0 .. 2 s { points = 3 } }
}
"""
    run = bondgraph.load(text).simulate()
    assert [run.final(n) for n in ("x", "T", "N")] == pytest.approx([40 / 3, -10 / 3, 9.81], rel=1e-6)


# ---------------------------------------------------------------- what is wrong
@pytest.mark.parametrize(
    ("space", "part", "words"),
    [
        ("planar", "wheel w : ground to b", "The wheel `w` has no radius"),
        ("planar", "wheel w : ground to b { radius = 0 m }", "The radius of `w` is zero"),
        ("planar", "wheel w : ground to b { radius = -1 m }", "The radius of `w` is negative"),
        ("planar", "wheel w : ground to b { radius = 1 m, normal = (0, 0) }", "has the length zero"),
        ("planar", "wheel w : ground to b { radius = 1 m, about = (0, 0, 1) }", "everything turns about the same axis"),
        ("planar", "skate w : ground to b", "The skate `w` has no direction"),
        ("spatial", "wheel w : ground to b { radius = 1 m, about = (0, 0, 2) }", "lies flat in the drawing"),
        ("spatial", "skate w : ground to b { along = (0, 0, 2) }", "stands on end in the drawing"),
        ("spatial", "wheel w : ground to b { radius = 1 m, limits = (0, 1) }", "A wheel has no coordinate"),
    ],
)  # fmt: skip
def test_what_no_wheel_is(space: str, part: str, words: str) -> None:
    text = f"model M {{\n  multibody m : {space} {{\n    body b {{ mass = 1 kg }}\n    {part}\n  }}\n  output x = m.b.x\n}}\n"
    found = check(Source("m.bg", text))
    assert any(words in str(d) + str(d.advice) for d in found), [str(d) for d in found]


@pytest.mark.parametrize(
    ("setting", "words"), [({"r": -0.1}, "negative"), ({"r": 0.0}, "zero"), ({"lie": math.pi / 2}, "lies flat")]
)
def test_what_a_run_s_values_make_wrong(setting: dict[str, float], words: str) -> None:
    text = """model M {
  parameter r = 0.1 m, lie = 0
  multibody m : spatial {
    body b { mass = 1 kg, inertia = 1 [kg*m^2]*(1, 1, 1) }
    wheel w : ground to b { radius = r, about = (0, cos(lie), sin(lie)) }
  }
  output x = m.b.x
  experiment go { simulate 0 .. 1 s }
}
"""
    with pytest.raises(CompilationFailed, match=words):
        bondgraph.load(text).simulate(settings=setting)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", ["coin", "four_bar"])
def test_multipliers_are_computed_and_not_searched(name: str, target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method to rounding takes a thousand iterations for those that are zero, in each step of the look ahead."""

    def searched(*_: Any) -> None:
        raise AssertionError("a loop of multipliers is solved by iteration")

    monkeypatch.setattr(LoopSolver, "system", searched)
    model = bondgraph.load(MODELS / f"{name}.bg")
    assert model.simulate(to=0.01, points=3, target=target).steps > 0
