"""Resumption of a run from the result of another: checks, the state to start from, and both results joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isclose
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from .segments.trajectory import PhaseTransition

if TYPE_CHECKING:
    from compiler.api import Array, Scene

    from ..compiled_scene import CompiledScene
    from ..results.checkpoint import Checkpoint
    from ..results.result import Result

SAME = 1e-12  # relative change of a parameter by writing and reading
SHOWN = 4  # most names in a message


def resumed(
    before: Result, made: Callable[[Scene, bool], CompiledScene], scene: Scene, values: Mapping[str, float], compiled_scene: CompiledScene, energy: bool,
    instants: Array,
) -> tuple[Scene, PhaseTransition, Any]:  # fmt: skip
    """Return the scene and the handover from which the run goes on, and its remaining output instants. Raises `UsageError`."""
    end = before.checkpoint
    if end is None:
        raise UsageError("BR721", "the result says nothing of where its run ended, so nothing goes on from it")
    _check_model(before, end, compiled_scene, values, energy)
    scene = replace(scene, preferences=end.preferences)
    hybrid = compiled_scene.program.hybrid
    if hybrid is not None and hybrid.junctions:
        scene = replace(scene, off=end.off)
    if made(scene, energy).facts.identity != end.identity:
        raise UsageError(
            "BR722", f"the result is of other equations than `{compiled_scene.program.name}` has now: its text, the settings of its inputs, "
            "the experiment or the outputs that are asked for are not the same",
        )  # fmt: skip
    left = instants[instants > end.time + 1e-12 * (instants[-1] - instants[0])]
    if not len(left):
        raise UsageError("BR723", f"the result ends at t = {end.time:.9g} s already:", "let the run go further (--to)")
    peaks, magnitudes = dict(end.peaks), end.magnitudes
    # beyond the horizon of the stored magnitudes: they hold for the past only
    if instants[-1] > end.until * (1 + SAME):
        for name, value in magnitudes.items():
            # a state that never moved has the magnitude 1 in SI, which has no meaning
            idle = value == 1.0 and end.stored.get(name) == 0.0
            peaks[name] = max(peaks.get(name, 0.0), 0.0 if idle else value)
        magnitudes = {}
    on = {(owner, place): truth for owner, place, truth in end.on}
    begin = PhaseTransition(
        end.time, end.stored, peaks, modes=end.modes, on=on, past=end.past, magnitudes=magnitudes, unknowns=end.unknowns
    )  # fmt: skip
    return scene, begin, left


def _check_model(before: Result, end: Checkpoint, compiled_scene: CompiledScene, values: Mapping[str, float], energy: bool) -> None:  # fmt: skip
    """Raise `UsageError` if the result belongs to another model, or has other outputs or other parameters."""
    program, plan = compiled_scene.program, compiled_scene.plan
    if before.model != program.name:
        raise UsageError("BR724", f"the result is of the model `{before.model}`, not of `{program.name}`")
    if before.experiment != plan.experiment:
        old, new = (f"`{e}`" if e is not None else "no experiment" for e in (before.experiment, plan.experiment))
        raise UsageError("BR725", f"the result is of {old}, this run of {new}:", "name the same with -e")
    if before.names != program.outputs.names:
        raise UsageError(
            "BR726", f"the result has the outputs {', '.join(before.names)}, this run {', '.join(program.outputs.names)}:", "ask for the same",
        )  # fmt: skip
    if energy and before.energy is None:
        raise UsageError(
            "BR727", "the result has no energy balance, so that of the whole cannot be told:", "run both with --energy, or none",
        )  # fmt: skip
    now = {n: values.get(n, d) for n, d in zip(program.parameters.names, program.defaults, strict=True)}
    other = [n for n in now if n in end.parameters and not isclose(now[n], end.parameters[n], rel_tol=SAME)]
    if other:
        told = "; ".join(f"`{n}` was {end.parameters[n]:.9g} and is {now[n]:.9g}" for n in other[:SHOWN])
        raise UsageError("BR728", f"the result is of other parameters: {told} (SI)")
    needed = program.states.names if program.hybrid is None or not program.hybrid.junctions else ()
    missing = [n for n in needed if n not in end.stored]
    if missing and set(now) != set(end.parameters):
        raise UsageError("BR729", f"the result knows nothing of {', '.join(f'`{n}`' for n in missing[:SHOWN])}")


def joined(before: Result, after: Result) -> Result:
    """Return both results as one."""
    from ..results.records import widest
    from ..results.truncation import joined as both
    from .monitors.energy import added

    before_both = before.time <= (after.time[0] if len(after.time) else np.inf)
    evaluations: Mapping[str, int] = {
        n: before.evaluations.get(n, 0) + after.evaluations.get(n, 0)
        for n in {**before.evaluations, **after.evaluations}
    }
    energies = [r.energy for r in (before, after) if r.energy is not None]
    first = {(w.owner, w.condition, w.place) for w in before.warnings}
    return replace(
        after, time=np.concatenate([before.time[before_both], after.time]), values=np.concatenate([before.values[before_both], after.values]),
        solver=" and ".join(dict.fromkeys([*before.solver.split(" and "), *after.solver.split(" and ")])), steps=before.steps + after.steps,
        evaluations=evaluations, energy=added(energies) if len(energies) == 2 else None,
        warnings=(*before.warnings, *(w for w in after.warnings if (w.owner, w.condition, w.place) not in first)),
        notes=tuple(dict.fromkeys([*before.notes, *after.notes])), events=(*before.events, *after.events),
        truncation=both(before.truncation, after.truncation),
        searched=tuple(map(widest, zip(before.searched, after.searched, strict=False))),
    )  # fmt: skip
