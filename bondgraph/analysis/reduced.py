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
        n, (m, width) = len(self.directions), self.unknowns.shape
        whole = np.concatenate([slopes[:, :n], slopes[:, n + m :]], axis=1)
        whole = whole + slopes[:, n : n + m] @ self.unknowns if m else whole
        return whole[:, :n], whole[:, n:width]

    def through(self, slopes: Array) -> tuple[Any, Any]:
        """Convert columns for states, unknowns and `by` to columns for free coordinates, and for `by`."""
        states, moved = self.by_states(slopes)
        if not self.tied:
            return states, moved
        return states @ self.directions, states @ self.following + moved

    def held(self, moved: Array) -> Any:
        """Return derivatives of the states (n, k) by `by`, with tied coordinates determined by the free ones."""
        return self.directions @ moved[self.chosen] + self.following if self.tied else moved


def tied_coordinates(slopes: Array, moved: Array) -> tuple[Any, Any, Any]:
    """Return coordinates that stay free where slopes @ x + moved @ p = 0, and the derivatives of all by them and by p."""
    from scipy.linalg import qr

    n = slopes.shape[1]
    rows = nonzero(np.abs(slopes).max(axis=1, initial=0.0))[:, None]
    slopes, moved = slopes / rows, moved / rows
    _, triangle, order = qr(slopes, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    rank = int((sizes > RANK * sizes.max(initial=0.0)).sum())
    tied, chosen = np.sort(order[:rank]), np.sort(order[rank:])
    directions, following = np.zeros((n, n - rank)), np.zeros((n, moved.shape[1]))
    directions[chosen, np.arange(n - rank)] = 1.0
    solved = np.linalg.lstsq(slopes[:, tied], np.concatenate([slopes[:, chosen], moved], axis=1), rcond=None)[0]
    directions[tied], following[tied] = -solved[:, : n - rank], -solved[:, n - rank :]
    return chosen, directions, following
