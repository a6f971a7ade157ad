"""Starts of mechanisms: on the branch of the drawing, or refused with the reachable values; rates never change a pose."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import MODELS
from tests.simulation.linkages import FOUR_BAR, LINKAGES

# `python tests/stress assemblies` tries hundreds.
CASES = {"slider-crank": 15, "four-bar": 4, "five-bar": 3, "Stephenson": 3, "RSSR": 3, "Bricard": 1}
EXACT = 1e-9


@pytest.mark.few(2)
@pytest.mark.interpreted
@pytest.mark.parametrize("name", CASES)
def test_random_linkages_start_on_the_branch_that_is_drawn(name: str) -> None:
    """Against closed forms along the whole path, and a continuation by hand; poses beyond a dead centre are refused."""
    linkage, rng = LINKAGES[name], np.random.default_rng(7)
    model = bondgraph.load(linkage.text())
    for _ in range(CASES[name]):
        case = linkage.case(rng)
        try:
            found = model.simulate("go", case.settings, target="numpy")
        except RunFailed as failed:
            assert case.wanted is None or case.open_, failed
            assert "can be reached up to `e." in str(failed)
            continue
        assert case.wanted is not None, case.settings
        for output, value in case.wanted.items():
            assert found[output][0] == pytest.approx(value, rel=EXACT, abs=EXACT), case.settings


@pytest.mark.parametrize(("name", "rates"), [("slider-crank", "a 3"), ("four-bar", "a -2"), ("five-bar", "a 5,d -7"), pytest.param("Stephenson", "a 4", marks=pytest.mark.machine_code), pytest.param("RSSR", "a 3", marks=pytest.mark.machine_code)])  # fmt: skip
def test_a_pose_is_the_same_with_a_start_of_rates(name: str, rates: str) -> None:
    linkage, rng = LINKAGES[name], np.random.default_rng(11)
    still, moving = bondgraph.load(linkage.text()), bondgraph.load(linkage.text(rates))
    met = 0
    for _ in range(12):
        case = linkage.case(rng)
        if case.wanted is None or case.open_:
            continue
        first, second = (m.simulate("go", case.settings, target="numpy") for m in (still, moving))
        assert np.abs(first.values[0] - second.values[0]).max() < 1e-14 * max(1.0, np.abs(first.values[0]).max())
        assert np.abs(second.values[1] - second.values[0]).max() > 1e-9, "it moves"
        met += 1
        if met == 2:
            return
    assert met


# ---------------------------------------------------------------- a crank and rocker, in closed form
def swing(crank: float) -> float:
    """The rocker's angle of models/four_bar.bg, degrees, as the crank turns from the drawing to an angle in degrees."""
    g, a, b, c = 0.5, 0.15, 0.45, 0.35

    def rocker(t: float) -> float:
        p = a * np.array([math.cos(t), math.sin(t)])
        d = np.array([g, 0.0]) - p
        reach = math.hypot(*d)
        x = (reach**2 + b**2 - c**2) / (2 * reach)
        q = p + (x * d + math.sqrt(b * b - x * x) * np.array([-d[1], d[0]])) / reach
        return math.atan2(q[1], q[0] - g)

    angles = np.unwrap([rocker(t) for t in np.radians(np.linspace(0, crank, 2001))])
    return math.degrees(angles[-1] - angles[0])


@pytest.mark.few(6)
@pytest.mark.parametrize(
    "crank",
    [60, 120, 150, 180, -120, -150, 179.99, 359, pytest.param(400, marks=pytest.mark.machine_code), -790, 1e-6, -1],
)
def test_the_crank_of_the_gallery_s_four_bar(crank: float) -> None:
    text = (MODELS / "four_bar.bg").read_text(encoding="utf-8")
    text = text.replace(
        "  experiment start_up {", f"  experiment start_up {{\n    start linkage.shaft.phi = {crank!r} deg"
    )
    found = bondgraph.load(text).simulate(to="1 us", points=2, target="numpy")
    assert math.degrees(found["angle"][0]) == pytest.approx(crank, abs=1e-12)
    assert math.degrees(found["swing"][0]) == pytest.approx(swing(crank), abs=1e-9)


def test_the_limit_that_a_refusal_tells_is_the_dead_centre_and_just_before_it_runs() -> None:
    """A double rocker: the crank goes as far as the other two bars reach, by the law of cosines."""
    model = bondgraph.load(FOUR_BAR.text())
    places = {"Ax": 0, "Ay": 0, "Bx": 0.0, "By": 1.0, "Cx": 0.8, "Cy": 0.9, "Dx": 1.5, "Dy": 0.0}
    far = math.hypot(0.8, 0.1) + math.hypot(0.7, 0.9)
    limit = math.acos((1 + 1.5**2 - far**2) / (2 * 1.5)) - math.pi / 2
    with pytest.raises(RunFailed, match=r"line 11\) cannot hold.*up to `e\.a\.phi` = .*dead centre") as failed:
        model.simulate("go", {**places, "start_a": 2.5}, target="numpy")
    told = float(str(failed.value).split("`e.a.phi` = ")[1].split(" rad")[0])
    assert told == pytest.approx(limit, abs=1e-6)
    assert model.simulate("go", {**places, "start_a": limit - 1e-5}, target="numpy")["o_a"][0] == limit - 1e-5


def test_another_coordinate_leads_through_the_dead_centre_of_the_crank() -> None:
    """Both are said: the crank cannot lead there, the rocker can."""
    places = {"Ax": 0, "Ay": 0, "Bx": 0.0, "By": 1.0, "Cx": 0.8, "Cy": 0.9, "Dx": 1.5, "Dy": 0.0}
    by_rocker = bondgraph.load(
        FOUR_BAR.text()
        .replace("start phi = start_a", "")
        .replace("at = (Dx, Dy)", "at = (Dx, Dy), start phi = start_a")
    )
    wanted = by_rocker.simulate("go", {**places, "start_a": 0.45}, target="numpy")
    crank = float(wanted["o_a"][0])
    text = FOUR_BAR.text().replace("at = (Dx, Dy)", "at = (Dx, Dy), start phi = 0.45")
    both = bondgraph.load(text).simulate("go", {**places, "start_a": crank}, target="numpy")
    assert both.values[0] == pytest.approx(wanted.values[0], abs=1e-9)
    with pytest.raises(
        RunFailed,
        match=r"`e\.c` cannot be closed with the starts of `e\.a\.phi`, `e\.d\.phi` \(line 14\).*leave one of them out",
    ):
        bondgraph.load(text).simulate("go", {**places, "start_a": crank - 0.1}, target="numpy")


# ---------------------------------------------------------------- any coordinate, from anywhere
@pytest.mark.few(4)
@pytest.mark.parametrize("start", ["e.q.x", "e.q.y", "e.q.phi", "e.d.phi", "e.c.phi", "e.b.phi", "e.s.x", "e.p.y"])
def test_any_coordinate_may_say_the_pose(start: str) -> None:
    """The pose of a crank's start, given by another coordinate of the same linkage in an experiment."""
    places = {"Ax": 0, "Ay": 0, "Bx": 0.1, "By": 0.3, "Cx": 0.8, "Cy": 0.9, "Dx": 1.1, "Dy": 0.0}
    text = FOUR_BAR.text().replace("  output", f"  output said = {start}, ")
    first = bondgraph.load(text).simulate("go", {**places, "start_a": 0.05}, target="numpy")
    unit = " m" if start[-1] in "xy" else ""
    text = text.replace("start phi = start_a", "").replace(
        "{ simulate", f"{{ start {start} = {float(first['said'][0])!r}{unit}; simulate"
    )
    second = bondgraph.load(text).simulate("go", places, target="numpy")
    assert second.values[0] == pytest.approx(first.values[0], abs=1e-9)


def test_a_kite_does_not_wind() -> None:
    """Two starts that agree: angles are those of the nearest pose, not of one some turns away."""
    text = """model K {
  multibody b : planar {
    body crank { mass = 1 kg, inertia = 0.08 [kg*m^2], at = (0.22679806071278866 m, 0.4456036800307177 m) }
    body coupler { mass = 1.2 kg, inertia = 0.03 [kg*m^2], at = (0.71578039230753 m, 0.7454012967372415 m) }
    body rocker { mass = 0.8 kg, inertia = 0.025 [kg*m^2], at = (0.9889823315947414 m, 0.29979761670652383 m) }
    hinge hA : ground to crank { at = (0 m, 0 m), start phi = -0.7219157988090106, start phi.omega = 3 [1/s] }
    hinge hB : crank to coupler { start phi = 1.0999306008946366, at = (0.4535961214255773 m, 0.8912073600614354 m) }
    hinge hC : coupler to rocker { at = (0.9779646631894827 m, 0.5995952334130477 m) }
    hinge hD : ground to rocker { at = (1 m, 0 m) }
  }
  C tors : M = 1 [N*m]*phi
  b.hC -> tors
  output hc = b.hC.phi, a = b.hA.phi, d = b.hD.phi, e = b.hB.phi
  experiment go { simulate 0 .. 1 us { points = 2 } }
}
"""
    found = bondgraph.load(text).simulate(target="numpy")
    assert found["a"][0] == pytest.approx(-0.7219157988090106, abs=1e-9)
    assert found["e"][0] == pytest.approx(1.0999306008946366, abs=1e-9)
    assert found["d"][0] == pytest.approx(-1.0999306008946366, abs=1e-9)


# ---------------------------------------------------------------- rates alone
@pytest.mark.parametrize("level", [0.0, 0.2, -0.7])
@pytest.mark.parametrize("omega", [0.0, 2.0, -30.0])
def test_a_double_pendulum_stays_where_it_is_drawn(level: float, omega: float) -> None:
    """The tip's rate decides that of the second bar by a division; also where the first one is level or not."""
    text = f"""model DP {{
  multibody d : planar {{
    gravity = (0, -9.81 [m/s^2])
    body a {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, {level / 2} m) }}
    body b {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, 0.2 m) }}
    hinge h1 : ground to a {{ at = (0, 0), start phi.omega = {omega} [1/s] }}
    hinge h2 : a to b {{ at = (1 m, {level} m) }}
    frame tip : b {{ at = (2 m, 0.4 m), start y.v = 1 [m/s] }}
  }}
  output x = d.b.x, y = d.b.y, p1 = d.h1.phi, p2 = d.h2.phi, w1 = d.h1.phi.omega, w2 = d.h2.phi.omega
  experiment go {{ simulate 0 .. 1 us {{ points = 2 }} }}
}}
"""
    found = bondgraph.load(text).simulate(target="numpy")
    assert list(found.values[0][:4]) == [1.5, 0.2, 0.0, 0.0]
    assert found["w1"][0] == omega
    assert found["w2"][0] == pytest.approx(1.0 - 2.0 * omega, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("spatial", [False, True])
def test_a_block_on_a_wheel_stays_where_it_is_drawn(spatial: bool) -> None:
    kind = ("spatial", "inertia = 1 [kg*m^2]*(0.06, 0.12, 0.06)", "inertia = 1 [kg*m^2]*(1, 2, 3), at = (0.3 m, 0, 0.6 m)", "start ry.omega = 0", "about = (0, 1, 0), at = (0, 0, 0)", "z") if spatial else ("planar", "inertia = 0.12 [kg*m^2]", "inertia = 2 [kg*m^2], at = (0.3 m, 0.6 m)", "start phi.omega = 0", "at = (0, 0)", "y")  # fmt: skip
    text = f"""model Wheel {{
  multibody b : {kind[0]} {{
    body wheel {{ mass = 1 kg, {kind[1]} }}
    body block {{ mass = 10 kg, {kind[2]}, start x.v = 5 [m/s], {kind[3]} }}
    hinge h : block to wheel {{ {kind[4]}, start phi.omega = 17 [1/s] }}
  }}
  output x = b.block.x, z = b.block.{kind[5]}, phi = b.h.phi, v = b.block.x.v
  experiment go {{ simulate 0 .. 1 us {{ points = 2 }} }}
}}
"""
    found = bondgraph.load(text).simulate(target="numpy")
    assert found.values[0] == pytest.approx([0.3, 0.6, 0.0, 5.0], rel=1e-12, abs=1e-14)


def test_rates_that_no_pose_allows_are_refused() -> None:
    """A crank and a rocker of a mechanism with one freedom, both with rates."""
    places = {"Ax": 0, "Ay": 0, "Bx": 0.1, "By": 0.3, "Cx": 0.8, "Cy": 0.9, "Dx": 1.1, "Dy": 0.0}
    text = FOUR_BAR.text("a 1,d 9")
    with pytest.raises(RunFailed, match=r"starts of rates of `e\.a\.phi`, `e\.d\.phi` cannot hold together"):
        bondgraph.load(text).simulate("go", places, target="numpy")


@pytest.mark.parametrize(("rate", "length"), [(1e-17, 1e-6), pytest.param(1e12, 1.0, marks=pytest.mark.machine_code)])
def test_rates_have_no_size_of_their_own(rate: float, length: float) -> None:
    """Contradictions are refused, and what follows follows, however slow or fast: of a loop, and of a pendulum beside it."""
    places = {k: length * v for k, v in {"Ax": 0, "Ay": 0, "Bx": 0.1, "By": 0.3, "Cx": 0.8, "Cy": 0.9, "Dx": 1.1, "Dy": 0}.items()}  # fmt: skip
    beside = "    body z { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0), start y.v = %r [m/s] }\n    hinge y : ground to z { at = (0, 0), start phi.omega = %r [1/s] }\n  }\n"  # fmt: skip
    text = FOUR_BAR.text(f"a {rate!r}").replace("  }\n", beside % (rate, rate), 1).replace("output ", "output slow = e.d.phi.omega, z = e.y.phi, ")  # fmt: skip
    text = text.replace("0 .. 1 us", f"0 .. {1e-9 / max(rate, 1.0)!r} s")
    slow = bondgraph.load(text).simulate("go", places, target="numpy")["slow"][0]
    assert slow / rate == pytest.approx(5 / 27, rel=1e-12)
    for other in (FOUR_BAR.text(f"a {rate!r},d {9 * rate!r}"), text.replace(f"y.v = {rate!r}", f"y.v = {2 * rate!r}")):
        with pytest.raises(RunFailed, match="cannot hold together"):
            bondgraph.load(other).simulate("go", places, target="numpy")


# ---------------------------------------------------------------- singular drawings
def test_a_flat_drawing_says_nothing_about_the_branch() -> None:
    """A parallelogram with all bars in line: the rocker could follow or cross."""
    places = {"Ax": 0, "Ay": 0, "Bx": 0.5, "By": 0.0, "Cx": 1.5, "Cy": 0.0, "Dx": 1.0, "Dy": 0.0}
    with pytest.raises(RunFailed, match="several ways from the drawing, a singular pose"):
        bondgraph.load(FOUR_BAR.text()).simulate("go", {**places, "start_a": 0.4}, target="numpy")


@pytest.mark.parametrize("turn", [0.3, -0.9, 2.0, 4.0])
def test_a_parallelogram_stays_one_or_is_refused(turn: float) -> None:
    """Its flat poses are crossings of two branches: no start leads over one."""
    places = {"Ax": 0, "Ay": 0, "Bx": 0.3, "By": 0.4, "Cx": 1.3, "Cy": 0.4, "Dx": 1.0, "Dy": 0.0}
    flat = math.pi - math.atan2(0.4, 0.3)
    try:
        found = bondgraph.load(FOUR_BAR.text()).simulate("go", {**places, "start_a": turn}, target="numpy")
    except RunFailed as failed:
        assert turn > flat and "singular pose" in str(failed)
    else:
        assert turn < flat
        assert found["o_d"][0] == pytest.approx(turn, abs=1e-12)


def test_an_open_chain_that_is_drawn_stretched_out_says_which_elbow_is_taken() -> None:
    text = """model A {
  multibody m : planar {
    body rod { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }
    body bob { mass = 1 kg, inertia = 1 [kg*m^2], at = (2 m, %s m) }
    hinge pin   : ground to rod { at = (0, 0) }
    hinge elbow : rod to bob    { at = (1.5 m, %s m) }
    frame tip   : bob           { at = (2.5 m, 0), start x = 0.5 m, start y = 1.2 m }
  }
  output x = m.tip.x, y = m.tip.y, elbow = m.elbow.phi
  experiment reach { simulate 0 .. 1 us { points = 2 } }
}
"""
    stretched = bondgraph.load(text % (0, 0)).simulate(target="numpy")
    assert any("several ways" in note for note in stretched.notes)
    for side in (0.1, -0.1):
        found = bondgraph.load(text % (side / 2, side)).simulate(target="numpy")
        assert (found["x"][0], found["y"][0]) == pytest.approx((0.5, 1.2), abs=1e-12)
        assert np.sign(found["elbow"][0]) == -np.sign(side), "the elbow stays on its side"
        assert not any("several ways" in note for note in found.notes)
