"""Scope of batches: scenes whose runs are one phase without events, loops or constraints; and what their runs have in common."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import AUTOMATIC, Array, Program, Scene

from ..compiled_model import CompiledModel
from ..compiled_scene import CompiledScene, chosen_target, many_runs
from ..simulation.integration.method import LARGEST
from ..simulation.integrators.compiled.fields import is_sparse
from ..simulation.integrators.compiled.run import obstacle
from ..simulation.integrators.exponential import DEGREE
from ..simulation.monitors.state_selection import Choice
from ..simulation.phase import PhaseOptions
from ..simulation.phases.cancellation import MOST_STATES, PLACES
from ..simulation.run_options import RunOptions, planned


@dataclass(frozen=True, slots=True, eq=False)
class BatchScene:
    """A compiled scene with the options of its runs; `instants` (points,) that they report, and `inputs` (U,), common to all."""

    compiled_scene: CompiledScene
    options: PhaseOptions
    instants: Any
    inputs: Any

    @property
    def program(self) -> Program:
        """Program of all runs."""
        return self.compiled_scene.program

    @property
    def whole(self) -> float:
        """Length of the runs, s."""
        return float(self.instants[-1] - self.instants[0])

    @property
    def linear(self) -> bool:
        """True if the matrix exponential integrates the runs."""
        return self.compiled_scene.certificate.linear

    def state_selection(self, constants: Array) -> Choice:
        """Return the monitor of the state selection of runs with these constants, (runs, K)."""
        return Choice(self.program, constants, self.inputs, self.compiled_scene.facts.storages, None)

    @property
    def numbers(self) -> int:
        """Count of the numbers that a run needs at once: states and outputs, or what drives the states at the nodes between the reported instants; or
        the states that are moved to find the terms of outputs."""
        states, outputs = len(self.program.variables.names), len(self.program.outputs.names)
        width = states * (2 * (DEGREE + 1) if self.linear else 1)
        return max(
            len(self.instants) * (width + outputs),
            len(PLACES) * (states + 1) * (states + outputs) * (states <= MOST_STATES),
        )


def batch_scene(model: CompiledModel, scene: Scene, wanted: RunOptions) -> BatchScene | None:
    """Return a scene whose runs may be stepped together; None if they need Python on their way, or more than steps. Raises `UsageError`."""
    target = chosen_target(wanted.target)
    if (
        target != "native"
        or scene.fixed
        or wanted.energy
        or wanted.error
        or wanted.check
        or wanted.extremes
        or wanted.parts != 1
    ):
        return None
    compiled_scene = model.compiled_scene(replace(scene, conserving=False), False, target)
    plan = compiled_scene.plan
    if many_runs(plan, scene) is not None:
        return None
    instants, options, accuracy = planned(plan, wanted, {})
    plain = options.solver == AUTOMATIC and options.bandwidth is None and accuracy is None
    if not plain or plan.equilibrium or not _has_only_steps(compiled_scene):
        return None
    return BatchScene(compiled_scene, options, instants, np.array(compiled_scene.program.input_defaults, dtype=float))


def _has_only_steps(compiled_scene: CompiledScene) -> bool:
    """Return True if a run of a program is one phase, whose steps end where time says so, and nothing but their errors is checked."""
    program, facts = compiled_scene.program, compiled_scene.facts
    if program.native is None or obstacle(program):
        return False
    with_events = program.hybrid is not None or program.delays is not None or facts.valves or facts.integrals
    with_loops = program.unknowns.names or program.invariants.names or facts.claims
    fits = 0 < len(program.states.names) <= LARGEST and not is_sparse(program)
    return fits and not (with_events or with_loops or program.watched)
