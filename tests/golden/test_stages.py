"""Every stage of the compiler as text, for three small models: stable, diff-able, and frozen here."""

from __future__ import annotations

from pathlib import Path

import pytest

import bondgraph
from bondgraph.model import STAGES
from tests.conftest import Golden

HERE = Path(__file__).parent
MODELS = (
    "oscillator",
    "two_masses",
    "rectifier",
)  # explicit, a dependent storage, a nonlinear loop and an implicit law


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("model", MODELS)
def test_stage(model: str, stage: str, golden: Golden) -> None:
    text = bondgraph.load(HERE / f"{model}.bg").show(stage)
    assert str(HERE) not in text, "the text depends on where the project lies"
    golden(HERE / f"{model}.{stage}.txt", text)


def test_all_stages_are_there() -> None:
    assert set(STAGES) >= {"syntax", "graph", "causality", "equations", "reduction", "code"}


def test_no_golden_file_is_left_over() -> None:
    expected = {f"{model}.{stage}.txt" for model in MODELS for stage in STAGES}
    assert {p.name for p in HERE.glob("*.txt")} - expected == set()


@pytest.mark.parametrize("stage", STAGES)
def test_the_same_twice(stage: str) -> None:
    first, second = (bondgraph.load(HERE / "two_masses.bg").show(stage) for _ in range(2))
    assert first == second


def test_an_unknown_stage() -> None:
    with pytest.raises(bondgraph.UsageError, match="graph"):
        bondgraph.load(HERE / "oscillator.bg").show("grph")
