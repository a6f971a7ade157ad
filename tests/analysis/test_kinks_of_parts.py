"""Ideal diode, check valve and backlash of the library: linear models and derivatives on either side of their kinks, and at the kinks a refusal by name."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import bondgraph
from bondgraph.analysis.linear import linearization
from bondgraph.analysis.placement import operating_point
from bondgraph.errors import RunFailed, UsageError
from bondgraph.keywords import AnalysisRequest
from tests.compiling import LIBRARY

TARGETS = (pytest.param("native", marks=pytest.mark.machine_code), "numpy")


def linear(
    model: bondgraph.Model, target: str, settings: Mapping[str, str | float], by: tuple[str, ...] = ()
) -> np.ndarray:
    """A and B side by side at the start."""
    request = AnalysisRequest(settings=settings, state="start", by=by)
    found = linearization(operating_point(model, request, target))
    return np.concatenate([found.A, found.B], axis=1)


def refused(model: bondgraph.Model, code: str, name: str, settings: Mapping[str, str | float]) -> None:
    for analysis in (model.linearize, model.modes):
        with pytest.raises(RunFailed) as caught:
            analysis(settings=settings, state="start")
        assert caught.value.code == code and name in str(caught.value) and "no linear model" in str(caught.value)


def no_run_derivative(model: bondgraph.Model, settings: Mapping[str, str | float]) -> None:
    with pytest.raises(UsageError, match="no sensitivities of runs") as caught:
        model.sensitivity_of_run(settings=settings, to="1 ms")
    assert caught.value.code == "BR239"


BACKLASH = """import Backlash from mechanics
model S {
  parameter k = 1e4 [N/m], play = 2 mm, r = 3 [N*s/m], at = 0 mm, m = 2 kg
  input push = 0 N
  MSe force : F = push
  I mass : p = m*v
  R oil : F = 1 [N*s/m]*v
  Backlash lash { play = play, k = k, r = r, x_0 = at }
  Sf wall : v = 0 [m/s]
  1 body : translation
  0 far : translation
  force -> body
  body -> mass, oil
  body -> lash.a
  lash.b -> far
  wall -> far
  output x = lash.way, F = lash.force
}
"""


@pytest.mark.few(4)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("place", "stiffness"), [*itertools.product((1.0, -1.0, 2.5, -0.3), (1e3, 1e9))])
def test_backlash(place: float, stiffness: float, target: str) -> None:
    """Free within the play, a spring and a damper beyond it, refused at its ends."""
    model = bondgraph.load(BACKLASH)
    for half in (0.4, 0.99999, 1.00001, 3.0):
        settings: dict[str, str | float] = {"at": place * 1e-3, "play": 2 * half * abs(place) * 1e-3, "k": stiffness}
        k, r = (stiffness, 3.0) if half < 1 else (0.0, 0.0)
        expected = [[-(1 + r) / 2, -k, 1.0], [0.5, 0.0, 0.0]]  # of mass.p and lash.flank.x, and by push
        found = linear(model, target, settings, ("push",))
        assert found == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9), half
        pushed = model.sensitivity_of_run("push", settings=settings, to=1e-6, points=2, outputs=["x"])
        assert pushed.slopes[1, 0, 0] == pytest.approx(
            expm(1e-6 * np.array([*expected, [0.0, 0.0, 0.0]]))[1, 2], rel=1e-6
        )
    refused(model, "BR263", "lash", {"at": place * 1e-3, "play": 2 * abs(place) * 1e-3, "k": stiffness})


@pytest.mark.parametrize("push", [1.0, -1.0, 1e-3, -20.0])
def test_derivatives_of_backlash_at_rest(push: float) -> None:
    """x = s play/2 + F/k, with the sign s of the force."""
    model = bondgraph.load(BACKLASH)
    settings: dict[str, str | float] = {"push": push, "at": math.copysign(1.001e-3, push)}
    found = model.sensitivity(["k", "play"], "equilibrium", ["x"], settings=settings)
    assert found.of("x", "k") == pytest.approx(-push / 1e8, rel=1e-9)
    assert found.of("x", "play") == pytest.approx(math.copysign(0.5, push), rel=1e-9)
    assert model.equilibrium(settings=settings)["x"] == pytest.approx(math.copysign(1e-3, push) + push / 1e4)


VALVE = """import CheckValve from hydraulic
model S {
  parameter P_open = 0.5 bar, area = 10 [mm^2], bulk = 1e9 Pa, start_at = 0 bar
  input feed = 0 [m^3/s]
  MSf pump : Q = feed
  C room : P = bulk*V/1 [m^3] { start V = start_at*1 [m^3]/bulk }
  R leak : Q = 1e-12 [m^3/s/Pa]*P
  CheckValve valve { area = area, P_open = P_open }
  Se out : P = 0 Pa
  0 node : hydraulic
  1 last : hydraulic
  pump -> node -> room, leak
  node -> valve.a
  valve.b -> last
  out -> last
  output P = room.P, Q = valve.flow
}
""".replace("  1 last : hydraulic\n", "  0 last : hydraulic\n")
FACTOR, SOFT = 0.62 * math.sqrt(2 / 850), 100.0


def root(pressure: float) -> float:
    """Flow per area and factor: P = r sqrt(r^2 + 2 P_soft) solved for r."""
    return math.copysign(math.sqrt(math.hypot(pressure, SOFT) - SOFT), pressure)


def slope(pressure: float, step: float = 1e-3) -> float:
    return (root(pressure * (1 + step)) - root(pressure * (1 - step))) / (2 * step * pressure)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("opens", [0.5, 2.0, 1e-3])
def test_check_valve(opens: float, target: str) -> None:
    """Shut below the pressure at which it opens, a turbulent orifice above it, refused at that pressure."""
    model = bondgraph.load(VALVE)
    for share in (0.2, 0.999999, 1.000001, 3.0):
        pressure = share * opens * 1e5
        settings: dict[str, str | float] = {"P_open": opens * 1e5, "start_at": pressure}
        conducts = FACTOR * 10e-6 * slope(pressure) if share > 1 else 0.0
        found = linear(model, target, settings, ("feed",))
        assert found == pytest.approx(np.array([[-(conducts + 1e-12) * 1e9, 1.0]]), rel=1e-5)
        no_run_derivative(model, settings)
    refused(model, "BR266", "when orifice.P > P_open", {"P_open": opens * 1e5, "start_at": opens * 1e5})


def test_a_check_valve_that_is_about_to_shut(tmp_path: Path) -> None:
    """A copy of the part that begins open, at no pressure: the other event is at its threshold."""
    library = (LIBRARY / "hydraulic.bg").read_text(encoding="utf-8")
    (tmp_path / "own.bg").write_text(library.replace("mode is_open = false", "mode is_open = true"), encoding="utf-8")
    (tmp_path / "m.bg").write_text(VALVE.replace("from hydraulic", 'from "own.bg"'), encoding="utf-8")
    refused(bondgraph.load(tmp_path / "m.bg"), "BR266", "when orifice.P < 0 Pa", {})


@pytest.mark.parametrize("feed", [1e-4, 3e-4, 1e-3])
def test_derivatives_of_a_check_valve_at_rest(feed: float) -> None:
    """area g(P) + P leak = feed: dP/darea = -g/(area g' + leak)."""
    model = bondgraph.load(VALVE)
    settings: dict[str, str | float] = {"feed": feed, "start_at": 2e5}
    rest = model.equilibrium(settings=settings)
    pressure = rest["P"]
    assert FACTOR * 10e-6 * root(pressure) + 1e-12 * pressure == pytest.approx(feed, rel=1e-9) and rest.stable
    found = model.sensitivity(["area", "P_open"], "equilibrium", ["P"], settings=settings)
    expected = -FACTOR * root(pressure) / (FACTOR * 10e-6 * slope(pressure) + 1e-12)
    assert found.of("P", "area") == pytest.approx(expected, rel=1e-5)
    assert found.of("P", "P_open") == 0.0


DIODE = """import IdealDiode from electric
model S {
  parameter R = 50 ohm, load = 1 [kohm], C = 1 [uF]
  input drive = 0 V
  MSe source : u = drive
  R wire : u = R*i
  R drain : u = load*i
  C store : u = q/C
  IdealDiode d
  1 loop : electric
  0 out : electric
  source -> loop -> wire
  loop -> d.pins
  loop -> out -> drain, store
  output u = store.u, i = d.current
}
"""


@pytest.mark.parametrize("drive", [10.0, 1e-3, 1e6, -10.0, -1e-3])
def test_derivatives_of_an_ideal_diode_at_rest(drive: float) -> None:
    """u = drive load/(R + load) while it conducts, else zero."""
    model = bondgraph.load(DIODE)
    settings: dict[str, str | float] = {"drive": drive}
    found = model.sensitivity(["R", "load", "drive"], ("equilibrium", "modes"), ["u"], settings=settings)
    on = drive > 0
    assert found.of("u", "R") == pytest.approx(-drive * 1000 / 1050**2 * on, rel=1e-9)
    assert found.of("u", "load") == pytest.approx(drive * 50 / 1050**2 * on, rel=1e-9)
    assert found.of("u", "drive") == pytest.approx(1000 / 1050 * on, rel=1e-9)
    no_run_derivative(model, settings)


@pytest.mark.few(3)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("drive", "conducting"), [((3.0, 2.0, 1.0), 1), ((-3.0, -2.0, -1.0), 0), ((5.0, -5.0, 0.1), 1)]
)
def test_three_diodes_into_one_node(drive: tuple[float, ...], conducting: int, target: str) -> None:
    """The largest source feeds the node, the others block: a rest for which several must switch."""
    branches = "\n".join(
        f"""  input u{k} = {u} V
  MSe source{k} : u = u{k}
  R wire{k} : u = 50 ohm*i
  IdealDiode d{k}
  1 way{k} : electric
  source{k} -> way{k} -> wire{k}
  way{k} -> d{k}.pins
  way{k} -> out"""
        for k, u in enumerate(drive)
    )
    model = bondgraph.load(
        "import IdealDiode from electric\nmodel S {\n"
        f"{branches}\n  0 out : electric\n  R drain : u = 1 [kohm]*i\n  C store : u = q/1 [uF]\n"
        "  out -> drain, store\n  output u = store.u\n"
        "  experiment still { equilibrium; simulate 0 .. 1 ms }\n}"
    )
    rest = model.equilibrium()
    assert rest["u"] == pytest.approx(max(*drive, 0.0) / 1.05, rel=1e-9) and rest.stable
    run = model.simulate("still", points=5, target=target)  # a run that starts at its rest stays there
    assert run["u"] == pytest.approx(np.full(5, max(*drive, 0.0) / 1.05), rel=1e-9)
    request = AnalysisRequest(by=("u0",))
    found = linearization(operating_point(model, request, target))
    assert found.A[0, 0] == pytest.approx(-1e3 - 2e4 * conducting, rel=1e-9)
