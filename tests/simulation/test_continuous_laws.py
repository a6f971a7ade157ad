"""Laws that are continuous at their conditions, with a bend or with an infinite slope: they run like those without conditions, and end in a rest."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
import bondgraph.errors
from bondgraph.compiled_scene import TARGETS
from bondgraph.results.result import Result

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]

TANK = """model Tank {{
  C tank : P = V*1e4 [Pa/m^3] {{ start V = {start} [m^3] }}
  R o : Q = {law}
  0 n : hydraulic
  n -> tank, o
  output V = tank.V
}}
"""
ROOTS = [  # law of P in Pa, with c, and its exponent
    ("{c}*sign(P)*sqrt(abs(P)/1 Pa)", 0.5),
    ("{c}*sign(P/1 Pa)*(abs(P)/1 Pa)^0.5", 0.5),
    ("{c}*sqrt(P/1 Pa) if P > 0 Pa else 0 [m^3/s]", 0.5),
    ("{c}*sqrt(abs(P)/1 Pa) if P > 0 Pa else 0 [m^3/s]", 0.5),
    ("{c}*sqrt(P/1 Pa) if P >= 0 Pa else 0 [m^3/s]", 0.5),
    ("{c}*sqrt(max(P, 0 Pa)/1 Pa)", 0.5),
    ("0 [m^3/s] if P <= 0 Pa else {c}*sqrt(P/1 Pa)", 0.5),
    ("{c}*sqrt(P/1 Pa) if P > 0 Pa else -0.2*{c}*sqrt(-P/1 Pa)", 0.5),
    ("{c}*sign(P)*(abs(P)/1 Pa)^0.7", 0.7),
    ("{c}*sign(P)*(abs(P)/1 Pa)^(1/3)", 1 / 3),
    ("{c}*sign(P)*(abs(P)/1 Pa)^0.25", 0.25),
]


@pytest.mark.few(15)
@pytest.mark.parametrize("start", [1.0, 1e-3, -0.2])
@pytest.mark.parametrize(("law", "exponent"), ROOTS, ids=[law for law, _ in ROOTS])
@pytest.mark.parametrize("target", BOTH)
def test_a_tank_runs_empty_and_stays_so(law: str, exponent: float, start: float, target: str) -> None:
    """V' = -V^p/(1 - p) in units of the start and of the time that it takes, so V = (1 - t)^(1/(1 - p))."""
    if start < 0 and "sign" not in law:
        return
    full = abs(1e4 * start) ** exponent * (1 - exponent) / abs(start)  # 1/c, for a tank that is empty after 1 s
    text = TANK.format(start=start, law=law.format(c=f"{1 / full!r} [m^3/s]"))
    found = bondgraph.load(text).simulate(to=3, points=31, target=target, solver="radau")
    expected = start * np.maximum(1 - found.time, 0) ** (1 / (1 - exponent))
    np.testing.assert_allclose(found["V"], expected, atol=1e-5 * abs(start))
    assert found.steps < 500


@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("second", [0.0, 0.3, 2.5])
def test_two_tanks_level_out(second: float, target: str) -> None:
    """The root of their difference falls as a line."""
    text = f"""model Two {{
      C one : P = V*1e4 [Pa/m^3] {{ start V = 1 [m^3] }}
      C two : P = V*1e4 [Pa/m^3] {{ start V = {second} [m^3] }}
      R o : Q = 0.01 [m^3/s/Pa^(1/2)]*sign(P)*sqrt(abs(P))
      0 a, b : hydraulic
      a -> one
      b -> two
      a -> 1(o) -> b
      output difference = one.V - two.V, sum = one.V + two.V
    }}"""
    found = bondgraph.load(text).simulate(to=3, points=31, target=target, solver="radau")
    root = np.maximum(np.sqrt(abs(1 - second)) - found.time, 0)  # V' = -2*0.01*100*sqrt(V) of the difference V
    np.testing.assert_allclose(found["difference"], np.sign(1 - second) * root**2, atol=2e-5)
    np.testing.assert_allclose(found["sum"], 1 + second, rtol=1e-9)
    assert found.steps < (
        500 if second < 1 else 10_000
    )  # from 2.5 the levels end on rounding of their sum, and steps are short there


@pytest.mark.parametrize(
    ("c", "solver"), [(1e-12, "radau"), (1e-13, "rodas"), pytest.param(1e-15, "radau", marks=pytest.mark.machine_code)]
)
@pytest.mark.parametrize("law", ["sign(P)*sqrt(abs(P)/1 Pa)", "sqrt(P/1 Pa) if P > 0 Pa else -sqrt(-P/1 Pa)"])
def test_a_stiff_volume_passes_the_infinite_slope_of_an_orifice(law: str, c: float, solver: str) -> None:
    """A flow a t through zero: V = B t^2 with 2 B = a - k sqrt(B/c) behind it, and before it the same with -k. The law does not jump where its sign does."""
    a, k = 2e-4, 1e-7
    before, behind = (float(np.roots([2, side * k / c**0.5, -side * a]).real.max() if side > 0 else
                            np.roots([2, side * k / c**0.5, -side * a]).real.min()) ** 2 for side in (-1, 1))  # fmt: skip
    text = f"""model Volume {{
      Sf pump : Q = {a} [m^3/s^2]*(time - 0.5 s)
      C volume : P = V/{c} [m^3/Pa] {{ start V = {-before / 4!r} [m^3] }}
      R o : Q = {k} [m^3/s]*({law})
      0 n : hydraulic
      pump -> n
      n -> volume, o
      output V = volume.V
    }}"""
    found = bondgraph.load(text).simulate(to=1, points=11, solver=solver)
    late = found.time - 0.5
    expected = np.where(late > 0, behind, -before) * late**2
    np.testing.assert_allclose(found["V"], expected, rtol=0, atol=1e-7 * behind)


OPENS = [  # writings of sqrt(max(P - set, 0 Pa)/1 Pa)
    "sqrt((P - set)/1 Pa) if P > set else 0",
    "sqrt((P - set)/1 Pa) if P >= set and P > -set else 0",
    "0 if not P > set else sqrt(2*(P - set)/k)",
    "past(P - set)",
]


@cache
def pressures(law: str) -> Any:
    """Pressure of a volume with a load, a pump that pulses, and a relief valve with a law."""
    text = f"""model Relief {{
      parameter set = 100 bar, k = 2 Pa
      function past(p) = (p/1 Pa)^0.5 if p > 0 Pa else 0
      Sf pump : Q = 1e-3 [m^3/s]*(1 + sin(time/0.01 s))
      C volume : P = V/2e-12 [m^3/Pa]
      R relief : Q = 1e-5 [m^3/s]*({law})
      R load : Q = 1e-7 [m^3/s]*sign(P)*sqrt(abs(P)/1 Pa)
      0 n : hydraulic
      pump -> n
      n -> volume, relief, load
      output P = volume.P
    }}"""
    return bondgraph.load(text).simulate(to=0.12, points=21)["P"]


@pytest.mark.parametrize(
    "law", [*OPENS[::2], *(pytest.param(law, marks=pytest.mark.machine_code) for law in OPENS[1::2])]
)
def test_a_relief_valve_opens_and_shuts_whatever_way_its_root_is_written(law: str) -> None:
    """Its law has no value below its pressure, and is open at less than the rounding of the pressure, too."""
    np.testing.assert_allclose(pressures(law), pressures("sqrt(max(P - set, 0 Pa)/1 Pa)"), rtol=1e-4)


@pytest.mark.parametrize("law", ["sqrt(2*g*e) if e > 0 else -sqrt(-2*g*e)", "sqrt(2*g*e) if e >= 0 else 0", "sqrt(2*g*e) if e > 0 else -0.2*sqrt(-2*g*e)"])  # fmt: skip
def test_a_pump_empties_a_tank_against_its_drain(law: str) -> None:
    """Steps whose polynomials cross zero to and fro, by less than the tolerance, end."""
    text = f"""plain model Tank {{
      parameter g = 9.81
      Sf pump : f = -0.3*sin(time)
      C tank : q = 0.5*e {{ start e = 2 }}
      R o : f = {law}
      0 n : untyped
      pump -> n
      n -> tank, o
      output e = tank.e
    }}"""
    back = {"-sqrt": -1.0, "0": 0.0, "-0.2*sqrt": -0.2}[law.split("else ")[1].split("(")[0]]

    def rate(t: float, e: Any) -> Any:
        return [2 * (-0.3 * np.sin(t) - (1.0 if e[0] > 0 else back) * np.sqrt(2 * 9.81 * abs(e[0])))]

    found = bondgraph.load(text).simulate(to=4, points=21)
    expected = solve_ivp(rate, (0, 4), [2.0], method="LSODA", rtol=1e-9, atol=1e-11, t_eval=found.time, max_step=1e-2)
    np.testing.assert_allclose(found["e"], expected.y[0], rtol=0, atol=1e-5)
    assert found.steps < 500


def test_what_decays_behind_a_condition_below_the_tolerance_is_not_called_back() -> None:
    """A stiff decay, whose polynomial crosses the condition within the tolerance; the flow does not."""
    text = """plain model Tank {
      C tank : q = e { start e = 1 }
      R o : f = sqrt(e) if e > 1e-9 else e/sqrt(1e-9)
      0(tank) -> o
      output e = tank.e
    }"""
    found = bondgraph.load(text).simulate(to=3, points=31)
    np.testing.assert_allclose(found["e"], np.maximum(1 - found.time / 2, 0) ** 2, atol=1e-6)
    assert found.steps < 500


def test_dry_friction_beside_a_root_stays_refused() -> None:
    """The root vanishes at zero, the small dry part does not: no motion leads away, and nothing says that the mass sticks."""
    text = """model Stuck {
      I m : p = 1 kg*v
      Se push : F = 1e-3 [N/s]*time - 5e-4 N
      R rub : F = sign(v)*(1e-2 N + 5 N*sqrt(abs(v)/1 [m/s]))
      push -> 1(m, rub)
    }"""
    with pytest.raises(bondgraph.errors.RunFailed, match="slides along"):
        bondgraph.load(text).simulate(to=1)


FORMS = [  # with `if`, without
    ("x if x > 0 else 0", "max(x, 0)"),
    ("x^2 if x > 0 else 0", "max(x, 0)^2"),
    ("3*x if x > 0 else x", "max(3*x, x)"),
    ("x if x > y else y", "max(x, y)"),
    ("x - 0.2 if x > 0.2 else 0", "max(x - 0.2, 0)"),
    ("0 if x <= 0 else (x^2 if x <= 1 else 2*x - 1)", "max(min(x, 1), 0)^2 + 2*max(x - 1, 0)"),
    ("exp(x) - 1 if x <= 0 else x", "exp(min(x, 0)) - 1 + max(x, 0)"),
    ("x*abs(x) if x > 0 else 0", "max(x, 0)*abs(x)"),
    ("1e-9*x if x <= 0 else 0", "1e-9*min(x, 0)"),
    ("x*y if x > 0 else 0", "max(x, 0)*y"),
    ("x if x < y else y", "min(x, y)"),
]


def run(law: str, rtol: float, target: str) -> Result:
    text = f"""plain model Pushed {{
      "It is pushed to and fro twice, and comes to rest at zero in between."
      signal push = 2*(ramp(time, 0, 0.1) - ramp(time, 1, 1.1) - ramp(time, 3, 3.1) + ramp(time, 4, 4.1) + ramp(time, 10, 10.1) - ramp(time, 11, 11.1))
      signal x = integral(push - x - 5*({law}), 0), y = integral(x - 2*y, 0)
      output position = x
    }}"""
    return bondgraph.load(text).simulate(to=20, points=41, rtol=rtol, target=target, solver="radau")


@pytest.mark.few(8)
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
@pytest.mark.parametrize("forms", FORMS, ids=[f for f, _ in FORMS])
@pytest.mark.parametrize("target", BOTH)
def test_a_law_with_if_that_only_bends_runs_like_one_without(forms: tuple[str, str], rtol: float, target: str) -> None:
    with_if, without = (run(form, rtol, target) for form in forms)
    np.testing.assert_allclose(with_if["position"], without["position"], atol=100 * rtol)
    assert work(with_if) <= 2 * work(without)


def work(result: Result) -> Any:
    return result.evaluations["derivative"]


WRITINGS = [  # of one law: the root of the pressure, with its sign
    "sign(P)*sqrt(abs(P)/1 Pa)",
    "(abs(P)/1 Pa)^0.5*sign(P)",
    "P/1 Pa/sqrt(abs(P)/1 Pa)",
    "P/1 Pa*(abs(P)/1 Pa)^(-0.5)",
    "sqrt(P/1 Pa) if P > 0 Pa else -sqrt(-P/1 Pa)",
    "-sqrt(-P/1 Pa) if P < 0 Pa else sqrt(P/1 Pa)",
    "sqrt(abs(P)/1 Pa) if P >= 0 Pa else -sqrt(abs(P)/1 Pa)",
    "sqrt(P/1 Pa) if P > 0 Pa else (-sqrt(-P/1 Pa) if P < 0 Pa else 0)",
    "sqrt(max(P, 0 Pa)/1 Pa) - sqrt(max(-P, 0 Pa)/1 Pa)",
    "sign(P)*sqrt(P*sign(P)/1 Pa)",
]
TANKS = {
    "runs empty": """
      C one : P = V*1e4 [Pa/m^3] { start V = 1 [m^3] }
      0 a : hydraulic
      a -> one, o""",
    "levels out": """
      C one : P = V*1e4 [Pa/m^3] { start V = 1 [m^3] }
      C two : P = V*1e4 [Pa/m^3] { start V = 2.5 [m^3] }
      0 a, b : hydraulic
      a -> one
      b -> two
      a -> 1(o) -> b""",
    "is fed through a valve": """
      C one : P = V*1e4 [Pa/m^3] { start V = 0 [m^3] }
      Se pump : P = 1e4 [Pa]*sin(3 [1/s]*time)
      R valve : Q = 1e-3 [m^3/s/Pa]*max(P, 0 Pa)
      0 a : hydraulic
      pump -> 1(valve) -> a
      a -> one, o""",
}


@cache
def levels(tank: str) -> Any:
    """Volumes of the first tank at 31 instants, in m^3."""
    time = np.linspace(0, 3, 31)
    if tank == "runs empty":  # V' = -2 sqrt(V)
        return np.maximum(1 - time, 0) ** 2
    if tank == "levels out":  # the difference D from the other: D' = -4 sqrt(D)
        return 1.75 - 0.5 * np.maximum(np.sqrt(1.5) - 2 * time, 0) ** 2

    def rate(t: float, x: Any) -> list[float]:
        p = 1e4 * max(x[0], 0.0)
        return [1e-3 * max(1e4 * np.sin(3 * t) - p, 0.0) - 0.02 * np.sqrt(p)]

    found = solve_ivp(rate, (0, 3), [0.0], method="LSODA", rtol=1e-10, atol=1e-12, t_eval=time, max_step=1e-3)
    return np.maximum(found.y[0], 0.0)


@pytest.mark.few(15)
@pytest.mark.machine_code
@pytest.mark.parametrize("tank", TANKS)
@pytest.mark.parametrize("law", WRITINGS)
def test_all_writings_of_a_root_through_zero_are_one_law(law: str, tank: str) -> None:
    text = f"model Tank {{{TANKS[tank]}\n  R o : Q = 0.02 [m^3/s]*({law})\n  output V = one.V\n}}"
    found = bondgraph.load(text).simulate(to=3, points=31, solver="radau")
    np.testing.assert_allclose(found["V"], levels(tank), atol=1e-6)
    assert found.steps < 300


def test_a_root_of_what_is_negative_stays_one() -> None:
    """A coefficient under the root that is negative leaves no value, as it is written."""
    text = f"""model Tank {{
      parameter rho = -1 [kg/m^3]{TANKS["runs empty"]}
      R o : Q = 0.02 [m^2]*(sqrt(2*P/rho) if P > 0 Pa else -sqrt(-2*P/rho))
      output V = one.V
    }}"""
    with pytest.raises(bondgraph.errors.RunFailed, match="not finite"):
        bondgraph.load(text).simulate(to=3)
    found = bondgraph.load(text).simulate(to=0.3, settings={"rho": 2e4})
    np.testing.assert_allclose(found["V"], (1 - 0.01 * found.time) ** 2, atol=1e-6)  # V' = -0.02 sqrt(V)


PAD = """model Floor {
  parameter r: N*s/m = 20
  I m : p = 1 kg*v
  Se g : F = -9.81 N
  signal y = integral(m.v, 1 mm)
  MR pad : F = 0 N if y > 0 m else min(r*v + 2e4 [N/m]*y, 0 N)
  g -> 1(m, pad)
  output h = y, v = m.v
}
"""


def bounces(r: float, times: np.ndarray) -> np.ndarray:
    """Return height and speed over a pad that pushes and never pulls: each touch on its own, up to where the force would pull, then a flight."""
    state, now, found = np.array([1e-3, 0.0]), 0.0, np.zeros((2, len(times)))

    def on(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -9.81 - r * y[1] - 2e4 * y[0]]

    def pushes(_: float, y: np.ndarray) -> float:
        return -(r * y[1] + 2e4 * y[0])

    pushes.terminal, pushes.direction = True, -1  # type: ignore[attr-defined]
    while now < times[-1]:
        v = state[1]
        flight = (v + np.sqrt(v * v + 2 * 9.81 * state[0])) / 9.81
        t = times - now
        in_air = (t >= 0) & (t <= flight)
        found[:, in_air] = state[0] + v * t[in_air] - 4.905 * t[in_air] ** 2, v - 9.81 * t[in_air]
        now, state = now + flight, np.array([0.0, v - 9.81 * flight])
        touch = solve_ivp(on, (0, 1), state, method="DOP853", rtol=1e-11, atol=1e-14, events=pushes, dense_output=True)
        t = times - now
        touches = (t >= 0) & (t <= touch.t[-1])
        found[:, touches] = touch.sol(t[touches])
        now, state = now + touch.t[-1], touch.y[:, -1]
    return found


@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("r", [5.0, 20.0, 60.0])
def test_a_pad_that_only_pushes_is_met_again_where_it_is(r: float, target: str) -> None:
    """Where it lifts off both laws are zero, and the condition passes within the step: coming back from there it is still located.

    The force lets go before the height is zero, so the laws agree over all of the way up; that way was once taken for rounding.
    """
    found = bondgraph.load(PAD).simulate(settings={"r": r}, to=0.15, points=151, rtol=1e-9, target=target)
    expected = bounces(r, found.time)
    np.testing.assert_allclose(found["h"], expected[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["v"], expected[1], rtol=0, atol=1e-7)


@pytest.mark.parametrize("solver", ["radau", pytest.param("explicit", marks=pytest.mark.machine_code)])
def test_work_of_a_step_that_a_condition_divides(solver: str) -> None:
    """A bob falls into a rope: until its stretch is zero the loss takes what the rope gives, then both are zero. All of the energy is told."""
    text = """model Swing {
      multibody s : planar {
        gravity = (0, -9.81 [m/s^2])
        body bob { mass = 1 kg, at = (0.6 m, -0.2 m) }
        frame top : ground { at = (0, 0) }
        distance d : top to bob
      }
      C rope : F = 5000 [N/m]*max(x - 0.8 m, 0 m)
      MR loss : F = max(20 [N*s/m]*v, -rope.F) if rope.x > 0.8 m else 0 N
      s.d -> rope, loss
      output y = s.bob.y
    }"""
    found = bondgraph.load(text).simulate(to=1, energy=True, solver=solver, rtol=1e-8)
    assert found.energy is not None
    (loss,) = (e for e in found.energy.elements if e.name == "loss")
    assert loss.dissipated == pytest.approx(1.5402298, rel=1e-6)
    assert abs(found.energy.residual) < 1e-7
