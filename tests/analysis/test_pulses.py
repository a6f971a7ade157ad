"""Pulses of time in analyses at one instant: what moves their instants has no slope there, and a branch has the values that hold at each of its points."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError

CHOPPER = """model Chopper {{
  input duty = 0.4
  parameter T = 1 ms, D = 0.3
  MSe s : u = 10 V*{source}
  I l : lambda = 0.01 H*i
  R r : u = 2 ohm*i
  s -> 1(l, r)
  output i = l.i, gate = {gate}
}}"""


def chopper(source: str, gate: str = "0") -> bondgraph.Model:
    return bondgraph.load(CHOPPER.format(source=source, gate=gate))


@pytest.mark.parametrize(
    ("source", "gate"),
    [
        ("pwm(time, T, duty)", "0"), ("(1 if mod(time, T) < duty*T else 0)", "0"), ("stairs(duty + time/1 s, 0.1)", "0"), ("(1 - 0.01*l.i/1 A)", "pwm(time, T, duty)"),
    ],
)  # fmt: skip
def test_a_duty_has_no_slope_at_one_instant(source: str, gate: str) -> None:
    model = chopper(source, gate)
    with pytest.raises(UsageError, match="`duty` moves the instants"):
        model.linearize(inputs=("duty",))
    with pytest.raises(UsageError, match="`duty` moves the instants"):
        model.response("duty", "i" if gate == "0" else "gate", 1, 100, points=3)


def test_a_state_that_is_compared_with_pulses_has_no_modes() -> None:
    with pytest.raises(UsageError, match=r"`l\.lambda` moves the instants"):
        chopper("pwm(time, T, 0.5 + 0.01*l.i/1 A)").modes()


def test_what_moves_no_instant_is_analysed_as_ever() -> None:
    """The mean, as the advice says; pulses beside it; an input that is rounded at one instant."""
    for source in ("duty", "(duty + 0*pwm(time, T, D))", "(duty + stairs(D, 0.1))"):
        model = chopper(source, "pwm(time, T, D)")
        linear = model.linearize(inputs=("duty",))
        np.testing.assert_allclose([*linear.A[0], *linear.B[0]], [-200, 10])
        assert model.modes()[0].eigenvalue == pytest.approx(-200)


def test_a_run_has_slopes_of_its_pulses() -> None:
    """The mean of whole periods is D, so that an integral over 10 ms has the slope 10 ms."""
    model = bondgraph.load(
        "model Mean { parameter D = 0.3\n signal x = integral(pwm(time, 1 ms, D), 0 s)\n output y = x\n"
        " experiment e { simulate 0 .. 10 ms; sensitivity D } }"
    )
    found = dict(model.run("e").points[0].analyses)
    assert next(iter(found.values())).of("y", "D")[-1] == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize("signal", ["pwm(time + 0.55 s, 1 s, u)", "step(u*1 s - 0.55 s - time)", "stairs(u, 0.1)"])
def test_a_branch_has_the_values_of_each_point(signal: str) -> None:
    model = bondgraph.load(
        f"model Along {{ input u = 0.2\n signal x = integral(({signal} - x)/1 s, 0)\n output y = x }}"
    )
    branch = model.continuation("u", 0, 1)
    expected = np.floor(np.array(branch.values) / 0.1) * 0.1 if "stairs" in signal else np.array(branch.values) > 0.55
    np.testing.assert_allclose(branch.outputs["y"], expected, atol=1e-9)
    assert set(np.round(branch.outputs["y"])) == {0, 1}


def test_samples_that_are_late_are_named_as_the_author_does() -> None:
    """The message of a rest that is not found, and the verdict of one."""
    text = "model Late {{ mode y = 0\n signal x = integral({rate}, 0)\n every 0.1 s delay 0.05 s {{ y = x }}\n output o = y }}"
    with pytest.raises(bondgraph.RunFailed) as caught:
        bondgraph.load(text.format(rate="1 [1/s]")).equilibrium()
    assert "late" not in str(caught.value)
    assert "late by a delay" in bondgraph.load(text.format(rate="-(x + y)/1 s")).equilibrium().summary()
