"""Modes: closed forms of chains, damped and rigid motion, the manipulator's resonances, and where the energy is."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.modes import moving_frequencies
from bondgraph.analysis.spectrum import spectrum
from bondgraph.keywords import AnalysisRequest
from tests.compiling import MODELS

OSCILLATOR = """
model A {
  parameter m = 2 kg, k = 50 [N/m], r = 3 [N*s/m]
  I mass : p = m*v
  C spring : F = k*x
  R damper : F = r*v
  1 body : translation
  body -> mass, spring, damper
  output x = spring.x
}
"""


def chain(n: int, stiffness: float) -> Any:
    """Frequencies in Hz of n masses between two walls; `stiffness` is k/m."""
    return 2 * np.sqrt(stiffness) * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1))) / (2 * np.pi)


PULLED = """
model Pulled {
  parameter n = 8, m = 0.1 kg, k: N/m = 100
  input pull = 0 N
  for i in 0..n {
    C spring[i] : F = k*x
    0 link[i] : translation
    link[i] -> spring[i]
  }
  for i in 1..n {
    1 at[i] : translation
    I mass[i] : p = m*v
    link[i-1] -> at[i] -> mass[i], link[i]
  }
  Sf wall_0, wall_n : v = 0
  MSe force : F = pull
  wall_0 -> link[0]
  link[n] -> wall_n
  force -> at[n]
  output x = spring[n].x
}
"""


class TestClosedForms:
    def test_damped_oscillator(self) -> None:
        (mode,) = bondgraph.load(OSCILLATOR).modes()
        natural, zeta = math.sqrt(50 / 2), 3 / (2 * math.sqrt(50 * 2))
        assert mode.frequency == pytest.approx(natural / (2 * math.pi), rel=1e-14)
        assert mode.damping == pytest.approx(zeta, rel=1e-13)
        assert mode.damped_frequency == pytest.approx(mode.frequency * math.sqrt(1 - zeta**2), rel=1e-13)
        assert mode.energy == pytest.approx({"mass": 0.5, "spring": 0.5}, rel=1e-12)

    def test_overdamped_and_unstable(self) -> None:
        slow, fast = bondgraph.load(OSCILLATOR).modes(settings={"r": 52.0})  # s^2 + 26 s + 25
        assert (slow.eigenvalue, fast.eigenvalue) == (pytest.approx(-1, rel=1e-13), pytest.approx(-25, rel=1e-13))
        assert slow.damping == 1 and slow.damped_frequency == 0 and slow.energy["spring"] > 0.9
        (grows,) = bondgraph.load(OSCILLATOR).modes(settings={"r": -3.0})
        assert grows.damping == pytest.approx(-0.15, rel=1e-12)
        assert not bondgraph.load(OSCILLATOR).equilibrium(settings={"r": -3.0}).stable

    def test_chain_of_masses(self) -> None:
        """2 sqrt(k/m) sin(pi j / (2 (n + 1))), j = 1 .. n; each mode's energy half in masses, half in springs."""
        n = 120
        found = bondgraph.load(MODELS / "chain.bg").modes(settings={"n": n})
        moving = [m for m in found if m.frequency > 1e-9]
        assert np.array([m.frequency for m in moving]) == pytest.approx(chain(n, 100 / 0.1), rel=1e-12)
        assert max(abs(m.damping) for m in moving) == 0
        third = moving[2]
        assert sum(v for name, v in third.energy.items() if name.startswith("mass")) == pytest.approx(0.5, rel=1e-9)
        for i in (1, 50, 119):  # p_i is proportional to sin(j pi i / (n + 1))
            ratio = abs(third.shape[f"mass[{i}].p"]) / abs(third.shape["mass[60].p"])
            wanted = abs(math.sin(3 * math.pi * i / (n + 1)) / math.sin(3 * math.pi * 60 / (n + 1)))
            assert ratio == pytest.approx(wanted, rel=1e-8)

    @pytest.mark.machine_code
    def test_a_thousand_masses(self) -> None:
        """1001 springs, 1000 masses, pulled at one end: at rest as the closed form says, all frequencies to 1e-11."""
        n = 1000
        model = bondgraph.load(PULLED)
        point = model.operating_point(AnalysisRequest(settings={"n": n, "pull": 2.0}))
        x = dict(zip(point.program.outputs.names, point.outputs, strict=True))["x"]
        assert x == pytest.approx(2.0 * n / (n + 1) / 100, rel=1e-9)  # k and n springs of k in line
        found = np.array(moving_frequencies(point))
        assert found == pytest.approx(chain(n, 100 / 0.1), rel=1e-11)

    def test_lossless_way_agrees_with_the_general_one(self) -> None:
        """Rings and unlike scales: the singular values against LAPACK's general eigenvalues of the same matrix."""
        random = np.random.default_rng(3)
        block = random.normal(size=(4, 6)) * (random.random((4, 6)) < 0.6)
        scale = 10.0 ** random.uniform(-4, 4, 10)
        A = np.block([[np.zeros((4, 4)), block], [-block.T, np.zeros((6, 6))]]) * scale[:, None] / scale
        found = spectrum(A)
        assert (np.abs(A @ found.shapes - found.shapes * found.values) <= 1e-9 * np.abs(A).max()).all()
        key = np.sort(np.abs(np.linalg.eigvals(A / scale[:, None] * scale)))
        assert np.sort(np.abs(found.values)) == pytest.approx(key, rel=1e-9, abs=1e-12)
        assert not found.values.real.any()


class TestManipulator:
    def test_resonances(self) -> None:
        """Reference: 1119.485, 1161.447, 1351.936 Hz undamped; abs(lambda)/2pi agrees to 2e-7, Im(lambda)/2pi is 6e-4 to 9e-4 lower."""
        found = bondgraph.load(MODELS / "manipulator.bg").modes()
        assert found.frequencies[:3] == pytest.approx([1119.485, 1161.447, 1351.936], rel=6e-7)
        assert found.frequencies[3:] == pytest.approx([812_091, 836_512, 1_658_236], rel=1e-6)
        for mode in found[:3]:
            assert 6e-4 < 1 - mode.damped_frequency / mode.frequency < 9.2e-4
            assert sum(mode.energy.values()) == pytest.approx(1, rel=1e-6)
            assert mode.energy["stage"] == pytest.approx(0.5, rel=2e-3)
        x, y, phi = found[:3]
        assert max(x.outputs, key=lambda n: abs(x.outputs[n]) * (n in "xy")) == "x"
        assert max(y.outputs, key=lambda n: abs(y.outputs[n]) * (n in "xy")) == "y"
        assert abs(phi.outputs["phi"]) * 170e-6 > 2 * max(abs(phi.outputs[n]) for n in "xy")

    def test_pushed_it_is_still_close(self) -> None:
        """At 30 uN in x, at rest: another point, other frequencies."""
        model = bondgraph.load(MODELS / "manipulator.bg")
        at_rest = model.equilibrium(settings={"fx": "30 uN"})
        assert at_rest["x"] == pytest.approx(9.67567e-6, rel=1e-5) and at_rest.stable
        moved = model.modes(settings={"fx": "30 uN"}).frequencies[:3]
        assert np.abs(moved / model.modes().frequencies[:3] - 1).max() < 0.02


class TestEnergy:
    def test_storage_in_derivative_form_and_gyrator(self) -> None:
        """Two masses on a lever swing as one: their shares are m1 and (r^2 m2) of the kinetic half."""
        text = """
        model A {
          I one : p = 2 kg*v
          I two : p = 3 kg*v
          C spring : F = 7 [N/m]*x
          TF lever : v1 = 0.5*v2
          1 here, there : translation
          here -> one, spring, lever
          lever -> there -> two
          output x = spring.x
        }
        """
        model = bondgraph.load(text)
        (mode,) = model.modes()
        inertia = 2 + 4 * 3  # v2 = 2 v1
        assert mode.frequency == pytest.approx(math.sqrt(7 / inertia) / (2 * math.pi), rel=1e-13)
        assert mode.energy == pytest.approx({"spring": 0.5, "one": 1 / inertia, "two": 6 / inertia}, rel=1e-10)

    def test_pendulum_has_its_energy_in_the_mechanism(self) -> None:
        """A compound double pendulum, hanging: eigenvalues of the textbook's mass and stiffness matrices."""
        found = bondgraph.load(MODELS / "pendulum.bg").modes()
        mass = np.array([[1 / 3 + 1, 1 / 2], [1 / 2, 1 / 3]])  # absolute angles, m = l = 1
        stiffness = 9.81 * np.diag([3 / 2, 1 / 2])
        wanted = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)) / (2 * np.pi)
        assert found.frequencies == pytest.approx(wanted, rel=1e-12)
        assert [m.energy for m in found] == [{"chain": pytest.approx(1, rel=1e-12)}] * 2

    def test_rigid_motion_has_none(self) -> None:
        text = (
            "model A { Se push : F = 0 N; I mass : p = 1 kg*v; 1 b; push -> b -> mass; output x = integral(b.v, 0 m) }"
        )
        found = bondgraph.load(text).modes()
        assert [m.frequency for m in found] == [0, 0] and all(not m.energy and math.isnan(m.damping) for m in found)
        assert json.dumps(found.to_json(), allow_nan=False)
