"""Laws that bend or jump exactly at rest: linear analyses refuse them by name, equilibria are found without a verdict; kinks elsewhere change nothing."""

from __future__ import annotations

import math

import pytest

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from tests.compiling import ROOT

TEXT = """model S {{
  parameter none = 0, gap = 0 m, stop = 1 mm
  parameter X: m = (-1, 0, 1), Y: N = (-1, 0, {up})
  input push = 0 N
  C spring : F = {spring} {{ start x = {start} }}
  I mass : p = 1 kg*v
  {letters} loss : F = {loss}
  MSe force : F = push
  force -> 1(spring, mass, loss)
  output x = spring.x
}}
"""
SOFT, LINEAR, TABLE = "1 [N*s/m]*v", "4 [N/m]*x", "linear(spring.x, X, Y)"


def model(spring: str = LINEAR, loss: str = SOFT, start: str = "0 m", up: float = 1) -> bondgraph.Model:
    letters = "MR" if "*x*" in loss else "R"
    return bondgraph.load(TEXT.format(spring=spring, loss=loss, start=start, up=up, letters=letters))


LOSSES = [
    "1 [N*s/m]*v if v > 0 [m/s] else 3 [N*s/m]*v",
    "1 [N*s/m]*v if v >= 0 [m/s] else 3 [N*s/m]*v",
    "1 [N*s/m]*abs(v)",
    "1 [N*s/m]*max(v, 0 [m/s])",
    "1 [N*s/m]*min(v, 0 [m/s])",
    "2 [N*s/m]*v + 1e-3 [N*s/m]*abs(v)",
    "2 N*sign(v)",
    "2 N*sign(v) + 0.1 [N*s/m]*v",
    "1 N if abs(v) > 0 [m/s] else 0 N",
    "1e-6 N*sign(v)",
    "1 [N*s/m]*max(v, 0 [m/s]) + 3 [N*s/m]*max(-v, 0 [m/s])",
    "1 [N*s/m]*min(max(v, 0 [m/s]), 1 [m/s])",
    "1 N*sign(v)*(0.5 + exp(-(v/1e-3 [m/s])^2))",
    "1 [N*s/m]*sqrt(v*v)",
    "1 N*min(abs(v/1 [m/s]), 1)*sign(v) + 1 [N*s/m]*max(v, 0 [m/s])",
    "1 [N*s/m]*max(v, -2*v)",
]
SPRINGS = [
    "4 [N/m]*max(x, 0 m)",
    "4 [N/m]*x + 1e12 [N/m]*max(x, 0 m)",
    "1e12 [N/m]*x + 1e5 [N/m]*max(x, 0 m)",
    "4 [N/m]*x if x > 0 m else 2 [N/m]*x",
    "4 [N/m]*max(x, 0 m) + 2 [N/m]*min(x + stop, 0 m)",
    "4 [N/m]*max(x - gap, 0 m)",
    "4 [N/m]*x + 5 [N/m]*(max(x - gap, 0 m) + min(x + gap, 0 m)/2)",
    "4 [N/m]*x + 2 [N/m]*abs(x - none*1 m)",
    "4 [N/m]*x + 1 [N/m]*abs(abs(x))",
    "4 [N/m]*x + 1 N*max(sin(x/1 m), 0)",
]
SMOOTH = [
    (LINEAR, SOFT),
    ("4 [N/m]*max(x, 0 m) + 4 [N/m]*min(x, 0 m)", SOFT),
    ("4 [N/m]*x", "1 [N*s/m]*v + none*2 [N*s/m]*abs(v)"),
    ("4 [N/m]*x", "1 [N*s/m]*v + 1 [N*s^2/m^2]*v*abs(v)"),
    ("4 [N/m]*x", "1 [N*s/m]*v + 1 [N*s/m^2]*x*max(v, 0 [m/s])"),
    ("4 [N/m]*x + 1 [N/m]*max(x - 1e-8 m, 0 m)", SOFT),
    ("4 [N/m]*x + 1 [N/m]*max(x - stop, 0 m)", SOFT),
    ("4 [N/m]*x", "1 [N*s/m]*v + 1 [N*s/m]*max(v - 1e-6 [m/s], 0 [m/s])"),
    ("4 [N/m]*x", "1 [N*s/m]*v if v > 0 [m/s] else 1 [N*s/m]*v"),
    ("4 [N/m]*x + 1 [N/m]*abs(x) - 1 [N/m]*abs(-x)", SOFT),
    ("4 [N/m]*x + 1 N*smoothstep5(x, 0 m, 1 m)", SOFT),
    ("4 [N/m]*x + 1 N*smoothstep3(x, 0 m, 1 m)", SOFT),
    ("4 [N/m]*x + 1 N*max(x/1 m, 0)^2", SOFT),
    ("4 [N/m]*x + 1 [N/m]*(max(x + 1 m, 0 m) - 1 m)  - 1 [N/m]*x", SOFT),
    ("4*linear(x, X, Y)", SOFT),
]


@pytest.mark.few(8)
@pytest.mark.parametrize("loss", LOSSES)
def test_a_resistor_that_bends_at_rest(loss: str) -> None:
    refused(model(loss=loss), "loss")


@pytest.mark.parametrize("spring", SPRINGS)
def test_a_spring_that_bends_at_rest(spring: str) -> None:
    refused(model(spring=spring), "spring")


@pytest.mark.parametrize(
    ("spring", "start"),
    [
        ("4 [N/m]*max(min(x, 1 m), -1 m)", "1 m"),
        ("4 N*(1 if x > 0.1 m + 0.2 m else 0)", "0.3 m"),
        ("4 [N/m]*abs(x - 3 m)", "3 m"),
        ("4 [N/m]*(max(x - stop, 0 m) + min(x + stop, 0 m))", "1 mm"),
    ],
)
def test_a_kink_away_from_zero(spring: str, start: str) -> None:
    with pytest.raises(RunFailed, match="no linear model"):
        model(spring=spring, start=start).modes(state="start")


def refused(bent: bondgraph.Model, owner: str) -> None:
    for analysis in (bent.linearize, bent.modes, bent.sensitivity, bent.response):
        with pytest.raises(RunFailed, match=rf"by the law of `{owner}` .*no linear model") as caught:
            analysis()  # type: ignore[operator]
        assert caught.value.code == "BR263"
    found = bent.equilibrium()
    assert found["x"] == 0 and found.stable is None
    assert found.verdict.kink == "mass.p" and "not decided" in found.summary()


def test_a_bend_far_from_small_values() -> None:
    """Charges of picocoulombs: a step of 1e-10 of one coulomb is thousands of them, and over the bend of a junction's law."""
    amplifier = bondgraph.load(ROOT / "tests/metamorphic/circuits/amplifier.bg")
    for lift in ("12 V", "0 V"):
        assert len(amplifier.modes(settings={"lift": lift})) == 3
        assert amplifier.equilibrium(settings={"lift": lift}).stable


@pytest.mark.parametrize(("spring", "loss"), SMOOTH)
def test_a_law_with_one_slope(spring: str, loss: str) -> None:
    linear = model(spring, loss).linearize()
    assert linear.A[1] == pytest.approx([-4.0, -1.0] if linear.states[0] == "spring.x" else [-1.0, -4.0], rel=1e-6)
    assert model(spring, loss).equilibrium().stable


def test_a_point_of_a_table() -> None:
    """Only `modes` refused it: the slopes of others had the side from there on, without a word."""
    refused(model("4*linear(x, (-1 m, 0 m, 1 m), (-1 N, 0 N, 3 N))"), "spring")


def test_the_advice_works() -> None:
    law = LOSSES[0]
    for speed, damping in (("1e-6 [m/s]", 1.0), ("-1e-6 [m/s]", 3.0)):
        text = TEXT.format(spring=LINEAR, loss=law, start="0 m", up=1, letters="R").replace(
            "kg*v", f"kg*v {{ start v = {speed} }}"
        )
        modes = bondgraph.load(text).modes(state="start")
        assert modes[0].damping == pytest.approx(damping / 4, rel=1e-9)
    assert model(loss="2 N*tanh(v/1 [m/s])").modes()[0].damping == pytest.approx(0.5)


def test_outputs_that_bend() -> None:
    text = TEXT.format(spring=LINEAR, loss=SOFT, start="0 m", up=3, letters="R")
    for law in (
        "abs(spring.x)",
        TABLE,
        "1 if spring.x > 0 m else 0",
        "sign(mass.v)",
        "floor(spring.x/1 m)",
        "abs(push)",
    ):
        bent = bondgraph.load(text.replace("output x", f"output y = {law}, x"))
        with pytest.raises(RunFailed, match=r"the equation of `.*no linear model"):
            bent.linearize()
        assert bent.linearize(outputs=["x"]).C.shape == (1, 2)
        assert bent.modes()[0].frequency == pytest.approx(1 / math.pi)
        if "push" not in law:
            assert math.isnan(bent.modes()[0].outputs["y"].real) and not math.isnan(bent.modes()[0].outputs["x"].real)


def test_inputs_that_bend() -> None:
    text = TEXT.format(spring=LINEAR, loss=SOFT, start="0 m", up=1, letters="R")
    table = "linear(push, (-1 N, 0 N, 1 N), (0 N, 0 N, 1 N))"
    for law in ("max(push, 0 N)", "2 N*sign(push/1 N)", "push if push > 0 N else 2*push", table):
        bent = bondgraph.load(text.replace("F = push", f"F = {law}"))
        with pytest.raises(RunFailed, match="no linear model"):
            bent.linearize()
        assert bent.modes()[0].damping == pytest.approx(0.25)


def test_two_bends_in_two_variables() -> None:
    """The slopes agree on opposite sides, but not all around."""
    for law in ("max(min(u, abs(w)), -abs(w))", "abs(u + w) - abs(u - w)", "max(u, 0 [m/s]) - max(w, 0 [m/s])"):
        text = f"""model S {{
          I a : p = 1 kg*v
          I b : p = 1 kg*v
          signal w = b.v, u = a.v
          MSe drag : F = -1 [N*s/m]*({law})
          R one : F = 1 [N*s/m]*v
          R two : F = 1 [N*s/m]*v
          drag -> 1(a, one)
          1 second
          second -> b
          second -> two
        }}"""
        with pytest.raises(RunFailed, match="no linear model"):
            bondgraph.load(text).modes()


def test_loops_and_valves() -> None:
    loop = """model S {
      input push = 0 V
      MSe source : e = push
      C store : q = 1 F*e
      R first : e = 1 [ohm]*f + 1 [ohm]*max(f, 0 A)
      R second : e = 2 [ohm]*f
      R third : e = 1 [ohm]*f + 1 V*tanh(f/1 A)
      1 left : electric
      1 right : electric
      0 mid : electric
      source -> left -> first
      left -> mid -> second
      mid -> right -> third
      right -> store
    }"""
    with pytest.raises(RunFailed, match="no linear model"):
        bondgraph.load(loop).linearize()


SAMPLED = """model S {{
  mode u = 0 N
  input aim = 0 m
  MSe act : F = {act}
  I m : p = 1 kg*v
  C spring : F = 4 [N/m]*x
  R d : F = 1 [N*s/m]*v
  act -> 1(m, spring, d)
  every 10 ms {{ u = {law} }}
  output x = spring.x
}}
"""


@pytest.mark.parametrize(
    ("act", "law"),
    [
        ("u", "max(2 [N/m]*(aim - spring.x), 0 N)"),
        ("u", "1 N*sign(aim - spring.x)"),
        ("u", "1 N if spring.x > 0 m else -1 [N/m]*spring.x"),
        ("max(u, 0 N)", "2 [N/m]*(aim - spring.x)"),
        ("2 N*sign(u)", "2 [N/m]*(aim - spring.x)"),
    ],
)
def test_a_sampled_loop(act: str, law: str) -> None:
    bent = bondgraph.load(SAMPLED.format(act=act, law=law))
    with pytest.raises(RunFailed, match="no linear model"):
        bent.response(inputs=["aim"], outputs=["x"], low=1, high=2)
    assert bent.equilibrium().stable is None
    assert bondgraph.load(SAMPLED.format(act="u", law="min(2 [N/m]*(aim - spring.x), 1 N)")).equilibrium().stable


@pytest.mark.machine_code
def test_searches_go_through_kinks() -> None:
    """Inverse problems and branches have their points; a verdict is given where there is one."""
    damped = model(loss=LOSSES[0])
    assert damped.invert({"x": "1 m"}, ["push"]).inputs["push"] == pytest.approx(4.0)
    branch = damped.continuation("push", "0 N", "4 N")
    assert branch["x"][-1] == pytest.approx(1.0) and not branch.stable.any() and not branch.unstable.any()
    contact = model("4 [N/m]*x + 2 [N/m]*max(x, 0 m)").continuation("push", "-4 N", "6 N")
    assert contact["x"][[0, -1]] == pytest.approx([-1.0, 1.0]) and contact.stable[[0, -1]].all()


@pytest.mark.parametrize("loss", [law for law in LOSSES if "min(abs" not in law])
def test_the_port_hamiltonian_form(loss: str) -> None:
    with pytest.raises(UsageError, match="`loss` has no slope, or one on each side"):
        model(loss=loss).port_hamiltonian()
    assert model(loss="1 [N*s/m]*v + 2 [N*s^2/m^2]*v*abs(v)").port_hamiltonian().R.max() == pytest.approx(1.0)


def test_the_message() -> None:
    with pytest.raises(RunFailed) as caught:
        model(loss=LOSSES[6]).modes()
    assert str(caught.value).startswith(
        "the equation of `mass.p` jumps at this state (t = 0 s), by the law of `loss` (line 7)"
    )
