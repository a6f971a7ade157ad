"""Stored quantities when other junctions are on: preserved, except that an impulse passes between storages that are now tied to each other.

An impulse does no work on any motion that the ties allow: for all of those, the sum of conjugate (flow of an inertia, effort of a capacitor)
times jump of the stored quantity vanishes. So momentum and charge pass from one to the other and none is lost, unless a tie blocks or shorts
a storage: then its content goes to the world outside the model. (Brogliato, Nonsmooth Mechanics, 2016, section 4.3; for circuits Opal and
Vlach, IEEE Trans. CAS 37, 1990.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..constraints.constraints import Constraints
from ..initialization.initial_equations import slopes_of
from ..loops.loops import LoopSolver

ITERATIONS = 100
HALVES = 20  # of a step that leaves the domain of a law
CLOSE = 1e-12  # relative to the magnitudes: end of the iteration
AFFINE = 1e-13  # relative to the values: rounding error of an affine function
SEEN = 1e-9  # relative to the magnitudes: least change that counts as a jump


@dataclass(frozen=True, slots=True)
class StorageJump:
    """Content of a storage before and after an impulse."""

    name: str
    unit: str
    before: float
    after: float


def after_impulse(
    constraints: Constraints, time: float, full: Array, mode: Array, stored: Mapping[str, float], peaks: Mapping[str, float]
) -> tuple[Any, tuple[StorageJump, ...]]:  # fmt: skip
    """Return the state after the impulse from the stored quantities before, with unknowns, and the jumps. Raises `RunFailed`."""
    program = constraints.program
    names = (*program.states.names, *program.dependents.names)
    units = (*program.states.units, *program.dependents.units)
    count = len(program.states.names)
    old = np.array([stored.get(n, np.nan) for n in names])
    size = np.array([max(abs(stored.get(n, 0.0)), peaks.get(n, 0.0)) for n in names])
    size = nonzero(size)
    held = _Held(constraints, constraints.loops(np.ones(len(full))), time, full, mode)
    x = full[:count]
    here = held.stored(x)
    # quantities that no program computed before start at their computed values
    old = np.where(np.isfinite(old), old, here)
    if (np.abs(here - old) <= SEEN * size).all():
        return held.full(x), ()
    x = _balanced(held, x, old, size, time)
    after = held.stored(x)
    jumped = np.flatnonzero(np.abs(after - old) > SEEN * size)
    return held.full(x), tuple(StorageJump(names[i], units[i], float(old[i]), float(after[i])) for i in jumped)


def refuse_jumps_of_mechanisms(jumps: Sequence[StorageJump], mechanisms: Sequence[str], time: float) -> None:
    """Raise `RunFailed` if an impulse changes the rate of a coordinate of a mechanism: rates hold no momentum, so they say nothing of the other rates."""
    prefixes = tuple(f"{name}." for name in mechanisms)
    jump = next((j for j in jumps if j.name.startswith(prefixes)), None)
    if jump is not None:
        raise RunFailed(
            "BR788", f"at t = {time:.9g} s a junction that goes on or off takes `{jump.name}` from {jump.before:.6g} to {jump.after:.6g} {jump.unit} at once: "
            "impulses within mechanisms are not computed;", "couple it by a stiff spring and a damper, or by `DryFriction`",
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Held:
    """Stored quantities and their conjugates, as functions of the states."""

    constraints: Constraints
    loops: LoopSolver
    time: float
    start: Any
    mode: Any

    def full(self, x: Array) -> Any:
        """Return the state with the unknowns of loops."""
        return self.loops.solve(self.time, np.concatenate([x, self.start[len(x) :]]), self.mode)

    def stored(self, x: Array) -> Any:
        """Return the states, then the contents of dependent storages."""
        return np.concatenate([x, self._at(self.constraints.program.dependent, x)])

    def conjugates(self, x: Array) -> Any:
        """Return the efforts and flows conjugate to the stored quantities."""
        hybrid = self.constraints.program.hybrid
        assert hybrid is not None
        return self._at(hybrid.conjugates, x)

    def _at(self, function: Callable[..., Any], x: Array) -> Any:
        return function(self.time, self.full(x), self.constraints.inputs, self.constraints.constants, self.mode)


def _balanced(held: _Held, x: Array, old: Array, size: Array, time: float) -> Any:
    """Return the states for which no impulse does work on a motion that the ties allow."""
    scale = size[: len(x)]

    def scaled(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda y: function(y * scale)

    if not len(x):
        return x
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
        ahead = _ahead(scaled(held.stored), y, step)
        if ahead is None:
            break
        step, y = ahead - y, ahead
        size_of_step = float(np.abs(step).max())
        # limit of the difference quotients
        if size_of_step <= CLOSE or (size_of_step <= SEEN and size_of_step > 0.1 * last):
            return y * scale
        last = size_of_step
    raise RunFailed(
        "BR772", f"at t = {time:.9g} s storages that are tied to each other by a switched junction find no common motion:",
        "put a resistor or a spring between them",
    )  # fmt: skip


def _ahead(function: Callable[[Any], Any], y: Array, step: Array) -> Any:
    """Return the end of a step, or of the longest of its halves that stays in the domain of the laws; None if none does."""
    for _ in range(HALVES):
        try:
            if np.isfinite(function(y + step)).all():
                return y + step
        except RunFailed:
            pass
        step = step / 2
    return None


def _slopes(function: Callable[[Any], Any], y: Array) -> Any:
    """Return central differences, shape (values, n); with a wide step for an affine function, so that rounding has no effect."""
    here, columns = function(y), []
    for way in np.eye(len(y)):
        try:
            ahead, behind = function(y + way), function(y - way)
        except RunFailed:  # a law that ends nearer than that
            return slopes_of(function, y, np.ones(len(y), dtype=bool))
        size = np.maximum(np.abs(ahead), np.abs(behind))
        if not (np.abs(ahead + behind - 2 * here) <= AFFINE * size).all():
            return slopes_of(function, y, np.ones(len(y), dtype=bool))
        columns.append(0.5 * (ahead - behind))
    return np.stack(columns, axis=1) if columns else np.zeros((len(here), 0))
