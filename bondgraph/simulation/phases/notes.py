"""Notes of a phase, and doubts about its tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...results.records import ToleranceDoubt
from ..segments.trajectory import Trajectory
from .failures import modes_in
from .solution import PhaseSolution

if TYPE_CHECKING:
    from ...compiled_scene import CompiledScene
    from ..constraints.constraints import Assembled
    from ..events.events import Events

TOO_LARGE = "too large for a double"  # of a cause: an overflow, whose sign is certain
ROUNDED = 3.0  # tolerances of rounding in a step from which a run warns
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
    return bool(np.max(trajectory.missed) > MISSED)


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
        from .open_loops import doubts_on_open_loops

        doubts += doubts_on_open_loops(solution)
    if solution.constraints and len(trajectory.states):
        from ..constraints.singular import doubts_of

        doubts += doubts_of(trajectory.poses)
    return tuple(doubts)
