"""Placement of a model at the operating point that an analysis asks for: its rest, its start, or given states, in the mode that holds there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array, CompilationFailed

from ..compiled_scene import CompiledScene
from ..errors import RunFailed, UsageError
from ..keywords import AnalysisRequest
from ..numerics.threads import release_for
from ..simulation.segments.units import refuse_units
from .movable import differentiable_program, refuse_choice, refuse_structural
from .operating_point import OperatingPoint, length_of
from .reduced import led

if TYPE_CHECKING:
    from compiler.api import Scene

    from ..compiled_model import CompiledModel
    from ..simulation.events.complementarity import Companion
    from ..simulation.phase import Phase, PhaseOptions

    Prepare = Callable[[Scene, bool], CompiledScene]

SAME_REST = 1e-6  # relative to the largest state of its unit: difference of one rest found twice
# A part of a length of time, and refusals of one with too many instants.
SHORTER, TOO_MANY = 1e-5, ("BR761", "BR762", "BR763")
KEPT = 1e-9  # relative: change of what is stored where junctions go on or off


def operating_point(
    model: CompiledModel, asked: AnalysisRequest, target: str = "numpy", moved: Mapping[str, float] | None = None
) -> OperatingPoint:
    """Return the model at the requested point; numbers that are set are arguments of one program, so that others need no compilation.

    `moved`: values of `by` in a program that was made with the author's: decisions that depend on these (coinciding parts of a mechanism, a choice
    between laws) stay unchanged. Raises `CompilationFailed`, `UsageError`, `RunFailed`.
    """
    try:
        point = _point(model, asked, target, moved)
    except CompilationFailed:
        for name in asked.by:
            refuse_choice(name, model.compilation(model.scene(asked.experiment, asked.settings or {})))
        raise
    for name in asked.by:
        refuse_choice(name, point.made.compilation)
    if not asked.upstream or asked.state != "equilibrium" or point.made.certificate.linear:
        return point
    try:
        whole = _point(model, replace(asked, upstream=False, outputs=None), target, moved)
    except (RunFailed, UsageError):  # what lies downstream has no rest
        return point
    rest = dict(zip(whole.program.states.names, whole.state.tolist(), strict=False))
    program = point.program
    if _is_at(point, rest):
        return point
    if program.hybrid is not None:
        raise UsageError(
            "BR265", "the part on which these outputs depend has several rests, and finds another one than the whole model:", "name no outputs",
        )  # fmt: skip
    return _point(model, replace(asked, state={name: rest[name] for name in program.states.names}), target, moved)


def _is_at(point: OperatingPoint, rest: Mapping[str, float]) -> bool:
    """Return True if the states of a point are those of a rest, relative to the largest of their unit."""
    names, units = point.program.states.names, point.program.states.units
    largest: dict[str, float] = {}
    for name, unit in zip(names, units, strict=True):
        largest[unit] = max(largest.get(unit, 0.0), abs(rest[name]))
    far = np.abs(point.state[: len(names)] - [rest[name] for name in names])
    return bool((far <= SAME_REST * np.array([largest[unit] for unit in units])).all())


def _point(model: CompiledModel, asked: AnalysisRequest, target: str, moved: Mapping[str, float] | None) -> OperatingPoint:  # fmt: skip
    """Return the same, for a part at the rest that a search in the part finds."""
    from ..simulation.settings import settle

    def prepare(scene: Scene, everything: bool = True) -> CompiledScene:
        return model.compiled_scene(scene, everything, target)

    settings = asked.settings or {}
    settled = settle(model, asked.experiment, settings, asked.outputs, True, target)
    zeros = settled.scene.fixed
    if settled.values or moved:
        scene = replace(settled.scene, free=frozenset(asked.by), by=asked.by, upstream=asked.upstream)
        try:
            return placed(prepare, scene, asked, {**settled.values, **(moved or {})})
        except RunFailed:
            if moved or all(settled.values.values()):
                raise  # otherwise a zero may change the equations of the model: it is compiled in
            zeros = frozenset(name for name, value in settled.values.items() if value == 0)
    scene = model.scene(asked.experiment, settings, asked.by, asked.outputs)
    scene = replace(scene, by=asked.by, upstream=asked.upstream, fixed=zeros - {*asked.by})
    return placed(prepare, scene, asked)


def _delayed(made: CompiledScene) -> UsageError:
    """Return the refusal of a model with delays: the first of them, its line, and a law of states instead."""
    space = made.compilation.state_space
    first = space.delays[0]
    name, place = space.variables[first.value].name, f"{first.span.source.name}:{first.span.line}"
    what = "a signal" if name.startswith("what ") else f"`{name}`"
    return UsageError(
        "BR262", f"{place}: the `delay` of {what} is an earlier value and no state: no linear analysis is made.",
        "Simulate, or write for `delay(x, T)` Padé's first order, `2*z - x` with `signal z = integral(2*(x - z)/T, x0)`, which "
        "follows frequencies well below 1/T",
    )  # fmt: skip


def placed(prepare: Prepare, scene: Scene, asked: AnalysisRequest, values: Mapping[str, float] | None = None) -> OperatingPoint:  # fmt: skip
    """Return the same for a scene; `values` are set at the beginning."""
    from ..simulation.phase import PhaseOptions

    compiled = prepare(scene, True)
    program, plan = differentiable_program(compiled), compiled.plan
    refuse_structural(compiled.compilation, asked.by)
    if not isinstance(asked.state, Mapping) and asked.state not in ("equilibrium", "start"):
        raise UsageError("BR220", f"a state is `equilibrium`, `start` or values by name; not `{asked.state}`")
    begins = plan.start if asked.time is None else asked.time
    plan = replace(plan, equilibrium=asked.state == "equilibrium", start=begins, tolerances={})
    if program.delays is not None:
        raise _delayed(compiled)
    refuse_units(program.hybrid)
    release_for(len(program.states.names) + len(program.unknowns.names))
    with np.errstate(all="ignore"):
        leg = _phase(prepare, scene, PhaseOptions(plan, 1e-6, None, False, values or {}), length_of(compiled.plan))
        state, mode = leg.state, leg.stretches[0].mode
        if isinstance(asked.state, Mapping):
            left_out = compiled.certificate.unneeded if compiled.scene.upstream else ()
            state, mode = _given(leg, {n: v for n, v in asked.state.items() if n not in left_out}, begins, mode)
    point = OperatingPoint(leg.compilation, leg.constraints, state, mode, begins, asked.by, values).check_limits()
    point.notes = leg.start_notes
    return point


def _phase(prepare: Prepare, scene: Scene, options: PhaseOptions, length: float) -> Phase:
    """Return the phase with which a run begins. A single instant is asked for: where the instants of a length of time are too many, those of less are."""
    while True:
        try:
            return _Start(prepare, scene, options, options.plan.start + length).phase()
        except RunFailed as failed:
            length *= SHORTER
            if failed.code not in TOO_MANY or length <= np.spacing(abs(options.plan.start)):
                raise


@dataclass(frozen=True, slots=True)
class _Start:
    """Begin of a run without the run: a phase in which all junctions are as they are after the events at the start."""

    prepare: Prepare
    scene: Scene
    options: PhaseOptions
    until: float  # s: end of the time that is searched for instants

    def phase(self) -> Phase:
        """Return the phase. Raises `RunFailed` where there is none, and `UsageError` where an impulse passes at the start."""
        from ..simulation.phase import Phase, SwitchedStart
        from ..simulation.phases.start import no_rest

        plan, compiled, modes = self.options.plan, self.prepare(self.scene, True), dict[str, float]()
        span, tried = np.array([plan.start, self.until]), set[SwitchedStart]()
        companion, first = self._companion(compiled), None
        while True:
            try:
                leg = Phase(compiled, span, self.options, None, companion, modes)
            except RunFailed:
                if tried or companion is None or not companion.valves:
                    raise
                from ..simulation.events.begin import conducting_at_start

                modes, off = conducting_at_start(compiled, companion, plan.start)
                again = off, tuple(sorted(modes.items()))
            else:
                other = leg.begins_again(settled=True)
                if other is None:
                    break
                again, first = other, leg if first is None and leg.begins_without == leg.off else first
            if again in tried:
                raise no_rest() if plan.equilibrium else _switching()
            tried.add(again)
            compiled, modes = self.prepare(replace(self.scene, off=again[0]), True), dict(again[1])
        if first is not None:
            self._check_kept(first, leg, modes)
        return leg

    def _companion(self, compiled: CompiledScene) -> Companion | None:
        if not compiled.facts.valves:
            return None
        from ..simulation.events.begin import companion_of

        span = self.options.plan.start, self.until
        return companion_of(self.prepare, self.scene, compiled.facts, self.options.values, span)

    def _check_kept(self, first: Phase, last: Phase, modes: Mapping[str, float]) -> None:
        """Raise `UsageError` where a storage has to change at once when the junctions switch at the start."""
        from ..simulation.phase import Phase

        if self.options.plan.equilibrium:
            if not set(last.program.dependents.names) & set(first.program.states.names):
                return  # the rest is searched from the same stored quantities
            options = replace(self.options, plan=replace(self.options.plan, equilibrium=False))
            first = Phase(first.compilation, first.instants, options)
            last = Phase(last.compilation, last.instants, options, None, None, modes)
        before, after = stored(first), stored(last)
        common = [(before[n], after[n]) for n in before.keys() & after.keys()]
        if any(abs(a - b) > KEPT * max(abs(a), abs(b)) for a, b in common):
            raise _switching()


def stored(leg: Phase) -> dict[str, float]:
    """Return the stored quantities at the start of a phase by name."""
    program, constraints = leg.program, leg.constraints
    mode = leg.stretches[0].mode
    dependent = program.dependent(leg.stretches[0].start, leg.state, constraints.inputs, constraints.constants, mode)
    names = (*program.states.names, *program.dependents.names)
    return dict(zip(names, [*leg.state[: len(program.states.names)], *np.ravel(dependent)], strict=True))


def _switching() -> UsageError:
    return UsageError(
        "BR219", "junctions go on or off at the very start (`active`), and what is stored changes at once or nothing holds: no linear analysis is made there",
    )  # fmt: skip


def _given(leg: Phase, given: Mapping[str, float], time: float, mode: Array) -> tuple[Array, Array]:
    """Return the state with given values, on the constraints, with the unknowns that belong to it, and the mode that holds there.

    Raises `UsageError` where an event acts there that changes what is stored, or the junctions.
    """
    names = leg.program.states.names
    if any(n in leg.compilation.facts.following for n in given):
        given = led(leg.compilation.compilation, leg.parameters, given)
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise UsageError("BR221", f"`{unknown[0]}` is no state; states are {', '.join(names) or 'none'}")
    state = np.array(leg.state, dtype=float)
    for i, name in enumerate(names):
        state[i] = given.get(name, state[i])
    loops = leg.constraints.loops()
    state = loops.solve(time, leg.constraints.project(time, state, mode), mode)
    if leg.events is None:
        return state, mode
    from ..simulation.events.indicators import HybridState

    leg.events.measure(np.abs(state))
    after = leg.events.happen(HybridState(time, state, leg.events.guess(HybridState(time, state, mode))))
    if leg.events.actives(after) != leg.off or not np.allclose(after.state, state, rtol=KEPT, atol=0.0):
        raise _switching()
    return np.asarray(after.state), np.asarray(after.mode)
