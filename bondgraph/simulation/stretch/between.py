"""States between the ends of a step that follow others at once: found from their own equations at the instants asked for, where polynomials are not sure.

At the ends of Radau's steps what is stiff lies where its rate nearly vanishes, however long the step; between them nothing holds a polynomial to it. There
the rates at an instant, less the slope of the polynomial, tell how far off it is, and Newton's method brings back what is stiff; all else stays as it is.
`compiled/between.py` is the same for machine code.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..steps.factorise import is_large
from ..steps.radau import BACK_ITERATIONS, LEFT, MU_REAL, NEAR, SLOW, STIFF, SURE, Radau, interpolated

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
    slope = interpolated(radau, times + NEAR * size) - interpolated(radau, times - NEAR * size)
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
    apart = np.abs(interpolated(radau, times) - radau.collocation(times))
    return inner & (apart > limit)[:, stiff].any(axis=1)


def _brought_back(radau: Radau, time: float, state: Any, slope: Any, stiff: Any, size: float) -> Any | None:
    """The state with what is stiff where its equations want it; None if Newton's method does not find that."""
    problem, count = radau.problem, radau.evaluations
    scale, new, before = problem.absolute + problem.relative * np.abs(state), np.array(state), np.inf
    slope = np.where(problem.differential, slope, 0.0)
    matrix: Any = None
    for _ in range(BACK_ITERATIONS):
        count["derivative"] += 1
        try:
            if matrix is None:
                count["jacobian"] += 1
                count["factorisation"] += 1
                matrix = problem.shifted(MU_REAL / size, problem.jacobian(time, new))
            change = matrix.solve(problem.function(time, new) - slope)
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            return None
        change = np.where(stiff | ~problem.differential, change, 0.0)
        norm = float((np.abs(change) / scale).max())
        if not np.isfinite(norm) or norm > 2 * before:
            return None
        matrix = None if norm > SLOW * before else matrix
        new, before = new + change, norm
        if norm < LEFT:
            return new
    return None
