"""Linear models: against complex-step derivatives of the sympy equations, against closed forms, through loops and constraints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy

import bondgraph
from bondgraph.errors import MissingPackage, RunFailed, UsageError
from compiler.api import Source, scene_of
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.scales import in_other_units

STEP = 1e-60  # of a complex-step derivative: nothing is subtracted, so that no digit is lost


def symbolic_slopes(model: Any, linear: Any, state: dict[str, float], inputs: dict[str, float]) -> tuple[Any, Any]:
    """A and B by complex steps through the sympy equations, which the compiled Jacobian has no part in."""
    equations = model.state_equations()
    values = {n: p.value for n, p in model.parameters.items()} | inputs | state | {"time": 0.0}
    symbols = sorted({s for e in equations.values() for s in sympy.sympify(e).free_symbols}, key=str)
    names = [str(s) for s in symbols]
    function = sympy.lambdify(symbols, [equations[n] for n in linear.states], "numpy", cse=True)

    def column(name: str) -> Any:
        if name not in names:
            return np.zeros(len(linear.states))
        moved = [values[n] + (1j * STEP if n == name else 0) for n in names]
        return np.array([complex(x).imag for x in function(*moved)]) / STEP

    return (
        np.array([column(n) for n in linear.states]).T,
        np.array([column(n) for n in linear.inputs]).reshape(len(linear.inputs), len(linear.states)).T,
    )


POINTS: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "duffing.bg": ({"mass.p": 0.3, "spring.x": -0.2}, {}),
    "dc_motor.bg": ({}, {"volt": 12.0}),
    "coupled_coils.bg": ({}, {}),
    "van_der_pol.bg": ({}, {}),
    "plates.bg": ({"spring.x": 4e-7, "plates.q": 2e-11, "mass.p": 1e-12}, {"current": 1e-6}),
    "manipulator.bg": (
        {"stage.platform.x": 4e-6, "stage.platform.y": -3e-6, "stage.platform.phi": 0.03, "stage.platform.phi.omega": 40.0,
         "stage.platform.x.v": 0.02, "stage.guide[1].x": 5e-6, "stage.guide[2].x": -6e-6, "stage.guide[3].x.v": 0.01},
        {"fx": 3e-5, "push1": 14.0, "pull2": 9.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", POINTS)
def test_derivatives_by_another_route(name: str) -> None:
    """To 1e-10 of each row's largest term: the symbolic route and ours round differently where terms cancel."""
    state, inputs = POINTS[name]
    model = bondgraph.load(MODELS / name)
    inputs = {n: v for n, v in inputs.items() if n in model.inputs}
    linear = model.linearize(settings=inputs, state=state)
    full = dict(zip(linear.states, map(float, linear.x), strict=True))
    others = {n: float(model.parameters[n].value) for n in model.parameters if n in model.inputs}
    given = dict(zip(linear.inputs, map(float, linear.u), strict=True))
    A, B = symbolic_slopes(model, linear, full, others | given)
    for found, wanted in ((linear.A, A), (linear.B, B)):
        size = np.abs(wanted).max(axis=1, initial=0.0, keepdims=True)
        assert np.abs(found - wanted).max(initial=0.0) <= 1e-10 * max(size.max(initial=0.0), 1.0)
        assert (np.abs(found - wanted) <= 1e-10 * np.where(size > 0, size, 1.0)).all()


LOOP = """
model A {
  parameter m = 2 kg, k = 30 [N/m], c = 4 [N*s^3/m^3]
  input push = 5 N, base = 0 [m/s]
  MSe drive : F = push
  I mass : p = m*v
  C spring : F = k*x
  R cubic : F = c*v^3
  R line : F = 7 [N*s/m]*v
  1 body : translation
  drive -> body -> mass, 0(spring, 1(cubic, line))
  output v = body.v, F = cubic.F, x = spring.x
}
"""


def test_unknowns_of_a_nonlinear_loop_are_eliminated() -> None:
    """Spring, and in parallel with it a cubic and a linear damper in series: F = c w^3 + 7 w has one root w(F), dw/dF = 1/(3 c w^2 + 7)."""
    state = {"mass.p": 3.0, "spring.x": 0.4}
    linear = bondgraph.load(LOOP).linearize(state=state, inputs=("push", "k"))
    assert set(linear.states) == {"mass.p", "spring.x"}
    force = 30 * 0.4
    w = sympy.nsolve(4 * sympy.Symbol("w") ** 3 + 7 * sympy.Symbol("w") - force, 1.0)
    slope = float(1 / (3 * 4 * w**2 + 7))
    p, x = linear.states.index("mass.p"), linear.states.index("spring.x")
    assert linear.A[x, p] == pytest.approx(1 / 2, rel=1e-12)
    assert linear.A[x, x] == pytest.approx(-30 * slope, rel=1e-12)
    assert linear.A[p, x] == pytest.approx(-30, rel=1e-12)
    assert linear.B[p].tolist() == pytest.approx([1, -0.4], rel=1e-12)
    assert linear.B[x].tolist() == pytest.approx([0, -0.4 * slope], rel=1e-12)
    F = linear.outputs.index("F")  # of the cubic damper: c w^3
    assert linear.C[F, x] == pytest.approx(float(3 * 4 * w**2 * 30 * slope), rel=1e-12)
    assert linear.D[F].tolist() == pytest.approx([0, float(3 * 4 * w**2) * 0.4 * slope], rel=1e-12)


def test_closing_joints_leave_one_coordinate() -> None:
    """Upright four-bars in a row: theta'' = (G/I) sin theta exactly (IFToMM A02), so +-sqrt(G/I), for any choice of the coordinate."""
    model = bondgraph.load(MODELS / "published" / "iftomm_A02_N_fourbar.bg")
    for n in (1, 4):
        linear = model.linearize(settings={"N": n, "top_speed": 0.0}, state="start")
        inertia, weight = (n + 1) / 3 + n, 9.81 * ((n + 1) / 2 + n)
        wanted = np.sqrt(weight / inertia)
        assert sorted(np.linalg.eigvals(linear.A).real.tolist()) == pytest.approx([-wanted, wanted], rel=1e-12)
        assert len(linear.states) == 2


def test_to_scipy_and_names() -> None:
    linear = bondgraph.load(MODELS / "dc_motor.bg").linearize()
    system = linear.to_scipy()
    assert (system.A == linear.A).all() and (system.B == linear.B).all() and (system.D == linear.D).all()
    with pytest.raises(ValueError, match="at least one input"):
        bondgraph.load(MODELS / "van_der_pol.bg").linearize(inputs=()).to_scipy()


def test_to_control() -> None:
    linear = bondgraph.load(MODELS / "dc_motor.bg").linearize()
    try:
        system = linear.to_control()
    except MissingPackage as missing:
        assert "bondgraph-lang[control]" in str(missing)
        return
    assert list(system.state_labels) == list(linear.states) and (system.A == linear.A).all()
    with pytest.raises(ValueError, match="no system without an input"):
        bondgraph.load(MODELS / "oscillator.bg").linearize().to_control()


def test_a_parameter_as_input_of_a_computed_quantity() -> None:
    """`k` depends on others: its derivative is by an addition to it, also as an input that an experiment moves."""
    text = """
    model A {
      parameter a = 3, k: N/m = 2 [N/m]*a^2, m = 2 kg
      input push = 0 N
      MSe drive : F = push
      I mass : p = m*v
      C spring : F = k*x
      drive -> 1(mass, spring)
      output x = spring.x
      experiment pushed { set push = 4 N*sin(time/1 s) + 9 N; simulate 0 .. 1 s }
    }
    """
    model = bondgraph.load(text)
    linear = model.linearize(inputs=("k", "a", "push"), experiment="pushed")
    p = linear.states.index("mass.p")
    x = 9 / 18
    assert linear.x[linear.states.index("spring.x")] == pytest.approx(x, rel=1e-12)
    assert linear.B[p].tolist() == pytest.approx([-x, -4 * 3 * x, 1], rel=1e-12)
    assert linear.u.tolist() == pytest.approx([18, 3, 9], rel=1e-15)


class TestRefused:
    def test_a_state_that_is_none(self) -> None:
        with pytest.raises(UsageError, match="`spring` is no state; states are "):
            bondgraph.load(MODELS / "oscillator.bg").linearize(state={"spring": 1.0})

    def test_an_input_that_is_none(self) -> None:
        with pytest.raises(bondgraph.CompilationFailed, match="nonsense"):
            bondgraph.load(MODELS / "oscillator.bg").linearize(inputs=("nonsense",))

    def test_nothing_rests(self) -> None:
        with pytest.raises(RunFailed, match="no equilibrium was found"):
            bondgraph.load(MODELS / "drag.bg").equilibrium()


def test_rest_where_no_eigenvalue_tells_a_time() -> None:
    """A double pendulum held out level: gravity has no slope there; it comes to hang. A hot brake cools to the air."""
    hanging = bondgraph.load(MODELS / "pendulum.bg").equilibrium()
    assert hanging["upper"] == pytest.approx(-np.pi / 2, rel=1e-12) and hanging["y"] == pytest.approx(-1.5, rel=1e-12)
    assert hanging.stable
    cold = bondgraph.load(MODELS / "brake.bg").equilibrium()
    assert cold["T"] == pytest.approx(293.15, rel=1e-12) and cold["speed"] == 0


@pytest.mark.parametrize("powers", [{}, {"length": 6}])
def test_entries_that_are_rounding_of_terms_that_cancel_are_zero(powers: dict[str, int]) -> None:
    """A force at the middle of a leaf spring does not turn its ends: the moments of both halves cancel, in all units."""
    path = MODELS / "flexure.bg"
    scene = scene_of(
        Source("model", path.read_text("utf-8"), path), LIBRARY, (bondgraph.load(path).name, None), None, {}
    )
    found = bondgraph.load(in_other_units(scene.text, powers)[0], model=scene.model).linearize()
    column = np.abs(found.B[:, found.inputs.index("fx")])
    turning = [name.endswith("omega") for name in found.states]
    assert (column[turning] == 0).all() and (column[column > 0] > 1e-3 * column.max()).all() and (column > 0).any()


@pytest.mark.parametrize("large, small", [(1.0, 1e-9), (1e9, 1e-3), (1e3, 1e-8)])
def test_a_small_entry_beside_large_terms_stays(large: float, small: float) -> None:
    """(k + e) y - k y has the slope e, as far as the digits of k + e tell it."""
    text = f"""plain model A {{
      parameter k = {large!r}, e = {small!r}
      signal y = integral(-y, 1)
      signal x = integral((k + e)*y - k*y - {large!r}*x, 1)
      output z = x
    }}"""
    entry = bondgraph.load(text).linearize().A[1, 0]
    assert entry == pytest.approx(small, abs=4e-16 * large) and entry != 0
