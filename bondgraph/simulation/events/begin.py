"""Initial mode of a run with events, and of a phase that goes on in another program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from compiler.api import Array, Program, RunMetadata, Scene

from ...compiled_scene import CompiledScene
from ...errors import RunFailed
from ..constraints.constraints import Constraints
from ..initialization.assembly import choose_rows
from ..initialization.consistent_start import consistent_start
from ..segments.timeline import Segment, with_discrete_variables
from ..segments.trajectory import PhaseTransition
from ..segments.units import units_of
from .complementarity import Companion, Instant
from .events import Events
from .impulse import StorageJump, after_impulse, refuse_vanishing_hold
from .indicators import EventIndicators, HybridState, conditions_of
from .mode_iteration import settled
from .resets import reset

MOST_MODES = 30  # modes tried at a start


def companion_of(
    made: Callable[[Scene, bool], CompiledScene], scene: Scene, facts: RunMetadata, values: Mapping[str, float], ends: tuple[float, float]
) -> Companion:  # fmt: skip
    """Return the companion model of the switched junctions of a scene, which valves and integrals need. `ends`: of the run."""

    def network(off: tuple[str, ...]) -> CompiledScene:
        alone = replace(scene, preferences=(), off=off, companion=True, conserving=False, by=(), upstream=False)
        return made(alone, False)

    companion = Companion(facts, network, values, ends[1] - ends[0], conditions_of)
    companion.switched(ends[0])
    return companion


def conducting_at_start(
    first: CompiledScene, companion: Companion, start: float
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the modes of the valves at the beginning of a run that the start values require, and the junctions that are off with them."""
    hybrid = first.program.hybrid
    assert hybrid is not None
    own = {v.junction for v in companion.valves}
    off = {j for j in first.compilation.off if j not in own}
    modes = companion.begin(start, tuple(off))
    off |= {v.junction for v in companion.valves if modes[v.mode] == v.conducting}
    return modes, tuple(name for name, _ in hybrid.junctions if name in off)


def with_modes(program: Program, first: Segment, modes: Mapping[str, float]) -> Segment:
    """Return a segment with initial values of some discrete variables."""
    assert program.hybrid is not None
    return replace(first, mode=with_discrete_variables(program.hybrid, first.mode, modes))


def with_mode(space: CompiledScene, constraints: Constraints, state: Array, first: Segment, horizon: float) -> Segment:
    """Return the first segment with the mode that fits the consistent initial state. Raises `RunFailed` if there is none."""
    indicators = EventIndicators(constraints, np.abs(state), horizon)
    indicators.record.put({"until": first.stop})
    mode = indicators.guess(HybridState(first.start, state, first.mode))
    if (
        indicators.hybrid.junctions
        and indicators.actives(HybridState(first.start, state, mode)) != space.compilation.off
    ):
        return replace(first, mode=mode)  # its laws are those of another program, which decides what rounding hides
    seen = set()
    for _ in range(MOST_MODES):
        first = replace(first, mode=mode)
        full, _ = consistent_start(space, constraints, state, first)
        indicators.measure(np.abs(full))
        found = settled(indicators, HybridState(first.start, full, mode)).mode
        if (found == mode).all():
            return first
        mode = found
        if mode.tobytes() in seen:
            break
        seen.add(mode.tobytes())
    raise RunFailed(
        "BR773", f"at t = {first.start:.9g} s the starts and the conditions of the model contradict each other"
    )


def begun(
    constraints: Constraints, full: Array, first: Segment, horizon: float, companion: Companion | None
) -> tuple[Events, HybridState]:
    """Return the events of a run, and the hybrid state after all events at its beginning."""
    events = Events(constraints, np.abs(full), horizon, companion=companion)
    events.record.put({"until": first.stop})
    events.units = units_of(
        events.hybrid, dict(zip(events.sampled.tolist(), events.sampling[:, 0], strict=True)), first.start
    )
    start = HybridState(first.start, full, first.mode)
    if events.units is not None:  # what they give at the start is there before anything reads it
        start = reset(events, start, list(events.units.units))
        start = replace(start, mode=events.guess(start))
    if events.valves is not None:
        events.valves.begin(events, first.start)
    moment = events.happen(start, due=events.due(first.start))
    events.tell_valves(first.mode)
    return events, moment


def continued(
    constraints: Constraints, state: Array, first: Segment, begin: PhaseTransition, horizon: float, companion: Companion | None, before: Events | None
) -> tuple[Events, HybridState, tuple[StorageJump, ...]]:  # fmt: skip
    """Return the events of a run that goes on in this program, the hybrid state at that instant, and the jumps there. `before`: those of the last phase
    of the program."""
    program = constraints.program
    hybrid = program.hybrid
    assert hybrid is not None
    full = carried_over(constraints, state, first, begin)
    mode = with_discrete_variables(hybrid, first.mode, begin.modes)
    known = np.array([begin.magnitudes.get(n) or begin.peaks.get(n, 0.0) for n in program.variables.names])
    magnitude = np.where(known > 0, known, np.abs(full))
    if before is None:
        events = Events(constraints, magnitude, horizon, companion=companion)
    else:
        events = before.anew(magnitude)
    events.units, events.on = begin.units, dict(begin.on)
    events.record.record.until = first.stop
    mode = events.guess(HybridState(first.start, full, mode))
    jumps: tuple[StorageJump, ...] = ()
    if hybrid.junctions:
        full, jumps = after_impulse(
            constraints, first.start, full, mode, begin.stored, {**begin.peaks, **begin.magnitudes}
        )
        if (jumps or constraints) and begin.left is not None and not (companion is not None and companion.valves):
            refuse_vanishing_hold(*begin.left, events, HybridState(first.start, full, mode), jumps, begin.peaks)
        if jumps and companion is not None:
            full, passed = _through_integrals(program, full, begin, companion, jumps)
            jumps += passed
    return events, events.happen(HybridState(first.start, full, mode)), jumps


def _through_integrals(
    program: Program, full: Array, begin: PhaseTransition, companion: Companion, storages: tuple[StorageJump, ...]
) -> tuple[Any, tuple[StorageJump, ...]]:
    """Return the state with the contribution of an impulse to the integrals of the model, and their jumps. `storages`: jumps of stored quantities."""
    if not any(n in companion.integrals for n in program.states.names):
        return full, ()
    at = Instant(begin.time, begin.stored, begin.modes, begin.off or ())
    full, jumps = np.array(full), []
    for name, jump in companion.impulses(at, {j.name: j.after - j.before for j in storages}).items():
        if name not in program.states.names:
            continue
        place = program.states.names.index(name)
        before = float(full[place])
        full[place] += jump
        if full[place] != before:
            jumps.append(StorageJump(name, program.states.units[place], before, float(full[place])))
    return full, tuple(jumps)


def carried_over(constraints: Constraints, state: Array, first: Segment, begin: PhaseTransition) -> Any:
    """Return the stored quantities of a transition as a state on the constraints, whose independent rows are chosen again.

    Unknowns of loops stay as they were where their names are known, which preserves the branch among several solutions; else as in `state`.
    """
    states, unknowns = (names.names for names in (constraints.program.states, constraints.program.unknowns))
    followed = [begin.unknowns.get(n, float(x)) for n, x in zip(unknowns, state[len(states) :], strict=True)]
    full = np.array([*map(begin.stored.__getitem__, states), *followed])
    if not constraints:
        return full
    constraints.assembled = choose_rows(constraints, first.start, full, first.mode)
    return constraints.project(first.start, full, first.mode)
