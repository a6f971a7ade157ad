"""What is stored when other junctions are on: kept, but where storages are now tied to each other, an impulse passes between them.

An impulse does no work on any motion that the ties allow: for all of those, the sum of conjugate (flow of an inertia, effort of a
capacitor) times jump of what is stored vanishes. So momentum and charge pass from one to the other and none is lost, unless
a tie holds something still or shorts it: then what it stored is gone, into the world outside of the model. (Brogliato,
Nonsmooth Mechanics, 2016, section 4.3; for circuits Opal and Vlach, IEEE Trans. CAS 37, 1990.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import RunFailed
from ..closed.constraints import Constraints
from ..loops.loops import LoopSolver
from ..start.claims import slopes_of

ITERATIONS = 30
CLOSE = 1e-12  # of the magnitudes: where the iteration ends
AFFINE = 1e-13  # of its values: how far from a straight line rounding takes an affine function
SEEN = 1e-9  # of the magnitudes: what counts as a jump


@dataclass(frozen=True, slots=True)
class Jump:
    """What a storage held before and after an impulse."""

    name: str
    unit: str
    before: float
    after: float


def after_impulse(
    constraints: Constraints, time: float, full: Any, mode: Any, stored: Mapping[str, float], peaks: Mapping[str, float]
) -> tuple[Any, tuple[Jump, ...]]:  # fmt: skip
    """The state that follows what was stored, unknowns included, and what jumped. Raises `RunFailed`."""
    program = constraints.program
    names = (*program.states.names, *program.dependents.names)
    units = (*program.states.units, *program.dependents.units)
    count = len(program.states.names)
    old = np.array([stored.get(n, np.nan) for n in names])
    size = np.array([max(abs(stored.get(n, 0.0)), peaks.get(n, 0.0)) for n in names])
    size = np.where(size > 0, size, 1.0)
    held = _Held(constraints, time, full, mode)
    x = full[:count]
    known = np.isfinite(old)
    old = np.where(known, old, held.stored(x))  # what no program computed before begins as it follows
    if (np.abs(held.stored(x) - old) <= SEEN * size).all():
        return held.full(x), ()
    x = _balanced(held, x, old, size, time)
    after = held.stored(x)
    jumped = np.flatnonzero(np.abs(after - old) > SEEN * size)
    return held.full(x), tuple(Jump(names[i], units[i], float(old[i]), float(after[i])) for i in jumped)


@dataclass(frozen=True, slots=True)
class _Held:
    """What storages hold, and their conjugates, as functions of the states."""

    constraints: Constraints
    time: float
    start: Any
    mode: Any

    def full(self, x: Any) -> Any:
        """The state with the unknowns of loops."""
        held = self.constraints
        loops = LoopSolver(held.program, held.constants, held.inputs, np.ones(len(self.start)), held.parameters)
        return loops.solve(self.time, np.concatenate([x, self.start[len(x) :]]), self.mode)

    def stored(self, x: Any) -> Any:
        """States, then what dependent storages hold."""
        return np.concatenate([x, self._at(self.constraints.program.dependent, x)])

    def conjugates(self, x: Any) -> Any:
        """Their efforts and flows."""
        hybrid = self.constraints.program.hybrid
        assert hybrid is not None
        return self._at(hybrid.conjugates, x)

    def _at(self, function: Callable[..., Any], x: Any) -> Any:
        return function(self.time, self.full(x), self.constraints.inputs, self.constraints.constants, self.mode)


def _balanced(held: _Held, x: Any, old: Any, size: Any, time: float) -> Any:
    """The states for which no impulse does work on a motion that the ties allow."""
    scale = size[: len(x)]

    def scaled(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda y: function(y * scale)

    y, last = x / scale, np.inf
    for _ in range(ITERATIONS):
        allowed, ways = _slopes(scaled(held.conjugates), y), _slopes(scaled(held.stored), y)
        matrix, right = allowed.T @ ways, allowed.T @ (held.stored(y * scale) - old)
        rows = np.abs(matrix).max(axis=1)
        if not (np.isfinite(matrix).all() and (rows > 0).all()):
            break
        try:
            step = np.linalg.solve(matrix / rows[:, None], -right / rows)
        except np.linalg.LinAlgError:
            break
        y = y + step
        size_of_step = float(np.abs(step).max())
        if size_of_step <= CLOSE or (size_of_step <= SEEN and size_of_step > 0.1 * last):  # the slopes are no better
            return y * scale
        last = size_of_step
    raise RunFailed(
        f"at t = {time:.9g} s storages that are tied to each other by a switched junction find no common motion: "
        "put a resistor or a spring between them"
    )


def _slopes(function: Callable[[Any], Any], y: Any) -> Any:
    """Central differences, shape (values, n): of an affine function over a long way, where rounding does not count."""
    here, columns = function(y), []
    for way in np.eye(len(y)):
        ahead, behind = function(y + way), function(y - way)
        size = np.maximum(np.abs(ahead), np.abs(behind))
        if not (np.abs(ahead + behind - 2 * here) <= AFFINE * size).all():
            return slopes_of(function, y, np.ones(len(y), dtype=bool))
        columns.append(0.5 * (ahead - behind))
    return np.stack(columns, axis=1) if columns else np.zeros((len(here), 0))
