"""Loops that have strokes, but no solution with the values of the run: reported with the elements, the parameters and their values."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.reduction.slopes import slopes_at_start
from tests.compiling import compiled, mistake, mistakes, refused

RING = "plain model A {\n  parameter n = 2, k = 0.5\n  Se s : e = 1\n  1 a, b\n  R r : e = 3*f\n  R t : e = 2*f\n  TF one : e1 = n*e2\n  TF two : e1 = k*e2\n  s -> a -> r\n  a -> one -> b -> t\n  b -> two -> a\n  output o = r.f\n}\n"
RESISTORS = "plain model A {\n  parameter r = -2\n  Se s : e = 1\n  1 a\n  R x : e = 2*f\n  R y : e = r*f\n  s -> a -> x, y\n  output o = x.f\n}\n"
INERTIAS = "plain model A {\n  parameter m = 3, n = 1\n  Se s : e = 1\n  1 a, b\n  I x : p = 3*f\n  I y : p = -m*f\n  TF lever : f1 = n*f2\n  s -> a -> x, lever\n  lever -> b -> y\n  output o = x.f\n}\n"


@pytest.mark.parametrize(
    ("text", "elements", "values", "cure"),
    [
        (RING, ["one", "two"], ["k = 0.5", "n = 2"], {"n": 3.0}),
        (RESISTORS, ["x", "y"], ["r = -2"], {"r": -3.0}),
        (INERTIAS, ["lever", "y"], ["m = 3"], {"n": 2.0}),
    ],
)
def test_what_cancels_is_told(text: str, elements: list[str], values: list[str], cure: dict[str, float]) -> None:
    found = mistake(text, "BG502")
    assert all(f"`{name}`" in found.sentence for name in [*elements, *values]), found.sentence
    assert found.span.line > 1 and found.help
    assert compiled(text, cure).program.states is not None, "other values have a solution"


def test_products_that_are_one_but_for_rounding() -> None:
    """3 times 1/3, and 0.1 times 10 in seven ratios."""
    third = RING.replace("n = 2, k = 0.5", f"n = 3, k = {1 / 3!r}")
    assert mistake(third, "BG502")
    ratios = [0.1, 0.7, 1.9, 1.3]
    chain = "".join(f"  TF t{i} : e1 = {x!r}*e2\n  1 j{i}\n" for i, x in enumerate(ratios))
    product = 0.1 * 0.7 * 1.9 * 1.3
    text = (
        f"plain model A {{\n  Se s : e = 1\n  1 a\n  R r : e = 3*f\n{chain}  TF back : e1 = {1 / product!r}*e2\n  s -> a -> r\n"
        "  a -> t0 -> j0 -> t1 -> j1 -> t2 -> j2 -> t3 -> j3 -> back -> a\n  output o = r.f\n}\n"
    )
    assert mistake(text, "BG502")
    assert mistakes(text.replace(f"{1 / product!r}", f"{1.001 / product!r}")) == ()


@pytest.mark.parametrize("ratio", [1e-12, 1e-6, 1e6, 1e12])
def test_what_is_only_small_is_no_zero(ratio: float) -> None:
    text = RESISTORS.replace("r = -2", f"r = {2 * ratio!r}")
    result = bondgraph.load(text).simulate(to=1)
    assert result.final("o") == pytest.approx(1 / (2 + 2 * ratio), rel=1e-12)


def test_a_parameter_that_may_change_is_not_held_against_the_author() -> None:
    assert refused(compiled(RESISTORS), "BG502")
    assert compiled(RESISTORS, free=("r",)).program.source
    assert compiled(RESISTORS, free=("*",)).program.source


def test_a_full_matrix_of_rank_one() -> None:
    """Two meshes whose own resistances are taken away by negative ones: only the shared one is left."""
    lines = [
        f"  Se s{i} : e = {i}\n  1 m{i}\n  R own{i} : e = 2*f\n  R less{i} : e = -2*f\n  s{i} -> m{i} -> own{i}, less{i}\n"
        for i in (1, 2)
    ]
    text = f"plain model A {{\n{''.join(lines)}  0 k\n  R shared : e = 5*f\n  m1 -> k -> shared\n  m2 -> k\n  output o = shared.f\n}}\n"
    found = mistakes(text)
    assert [d.code for d in found] == ["BG502"], "the two sources meet without a resistance"
    assert mistakes(text.replace("-2*f", "-1*f")) == ()


MODULATED = "plain model A {\n  parameter n = 2\n  Sf clock : f = 1.87*sin(3.61*time)\n  R load : e = f\n  clock -> load\n  C tank : e = q\n  R leak : e = f\n  1 k\n  k -> tank, leak\n  Se s : e = 1\n  1 a, b\n  R r : e = 3*f\n  R t : e = 2*f\n  s -> a -> r\n  a -> one -> b -> two -> a\n  b -> t\n  output o = r.f\n"


@pytest.mark.parametrize("gain", ["1 + 0.4*sin(time)", "1 + 0.4*sin(clock.f)", "2 + tanh(tank.q)"])
def test_a_gain_that_cancels_at_all_times(gain: str) -> None:
    """There and back by the same ratio, at every moment: nothing determines the circulating variable."""
    ring = MODULATED + "  MTF one : e1 = (GAIN)*e2\n  MTF two : e2 = (OTHER)*e1\n}\n"
    found = mistake(ring.replace("GAIN", gain).replace("OTHER", gain), "BG502")
    assert "`one`, `two`" in found.sentence
    assert mistakes(ring.replace("GAIN", gain).replace("OTHER", gain + " + 0.1")) == ()


def test_a_gain_that_cancels_now_and_then_is_no_mistake_of_the_graph() -> None:
    ring = MODULATED + "  MTF one : e1 = (1 + time)*e2\n  TF two : e2 = 1.5*e1\n}\n"
    assert mistakes(ring) == ()


def test_a_parameter_that_cancels_whatever_its_value() -> None:
    ring = MODULATED + "  TF one : e1 = n*e2\n  TF two : e2 = n*e1\n}\n"
    assert refused(compiled(ring, free=("n",)), "BG502")


def test_slopes_of_a_series_circuit_at_the_start() -> None:
    """q' = 4 p, p' = 1 - 2*4 p - 3 q, by hand."""
    text = "plain model A { Se u : e = 1; R r : e = 2*f; C c : e = 3*q; I m : f = 4*p; 1 j; u -> j; j -> r, c, m; output x = c.q }"
    space = compiled(text).state_space
    names = [space.variables[s.variable].name for s in space.states]
    found = slopes_at_start(space, [s.rate for s in space.states], space.states)
    assert found is not None
    by_name = [{space.variables[v].name: x for v, x in row.items()} for row in found]
    assert dict(zip(names, by_name, strict=True)) == {"c.q": {"m.p": 4.0}, "m.p": {"m.p": -8.0, "c.q": -3.0}}
