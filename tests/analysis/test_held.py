"""Analyses of one instant of a model that time moves: a note says what is held, and is absent where nothing would be another."""

from __future__ import annotations

import pytest

import bondgraph

COIL = "model M {{ I l : lambda = 1 mH*i\n R r : u = 1 ohm*i{more}\n Se s : u = {source}\n s -> 1(l) -> r\n output i = l.i }}"
CHOPPER = "model M { I l : lambda = 1 mH*i\n R r : u = 1 ohm*i\n Se s : u = 2 V\n MTF t : u2 = pwm(time, 1 ms, 0.5)*u1\n s -> t -> 1(l) -> r\n output i = l.i }"


@pytest.mark.parametrize(
    ("source", "current", "noted"),
    [
        ("2 V", 2.0, False), ("2 V*sin(1 + 10 [1/s]*time)", 1.682941969615793, True), ("2 V*pwm(time, 1 ms, 0.5)", 2.0, True),
        ("2 V*step(time - 1 s)", 0.0, True), ("1 [V/s]*time", 0.0, True), ("2 V*exp(-time/1 s)", 2.0, True),
    ],
)  # fmt: skip
def test_a_rest_under_a_source_of_time_says_what_is_held(source: str, current: float, noted: bool) -> None:
    """The current u(0)/R, with the instant in the note; the linear model of a constant coil is the same at every instant and has none."""
    model = bondgraph.load(COIL.format(source=source, more=""))
    found = model.equilibrium()
    assert found["i"] == pytest.approx(current, rel=1e-12)
    assert (
        ("kept its values of t = 0 s" in found.note)
        is ("note" in found.to_json())
        is ("note: time" in found.summary())
        is noted
    )
    assert model.linearize(outputs=("i",)).note == "" == model.modes().note


def test_slopes_that_time_moves() -> None:
    """A law that bends rests elsewhere at another instant, and a switch in the path has another slope: linear models and modes say so."""
    bent = bondgraph.load(COIL.format(source="2 V*pwm(time, 1 ms, 0.5)", more=" + 0.1 [V/A^3]*i^3"))
    switched = bondgraph.load(CHOPPER)
    for model in (bent, switched):
        assert "time moves" in model.equilibrium().note
    for found in (bent.linearize(outputs=("i",)), bent.modes()):
        assert "slopes are those of t = 0 s" in found.note
    assert "time moves" not in switched.modes().note  # the coil and its resistor are behind the switch


def test_a_branch_does_not_pass_teeth() -> None:
    """With F = x + mod(x, 1)/2 the rest at F = 1.8 is on the second tooth, x = (F + 1/2)/1.5; a branch would stay on the first, and is refused."""
    text = "model T { parameter F = 0.5\n signal x = integral((F - x - 0.5*mod(x, 1))/1 s, 0)\n output y = x }"
    model = bondgraph.load(text)
    with pytest.raises(bondgraph.errors.UsageError, match="cannot pass the jumps of a law"):
        model.continuation("F", 0.1, 5)
