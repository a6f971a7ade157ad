"""Tables and noise in generated code: the numbers of the algebra, exact Jacobians, batches of states and of parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.algebra import interpolate
from compiler.algebra.operators import SLOPES, value_of
from compiler.codegen.numpy.generate import load_module
from compiler.codegen.numpy.runtime import beginning
from tests.codegen.test_jacobian import differences
from tests.compiling import Running, compiled, numbers, refused

WORDS = load_module(
    "words", beginning({"linear", "cubic", "inverse", "natural_slope", "monotone_slope", "noise", "root"})
)
XS, YS = (0.0, 1.0, 2.5, 4.0), (0.5, 1.0, 1.2, 5.0)
SLOPE = {"cubic": interpolate.natural_slopes(XS, YS), "monotone": interpolate.monotone_slopes(XS, YS)}
FALLING = tuple(-y for y in YS)


def arrays(*lists: tuple[float, ...]) -> list[Any]:
    return [np.array(values) for values in lists]


class TestWords:
    """Functions at the beginning of a module, against the algebra's own numbers."""

    AT = np.linspace(-1, 5, 61)

    @pytest.mark.parametrize("order", [0, 1, 2, 3])
    @pytest.mark.parametrize("kind", ["cubic", "monotone"])
    def test_hermite(self, kind: str, order: int) -> None:
        inside = self.AT[(self.AT >= 0) & (self.AT <= 4)]
        expected = [value_of("cubic", (order, x, *XS, *YS, *SLOPE[kind])) for x in inside]
        points = arrays(XS, YS, SLOPE[kind])
        np.testing.assert_allclose(WORDS._hermite(order, inside, *points), expected, rtol=1e-14, atol=1e-14)
        assert [WORDS._hermite(order, float(x), *points) for x in inside] == pytest.approx(
            expected, rel=1e-14, abs=1e-14
        )

    @pytest.mark.parametrize("kind", ["cubic", "monotone"])
    def test_beyond_the_ends_it_is_straight_and_smooth(self, kind: str) -> None:
        """Only trial points of a solver come here: they see no jump of value or slope."""
        points = arrays(XS, YS, SLOPE[kind])
        for end in (0.0, 4.0):
            before, after = (WORDS._hermite(0, end + h, *points) for h in (-1e-9, 1e-9))
            slope = WORDS._hermite(1, end, *points)
            assert before == pytest.approx(after, abs=1e-7)
            outside = end + (3.0 if end else -3.0)
            assert WORDS._hermite(1, outside, *points) == slope and WORDS._hermite(2, outside, *points) == 0
            value = WORDS._hermite(0, end, *points) + (outside - end) * slope
            assert WORDS._hermite(0, outside, *points) == pytest.approx(value)

    @pytest.mark.parametrize("values", [YS, FALLING])
    def test_inverse(self, values: tuple[float, ...]) -> None:
        slopes = interpolate.monotone_slopes(XS, values)
        at = np.linspace(values[0], values[-1], 41)
        found = WORDS._inverse(0, at, *arrays(XS, values, slopes))
        np.testing.assert_allclose(WORDS._hermite(0, found, *arrays(XS, values, slopes)), at, rtol=1e-12)
        for y, x in zip(at.tolist(), found.tolist(), strict=True):
            assert value_of("inverse", (0, y, *XS, *values, *slopes)) == pytest.approx(x, rel=1e-12, abs=1e-12)
            assert float(WORDS._inverse(0, y, *arrays(XS, values, slopes))) == pytest.approx(x, rel=1e-12, abs=1e-12)

    def test_slopes(self) -> None:
        assert set(SLOPES) == {"natural_slope", "monotone_slope"}
        assert WORDS._natural_slope(XS, YS) == pytest.approx(SLOPE["cubic"], rel=1e-14)
        assert WORDS._monotone_slope(XS, YS) == pytest.approx(SLOPE["monotone"], rel=1e-14)
        batch = np.array([YS, FALLING]).T  # points first
        for row, values in enumerate((YS, FALLING)):
            found = [slope[row] for slope in WORDS._monotone_slope(XS, list(batch))]
            assert found == pytest.approx(interpolate.monotone_slopes(XS, values), rel=1e-14)

    @pytest.mark.parametrize("order", range(6))
    @pytest.mark.parametrize("seed", [0, 7, -3, 2**53])
    def test_noise_bit_by_bit(self, order: int, seed: int) -> None:
        at = np.linspace(-3.3, 1e6, 57)
        expected = [interpolate.noise_at(order, x, seed) for x in at.tolist()]
        found = WORDS._noise(order, at, float(seed))
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-10)
        assert [WORDS._noise(order, x, float(seed)) for x in at.tolist()] == expected

    def test_noise_of_what_is_not_finite(self) -> None:
        assert np.isnan(WORDS._noise(0, np.array([np.nan, np.inf, 1e300]), 1.0)).all()
        assert np.isnan(WORDS._noise(0, np.nan, 1.0))

    def test_root(self) -> None:
        with np.errstate(all="ignore"):
            found = WORDS._root(np.array([8.0, -8.0, 4.0, -4.0]), np.array([3.0, 3.0, 2.0, 1.5]))
        assert found[:2] == pytest.approx([2, -2]) and np.isnan(found[2:]).all()


SPRINGS = """
model Springs {{
  parameter xs = (-3, 0, 1, 4), ys = ({ys})
  Se push : F = 1 N*noise(time, 0.1 s, 3) + 1 N*linear(time/1 s, (0, 1, 9), (0, 1, 3))
  I  mass : p = 1 kg*v
  C  held : F = 1 N*{law}
  R  loss : F = 1 N*monotone(v/1 [m/s], (-20, 0, 1, 20), (-9, 0, 0.2, 14))
  push -> 1(mass, held, loss)
  output x = held.x, road = noise(held.x, 0.3 m, 2)
}}
"""
LAWS = {
    "linear": "linear(x/1 m, xs, ys)", "cubic": "cubic(x/1 m, xs, ys)", "monotone": "monotone(x/1 m, xs, ys)",
    "numbers": "cubic(x/1 m, (-3, 0, 1, 4), (-4, 0, 0.5, 4))", "road": "noise(x, 0.3 m, 2)",
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_the_jacobian_is_exact(law: str) -> None:
    running = Running(compiled(SPRINGS.format(law=LAWS[law], ys="-4, 0, 0.5, 4")))
    generator = np.random.default_rng(5)
    for _ in range(10):
        state = generator.uniform(-2.5, 3.5, 2)
        arguments = (running.inputs, running.constants, running.program.switches(0.37, running.constants))
        exact = running.program.jacobian(0.37, state, *arguments)

        def rates(x: Any, arguments: Any = arguments) -> Any:
            return running.program.derivative(0.37, x, *arguments)

        found = differences(rates, state, np.full(2, 1e-5)) / 1e-5
        np.testing.assert_allclose(exact, found, rtol=1e-6, atol=1e-6)


def test_an_energy_that_is_a_table_gives_its_slope() -> None:
    text = """
    model A {
      C field : energy = 1 J*cubic(x/(1 m), (0, 1, 2, 3), (0, 1, 4, 9))
      Sf drive : v = 1 [m/s]
      drive -> field
      output F = field.F, x = field.x
    }"""
    running = Running(compiled(text))
    found = running.outputs({"field.x": 1.4})
    spline = interpolate.natural_slopes((0, 1, 2, 3), (0, 1, 4, 9))
    assert found["F"] == pytest.approx(value_of("cubic", (1, 1.4, 0, 1, 2, 3, 0, 1, 4, 9, *spline)), rel=1e-14)


@pytest.mark.parametrize("law", ["linear", "cubic", "monotone"])
def test_points_are_arguments_of_a_program(law: str) -> None:
    """A batch of parameters is its members, each as if compiled with its numbers."""
    text = SPRINGS.format(law=LAWS[law], ys="-4, 0, 0.5, 4")
    program = compiled(text, free=("*",)).program
    assert "ys[4]" in program.parameters.names
    sets = np.array([program.defaults] * 3)
    sets[:, program.parameters.names.index("ys[4]")] = 4, 5, 6
    constants = program.constants(sets)
    states = np.array([[0.1, 2.0], [0.2, 3.0], [-0.5, 3.9]])
    mode = program.switches(0.1, constants)
    found = program.derivative(0.1, states, np.array(program.input_defaults), constants, mode)
    for i, last in enumerate((4, 5, 6)):
        one = Running(compiled(text.replace("0.5, 4)", f"0.5, {last})", 1)))
        state = dict(zip(one.program.states.names, states[i].tolist(), strict=True))
        assert list(one.rates(state, 0.1).values()) == pytest.approx(found[i].tolist(), rel=1e-13)


@pytest.mark.parametrize(("law", "expected"), [("linear", 1.6), ("monotone", None)])
def test_a_valve_is_turned_round(law: str, expected: float | None) -> None:
    """Flow given, pressure wanted: Q(P) is what was given."""
    text = f"""
    model A {{
      parameter drop: bar = (0, 1, 4), flow: L/s = (0, 0.05, 0.3)
      Sf pump : Q = 0.1 [L/s]
      R valve : Q = {law}(P, drop, flow)
      pump -> valve
      output P = valve.P, again = {law}(valve.P, drop, flow)
    }}"""
    found = numbers(text)
    assert found["again"] == pytest.approx(1e-4, rel=1e-13)
    if expected is not None:
        assert found["P"] == pytest.approx(expected * 1e5, rel=1e-14)


def test_points_that_turn_back_are_seen_where_they_are_parameters() -> None:
    text = "model A {\n  parameter ys = (0, 2, %s)\n  Sf s : u = 1 V\n}"
    text = "model A {\n  parameter xs = (0, 1, 2), ys = (0, 2, %s)\n  Sf s : i = 1 A\n  R r : i = 1 A*linear(u/(1 V), xs, ys)\n  s -> r\n  output u = r.u\n}"
    assert numbers(text % "3") == {"u": 0.5}
    assert "`r`" in refused(compiled(text % "1"), "BG603").sentence


def test_long_tables_are_arrays_of_the_module() -> None:
    """Numbers of the text are written once, for any number of uses."""
    many = ", ".join(map(str, range(400)))
    body = "signal u = integral(1 [1/s], 3.5)\noutput a = cubic(u, xs, xs), b = linear(u, xs, xs), c = monotone(2*u, xs, xs)"
    text = f"constant xs = ({many})\nmodel A {{\n{body}\n}}\n"
    source = compiled(text).program.source
    assert source.count("398.0,") == 1 and len(source) < 40_000
    assert numbers(text) == pytest.approx({"a": 3.5, "b": 3.5, "c": 7.0})


class TestPowers:
    TEXT = (
        "model A {\n  parameter n = %s\n  Sf s : i = 1 A*%s\n  R r : i = 2 A*(u/(1 V))^n\n  s -> r\n  output u = r.u\n}"
    )

    @pytest.mark.parametrize(("n", "i", "u"), [("1.4", "3", 1.5 ** (1 / 1.4)), ("3", "-16", -2.0), ("-1", "4", 0.5)])
    def test_with_a_parameter_as_exponent(self, n: str, i: str, u: float) -> None:
        assert numbers(self.TEXT % (n, i))["u"] == pytest.approx(u, rel=1e-13)

    def test_an_even_one_is_refused_where_its_value_is_known(self) -> None:
        assert "power of 4" in refused(compiled(self.TEXT % ("4", "1")), "BG604").sentence
        assert refused(compiled(self.TEXT % ("3", "1"), {"n": "2"}), "BG604")


class TestForPeople:
    """Equations and stages name tables as their author does."""

    TEXT = """model Shown {
  parameter xs: mm = (0, 1, 2)
  constant long = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13)
  Sf drive : v = 1 [mm/s]*noise(time, 10 ms, 3)
  C  spring : energy = 1 J*cubic(x, xs, (0, 1, 4))
  R  loss   : F = 1 N*linear(v/1 [m/s] + 1, long, long)
  drive -> 1(spring, loss)
  require spring.x < 1 mm "short"
  output x = spring.x, F = spring.F
}
"""

    def test_equations(self) -> None:
        text = bondgraph.load(self.TEXT).equations()
        assert "spring.F = cubic_slope(spring.x, (0, xs[2], xs[3]), (0, 1, 4))" in text
        assert "drive.v = 0.001*noise(100.0*time, 3)" in text
        assert "linear(1 + drive.v, 14 points)" in text.replace("drive.v + 1", "1 + drive.v")

    def test_latex(self) -> None:
        text = bondgraph.load(self.TEXT).equations(latex=True)
        assert r"\operatorname{cubic" in text and r"\operatorname{noise}" in text

    def test_state_equations(self) -> None:
        (right,) = bondgraph.load(self.TEXT).state_equations().values()
        assert str(right) == "0.001*noise(100.0*time, 3)"

    def test_stages(self) -> None:
        shown = bondgraph.load(self.TEXT).show("graph")
        assert "required: spring.x < 1 mm  # text:8 short" in shown
        assert "_hermite(" in bondgraph.load(self.TEXT).show("code")

    def test_a_module_of_its_own(self) -> None:
        """It needs numpy alone and keeps its points as parameters."""
        source = bondgraph.load(self.TEXT).compile()
        module = load_module("own", source)
        assert "import scipy" not in source
        p, state = module.Parameters(), np.array([5e-4])
        assert p.xs_3 == 2e-3
        spline = interpolate.natural_slopes((0, 1e-3, 2e-3), (0, 1, 4))
        expected = 1e-3 * interpolate.noise_at(0, 1.25, 3)
        assert module.derivative(0.0125, state, p) == pytest.approx([expected], rel=1e-12)
        assert module.holds(0.0, state, p).all()
        slope = value_of("cubic", (1, 5e-4, 0, 1e-3, 2e-3, 0, 1, 4, *spline))
        assert module.outputs(0.0, state, p)[1] == pytest.approx(slope, rel=1e-12)
