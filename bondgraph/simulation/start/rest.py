"""Where a model is at rest: the states at which all rates vanish, for the inputs and the time of the start.

Pseudo-transient continuation (Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998): implicit Euler steps that grow as the rates
fall, so that first the way of the motion is followed and then Newton's method takes over. What nothing brings back (the position
of a free body) stays where it is: the last steps are of least length.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...door import Program
from ...errors import RunFailed
from ..closed.constraints import Constraints
from ..loops.loops import LoopSolver
from ..segments import Segment
from ..steps.factorise import is_large
from ..watch.stuck import not_finite

STEPS = 400
GROWTH = 2.0
LARGEST = 1e100  # what has gone so far has no rest
SINGULAR = 1e-12  # of the largest singular value
CLOSE = 1e-9  # of the magnitude of a state: the last correction
ROUNDING = 1e-12  # of the terms in a rate: less of it is what rounding leaves where they cancel
FIRST = (
    0.1  # of the time in which the first rates make a magnitude: where nothing brings back, eigenvalues tell no time
)


def equilibrium(program: Program, constraints: Constraints, inputs: Any, state: Any, first: Segment) -> Any:
    """The state at rest that is reached from a state, unknowns of loops included. Raises `RunFailed` if there is none."""
    count = len(program.states.names)
    if not count:
        return state
    search = _search(program, constraints, inputs, first)
    x, slope, jacobian = search.at(np.array(state))
    if not np.isfinite(slope).all():
        raise not_finite(program, first.start, slope, x, first.mode)
    if not np.isfinite(abs(jacobian).max()):
        raise RunFailed(
            f"at t = {first.start:.9g} s the rates have slopes that are not finite: no equilibrium is found"
        )
    if not slope.any():
        return x
    if search.distance(slope, jacobian) <= CLOSE:
        return search.polished(x, slope, jacobian)
    size = search.first(slope, jacobian)
    for _ in range(STEPS):
        found = search.step(x, slope, jacobian, size)
        if found is None:
            size *= 0.25
            continue
        trial, new_slope, new_jacobian = found
        if not np.abs(trial[:count]).max() < LARGEST:
            break
        before, after = search.distance(slope, jacobian), search.distance(new_slope, new_jacobian)
        gain = before / max(after, 1e-300) if np.isfinite(before) and np.isfinite(after) else 1.0
        size *= GROWTH * min(max(gain, 0.5), 100.0)
        x, slope, jacobian = trial, new_slope, new_jacobian
        if after <= CLOSE:
            return search.polished(x, slope, jacobian)
    worst = int(np.argmax(np.abs(slope) / search.scale(np.zeros(count))))
    raise RunFailed(
        f"no equilibrium was found: the rate of `{program.states.names[worst]}` does not vanish (now {slope[worst]:.6g}); "
        "does something drive the model for ever, or is it unstable there?"
    )


def _search(program: Program, constraints: Constraints, inputs: Any, first: Segment) -> Search:
    """Dense, or sparse where a model is large. Closing joints leave directions that are dense as they are."""
    rows, _ = program.pattern
    if not constraints and is_large(len(program.states.names), len(rows)):
        from .rest_sparse import SparseSearch

        return SparseSearch(program, constraints, inputs, first)
    return Search(program, constraints, inputs, first)


class Search:
    """Rates and their derivatives by the states, with the unknowns of loops solved for."""

    def __init__(self, program: Program, constraints: Constraints, inputs: Any, first: Segment) -> None:
        self.constraints, constants = constraints, constraints.constants
        self.program, self.count = program, len(program.states.names)
        self.time, self.fixed = first.start, (inputs, constants, first.mode)
        magnitude = np.ones(self.count + len(program.unknowns.names))
        self.loops, self.mode = LoopSolver(program, constants, inputs, magnitude), first.mode
        self.largest = np.zeros(self.count)
        units = program.states.units
        kinds = {unit: i for i, unit in enumerate(dict.fromkeys(units))}
        self.kind = np.array([kinds[unit] for unit in units], dtype=int)  # states of one unit have one number
        self.basis: Any = None  # of the directions that closing joints leave, where the search is

    def at(self, full: Any) -> tuple[Any, Any, Any]:
        """State, rates, and their derivatives by the states alone."""
        full = self.constraints.project(self.time, full, self.mode)
        full = self.loops.solve(self.time, full, self.mode)
        if self.constraints:
            self.basis = self.constraints.tangents(self.time, full, self.mode)
        n = self.count
        slope = np.asarray(self.program.derivative(self.time, full, *self.fixed))[:n]
        whole = np.asarray(self.program.jacobian(self.time, full, *self.fixed))
        jacobian = whole[:n, :n]
        if len(full) > n:
            jacobian = jacobian - whole[:n, n:] @ np.linalg.solve(whole[n:, n:], whole[n:, :n])
        self.largest = np.maximum(self.largest, np.abs(full[:n]))
        return full, slope, jacobian

    def first(self, slope: Any, jacobian: Any) -> float:
        """The length of the first step: that of the fastest mode, or of what the rates do to the states."""
        moving = slope != 0
        reach = float((self.scale(np.zeros(self.count))[moving] / np.abs(slope[moving])).min())
        fastest = self.fastest(jacobian)
        return min(1.0 / fastest, FIRST * reach) if fastest > 0 else FIRST * reach

    def fastest(self, jacobian: Any) -> float:
        """The largest eigenvalue, in 1/s."""
        return float(np.abs(np.linalg.eigvals(jacobian)).max(initial=0.0))

    def scale(self, change: Any) -> Any:
        """Magnitudes of the states, as far as they are known: those of one unit share the largest."""
        seen = np.maximum(self.largest, np.where(np.isfinite(change), np.abs(change), 0.0))
        largest = np.zeros(self.kind.max(initial=0) + 1)
        np.maximum.at(largest, self.kind, seen)
        return np.where(largest > 0, largest, 1.0)[self.kind]

    def step(self, full: Any, slope: Any, jacobian: Any, size: float) -> tuple[Any, Any, Any] | None:
        """One implicit Euler step; None if it leads to no numbers."""
        try:
            change = self.euler(slope, jacobian, size)
            trial = self.at(np.concatenate([full[: self.count] + change, full[self.count :]]))
        except (np.linalg.LinAlgError, RunFailed):
            return None
        return trial if np.isfinite(trial[1]).all() and np.isfinite(trial[2].sum()) else None

    def euler(self, slope: Any, jacobian: Any, size: float) -> Any:
        """The change of the states in one implicit step. Raises LinAlgError."""
        if self.basis is None:
            return np.linalg.solve(np.eye(self.count) / size - jacobian, slope)
        inner = self.basis.T @ jacobian @ self.basis
        return self.basis @ np.linalg.solve(np.eye(len(inner)) / size - inner, self.basis.T @ slope)

    def correction(self, slope: Any, jacobian: Any) -> Any:
        """Newton's step of least length; where nothing brings back, it does not move. Infinite if nothing balances the rates."""
        if self.basis is not None:  # what closing joints leave
            inner = np.abs(self.basis).T @ self._noise(jacobian)
            change = self._least(self.basis.T @ slope, self.basis.T @ jacobian @ self.basis, inner)
            return self.basis @ change if np.isfinite(change).all() else np.full(self.count, np.inf)
        return self._least(slope, jacobian, self._noise(jacobian))

    def _noise(self, jacobian: Any) -> Any:
        """What rounding may leave of each rate."""
        return ROUNDING * (np.abs(jacobian) @ self.scale(np.zeros(self.count)))

    def _least(self, slope: Any, jacobian: Any, noise: Any) -> Any:
        rows = np.abs(jacobian).max(axis=1)
        if not (np.isfinite(rows).all() and np.isfinite(slope).all()):
            return np.full(len(slope), np.inf)
        rows = np.where(rows > 0, rows, 1.0)
        matrix = jacobian / rows[:, None]
        columns = np.abs(matrix).max(axis=0)
        columns = np.where(columns > 0, columns, 1.0)
        left, sizes, right = np.linalg.svd(matrix / columns)
        rank = int((sizes > SINGULAR * sizes[0]).sum())
        needed = -slope / rows
        if rank < len(slope):  # what no change of the states can cancel
            lost = left[:, rank:].T
            allowed = CLOSE * (np.abs(lost) @ np.abs(needed)) + np.abs(lost) @ (noise / rows)
            if (np.abs(lost @ needed) > allowed).any():
                return np.full(len(slope), np.inf)
            kept = lost / rows / columns  # what every motion keeps (w with w J = 0) stays as it is
            kept = kept / np.linalg.norm(kept, axis=1, keepdims=True)
            whole = np.concatenate([matrix / columns, kept])
            return np.linalg.lstsq(whole, np.concatenate([needed, np.zeros(len(kept))]), rcond=SINGULAR)[0] / columns
        change = right[:rank].T @ ((left[:, :rank].T @ needed) / sizes[:rank])
        return change / columns

    def distance(self, slope: Any, jacobian: Any) -> float:
        """How far the equilibrium is, in units of the magnitudes."""
        change = self.correction(slope, jacobian)
        seen = self.scale(change)
        fastest = self.fastest(jacobian)
        if fastest > 0:  # a speed that only rounding ever moved has a magnitude nevertheless
            seen = np.maximum(seen, np.abs(jacobian) @ seen / fastest)
        return float((np.abs(change) / seen).max(initial=0.0))

    def polished(self, full: Any, slope: Any, jacobian: Any) -> Any:
        """The last corrections, to round-off."""
        for _ in range(3):
            change = self.correction(slope, jacobian)
            full, slope, jacobian = self.at(np.concatenate([full[: self.count] + change, full[self.count :]]))
        return full
