"""Free coordinates of a model at a point: those that closing joints tie follow them, unknowns of loops are eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray

from ..numerics.scales import nonzero

RANK = 1e-9  # relative to the largest: a smaller pivot shows a dependent constraint


@dataclass(frozen=True, eq=False)
class Reduced:
    """Free coordinates (r,) of the states.

    `chosen`: their indices; `directions` (n, r): derivatives of all states by them; `following` (n, k): derivatives of all states by `by` with the
    free ones fixed; `unknowns` (m, n + k): derivatives of the unknowns by states and `by`.
    """

    chosen: Any
    directions: Any
    following: Any
    unknowns: Any

    @property
    def tied(self) -> bool:
        """True if some coordinates follow others."""
        return len(self.chosen) < len(self.directions)

    def whole(self, amplitudes: Array | ComplexArray) -> Any:
        """Return all states from the free coordinates."""
        return self.directions @ amplitudes if self.tied else amplitudes

    def by_states(self, slopes: Array) -> tuple[Any, Any]:
        """Convert columns for states, unknowns and `by` to columns for all states, taken as independent, and for `by`."""
        return by_states(slopes, self.unknowns, len(self.directions))

    def through(self, slopes: Array) -> tuple[Any, Any]:
        """Convert columns for states, unknowns and `by` to columns for free coordinates, and for `by`."""
        states, moved = self.by_states(slopes)
        if not self.tied:
            return states, moved
        return states @ self.directions, states @ self.following + moved

    def held(self, moved: Array) -> Any:
        """Return derivatives of the states (n, k) by `by`, with tied coordinates determined by the free ones."""
        return self.directions @ moved[self.chosen] + self.following if self.tied else moved


def followed_unknowns(residuals: Array, n: int) -> Any:
    """Return the derivatives of unknowns (…, m, n + k) from those of their residuals (…, m, n + m + k). Raises `LinAlgError`."""
    last = n + residuals.shape[-2]
    return -np.linalg.solve(
        residuals[..., n:last], np.concatenate([residuals[..., :n], residuals[..., last:]], axis=-1)
    )


def by_states(slopes: Array, unknowns: Array, n: int) -> tuple[Any, Any]:
    """Convert columns (…, n + m + k) for states, unknowns and `by` to columns for states and for `by`, with unknowns that follow."""
    last = n + unknowns.shape[-2]
    whole = np.concatenate([slopes[..., :n], slopes[..., last:]], axis=-1)
    whole = whole + slopes[..., n:last] @ unknowns if last > n else whole
    return whole[..., :n], whole[..., n:]


def tied_step(slopes: Array, residuals: Array) -> Any:
    """Return the smallest x with slopes @ x = residuals (…, rows, k), where rows may follow from others."""
    rows = nonzero(np.abs(slopes).max(axis=-1, keepdims=True))
    return np.linalg.pinv(slopes / rows, rcond=RANK) @ (residuals / rows)


def tied_coordinates(slopes: Array, moved: Array, sizes: Array) -> tuple[Any, Any, Any]:
    """Return coordinates that stay free where slopes @ x + moved @ p = 0, and the derivatives of all by them and by p. `sizes` (n,): of x, by which
    the choice is the same in all units. Elimination keeps the zeros between coordinates and speeds that do not read each other."""
    from scipy.linalg import qr

    n = slopes.shape[1]
    rows = nonzero(np.abs(slopes * sizes).max(axis=1, initial=0.0))[:, None]
    scaled, moved = slopes * sizes / rows, moved / rows
    _, triangle, order = qr(scaled, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(triangle))
    rank = int((pivots > RANK * pivots.max(initial=0.0)).sum())
    tied, chosen = np.sort(order[:rank]), np.sort(order[rank:])
    *_, decisive = qr(scaled[:, tied].T, mode="economic", pivoting=True)  # rows that the others follow from
    decisive = np.sort(decisive[:rank])
    solved = np.linalg.solve(
        scaled[np.ix_(decisive, tied)], np.concatenate([scaled[np.ix_(decisive, chosen)], moved[decisive]], axis=1)
    )
    directions, following = np.zeros((n, n - rank)), np.zeros((n, moved.shape[1]))
    directions[chosen, np.arange(n - rank)] = 1.0
    directions[tied] = -solved[:, : n - rank] * sizes[tied][:, None] / sizes[chosen]
    following[tied] = -solved[:, n - rank :] * sizes[tied][:, None]
    return chosen, directions, following
