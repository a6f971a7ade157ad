"""Values with which the instances of a unit begin, and tolerances: those of a run of the same model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import CompilationFailed, NotInUnit

from ..simulation.integrators.compiled.fields import is_sparse
from ..simulation.phase import Phase, PhaseOptions
from ..simulation.run import DEFAULT_RTOL

if TYPE_CHECKING:
    from compiler.api import Compilation, Plan

    from ..compiled_scene import CompiledScene
    from ..simulation.segments.trajectory import Tolerances


@dataclass(frozen=True, slots=True)
class StartValues:
    """Values with which an instance begins, in SI, and its tolerances."""

    parameters: Any
    inputs: Any
    state: Any
    tolerances: Tolerances


def start_values(
    compiled_scene: CompiledScene, compilation: Compilation, plan: Plan, experiment: str | None
) -> StartValues:
    """Return the start of a run. Raises `CompilationFailed` where a unit would begin with other states, `RunFailed`."""
    program = compiled_scene.program
    if is_sparse(program):
        _refuse(
            compilation, f"{len(program.states.names)} states whose equations are sparse", "Export a smaller model."
        )
    stop = plan.stop if plan.stop is not None else plan.start + 1.0
    alone = plan if experiment is not None else replace(plan, equilibrium=False)
    options = PhaseOptions(alone, plan.settings.get("rtol", DEFAULT_RTOL), plan.settings.get("atol"), False)
    with np.errstate(all="ignore"):
        phase = Phase(compiled_scene, np.array([plan.start, stop]), options)
        tolerances = phase.tolerances()
        written = np.asarray(program.start(phase.constants))
    if not np.array_equal(written, phase.state):
        _refuse(compilation, "a start that has to be searched", "Give the starts of the storages themselves.")
    return StartValues(program.defaults, program.input_defaults, phase.state, tolerances)


def _refuse(compilation: Compilation, what: str, instead: str) -> None:
    raise CompilationFailed([NotInUnit(compilation.whole_graph.span, what, instead)])
