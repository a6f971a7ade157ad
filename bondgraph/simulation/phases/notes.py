"""Notes of a phase, and doubts about its tolerances.

Doubtful are also results that depend on unknowns of loops which their equations leave open in double precision, as voltages of diodes that
block so well that no digit of a current shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array

from ...numerics.scales import nonzero
from ...results.records import ToleranceDoubt
from ..loops.loops import LoopSolver
from ..segments.trajectory import Trajectory
from .failures import modes_in
from .solution import PhaseSolution

if TYPE_CHECKING:
    from ...compiled_scene import CompiledScene
    from ..constraints.constraints import Assembled
    from ..events.events import Events

TOO_LARGE = "too large for a double"  # of a cause: an overflow, whose sign is certain
ROUNDED = 3.0  # tolerances of rounding in a step from which a run warns
FEW = 16  # instants that are looked at, at least
MANY = 40  # unknowns of which matrices are still cheap
SHARE = 1e-3  # of the largest value of an unknown: a change that its equations must show
TRIES = (1.0, -1.0, 0.5, -0.5, 0.25, -0.25)  # parts of it: rounding has the right sign for all of them hardly ever
FAINT = 1e-12  # of the largest terms of the equations: a smaller change may be below rounding
SHOWN = 0.5  # of what the slopes promise: less, or none, or the other sign, is rounding
MOVED = 1e-2  # of that change: an output that moves by more of its size depends on the unknown
SURE, BLURRED = 4.0, 1000.0  # in units of the rounding of a root: one is told that is larger, but nowhere by more
MISSED = 30.0  # tolerances by which rates that a step has missed would move a state, from which a run warns


def phase_notes(
    solution: PhaseSolution, timed: Sequence[str], events: Events | None, undetermined: Sequence[str], assembled: Assembled | None
) -> tuple[str, ...]:  # fmt: skip
    """Return the notes of an integrated phase. `timed`: on its segments; `undetermined`: on its program; `assembled`: of the first phase."""
    constraints, trajectory = solution.constraints, solution.trajectory
    resolutions, reached = {}, (trajectory.pieces or solution.planned)[-1].stop  # other programs go on there
    for segment in solution.planned:
        if segment.start > reached:
            break
        if segment.resolution is not None:
            resolutions[id(segment.resolution)] = segment.resolution
    notes = [*list(dict.fromkeys(trajectory.notes))[:1], *timed, *(n for r in resolutions.values() for n in r.notes)]
    if events is not None:
        from ..events.bounds import notes_on_conditions

        notes += () if events.units is None else events.units.notes
        notes += (*notes_on_conditions(constraints.program, events.crowded, events.touches), *undetermined)
    if constraints and len(trajectory.states):
        from ..constraints.singular import told_of

        notes += told_of(assembled, trajectory.poses)
    return tuple(notes)


def misses_rates(trajectory: Trajectory) -> bool:
    """Return True if a step has missed rates, by far more than the tolerance."""
    return type(trajectory.missed) is not float and bool(trajectory.missed.max() > MISSED)


def phase_doubts(
    solution: PhaseSolution, rtol: float, events: Events | None, compilation: CompiledScene
) -> tuple[ToleranceDoubt, ...]:
    """Return the warnings that steps were accepted with many tolerances of rounding, those of conditions that are infinite, and of singular poses."""
    trajectory, doubts = solution.trajectory, list[ToleranceDoubt]()
    for number, at in ({} if events is None else events.infinite).items():
        from ..monitors.finite import cause_of

        constraints, what = solution.constraints, events.listed_conditions([number]) if events else ""
        modes, space = modes_in(constraints, at.mode), compilation.state_space
        cause = cause_of(constraints.program, space, at.time, at.state, constraints.parameters, modes)
        if TOO_LARGE not in cause:
            text = (
                f"at t = {at.time:.9g} s {what} is infinite, with the sign of a zero, which rounding decides: {cause}"
            )
            doubts.append(ToleranceDoubt(at.time, what, "infinite condition", text, (), ""))
    if events is not None and events.blurs and len(trajectory.states):
        doubts += doubts_on_conditions(solution, events)
    if trajectory.rounded > ROUNDED:
        text = (
            f"rtol = {rtol:g} is below what rounding leaves: steps were accepted with {trajectory.rounded:.2g} tolerances of rounding; "
            f"rtol = {rtol * trajectory.rounded:.1g} is about the tightest that can be held"
        )
        doubts.append(ToleranceDoubt(float(solution.instants[0]), "", "tolerance below rounding", text, (), ""))
    if misses_rates(trajectory):
        worst = int(np.argmax(trajectory.missed))
        text = (
            f"a step has missed rates that would move `{solution.constraints.program.states.names[worst]}` by {trajectory.missed[worst]:.2g} tolerances: "
            "a law beside it is so steep, as a root at zero, that its slope tells nothing of where the solution is; give it a finite slope there"
        )
        doubts.append(ToleranceDoubt(float(solution.instants[0]), "", "missed rates", text, (), ""))
    if solution.constraints.program.unknowns.names:
        doubts += doubts_on_open_loops(solution)
    if solution.constraints and len(trajectory.states):
        from ..constraints.singular import doubts_of

        doubts += doubts_of(trajectory.poses)
    return tuple(doubts)


def doubts_on_conditions(solution: PhaseSolution, events: Events) -> list[ToleranceDoubt]:
    """Return a warning on each condition that the flow has contradicted and that is at most a thousand times its rounding in the whole phase."""
    from ..integrators.acceptance.event_indicators import NOISE

    times, states = solution.instants[: len(solution.trajectory.states)], solution.trajectory.states
    roots = [events.roots(times[i:j], states[i:j], mode) for mode, i, j in solution.modes() if i < j]
    largest = np.abs(np.concatenate(roots)).max(axis=0)
    doubts = []
    for number, (time, noise) in events.blurs.items():
        if SURE * noise < largest[number] < BLURRED * noise:
            what = events.listed_conditions([number])
            text = (
                f"near t = {time:.9g} s {what} compares numbers that are {noise / (NOISE * largest[number]):.1g} times as large as their difference: "
                "rounding may decide when it changes; make what is between them less stiff"
            )
            doubts.append(ToleranceDoubt(time, what, "blurred condition", text, (), ""))
    return doubts


def doubts_on_open_loops(solution: PhaseSolution) -> tuple[ToleranceDoubt, ...]:
    """Return a warning on outputs, and states by their rates, that move with unknowns while the equations of these do not show it."""
    program, constraints = solution.constraints.program, solution.constraints
    states = solution.trajectory.states
    if not len(states) or not 0 < len(program.unknowns.names) <= MANY or np.ndim(constraints.inputs) > 1:
        return ()
    loops = constraints.loops()
    if loops.affine:
        return ()
    segments, chosen = solution.segments, np.arange(0, len(states), max(1, len(states) // FEW))
    which = np.searchsorted([s.stop for s in segments[:-1]], solution.instants[chosen], side="right").tolist()
    keys = [segments[w].mode.tobytes() for w in which]
    size = nonzero(np.abs(states).max(axis=0))
    names, since = set[str](), np.inf
    for key in dict.fromkeys(keys):
        rows = chosen[[k == key for k in keys]]
        mode = segments[which[keys.index(key)]].mode
        for row, move in _open_moves(loops, solution.instants[rows], states[rows], mode, size[loops.count :]):
            moved = _moved_names(solution, float(solution.instants[rows[row]]), states[rows[row]], move, mode, size)
            since = min(since, float(solution.instants[rows[row]])) if moved else since
            names |= moved
    if not names:
        return ()
    listed = ", ".join(f"`{n}`" for n in sorted(names))
    text = (
        f"at t = {since:.9g} s the equations do not determine {listed} in double precision, as where diodes block: other values solve them to rounding too; "
        "a resistance beside what blocks, as its leak, decides them"
    )
    return (ToleranceDoubt(since, "", "loops open to rounding", text, (), ""),)


def _open_moves(loops: LoopSolver, times: Array, states: Array, mode: Array, size: Array) -> list[tuple[int, Array]]:
    """Return moves of the unknowns, each with the row of its instant, of which the equations do not show what their slopes promise."""
    count = loops.count
    matrices = loops.matrix(times, states, mode, states[:, count:])
    terms = nonzero((np.abs(matrices) @ size).max(axis=0))
    scaled = matrices * size / terms[:, None]
    if not np.isfinite(scaled).all():
        return []
    try:
        largest = np.abs(np.linalg.inv(scaled)).max(axis=(1, 2))
    except np.linalg.LinAlgError:  # one of them has no inverse
        largest = np.full(len(times), np.inf)
    found = []
    for row in np.flatnonzero(FAINT * len(terms) * largest >= SHARE).tolist():
        into, values, along = np.linalg.svd(scaled[row])
        for k in np.flatnonzero(SHARE * values <= FAINT).tolist():
            share = SHARE / np.abs(along[k]).max()
            move, z = share * size * along[k], states[row, count:]
            tried = z + np.array((0.0, *TRIES))[:, None] * move
            changes = loops.residual(times[row], states[row], mode, tried) / terms
            shown = (changes[1:] - changes[0]) @ into[:, k] / np.array(TRIES)
            if not (shown > 0).all() or shown.max() < SHOWN * share * values[k]:
                found.append((row, move))
    return found


def _moved_names(solution: PhaseSolution, time: float, state: Array, move: Array, mode: Array, size: Array) -> set[str]:
    """Return the outputs, and the states by their rates, that a move of the unknowns changes."""
    program, constraints, count = solution.constraints.program, solution.constraints, len(state) - len(move)
    pair = np.stack([state, np.concatenate([state[:count], state[count:] + move])])
    times = np.full(2, time)
    outputs = solution.output(times, pair, mode)
    rates = program.derivative(times, pair, constraints.inputs, constraints.constants, mode)[:, :count]
    span = solution.instants[-1] - solution.instants[0]
    least = MOVED * SHARE
    moved = np.abs(outputs[1] - outputs[0]) > least * np.abs(outputs).max(axis=0)
    steered = span * np.abs(rates[1] - rates[0]) > least * size[:count]
    return {n for n, m in zip((*program.outputs.names, *program.states.names), (*moved, *steered), strict=True) if m}
