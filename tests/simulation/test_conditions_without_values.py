"""Conditions whose sides have no value, or an infinite one: refused or told where something reads them, and only there."""

from __future__ import annotations

import pytest

import bondgraph
from bondgraph.errors import RunFailed

TOLD = """plain model Told {
  parameter k = 0.7, d = 2
  signal x = integral(1, 0), fixed = 1 if 1/(k - 0.7)^2 < 3 and d > 1 else 0
  mode n1 = 0, n2 = 0, n3 = 0, n4 = 0, n5 = 0, m = 0, s = 0
  when 1/(k - 0.7) > 0 { n1 = n1 + 1 }
  when 1/(m - 0.5) > 7 { n2 = n2 + 1 }
  when exp(1000*x) > 5 { n3 = n3 + 1 }
  when x < 0.6 and log(0.7 - x) > -5 { n4 = n4 + 1 }
  when 5/d > 3 or x/(d + 1) > 7 { n5 = n5 + 1 }
  every 0.25 { m = m + 0.25; s = (1 if log(0.55 - x) > -5 else 0) }
  output count = n1 + n2 + n3 + n4 + n5, sampled = s, first = fixed, late = 1 if sqrt(0.81 - x) > 0.1 else 0, guarded = 1 if x < 0.8 and sqrt(0.81 - x) > 0.1 else 0
}"""


@pytest.fixture(scope="module")
def model() -> bondgraph.Model:
    return bondgraph.load(TOLD)


@pytest.mark.parametrize("solver", ["automatic", "rodas", "explicit"])
def test_what_is_evaluated_where_it_stands_is_told(model: bondgraph.Model, solver: str) -> None:
    """1/0 counted as true, and what a logarithm of -0.3 is compared with as false."""
    told = {w.condition: w.time for w in model.simulate(to=1, points=5, solver=solver).warnings}
    assert told == pytest.approx(
        {"when 1/(k - 0.7) > 0": 0, "fixed": 0, "when 1/(m - 0.5) > 7": 0.25, "new s": 0.55, "late": 0.81}, abs=1e-9
    )
    one = {w.condition for w in model.simulate(to=0.2, points=2, solver=solver, settings={"k": 0.8}).warnings}
    assert not one


@pytest.mark.parametrize("solver", ["automatic", "rodas"])
@pytest.mark.parametrize("side", ["log(0.7 - x) > -5", "sqrt(0.7 - x) < 2", "2 > (0.7 - x)^0.3", "asin(x + 0.3) < 1.8"])
def test_a_crossing_into_what_has_no_value_is_refused(side: str, solver: str) -> None:
    text = f"plain model Out {{\n  mode n = 0\n  signal x = integral(y, 0), y = integral(-0.1*x, 1)\n  when {side} {{ n = n + 1 }}\n  output count = n, at = x\n}}"
    for guard in ("", "x < 0.6 and "):
        guarded = bondgraph.load(text.replace("when ", f"when {guard}"))
        if guard:
            assert guarded.simulate(to=1, points=3, solver=solver).final("count") == 1
            continue
        with pytest.raises(RunFailed, match="no value") as refused:
            guarded.simulate(to=1, points=3, solver=solver)
        assert "made" not in str(refused.value) and "line 4" in str(refused.value)


@pytest.mark.parametrize(
    ("side", "since"),
    [
        ("log(1 - {u}) > -1", 1),
        ("sqrt(1.5 - {u}) < 2", 1.5),
        ("2 > (1 - {u})^0.3", 1),
        ("(1.2 - {u})^k < 2", 1.2),
        ("not (asin({u}) < 1.8)", 1),
        ("acos({u} - 0.4) > 1", 1.4),
        ("2 > acosh(1.5 - {u})", 0.5),
        ("{u} > 3 or atanh({u} - 0.2) < 9", 1.2),
        ("log10(0.7 - {u}) == -1", 0.7),
    ],
)
def test_a_condition_on_time_that_has_no_value_is_told(side: str, since: float) -> None:  # fmt: skip
    """What a logarithm of -0.5 is compared with counted as false: in time without a word, and beside a state for powers and inverse functions."""
    time, state = (side.format(u=u) for u in ("time", "x"))
    text = f"""plain model Late {{
  parameter k = 0.4
  signal x = integral(1, 0), grown = integral(2 if {time} else 1, 0), unread = 1 if {time} else 0
  mode n = 0, m = 0
  when time < 0.4 and ({time}) {{ n = n + 1 }}
  when {time} {{ m = m + 1 }}
  output late = 1 if {time} else 0, far = 1 if {state} else 0, rate = grown, count = n + m
}}"""
    told = {w.condition: w.time for w in bondgraph.load(text).simulate(to=2, points=3).warnings}
    assert told == pytest.approx(dict.fromkeys(("late", "far", "rate of grown", f"when {time}"), since), abs=1e-9)
    assert not bondgraph.load(text).simulate(to=0.45, points=3).warnings


def test_an_infinite_side_of_one_sign_and_poles_in_time_are_conditions_as_any() -> None:
    text = (
        "plain model Sure {\n  output y = 1 if log(time) > -1 or 1/(time - 0.5) > 4 or acos(cos(time)) < 0.1 else 0\n}"
    )
    found = bondgraph.load(text).simulate(to=1, points=11)
    assert not found.warnings and found["y"].tolist() == [1, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1]
