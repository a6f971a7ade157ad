"""Every model of `models/`: it checks, runs, balances its energy, and agrees with closed forms where there are any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bondgraph

MODELS = sorted(p for p in Path("models").glob("*.bg") if p.name != "mems.bg")


@pytest.mark.machine_code
@pytest.mark.parametrize("path", sorted(Path("models").glob("*.bg")), ids=lambda p: p.stem)
def test_checks_clean(path: Path) -> None:
    assert bondgraph.check(path) == ()


@pytest.mark.few(13)
@pytest.mark.machine_code  # interpreted runs have the same balance: tests/simulation/test_compiled.py
@pytest.mark.parametrize("path", MODELS, ids=lambda p: p.stem)
def test_energy_balance_within_the_tolerance(path: Path) -> None:
    """Supplied = stored + dissipated, to 100 tolerances of the largest energy of any element.

    Work is a quadrature with the order of the solver, stored energy a function of the state alone.
    """
    result = bondgraph.load(path).simulate(energy=True)
    balance = result.energy
    assert balance is not None
    turned_over = sum(abs(e.supplied) + abs(e.dissipated) + abs(e.stored) for e in balance.elements)
    # nothing is supplied or lost: against the energy that is there
    swinging = {"pendulum": 4 * 9.81, "gyroscope": 13.5, "coin": 1e-3, "crank_linkage": 9.0}
    turned_over = swinging.get(path.stem, turned_over)
    if (
        path.stem == "inverse_kinematics"
    ):  # forces are k times a difference of positions, and rtol holds for these: k x^2
        turned_over = 4e4 * 0.072**2 / 100
    assert bool(balance.elements) is (path.stem != "lotka_volterra")  # which has signals and nothing else
    assert abs(balance.residual) <= 100 * result.rtol * turned_over


def test_series_rlc_against_the_closed_form() -> None:
    """u = U (1 - exp(-a t) (cos w t + a/w sin w t)), a = R/2L, w^2 = 1/LC - a^2."""
    result = bondgraph.load("models/rlc.bg").simulate(rtol=1e-10, points=201)
    a, w = 10 / 0.02, np.sqrt(1 / (0.01 * 1e-5) - (10 / 0.02) ** 2)
    t = np.maximum(result.time - 1e-3, 0.0)
    exact = 5 * (1 - np.exp(-a * t) * (np.cos(w * t) + a / w * np.sin(w * t)))
    assert np.abs(result["u"] - exact).max() < 5e-7  # of dense output between the steps
    assert result.final("u") == pytest.approx(exact[-1], rel=1e-9)


def test_driven_charge_is_t_exp_minus_t() -> None:
    result = bondgraph.load("models/rc_driven.bg").simulate(rtol=1e-11, points=2)
    assert result.final("x") == pytest.approx(10 * np.exp(-10), rel=1e-9)


def test_dc_motor_has_the_inertia_of_both() -> None:
    model = bondgraph.load("models/dc_motor.bg")
    k, r, n, b = 0.05, 1.0, 20.0, 1e-3
    speed = model.simulate(to=20.0, points=3).final("speed")
    assert speed == pytest.approx(12 * k / n / (k * k + r * b / n**2), rel=1e-6)
    program = model.compilation().program
    constants = program.constants(np.array(program.defaults))
    x = program.start(constants)
    jacobian = program.jacobian(0.0, x, np.array(program.input_defaults), constants, program.switches(0.0, constants))
    inertia, inductance = 2e-5 + 0.01 / n**2, 0.5e-3
    by_hand = np.array([[-r / inductance, -k / 2e-5], [k / inductance * 2e-5 / inertia, -b / n**2 / inertia]])
    assert np.trace(jacobian) == pytest.approx(np.trace(by_hand), rel=1e-12)
    assert np.linalg.det(jacobian) == pytest.approx(np.linalg.det(by_hand), rel=1e-9)
    assert len(program.states.names) == 2


def test_quarter_car_rests_before_the_bump() -> None:
    model = bondgraph.load("models/quarter_car.bg")
    result = model.simulate(settings={"speed": "1e-9 [m/s]"}, to=1.0, points=11)
    assert np.ptp(result["force"]) < 1e-3
    assert result.final("force") == pytest.approx((320 + 320 / 6) * 9.81, rel=1e-6)
    bump = model.simulate(rtol=1e-8, outputs=("force", "lift_off"))
    assert bump["lift_off"].max() == (1.0 if bump["force"].min() <= 0 else 0.0)


@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("load", "world", "body"),
    [
        ({"fx": "0.8 uN"}, (32.03080731, -0.3361817381, -0.03667257382), (31.99406616, -0.8369191345, -0.03663582245)),
        ({"fx": "0.8 uN", "torque": "4e-10 [N*m]"}, (13.6986301, 0.0, 0.0), (13.6986301, 0.0, 0.0)),
        ({"fx": "4.2 uN"}, (165.9650983, -8.924540184, -0.1892217368), (161.1780368, -21.43971295, -0.1843993767)),
    ],
)
def test_flexure_orders(load: dict[str, str], world: tuple[float, ...], body: tuple[float, ...]) -> None:
    """Section 3.4, put on slowly and left until all is at rest; um, um, rad."""
    ramp = {n: f"{v}*smoothstep5(time, 0 s, 10 ms)" for n, v in load.items()}
    names = [f"{c}_{w}" for w in ("world", "body") for c in ("x", "y", "phi")] + ["dx_symmetric", "dy_symmetric"]
    model = bondgraph.load("models/flexure.bg")
    result = model.simulate("force_and_torque", ramp, to=0.12, points=2, rtol=1e-7, outputs=tuple(names))
    micro = np.array([1e6, 1e6, 1.0])

    def place(which: str) -> np.ndarray:  # type: ignore[type-arg]
        return np.array([result.final(f"{c}_{which}") for c in ("x", "y", "phi")]) * micro

    assert place("world") == pytest.approx(np.array(world), rel=1e-6, abs=1e-7)
    assert place("body") == pytest.approx(np.array(body), rel=1e-6, abs=1e-7)
    assert abs(result.final("dx_symmetric")) < 2e-11  # rtol of the largest displacement
    assert abs(result.final("dy_symmetric")) < 2e-11


def test_flexure_published_differences() -> None:
    result = bondgraph.load("models/flexure.bg").simulate("force", to=0.2, points=2)
    assert result.final("dx") * 1e6 == pytest.approx(0.0367, abs=5e-5)
    assert result.final("dy") * 1e6 == pytest.approx(0.5007, abs=5e-5)
