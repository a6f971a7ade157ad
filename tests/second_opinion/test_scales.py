"""Random networks in other units of effort, flow and time; `python tests/second_opinion FOLDER --scales N` tries more, and texts with units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph
from tests.compiling import MODELS
from tests.second_opinion import scaled_analyses
from tests.second_opinion.random_models import network
from tests.second_opinion.scales import POWERS, SCALES, difference, in_other_units, scaled_run, unscaled, with_units

FOUND = (16, 80, 224, 272, 288, 296, 416)
"""Seeds of networks that gave wrong numbers, or were refused, in small or large units: a magnitude of 1 in SI hid their events."""


@pytest.mark.few(4)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("seed", FOUND)
def test_no_unit_changes_a_network(seed: int, scale: tuple[float, float, float]) -> None:
    """The same numbers, and the same events at the same instants."""
    example = network(seed)
    model = bondgraph.load(with_units(example))
    first, other = (scaled_run(model, example, s, target="numpy") for s in ((1.0, 1.0, 1.0), scale))
    assert difference(first, other, unscaled, scale[2]) == ""


def test_units_of_two_leave_every_bit() -> None:
    """What has no size of its own gives equal digits in units that are powers of two."""
    example, scale = network(272), (2.0**-50, 2.0**30, 2.0**-20)
    model = bondgraph.load(with_units(example))
    first, other = (scaled_run(model, example, s, target="numpy") for s in ((1.0, 1.0, 1.0), scale))
    assert first.steps == other.steps and len(first.events) == len(other.events) == 3
    np.testing.assert_allclose(other.values, first.values, rtol=1e-13, atol=1e-15)


def test_a_difference_is_seen() -> None:
    """Another parameter in its third digit, and events at other instants."""
    example = network(80)
    model = bondgraph.load(with_units(example))
    first = scaled_run(model, example, (1.0, 1.0, 1.0), target="numpy")
    name, value = next(iter(example.settings.items()))
    changed = replace(example, parameters={**example.parameters, name: 1.003 * value})
    other = scaled_run(model, changed, (1.0, 1.0, 1.0), target="numpy")
    assert "differs" in difference(first, other, unscaled, 1.0)
    assert "instants" in difference(first, first, unscaled, 1.001)


@pytest.mark.few(5)
@pytest.mark.parametrize("powers", POWERS)
def test_no_unit_changes_a_rest_and_its_modes(powers: dict[str, int]) -> None:
    """A motor from standstill: with a magnitude of 1 in SI for what is zero, its start was taken for a steady motion."""
    text = (MODELS / "dc_motor.bg").read_text(encoding="utf-8")
    changed, units = in_other_units(text, powers)
    first, other = bondgraph.load(text), bondgraph.load(changed)
    second = units.of_unit("s")
    assert other.equilibrium()["speed"] * second == pytest.approx(first.equilibrium()["speed"], rel=1e-9)
    for mode, same in zip(first.modes(), other.modes(), strict=True):
        assert same.frequency * second == pytest.approx(mode.frequency, rel=1e-9)


def test_a_compound_unit_without_brackets_is_one_quantity() -> None:
    """`1 mm/s` was printed as a number over a name, and only its length was changed."""
    text = "model A {\n  Sf d : v = 1 mm/s\n  I m : p = 1 kg*v\n  d -> m\n  output p = m.p\n}"
    changed, units = in_other_units(text, {"length": 2, "time": -4, "mass": 6})
    run = bondgraph.load(changed).simulate(to=1.0, points=2)
    assert run.final("p") == pytest.approx(1e-3 * units.of_unit("N*s"), rel=1e-12)


def test_a_mechanism_of_nanometres_has_inertia() -> None:
    """Displacements of a metre, at which inertia was sampled, made that of the links rounding: BG202."""
    text = (MODELS / "flexure.bg").read_text(encoding="utf-8")
    small, _ = in_other_units(text, {"length": -6})
    assert bondgraph.load(small).certificate == bondgraph.load(text).certificate


@pytest.mark.few(2)
@pytest.mark.parametrize("powers", POWERS[::2], ids=str)
@pytest.mark.parametrize("name", ["plates", "pendulum", "solenoid", "active_filter"])
def test_no_unit_changes_an_analysis(name: str, powers: dict[str, int]) -> None:
    """Rest, modes, linear model, branches along parameters and inversions, or their refusals."""
    path = MODELS / f"{name}.bg"
    found = dict(scaled_analyses.cases(name, path.read_text(encoding="utf-8"), path, [powers]))
    assert len(found) >= 5 and not any(found.values()), {case: words for case, words in found.items() if words}


def test_a_difference_of_analyses_is_seen() -> None:
    """Another number in its sixth digit, a verdict, a refusal, and the unit of an entry of A."""
    one = {"x": ("m", 3.0), "stable": ("", True), "A[p, x]": ("N*s|m|/s", 2.0)}
    assert scaled_analyses.differing(one, one, unscaled) == ""
    assert "x: 3" in scaled_analyses.differing(one, one | {"x": ("m", 3.00001)}, unscaled)
    assert "stable" in scaled_analyses.differing(one, one | {"stable": ("", None)}, unscaled)
    assert "there" in scaled_analyses.differing(one, "RunFailed", unscaled)
    factors = {"m": 100.0, "s": 10.0, "N*s": 20.0}
    same = {"x": ("m", 300.0), "stable": ("", True), "A[p, x]": ("N*s|m|/s", 2.0 * 20 / 100 / 10)}
    assert scaled_analyses.differing(one, same, factors.__getitem__) == ""
