"""The hand-written manipulator against the published table, and its two integrators against the fixed digits."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from tests.physics import manipulator_reference as reference
from tests.physics.manipulator_reference import NOMINAL, SCALE, Array, Loads

POSES = [
    np.zeros(6),
    np.array([1e-6, -2e-6, 3e-6, 8e-6, -5e-6, 0.02]),
    np.array([-9e-6, 4e-6, 5e-6, -1.1e-5, 7e-6, -0.05]),
]


def test_parameters_are_the_published_ones() -> None:
    """(4.6), (4.9), (4.19), (4.20) as printed, and the inferred comb constants."""
    assert pytest.approx([1.09016e-8, 9.57669e-9, 9.57669e-9], rel=1e-6) == NOMINAL.k_phi
    assert pytest.approx([0.0584433, 0.0513404, 0.0513404], rel=1e-6) == NOMINAL.k_x
    assert pytest.approx([34403.571, 37525.0, 37525.0], rel=1e-7) == NOMINAL.k_y
    assert pytest.approx([2.289343, 2.011105, 2.011105], rel=3e-7) == NOMINAL.k_g
    assert pytest.approx([8.307633e-9, 7.916686e-9, 7.916686e-9], rel=1e-7) == NOMINAL.comb
    assert pytest.approx(0.573233e-9, rel=1e-6) == NOMINAL.flexure_mass
    assert pytest.approx(40.3732e-9, rel=1e-6) == NOMINAL.shuttle_mass
    assert pytest.approx(2.108492e-9, rel=3e-7) == NOMINAL.platform_mass
    assert NOMINAL.spring_arm == 0.5e-3


def _energy(q: list[complex]) -> complex:
    """The springs' energy written a second time, term by term as printed in (3.10), for complex steps."""
    energy, phi = 0j, q[5]
    for arm, angle in enumerate((0.0, 2 * math.pi / 3, 4 * math.pi / 3)):
        cosine, sine = math.cos(angle), math.sin(angle)
        xa = q[3] * cosine + q[4] * sine + 170e-6 * (np.cos(phi) - 1) + 0.5e-3 * np.sin(phi)
        ya = -q[3] * sine + q[4] * cosine + 170e-6 * np.sin(phi) + 0.5e-3 * (1 - np.cos(phi)) - q[arm]
        xc = xa * np.cos(phi / 2) + ya * np.sin(phi / 2)
        yc = -xa * np.sin(phi / 2) + ya * np.cos(phi / 2)
        energy += NOMINAL.k_phi[arm] * phi**2 / 2 + NOMINAL.k_x[arm] * xc**2 / 2 + NOMINAL.k_y[arm] * yc**2 / 2
        energy += NOMINAL.k_g[arm] * q[arm] ** 2 / 2
    return energy


@pytest.mark.parametrize("q", POSES)
def test_forces_are_the_gradient_of_the_energy(q: Array) -> None:
    tiny, forces = 1e-30, reference.restoring(q)
    assert float(reference.potential(q)) == pytest.approx(_energy(list(q.astype(complex))).real, rel=1e-12)
    for index in range(6):
        point = list(q.astype(complex))
        point[index] += 1j * tiny
        assert forces[index] == pytest.approx(_energy(point).imag / tiny, rel=1e-10, abs=1e-14)


@pytest.mark.parametrize("phi", [0.0, 0.03, -0.2])
def test_efforts_are_the_printed_ones(phi: float) -> None:
    """(3.11)-(3.13) multiplied out, with 12 E I/l^3 = k_x and E A/l = k_y."""
    xa, ya, k_phi, kx, ky = 1.3e-5, -4e-7, 1.09e-8, 0.0584, 34404.0
    stiffness = reference.Stiffness(np.array(k_phi), np.array(kx), np.array(ky))
    fx, fy, m = reference.flexure_effort(np.array(xa), np.array(ya), np.array(phi), stiffness)
    half, both = phi / 2, (kx - ky) * math.sin(phi) / 2
    assert fx == pytest.approx((kx * math.cos(half) ** 2 + ky * math.sin(half) ** 2) * xa + both * ya, rel=1e-12)
    assert fy == pytest.approx(both * xa + (kx * math.sin(half) ** 2 + ky * math.cos(half) ** 2) * ya, rel=1e-12)
    printed = k_phi * phi + both / 2 * (ya**2 - xa**2) + (kx - ky) / 2 * math.cos(phi) * xa * ya
    assert m == pytest.approx(printed, rel=1e-12)


@pytest.mark.parametrize("q", POSES)
def test_stiffness_is_the_derivative_of_the_forces(q: Array) -> None:
    """By differences of fourth order, scaled to energies."""
    step, scale = 1e-2, SCALE[:6]
    exact = reference.stiffness(q) * scale * scale[:, None]
    assert np.max(np.abs(exact - exact.T)) <= 1e-14 * np.max(np.abs(exact))
    for index in range(6):
        shift = np.zeros(6)
        shift[index] = step * scale[index]
        near = reference.restoring(q + shift) - reference.restoring(q - shift)
        far = reference.restoring(q + 2 * shift) - reference.restoring(q - 2 * shift)
        column = (8 * near - far) / (12 * step) * scale
        assert np.max(np.abs(column - exact[:, index])) < 1e-9 * np.max(np.abs(exact[:, index]))


@pytest.mark.parametrize("q", POSES)
def test_jacobian_is_the_derivative(q: Array) -> None:
    """Its left half follows from the stiffness; in its right half the equations are linear."""
    rate = np.array([0.01, -0.02, 0.03, 0.05, -0.04, 3.0])
    matrix = reference.jacobian(np.concatenate([q, rate]))
    assert not matrix[:6, :6].any()
    assert matrix[6:, :6] * NOMINAL.mass[:, None] == pytest.approx(-reference.stiffness(q), rel=1e-14)
    coasting = reference.derivative(0.0, np.concatenate([np.zeros(6), rate]))
    assert matrix[:, 6:] @ rate == pytest.approx(coasting, rel=1e-14)


def test_frequencies() -> None:
    """Table 4.2 within its 10 Hz, and the digits of the model; the air moves abs(lambda) by 2e-7 at most."""
    found = reference.frequencies()
    assert found[:3] == pytest.approx([1122, 1163, 1353], abs=10)
    assert found[:3] == pytest.approx([1119.485, 1161.447, 1351.936], abs=1e-3)
    assert found[3:] == pytest.approx([812_091, 836_512, 1_658_236], abs=0.5)
    assert reference.undamped_frequencies() == pytest.approx(found, rel=3e-7)


def test_static_deflections() -> None:
    """(4.21), and equilibrium as the rest of the equations of motion."""
    along_x, along_y = reference.static(fx=30e-6), reference.static(fy=30e-6)
    assert along_x[3] == pytest.approx(9.67567e-6, rel=1e-6)
    assert along_y[4] == pytest.approx(8.92099e-6, rel=1e-6)
    rest = np.concatenate([along_x, np.zeros(6)])
    force = reference.derivative(0.0, rest, fx=30e-6)[6:] * NOMINAL.mass
    assert np.max(np.abs(force[:5])) < 1e-14
    assert abs(force[5]) < 1e-18


def _fed_forward(x: float = 0.0, y: float = 0.0, phi: float = 0.0) -> tuple[Array, Array]:
    """Positions for the static feed-forward of 5.2, and the squares of its voltages, negative for pull."""
    shuttles = np.array(reference.inverse_kinematics(0.735 * x, 0.735 * y, 0.96 * phi))
    squares = np.array([19400.0, 18900.0, 18900.0]) ** 2 * shuttles
    volts = np.sqrt(np.abs(squares))
    return reference.static(push=np.where(squares > 0, volts, 0.0), pull=np.where(squares < 0, volts, 0.0)), squares


def test_feed_forward_ratios() -> None:
    """5.3.1: V3^2/x over V1^2/y is 0.81, and V1^2/V2^2 in y is 2.1."""
    along_x, volts_x = _fed_forward(x=12e-6)
    along_y, volts_y = _fed_forward(y=12e-6)
    assert (volts_x[2] / along_x[3]) / (volts_y[0] / along_y[4]) == pytest.approx(0.8095, abs=5e-5)
    assert -volts_y[0] / volts_y[1] == pytest.approx(2.107, abs=5e-4)


def test_inverse_kinematics_meet_the_shuttles() -> None:
    """Erratum 7: at about 3 deg the formula for the symmetric flexure is right to 0.0003 um."""
    turned, _ = _fed_forward(phi=math.radians(3))
    x, y, phi = turned[3:]
    assert math.degrees(phi) == pytest.approx(2.9045, abs=1e-4)
    assert turned[:3] == pytest.approx(reference.inverse_kinematics(x, y, phi), abs=3e-10)


def test_peak_to_peak_in_resonance() -> None:
    """4.4.2: 14 V on pull 2 and push 3, 98 V^2 (1 - cos) by (4.25): 10.2 um peak to peak, 9.04 with r = 2.82e-5."""
    for parameters, expected in ((NOMINAL, 10.2e-6), (reference.Parameters(damping=2.82e-5), 9.04e-6)):
        drive = np.zeros(12)
        drive[6:] = reference.applied(push=(0, 0, 14), pull=(0, 14, 0)) / 2 / parameters.mass
        slope = reference.jacobian(np.zeros(12), parameters)
        angular = 2 * math.pi * np.linspace(1100, 1130, 121)
        peak = max(abs(np.linalg.solve(1j * w * np.eye(12) - slope, drive)[3]) for w in angular)
        assert 2 * peak == pytest.approx(expected, rel=3e-3)


def _differences(symmetric: bool, fx: float, torque: float = 0.0) -> tuple[float, float]:
    world = reference.flexure_static("world", symmetric, fx, torque)
    body = reference.flexure_static("body", symmetric, fx, torque)
    return world.x - body.x, world.y - body.y


def test_plain_flexures_differ() -> None:
    """3.4.1: 0.0367 and 0.5007 um at 0.8 uN, where the body turns by 2.10 deg; 4.79 and 12.5 um at 4.2 uN."""
    assert _differences(False, 0.8e-6) == pytest.approx((0.0367e-6, 0.5007e-6), abs=0.5e-10)
    assert _differences(False, 4.2e-6) == pytest.approx((4.79e-6, 12.5e-6), rel=2e-3)
    assert math.degrees(reference.flexure_static("world", False, 0.8e-6, 0.0).phi) == pytest.approx(-2.10, abs=5e-3)


@pytest.mark.parametrize("fx", [0.8e-6, 4.2e-6])
def test_symmetric_flexures_agree(fx: float) -> None:
    """3.4.2: with (3.10) and (3.15) the order of the joints does not matter."""
    assert _differences(True, fx) == pytest.approx((0.0, 0.0), abs=1e-18)


@pytest.mark.parametrize("order", ["world", "body"])
@pytest.mark.parametrize("symmetric", [False, True])
def test_torque_that_cancels_the_rotation(order: Literal["world", "body"], symmetric: bool) -> None:
    """(3.19): x = 13.7 um and no rotation."""
    deflection = reference.flexure_static(order, symmetric, 0.8e-6, 4e-10)
    assert deflection.x == pytest.approx(13.6986e-6, rel=1e-5)
    assert abs(deflection.phi) < 1e-15
    assert abs(deflection.y) < 1e-18


def test_gauss_is_of_its_order() -> None:
    """Halving the step in a resolved free swing divides the error by 2^(2*stages)."""
    start = np.concatenate([reference.static(fx=30e-6), np.zeros(6)])

    def end(stages: int, step: float) -> Array:
        run = reference.integrate_gauss(lambda t: Loads(), 5e-6, [5e-6], step=step, stages=stages, start=start)
        scaled: Array = run.states[0] / SCALE
        return scaled

    fine = end(4, 2e-8)
    for stages, step, order in ((2, 1e-7, 4), (3, 2e-7, 6)):
        coarse, half = (float(np.max(np.abs(end(stages, h) - fine))) for h in (step, step / 2))
        assert math.log2(coarse / half) == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize("name", ["push_x", "drive_560", "feed_forward"])
def test_both_integrators_give_the_reference(name: str) -> None:
    """Radau at 1e-8 and Gauss of order 8 at 40 us against the digits, each output against its largest value."""
    scenario = reference.SCENARIOS[name]()
    rows = [reference.REFERENCE[name][instant] for instant in scenario.instants]
    digits = np.array([[row[key] for key in reference.COORDINATES] for row in rows])
    energies = np.array([[row[key] for key in ("stored", "work", "dissipated")] for row in rows])
    radau = reference.integrate(scenario.forcing, scenario.t_end, scenario.instants, scenario.breaks, rtol=1e-8)
    gauss = reference.integrate_gauss(scenario.forcing, scenario.t_end, scenario.instants, scenario.breaks, step=4e-5)
    for run, tolerance in ((radau, 3e-8), (gauss, 2e-9)):
        found = np.column_stack([reference.stored(run.states), run.work, run.dissipated])
        assert np.max(np.abs(run.states[:, 3] - digits[:, 3])) < tolerance * np.max(np.abs(digits[:, 3]))
        assert np.max(np.abs(run.states[:, :6] - digits) / SCALE[:6]) < tolerance
        assert np.max(np.abs(found - energies)) < 3 * tolerance * np.max(energies)


def test_reference_is_the_published_run() -> None:
    """The printed digits of the run with 30 uN in x; supplied energy is stored or dissipated."""
    digits = reference.REFERENCE["push_x"]
    assert digits[5e-3]["x"] == pytest.approx(9.678468044695e-6, abs=6e-19)
    assert digits[10e-3]["x"] == pytest.approx(9.677001283843e-6, abs=6e-19)
    assert digits[20e-3]["x"] == pytest.approx(9.675844161760e-6, abs=6e-19)
    assert digits[20e-3]["phi"] == pytest.approx(-1.365277450e-4, abs=6e-14)
    assert digits[20e-3]["c2"] == pytest.approx(-8.403548266412e-6, abs=6e-19)
    assert digits[20e-3]["stored"] == pytest.approx(1.451402509e-10, abs=6e-20)
    assert digits[20e-3]["work"] == pytest.approx(1.461642194e-10, abs=6e-20)
    assert digits[20e-3]["dissipated"] == pytest.approx(1.023968566e-12, abs=6e-22)
    for run in reference.REFERENCE.values():
        for values in run.values():
            assert values["work"] == pytest.approx(values["stored"] + values["dissipated"], rel=1e-9)
