"""Constraints in machine code: against the source of it run as Python, bit by bit, and against dense linear algebra."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

import bondgraph
from bondgraph.simulation import phase
from bondgraph.simulation.constraints.constraints import Constraints
from bondgraph.simulation.integrators.compiled.constraint_functions import CompiledConstraints, fields_of
from bondgraph.simulation.integrators.projection.projection import (
    NormalEquations,
    ProjectionWorkspace,
    least_singular_value,
    project,
)
from tests.compiling import MODELS

pytestmark = pytest.mark.machine_code
NAMES = ("published/andrews.bg", "published/iftomm_A04_bricard.bg", "spatial_slider_crank.bg", "four_bar.bg")


def started(name: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Constraints, Any, Any]:
    """The constraints of a model in the magnitudes of a run, a state that it came to, and its mode."""
    kept: list[phase.Phase] = []
    original = phase.Phase.go
    monkeypatch.setattr(phase.Phase, "go", lambda self: (kept.append(self), original(self))[1])
    bondgraph.load(MODELS / name).simulate(target="native", points=2, to=1e-3, rtol=1e-6)
    return kept[0].constraints, kept[0].trajectory.final, kept[0].stretches[-1].mode


def beside(constraints: Constraints, state: Any, count: int) -> Any:
    """States that keep the constraints nearly."""
    rng, states = np.random.default_rng(3), np.tile(state, (count, 1))
    states[:, : constraints.count] += 1e-3 * constraints.reach * rng.normal(size=(count, constraints.count))
    return states


def as_python(constraints: Constraints, mode: Any) -> ProjectionWorkspace:
    """The record over numpy arrays."""
    program = constraints.program
    magnitude = np.ones(len(program.states.names) + len(program.unknowns.names))
    magnitude[: len(constraints.magnitude)] = constraints.magnitude
    values = fields_of(program, constraints.inputs, constraints.constants, magnitude, constraints.taking)
    values["mode"] = np.array(mode, dtype=float)
    for name in ("positions", "velocities"):
        fields = {k: np.asarray(v) if isinstance(v, list) else v for k, v in values[name].items()}
        values[name] = NormalEquations(**fields)
    for name in ("invariant", "invariant_slopes", "solved"):
        values[name] = _into(getattr(program, name))
    return ProjectionWorkspace(**values)


def _into(function: Any) -> Any:
    def call(time: float, state: Any, inputs: Any, constants: Any, mode: Any, out: Any) -> None:
        found = function(time, state, inputs, constants, mode)
        out[: len(found)] = found

    return call


@pytest.mark.parametrize("name", NAMES)
def test_the_same_source_runs_as_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    constraints, state, mode = started(name, monkeypatch)
    states, times = beside(constraints, state, 4), np.zeros(4)
    machine = CompiledConstraints(constraints, True)  # its vector for singular values is as it begins
    held, weak = machine.project(times, states, mode)
    smallest = machine.least_singular_values(times, held, mode)
    python = as_python(constraints, mode)
    for k in range(4):
        assert project(python, 0.0, states[k]) == weak[k]
        np.testing.assert_array_equal(states[k], held[k])
    for k in range(4):
        assert least_singular_value(python, python.positions, 0.0, states[k]) == smallest[k]


@pytest.mark.parametrize("name", NAMES)
def test_projections_and_singular_values_are_those_of_dense_algebra(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    constraints, state, mode = started(name, monkeypatch)
    assert constraints.compiled is not None
    states, times = beside(constraints, state, 5), np.zeros(5)
    held, weak = constraints.compiled.project(times, states, mode)
    assert not weak.any()
    smallest = constraints.compiled.least_singular_values(times, held, mode)
    for k in range(5):
        reference = constraints._projected(0.0, states[k], mode)
        moved = np.abs((reference - states[k])[: constraints.count] / constraints.reach).max()
        off = np.abs((held[k] - reference)[: constraints.count] / constraints.reach).max()
        assert off < 1e-11 < 1e-5 < moved
        assert constraints.missed(0.0, held[k], mode) < 1e-13
        slopes, _ = constraints.slopes(0.0, held[k], mode)
        scaled = (slopes / constraints.sizes(slopes)[:, None])[constraints.taking]
        assert smallest[k] == pytest.approx(np.linalg.svd(scaled, compute_uv=False)[-1], rel=1e-4)
