"""Events exactly at their thresholds: linear analyses refuse them by name, equilibria are found without a verdict; beside them the linear model is exact."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.linear import linearization
from bondgraph.analysis.placement import operating_point
from bondgraph.errors import RunFailed, UsageError
from bondgraph.keywords import AnalysisRequest

OSCILLATOR = """model S {{
  mode n = {mode}
  input push = 0 N
  MSe force : F = push
  C spring : F = 100 [N/m]*x {{ start x = {x} }}
  I mass : p = 1 kg*v {{ start v = {v} }}
  MR drag : F = (1 + n)*1 [N*s/m]*v
  1 body : translation
  force -> body
  body -> spring, mass, drag
  {event}
  output x = spring.x
}}
"""


def oscillator(event: str, x: str = "0 m", v: str = "0 [m/s]", mode: float = 0) -> bondgraph.Model:
    return bondgraph.load(OSCILLATOR.format(event=event, x=x, v=v, mode=mode))


def refused(model: bondgraph.Model, name: str, state: str = "equilibrium") -> None:
    for analysis in (model.linearize, model.modes):
        with pytest.raises(RunFailed, match="exactly at its threshold") as caught:
            analysis(state=state)
        assert caught.value.code == "BR266" and name in str(caught.value)
    if state == "equilibrium":
        found = model.equilibrium()
        assert found.stable is None and name in found.verdict.kink and "at its threshold" in found.summary()
        with pytest.raises(RunFailed, match="exactly at its threshold"):
            model.sensitivity()


COMPARISONS = [
    *itertools.product(("<", "<=", ">", ">="), ("spring.x", "mass.v", "spring.F", "spring.x - 1 [s]*mass.v"))
]
UNITS = {"spring.x": "m", "mass.v": "[m/s]", "spring.F": "N", "spring.x - 1 [s]*mass.v": "m"}


@pytest.mark.few(8)
@pytest.mark.parametrize(("sign", "what"), COMPARISONS)
def test_a_condition_at_its_threshold(sign: str, what: str) -> None:
    """Both truths at the point, four quantities; a hair beside it the model of that side."""
    unit = UNITS[what]
    refused(oscillator(f"when {what} {sign} 0 {unit} {{ n = 2 - n }}"), f"when {what} {sign} 0")
    for near in (-1e-6, 1e-6):
        acts = eval(f"0 {sign} near")
        found = oscillator(f"when {what} {sign} {near} {unit} {{ n = 2 }}").linearize()
        assert found.A[list(found.states).index("mass.p"), list(found.states).index("mass.p")] == -1 - 2 * acts


@pytest.mark.parametrize("start", ["0.1 m + 0.2 m", "1e-9 m", "3e5 m", "7/3*1 mm", "0.3 m*(1 + 1e-16)"])
def test_within_rounding_of_a_threshold(start: str) -> None:
    """Values of any size that are equal but for rounding."""
    place = start.replace("0.1 m + 0.2 m", "0.3 m").replace("*(1 + 1e-16)", "")
    refused(oscillator(f"when spring.x > {place} {{ n = 1 }}", start), "when spring.x >", "start")
    beside = oscillator(f"when spring.x > ({place})*(1 + 1e-9) {{ n = 1 }}", start)
    sides = [beside, oscillator(f"when spring.x > ({place})*(1 - 1e-9) {{ n = 1 }}", start)]
    drags = sorted(-m.linearize(state="start").A.diagonal().sum() for m in sides)
    assert drags == [1.0, 2.0]


def test_within_rounding_of_an_input() -> None:
    """The input's own rounding counts, in whatever unit its size is."""
    for place, refuses in (("0.3 m", True), ("0.3 m*(1 + 1e-9)", False)):
        text = OSCILLATOR.format(event="when spring.x > place { n = 1 }", x="0.1 m + 0.2 m", v="0 [m/s]", mode=0)
        model = bondgraph.load(text.replace("input push", f"input place = {place}\n  input push"))
        if refuses:
            refused(model, "when spring.x >", "start")
        else:
            assert -model.linearize(state="start").A.diagonal().sum() == 1.0


def test_what_changes_nothing_is_no_kink() -> None:
    """A counter, a mode that is set to what it is, an instant, a reset of what is held."""
    for event in (
        "when spring.x > 0 m { n = 0 }",
        "mode count = 0; when spring.x > 0 m { count = count + 1 }",
        "when time > 0 s { n = 0 }",
        "when spring.x > 0 m { spring.x = spring.x }",
    ):
        model = oscillator(event)
        assert model.modes()[0].damping == pytest.approx(0.05) and model.equilibrium().stable


def test_an_output_that_an_event_makes_jump() -> None:
    model = oscillator("mode count = 0; when spring.x > 0 m { count = count + 1 }; output many = count")
    with pytest.raises(RunFailed, match="the equation of `many` jumps"):
        model.linearize()
    assert model.linearize(outputs=["x"]).C.shape == (1, 2)
    assert math.isnan(model.modes()[0].outputs["many"].real)


@pytest.mark.parametrize(
    "event",
    [
        "when spring.x > 0 m { mass.v = -0.5*mass.v }",
        "when spring.x > 0 m { mass.v = -1 [m/s] }",
        "when spring.x < 0 m { spring.x = -spring.x }",
        "mode flag = false; when spring.x > 0 m { flag = true }; when flag { n = 1 }",
        "when mass.v > 0 [m/s] and spring.x < 1 m { n = 1 }",
    ],
)
def test_resets_and_chains(event: str) -> None:
    refused(oscillator(event), "`when")


def test_a_searched_branch_goes_through() -> None:
    model = oscillator("when spring.x > 0 m { n = 1 }")
    assert model.invert({"x": "1 mm"}, ["push"]).inputs["push"] == pytest.approx(0.1)


FRICTION = """import DryFriction from mechanics
model S {{
  input push = {push}
  MSe force : F = push
  C spring : F = 100 [N/m]*x {{ start x = {x} }}
  I mass : p = 1 kg*v
  DryFriction dry {{ F_c = 10 N, F_s = {limit}, v_s = 0 [m/s] }}
  1 body : translation
  force -> body
  body -> spring, mass
  body -> dry.ends
  output x = spring.x
}}
"""


@pytest.mark.few(5)
@pytest.mark.parametrize(
    ("push", "x", "limit"),
    [
        ("12 N", "0 m", "12 N"), ("-12 N", "0 m", "12 N"), ("0 N", "-0.12 m", "12 N"), ("0 N", "0.12 m", "12 N"), ("6 N", "-0.06 m", "12 N"),
        ("30 N", "0.18 m", "12 N"), ("10.1 N + 0.2 N", "0 m", "10.3 N"), ("1e9 N", "0 m", "1e9 N"), ("0 N", "-0.3 m + 0.1 m", "20 N"),
        ("12000 mN", "0 cm", "12 N"),
    ],
)  # fmt: skip
def test_friction_at_its_limit(push: str, x: str, limit: str) -> None:
    model = bondgraph.load(FRICTION.format(push=push, x=x, limit=limit))
    refused(model, "when direction == 0", "start")
    inside = bondgraph.load(FRICTION.format(push=push, x=x, limit=f"({limit})*1.000001"))
    assert inside.linearize(state="start").A.tolist() == [[0.0]]  # it holds still
    beyond = bondgraph.load(FRICTION.format(push=push, x=x, limit=f"({limit})*0.999999"))
    refused(beyond, "when direction*contact.v < 0", "start")  # it begins to slide, and would stick if it turned


DIODE = """import IdealDiode from electric
model S {{
  input drive = 0 V
  MSe source : u = drive
  C cap : u = q/1 [uF] {{ start q = {charge} }}
  R load : u = 1 [kohm]*i
  R wire : u = 10 [ohm]*i
  IdealDiode d
  1 loop : electric
  0 out : electric
  source -> loop -> wire
  {bonds}
  loop -> out -> cap, load
  output u = cap.u
}}
"""
FORWARD, BACKWARD = "loop -> d.pins", "0 turned : electric; TF turn : u1 = -u2; loop -> turn -> d.pins"


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize(("bonds", "sign"), [(FORWARD, 1.0), ("TF turn : u1 = -u2\n  loop -> turn -> d.pins", -1.0)])
def test_an_ideal_diode(bonds: str, sign: float, target: str) -> None:
    """It conducts at one drive, blocks at the other, and has no linear model between them; the rest with a drive is that of the set that holds."""
    model = bondgraph.load(DIODE.format(charge="0 C", bonds=bonds))
    refused(model, "when not conducts")
    for drive in (5.0 * sign, -5.0 * sign, 1e-6 * sign, -1e-6 * sign):
        conducts = drive * sign > 0
        for state in ("equilibrium", "start"):
            request = AnalysisRequest(settings={"drive": drive}, state=state, by=("drive",))
            found = linearization(operating_point(model, request, target))
            assert pytest.approx(np.array([[-1e3 - 1e5 * conducts]]), rel=1e-9) == found.A
            assert pytest.approx(np.array([[0.1 * conducts]]), rel=1e-9) == found.B
        rest = model.equilibrium(settings={"drive": drive})
        assert rest["u"] == pytest.approx(drive * conducts / 1.01, rel=1e-9) and rest.stable


def test_a_charged_capacitor_blocks() -> None:
    model = bondgraph.load(DIODE.format(charge="3 uC", bonds=FORWARD))
    assert pytest.approx(np.array([[-1e3]])) == model.linearize(settings={"drive": 2.0}, state="start").A
    assert pytest.approx(np.array([[-1.01e5]])) == model.linearize(settings={"drive": 4.0}, state="start").A
    with pytest.raises(RunFailed, match="exactly at its threshold"):
        model.linearize(settings={"drive": 3.0}, state="start")


def test_a_switch_that_shorts_a_charge_at_the_start() -> None:
    """An impulse passes at the start: refused, for the storages do not keep what they have."""
    model = bondgraph.load("""import IdealDiode from electric
    model S {
      C one : u = q/1 [uF] { start q = 3 uC }
      C two : u = q/1 [uF]
      R load : u = 1 [kohm]*i
      IdealDiode d
      0 left : electric
      1 between : electric
      0 right : electric
      left -> one
      left -> between -> right -> two, load
      between -> d.pins
    }""")
    for state in ("start", "equilibrium"):
        with pytest.raises(UsageError, match="at the very start"):
            model.linearize(state=state)


@pytest.mark.parametrize(("start", "drag"), [("1 mm", 4.0), ("-1 mm", 0.0), ("0 m", None)])
def test_a_junction_that_is_active(start: str, drag: float | None) -> None:
    """A brake: off it holds the mass still."""
    model = bondgraph.load(f"""model S {{
      C spring : F = 100 [N/m]*x {{ start x = {start} }}
      I mass : p = 1 kg*v
      R drag : F = 1 [N*s/m]*v
      R extra : F = 3 [N*s/m]*v
      1 body : translation
      0 mid : translation
      1 touch : translation {{ active = spring.x > 0 m }}
      body -> spring, mass, drag
      body -> mid
      mid -> touch -> extra
    }}""")
    if drag is None:
        refused(model, "`active` of `touch`", "start")
    else:
        assert model.linearize(state="start").A.diagonal().sum() == -drag


@pytest.mark.parametrize("speed", [1.0, -1.0, 1e-9, -1e-9])
def test_given_states_have_their_own_mode(speed: float) -> None:
    """Conditions and events are those of the given state, not of the start."""
    law = oscillator("when mass.v < 0 [m/s] { n = 2 }")
    assert law.linearize(state={"mass.p": speed}).A.diagonal().sum() == (-1.0 if speed > 0 else -3.0)
    text = OSCILLATOR.format(event="", x="0 m", v="0 [m/s]", mode=0)
    bent = text.replace("MR drag", "R drag").replace(
        "(1 + n)*1 [N*s/m]*v", "1 [N*s/m]*v if v > 0 [m/s] else 3 [N*s/m]*v"
    )
    assert bondgraph.load(bent).linearize(state={"mass.p": speed}).A.diagonal().sum() == (-1.0 if speed > 0 else -3.0)


def test_delays_and_samples() -> None:
    delayed = oscillator("signal late = delay(spring.x, 1 ms); when late > 0 m { n = 1 }")
    with pytest.raises(UsageError, match="`delay`"):
        delayed.modes()
    sampled = oscillator("mode m = 0; every 1 ms { m = spring.x/1 m }; when spring.x > 0 m { n = 1 }")
    assert sampled.equilibrium().stable is None
    with pytest.raises(RunFailed, match="exactly at its threshold"):
        sampled.response(inputs=["push"], outputs=["x"], low=1, high=2)
    quiet = oscillator("mode m = 0; every 1 ms { m = spring.x/1 m }; when spring.x > 1 m { n = 1 }")
    assert quiet.equilibrium().stable
