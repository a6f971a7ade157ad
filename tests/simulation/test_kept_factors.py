"""The pilot run of a large model reuses factorizations: those of an earlier step serve as long as the iteration converges fast.

Its result equals that of a run that factorises in each iteration, in machine code as in Python.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bondgraph.model import Model
from bondgraph.simulation.constraints.constraints import Constraints
from bondgraph.simulation.magnitudes.pilot_run import PilotRun
from bondgraph.simulation.segments.timeline import Segment
from compiler.api import Source
from tests.benchmarks import large_models

pytestmark = pytest.mark.machine_code
SIDE = 13
LEAKS = {
    "cubic": large_models.CUBIC,
    # A diode: its slope changes by decades along the run, and old factors must be noticed to be wrong.
    "diode": "1e-6 [A]*(exp(u/(0.05 [V])) - 1)",
}


def coarse_run(leak: str, target: str, keeping: bool = True) -> PilotRun:
    text = large_models.network(large_models.mesh_edges(SIDE), SIDE**2, leak=leak)
    model = Model(Source("mesh.bg", text))
    program = model.compiled_scene(model.scene(), False, target).program
    every = np.ones(len(program.states.names))
    constraints = Constraints(program, np.array(program.defaults), np.array(program.input_defaults), every)
    state = np.asarray(program.start(constraints.constants), dtype=float)
    run = PilotRun(constraints, state)
    if not keeping:
        run.compiled.record.keeping = 0
    run.peak([Segment(0.0, 1e-3, program.switches(0.0, constraints.constants))], None)
    return run


@pytest.mark.parametrize("leak", LEAKS)
def test_few_factors_and_the_same_magnitudes(leak: str) -> None:
    usual, kept = coarse_run(LEAKS[leak], "numpy"), coarse_run(LEAKS[leak], "native")
    assert usual.stopped is kept.stopped is None
    np.testing.assert_allclose(kept.largest, usual.largest, rtol=1e-6)
    record: Any = kept.compiled.record
    assert usual.compiled.record.factorised == record.factorised  # step by step the same
    assert 0 < record.factorised <= {"cubic": 6, "diode": 50}[leak]
    anew = coarse_run(LEAKS[leak], "numpy", keeping=False)
    assert anew.compiled.record.factorised > 2 * record.factorised
    np.testing.assert_allclose(kept.largest, anew.largest, rtol=0.01)
