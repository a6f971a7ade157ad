"""States between the ends of a step that follow others at once: found from their own equations at the instants asked for, where polynomials are not sure.

At the ends of Radau's steps what is stiff lies where its rate nearly vanishes, however long the step; between them nothing holds a polynomial to it. There
the rates at an instant, less the slope of the polynomial, tell how far off it is, and Newton's method brings back what is stiff; all else stays as it is.
`compiled/between.py` is the same for machine code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..steps.factorise import is_large
from ..steps.radau import (
    BACK_ITERATIONS,
    BACK_PATIENT,
    LEFT,
    MU_REAL,
    NEAR,
    SLOW,
    STIFF,
    SURE,
    Factorised,
    Radau,
)

if TYPE_CHECKING:
    from .stepper import Stepper


def stiff_states(stepper: Stepper, entries: Any, size: float) -> Any:
    """Which states follow at once in a step of that size, by the Jacobian of scaled states."""
    rows, _ = stepper.program.pattern
    total = np.zeros(len(stepper.program.states.names) + len(stepper.program.unknowns.names))
    np.add.at(total, rows, np.abs(entries))
    return (total * size > STIFF) & (np.arange(len(total)) < len(stepper.program.states.names))


def settled(stepper: Stepper, radau: Radau, times: Any) -> Any:
    """Scaled states within the last step of Radau; shape (times, n)."""
    states, size = radau.sample(times), radau.last_step[1] - radau.last_step[0]
    entries = radau.jacobian
    left = entries is None or stepper.constraints or is_large(states.shape[1], len(entries))
    stiff = np.zeros(0, dtype=bool) if left else stiff_states(stepper, entries, size)
    if not stiff.any():
        return states
    unsure = unsure_at(radau, times, stiff)
    if not unsure.any():
        return states
    slope = radau.interpolated(times + NEAR * size) - radau.interpolated(times - NEAR * size)
    for k in np.flatnonzero(unsure):
        found = _brought_back(radau, times[k], states[k], slope[k] / (2 * NEAR * size), stiff, size)
        if found is not None:
            states[k] = found
    return states


def unsure_at(radau: Radau, times: Any, stiff: Any) -> Any:
    """At which instants within the last step the polynomials do not agree on what is stiff."""
    start, stop = radau.last_step
    inner = (times > start) & (times < stop)
    if not radau.has_quintic:
        return inner
    after = radau.state_at_end
    limit = SURE * (radau.problem.absolute + radau.problem.relative * np.abs(after))
    apart = np.abs(radau.interpolated(times) - radau.collocation(times))
    return inner & (apart > limit)[:, stiff].any(axis=1)


def _brought_back(radau: Radau, time: float, state: Any, slope: Any, stiff: Any, size: float) -> Any | None:
    """The state with what is stiff where its equations want it; None if Newton does not find that with the factors of the step, or its own."""
    problem, count = radau.problem, radau.evaluations
    slope = np.where(problem.differential, slope, 0.0)

    def renewed(at: Any) -> Any:
        count["jacobian"] += 1
        count["factorisation"] += 1
        return problem.shifted(MU_REAL / size, problem.jacobian(time, at))

    def missed(at: Any) -> Any:
        count["derivative"] += 1
        return problem.function(time, at) - slope

    wanted = stiff | ~problem.differential
    scale = problem.absolute + problem.relative * np.abs(state)
    try:
        found = _found(missed, state, wanted, scale, radau.factors, None)
        return found if found is not None else _found(missed, state, wanted, scale, None, renewed)
    except (ValueError, RuntimeError, np.linalg.LinAlgError):
        return None


def _found(
    missed: Callable[[Any], Any], state: Any, wanted: Any, scale: Any, matrix: Factorised | None, renewed: Callable[[Any], Factorised] | None
) -> Any | None:  # fmt: skip
    """Newton's method from a state, with a matrix or with one that is made anew where it slows down; None if it does not get there."""
    new, before, slow = state, np.inf, 0
    for _ in range(BACK_ITERATIONS):
        if matrix is None:
            assert renewed is not None
            matrix = renewed(new)
        change = np.where(wanted, matrix.solve(missed(new)), 0.0)
        norm = float((np.abs(change) / scale).max())
        slow = slow + 1 if norm > SLOW * before else 0
        if not np.isfinite(norm) or norm > 2 * before or slow > (BACK_PATIENT if renewed else 0):
            return None
        matrix = None if slow else matrix
        new, before = new + change, norm
        if norm < LEFT:
            return new
    return None
