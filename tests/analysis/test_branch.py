"""Branches of rest: pull-in at a third of the gap, snap-through, buckling, the onset of oscillation; closed forms."""

from __future__ import annotations

import json
import math
from typing import cast

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.analysis.branch_line import _verified
from bondgraph.analysis.branch_steps import BranchFollower, BranchPlace
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from tests.compiling import MODELS

PLATE = """
model A {
  parameter g = 3 um, area = 1 [mm^2], eps = 8.85e-12 [F/m], k = 8 [N/m], m = 20 ug, r = 2e-4 [N*s/m], R = 1 kohm
  input volt = 0 V
  MSe source : u = volt
  R lead : u = R*i
  C plates(q: electric, x: translation) : energy = 1/2*q^2*(g - x)/(eps*area)
  1 plate : translation
  I mass : p = m*v
  C spring : F = k*x
  R air : F = r*v
  source -> 1(lead, plates.q)
  plate -> plates.x, mass, spring, air
  output x = spring.x
}
"""
TRUSS = """
model A {
  "Two bars lean against each other; pushed down at the top they snap through."
  parameter k = 1e4 [N/m], b = 1 m, h = 0.3 m, m = 1 kg, r = 20 [N*s/m]
  input load = 0 N
  constant l = sqrt(b^2 + h^2)
  MSe push : F = load
  C bars : energy = k*(sqrt(b^2 + (h - x)^2) - l)^2
  I mass : p = m*v
  R air : F = r*v
  push -> 1(bars, mass, air)
  output x = bars.x
}
"""


def test_pull_in() -> None:
    """At g/3 and V^2 = 8 k g^3/(27 eps A), then back along the unstable part to where the plates touch; the charge has its own way out."""
    found = bondgraph.load(PLATE).continuation("volt", 0.0, "5 V")
    (fold,) = found.folds
    assert fold.outputs["x"] == pytest.approx(3e-6 / 3, rel=1e-8)
    assert fold.value**2 == pytest.approx(8 * 8 * 3e-6**3 / (27 * 8.85e-12 * 1e-6), rel=1e-8)
    x, volt = found["x"], found.values
    assert 8 * x * 2 * (3e-6 - x) ** 2 == pytest.approx(8.85e-18 * volt**2, rel=1e-9, abs=1e-20)
    assert (found.stable == (x < 1e-6)).all()
    assert volt[-1] == pytest.approx(0, abs=1e-12) and x[-1] == pytest.approx(3e-6, rel=1e-9)


def test_snap_through() -> None:
    """Two folds, where the slope of 2 k y (l/s - 1) vanishes: s^3 = l b^2, with s the length of a bar and y = +-sqrt(s^2 - b^2)."""
    found = bondgraph.load(TRUSS).continuation("load", "-400 N", "400 N")
    length = math.hypot(1, 0.3)
    y = math.sqrt(length ** (2 / 3) - 1)
    load = 2e4 * y * (length / math.hypot(1, y) - 1)
    up, down = found.folds
    assert down.value == pytest.approx(-load, rel=1e-9) and found.values[-1] == pytest.approx(400, rel=1e-12)
    assert up.value == pytest.approx(load, rel=1e-9) and up.outputs["x"] == pytest.approx(0.3 - y, rel=1e-8)


def test_buckling_of_closed_loops() -> None:
    """Upright four-bars held by springs at their feet: upright is stable down to k = G/(N + 1)."""
    text = (MODELS / "published" / "iftomm_A02_N_fourbar.bg").read_text(encoding="utf-8")
    text = text.replace("parameter N = 40", "parameter k = 60 [N*m], N = 2").replace(
        "top_speed = 1 [m/s]", "top_speed = 0 [m/s]"
    )
    text = text.replace(
        "  output x", "  for i in 0..N { C spring[i] : M = k*phi; bars.foot[i] -> spring[i] }\n  output x", 1
    )
    found = bondgraph.load(text).continuation("k", "60 N*m", "5 N*m", points=10)
    (lost,) = found.special
    assert lost.kind == "branch" and lost.value == pytest.approx(9.81 * (3 / 2 + 2) / 3, rel=1e-9)
    assert (found.stable == (found.values > lost.value)).all() and found.values[-1] == pytest.approx(5, rel=1e-12)


def test_onset_of_oscillation() -> None:
    """A tank with R u = c u^3 - a u: at rest it is stable until a is zero."""
    text = """
    model A {
      parameter a = -1 [A/V], c = 0.1 [A/V^3]
      0 node : electric
      C tank : q = 2 F*u
      I coil : lambda = 3 H*i
      R lamp : i = c*u^3 - a*u
      node -> tank, coil, lamp
      output u = tank.u
    }
    """
    found = bondgraph.load(text).continuation("a", "-1 A/V", "0.7 A/V", points=7)
    assert [s.kind for s in found.special] == ["oscillation"] and found.special[0].value == pytest.approx(0, abs=1e-9)


COMB = """
model Comb {
  "Fingers that may go aside, with a stiffness along the beams that stays; all is symmetric."
  parameter n = 100, h = 38 um, gap = 4.25 um, c_0 = 20 um, k_g: N/m = 2.011105, k_l: N/m = 105070
  parameter eps0 = 8.8541878128e-12 [F/m], m = 40 ug, r = 2.5e-5 [N*s/m]
  input volt = 0 V
  MSe drive   : F = n*eps0*h*gap/(gap^2 - l.x^2)*volt^2
  MSe pull_in : F = 2*n*eps0*h*gap*l.x/(gap^2 - l.x^2)^2*(c_0 + c.x)*volt^2
  C c : F = k_g*x
  C l : F = k_l*x
  I along, aside : p = m*v
  R air, film : F = r*v
  drive -> 1(c, along, air)
  pull_in -> 1(l, aside, film)
  output out = l.x, deflection = c.x
}
"""


def test_side_instability_of_a_comb() -> None:
    """At (4.2) of the thesis, with n = 100, 415 V; from there two branches lead back to lower voltages, on which the fingers go aside: none is stable."""
    gap, k_g, k_l, c_0, comb = 4.25e-6, 2.011105, 105070.0, 20e-6, 100 * 8.8541878128e-12 * 38e-6
    side = math.sqrt(gap**2 * k_g / (2 * comb) * (math.sqrt(2 * k_l / k_g + (c_0 / gap) ** 2) - c_0 / gap))
    found = bondgraph.load(COMB).continuation("volt", 1.0, "600 V", branches=True)
    (lost,) = found.special
    assert round(side) == 415 and lost.kind == "branch" and lost.value == pytest.approx(side, rel=1e-10)
    assert (found.stable == (found.values < side)).all() and np.abs(found["out"]).max() < 1e-15
    one, other = found.others
    for branch in (one, other):
        out, volt, far = branch["out"][1:], branch.values[1:], branch["deflection"][1:]
        narrow = comb * gap / (gap**2 - out**2)
        assert far == pytest.approx(narrow * volt**2 / k_g, rel=1e-7)
        assert 2 * narrow / (gap**2 - out**2) * (c_0 + far) * volt**2 == pytest.approx(k_l, rel=1e-7)
        assert (np.diff(volt) < 0).all() and volt[-1] == pytest.approx(1.0) and not branch.stable[1:].any()
    assert one["out"][-1] == pytest.approx(-other["out"][-1], rel=1e-6) and abs(one["out"][-1]) > 4.2e-6


def test_branches_that_cross() -> None:
    """A rod on a coil under a load buckles at P = k/l into P l sin(phi) = k phi, both ways and stable; x' = p x - x^2 has x = p crossing x = 0."""
    rod = """
    model Rod {
      parameter k = 2 [N*m], l = 0.5 m
      input load = 1 N
      I bob : L = 0.1 [kg*m^2]*omega
      R air : M = 0.05 [N*m*s]*omega
      C coil : M = k*phi
      MSe top : M = load*l*sin(coil.phi)
      top -> 1(bob, coil, air)
      output phi = coil.phi
    }
    """
    found = bondgraph.load(rod).continuation("load", "1 N", "6 N", branches=True)
    assert [s.value for s in found.special] == [pytest.approx(4.0, rel=1e-10)]
    for branch in found.others:
        phi = branch["phi"][1:]
        assert branch.values[1:] * 0.5 * np.sin(phi) == pytest.approx(2 * phi, rel=1e-8) and branch.stable[1:].all()
    assert {bool(b["phi"][-1] > 0) for b in found.others} == {True, False}
    cross = bondgraph.load("model X {\n  input p = 0\n  signal x = integral((p*x - x^2)/1 s, 0)\n  output y = x\n}\n")
    found = cross.continuation("p", -1.0, 1.0, branches=True)
    assert [s.kind for s in found.special] == ["branch"] and found.special[0].value == pytest.approx(0.0, abs=1e-9)
    ends = sorted(float(b.values[-1]) for b in found.others)
    assert ends == [pytest.approx(-1.0), pytest.approx(1.0)]
    assert all(b["y"] == pytest.approx(b.values, abs=1e-8) for b in found.others)


@pytest.mark.machine_code
def test_command_and_refusals(tmp_path: object) -> None:
    from pathlib import Path

    file = Path(str(tmp_path)) / "plate.bg"
    file.write_text(PLATE, encoding="utf-8")
    done = CliRunner().invoke(commands, ["continue", str(file), "--along", "volt = 0 V .. 5 V", "--json"])
    told = json.loads(done.stdout)
    assert told["schema"] == "bondgraph-branch/1" and [s["kind"] for s in told["special"]] == ["fold"]
    assert np.isfinite(told["outputs"]["x"]["values"]).all()
    assert "fold" in CliRunner().invoke(commands, ["continue", str(file), "--along", "volt = 0 V .. 5 V"]).output
    comb = file.with_name("comb.bg")
    comb.write_text(COMB, encoding="utf-8")
    asked = ["continue", str(comb), "--along", "volt = 1 V .. 600 V"]
    assert "another branch of rest crosses" in CliRunner().invoke(commands, asked).output
    told = json.loads(CliRunner().invoke(commands, [*asked, "--branch", "--json"]).stdout)
    assert len(told["others"]) == 2 and told["others"][0]["schema"] == "bondgraph-branch/1"
    with pytest.raises(UsageError, match="`x` is no parameter or input"):
        bondgraph.load(PLATE).continuation("x", 0.0, 1.0)
    with pytest.raises(UsageError, match="is no quantity in V"):
        bondgraph.load(PLATE).continuation("volt", "0 V", "1 m")


def test_a_test_function_that_is_zero_at_an_end_changes_no_sign() -> None:
    """Nothing is followed then: the follower, None, is not asked."""
    here, found = cast("BranchPlace", 0.0), cast("BranchPlace", 1.0)
    for zero in (here, found):
        assert not _verified("branch", cast("BranchFollower", None), here, found, 1.0, lambda p, z=zero: float(p != z))


def test_a_momentum_that_is_rounding_has_no_magnitude() -> None:
    """A weight on a spring, followed along its mass, which its momentum is measured by: x = m g/k to the end, from either side."""
    text = "plain model Hung { parameter m = 2\n Se w : e = 9.81*m\n I mass : p = m*f\n C spring : e = 1000*q\n R loss : e = 10*f\n 1 j\n w -> j -> mass, spring, loss\n output x = spring.q }"
    model = bondgraph.load(text)
    for low, high in ((1.0, 4.0), (4.0, 1.0)):
        branch = model.continuation("m", low, high)
        assert branch.ended == "`m` leaves the range" and branch.values[-1] == high
        np.testing.assert_allclose(branch.outputs["x"], branch.values * 9.81e-3, rtol=1e-12)


def along(rate: str, more: str = "") -> bondgraph.Model:
    """A signal x with this rate in 1/s, and an input a."""
    return bondgraph.load(f"model A {{ input a = 0\n {more}\n signal x = integral(({rate})/1 s, 0)\n output y = x\n}}")


@pytest.mark.few(4)
@pytest.mark.parametrize("factor", [0.3, 2.0, 30.0])
@pytest.mark.parametrize(
    "law", ["x if x < 1 else F*(x - 1) + 1", "x + (F - 1)*max(x - 1, 0)", "linear(x, (-9, 1, 2, 9), (-9, 1, 1 + F, 1 + 8*F))"]
)  # fmt: skip
def test_a_branch_goes_on_behind_a_bend(law: str, factor: float) -> None:
    """Straight on both sides; where a spring became twice as stiff, the branch ended."""
    found = along(f"a - ({law.replace('F', str(factor))})").continuation("a", 0.0, 1.5)
    y = found["y"]
    assert found.values == pytest.approx(np.where(y < 1, y, factor * (y - 1) + 1), abs=1e-9)
    assert "leaves the range" in found.ended and found.stable.sum() >= len(y) - 2


@pytest.mark.parametrize(
    ("rate", "more", "end", "words"),
    [
        ("a - x - (1 if on else 0)", "mode on = false\n when x > 0.8 { on = true }", 0.8, "acts `when x > 0.8`"),
        ("a - x - (1 if hysteresis(x, 0.2, 0.7) else 0)", "", 0.7, "acts `when x > 0.7`"),
        ("a - (x if x < 0.6 else x + 1)", "", 0.6, "jump with the condition in `x`"),
        (
            "a - x + (x if on else 0)",
            "mode on = false\n when a - 2*x < -0.5 { on = true }",
            0.5,
            "acts `when a - 2*x < -0.5`",
        ),
    ],
)
def test_a_branch_ends_where_the_model_becomes_another_one(rate: str, more: str, end: float, words: str) -> None:
    """It went on in the mode of its first point: 3 for a relay whose rest at a = 3 is 2."""
    found = along(rate, more).continuation("a", 0.0, 3.0)
    assert found["y"] == pytest.approx(found.values, abs=1e-12)
    assert found.values[-1] == pytest.approx(end, rel=1e-8) and words in found.ended


@pytest.mark.parametrize(("last", "end", "words"), [(1.49, 1.49, "leaves the range"), (3.0, 1.5, "the table `linear(…)` of `x`")])  # fmt: skip
def test_a_branch_goes_to_the_end_of_a_table(last: float, end: float, words: str) -> None:
    """A step that went beyond it refused the whole branch."""
    found = along("a - linear(x, (-9, 1.5), (-9, 1.5))").continuation("a", 0.0, last)
    assert found["y"] == pytest.approx(found.values, abs=1e-12)
    assert found.values[-1] == pytest.approx(end, rel=2e-5) and words in found.ended


def test_what_an_event_counts_ends_no_branch() -> None:
    """A mode that no rate reads; and friction that sticks, up to its limit."""
    found = along("a - x", "mode n = 0\n when x > 0.8 { n = n + 1 }").continuation("a", 0.0, 3.0)
    assert "leaves the range" in found.ended and found["y"] == pytest.approx(found.values, abs=1e-12)
    stuck = bondgraph.load("""import DryFriction from mechanics
model A {
  input a = 0 N
  MSe push : F = a
  I mass : p = 1 kg*v
  C spring : F = 10 [N/m]*x
  DryFriction part { F_c = 1 N, F_s = 1.5 N }
  push -> 1(spring, part.ends) -> mass
  output x = spring.x
}""").continuation("a", 0.0, 3.0)
    assert stuck.values[-1] == pytest.approx(1.5, rel=1e-8) and "abs(end.F) > F_s" in stuck.ended


def test_a_jump_with_the_parameter_is_told() -> None:
    """Conditions on the parameter alone, of any size; beside a slope, on two sides of a flank, and where the slope changes, too."""
    text = "plain model A {{ parameter a = 0\n Se s : e = {law}\n C c : e = 2*q\n R r : e = f\n s -> 1(c) -> r\n output x = c.q }}"
    laws = {
        "3 if a > 0.5 else 1": [0.5], "a + (1e-3 if a > 0.512 else 0)": [0.512], "a*(2 if a > 0.512 else 1)": [0.512],
        "floor(2*a + 0.5)": [0.25, 0.75], "tanh((a - 0.512)/1e-5)": [], "max(0, min(1, (a - 0.512)/1e-4))": [],
    }  # fmt: skip
    for law, places in laws.items():
        branch = bondgraph.load(text.format(law=law)).continuation("a", 0, 1)
        jumps = [s for s in branch.special if s.kind == "jump"]
        assert [s.value for s in jumps] == pytest.approx(places, abs=1e-12), law
        assert len(jumps) == len(branch.special) and branch.values[-1] == pytest.approx(1.0)
        assert all(s.value in branch.values for s in jumps)
    branch = bondgraph.load(text.format(law="3 if a > 0.5 else 1")).continuation("a", 1, 0)
    assert [(s.kind, s.outputs["x"]) for s in branch.special] == [("jump", 0.5)]
    assert "jump" in branch.summary()


def test_a_jump_between_a_condition_on_a_state_and_the_end() -> None:
    text = (
        "plain model A { parameter a = 0\n Se s : e = a + (1 if a > 0.3 else 0)\n"
        " C c : e = q + (q - 0.25 if q > 0.25 else 0) + (q - 1.5 if q > 1.5 else 0)\n R r : e = f\n s -> 1(c) -> r\n output x = c.q }"
    )
    branch = bondgraph.load(text).continuation("a", 0, 3, points=3)
    a, x = branch.values, branch.outputs["x"]
    np.testing.assert_allclose(x + np.maximum(x - 0.25, 0) + np.maximum(x - 1.5, 0), a + (a > 0.3), atol=1e-9)
    assert [s.kind for s in branch.special] == ["jump"]
