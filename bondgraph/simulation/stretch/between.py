"""Stiff interpolation: stiff states between the ends of a step, computed from their own equations where the polynomials are not accurate.

At the ends of Radau's steps a stiff state lies where its rate nearly vanishes, however long the step; between them a polynomial is not bound to
that. The rates at an instant, minus the derivative of the polynomial, give the residual, and Newton's method corrects the stiff states; all others
stay unchanged. `compiled/between.py` is the same for machine code.
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
    """Return a mask of the states that are stiff in a step of this size, from the Jacobian of the scaled states."""
    rows, _ = stepper.program.pattern
    total = np.zeros(len(stepper.program.states.names) + len(stepper.program.unknowns.names))
    np.add.at(total, rows, np.abs(entries))
    return (total * size > STIFF) & (np.arange(len(total)) < len(stepper.program.states.names))


def settled(stepper: Stepper, radau: Radau, times: Any) -> Any:
    """Return scaled states within the last step of Radau; shape (times, n)."""
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
    """Return a mask of the instants within the last step at which two polynomials disagree on the stiff states."""
    start, stop = radau.last_step
    inner = (times > start) & (times < stop)
    if not radau.has_quintic:
        return inner
    after = radau.state_at_end
    limit = SURE * (radau.problem.absolute + radau.problem.relative * np.abs(after))
    apart = np.abs(radau.interpolated(times) - radau.collocation(times))
    return inner & (apart > limit)[:, stiff].any(axis=1)


def _brought_back(radau: Radau, time: float, state: Any, slope: Any, stiff: Any, size: float) -> Any | None:
    """Return the state with its stiff part corrected by its equations; None if Newton fails with the factors of the step and with new ones."""
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
    """Iterate Newton's method from a state, with a matrix or one that is renewed where convergence slows down; None if it fails."""
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
