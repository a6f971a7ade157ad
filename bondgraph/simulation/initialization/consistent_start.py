"""Consistent initialization: the unknowns of loops, and the states that the author's start values determine.

A start value of a state holds. A start value of a computed quantity (a storage in derivative form, an effort) is an initial equation: the
states without start value move by the least amount that satisfies all initial equations (Pantelides, SIAM J. Sci. Stat. Comput. 9, 1988, for the
problem). Initial equations that cannot all hold are an error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed
from ...numerics.scales import EPS
from ...quantities import behind
from ..constraints.constraints import Constraints
from ..loops.loops import LoopSolver
from ..segments.timeline import Segment
from .initial_equations import fulfil, slopes_of

if TYPE_CHECKING:
    from compiler.api import Array, BoolArray, IntArray, Program, StateSpace

    from ...compiled_scene import CompiledScene
    from .poses import PoseProblem

CLOSE = 1e-9  # relative residual with which an initial equation holds
ROUNDED = 4 * EPS  # relative to a start value: a residual that is none
ROUNDING = 1e-3  # relative to the size of a mechanism: least size of a start value in that test
DISTINCT = 1e-6  # relative difference of an unknown in two solutions
SHOWN = 4  # most solutions, and unknowns of each, in a message


def consistent_start(
    made: CompiledScene, constraints: Constraints, state: Array, first: Segment
) -> tuple[Any, tuple[str, ...]]:
    """Return the state at the start, shape (n,), and notes about it.

    Raises `RunFailed` if initial equations contradict each other or the start values of states, or if a loop has no solution.
    """
    loops, program = constraints.loops(), constraints.program
    time, mode, count = first.start, first.mode, constraints.count
    if not made.facts.claims and not constraints:
        full = loops.solve(time, state, mode)
        return _determined(loops, made, full, (time, mode))
    space = made.state_space

    def claims(x: Array) -> Any:
        return np.asarray(program.claims(time, x, constraints.inputs, constraints.constants, mode))

    notes: tuple[str, ...] = ()
    if constraints or any(c.on_pose for c in space.claims):
        from .poses import pose_problem

        state, notes = _with_pose(pose_problem(space, constraints, claims, (time, mode), state), state)
    movable = np.array([not s.given for s in space.states], dtype=bool)
    poses = np.array([s.drawn is not None for s in space.states], dtype=bool)
    rows = [i for i, c in enumerate(space.claims) if not c.on_pose]
    if constraints:
        poses[constraints.positions] = True
        full, several = _assembled(made, constraints, state, movable & ~poses, poses, first)
        return full, (*notes, *several)

    def missed(x: Array) -> tuple[Any, Any]:
        full = loops.solve(time, np.concatenate([x, state[count:]]), mode)
        return _missed(space, claims(full)), full

    x = fulfil(lambda y: missed(y)[0][rows], state[:count], movable & ~poses) if rows else state[:count]
    value, full = missed(x)
    reach = np.abs(value)
    if value.any():  # the size of the terms that an initial equation adds up: a value of zero has no size of its own
        terms = np.abs(x[x != 0])
        reach = np.abs(slopes_of(lambda y: missed(y)[0], x, x != 0, terms)) @ terms
    _check(constraints, space, value, reach, full, (time, mode))
    full, several = _determined(loops, made, full, (time, mode))
    return full, (*notes, *several)


def _missed(space: StateSpace, claims: Array) -> Any:
    """Return by how much the initial equations are missed, (claims,), zero where that is rounding of a start value: such a residual has no size."""
    missed, values = claims[: len(space.claims)], claims[len(space.claims) + len(space.moved) :]
    rounding = ROUNDED * np.maximum(np.abs(values), np.abs(values - missed))
    return np.where(np.abs(missed) <= rounding, 0.0, missed)


def _with_pose(problem: PoseProblem, state: Array) -> tuple[Any, tuple[str, ...]]:
    """Return the state with mechanisms in their initial pose, coordinates of the text exactly as given; and notes."""
    from .poses import posed

    found, note = posed(problem)
    for item in problem.given:
        if item.claim < 0:
            found[problem.places[item.state]] = item.value
    return found, () if note is None else (note,)


def _assembled(
    made: CompiledScene, constraints: Constraints, state: Array, movable: BoolArray, poses: BoolArray, first: Segment
) -> tuple[Any, tuple[str, ...]]:  # fmt: skip
    """Return the consistent state of a model with loop joints, the rates of whose residuals vanish as well, and notes."""
    from .assembly import choose_rows, measures, rates_closed

    time, mode, space, program = first.start, first.mode, made.state_space, constraints.program
    loops = constraints.loops()
    loose = len(program.unknowns.names) > 0 and not loops.affine  # initial equations may depend on other loops
    rows = [i for i, c in enumerate(space.claims) if not c.on_pose]

    def claims(x: Array) -> Any:
        if loose:
            x = loops.solve(time, x, mode)
        return _missed(space, np.asarray(program.claims(time, x, constraints.inputs, constraints.constants, mode)))

    claimed = [(space.claims[i].element, space.variables[space.claims[i].variable].unit) for i in rows]
    x = rates_closed(constraints, lambda y: claims(y)[rows], (time, mode), state, (movable, poses), claimed)
    constraints.assembled = choose_rows(constraints, time, x, mode)
    x = constraints.project(time, x, mode)
    value = claims(x)
    # a value that must be zero has the size of the mechanism, and of its motion, by which rounding is measured
    size = np.abs(x)
    size[: constraints.count] += ROUNDING * measures(constraints, time, x, mode)
    terms = size[size > 0]
    reach = np.abs(slopes_of(claims, x, size > 0, terms)) @ terms if value.any() else np.abs(value)
    _check(constraints, space, value, reach, x, (time, mode))
    loops = constraints.loops()  # with the rows that were chosen
    full = loops.solve(time, x, mode)
    return _determined(loops, made, full, (time, mode)) if loose else (full, ())


def _determined(loops: LoopSolver, made: CompiledScene, full: Array, at: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the state with the solution of each loop that the model determines, the only one or that nearest to guesses of the text, and notes of others.

    Raises `RunFailed` if a loop without a guess has several.
    """
    if not len(loops.program.unknowns.names):
        return full, ()
    from ..loops.branches import other_solutions

    others = other_solutions(loops, at[0], full, at[1])
    if not others:
        return full, ()
    solutions = np.array([full[loops.count :], *others])
    size = np.abs(solutions).max(axis=0)
    near, notes, space = np.asarray(loops.program.start(loops.constants))[loops.count :], list[str](), made.state_space
    for places in loops.separate():
        differ = places[np.ptp(solutions[:, places], axis=0) > DISTINCT * size[places]]
        if not len(differ):  # Newton's method led them all to one
            continue
        guessed = [i for i in differ if space.variables[space.unknowns[i].variable].value is not None]
        distance = np.abs((solutions[:, guessed] - near[guessed]) / size[guessed]).max(axis=1, initial=0.0)
        best = int(np.argmin(distance))
        apart = (np.abs(solutions - solutions[best]) > DISTINCT * size)[:, differ].any(axis=1)
        if distance[apart].min() - distance[best] <= DISTINCT:
            every = np.flatnonzero(np.ptp(solutions, axis=0) > DISTINCT * size)
            raise _several(made, loops.program, solutions, every, at[0])
        if apart[0]:
            full = loops.solve(at[0], np.concatenate([full[: loops.count], solutions[best]]), at[1])
            return _determined(loops, made, full, at)
        left, *rest = in_words(loops.program, solutions[[best, *np.flatnonzero(apart)]], differ)
        notes.append(
            f"nearest to its guess, of several solutions: {left}; not {'; '.join(rest)}; the run follows it from instant to instant"
        )
        solutions = solutions[~apart]
    return full, tuple(notes)


def in_words(program: Program, solutions: Array, differ: IntArray) -> list[str]:
    names, units = program.unknowns.names, program.unknowns.units
    lines = [
        ", ".join(f"`{names[i]}` = {z[i]:.6g}{behind(units[i])}" for i in differ[:SHOWN]) for z in solutions[:SHOWN]
    ]
    return [*lines, *([f"and {len(solutions) - SHOWN} more"] if len(solutions) > SHOWN else [])]


def _several(made: CompiledScene, program: Program, solutions: Array, differ: IntArray, time: float) -> RunFailed:
    """Error for a loop with several solutions."""
    space = made.state_space
    members = dict.fromkeys(m for i in differ for m in space.unknowns[i].members)
    elements = ", ".join(f"`{m}`" for m in list(members)[:6])
    line = space.unknowns[differ[0]].span.line
    return RunFailed(
        "BR734", f"at t = {time:.9g} s the algebraic loop of {elements} (line {line}) has more than one solution: "
        f"{'; '.join(in_words(program, solutions, differ))}.",
        "Nothing in the model chooses between them: put a small storage into the loop (a C beside what gives the flow, an I in line with what gives "
        "the effort) and start it near the one that you mean, or write the law so that only one is left; give what a `solve` looks for a guess near it",
    )  # fmt: skip


def _check(
    constraints: Constraints, space: StateSpace, value: Array, reach: Array, full: Array, at: tuple[float, Any]
) -> None:
    fixed = constraints.inputs, constraints.constants, at[1]
    others = np.asarray(constraints.program.claims(at[0], np.zeros(len(full)), *fixed))[: len(space.claims)]
    others = np.where(np.isfinite(others), others, value)  # not finite where all states are zero
    size = np.maximum(np.maximum(np.abs(value - others), np.abs(others)), reach)
    bad = [c for c, v, s in zip(space.claims, value, size, strict=True) if not abs(v) <= CLOSE * max(s, 1e-300)]
    if not bad:
        return
    names = ", ".join(f"`{n}`" for n in dict.fromkeys(c.element for c in bad))
    said = [space.variables[s.variable].name for s in space.states if s.given]
    against = f" together with those of {', '.join(f'`{n}`' for n in said[:6])}" if said else ""
    raise RunFailed(
        "BR735", f"the start of {names} (line {bad[0].span.line}) cannot hold{against}: the model ties them to each other;", "leave one of them out",
    )  # fmt: skip
