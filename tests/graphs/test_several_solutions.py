"""Loops with more than one solution are reported with all of them and with names; loops with one are not."""

from __future__ import annotations

from math import sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bondgraph
from bondgraph.errors import RunFailed

# A tunnel diode: its current rises to 4 A at 1 V, falls to nothing at 3 V, and rises again.
TUNNEL = "R tunnel : i = 9 S*u - 6 [A/V^2]*u^2 + 1 [A/V^3]*u^3"
CIRCUIT = "model A {{\n  Se supply : u = {} V\n  R series : u = 1 ohm*i\n  {}\n  supply -> 1(series) -> 0({})\n  output u = tunnel.u\n}}\n"


def run(text: str, to: float = 1.0) -> float:
    return bondgraph.load(text).simulate(to=to, points=2, rtol=1e-9).final("u")


@pytest.mark.parametrize(("supply", "u"), [(0, 0), (8, 4), (1.5, None), (30, 5.6)])
def test_one_solution(supply: float, u: float | None) -> None:
    """u^3 - 6 u^2 + 10 u = V: for 0 V the others are 3 +- i, for 8 V 1 +- i; in general what the cubic says."""
    found = run(CIRCUIT.format(supply, TUNNEL, "tunnel"))
    assert found**3 - 6 * found**2 + 10 * found == pytest.approx(supply, rel=1e-12, abs=1e-15)
    if u is not None and supply < 10:
        assert found == pytest.approx(u, rel=1e-12, abs=1e-15)


def test_three_solutions() -> None:
    """At 4 V: (u - 2)(u^2 - 4 u + 2) = 0, so u = 2 - sqrt 2, 2, 2 + sqrt 2; `series` has the rest."""
    with pytest.raises(RunFailed) as told:
        run(CIRCUIT.format(4, TUNNEL, "tunnel"))
    said = str(told.value)
    assert "`tunnel`" in said and "`series`" in said and "line 3" in said and "t = 0 s" in said
    values = [2 - sqrt(2), 2.0, 2 + sqrt(2)]  # the same three for either of the two
    assert all(f"{v:.6g} " in said for v in values) and "storage" in said


@pytest.mark.parametrize(
    ("start", "rest"), [(0.5, 2 - sqrt(2)), (1.9, 2 - sqrt(2)), (2.1, 2 + sqrt(2)), (9, 2 + sqrt(2))]
)
def test_a_small_storage_chooses(start: float, rest: float) -> None:
    """A capacitance beside the diode, as the message advises: its start selects the side, and the middle solution is unstable."""
    text = CIRCUIT.format(4, TUNNEL + f"\n  C own : u = q/1 uF {{ start u = {start} V }}", "tunnel, own")
    assert run(text, 1e-3) == pytest.approx(rest, rel=1e-7)


def test_two_solutions_of_a_product() -> None:
    """3 i + 6 i^2 = 12: i = (-3 +- sqrt 297)/12."""
    text = "model A {\n  Se s : u = 12 V\n  1 loop\n  R series : u = 3 ohm*i\n  R odd : u = 6 [V/A^2]*i^2\n  s -> loop -> series, odd\n  output u = loop.i\n}\n"
    with pytest.raises(RunFailed, match="more than one solution") as told:
        run(text)
    currents = [(-3 + sqrt(297)) / 12, (-3 - sqrt(297)) / 12]
    assert all(f"{3 * i:.6g} V" in str(told.value) or f"{i:.6g} A" in str(told.value) for i in currents)


def test_beside_states() -> None:
    """A filter that decides the voltage of the circuit: the loop's branch is as open at the start as without it."""
    text = "model A {\n  Se supply : u = 4 V\n  R lead : u = 1 kohm*i\n  C buffer : u = q/1 F { start u = %s V }\n  R series : u = 1 ohm*i\n  %s\n  supply -> 1(lead) -> 0(buffer, 1(series, tunnel))\n  output u = tunnel.u\n}\n"
    with pytest.raises(RunFailed, match="more than one solution") as told:
        run(text % (4, TUNNEL))
    assert "`tunnel`" in str(told.value) and "`lead`" not in str(told.value)
    assert run(text % (8, TUNNEL), 1e-9) == pytest.approx(4, rel=1e-6)


def test_two_loops_with_three_solutions_each() -> None:
    """The message shows four and says that there is a fifth: each loop has two more than the solution that is known."""
    second = TUNNEL.replace("tunnel", "other")
    text = f"model A {{\n  Se supply : u = 4 V\n  R s1, s2 : u = 1 ohm*i\n  {TUNNEL}\n  {second}\n  supply -> 0(1(s1, tunnel), 1(s2, other))\n  output u = tunnel.u, w = other.u\n}}\n"
    with pytest.raises(RunFailed, match="more than one solution") as told:
        run(text)
    assert "`tunnel`" in str(told.value) and "`other`" in str(told.value) and "; and 1 more" in str(told.value)


def test_a_balanced_bridge_has_one() -> None:
    """Round-off around a current of zero is no second solution."""
    text = "model A {\n  Se s : u = 6 V\n  0 top, a, b : electric\n  R r1 : u = 10 ohm*i\n  R r2 : u = 20 ohm*i\n  R r3 : u = 30 ohm*i\n  R r4 : u = 60 ohm*i\n  R gauge : u = 7 ohm*i + 1 [ohm/A^2]*i^3\n  s -> top\n  top -> 1(r1) -> a -> r2\n  top -> 1(r3) -> b -> r4\n  a -> 1(gauge) -> b\n  output u = gauge.i\n}\n"
    assert run(text) == pytest.approx(0, abs=1e-15)


@settings(max_examples=20)
@given(
    st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(1e-6, 1e6)), min_size=2, max_size=4), st.integers(-1000, 1000)
)
def test_ladders_of_laws_that_only_rise_have_one(values: list[tuple[float, float]], supply: float) -> None:
    """With increasing laws there is one solution (Duffin, Bull. Amer. Math. Soc. 53, 1947), over any number of decades."""
    lines = [f"  Se s : u = {supply!r} V", "  0 k[0] : electric", "  s -> k[0]"]
    for i, (a, b) in enumerate(values, 1):
        lines += [f"  0 k[{i}] : electric", f"  R series[{i}] : u = {a!r} ohm*i + {b!r} [V/A^3]*i^3"]
        lines += [
            f"  R shunt[{i}] : i = {b!r} uA*sinh(u/10 V)",
            f"  k[{i - 1}] -> 1(series[{i}]) -> k[{i}] -> shunt[{i}]",
        ]
    text = "model A {\n" + "\n".join(lines) + f"\n  output u = k[{len(values)}].u\n}}\n"
    try:
        found = run(text)
    except RunFailed as failed:
        assert "more than one" not in str(failed)
    else:
        assert abs(found) <= abs(supply)


@pytest.mark.parametrize("laws", [("e = f*f", "e = 0*f"), ("e = f*abs(f)", "e = f*f*f")], ids=["double", "flat"])
def test_a_solution_where_a_law_is_flat_is_one(laws: tuple[str, str]) -> None:
    """Newton's method comes near such a zero from all sides, and nowhere to it; and a condition on states that would have to
    be another there (the sign in a signed root) makes no second solution."""
    text = f"""plain model A {{
      Se s : e = 0
      1 j
      R a : {laws[0]}
      R b : {laws[1]}
      s -> j -> a, b
      output i = j.f
    }}"""
    assert bondgraph.load(text).simulate(to=1, points=4)["i"] == pytest.approx(0, abs=1e-13)
