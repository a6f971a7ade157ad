"""A value that is not finite is found where it occurs, in both back-ends: instant, element, operation, values; earlier results are kept."""

from __future__ import annotations

import re

import numpy as np
import pytest

import bondgraph
from bondgraph import CompilationFailed, RunFailed, UsageError
from bondgraph.results.result import Result

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]


def failed(text: str, target: str, to: float = 3, **given: str) -> tuple[str, Result]:
    """Message of the failure, and the result kept."""
    with pytest.raises(RunFailed) as found:
        bondgraph.load(text).simulate(to=to, points=31, target=target, settings=given or None)
    assert found.value.result is not None
    return str(found.value), found.value.result


def told_time(words: str) -> float:
    found = re.search(r"t = ([0-9.e+-]+) s", words)
    assert found is not None, words
    return float(found.group(1))


# law of the rate of z, what drives it, when it ends, what is said
DRIVEN = "plain model M {\n  signal x = integral(%s, %s)\n  signal z = integral(%s, 0)\n  output y = x, w = z\n}\n"
ENDS = {
    "square root of a negative": ("-1", "1", "sqrt(x) - z^2", 1.0, r"`rate of z`, computed at `z` \(line 3\), has no value there: the square root of -.* with `x` = -"),
    "logarithm": ("-1", "1", "x^2*log(x) - z^3", 1.0, r"the logarithm of (-|0).*with `x` = "),
    "power": ("-1", "1", "x^2.5 - z^3", 1.0, r"computed at `z` \(line 3\).* to the power of 2.5|the square root of -"),
    "arc sine": ("1", "0", "asin(x) - z^3", 1.0, r"asin of 1.* with `x` = 1"),
    "division by zero": ("-1", "1", "1/x - 0*z^3", 1.0, r"is divided by what passes zero there with `x` = "),
    "overflow": ("1", "0", "log(exp(800*x)) - 0*z^3", 0.88722, r"exp of 7\d\d.* is too large for a double with `x` = 0.88"),
    "of time": ("1", "0", "sqrt(2 - time) - z^3", 2.0, r"the square root of -.* with `time` = 2"),
}  # fmt: skip


@pytest.mark.few(5)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("what", ENDS)
def test_a_rate_that_ends(what: str, target: str) -> None:
    slope, start, law, time, words = ENDS[what]
    said, result = failed(DRIVEN % (slope, start, law), target)
    assert re.search(words, said), said
    assert told_time(said) == pytest.approx(time, abs=2e-3)
    shown = result.time <= time
    np.testing.assert_allclose(result["y"][shown], float(start) + float(slope) * result.time[shown], atol=1e-9)
    assert 0.85 * time < result.time[-1] <= time + 0.02


@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("law", "time"), [("1/(time - 0.3)", 0.3), ("1/(1 - 1.0123*time)", 1 / 1.0123), ("-1/(2.7 - time)^3", 2.7), ("exp(-time)/(time - 1e-3)", 1e-3)]
)  # fmt: skip
@pytest.mark.parametrize("rate", ["{}", "{} - z^3", "sin(z) + {}"])
def test_a_pole_in_time(law: str, time: float, rate: str) -> None:
    """Next to it the rounding of time hides the law: millions of steps of some last places tried to follow that."""
    said, result = failed(
        "plain model M {\n  signal z = integral(%s, 0)\n  output w = z\n}\n" % rate.format(law), "native"
    )
    assert told_time(said) == pytest.approx(time, rel=1e-6)
    assert result.steps < 100_000


@pytest.mark.parametrize("target", TARGETS)
def test_a_branch_that_is_not_taken_has_no_fault(target: str) -> None:
    text = "plain model M {\n  signal x = integral(-1, 1)\n  signal z = integral((sqrt(x) if x > 0 else 0) - 0*z^3, 0)\n  output w = z\n}\n"
    assert bondgraph.load(text).simulate(to=3, points=4, target=target).final("w") == pytest.approx(2 / 3, rel=1e-5)


@pytest.mark.parametrize("target", TARGETS)
def test_a_mode_is_known_to_the_message(target: str) -> None:
    text = "plain model M {\n  mode k = 1\n  signal x = integral(1, 0)\n  signal z = integral(sqrt(k - x) - z^3, 0)\n  when x > 0.5 { k = 0.75 }\n  output w = z\n}\n"
    said, _ = failed(text, target)
    assert told_time(said) == pytest.approx(0.75, abs=1e-6)
    assert "the square root of -" in said and "`k` = 0.75" in said


LOOP = "model A {\n  input r = 2 ohm\n  Se s : u = 6 V\n  1 a\n  MR q : u = r*i\n  R t : u = 3 ohm*i\n  C c : q = 1 [F]*u + 0.1 [F/V^2]*u^3\n  s -> a -> q, t, c\n  output i = a.i\n}\n"


@pytest.mark.parametrize("target", TARGETS)
def test_a_loop_that_loses_its_solution(target: str) -> None:
    """-5 ohm + t towards -3 ohm, beside 3 ohm: at 2 s no current is the current."""
    said, result = failed(LOOP, target, r="-5 ohm + 1 ohm*time/1 s")
    assert (
        "the algebraic loop through `q`, `t`, `a` has no unique solution" in said
        or "divided by what passes zero" in said
    ), said
    assert told_time(said) == pytest.approx(2, abs=1e-3)
    assert len(result.time) >= 19


@pytest.mark.parametrize("target", TARGETS)
def test_a_mass_matrix_that_is_singular(target: str) -> None:
    text = "model A {\n multibody s : planar {\n body a { mass = 1 kg, inertia = 0 [kg*m^2] }\n hinge h : ground to a { at = (0, 0) }\n }\n Se m : M = 1 [N*m]\n m -> s.h\n output phi = s.h.phi\n}\n"
    with pytest.raises(CompilationFailed, match=r"BG202: Nothing with inertia moves along `h.phi`"):
        bondgraph.load(text).simulate(to=1, target=target)


@pytest.mark.parametrize("target", TARGETS)
def test_a_parameter_that_makes_the_mass_matrix_singular(target: str) -> None:
    text = "model A {\n parameter J = 1 [kg*m^2]\n multibody s : planar {\n body a { mass = 1 kg, inertia = J }\n hinge h : ground to a { at = (0, 0) }\n }\n Se m : M = 1 [N*m]\n m -> s.h\n output phi = s.h.phi\n}\n"
    assert bondgraph.load(text).simulate(to=1, target=target).final("phi") == pytest.approx(0.5, rel=1e-9)
    with pytest.raises((RunFailed, CompilationFailed), match=r"not finite|Nothing with inertia|not positive"):
        bondgraph.load(text).simulate(to=1, target=target, settings={"J": 0.0})


@pytest.mark.parametrize("target", TARGETS)
def test_steps_that_collapse_say_which_state_grows(target: str) -> None:
    said, result = failed("plain model B {\n  signal x = integral(x^2, 1)\n  output y = x\n}\n", target)
    assert re.search(r"its step fell below round-off; `x` \(now .*\) changes fastest.*grows without bound", said), said
    assert told_time(said) == pytest.approx(1, abs=0.1) and len(result.time) > 8


@pytest.mark.parametrize("target", TARGETS)
def test_an_output_that_nobody_asks_for_stops_nothing(target: str) -> None:
    text = "plain model M {\n  signal x = integral(-x^3, 1)\n  output bad = sqrt(x - 0.5)\n  output good = x\n}\n"
    model = bondgraph.load(text)
    found = model.simulate(to=3, points=4, target=target, outputs=("good",))
    np.testing.assert_allclose(found["good"], 1 / np.sqrt(1 + 2 * found.time), rtol=1e-4)
    with pytest.raises(
        RunFailed,
        match=r"`bad` is not finite: `bad`, computed at `bad` \(line 3\), has no value there: the square root of -0\.",
    ) as failure:
        model.simulate(to=3, points=4, target=target)
    assert failure.value.result is not None and len(failure.value.result.time) == 2


def test_a_path_is_no_model() -> None:
    with pytest.raises(UsageError, match=r"bondgraph\.load") as refused:
        bondgraph.Model("models/oscillator.bg")  # type: ignore[arg-type]
    assert refused.value.code == "BR616"


class TestMostParts:
    """`BONDGRAPH_PARTS`, of a row of three signals in a loop, each with its round, and of their output: 7 parts."""

    ROW = "model A {\n  for k in 1..3 { signal s[k] = k }\n  output y = s[3]\n}\n"

    def test_is_the_limit(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("BONDGRAPH_PARTS", "6")
        (found,) = bondgraph.check(self.ROW)
        assert found.code == "BG160"
        with pytest.raises(CompilationFailed, match="BG160"):
            _ = bondgraph.load(self.ROW).outputs
        advised = re.search(r"BONDGRAPH_PARTS=(\d+) in the environment", found.help)
        assert advised is not None
        for enough in ("7", advised[1], ""):
            monkeypatch.setenv("BONDGRAPH_PARTS", enough)
            assert bondgraph.check(self.ROW) == ()
            assert bondgraph.load(self.ROW).outputs == ("y",)

    @pytest.mark.parametrize("given", ["many", "-1", "0", "1e6", "1.5", " ", "9" * 5000])
    def test_is_a_whole_number(self, given: str, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("BONDGRAPH_PARTS", given)
        for call in (bondgraph.check, lambda text: bondgraph.load(text).outputs):
            with pytest.raises(UsageError, match="whole number") as refused:
                call(self.ROW)
            assert refused.value.code == "BR650"
            assert len(str(refused.value)) < 200
