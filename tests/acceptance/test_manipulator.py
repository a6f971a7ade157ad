"""The manipulator, end to end, against an independent integration of hand-written equations and the published numbers."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.physics.manipulator_reference import REFERENCE

OUTPUTS = ("x", "y", "phi", "c1", "c2", "c3")
SCENARIOS = {"push_x": "manipulator", "drive_560": "manipulator", "feed_forward": "feed_forward"}
TIGHT = 1e-9  # the tolerance that agreement to 1e-8 is asked at


@cache
def model(name: str = "manipulator") -> bondgraph.Model:
    return bondgraph.load(f"models/{name}.bg")


def deviations(scenario: str, rtol: float | None) -> dict[str, float]:
    """Largest deviation of each output from the reference, over the largest value of its kind (lengths, angle)."""
    experiment = {"feed_forward": "step_x"}.get(scenario, scenario)
    reference = REFERENCE[scenario]
    result = model(SCENARIOS[scenario]).simulate(experiment, rtol=rtol, points=401, outputs=OUTPUTS)
    worst = dict.fromkeys(OUTPUTS, 0.0)
    length = max(abs(row[n]) for row in reference.values() for n in OUTPUTS if n != "phi")
    angle = max(abs(row["phi"]) for row in reference.values())
    for instant, row in reference.items():
        place = int(np.argmin(abs(result.time - instant)))
        assert abs(result.time[place] - instant) < 1e-12
        for name in OUTPUTS:
            scale = angle if name == "phi" else length
            worst[name] = max(worst[name], abs(result[name][place] - row[name]) / scale)
    return worst


@pytest.mark.machine_code
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_agrees_at_a_tight_tolerance(scenario: str) -> None:
    assert max(deviations(scenario, TIGHT).values()) < 1e-8


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_agrees_at_the_default_tolerance(scenario: str) -> None:
    assert max(deviations(scenario, None).values()) < 1e-5


def test_reference_run_in_x() -> None:
    """x to 1e-8 of itself, against the digits of an independent implementation."""
    result = model().simulate("push_x", rtol=TIGHT, points=5, outputs=("x", "phi", "c2"))
    published = {0.005: 9.678468044695e-6, 0.01: 9.677001283843e-6, 0.02: 9.675844161760e-6}
    for instant, x in published.items():
        assert result["x"][round(instant / 0.005)] == pytest.approx(x, rel=1e-8)
    assert result.final("phi") == pytest.approx(-1.365277450e-4, rel=1e-8)
    assert result.final("c2") == pytest.approx(-8.403548266412e-6, rel=1e-8)


def test_energy_balance() -> None:
    balance = model().simulate("push_x", energy=True).energy
    assert balance is not None
    assert balance.stored == pytest.approx(1.451402509e-10, rel=1e-6)
    assert balance.supplied == pytest.approx(1.461642194e-10, rel=1e-6)
    assert balance.dissipated == pytest.approx(1.023968566e-12, rel=1e-5)
    assert abs(balance.residual) < 1e-6 * balance.supplied


def test_asking_for_energy_changes_no_step() -> None:
    plain, audited = (model().simulate("push_x", energy=e) for e in (False, True))
    assert (plain.steps, plain.evaluations) == (audited.steps, audited.evaluations)
    assert np.array_equal(plain.values, audited.values)


@pytest.mark.machine_code
@pytest.mark.parametrize("more", ["", " + 1e-3 [N/m^3]*x^3"], ids=["linear", "nonlinear"])
def test_asking_for_energy_changes_nothing_where_states_were_left_out(more: str) -> None:
    """Quantities needed only for the balance are computed with the same accuracy, so the steps may differ."""
    text = """
    model Two {
      1 slow, fast : translation
      I a : p = 1 kg*v
      C b : F = 2 [N/m]*xMORE { start x = 1 m }
      I c : p = 1e-3 kg*v
      C d : F = 2e3 [N/m]*xMORE { start x = 5 m }
      slow -> a, b
      fast -> c, d
      output x = b.x, y = d.x
    }""".replace("MORE", more)
    model = bondgraph.load(text)
    lean, audited = (model.simulate(to=3.0, points=7, outputs=("x",), energy=e) for e in (False, True))
    assert audited["x"] == pytest.approx(lean["x"], abs=1e-12 if not more else 1e-7)
    assert audited.energy is not None
    assert {e.name for e in audited.energy.elements} == {"a", "b", "c", "d"}
    assert abs(audited.energy.residual) < 25e3 * (1e-11 if not more else 5e-5)  # of what is stored, over 675 periods


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("flexure[1].k_phi", 1.09016e-8), ("flexure[1].k_x", 0.0584433), ("flexure[1].k_y", 34403.571),
        ("flexure[2].k_phi", 9.57669e-9), ("flexure[3].k_x", 0.0513404), ("flexure[3].k_y", 37525.0),
        ("comb[1].k", 2.289343), ("comb[2].k", 2.011105), ("m_s", 40.3732e-9), ("m_p", 2.108492e-9), ("m_f", 0.573233e-9),
        ("comb[1].gap", 4.05e-6), ("comb[3].gap", 4.25e-6), ("s", 0.5e-3),
    ],
)  # fmt: skip
def test_derived_parameters(name: str, value: float) -> None:
    """(4.5) to (4.20), derived inside the model from dimensions; the table prints six digits."""
    assert model().parameters[name].value == pytest.approx(value, rel=1e-6)


def program(settings: dict[str, str]) -> tuple[Any, Any, Any]:
    compiled = model().compilation(model().scene(None, settings)).program
    constants = compiled.constants(np.array(compiled.defaults))
    return compiled, constants, compiled.switches(0.0, constants)


def test_natural_frequencies() -> None:
    compiled, constants, mode = program({})
    jacobian = compiled.jacobian(0.0, compiled.start(constants), np.array(compiled.input_defaults), constants, mode)
    found = np.sort(np.abs(np.linalg.eigvals(jacobian)) / (2 * np.pi))[::2]
    from tests.physics.manipulator_reference import frequencies

    assert found == pytest.approx(np.sort(frequencies())[-6:], rel=1e-6)
    assert found == pytest.approx([1119.485, 1161.447, 1351.936, 812091, 836512, 1658236], rel=1e-6)


@pytest.mark.parametrize(("force", "output", "place"), [("fx", "x", 9.67567e-6), ("fy", "y", 8.92099e-6)])
def test_static_deflection(force: str, output: str, place: float) -> None:
    compiled, constants, mode = program({force: "30 uN"})
    inputs = np.array(compiled.input_defaults)
    state = compiled.start(constants)
    for _ in range(20):  # Newton; the flexures are only slightly nonlinear
        slope = compiled.jacobian(0.0, state, inputs, constants, mode)
        scale = np.abs(slope).max(axis=1)
        rates = compiled.derivative(0.0, state, inputs, constants, mode)
        state = state - np.linalg.solve(slope / scale[:, None], rates / scale)
    values = compiled.output(0.0, state, inputs, constants, mode)
    assert values[compiled.outputs.names.index(output)] == pytest.approx(place, rel=1e-6)


def test_a_resistor_of_zero_leaves_no_trace() -> None:
    plain = model().compilation(model().scene("push_x")).program.source
    assert "loss" not in plain
    assert "r_x" not in plain
    for value in ("0 [N*s/m]", "1e-6 [N*s/m]"):
        assert "r_x" in model().compilation(model().scene("push_x", {"r_x": value})).program.source
    damped = model().simulate("push_x", {"r_x": "1e-6 [N*s/m]"}, points=21)
    zero = model().simulate("push_x", {"r_x": "0 [N*s/m]"}, points=21)
    same = model().simulate("push_x", points=21)
    assert abs(damped["y"] - same["y"]).max() > 1e-12
    assert zero["x"] == pytest.approx(same["x"], rel=1e-6, abs=1e-11)
