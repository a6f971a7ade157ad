"""Algebraic loops whose solution is far, behind a turn, or among values that overflow: against bisection of the same law."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.numerics.homotopy import follow
from bondgraph.simulation.integrators.linear_algebra.factors import Factors
from bondgraph.simulation.integrators.loop_newton import LoopSystem, relative_step, solve_loops
from bondgraph.simulation.loops.branches import _regular
from compiler.api import zeros_of

DIODE = """model A {
  parameter supply = 5 kV
  Se s : u = supply
  1 j
  R r : u = 1 kohm*i + 10 ohm*i*(i/1 mA)^2
  R d : i = 1e-14 A*(exp(u/25 mV) - 1) + u/1 Mohm
  s -> j -> r, d
  output i = j.i
}
"""


def bisected(function: Callable[[float], float], low: float, high: float) -> float:
    """The zero of a rising function."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) > 0 else (middle, high)
    return 0.5 * (low + high)


def diode(u: float) -> float:
    return 1e-14 * math.expm1(min(u / 0.025, 700)) + 1e-6 * u


@pytest.mark.parametrize("supply", [0.5, 5.0, 500.0, 5e3, 1e5, 1e6, -5e3, -1e6])
def test_a_diode_behind_a_cubic_resistor(supply: float) -> None:
    """From zero volts across the resistor the diode's law overflows from 20 V of supply on."""

    def left_over(u: float) -> float:  # of the supply, with u across the diode
        i = diode(u)
        return 1e3 * i + 1e7 * i**3 + u - supply

    u = bisected(left_over, -abs(supply), 2.0 if supply > 0 else 0.0)
    run = bondgraph.load(DIODE).simulate(settings={"supply": supply}, to=1, points=2)
    assert run.final("i") == pytest.approx(diode(u), rel=1e-8)


def test_a_solution_behind_the_crest() -> None:
    """From 0 the residual rises at first: on that side nothing is found, the solution lies beyond the crest."""
    text = "plain model A {\n  Se s : e = 5\n  1 j\n  R a : e = 3*sin(f) + 0.1*f^3\n  R b : e = 0.5*f\n  s -> j -> a, b\n  output y = j.f\n}\n"
    found = bisected(lambda f: 3 * math.sin(f) + 0.1 * f**3 + 0.5 * f - 5, 3.0, 4.0)
    assert bondgraph.load(text).simulate(to=1, points=2).final("y") == pytest.approx(found, rel=1e-12)


def test_two_loops_do_not_disturb_each_other() -> None:
    """Each is solved separately, the second with the solution of the first."""
    part = "  Se s{n} : e = {e}\n  1 j{n}\n  R a{n} : e = 3*sin(f) + 0.1*f^3\n  R b{n} : e = 0.5*f\n  s{n} -> j{n} -> a{n}, b{n}\n"
    text = "plain model A {\n" + part.format(n=1, e=5) + part.format(n=2, e="4 + a1.f/4").replace("Se s2", "MSe s2")
    text += "  output x = j1.f, y = j2.f\n}\n"
    run = bondgraph.load(text).simulate(to=1, points=2)
    x = bisected(lambda f: 3 * math.sin(f) + 0.1 * f**3 + 0.5 * f - 5, 3.0, 4.0)
    assert run.final("x") == pytest.approx(x, rel=1e-12)
    y = run.final("y")
    assert 3 * math.sin(y) + 0.1 * y**3 + 0.5 * y == pytest.approx(4 + x / 4, rel=1e-12)


@pytest.mark.parametrize(("power", "drop"), [(2, 4.0), (2, 0.1), (4, 4.0), (2, 900.0)])
def test_a_solution_beyond_a_condition_is_none(power: int, drop: float) -> None:
    """f^2 goes on below zero, where the other side holds: that it has a zero there, too, is no second solution of the model."""
    text = f"plain model A {{\n  Se s : e = {drop}\n  1 j\n  R a : e = f^{power} if f > 0 else 2*f\n  R b : e = 0.5*f\n  s -> j -> a, b\n  output y = j.f\n}}\n"
    found = bisected(lambda f: f**power + 0.5 * f - drop, 0.0, drop + 1)
    assert bondgraph.load(text).simulate(to=1, points=2).final("y") == pytest.approx(found, rel=1e-12)


def test_only_solutions_that_stand_alone_are_others() -> None:
    """In a flat law a whole range would do; a steep and a slight unknown are not flat."""

    def loop(matrix: list[list[float]]) -> Any:
        return SimpleNamespace(matrix=lambda _: np.array(matrix))

    place = np.array([1.0, 2.0])
    assert _regular(loop([[1.0, 0.0], [0.0, 1e-9]]), place)
    assert not _regular(loop([[1.0, 0.0], [0.0, 0.0]]), place)
    assert not _regular(loop([[1.0, 1.0], [1.0, 1.0 + 1e-14]]), place)
    assert _regular(loop([[1.0, 1.0], [1.0, 1.0 + 1e-9]]), place)


@pytest.mark.machine_code
def test_no_solution_is_told_with_the_loop() -> None:
    text = "plain model A {\n  Se s : e = -2\n  1 j\n  R a : e = f^2 + f^4\n  R b : e = 0*f + f^6\n  s -> j -> a, b\n  output y = j.f\n}\n"
    with pytest.raises(RunFailed, match="could be found"):
        bondgraph.load(text).simulate(to=1)


class TestHomotopy:
    """`follow` alone, on curves with known turning points."""

    @staticmethod
    def led(function: Callable[[float], float], slope: Callable[[float], float], guess: float) -> float | None:
        found = follow(
            lambda z: np.array([function(z[0])]), lambda z: np.array([[slope(z[0])]]), np.array([guess]), np.ones(1)
        )
        if found is None:
            return None
        x = float(found[0])
        for _ in range(8):  # `follow` ends near a zero, from where Newton's method arrives
            x -= function(x) / slope(x)
        return x

    def test_round_two_turns(self) -> None:
        """x^3 - 3x - 20 turns at -1 and 1; from -1.5 its zero, between 3.08 and 3.09, is behind both."""
        found = self.led(lambda x: x**3 - 3 * x - 20, lambda x: 3 * x * x - 3, -1.5)
        assert found is not None and found**3 - 3 * found == pytest.approx(20, rel=1e-12) and found > 3

    def test_both_ways(self) -> None:
        """From 0, 5 + x - x^2/8 falls to the left at once, and to the right behind its crest; both zeros are right."""
        found = self.led(lambda x: 5 + x - x * x / 8, lambda x: 1 - x / 4, 0.0)
        assert found == pytest.approx(4 - math.sqrt(56), rel=1e-12)

    def test_no_zero(self) -> None:
        assert self.led(lambda x: 1 + x * x, lambda x: 2 * x, 0.5) is None

    def test_where_there_is_no_value(self) -> None:
        assert self.led(lambda x: math.inf, lambda x: math.inf, 0.0) is None


MAINS = """model Rectifier {
  parameter V = 325 V
  Se mains : u = V*sin(300 [1/s]*time)
  R wire : u = 1 ohm*i
  R diode : i = 1e-12 A*(exp(u/(0.025 V)) - 1)
  R other : i = 1e-12 A*(exp(u/(0.025 V)) - 1)
  R before : u = 50 ohm*i
  C buffer : q = 100 uF*u
  R load : u = 100 ohm*i
  0 n, m, g : electric
  mains -> 1(wire) -> m
  m -> 1(diode) -> n -> buffer, load
  m -> 1(before) -> g -> other
  output u = buffer.u, i = diode.i
}
"""


@cache
def rectified(volts: float) -> bondgraph.Result:
    """By the other method, tightly."""
    return bondgraph.load(MAINS).simulate(settings={"V": volts}, to=0.1, rtol=1e-8, solver="rodas")


@pytest.mark.few(5)
@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
@pytest.mark.parametrize(
    ("volts", "rtol"),
    [(5, 1e-3), (50, 1e-3), (50, 1e-4), (325, 1e-4), (325, 5e-5), (325, 1e-5), (3000, 2e-4), (3000, 1e-5)],
)
def test_diodes_at_loose_tolerances(target: str, volts: float, rtol: float) -> None:
    """A diode that conducts no more has a slope of nothing: by its old one unknowns seemed to be solved, 100 tolerances off, and no step led on."""
    settings = {"V": volts}
    found = bondgraph.load(MAINS).simulate(settings=settings, to=0.1, rtol=rtol, solver="radau", target=target)
    right = rectified(volts)
    for name in ("u", "i"):
        assert np.abs(found[name] - right[name]).max() < 50 * rtol * np.abs(right[name]).max()


@pytest.mark.machine_code
@pytest.mark.parametrize("volts", [5, 50, 325, 1000, 1827.5862068965519, 2172.4137931034484, 3000])
def test_no_tolerance_stops_at_diodes(volts: float) -> None:
    """Unknowns accepted off their equations by a part of the tolerance, which is many times a diode's 25 mV, stopped some runs: no step was short enough."""
    model, right = bondgraph.load(MAINS), rectified(volts)
    for rtol in (2e-4, 1e-4, 5e-5, 2e-5, 1e-6):
        found = model.simulate(settings={"V": volts}, to=0.1, rtol=rtol, solver="radau")
        for name in ("u", "i"):
            assert np.abs(found[name] - right[name]).max() < 50 * rtol * np.abs(right[name]).max()


@pytest.mark.machine_code
def test_what_bends_within_the_tolerance_is_passed() -> None:
    """The diode that begins to conduct is flat at the start of a step and 100 times as steep at its end, within the tolerance; 500 reported instants."""
    found = bondgraph.load(MAINS).simulate(settings={"V": 3000}, to=0.1, rtol=1e-2, solver="radau")
    for name in ("u", "i"):
        np.testing.assert_allclose(found[name], rectified(3000)[name], rtol=0, atol=0.02 * rectified(3000)[name].max())


@pytest.mark.parametrize("step", [(math.nan, 1e-12), (1e-12, math.nan), (math.inf, 0.0)])
def test_a_correction_that_is_not_finite_is_not_hidden_by_another_unknown(step: tuple[float, float]) -> None:
    """Corrections of the other unknowns alone would tell that the loop is solved."""
    loop: Any = SimpleNamespace(n=2, step=step, z=(1.0, 1.0), unit=(1.0, 1.0))
    assert not math.isfinite(relative_step(loop, 1e-3))


def by_newton(law: Callable[[float], float], slope: Callable[[float], float], magnitude: float, guess: float) -> Any:
    """What Newton's method says of one unknown, and where it ends."""

    def derivative(*given: Any) -> None:
        given[-1][0] = law(given[1][0])

    def entries(*given: Any) -> None:
        given[-1][0] = slope(given[1][0])

    arrays = zeros_of(LoopSystem, n=1, variables=1, entry_count=1, all_entries=1)
    loop: Any = SimpleNamespace(**arrays, **dict.fromkeys(("inputs", "constants", "mode"), np.zeros(0)))
    loop.derivative, loop.entries, loop.time, loop.unknown, loop.n, loop.entry_count = derivative, entries, 0.0, 0, 1, 1
    loop.real = SimpleNamespace(**zeros_of(Factors, n=1))
    loop.state, loop.magnitude, loop.z = np.zeros(1), np.array([magnitude]), np.array([guess])
    loop.places = loop.chosen = loop.rows = loop.columns = np.zeros(1, dtype=int)
    return solve_loops(loop, 0), float(loop.z[0])


@pytest.mark.parametrize("steep", [1.0, 4e4, 1e5, 3e5, 1e8])
@pytest.mark.parametrize("push", [3e-16, 1e-16, 1e-18, 1e-21, -1e-16, -2e-16])
def test_the_one_of_an_exponential_hides_a_smaller_unknown(steep: float, push: float) -> None:
    """exp(u) - 1 is a multiple of 1e-16: where all was at rest no correction counted as small enough, and a valve could not open."""
    right = push / (1 / 0.3 + steep)
    solved, f = by_newton(
        lambda f: 0.3 * (math.exp(push - steep * f) - 1) - f, lambda f: -0.3 * steep * math.exp(push - steep * f) - 1, 10 * abs(right), 0.0
    )  # fmt: skip
    assert solved and abs(f - right) <= 2.3e-16 / (1 / 0.3 + steep)


@pytest.mark.parametrize(
    ("law", "slope", "guess"),
    [
        (lambda z: math.tanh(1e9 * z) + 1.5, lambda z: 1e9 / math.cosh(1e9 * max(z, -1e-7)) ** 2, 3e-9),
        (lambda z: z + math.copysign(1.0, z) + 0.5, lambda z: 1.0, 0.0),
        (lambda z: max(z, 0.0) + 1.0, lambda z: float(z >= 0), 0.0),
        (lambda z: z * z + 1e-3, lambda z: 2 * z, 0.01),
        (lambda z: z**3 - 3 * z + 2 + 2e-5, lambda z: 3 * z * z - 3, 1.001),
    ],
)
def test_a_residual_that_answers_is_none_of_rounding(law: Any, slope: Any, guess: float) -> None:
    """Beside a narrow slope, a jump, a bend and a minimum there is no solution."""
    assert not by_newton(law, slope, 1.0, guess)[0]


@pytest.mark.parametrize("jump", ["w^3 - w = (0.1 if time > 1 else 3) for w = 1", "w^3 - w = b + 0*time for w = 1 when time > 1 { b = 0.1 }", "w^3 - w = b + 0*time for w = 1 every 3 { b = 0.1 }"])  # fmt: skip
def test_a_jump_to_one_of_several_solutions_is_told(jump: str) -> None:
    """w^3 - w = 3 has one solution, w^3 - w = 0.1 has three, of which nothing chooses one."""
    text = f"plain model A {{ mode b = 3; solve {jump}; output last = w }}".replace(" when", "; when").replace(
        " every", "; every"
    )
    found = bondgraph.load(text).simulate(to=2, points=3)
    assert found.final("last") == pytest.approx(1.0466805, abs=1e-6)
    assert [note for note in found.notes if "one of several" in note and "-0.945649" in note]
    assert not bondgraph.load(text.replace("0.1", "4")).simulate(to=2, points=3).notes


STEEP = "plain model A {{\n  Sf s : f = sin(3*time)\n  0 a\n  1 b\n  R c : {}\n  R d : {}\n  C k : e = 5*q\n  s -> a -> c\n  a -> b -> d, k\n  output x = k.q\n}}\n"


@pytest.mark.parametrize(
    ("laws", "first", "second"),
    [
        (("e = f^3", "e = 2*f^3"), lambda f: f**3, lambda f: 2 * f**3),
        (("e = f^5", "e = 2*f*abs(f)"), lambda f: f**5, lambda f: 2 * f * abs(f)),
        (
            ("f = e*abs(e)", "f = 2*sign(e)*sqrt(abs(e))"),
            lambda f: np.sign(f) * abs(f) ** 0.5,
            lambda f: f * abs(f) / 4,
        ),
    ],
)
def test_laws_that_are_flat_or_steep_at_zero_pass_it(
    laws: tuple[str, str], first: Callable[[float], float], second: Callable[[float], float]
) -> None:
    """A root has no slope at zero, and a sign that jumps there; the power whose inverse it is has a slope and no sign."""

    def rate(time: float, x: Any) -> list[float]:
        return [bisected(lambda f: second(f) + 5 * x[0] - first(math.sin(3 * time) - f), -9.0, 9.0)]

    found = bondgraph.load(STEEP.format(*laws)).simulate(to=4, points=21)
    right = solve_ivp(rate, (0, 4), [0.0], t_eval=np.linspace(0, 4, 21), method="LSODA", rtol=1e-6, atol=1e-8).y[0]
    assert np.abs(found["x"] - right).max() < 2e-4 * np.abs(right).max()


FLAT = """plain model F {{
  signal x = integral({rate}*z, {start})
  solve z^3 - x = 0 for z = {guess}
  output y = x
}}"""


@pytest.mark.parametrize(
    ("c", "k", "start"),
    [
        (1, -1, 0),
        (1, 0.5, -0.3),
        *(pytest.param(*c, marks=pytest.mark.machine_code) for c in ((-1, 0.5, 0), (-1, -0.9, 0.3))),
    ],
)
@pytest.mark.parametrize("solver", ["radau", "rodas"])
def test_a_loop_begins_and_passes_where_its_law_is_flat(c: float, k: float, start: float, solver: str) -> None:
    """z^3 has no slope at zero, so no implicit step begins there. The time to reach z is the integral of 3 z^2/(c + k z)."""
    guess = float(np.cbrt(start))
    text = FLAT.format(rate=f"{c} + {k}", start=start, guess=guess)
    run = bondgraph.load(text).simulate(to=1, points=11, solver=solver)
    z, a = np.cbrt(run["y"]), c / k
    at_z, at_start = (3 / k * (x**2 / 2 - a * x + a**2 * np.log(abs(a + x))) for x in (z, guess))
    np.testing.assert_allclose(at_z - at_start, run.time, rtol=0, atol=1e-5)


def test_a_branch_that_ends_is_not_stepped_over() -> None:
    """z^3 - 3 z + 1 + 2 x has a fold at x = 0.5; the solution behind it is far, however short the step over it."""
    text = (
        "plain model F {\n  signal x = integral(1, 0)\n  solve z^3 - 3*z + 1 + 2*x = 0 for z = 1.5\n  output y = z\n}"
    )
    with pytest.raises(RunFailed, match=r"t = 0\.5 s.*needs a tighter one$"):
        bondgraph.load(text).simulate(to=1)


def test_a_bridge_of_unequal_diodes_goes_on_from_a_node_that_floats() -> None:
    """Where all diodes block, a node floats within the tolerance of its equations, so no step began there. A proof says that the loop has one solution."""
    text = """model Bridge {
      Se s : u = 10 V*sin(2*pi*50 Hz*time)
      Se earth : u = 0 V
      R rs : u = 0.1702 ohm*i
      R load : u = 250.6 ohm*i
      C buffer : q = 100 uF*u
      R d1 : i = 1.894e-10 A*(exp(u/25 [mV]) - 1)
      R d2 : i = 9.071e-11 A*(exp(u/25 [mV]) - 1)
      R d3 : i = 1.981e-07 A*(exp(u/50 [mV]) - 1)
      R d4 : i = 3.248e-13 A*(exp(u/25 [mV]) - 1)
      0 a, b, p, m : electric
      s -> 1(rs) -> a
      earth -> b
      a -> 1(d1) -> p
      b -> 1(d2) -> p
      m -> 1(d3) -> a
      m -> 1(d4) -> b
      p -> 1(load) -> m
      p -> 1(buffer) -> m
      output u = load.u
    }"""
    model = bondgraph.load(text)
    right = model.simulate(to=0.0095, points=6)["u"]
    np.testing.assert_allclose(
        model.simulate(to=0.0095, points=6, rtol=1e-3)["u"], right, rtol=0, atol=0.02 * right.max()
    )


@pytest.mark.parametrize(
    ("form", "share"), [("R", 0.5), ("R", 0.0), pytest.param("power", 0.5, marks=pytest.mark.machine_code)]
)
def test_orifices_at_a_node_begin_from_rest(form: str, share: float) -> None:
    """All pressures and flows are zero at the start, where a root has no finite slope, nor has what it inverts any. The flow is then without a scale."""
    law = "R {0} : Q = {1} [m^3/s/Pa^(1/2)]*{2}sign(P)*sqrt(abs(P))"
    if form == "power":
        law = "R {0} : P = 1 [Pa*s^2/m^6]*({2}{1})^(-2)*sign(Q)*Q^2"
    orifices = [law.format(*row) for row in (("a", 1e-6, "o*"), ("b", 2e-6, ""), ("c", 2e-6, "o*"))]
    text = "\n".join(
        ["model Node {", "parameter o = 0.5", "Se s : P = 1e5 [Pa]*sin(7 [1/s]*time)", *orifices, "C t : P = V/1e-9 [m^3/Pa]",
         "0 n, m : hydraulic", "s -> 1(a) -> n", "n -> b", "n -> 1(c) -> m", "m -> t", "output P = t.P", "}"]
    )  # fmt: skip

    def root(p: float) -> float:
        return float(np.sign(p) * abs(p) ** 0.5)

    def rate(time: float, volume: Any) -> float:
        supply, stored = 1e5 * np.sin(7 * time), volume[0] / 1e-9
        ends = min(supply, stored, 0.0) - 1, max(supply, stored, 0.0) + 1
        node = brentq(
            lambda p: share * root(supply - p) - 2 * root(p) - 2 * share * root(p - stored), *ends, xtol=1e-12
        )
        return 2e-6 * share * root(node - stored)

    found = bondgraph.load(text).simulate(to=0.4, points=5, settings={"o": share}, rtol=1e-4)
    right = solve_ivp(rate, (0, 0.4), [0.0], method="LSODA", rtol=1e-6, atol=1e-13, t_eval=found.time).y[0] / 1e-9
    np.testing.assert_allclose(found["P"], right, rtol=0, atol=1e-3 * np.abs(right).max() + 1e-12)


@pytest.mark.parametrize(
    ("equation", "guess", "end", "last"),
    [("z + sqrt(z) = 2 - time", 1, 2, 0), ("z - sqrt(1 - z) = time", 0.5, 1, 1), ("asin(z) + z = time", 0.1, 1 + np.pi / 2, 1), ("z + sqrt(z) = (1 - time)^2", 1, None, 0.381966)],
)  # fmt: skip
def test_a_solution_ends_where_a_law_has_no_value_beyond(
    equation: str, guess: float, end: float | None, last: float
) -> None:
    """The slope is infinite there, so any step of Newton's method was rounding: a run went on 8e-6 s with what solves nothing."""
    model = bondgraph.load(f"plain model A {{ solve {equation} for z = {guess}; output o = z }}")
    assert model.simulate(to=2 if end is None else end - 1e-12, points=3).final("o") == pytest.approx(last, abs=1e-5)
    for beyond in () if end is None else (1e-7, 8e-6):
        with pytest.raises(RunFailed, match="no solution that could be found"):
            model.simulate(to=end * (1 + beyond), points=3)


@pytest.mark.parametrize(
    "c",
    [1e-12, -1e-10, 1e-4, *(pytest.param(c, marks=pytest.mark.machine_code) for c in (1.3387719732501184e-10, 1e-8))],
)
@pytest.mark.parametrize("s", [-0.3, 0.3])
def test_a_solution_beside_a_pole_is_found(c: float, s: float) -> None:
    """(z - 1.5)^2 = s^2 + c: one of the two is nearer to the pole than any guess, and there Newton's steps are small anywhere."""
    text = "plain model A {\n  parameter c = 1, s = 1, guess = 2\n  solve (z - 1.5) - s = c/((z - 1.5) + s) for z = guess\n  output y = z\n}"
    for guess, side in ((2.5, 1.0), (1.0, -1.0)):
        found = poles_model(text).simulate(to=1e-3, points=2, settings={"c": c, "s": s, "guess": guess})
        expected = 1.5 + side * np.sqrt(s * s + c)
        assert found.final("y") == pytest.approx(expected, abs=1e-14)
        assert any("of several solutions" in note for note in found.notes)


@cache
def poles_model(text: str) -> bondgraph.Model:
    return bondgraph.load(text)


@pytest.mark.parametrize(
    ("slope", "load"),
    [
        ("1e-6", 1),
        ("1e-3", 1e4),
        *(pytest.param(slope, 1e4, marks=pytest.mark.machine_code) for slope in ("1e-6", "0.05")),
    ],
)
def test_a_steep_diode_without_any_storage_blocks(slope: str, load: float) -> None:
    """Its voltage is within the tolerance of its threshold all the time, but loops beside no states are solved to rounding."""
    found = bondgraph.load(f"""plain model A {{
      Se s : e = 10*sin(2*pi*50*time)
      R d : f = (e - 0.7)/{slope} if e > 0.7 else 0
      R load : e = {load}*f
      s -> 1(d, load)
      output i = load.f
    }}""").simulate(to=0.03, points=61)
    np.testing.assert_allclose(
        found["i"],
        np.maximum(10 * np.sin(100 * np.pi * found.time) - 0.7, 0) / (load + float(slope)),
        atol=1e-7 * found["i"].max(),
    )


@pytest.mark.parametrize("slope", ["50 mohm", pytest.param("1 mohm", marks=pytest.mark.machine_code), "3 ohm"])
def test_a_branch_goes_on_where_a_law_bends(slope: str) -> None:
    """The determinant of a loop jumps there, by more than any smooth law would have it change."""
    found = bondgraph.load(f"""import DiodeBridge from power
    model A {{
      Se supply : u = 10 V*sin(2*pi*50 Hz*time)
      DiodeBridge part {{ U_0 = 0.7 V, R_on = {slope} }}
      R load : u = 9.9 ohm*i
      supply -> part.ac
      part.dc -> load
      output i = load.i
    }}""").simulate(to=0.021, points=61)
    resistance = 9.9 + 2 * {"50 mohm": 0.05, "1 mohm": 0.001, "3 ohm": 3.0}[slope]
    expected = np.maximum(np.abs(10 * np.sin(100 * np.pi * found.time)) - 1.4, 0) / resistance
    np.testing.assert_allclose(found["i"], expected, atol=1e-8)
