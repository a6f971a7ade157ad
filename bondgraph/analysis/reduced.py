"""Free coordinates of a model at a point: those that closing joints tie follow them, unknowns of loops are eliminated.

Storages and integrals that share a state have their values from the states, and the states from theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, ComplexArray, Tape

from ..errors import UsageError
from ..numerics.scales import nonzero

if TYPE_CHECKING:
    from compiler.api import Compilation

RANK = 1e-9  # relative to the largest: a smaller pivot shows a dependent constraint
SAME = 1e-9  # relative difference of values that share a state


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


@dataclass(frozen=True, slots=True)
class Follower:
    """A quantity equal to `slope` times the state at index `place`, plus `offset`; `unit` in SI."""

    place: int
    slope: float
    offset: float
    unit: str

    def at(self, state: Array) -> float:
        """Return its value for states (n, ...)."""
        return float(self.slope * state[self.place] + self.offset)


def followers(compilation: Compilation, parameters: Array | tuple[float, ...]) -> dict[str, Follower]:
    """Return the followers by name, with the parameters (p,) of the program."""
    space, lowered = compilation.state_space, compilation.lowered
    if not space.following:
        return {}
    tape = Tape([lowered.values[f.variable] for f in space.following])

    def at(state: float) -> Any:
        return np.array(
            tape.values(lambda leaf: state if leaf.role == "state" else float(parameters[leaf.position])), dtype=float
        )

    offsets, places = at(0.0), {s.variable: i for i, s in enumerate(space.states)}
    variables = [space.variables[f.variable] for f in space.following]
    return {
        v.name: Follower(places[f.state], float(slope), float(offset), v.unit)
        for v, f, slope, offset in zip(variables, space.following, at(1.0) - offsets, offsets, strict=True)
    }


def led(
    compilation: Compilation, parameters: Array | tuple[float, ...], given: Mapping[str, float]
) -> dict[str, float]:
    """Return given values by name, with those of followers converted to the states that they share.

    Raises `UsageError` where two of them contradict each other.
    """
    if all(name in compilation.program.states.names for name in given):
        return dict(given)
    names, all_followers = compilation.program.states.names, followers(compilation, parameters)
    leaders = {n: v for n, v in given.items() if n not in all_followers}
    for name, follower in ((n, all_followers[n]) for n in given if n in all_followers):
        leader, value = names[follower.place], (given[name] - follower.offset) / follower.slope
        other = leaders.setdefault(leader, value)
        if abs(other - value) > SAME * max(abs(other), abs(value), abs(follower.offset / follower.slope)):
            raise UsageError("BR207", f"`{name}` follows `{leader}`: their values contradict each other")
    return leaders
