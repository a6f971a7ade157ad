"""Peaks and dips of frequency responses against closed forms, for any number of points; and rare cases of derivatives and energies."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.energies import energies
from bondgraph.errors import RunFailed
from tests.compiling import MODELS


def oscillator(damping: float, k: float = 4.0) -> str:
    """One mass of 1 kg on a spring, with a share of critical damping."""
    r = 2 * damping * math.sqrt(k)
    return f"""model Osc {{
      input f = 1 N
      MSe s : F = f
      I b : p = 1 kg*v
      C c : F = {k!r} [N/m]*x
      R d : F = {r!r} [N*s/m]*v
      s -> 1(b, c) -> d
      output x = c.x, v = b.v
    }}"""


TWO = """model Two {
  "Two masses; seen where it is pushed, the first stands still where the second absorbs: at sqrt(k2/m2)."
  input f = 1 N
  MSe s : F = f
  I a : p = 2 kg*v
  I b : p = 1 kg*v
  C c : F = 10 [N/m]*x
  C d : F = 9 [N/m]*x
  1 one, two, link
  0 gap : translation
  s -> one -> a, c
  one -> gap -> two -> b
  gap -> link -> d
  output x = integral(one.v, 0 m), y = integral(two.v, 0 m)
}"""


@pytest.mark.parametrize("points", [2, 10, 400, 3000])
@pytest.mark.parametrize("damping", [0.3, 0.05, 1e-3, 1e-6, 1e-9])
def test_a_damped_peak(damping: float, points: int) -> None:
    """At w sqrt(1 - 2 z^2), of 1/(2 z sqrt(1 - z^2)) times the static response."""
    found = bondgraph.load(oscillator(damping)).response(["f"], ["x"], 0.01, 10.0, points)
    (peak,) = found.extrema
    assert peak.kind == "peak"
    assert peak.frequency == pytest.approx(2 * math.sqrt(1 - 2 * damping**2) / (2 * math.pi), rel=1e-8)
    assert peak.magnitude == pytest.approx(0.25 / (2 * damping * math.sqrt(1 - damping**2)), rel=1e-6)
    assert found.peaks() == [("f", "x", peak.frequency)]
    assert np.abs(found.of("f", "x")).max() == pytest.approx(peak.magnitude, rel=1e-9)


@pytest.mark.parametrize("points", [2, 11, 1000])
@pytest.mark.parametrize("k", [1e-4, 4.0, 1e8])
def test_an_undamped_peak(k: float, points: int) -> None:
    """Infinite, at sqrt(k/m), and no value of the table pretends to be its height."""
    frequency = math.sqrt(k) / (2 * math.pi)
    model = bondgraph.load(oscillator(0.0, k))
    found = model.response(["f"], ["x", "v"], frequency / 10, frequency * 10, points)
    assert [(e.kind, e.frequency, e.magnitude) for e in found.extrema] == [
        ("peak", pytest.approx(frequency, rel=1e-12), math.inf)
    ] * 2
    assert "infinite" in found.summary() and "undamped" in found.summary()
    told = found.to_json()["responses"][0]["extrema"][0]
    assert told["magnitude"] is None and told["undamped"] is True
    assert [at for _, _, at in found.peaks()] == [pytest.approx(frequency, rel=1e-12)] * 2


@pytest.mark.parametrize("points", [5, 500])
def test_peaks_and_an_antiresonance(points: int) -> None:
    """Resonances are roots of (k1 + k2 - 2 w^2)(k2 - w^2) = k2^2. The dip of x is a zero at sqrt(k2/m2), that of y is no zero."""
    found = bondgraph.load(TWO).response(["f"], ["x", "y"], 0.01, 10.0, points)
    roots = np.sqrt(np.sort(np.roots([2, -(19 + 18), 90.0]).real)) / (2 * np.pi)
    at_x, at_y = (found.extrema_of("f", name) for name in ("x", "y"))
    assert [e.kind for e in at_x] == ["peak", "dip", "peak"] and [e.kind for e in at_y] == ["peak", "dip", "peak"]
    assert at_y[1].magnitude > 0.01  # the lowest between two resonances, no zero
    assert [at_x[0].frequency, at_x[2].frequency] == pytest.approx(roots, rel=1e-10)
    assert at_x[1].frequency == pytest.approx(3 / (2 * math.pi), rel=1e-8) and at_x[1].magnitude < 1e-9


NEIGHBOURS = """model Neighbours {
  input f = 1 N
  MSe s : F = f
  I a, b : p = 1 kg*v
  C c, d : F = 1 [N/m]*x
  R q, r : F = 1e-5 [N*s/m]*v
  C weak : F = 1e-3 [N/m]*x
  1 one, two
  0 gap : translation
  s -> one -> a, c, q
  two -> b, d, r
  one -> gap -> two
  gap -> weak
  output x = c.x
}"""


def test_peaks_that_are_close_together() -> None:
    """Equal oscillators, weakly joined: x is half the sum of two peaks, at 1 and sqrt(1 + 2 k) rad/s, and turns near sqrt(1 + k) between them."""
    extrema = bondgraph.load(NEIGHBOURS).response(["f"], ["x"], 0.01, 1.0, 20).extrema
    assert [e.kind for e in extrema] == ["peak", "dip", "peak"]
    expected = np.sqrt([1.0, 1.001, 1.002]) / (2 * np.pi)
    assert [e.frequency for e in extrema] == pytest.approx(expected, rel=1e-6)
    assert extrema[0].magnitude == pytest.approx(0.5e5, rel=1e-3)


def test_a_mode_that_an_output_does_not_see_is_no_peak() -> None:
    """Two oscillators beside each other, one of which is driven."""
    text = oscillator(0.1).replace(
        "output", "I p : p = 1 kg*v\n C q : F = 1 [N/m]*x\n 1 other\n other -> p, q\n output"
    )
    found = bondgraph.load(text).response(["f"], ["x"], 0.01, 10.0, 50)
    assert [(e.kind, math.isinf(e.magnitude)) for e in found.extrema] == [("peak", False)]


def test_without_a_finite_slope() -> None:
    """The arc of a cosine of one."""
    text = "model A {\n I m : p = 1 kg*v\n R r : F = 1 [N*s/m]*v + 1 [N]*acos(1 - v/(1 [m/s]))\n 1 k\n k -> m, r\n output v = m.v\n}"
    with pytest.raises(RunFailed, match="has no finite slope at this state"):
        bondgraph.load(text).linearize(inputs=(), state="start")


def test_energy_of_a_source_into_which_the_arrow_runs() -> None:
    """It gives what the mass, the spring and the air have, whichever way its arrow points."""
    text = """model A {
      Se push : F = 2 N
      I mass : p = 1 kg*v
      C spring : F = 100 [N/m]*x
      R air : F = 1 [N*s/m]*v
      1 b
      b -> mass, spring, air
      ARROW
      output x = spring.x
      experiment e { simulate 0 .. 1 s { points = 11 } }
    }"""
    given = [energies(bondgraph.load(text.replace("ARROW", arrow))) for arrow in ("push -> b", "b -> push")]
    for found in given:
        assert found.elements["push"][1:].min() > 0
        assert found.stored + found.dissipated == pytest.approx(found.supplied, abs=1e-8)
    assert given[0].supplied == pytest.approx(given[1].supplied, abs=1e-8)


def test_energy_of_a_field_of_both_kinds() -> None:
    """A quarter of z'Hz, with H the second derivatives of lambda^2 (1 + x/a)/(2 L): of flux linkage and displacement alike."""
    model = bondgraph.load(MODELS / "solenoid.bg")
    rest = model.equilibrium(settings={"volt": 2.4})
    current, L, a = 2.4 / 12, 0.2, 2e-3
    x = rest["x"]
    flux = current * L / (1 + x / a)
    H = np.array([[(1 + x / a) / L, flux / (L * a)], [flux / (L * a), 0.0]])
    seen = 0
    for mode in model.modes(settings={"volt": 2.4}):
        z = np.array([mode.shape["field.coil"], mode.shape["spring.x"]])  # the armature shares the spring's state
        exact = (z.conj() @ H @ z).real * (0.25 if mode.eigenvalue.imag else 0.5)
        if mode.where:
            assert mode.energy.get("field", 0.0) == pytest.approx(exact, rel=1e-6, abs=1e-8)
            seen += 1
    assert seen >= 2


class TestDelays:
    """In an equilibrium a delayed quantity equals the quantity itself."""

    @staticmethod
    def loop(gain: float) -> str:
        return f"""model A {{
          signal x = integral((0.1 + {gain!r}*delay(x, 10 ms) - x)/1 s, 0)
          output y = x
          experiment e {{ equilibrium; simulate 0 .. 0.1 s {{ points = 3 }} }}
        }}"""

    @pytest.mark.parametrize("gain", [0.5, 0.9, -0.8])
    def test_a_feedback(self, gain: float) -> None:
        found = bondgraph.load(self.loop(gain)).simulate("e")
        assert found["y"] == pytest.approx(0.1 / (1 - gain), rel=1e-9)

    @pytest.mark.parametrize("gain", [2.0, -3.0])
    def test_what_does_not_settle_is_refused(self, gain: float) -> None:
        with pytest.raises(RunFailed, match=r"do not settle on each other|no equilibrium was found"):
            bondgraph.load(self.loop(gain)).simulate("e")
