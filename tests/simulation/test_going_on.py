"""A run in two parts gives the same as in one; results before an unintended end are kept."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph import RunFailed, RunInterrupted, UsageError, read_result
from bondgraph.errors import RunBroken
from bondgraph.results.result import Result
from tests.event_models import servo
from tests.simulation.test_events import BALL

RTOL = 1e-8
SAMPLED = servo("")
DELAYED = """
model Delayed {
  signal x = integral(-1 [1/s]*delay(x, 0.37 s) + (0.5 [1/s] if time > 1.3 s else 0 [1/s]), 1)
  output y = x
}
"""
HARDENING = """
model Hardening {
  parameter k = 100 [N/m], m = 1 kg
  input push = 1 N
  MSe pull  : F = push
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x + 2e5 [N/m^3]*x^3
  R  damper : F = 0.5 [N*s/m]*v
  pull -> body -> mass, spring, damper
  output x = spring.x, v = mass.v
  experiment go { simulate 0 .. 5 s }
  experiment other { simulate 0 .. 5 s }
}
"""
DIODE = """
model Rectifier {
  "With an unknown of a loop, which a restart has to find again."
  Se supply : u = 5 V*sin(2*pi*50 Hz*time)
  R  lead   : u = 10 ohm*i
  R  diode  : i = 1 [uA]*(exp(u/50 [mV]) - 1)
  C  store  : u = q/100 [uF]
  R  load   : u = 1 kohm*i
  supply -> 1(lead, diode) -> 0(store, load)
  output u = store.u
}
"""


def whole_and_parts(text: str, to: float, cut: float, way: Path, **given: Any) -> tuple[Result, Result]:
    """A run in one, and in two parts with a file between."""
    model = bondgraph.load(text)
    whole = model.simulate(to=to, points=241, rtol=RTOL, **given)
    model.simulate(to=cut, points=11, rtol=RTOL, **given).to_npz(way / "part.npz")
    return whole, bondgraph.load(text).simulate(to=to, points=241, rtol=RTOL, start=way / "part.npz", **given)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("text", "to", "cut", "scale"),
    [
        (BALL, 6, 1.0, 1), (BALL, 6, 5.0, 1), (DELAYED, 4, 0.2, 1), (DELAYED, 4, 2.5, 1), (SAMPLED, 0.4, 0.1, 5), (SAMPLED, 0.4, 0.123, 5),
        (HARDENING, 5, 1.7, 0.02), (DIODE, 0.06, 0.013, 5),
    ],
)  # fmt: skip
def test_two_parts_are_one_run(text: str, to: float, cut: float, scale: float, tmp_path: Path) -> None:
    """To a hundred times the tolerance: the solver starts once more, with steps of other sizes."""
    whole, parts = whole_and_parts(text, to, cut, tmp_path)
    assert parts.time[-1] == to and (np.diff(parts.time) > 0).all()
    place = np.isin(whole.time, parts.time)
    name = whole.names[0]
    np.testing.assert_allclose(
        parts[name][np.isin(parts.time, whole.time)], whole[name][place], rtol=0, atol=100 * RTOL * scale
    )
    assert [e.condition for e in parts.events] == [e.condition for e in whole.events]
    np.testing.assert_allclose([e.time for e in parts.events], [e.time for e in whole.events], rtol=1e-7)


def test_the_balance_of_two_parts_is_that_of_the_whole(tmp_path: Path) -> None:
    whole, parts = whole_and_parts(HARDENING, 5, 1.7, tmp_path, energy=True)
    assert whole.energy is not None and parts.energy is not None
    for word in ("stored", "supplied", "dissipated"):
        assert getattr(parts.energy, word) == pytest.approx(getattr(whole.energy, word), rel=1e-6)
    assert abs(parts.energy.residual) < 1e-7 * parts.energy.supplied


def test_three_parts_and_a_file_of_them(tmp_path: Path) -> None:
    """The result of a continued run is as complete as that of a first run, and reads back unchanged."""
    model = bondgraph.load(HARDENING)
    result = model.simulate(to=1, points=11)
    for end in (2, 5):
        result = model.simulate(to=end, points=10 * end + 1, start=result)
    np.testing.assert_allclose(result.time, np.linspace(0, 5, 51), atol=1e-12)
    result.to_npz(tmp_path / "r.npz")
    again = read_result(tmp_path / "r.npz")
    np.testing.assert_array_equal(again.values, result.values)
    assert (again.names, again.steps, again.notes, again.model) == (
        result.names,
        result.steps,
        result.notes,
        "Hardening",
    )
    assert again.unit("v") == "m/s"


class TestRefused:
    """A result of something else, in words."""

    @staticmethod
    def refused(words: str, text: str = HARDENING, experiment: str | None = "", **given: Any) -> None:
        before = bondgraph.load(HARDENING).simulate(to=1, points=3)
        with pytest.raises(UsageError, match=words):
            bondgraph.load(text).simulate(experiment, start=before, **{"to": 2} | given)

    def test_another_model(self) -> None:
        self.refused(
            "is of the model `Hardening`, not of `Softening`", HARDENING.replace("model Hardening", "model Softening")
        )

    def test_other_parameters(self) -> None:
        self.refused("`k` was 100 and is 120 ", settings={"k": "120 [N/m]"})

    def test_another_law(self) -> None:
        self.refused("of other equations than `Hardening` has now", HARDENING.replace("2e5", "3e5"))

    def test_another_input(self) -> None:
        self.refused("the settings of its inputs", settings={"push": "2 N*sin(time/1 s)"})

    def test_another_experiment(self) -> None:
        self.refused("is of `go`, this run of `other`: name the same with -e", experiment="other")

    def test_other_outputs(self) -> None:
        self.refused("has the outputs x, v, this run x", outputs=("x",))

    def test_no_balance(self) -> None:
        self.refused("has no energy balance", energy=True)

    def test_nothing_left(self) -> None:
        self.refused("ends at t = 1 s already", to=0.5)

    def test_comments_and_order_are_no_difference(self) -> None:
        lines = HARDENING.splitlines()
        lines[6], lines[8] = lines[8], lines[6]
        before = bondgraph.load(HARDENING).simulate(to=1, points=3)
        assert bondgraph.load("# again\n" + "\n".join(lines)).simulate(to=2, points=5, start=before).time[-1] == 2

    @pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x05\x06" + 18 * b"\0"])
    def test_no_result(self, content: bytes, tmp_path: Path) -> None:
        (tmp_path / "r.npz").write_bytes(content)
        with pytest.raises(UsageError, match=r"is no result of a run, as `--out R.npz` writes it"):
            bondgraph.load(HARDENING).simulate(start=tmp_path / "r.npz")


# ---------------------------------------------------------------------- ends that nobody wanted

EXPLODES = "plain model Burst {\n  signal x = integral(x^2, 1)\n  output y = x\n}\n"


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_a_run_that_fails_keeps_what_came_before(target: str) -> None:
    """x' = x^2 from 1 is 1/(1 - t), which ends at t = 1."""
    with pytest.raises(RunFailed) as failed:
        bondgraph.load(EXPLODES).simulate(to=2, points=201, atol=1e-9, target=target)
    result = failed.value.result
    assert result is not None and 99 <= len(result.time) <= 103 and "t = " in result.stopped
    shown = result.time < 0.99
    np.testing.assert_allclose(result["y"][shown], 1 / (1 - result.time[shown]), rtol=1e-4)


def test_a_table_that_is_left_keeps_what_came_before() -> None:
    text = "plain model T {\n  signal x = integral(linear(x, (0, 1, 2), (1, 1, 1)), 0)\n  output y = x\n}\n"
    with pytest.raises(RunFailed, match=r"t = 2.* asked at .*2") as failed:
        bondgraph.load(text).simulate(to=4, points=41)
    result = failed.value.result
    assert result is not None and result.time[-1] >= 1  # the last of a few long steps that ends within the table
    np.testing.assert_allclose(result["y"], result.time, rtol=1e-9)


def test_an_output_that_fails_keeps_the_rows_before() -> None:
    text = "plain model L {\n  signal x = integral(-1, 1)\n  output y = sqrt(x)\n}\n"
    with pytest.raises(RunFailed, match=r"at t = 1\.\d* s `y` is not finite") as failed:
        bondgraph.load(text).simulate(to=2, points=21)
    result = failed.value.result
    assert result is not None
    np.testing.assert_allclose(result["y"], np.sqrt(1 - result.time), atol=1e-7)


def test_what_breaks_in_the_middle_keeps_what_came_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception out of nowhere, in the ninth step."""
    from bondgraph.simulation.integrators.compiled.run import CompiledMethod

    steps = iter(range(100))
    step = CompiledMethod.advance

    def breaking(*given: Any) -> int:
        if next(steps) == 8:
            raise ZeroDivisionError("a law of our own making")
        return step(*given)

    monkeypatch.setattr(CompiledMethod, "advance", breaking)
    with pytest.raises(RunBroken, match=r"ZeroDivisionError: a law of our own making, after t = ") as broken:
        bondgraph.load(HARDENING).simulate(to=5, points=5001, target="numpy")
    result = broken.value.result
    assert result is not None and result.checkpoint is not None and 1 < len(result.time) < 5000
    assert 0 <= result.checkpoint.time - result.time[-1] < 1.1e-3
    monkeypatch.setattr(CompiledMethod, "advance", step)
    assert bondgraph.load(HARDENING).simulate(to=5, points=51, target="numpy", start=result).time[-1] == 5


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_an_interrupted_run_goes_on(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C as it comes in a run of hours: after so many steps of Python, or so many calls of machine code."""
    from bondgraph.simulation.integrators.compiled.run import CompiledMethod

    step, left = CompiledMethod.advance, iter(range(10**9))

    def interrupted(*given: Any) -> Any:
        if next(left) == (200 if target == "numpy" else 4):
            signal.raise_signal(signal.SIGINT)
        return step(*given)

    text = HARDENING.replace("R  damper : F = 0.5", "R  damper : F = 0.0").replace("0 .. 5 s", "0 .. 1e6 s")
    model = bondgraph.load(text)
    monkeypatch.setattr(CompiledMethod, "advance", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores it
    try:
        with pytest.raises(RunInterrupted) as stopped:
            model.simulate(to=2e5, points=500_001, rtol=1e-7, target=target)
    finally:
        signal.signal(signal.SIGINT, before)
    monkeypatch.undo()
    result = stopped.value.result
    assert result.stopped == "it was interrupted" and result.checkpoint is not None
    assert len(result.time) and result.time[-1] <= result.checkpoint.time
    energy = 0.5 * result["v"] ** 2 + 50 * result["x"] ** 2 + 5e4 * result["x"] ** 4 - result["x"]
    start = result.time < 1
    np.testing.assert_allclose(energy[start], 0, atol=1e-8)  # no loss: what the force gives is stored
    step = result.checkpoint.time + 0.4
    parts = model.simulate(to=step, points=int(step / 0.4) + 1, rtol=1e-7, start=result, target=target)
    assert parts.time[-1] == step and len(parts.time) > len(result.time)
    assert (
        abs(0.5 * parts.final("v") ** 2 + 50 * parts.final("x") ** 2 + 5e4 * parts.final("x") ** 4 - parts.final("x"))
        < 1e-3
    )
