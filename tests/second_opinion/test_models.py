"""Every model of `models/` beside the second opinion on its text, over the first part of its experiment."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.compiling import MODELS, compiled
from tests.second_opinion.comparison import compared, second
from tests.second_opinion.solution import Undecided
from tests.second_opinion.writer import NotHeld

# What the second opinion does not compare, and why. This table may only shrink.
LEFT = {
    "car": "its start leaves rates open that the product chooses",
    "end_stops": "a preload of a storage on a coordinate",
    "side_instability": "a preload of a storage on a coordinate",
    "feed_forward": "a table of inputs whose slopes are read",
    "flexure": "slow, and an output that is rounding",
    "coin": "its start leaves rates open that the product chooses",
    "mems": "several models to run",
    "published/whipple": "its start leaves rates open that the product chooses",
    "published/andrews": "slow: seven bodies, and springs of microseconds",
    "published/iftomm_A01_pendulum": "slow: a tight tolerance over many turns",
    "published/iftomm_A02_N_fourbar": "slow: many loops, most of them redundant",
    "published/robertson": "slow: decades of time with equal steps",
    "published/hires": "slow: equal steps through the first transient",
    "thesis/feedback": "undecided: Newton's method of the second opinion does not converge at the start",
    "thesis/figures_3_9": "slow, and an output that is rounding",
}
SHARES = {
    "gyroscope": 0.004,
    "six_axes": 0.01,
    "crank_linkage": 0.02,
    "rectifier": 0.02,
    "active_filter": 0.03,
    "pid_dc_motor": 0.03,
    "published/transistor_amplifier": 0.01,
}
USUAL = 0.1  # of the experiment's time

FILES = {str(p.relative_to(MODELS).with_suffix("")): p for p in sorted(MODELS.rglob("*.bg"))}


def span_of(path: Path) -> float | None:
    """Duration of the first experiment's simulation; None if it has none."""
    plan = compiled(path, experiment="").plan
    return None if plan.stop is None else plan.stop - plan.start


@pytest.mark.few(29)
@pytest.mark.machine_code  # random models compare the interpreted steps too
@pytest.mark.parametrize("name", [n for n in FILES if n not in LEFT])
def test_a_model_has_a_second_opinion(name: str) -> None:
    """Outputs at three instants differ by less than ten times both errors."""
    path = FILES[name]
    span = span_of(path)
    if span is None:
        pytest.skip("the first experiment simulates nothing")
    verdict = compared(path, span * SHARES.get(name, USUAL), points=4, goal=1e-5, most=128)
    assert verdict.kind == "agreed", verdict


def test_what_is_left_out_is_a_model() -> None:
    assert set(LEFT) <= set(FILES)


@pytest.mark.parametrize("name", [n for n, why in LEFT.items() if "space" in why or "preload" in why or "rates" in why])
def test_what_is_left_out_has_no_second_opinion(name: str) -> None:
    """A model that the second opinion can compare must be removed from the table."""
    span = span_of(FILES[name])
    assert span is not None
    with pytest.raises((NotHeld, Undecided)):
        second(FILES[name], 1e-3 * span, 2, goal=1e-2, most=16)
