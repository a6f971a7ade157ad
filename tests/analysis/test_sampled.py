"""Sampled loops at rest: closed forms, a hand-written recursion, and the run of the same model."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed, UsageError


def loop(gain: float, period: float, tau: float = 1e-3, extra: str = "") -> str:
    """A first-order lag behind a held value that is gain times the error, w - y."""
    return f"""
    model Loop {{
      input w = 1 V
      mode hold = 0 V
      every {period!r} s {{ hold = {gain!r}*(w - c.u) }}
      MSe s : u = hold
      R r : u = {tau * 1e6!r} ohm*i
      C c : u = q/(1 uF)
      s -> 1(r) -> c
      output y = c.u, h = hold
      {extra}
    }}"""


class TestRest:
    @pytest.mark.few(6)
    @pytest.mark.parametrize("gain", [0.5, 2.0, -0.5, 20.0])
    @pytest.mark.parametrize("period", [1e-5, 1e-3, 5e-3])
    def test_a_gain(self, gain: float, period: float) -> None:
        """u = k (w - u): u = k/(1 + k); stable where |a - (1 - a) k| < 1 with a = exp(-T/tau)."""
        found = bondgraph.load(loop(gain, period)).equilibrium()
        a = math.exp(-period / 1e-3)
        z = a - (1 - a) * gain
        assert found["y"] == pytest.approx(gain / (1 + gain), rel=1e-9) and found["h"] == pytest.approx(
            found["y"], rel=1e-9
        )
        assert found.stable is (abs(z) < 1)
        assert found.growth == pytest.approx(math.log(abs(z)) / period, rel=1e-7)

    @pytest.mark.parametrize("k_i", [0.1, 0.5, 3.5])
    def test_an_integrating_controller(self, k_i: float) -> None:
        """It leaves no error, for any plant; the loop's polynomial is (z - a)(z - 1) + k (1 - a)."""
        text = loop(1.0, 1e-3).replace("hold = 1.0*(w - c.u)", f"hold = hold + {k_i!r}*(w - c.u)")
        found = bondgraph.load(text).equilibrium()
        a = math.exp(-1)
        roots = np.roots([1, -(a + 1) + k_i * (1 - a), a])
        assert found["y"] == pytest.approx(1.0, rel=1e-9)
        assert found.stable is bool(np.abs(roots).max() < 1)

    def test_a_plant_that_integrates(self) -> None:
        """A held speed into a position: it rests at the goal, which no held value but zero keeps."""
        text = """model A {
          input goal = 3 mm
          mode speed = 0 [m/s]
          every 10 ms { speed = 20 [1/s]*(goal - c.x) }
          MSf s : v = speed
          C c : F = 1 [N/m]*x
          s -> c
          output x = c.x
        }"""
        found = bondgraph.load(text).equilibrium()
        assert found["x"] == pytest.approx(3e-3, rel=1e-9) and found.stable
        assert found.growth == pytest.approx(math.log(0.8) / 0.01, rel=1e-7)

    def test_a_law_that_is_not_linear(self) -> None:
        """u = 2 - u^3 rests at 1, where the loop has the eigenvalue a - 3 (1 - a)."""
        text = loop(1.0, 1e-3).replace("1.0*(w - c.u)", "2 V - c.u^3/(1 [V^2])")
        found = bondgraph.load(text).equilibrium()
        assert found["y"] == pytest.approx(1.0, rel=1e-9)
        assert found.growth == pytest.approx(math.log(abs(math.exp(-1) - 3 * (1 - math.exp(-1)))) / 1e-3, rel=1e-7)

    def test_two_periods(self) -> None:
        """The rest is that of all samples; the verdict would be one of both periods together and is left open."""
        text = loop(2.0, 1e-3, extra="mode slow = 0 V\n every 3 ms { slow = c.u }\n output z = slow")
        found = bondgraph.load(text).equilibrium()
        assert found["y"] == pytest.approx(2 / 3, rel=1e-9) and found["z"] == pytest.approx(2 / 3, rel=1e-9)
        assert found.stable is None and found.to_json()["stable"] is None and "several rates" in found.summary()

    def test_a_counter_has_no_rest(self) -> None:
        with pytest.raises(RunFailed, match=r"no equilibrium was found.*`n`"):
            bondgraph.load(
                "model A {\n mode n = 0\n every 1 s { n = n + 1 }\n C c : u = q/(1 F)\n R r : u = 1 ohm*i\n 0 k\n k -> c, r\n output y = n\n}"
            ).equilibrium()

    def test_a_run_from_rest_stays(self) -> None:
        model = bondgraph.load(
            loop(2.0, 1e-3, extra="experiment e { equilibrium; simulate 0 .. 20 ms { points = 50 } }")
        )
        assert model.simulate("e")["y"] == pytest.approx(2 / 3, rel=1e-9)


class TestResponse:
    @pytest.mark.parametrize("gain", [0.5, 2.0])
    @pytest.mark.parametrize("period", [2e-4, 1e-3])
    def test_against_its_recursion(self, gain: float, period: float) -> None:
        """With w = exp(i Omega t) each step of the recursion and the Fourier integral over a period are done by hand."""
        found = bondgraph.load(loop(gain, period)).response(["w"], ["y"], 1.0, 0.5 / period, points=15)
        a, tau = math.exp(-period / 1e-3), 1e-3
        for frequency, value in zip(found.frequencies, found.of("w", "y"), strict=True):
            w = 2 * math.pi * frequency
            z = np.exp(1j * w * period)
            X = gain * (1 - a) / (z - a + gain * (1 - a))  # y at the samples
            M = gain * (1 - X)
            s = np.linspace(0, period, 4001)
            y = X * np.exp(-s / tau) + M * (1 - np.exp(-s / tau))
            part = y * np.exp(-1j * w * s)
            simpson = (part[0] + part[-1] + 4 * part[1:-1:2].sum() + 2 * part[2:-1:2].sum()) * (s[1] - s[0]) / 3
            assert value == pytest.approx(simpson / period, rel=1e-8)

    def test_against_a_run(self) -> None:
        """At a fifth of the rate of the samples the first harmonic of a long run is the response."""
        text = loop(2.0, 1e-3).replace("input w = 1 V", "signal w = 1 V*sin(2*pi*200*time/(1 s))")
        run = bondgraph.load(text).simulate(None, to=0.06, points=6001, rtol=1e-10)
        late = run.time >= 0.05 - 1e-9
        t, y = run.time[late][:-1], run["y"][late][:-1]
        amplitude = 2j * np.mean(y * np.exp(-2j * np.pi * 200 * t))
        exact = bondgraph.load(loop(2.0, 1e-3)).response(["w"], ["y"], 100.0, 200.0, points=2).of("w", "y")[-1]
        assert amplitude == pytest.approx(exact, rel=1e-4)

    def test_low_frequencies_see_the_gain_at_rest(self) -> None:
        found = bondgraph.load(loop(2.0, 1e-3)).response(["w"], ["y"])
        assert abs(found.of("w", "y")[0]) == pytest.approx(2 / 3, rel=1e-4)
        assert found.frequencies[-1] == pytest.approx(500.0) and "sampled" in found.summary()
        slow = bondgraph.load(loop(0.5, 1e-3, tau=0.1)).response(["w"], ["y"])  # from a tenth of its slowest pole on
        a = math.exp(-0.01)
        assert slow.frequencies[0] == pytest.approx(-math.log(a - 0.5 * (1 - a)) / 1e-3 / (20 * math.pi), rel=1e-9)

    def test_refused(self) -> None:
        model = bondgraph.load(loop(2.0, 1e-3))
        with pytest.raises(UsageError, match="half that rate, 500 Hz"):
            model.response(["w"], ["y"], 1.0, 600.0)
        for ask in ("linearize", "modes", "sensitivity"):
            with pytest.raises(UsageError, match=r"`every .* is sampled"):
                getattr(model, ask)()
        with pytest.raises(UsageError, match="is sampled"):
            model.continuation("w", 0.0, 1.0)
        with pytest.raises(UsageError, match="is sampled"):
            model.invert({"y": 0.5}, ["w"])


class TestModes:
    """Discrete variables at an equilibrium."""

    @staticmethod
    def valve(on: float, off: float, flow: float) -> str:
        """A tank that is filled below a level and not above another, with a leak."""
        return f"""model A {{
          mode flow = 0 A
          MSf s : i = flow
          C c : u = q/(1 F)
          R r : u = 1 ohm*i
          0 k
          s -> k -> c, r
          when c.u < {on!r} V {{ flow = {flow!r} A }}
          when c.u > {off!r} V {{ flow = 0 A }}
          output u = c.u
        }}"""

    def test_the_mode_that_holds_at_the_rest(self) -> None:
        """The source comes on below 1 V and would go off above 5 V, but leads to 3 V only."""
        assert bondgraph.load(self.valve(1.0, 5.0, 3.0)).equilibrium()["u"] == pytest.approx(3.0, rel=1e-9)

    def test_to_and_fro(self) -> None:
        with pytest.raises(RunFailed, match="to and fro"):
            bondgraph.load(self.valve(1.0, 2.0, 3.0)).equilibrium()

    @pytest.mark.parametrize(("force", "place"), [(3.0, 0.3), (15.0, 1.25)])
    def test_a_law_with_a_branch_on_the_way(self, force: float, place: float) -> None:
        """A stop of 20 N/m more beyond 1 m, as an `if`: the rest lies on the side that the force leads to."""
        text = f"""model A {{
          Se s : F = {force!r} N
          I m : p = 1 kg*v
          R r : F = 4 [N*s/m]*v
          C c : F = 10 [N/m]*x + 10 [N/m]*(x - 1 m) if x > 1 m else 10 [N/m]*x
          s -> 1(m, r) -> c
          output x = c.x
        }}"""
        found = bondgraph.load(text).equilibrium()
        assert found["x"] == pytest.approx(place, rel=1e-9) and found.stable
