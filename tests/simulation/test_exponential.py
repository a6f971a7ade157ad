"""Linear models by the matrix exponential: against closed forms in forty digits, for any tolerance, and its limits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import bondgraph
from bondgraph.simulation.integrators import exponential
from bondgraph.simulation.integrators.linear_algebra.exponentials import (
    MATRICES,
    ExponentialTables,
    propagate,
    use_matrix,
)
from compiler.api import zeros_of
from tests.compiling import MODELS

SECOND_ORDER = """
model A {
  input push = 0 N
  parameter m = 2 kg, k = 8 [N/m], r = 1 [N*s/m]
  1 body; MSe drive : F = push
  I mass : p = m*v
  C spring : F = k*x { start x = 1 m }
  R damper : F = r*v
  drive -> body -> mass, spring, damper
  output x = spring.x, v = mass.v
}
"""
STIFF = """
model Ladder {
  "Two cells, time constants of 1 ns and 1 s or so."
  Se s : u = 1 V*sin(50 [1/s]*time)
  R r : u = 1 ohm*i
  C c : u = q/1 nF
  R w : u = 1 Mohm*i
  C d : u = q/1 uF
  s -> 1(r) -> 0(c) -> 1(w) -> 0(d)
  output a = c.u, b = d.u
}
"""


def exact(matrix: list[list[float]], push: object, start: list[float], time: float) -> list[float]:
    """x' = A x + (0, push(t)) for A that swings, in forty digits: exp(A t) x0 and the integral of exp(A (t - s)) b(s).

    exp(A t) = exp(c t) (cos(w t) 1 + sin(w t)/w (A - c 1)) where the eigenvalues of A are c + i w and c - i w.
    """
    mpmath.mp.dps = 40
    a = mpmath.matrix(matrix)
    c = (a[0, 0] + a[1, 1]) / 2
    w = mpmath.sqrt(a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0] - c**2)

    def carried(x: object, t: object) -> object:
        turned = mpmath.sin(w * t) / w * (a - c * mpmath.eye(2)) * x
        return mpmath.exp(c * t) * (mpmath.cos(w * t) * x + turned)

    def driven(row: int) -> object:
        return mpmath.quad(lambda s: carried(mpmath.matrix([0, push(s)]), time - s)[row], mpmath.linspace(0, time, 9))  # type: ignore[operator]

    free = carried(mpmath.matrix(start), mpmath.mpf(time))
    return [float(free[i] + driven(i)) for i in range(2)]


@pytest.mark.parametrize(
    ("text", "push"),
    [
        ("0 N", lambda t: 0),
        ("3 N*time/1 s + 1 N*(time/1 s)^3", lambda t: 3 * t + t**3),
        pytest.param(
            "2 N*sin(17 [1/s]*time)*exp(-time/1 s)",
            lambda t: 2 * mpmath.sin(17 * t) * mpmath.exp(-t),
            marks=pytest.mark.machine_code,
        ),
        ("1 N/(1 + (time/0.1 s)^2)", lambda t: 1 / (1 + (10 * t) ** 2)),
    ],
    ids=["free", "polynomial", "burst", "pole nearby"],
)
def test_twelve_digits_at_any_tolerance(text: str, push: object) -> None:
    result = bondgraph.load(SECOND_ORDER).simulate(settings={"push": text}, to=2.0, points=5, rtol=1e-3)
    assert result.solver == "matrix exponential"
    for i in (1, 4):
        x, p = exact([[0, 0.5], [-8, -0.5]], push, [1, 0], float(result.time[i]))
        assert result["x"][i] == pytest.approx(x, abs=3e-12) and result["v"][i] == pytest.approx(p / 2, abs=1e-11)


def test_stiff_and_slow_at_once() -> None:
    """The fast cell follows its source at once: u_c = u (1 - R/W …), to the size of the slow one's current."""
    result = bondgraph.load(STIFF).simulate(to=10.0, points=2001, rtol=1e-3)
    assert result.solver == "matrix exponential" and result.steps == 2000
    t, w = result.time[200:], 50.0
    source = np.sin(w * t)
    assert np.abs(result["a"][200:] - source).max() < 3e-6  # 1 ohm against 1 Mohm, and w R C
    exact_slow = (source - w * np.cos(w * t) + w * np.exp(-t)) / (1 + w * w)  # 1/(1 + s) on the source, tau = 1 s
    assert np.abs(result["b"][200:] - exact_slow).max() < 3e-6


def test_jumps_end_a_stretch_and_are_exact() -> None:
    result = bondgraph.load(SECOND_ORDER.replace("k = 8", "k = 0").replace("r = 1 ", "r = 0 ")).simulate(
        settings={"push": "2 N*step(time - 0.3 s) - 2 N*step(time - 0.55 s)"}, to=1.0, points=3, outputs=("v",)
    )
    assert result.final("v") == pytest.approx(0.25, rel=1e-14)


def test_a_lossless_oscillator_over_ten_thousand_periods() -> None:
    """Effect of rounding: 1e4 periods in 500 steps keep the energy to 1e-11."""
    text = SECOND_ORDER.replace("r = 1 ", "r = 0 ")
    result = bondgraph.load(text).simulate(to=2e4 * np.pi / 2, points=501)
    energy = 4 * result["x"] ** 2 + result["v"] ** 2
    assert np.abs(energy / 4 - 1).max() < 1e-11
    assert result["x"] == pytest.approx(np.cos(2 * result.time), abs=1e-10)


@pytest.mark.parametrize("law", ["F = 8 [N/m]*x + 1e-9 [N/m^3]*x^3", "F = 8 [N/m]*x*(1 + 0.1*sin(time/1 s))"])
def test_what_is_not_linear_or_not_constant_goes_by_steps(law: str) -> None:
    text = SECOND_ORDER.replace("F = k*x", law)
    if "time" in law:  # a spring has no time of its own: a source does
        text = text.replace(f"C spring : {law}", "C spring : F = k*x").replace(
            "R damper : F = r*v", "MR damper : F = r*v*(2 + sin(time/1 s))"
        )
    assert bondgraph.load(text).simulate(to=1.0, points=3).solver.startswith("Dormand-Prince 8")


def test_what_takes_many_polynomials() -> None:
    fast = bondgraph.load(SECOND_ORDER).simulate(settings={"push": "1 N*sin(1e3 [1/s]*time)"}, to=1.0, points=3)
    assert fast.solver == "matrix exponential" and fast.steps > 100


@pytest.mark.machine_code  # 1e5 steps, which as Python take two minutes; who takes them is decided before
def test_what_cannot_be_followed_by_polynomials_goes_by_steps() -> None:
    """An input a million times as fast as the reports: more intervals than are worth it."""
    faster = bondgraph.load(SECOND_ORDER).simulate(settings={"push": "1 N*sin(3e5 [1/s]*time)"}, to=1.0, points=3)
    assert faster.solver.startswith("Dormand-Prince 8")


@pytest.mark.parametrize("ratio", [1e6, 1e9, 1e12])
def test_where_rounding_of_a_stiff_matrix_would_tell_it_goes_by_steps(ratio: float) -> None:
    """Two capacitors of 1 F, one behind 1/ratio ohm, with 1 ohm across the other: the sum of the charges falls by half a second's rate.

    From u1 = u2 = 1 V the fast mode gets a share of 1/(4 ratio) alone: u = exp(-t/2) to that share.
    """
    text = f"""model Pair {{
  C first  : u = q/1 F      {{ start u = 1 V }}
  C second : u = q/1 F      {{ start u = 1 V }}
  R leak   : u = 1 ohm*i
  R wire   : u = {1 / ratio!r} ohm*i
  0 here, there : electric
  here -> first, leak
  here -> 1(wire) -> there
  there -> second
  output u = first.u
}}
"""
    found = bondgraph.load(text).simulate(to=3.0, points=31)
    np.testing.assert_allclose(found["u"], np.exp(-found.time / 2), rtol=0, atol=1e-7 + 1 / ratio)
    assert ("Radau" in found.solver) == (ratio == 1e12)


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_what_goes_by_steps_after_all_takes_a_bandwidth(target: str) -> None:
    """Noise is no polynomial: the linear model is stepped through, and it is asked there what is faster. Nothing is."""
    model = bondgraph.load(SECOND_ORDER.replace("F = push", "F = push + 0.01 N*noise(time, 20 ms, 7)"))
    found, plain = (model.simulate(to=1.0, points=11, bandwidth=b, target=target) for b in (1.0, None))
    assert found.solver.startswith("Dormand-Prince 8")
    assert found.truncation is not None and not found.truncation.modes
    assert (found.values == plain.values).all()


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
@pytest.mark.parametrize("atol", [0.0, -1.0, float("nan"), float("inf"), 1e-300])
def test_an_absolute_tolerance_is_a_positive_number(target: str, atol: float) -> None:
    """With none at all the first step had no length, and machine code went on for ever."""
    with pytest.raises(bondgraph.UsageError, match=r"^atol = "):
        bondgraph.load(SECOND_ORDER).simulate(to=1.0, atol=atol, target=target)


def test_tables_of_more_matrices_than_there_is_room_for() -> None:
    """x' = -a x from 1: exp(-a t), for seven a in turn; tables that are still there are used again, even if they have one length."""
    tables, place = ExponentialTables(**zeros_of(ExponentialTables, n=1, entry_count=1)), np.array([0])
    for a in range(1, 8):
        for _ in range(2):
            use_matrix(tables, place, place, np.array([-float(a)]))
            assert tables.used == tables.newest == a % MATRICES
        x, tables.rate[0] = np.ones(1), -a
        propagate(tables, place, place, 0.3, x)
        assert x[0] == pytest.approx(np.exp(-0.3 * a), rel=1e-13)
    for a in range(8 - MATRICES, 8):
        use_matrix(tables, place, place, np.array([-float(a)]))
        assert (tables.used, tables.newest) == (a % MATRICES, 7 % MATRICES)


def test_a_wave_that_rounding_has_turned_is_told() -> None:
    text = "model Long {{ I m : p = 1 kg*v\n C k : F = 100 [N/m]*x\n R r : F = {r} [N*s/m]*v\n Se f : F = 1 N\n 1 j\n f -> j -> m, k, r\n output x = k.x }}"
    free, damped = (bondgraph.load(text.format(r=r)) for r in ("0", "1e-3"))
    for to in (1e6, 1e9, 1e11):
        run = free.simulate(to=to, points=2)
        assert not run.warnings and run["x"][-1] == pytest.approx(
            0.01 * (1 - float(mpmath.cos(10 * mpmath.mpf(to)))), abs=1e-8
        )
    (warning,) = free.simulate(to=1e15, points=2).warnings
    assert "tolerances of rounding" in str(warning)
    assert not damped.simulate(to=1e15, points=2).warnings


def test_the_form_between_edges_of_a_chopper_is_examined_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Segments that differ in what their mode holds have one matrix."""
    examined: list[int] = []
    places = exponential._random
    monkeypatch.setattr(exponential, "_random", lambda count: examined.append(count) or places(count))
    text = (MODELS / "step_down.bg").read_text(encoding="utf-8")
    one = bondgraph.load(text).simulate(to="0.2 ms", points=41)
    assert len(examined) == 1
    text = text.replace("u = V*pwm(time, 1/f, duty)", "u = V*pwm(time, 1/f, duty)*(1 + 1e-9*sin(time/1 s))")
    with_signal = bondgraph.load(text).simulate(to="0.2 ms", points=41)
    assert len(examined) > 40
    np.testing.assert_allclose(one["u_out"], with_signal["u_out"], rtol=1e-7)
