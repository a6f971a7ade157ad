"""One run: the plan with its overrides, the program, the integrator, the result."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import SOLVERS, CompilationFailed, Scene

from ..compiled_model import CompiledModel
from ..compiled_scene import CompiledScene, chosen_target, many_runs
from ..errors import RunFailed, StepsCollapsed, UsageError
from ..memo import keep
from ..numerics.threads import OneThread
from ..results.result import Result
from .phase import Phase, PhaseOptions
from .phase_sequence import PhaseSequence
from .phases.notes import misses_rates
from .run_options import RunOptions, RunRequest, planned
from .segments.run_values import MOST
from .settings import refused_with_values, settle


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """Scene of a run as its solver needs it, compiled; the reported instants (points,), the options of its phases, and its accuracy, if it has one."""

    scene: Scene
    compiled_scene: CompiledScene
    instants: Any
    options: PhaseOptions
    accuracy: float | None
    left: dict[object, Phase] = field(default_factory=dict)  # phases of runs without events, by values, for other runs


def simulate_once(model: CompiledModel, request: RunRequest, start: Result | None = None) -> Result:
    """Run a model as requested. `start`: a result from which the run goes on.

    A `RunFailed` or `RunInterrupted` carries the result up to the instant at which it was raised.
    """
    experiment, settings, outputs = request.experiment, request.settings, request.outputs
    energy = request.options.energy or (start is not None and start.energy is not None)
    target, by_name = chosen_target(request.options.target), request.options.target == "native"
    wanted = _completed(request.options, target, energy)
    settled = settle(model, experiment, settings, outputs, energy, target)
    try:
        result = run(model, settled.scene, settled.values, wanted, start)
    except RunFailed:
        # Zeros that cancel (1 m + off beside 1 m) are no divisors to the eye: the equations in which they are zero decide.
        zeros = frozenset(name for name, value in settled.values.items() if value == 0)
        settled = replace(settled, scene=replace(model.scene(experiment, settings, (), outputs), fixed=zeros))
        found = _with_zeros(model, settled.scene, wanted, start) if zeros else None
        if found is None:
            if settled.values:
                refused_with_values(model, experiment, settings, outputs)
            raise
        result = found
    if by_name:
        result = replace(result, notes=(*result.notes, *_without_machine_code(model, settled.scene, wanted, target)))
    if not settled.scene.fixed:
        return result
    names = ", ".join(f"`{n} = 0`" for n in sorted(settled.scene.fixed))
    note = f"{names}: the equations are others than with values that are not zero, and were made for this run"
    return replace(result, notes=(*result.notes, note))


@lru_cache
def _completed(options: RunOptions, target: str, energy: bool) -> RunOptions:
    return replace(options, target=target, energy=energy)


def _without_machine_code(model: CompiledModel, scene: Scene, wanted: RunOptions, target: str) -> tuple[str, ...]:
    """Return the note that a run by machine code, which was asked for by name, went on in numpy; none if it did not."""
    plan: PlannedRun = model.recall(("run", scene, wanted), lambda: _planned(model, scene, wanted, target))
    if plan.compiled_scene.program.native is not None:
        return ()
    why = "what is delayed is filled in by Python" if plan.compiled_scene.program.delays else "it could not be made"
    return (f"there is no machine code of this model: {why}; it ran as the target numpy, as accurately and slower",)


def _with_zeros(model: CompiledModel, scene: Scene, wanted: RunOptions, start: Result | None) -> Result | None:
    """Run the scene in which parameters set to zero are compiled in; return None if that fails as well."""
    try:
        return run(model, scene, {}, wanted, start)
    except (CompilationFailed, RunFailed):
        return None


def run(
    model: CompiledModel, scene: Scene, values: Mapping[str, float], wanted: RunOptions, start: Result | None = None
) -> Result:
    """Run a scene of a model; `values` are parameters set when it begins. Roots are unknowns of the steps where these collapse or miss rates otherwise."""
    try:
        return _run(model, scene, values, wanted, start)
    except StepsCollapsed as failed:
        plan = model.recall(
            ("run", scene, wanted), lambda: _planned(model, scene, wanted, wanted.target or chosen_target(None))
        )
        if not plan.compiled_scene.facts.steep:
            raise
        with suppress(CompilationFailed, RunFailed, UsageError):
            return _run(model, replace(scene, steep=True), values, wanted, start)
        raise failed


def _run(
    model: CompiledModel, scene: Scene, values: Mapping[str, float], wanted: RunOptions, start: Result | None
) -> Result:
    began, as_written = clock.perf_counter(), scene
    energy, target = wanted.energy, wanted.target or chosen_target(None)

    def made(scene: Scene, everything: bool) -> CompiledScene:
        if scene is plan.scene and everything == energy:
            return plan.compiled_scene
        return model.compiled_scene(scene, everything or scene.conserving, target)

    plan = model.recall(("run", scene, wanted), lambda: _planned(model, scene, wanted, target))
    scene, compiled_scene = plan.scene, plan.compiled_scene
    before = None if start is None else start.checkpoint
    if before is not None and scene.from_start and before.identity != compiled_scene.facts.identity:
        scene = replace(scene, from_start=False)  # what nothing excites here may have moved in a run of other starts
        compiled_scene = made(scene, energy)
    run = PhaseSequence(made, scene, plan.options.at(values), plan.instants.copy(), began)
    run.accuracy = plan.accuracy
    key = tuple(values), np.array([*values.values()]).tobytes()
    if start is None:
        run.again = plan.left.pop(key, None)
    else:
        from .resume import resumed

        run.scene, run.begin, run.instants = resumed(start, made, scene, values, compiled_scene, energy, run.instants)
        run.before = start
    try:
        program = compiled_scene.program
        # values that are not finite are searched and reported by name
        with np.errstate(all="ignore"), OneThread(len(program.states.names) + len(program.unknowns.names)):
            run.go()
    except RunFailed as failed:
        failed.result = run.cut(f"it failed: {failed}")
        raise
    except KeyboardInterrupt:
        result = run.cut("it was interrupted")
        if result is None:
            raise
        from ..errors import RunInterrupted

        interrupted = RunInterrupted(f"interrupted at t = {run.reached:.9g} s")
        interrupted.result = result
        raise interrupted from None
    except UsageError:  # the requested solver cannot run this model
        raise
    except CompilationFailed as failed:
        if not run.legs:
            raise
        raise _uncompiled(run, failed) from failed
    except Exception as broken:
        if run.leg is None:  # no phase has begun: the exception passes on unchanged
            raise
        from ..errors import RunBroken

        what = f"{type(broken).__name__}: {broken}"
        result = run.cut(f"it broke off: {what}")
        error = RunBroken("BR710", f"{what}, after t = {run.reached:.9g} s")
        error.result = result
        raise error from broken
    if not as_written.steep and compiled_scene.facts.steep and any(misses_rates(leg.trajectory) for leg in run.legs):
        with suppress(CompilationFailed, RunFailed, UsageError):
            return _run(model, replace(as_written, steep=True), values, wanted, start)
    result = run.result("")
    phase = run.legs[0].left() if len(run.legs) == 1 and start is None else None
    if phase is not None:
        keep(plan.left, key, phase, MOST)
    return result


def _planned(model: CompiledModel, scene: Scene, wanted: RunOptions, target: str) -> PlannedRun:
    """Return the plan of all runs of a scene with the same options. Raises `ManyRuns` and `UsageError`."""

    def made(scene: Scene) -> CompiledScene:
        return model.compiled_scene(scene, wanted.energy or scene.conserving, target)

    scene = _conserving(scene, wanted.solver)
    plan = made(scene).plan
    many = many_runs(plan, scene)
    if many is not None:
        raise many
    instants, options, accuracy = planned(plan, wanted, {})
    scene = _conserving(scene, options.solver)
    return PlannedRun(scene, made(scene), instants, options, accuracy)


def _conserving(scene: Scene, solver: str | None) -> Scene:
    """Return the scene compiled for this solver: with or without the stored energy."""
    wanted = solver in SOLVERS and SOLVERS[solver].conserving
    return scene if scene.conserving == wanted else replace(scene, conserving=wanted)


def _uncompiled(run: PhaseSequence, failed: CompilationFailed) -> RunFailed:
    """Return the failure of a run whose model has no equations after junctions went on or off, or after another state selection."""
    begin = run.begins_now
    off = () if begin is None or begin.off is None else begin.off
    how = f" without {', '.join(f'`{name}`' for name in off)}" if off else " with other states"
    told = "; ".join(d.sentence for d in failed.diagnostics[:3])
    time = run.reached if begin is None else begin.time
    found = RunFailed("BR709", f"at t = {time:.9g} s the model goes on{how}, and then has no equations: {told}")
    found.result = run.cut(f"it failed: {found}")
    return found
