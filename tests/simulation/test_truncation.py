"""Report of a result on modes that a bandwidth truncated, beside runs that follow every turn: decays, ringings that die or grow, many of them."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.results.archive import read_result
from bondgraph.simulation.truncation.spectrum_split import Split, split

# A heavy and a light mass (506 Hz) with what a damper between them dissipates.
HEAT = """model Heat {
  parameter r = 1 [N*s/m]
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x
  R d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  output xa = wall.x, s = link.x, heat = integral(d.F*d.v, 0 J), power = d.F*d.v
  experiment both { start mb.v = 3 [m/s]; start link.x = 1 mm; start wall.x = 50 mm; simulate 0 .. 3 s; bandwidth 60 Hz }
}"""

# A small condenser that discharges into a large one within microseconds: 4.5 nJ of heat.
CONDENSERS = """model Condensers {
  C small : u = q/(1 nF) {start u = 3 V}
  R r : u = 100 ohm*i
  C big : u = q/(1 uF) + 1e11 [V/C^3]*q^3
  R load : u = 10 kohm*i
  0 a, b
  a -> small
  a -> 1(r) -> b -> big, load
  output us = small.u, ub = big.u, heat = integral(r.u*r.i, 0 J), i = r.i
  experiment go { simulate 0 .. 5 ms }
}"""

# A light mass (506 Hz) whose link to a mass of 1 kg is not linear.
PUSHED = """model Pushed {
  parameter r = 0 [N*s/m], k3 = 1e9 [N/m^3]
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x + k3*x^3
  R d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  C far : F = 50 [N/m]*x + 3000 [N/m^3]*x^3
  b -> far
  output xa = wall.x, s = link.x
  experiment off { start link.x = 1 mm; start wall.x = 50 mm; start far.x = 50 mm; simulate 0 .. 3 s; bandwidth 60 Hz }
}"""
FILTERED = PUSHED.replace(
    "output xa",
    "signal wf = integral((200 [1/s] + 1800 [1/s]*smoothstep5(time, 0.1 s, 0.6 s))*(cos(2 [1/s]*time) - wf), 1)\n"
    "  output filtered = wf, xa",
)


# ---------------------------------------------------------------- what decays without a turn
def test_what_decays_is_followed() -> None:
    """3 V on 1 nF are turned into heat, 4.5 nJ; an overdamped pair as well: bit by bit what it is without a bandwidth."""
    for text, hertz, joules, settings in (
        (CONDENSERS, 10e3, 4.5e-9, {}),
        (HEAT, 60, 0.0946, {"r": 300.0}),
    ):
        model = bondgraph.load(text)
        found, usual = (model.simulate(settings=settings, bandwidth=b) for b in (hertz, 1e12))
        told = found.truncation
        assert told is not None and not told.instants and told.faster == 0
        assert "nothing that is faster rings" in told.reason
        assert (found.values == usual.values).all()
        assert found["heat"][-1] == pytest.approx(joules, rel=1e-2)


@pytest.mark.machine_code
def test_a_decay_that_gets_faster_than_the_bandwidth() -> None:
    """A filter whose rate crosses the bandwidth does not change the report on a ringing elsewhere."""
    plain, filtered = (bondgraph.load(text).simulate().truncation for text in (PUSHED, FILTERED))
    assert plain is not None and filtered is not None and filtered.reason == ""
    assert plain.kept["xa"] > 1e-5 and filtered.kept["xa"] == pytest.approx(plain.kept["xa"], rel=0.3)


# ---------------------------------------------------------------- a ringing on its way
# Beside the ringing something quiet gets faster than the bandwidth, from 3 Hz to 300 Hz.
BESIDE = PUSHED.replace(
    "output xa",
    "signal q1 = integral(q2, 0 m), q2 = integral(-(20 [1/s] + 1980 [1/s]*smoothstep5(time, 0.1 s, 0.6 s))^2*q1, 0 [m/s])\n  output quiet = q1, xa",
)
# A stiffness that changes in time, by which the frequency of 506 Hz goes to `part` of it.
SOFTENS = """model Softens {
  parameter part = 0.1, k3 = 1e6 [N/m^3], r = 0 [N*s/m]
  signal gap = integral(b.v - a.v, 1 mm)
  signal k = 1e5 [N/m]*(1 - (1 - part^2)*smoothstep5(time, 0.2 s, 1.8 s))
  1 a, b
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  MSe one : F = k*gap + k3*gap^3
  MSe other : F = -k*gap - k3*gap^3
  R d : F = r*v
  one -> a -> ma, wall
  0 ab
  a -> ab -> 1(d)
  ab -> b
  other -> b -> mb
  output xa = wall.x, s = gap
  experiment off { start wall.x = 20 mm; simulate 0 .. 2 s; bandwidth 60 Hz }
}"""
# The damping changes its sign with the place of a slow mass, so that the ringing decays, then grows.
GROWS = """model Grows {
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 40 [N/m]*x + 10 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x + 1e6 [N/m^3]*x^3
  signal r = 0.25 [N*s/m]*(wall.x/(50 mm))
  MR d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  output xa = wall.x, s = link.x
  experiment off { start link.x = 0.1 mm; start wall.x = 15 mm; start ma.v = -0.3 [m/s]; simulate 0 .. 0.5 s; bandwidth 60 Hz }
}"""


@pytest.mark.machine_code
def test_modes_that_get_faster_beside_it() -> None:
    """The report on a ringing is not smaller if further modes become faster than the bandwidth later."""
    plain, beside = (bondgraph.load(text).simulate().truncation for text in (PUSHED, BESIDE))
    assert plain is not None and beside is not None
    assert plain.kept["xa"] > 1e-5 and beside.kept["xa"] == pytest.approx(plain.kept["xa"], rel=0.3)


@pytest.mark.machine_code
def test_a_ringing_that_gets_slower_than_the_bandwidth() -> None:
    """It is followed as long as it is recognised, also below the bandwidth."""
    model = bondgraph.load(SOFTENS)
    found, full = model.simulate(rtol=1e-8), model.simulate(rtol=1e-10, bandwidth="1 THz")
    told = found.truncation
    assert told is not None and told.kept["xa"] > 0
    assert told.outputs["s"] == pytest.approx(np.abs(full["s"] - found["s"]).max(), rel=0.3)


def test_what_is_not_known_is_told(tmp_path: Path) -> None:
    """A stiffness that vanishes leaves no mode: the effect of the ringing is then reported as unknown, not as 0."""
    found = bondgraph.load(SOFTENS).simulate(settings={"part": 0.0, "k3": 0.0})
    told = found.truncation
    assert told is not None and math.isnan(told.kept["xa"]) and told.outputs["s"] > 1e-3
    assert "what it does to the motion that is kept is not known" in str(told)
    assert "what rings is not told from what is kept" in told.reason
    text = json.dumps(found.to_json(), allow_nan=False)
    assert json.loads(text)["bandwidth"]["kept"]["xa"] is None
    found.to_npz(tmp_path / "r.npz")
    assert read_result(tmp_path / "r.npz").truncation == told


@pytest.mark.machine_code
def test_a_ringing_that_grows_later() -> None:
    """It is 40 times larger at the end, which is reported with the instant of its beginning."""
    model = bondgraph.load(GROWS)
    found, full = (
        model.simulate(points=5001),
        model.simulate(points=5001, rtol=1e-10, bandwidth="1 THz", solver="explicit"),
    )
    told = found.truncation
    assert told is not None
    assert told.outputs["s"] == pytest.approx(np.abs(full["s"] - found["s"]).max(), rel=0.3)
    said = re.search(r"what was left out grows from t = ([0-9.]+) s on, to ([0-9.]+) times as much", str(told))
    slow = found["xa"]
    turns = float(found.time[np.flatnonzero((slow[1:] < 0) & (slow[:-1] >= 0))[0]])
    assert said is not None and float(said[1]) == pytest.approx(turns, abs=0.03) and 20 < float(said[2]) < 100


@pytest.mark.machine_code
@pytest.mark.parametrize("damping", [0.05, 1.0, 5.0])
def test_a_ringing_that_decays_pushes_no_longer(damping: float) -> None:
    """Its energy becomes heat, if the losses are known, and it has an effect as long as it lasts."""
    model = bondgraph.load(HEAT)
    found, full = (
        model.simulate(settings={"r": damping}),
        model.simulate(settings={"r": damping}, rtol=1e-10, bandwidth="1 THz"),
    )
    told = found.truncation
    assert told is not None and told.instants[0] == 0.0
    lacks = full["heat"][-1] - found["heat"][-1]
    assert told.kept["heat"] == pytest.approx(lacks, rel=0.5)


@pytest.mark.machine_code
@pytest.mark.parametrize("damping", [0.2, 1.0, 5.0])
def test_what_a_decaying_ringing_does(damping: float) -> None:
    model = bondgraph.load(PUSHED)
    settings = {"r": damping}
    found = model.simulate(settings=settings, rtol=1e-9)
    full = model.simulate(settings=settings, rtol=1e-11, solver="explicit", bandwidth="1 THz")
    told, late = found.truncation, found.time > 3 * 0.02 / damping  # when nothing rings any more
    lacks = np.abs(full["xa"] - found["xa"])[late].max()
    assert told is not None and lacks / 3 < told.kept["xa"] < 3 * lacks


# ---------------------------------------------------------------- in the outputs
@pytest.mark.machine_code
@pytest.mark.parametrize("damping", [0.05, 1.0, 10.0])
def test_outputs_that_go_with_the_square(damping: float) -> None:
    """A power and a stored energy: the whole dissipation or storage by the ringing."""
    model = bondgraph.load(HEAT.replace("output xa", "output stored = link.F*link.x/2, xa"))
    asked = {"settings": {"r": damping}, "points": 20001, "to": 0.2}
    found, full = model.simulate(**asked), model.simulate(**asked, rtol=1e-10, bandwidth="1 THz")
    told = found.truncation
    assert told is not None
    for name in ("power", "stored"):
        lacks = np.abs(full[name] - found[name]).max()
        assert lacks / 2 < told.outputs[name] < 2 * lacks


# ---------------------------------------------------------------- many of them
# A force on the light mass that changes its sign again and again.
SQUARE = """model Square {
  parameter r = 0 [N*s/m], f = 19.777 [1/s]
  input pull = 0 N
  MSe hand : F = pull
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x + 1e7 [N/m^3]*x^3
  R d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  hand -> b
  output xa = wall.x, s = link.x
  experiment go { set pull = 1 N*(1 if sin(2*pi*f*time + 0.3) > 0 else -1); simulate 0 .. 3 s; bandwidth 60 Hz }
}"""


@pytest.mark.machine_code
@pytest.mark.parametrize(("frequency", "damping"), [(19.777, 0.0), (505.78 / 45, 0.0), (7.123, 5.0)])
def test_a_ringing_that_is_set_off_again_and_again(frequency: float, damping: float) -> None:
    """By up to 120 jumps, each of which adds to the remaining ringing with its phase: in step, out of step, and after its decay."""
    model, asked = bondgraph.load(SQUARE), {"settings": {"f": frequency, "r": damping}, "points": 12001}
    found, full = (
        model.simulate(**asked, rtol=1e-8),
        model.simulate(**asked, rtol=1e-9, solver="explicit", bandwidth="1 THz"),
    )
    told = found.truncation
    assert told is not None and len(told.instants) > 40
    lacks = np.abs(full["s"] - found["s"]).max()
    assert lacks / 2.5 < told.outputs["s"] < 2.5 * lacks
    assert [round(m.frequency) for m in told.modes] == [506]
    assert "a mode at 505.8 Hz" in str(told)


def test_where_it_was_looked_at_is_told() -> None:
    """Beside a mass on a spring that is not linear (0 Hz there), from rest: a force that grows excites it, else there was nothing to look at."""
    model = bondgraph.load(
        "plain model Still { signal x = integral(v, 0), v = integral(time - x^3, 0) \n output a = x }"
    )
    told = model.simulate(to=1, bandwidth=10).truncation
    assert told is not None and "its fastest motion is one of 0 Hz at t = 0 s where it was looked at" in told.reason


# ---------------------------------------------------------------- what is required
LEAF = """model Leaf {
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x
  a -> ma, wall
  a -> ab -> 1(link)
  ab -> b -> mb
  require abs(link.x) < 0.2 mm "the leaf yields"
  require abs(link.x) < 2 mm "the leaf breaks"
  output xa = wall.x, s = link.x
  experiment off { start link.x = 0.1 mm; start mb.v = 2 [m/s]; start wall.x = 50 mm; simulate 0 .. 0.1 s }
}"""


def test_what_is_required_is_asked_of_what_is_left_out() -> None:
    """The ringing exceeds a limit that neither the start nor the slow motion exceeds: the same warning as in the full run, at the same time."""
    model = bondgraph.load(LEAF)
    found, full = model.simulate(bandwidth="60 Hz"), model.simulate()
    assert found.truncation is not None and found.truncation.instants == (0.0,)
    (told,), (wanted,) = found.warnings, full.warnings
    assert told.text == wanted.text == "the leaf yields"
    assert told.time == pytest.approx(wanted.time, rel=0.05)
    assert told.values[0][1] == pytest.approx(wanted.values[0][1], rel=1e-3)


@pytest.mark.machine_code
def test_a_ringing_that_goes_on_where_something_else_is_left_out() -> None:
    """It is below the bandwidth by then, so that it is none of the truncated modes; it gets larger as it gets slower still."""
    text = SOFTENS.replace(
        "output xa",
        "signal q1 = integral(q2, 0 mm), q2 = integral(4e6 [1/s^2]*(1 mm*step(time - 1.65 s) - q1), 0 [m/s])\n  output quick = q1, xa",
    )
    model, asked = bondgraph.load(text), {"settings": {"part": 0.02}, "points": 4001}
    found, full = model.simulate(**asked), model.simulate(**asked, rtol=1e-9, bandwidth="1 THz")
    told = found.truncation
    assert told is not None and any(1.64 < t < 1.66 for t in told.instants)
    lacks = np.abs(full["s"] - found["s"]).max()
    assert lacks / 1.5 < told.outputs["s"] < 1.5 * lacks


def test_each_eigenvalue_belongs_to_one_part() -> None:
    """Two oscillations and two decays, one of each on either side of the rate."""
    matrix = np.zeros((6, 6))
    matrix[:2, :2], matrix[2:4, 2:4] = [[-1, 1000], [-1000, -1]], [[-0.1, 2], [-2, -0.1]]
    matrix[4, 4], matrix[5, 5] = -500, -1
    (found,) = split(matrix[None], 100.0)
    assert isinstance(found, Split)
    parts = [
        sorted(part.tolist(), key=lambda v: (v.real, v.imag)) for part in (found.values, found.others, found.decays)
    ]
    wanted = [[-1 - 1000j, -1 + 1000j], [-1, -0.1 - 2j, -0.1 + 2j], [-500]]
    for part, values in zip(parts, wanted, strict=True):
        np.testing.assert_allclose(part, values, rtol=1e-12)
