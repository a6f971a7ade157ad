"""NaN and infinity never pass silently; an invalid time is an error; a zero has its law."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph import RunFailed, UsageError

ROOT = "plain model M {\n  1 j\n  Se s : e = 1\n  I b : p = f\n  s -> j -> b\n  output y = log(b.f - 0.6)\n  output v = b.f\n}\n"


def test_an_output_without_a_value_stops_the_run_with_its_name_and_time() -> None:
    with pytest.raises(
        RunFailed,
        match=r"at t = 0 s `y` is not finite: `y`, computed at `y` \(line 6\), has no value there: the logarithm of -0\.6",
    ):
        bondgraph.load(ROOT).simulate(to=1.0, points=3)


def test_an_output_that_nobody_asked_for_stops_nothing() -> None:
    values = bondgraph.load(ROOT).simulate(to=1.0, points=3, outputs=("v",))["v"]
    np.testing.assert_allclose(values, [0.0, 0.5, 1.0], rtol=1e-12)


def test_a_loop_without_a_solution_is_told_with_its_members() -> None:
    """-3 ohm and 3 ohm in one loop: no current is the current."""
    text = "model A {\n  input r = 2 ohm\n  Se s : u = 6 V\n  1 a\n  MR q : u = r*i\n  R t : u = 3 ohm*i\n  s -> a -> q, t\n  output i = a.i\n}\n"
    model = bondgraph.load(text)
    assert model.simulate(to=1.0, points=2).final("i") == pytest.approx(1.2, rel=1e-14)
    with pytest.raises(RunFailed, match=r"at t = 0 s `i` is not finite: .*(`q`|`t`|`a`)"):
        model.simulate(to=1.0, points=2, settings={"r": "-3 ohm + 1 ohm*time/1 s"})


@pytest.mark.parametrize("text", ["5 foo", "5 kg", "5 )", "soon", "", "-1 s", "1 s + 1 s"])
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(UsageError, match="is no time: write `20 ms`"):
        bondgraph.load(ROOT).simulate(to=text, outputs=("v",))


@pytest.mark.parametrize(("text", "end"), [("20 ms", 0.02), ("2 [s]", 2.0), ("0.1", 0.1), ("1 min", 60.0)])
def test_what_is_a_time(text: str, end: float) -> None:
    assert bondgraph.load(ROOT).simulate(to=text, points=2, outputs=("v",)).time[-1] == pytest.approx(end, rel=1e-15)


# Elements that give nothing and are read: what they hold back, the rest of the circuit does not feel.
SILENT = {
    "I a : p = w*f": ("1", "I b : p = f", "p", 0.0),
    "C a : q = w*e": ("0", "C b : q = e", "q", 0.0),
    "C a : energy = w*q^2/2": ("1", "I b : p = f", "q", 0.5),
    "I a : f = w*p": ("0", "C b : q = e", "p", 0.5),
    "C a : e = w*q": ("1", "I b : p = f", "q", 0.5),
    "R a : f = w*e": ("0", "C b : q = e", "e", 1.0),
    "R a : e = w*f": ("1", "I b : p = f", "f", 1.0),
}


@pytest.mark.parametrize("law", SILENT)
def test_a_law_that_is_zero_and_read(law: str) -> None:
    """A source of one into a storage of one gives t; the silent element beside it sees t or its integral, or nothing."""
    junction, other, variable, end = SILENT[law]
    source, seen = ("Se s : e = 1", "f") if junction == "1" else ("Sf s : f = 1", "e")
    text = f"plain model M {{\n  parameter w = 0\n  {junction} j\n  {source}\n  {law}\n  {other}\n  s -> j -> a, b\n  output x = a.{variable}\n  output y = b.{seen}\n}}\n"
    result = bondgraph.load(text).simulate(to=1.0, points=3)
    np.testing.assert_allclose(result["y"], [0.0, 0.5, 1.0], rtol=1e-12)
    assert result.final("x") == pytest.approx(end, rel=1e-9, abs=1e-15)


def test_a_law_that_is_zero_where_it_cannot_be_is_named() -> None:
    text = "plain model M {\n  parameter w = 0\n  0 j\n  Se s : e = 1\n  R a : e = w*f\n  s -> j -> a\n  output y = a.f\n}\n"
    with pytest.raises(bondgraph.CompilationFailed, match=r"BG301: The 0-junction `j` takes its effort.*`a`"):
        bondgraph.load(text).simulate(to=1.0)


class TestTransducerOfRatioZero:
    """A transducer with ratio zero, in the direction that divides by it: the error names its line and the cause of the zero."""

    TEXT = "plain model M {\n  parameter w = 0\n  parameter m = 0\n  1 j\n  Se s : e = 1\n  TF t : e1 = %s*e2\n  I b : p = f\n  I c : p = f\n  s -> j -> t -> b\n  j -> c\n  output y = b.f\n}\n"

    def test_always_zero(self) -> None:
        with pytest.raises(
            RunFailed, match=r"rate of `b.p`.*computed at `t` \(line 6\), is divided by a factor of its law"
        ):
            bondgraph.load(self.TEXT % "w").simulate(to=1.0)

    def test_what_modulates_it(self) -> None:
        text = (self.TEXT % "sin(b.p)").replace("TF t", "MTF t")
        with pytest.raises(RunFailed, match=r"computed at `t` \(line 6\), is divided by what is zero with `b.p` = 0"):
            bondgraph.load(text).simulate(to=1.0)

    def test_another_ratio(self) -> None:
        """e1 = 2 e2: the second mass, seen from the first, weighs 4; f_b = 2 f_c."""
        run = bondgraph.load(self.TEXT % "w").simulate(settings={"w": 2.0}, to=1.0, points=2)
        assert run.final("y") == pytest.approx(2 / 5, rel=1e-9)


@pytest.mark.parametrize(
    ("law", "asked"),
    [
        ("sqrt(0.7 - time)", r"the square root of -"),
        ("log(0.7 - time)", r"the logarithm of "),
        ("asin(0.3 + time)", r"asin of 1"),
        ("(0.7 - time)^1.5", r"-.* to the power of 1\.5"),
    ],
)
def test_what_has_no_value_just_after_an_instant_is_told_there(law: str, asked: str) -> None:
    """The root of a signal that becomes negative is still defined at its zero, but not after any step beyond."""
    text = f"plain model M {{\n  signal x = integral({law} - 0.01*x^3, 0)\n  output y = x\n}}\n"
    with pytest.raises(RunFailed, match=rf"(at|from) t = 0\.7\d* s.*`x`.*has no value there: {asked}"):
        bondgraph.load(text).simulate(to=1.0, points=3)


FIELD = """model A {
  parameter k = 1, L: mH = 10, a: uF = 2
  constant M = k*L, D = L^2 - M^2
  Se s : u = 1 V
  R r1, r2 : u = 1 ohm*i
  LAW
  1 second : electric
  s -> 1(r1, field.x)
  second -> r2, field.y
  output i = r1.i
}"""


def test_a_storage_with_a_singular_matrix_is_named_with_what_to_write() -> None:
    """Coils with all flux in common."""
    law = "I field(x: electric, y: electric) : energy = (L*x^2 - 2*M*x*y + L*y^2)/(2*D)"
    with pytest.raises(bondgraph.RunFailed) as told:
        bondgraph.load(FIELD.replace("LAW", law)).simulate(to=1.0, target="numpy")
    assert "the matrix of `field` (line 6) is singular with `D` = 0: some combination" in str(told.value)
    assert "a `TF` and one `I`" in str(told.value)


COILS = "I field(x: electric, y: electric) : x.lambda = L*x.i + M*y.i, y.lambda = M*x.i + L*y.i"
PLATES = "C field(x: electric, y: electric) : x.q = a*x.u - a*y.u, y.q = {}*a*y.u - a*x.u"


@pytest.mark.parametrize(
    ("law", "near"),
    [
        (COILS, 1.0),
        (COILS, 1 - 1e-14),
        (COILS, 1 - 1e-11),
        (PLATES.format("1"), 1.0),
        (PLATES.format("1.00000000000001"), 1.0),
        (PLATES.format("k"), 1 + 2e-16),
    ],
)
def test_a_storage_whose_matrix_is_singular_but_for_rounding_is_refused(law: str, near: float) -> None:
    """Coils with all flux in common but for the last digits; two plates. Solved, the digits left would be noise: 0.9556 for 0.9732."""
    with pytest.raises(bondgraph.CompilationFailed, match=r"singular but for rounding.* a `TF` and one `I`"):
        bondgraph.load(FIELD.replace("LAW", law).replace("k = 1,", f"k = {near!r},")).simulate(to=1.0, points=2)


def test_coils_that_share_nearly_all_flux_are_solved() -> None:
    """As leakage of a ten-millionth; and coils whose currents are given need no solution."""
    regular = bondgraph.load(FIELD.replace("LAW", COILS).replace("k = 1,", "k = 0.9999999,"))
    assert regular.simulate(to=1e-3, points=2)["i"][-1] > 0.0
    given = FIELD.replace("LAW", COILS).replace("r1, r2 : u", "r2 : u").replace("Se s : u = 1 V", "Sf s : i = 1 A")
    given = (
        given.replace("1(r1, field.x)", "field.x")
        .replace("r1.i", "s.u")
        .replace("R r2 : u = 1 ohm*i", "Sf r2 : i = 2 A")
    )
    bondgraph.load(given.replace("second -> r2, field.y", "r2 -> second -> field.y")).simulate(to=1.0, points=2)


def test_a_storage_that_a_state_lets_divide_by_zero_has_no_singular_matrix() -> None:
    """A plate that touches: 1/x of a displacement."""
    with pytest.raises(bondgraph.RunFailed) as told:
        bondgraph.load("""model A {
  Se s : u = 1 V
  R r : u = 1 ohm*i
  C field(x: electric, y: electric) : energy = x^2/(2*y*(1 F/1 C))
  s -> 1(r, field.x)
  R r2 : u = 1 ohm*i
  1 second : electric
  second -> r2, field.y
  output i = r.i
}""").simulate(to=1.0, target="numpy")
    assert "is divided by what is zero with `field.y` = 0" in str(told.value) and "matrix" not in str(told.value)
