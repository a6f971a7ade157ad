"""Algebraic loops: linear ones of one, two and five unknowns against numpy; nonlinear ones against closed forms; singular ones refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import lambertw

import bondgraph
from bondgraph.errors import RunFailed
from compiler.algebra.expression import Symbol
from compiler.reduction.round_trips import Sums
from compiler.reduction.state_space import LinearLoop
from tests.compiling import Running, compiled, mistake, mistakes


def loops(text: str) -> list[LinearLoop]:
    return [s for s in compiled(text, everything=True).state_space.steps if isinstance(s, LinearLoop)]


DIVIDER = "model A {\n  parameter r1 = 2 ohm, r2 = 3 ohm\n  Se s : u = 6 V\n  1 a\n  R r : u = r1*i\n  R t : u = r2*i\n  s -> a -> r, t\n  output current = r.i, ur = r.u, ut = t.u\n}\n"


def test_one_unknown() -> None:
    assert Running(compiled(DIVIDER)).outputs() == pytest.approx({"current": 1.2, "ur": 2.4, "ut": 3.6}, rel=1e-15)
    (loop,) = loops(DIVIDER)
    assert len(loop.targets) == 1 and set(loop.members) == {"a", "r", "t"}


def test_two_unknowns_that_time_alone_drives() -> None:
    """The extrema of such a loop are found from its derivative by time, which has the same matrix."""
    text = """model A {
  Se s : u = 1 V*sin(3*time/1 s)
  1 a, b
  R h(a: electric, b: electric) : a.u = 2 ohm*a.i + 1 ohm*b.i, b.u = 1 ohm*a.i + 3 ohm*b.i
  R g(a: electric, b: electric) : a.u = 4 ohm*a.i + 1 ohm*b.i, b.u = 1 ohm*a.i + 5 ohm*b.i
  0 n, z
  s -> a -> h.a, g.a, n
  n -> b -> h.b, g.b
  MSf f : i = h.a.u*1 [A/V]
  C c : u = q/1 F
  R leak : u = 1 ohm*i
  f -> z -> c, leak
  output y = c.u, u = h.a.u
}
"""
    # One current through all four ports, since n joins a and b alone: 2 + 1 + 4 + 1 + 1 + 3 + 1 + 5 = 18 ohm.
    assert [len(x.targets) for x in loops(text)] == [2]
    run = bondgraph.load(text).simulate(to=4, points=41, rtol=1e-9)
    share, t = 3 / 18, run.time
    assert run["u"] == pytest.approx(share * np.sin(3 * t), abs=1e-14)
    assert run["y"] == pytest.approx(share * (np.sin(3 * t) - 3 * np.cos(3 * t) + 3 * np.exp(-t)) / 10, abs=1e-9)


def ladder(series: list[float], shunt: list[float]) -> tuple[str, list[float]]:
    """A ladder of resistors behind 10 V: its text, and its node voltages by numpy."""
    n = len(series)
    lines = ["  Se s : u = 10 V", "  0 k[0] : electric", "  s -> k[0]"]
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i, (r, g) in enumerate(zip(series, shunt, strict=True), 1):
        lines += [f"  0 k[{i}] : electric", f"  R series[{i}] : u = {r!r} ohm*i", f"  R shunt[{i}] : u = {g!r} ohm*i"]
        lines += [f"  k[{i - 1}] -> 1(series[{i}]) -> k[{i}] -> shunt[{i}]", f"  output v[{i}] = k[{i}].u"]
        for j in (i - 1, i - 2):
            if j >= 0:
                matrix[j, j] += 1 / r
        if i > 1:
            matrix[i - 1, i - 2] -= 1 / r
            matrix[i - 2, i - 1] -= 1 / r
        matrix[i - 1, i - 1] += 1 / g
    right[0] = 10 / series[0]
    return "model A {\n" + "\n".join(lines) + "\n}\n", np.linalg.solve(matrix, right).tolist()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_ladders_of_resistors(n: int) -> None:
    text, expected = ladder([1.0 + i for i in range(n)], [10.0 - i for i in range(n)])
    assert list(Running(compiled(text)).outputs().values()) == pytest.approx(expected, rel=1e-13)


@settings(max_examples=25)
@given(st.lists(st.tuples(st.floats(0.01, 1000), st.floats(0.01, 1000)), min_size=2, max_size=5))
def test_ladders_at_random(values: list[tuple[float, float]]) -> None:
    text, expected = ladder([a for a, _ in values], [b for _, b in values])
    assert list(Running(compiled(text)).outputs().values()) == pytest.approx(expected, rel=1e-9)


def coupled(n: int, seed: int) -> tuple[str, list[float]]:
    """n meshes with a source each that all share resistors: a full matrix of n unknowns; the currents by numpy."""
    generator = np.random.default_rng(seed)
    own, shared = generator.uniform(1, 5, n).tolist(), generator.uniform(0.1, 2, (n, n)).tolist()
    lines: list[str] = []
    matrix = np.diag(own)
    for i in range(n):
        lines += [
            f"  1 m{i} : electric",
            f"  Se s{i} : u = {i + 1} V",
            f"  R own{i} : u = {own[i]!r} ohm*i",
            f"  s{i} -> m{i} -> own{i}",
            f"  output i{i} = m{i}.i",
        ]
        for j in range(i + 1, n):  # what flows through the shared resistor is i_i - i_j
            lines += [
                f"  0 k{i}{j} : electric",
                f"  R r{i}{j} : u = {shared[i][j]!r} ohm*i",
                f"  m{i} -> k{i}{j} -> r{i}{j}",
                f"  k{i}{j} -> m{j}",
            ]
            matrix[[i, j], [i, j]] += shared[i][j]
            matrix[[i, j], [j, i]] -= shared[i][j]
    return "model A {\n" + "\n".join(lines) + "\n}\n", np.linalg.solve(matrix, np.arange(1.0, n + 1)).tolist()


@pytest.mark.parametrize("n", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", [1, 2])
def test_meshes_that_are_all_coupled(n: int, seed: int) -> None:
    text, expected = coupled(n, seed)
    found = Running(compiled(text)).outputs()
    assert [found[f"i{i}"] for i in range(n)] == pytest.approx(expected, rel=1e-11)


def test_five_unknowns_are_one_system() -> None:
    """Solved numerically in the generated code, never written out."""
    text, _ = coupled(5, 3)
    found = loops(text)
    assert len(found) == 1 and 2 <= len(found[0].targets) <= 10
    matrix = found[0].matrix
    assert len(matrix) == len(found[0].targets) and all(len(row) == len(matrix) for row in matrix)
    assert "_solve(" in compiled(text).program.source


def test_a_loop_that_depends_on_states_and_time() -> None:
    """u(t) over two resistors with a capacitor behind: rates and Jacobian see through the loop."""
    text = "model A {\n  Se s : u = 6 V*sin(time/1 s)\n  1 a\n  0 b\n  R r : u = 2 ohm*i\n  R t : u = 3 ohm*i\n  R w : u = 4 ohm*i\n  C c : u = q/5 F\n  s -> a -> r, b\n  b -> t, 1(w, c)\n}\n"
    running = Running(compiled(text, everything=True))
    for q, time in ((1.0, 0.3), (-2.0, 2.0)):
        u, uc = 6 * np.sin(time), q / 5
        node = (u / 2 + uc / 4) / (1 / 2 + 1 / 3 + 1 / 4)
        assert running.rates({"c.q": q}, time)["c.q"] == pytest.approx((node - uc) / 4, rel=1e-12)
    jacobian = running.program.jacobian(*running.arguments(0.3, {"c.q": 1.0}, None))
    slope = (1 / 5 / 4 / (1 / 2 + 1 / 3 + 1 / 4) - 1 / 5) / 4
    assert np.asarray(jacobian).reshape(1, 1)[0, 0] == pytest.approx(slope, rel=1e-12)


def test_parameters_in_a_loop_stay_parameters() -> None:
    running = Running(compiled(DIVIDER, free=("*",)))
    assert set(running.program.parameters.names) == {"r1", "r2"}
    running.parameters[running.program.parameters.names.index("r1")] = 9.0
    running.constants = running.program.constants(running.parameters)
    assert running.outputs()["current"] == pytest.approx(0.5, rel=1e-15)


class TestRefused:
    def test_singular_by_structure(self) -> None:
        """Two resistors that cancel for every value of the source."""
        text = "model A {\n  Se s : u = 12 V\n  1 loop\n  R plus : u = 3 ohm*i\n  R minus : u = -3 ohm*i\n  s -> loop -> plus, minus\n  output i = loop.i\n}\n"
        assert "`plus`" in mistake(text, "BG502").sentence

    def test_nothing_decides_the_flow_around_a_ring(self) -> None:
        """0 and 1 junctions in a ring with nothing but sources: refused, never dropped."""
        text = "plain model A {\n  Se s : e = 1\n  1 a\n  0 b, c\n  1 d\n  s -> a -> b -> d\n  a -> c -> d\n  output y = d.f\n}\n"
        found = mistakes(text)
        assert found and {d.code for d in found} <= {"BG301", "BG404", "BG502"} and found[0].help

    def test_singular_for_these_numbers_only(self) -> None:
        """A matrix that turns singular at run time gives NaN, not an exception or a wrong number."""
        text = "model A {\n  parameter r1 = 2 ohm, r2 = 3 ohm\n  Se s : u = 6 V\n  1 a\n  R r : u = r1*i\n  R t : u = r2*i\n  s -> a -> r, t\n  output i = a.i\n}\n"
        with np.errstate(all="ignore"):
            value = Running(compiled(text, {"r1": "-3 ohm"}, free=("*",))).outputs()["i"]
        assert not np.isfinite(value)

    def test_nothing_to_compute(self) -> None:
        assert mistake("model A {\n  parameter a = 2\n}\n", "BG505").help

    def test_a_signal_that_reads_the_loop(self) -> None:
        """A modulated source that reads what it drives is a loop too."""
        text = "model A {\n  MSe s : u = 6 V - 2*r.u\n  R r : u = 3 ohm*i\n  R t : u = 4 ohm*i\n  s -> 1(r, t)\n  output i = r.i\n}\n"
        assert Running(compiled(text)).outputs()["i"] == pytest.approx(6 / (3 + 4 + 2 * 3), rel=1e-14)


class TestNonlinear:
    """Loops that are not linear: the run solves them; against closed forms."""

    def test_a_diode_behind_a_resistor(self) -> None:
        """i = Ut/R W(Is R/Ut exp((V + Is R)/Ut)) - Is (Banwell and Jayakumar, Electron. Lett. 36, 2000)."""
        text = "model A {\n  Se s : u = 2 V\n  1 loop\n  R series : u = 3 ohm*i\n  R diode : i = 1 uA*(exp(u/26 mV) - 1)\n  s -> loop -> series, diode\n  output i = loop.i\n}\n"
        (unknown,) = compiled(text).state_space.unknowns
        assert set(unknown.members) == {"loop", "series", "diode"}
        found = bondgraph.load(text).simulate(to=1, points=3)
        leak, thermal, r, u = 1e-6, 26e-3, 3.0, 2.0
        exact = thermal / r * lambertw(leak * r / thermal * np.exp((u + leak * r) / thermal)).real - leak
        assert found["i"] == pytest.approx([exact] * 3, rel=1e-13) and found.solver == "Newton"

    def test_a_product_of_two_unknowns(self) -> None:
        """3 i + 2 |i| 3 i = 12; without the bars there were two solutions."""
        text = "model A {\n  Se s : u = 12 V\n  1 loop\n  R series : u = 3 ohm*i\n  MR odd : u = 2 [ohm/V]*abs(i)*series.u\n  s -> loop -> series, odd\n  output i = loop.i\n}\n"
        i = bondgraph.load(text).simulate(to=1, points=2).final("i")
        assert 6 * i * i + 3 * i == pytest.approx(12, rel=1e-14)

    def test_a_signal_in_a_loop(self) -> None:
        text = "model A {\n  MSe s : u = 6 V - 2 [1/V]*r.u*abs(r.u)\n  R r : u = 3 ohm*i\n  R t : u = 4 ohm*i\n  s -> 1(r, t)\n  output i = r.i\n}\n"
        i = bondgraph.load(text).simulate(to=1, points=2).final("i")
        assert 6 - 18 * i * i == pytest.approx(7 * i, rel=1e-13)

    def test_a_law_without_an_inverse(self) -> None:
        """q = C u + c3 u^3: the effort that a displacement asks for is an unknown of its own."""
        text = "model A {\n  Sf s : i = 2 A\n  C c : q = 1 F*u + 0.5 [C/V^3]*u^3\n  R r : u = 1e9 ohm*i\n  s -> 0(c, r)\n  output u = c.u, q = c.q\n}\n"
        found = bondgraph.load(text).simulate(to=3, points=4, rtol=1e-9)
        u, q = found["u"], found["q"]
        assert u + 0.5 * u**3 == pytest.approx(q, rel=1e-12) and q[-1] == pytest.approx(6, rel=1e-8)

    def test_a_rectifier(self) -> None:
        """A diode between a source and a capacitor: errors in proportion to the tolerance, no peak missed, energy balanced."""
        text = "model A {\n  Se s : u = 5 V*sin(2*pi*time*50 Hz)\n  R series : u = 10 ohm*i\n  R diode : i = 1 nA*(exp(u/26 mV) - 1)\n  C c : u = q/(100 uF)\n  R load : u = 1000 ohm*i\n  s -> 1(series, diode) -> 0(c, load)\n  output u = c.u\n}\n"
        model = bondgraph.load(text)
        fine = model.simulate(to=0.06, points=31, rtol=1e-10)
        for rtol in (1e-4, 1e-6):
            found = model.simulate(to=0.06, points=31, rtol=rtol, energy=True)
            assert found["u"] == pytest.approx(fine["u"], abs=20 * rtol * 5)
            assert abs(found.energy.residual) < 20 * rtol * found.energy.supplied

    def test_a_loop_without_solution_is_told(self) -> None:
        """i^2 = -1 has no real solution."""
        text = "model A {\n  Se s : u = -1 V\n  1 loop\n  R odd : u = 1 [V/A^2]*i^2\n  s -> loop -> odd\n  output i = loop.i\n}\n"
        with pytest.raises(RunFailed, match=r"odd|loop"):
            bondgraph.load(text).simulate(to=1, points=2)


@pytest.mark.parametrize(("kind", "ratio"), [("GY", "1.49"), ("GY", "r"), ("MGY", "r*(1 + 0.4*sin(time))")])
def test_a_gyrator_that_gives_back_what_it_takes(kind: str, ratio: str) -> None:
    """Between two junctions of one flow: its efforts cancel, so the other one sees a short circuit and holds the mass."""
    text = f"""plain model A {{
      parameter r = 3
      {kind} back : e1 = {ratio}*f2
      MGY far : f1 = (2 + sin(time))*e2
      1 a, b, c
      I mass : p = 2*f
      R loss : e = 5*f
      Se push : e = 7
      a -> back -> b
      a -> b
      push -> c -> far -> a
      c -> mass, loss
      output f = c.f, e = far.e1, taken = a.f
    }}"""
    result = bondgraph.load(text).simulate(to=1, points=3)
    assert result["f"] == pytest.approx(0, abs=1e-12)
    # All of the push goes into the gyrator, whose flow is what the other loop carries round.
    assert result["e"] == pytest.approx(7.0)
    assert result["taken"] == pytest.approx(7 * (2 + np.sin(result.time)), rel=1e-9)


def test_terms_that_return_cancel_and_small_ones_stay() -> None:
    """s = x + 2 y: in s - x only 2 y is left; 1e-20 x beside y is no rounding, whatever the units, and 1e-16 x that remains of x is."""
    x, y, s = Symbol("x"), Symbol("y"), Symbol("s")
    sums = Sums({"s": x + 2.0 * y})
    assert sums.open(s - x) == ({y: 2.0}, True)
    assert sums.open(1e-20 * x + y) == ({x: 1e-20, y: 1.0}, False)
    assert sums.open(s - (1.0 - 2e-16) * x) == ({y: 2.0}, True)
