"""Values with which the instances of a unit begin, and tolerances: those of a run of the same model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import CompilationFailed, NotInUnit

from ..errors import RunFailed
from ..simulation.phase import Phase, PhaseOptions
from ..simulation.run_options import DEFAULT_RTOL

if TYPE_CHECKING:
    from compiler.api import Array, Compilation, Plan

    from ..compiled_scene import CompiledScene
    from ..simulation.segments.trajectory import Tolerances


MOST = 400  # states and unknowns of loops: matrices of an instance are dense, some 5 MB
SOME = 0.618  # beside an input: another value that it may have


@dataclass(frozen=True, slots=True)
class StartValues:
    """Values with which an instance begins, in SI, and its tolerances; the start as the text gives it; and a mask of the constraints that take part."""

    parameters: Any
    inputs: Any
    state: Any  # on the constraints, with the unknowns of loops
    tolerances: Tolerances
    written: Any
    taking: Any


def start_values(
    compiled_scene: CompiledScene, compilation: Compilation, plan: Plan, experiment: str | None, example: CompiledScene | None = None
) -> StartValues:  # fmt: skip
    """Return the start of a run. Raises `CompilationFailed` where a unit would begin with other states, `RunFailed`.

    `example`: the scene of the first experiment. Without inputs a model may rest, and magnitudes of states at rest say nothing.
    """
    program = compiled_scene.program
    if (count := len(program.variables.names)) > MOST:
        words = f"{count} states and unknowns of loops, of which {MOST} have room,"
        _refuse(compilation, words, "Export parts of the model: `compile -o NAME.ssp`.")
    stop = plan.stop if plan.stop is not None else plan.start + 1.0
    alone = plan if experiment is not None else replace(plan, equilibrium=False)
    options = PhaseOptions(alone, plan.settings.get("rtol", DEFAULT_RTOL), plan.settings.get("atol"), False)
    with np.errstate(all="ignore"):
        phase = Phase(compiled_scene, np.array([plan.start, stop]), options)
        tolerances = phase.tolerances()
        if example is not None:
            tolerances = _with_magnitudes(
                compiled_scene, tolerances, _magnitudes(example, phase.instants, replace(options, plan=plan))
            )
        written = np.asarray(program.start(phase.constants))
    constraints, count = phase.constraints, len(program.states.names)
    # Events may have acted at the start of a run, which an instance does by itself.
    by_itself = phase.events is not None or bool(constraints)
    if alone.equilibrium if by_itself else not np.array_equal(written[:count], phase.state[:count]):
        _refuse(compilation, "a start that has to be searched", "Give the starts of the storages themselves.")
    _refuse_open_outputs(compilation, phase)
    parameters = constraints.parameters if constraints else program.defaults
    begins = phase.state if constraints or program.unknowns.names else written
    return StartValues(parameters, program.input_defaults, begins, tolerances, written, constraints.taking)


def _refuse_open_outputs(compilation: Compilation, phase: Phase) -> None:
    """Refuse outputs without a value at the start, whatever the inputs are: no instance could begin."""
    of, mode = phase.constraints, phase.stretches[0].mode
    if not of.program.outputs.names:
        return
    with np.errstate(all="ignore"):
        tries = [
            of.program.output(phase.instants[:1], phase.state[None], inputs, of.constants, mode)[0]
            for inputs in (of.inputs, of.inputs + SOME * (1 + np.abs(of.inputs)))
        ]
    for name, values in zip(of.program.outputs.names, np.isfinite(tries).T, strict=True):
        if not values.any():
            words = "Give it a value there, as `a/b if b > 0 else 0`, or leave it out."
            _refuse(compilation, f"`{name}`, which has no value at the start (0/0, say),", words)


def _magnitudes(example: CompiledScene, instants: Array, options: PhaseOptions) -> Mapping[str, float]:
    """Return the magnitudes of states in an experiment, by name; none if it does not begin."""
    try:
        phase = Phase(example, instants, options)
        magnitudes = phase.tolerances().magnitude
    except RunFailed:
        return {}
    return dict(zip(phase.program.variables.names, magnitudes.tolist(), strict=True))


def _with_magnitudes(compiled_scene: CompiledScene, own: Tolerances, others: Mapping[str, float]) -> Tolerances:
    """Return tolerances with other magnitudes where they are known."""
    names = compiled_scene.program.variables.names
    magnitude = np.array([others.get(name, value) for name, value in zip(names, own.magnitude.tolist(), strict=True)])
    absolute = np.where(own.held, own.absolute, own.relative * magnitude)
    return replace(own, magnitude=magnitude, absolute=absolute)


def _refuse(compilation: Compilation, what: str, instead: str) -> None:
    raise CompilationFailed([NotInUnit(compilation.whole_graph.span, what, instead)])
