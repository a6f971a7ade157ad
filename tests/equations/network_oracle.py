"""An independent solution of a bond graph: all element and junction equations at once, as an implicit DAE, in numbers.

Nothing here knows the compiler. A network is given flat: bonds with an effort and a flow each, storage ports with one stored
quantity each, and residual functions. With B bonds and S storage ports the equations are F(w, s, t) = 0, 2B of them in the
efforts and flows w (2B) and the stored quantities s, and s' = S w: the flow into a C, the effort on an I.

Some of the s are given (the states that a compiler chose), the others follow. The equations and their derivatives in time up
to some order K (the derivative array: Campbell and Gear, Numer. Math. 72, 1995), F = 0, F' = 0, …, with w as a Taylor series in
time, are solved together for w, w', … and what is not given of s, by Newton with least squares. The null space of the Jacobian
tells what the equations determine; a residual that stays tells that the given s contradict each other. K = 1 is enough for
index 2, each index more needs one more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from tests.equations.time_series import Series

Array = Any
TINY = 1e-40  # complex step
RANK = 1e-8  # singular values below this share of the largest are zero
CLOSE = 1e-10  # residual, as a share of the terms of its equation
LEAST = 1e-3  # what an unknown counts for at least among those terms


class Values(NamedTuple):
    """Quantities that a residual may read: efforts and flows by bond, stored quantities by storage port, time."""

    effort: Array
    flow: Array
    stored: Array
    time: Any


Residual = Callable[[Values], Sequence[Any]]


class StoragePort(NamedTuple):
    """A port that stores: its element and name, its bond, and whether the flow ("C") or the effort ("I") is integrated."""

    name: str
    bond: int
    kind: str


@dataclass
class Network:
    """A flat bond graph."""

    bonds: int = 0
    storages: list[StoragePort] = field(default_factory=list)
    residuals: list[Residual] = field(default_factory=list)

    def bond(self) -> int:
        self.bonds += 1
        return self.bonds - 1

    def junction(self, kind: str, ends: Sequence[tuple[int, int]]) -> None:
        """`ends`: (bond, +1 if the arrow points to the junction, else -1)."""

        def residual(v: Values) -> list[Any]:
            shared, split = (v.effort, v.flow) if kind == "0" else (v.flow, v.effort)
            first = ends[0][0]
            return [shared[b] - shared[first] for b, _ in ends[1:]] + [sum(sign * split[b] for b, sign in ends)]

        if ends:
            self.residuals.append(residual)

    def storage(self, name: str, bond: int, kind: str) -> int:
        self.storages.append(StoragePort(name, bond, kind))
        return len(self.storages) - 1

    # ------------------------------------------------------------ residuals
    def values(self, w: Array, s: Array, time: Any) -> Values:
        return Values(w[: self.bonds], w[self.bonds :], s, time)

    def residual(self, w: Array, s: Array, time: Any) -> Array:
        v = self.values(w, s, time)
        shape = np.broadcast_shapes(np.shape(w)[1:], np.shape(s)[1:])
        return np.array([np.broadcast_to(r, shape) for part in self.residuals for r in part(v)])

    def missed(self, w: Array, s: Array, time: float) -> float:
        """Largest residual relative to the terms of its equation, minus the rounding error of the largest of all."""
        slopes = np.hstack(self.jacobians(w, s, time)[:2])
        rounding = 1e-14 * np.abs(slopes).max(axis=1, initial=0.0) * float(np.abs(w).max(initial=0.0))
        left = np.maximum(np.abs(self.residual(w, s, time)) - rounding, 0.0)
        return _share(left, slopes, np.concatenate([w, s]))

    def taylor(self, w: Array, s: Array, time: Array) -> Array:
        """Coefficients in time of all residuals, for those of the quantities that they read (first axis)."""
        series = [Series(w[:, i]) for i in range(w.shape[1])]
        v = Values(
            series[: self.bonds], series[self.bonds :], [Series(s[:, i]) for i in range(s.shape[1])], Series(time)
        )
        rows = [r.c if isinstance(r, Series) else constant(r, time) for part in self.residuals for r in part(v)]
        return np.concatenate(np.moveaxis(np.array(rows), 1, 0))

    def rates(self, w: Array) -> Array:
        """s' = S w."""
        places = [self.rate_of(i) for i in range(len(self.storages))]
        return np.array([w[i] for i in places]).reshape(len(places), *np.shape(w)[1:])

    def rate_of(self, storage: int) -> int:
        """The place in w of the rate of a stored quantity."""
        port = self.storages[storage]
        return port.bond + (self.bonds if port.kind == "C" else 0)

    def jacobians(self, w: Array, s: Array, time: float) -> tuple[Array, Array, Array]:
        """F_w, F_s, F_t at a point, by complex steps."""
        n, m = 2 * self.bonds, len(self.storages)
        eye = np.eye(n + m + 1)
        both = self.residual(
            w[:, None] + 1j * TINY * eye[:n], s[:, None] + 1j * TINY * eye[n : n + m], time + 1j * TINY * eye[-1]
        )
        whole = both.imag / TINY
        return whole[:, :n], whole[:, n : n + m], whole[:, -1]


def constant(value: Any, like: Array) -> Array:
    """Coefficients of a constant."""
    result = np.zeros_like(like)
    result[0] = value
    return result


@dataclass
class Solution:
    """Solution for given states, and the directions that remain undetermined."""

    network: Network
    w: Array
    stored: Array
    converged: bool
    error: float
    null: Array  # (unknowns, k): directions that the equations do not determine, unknowns scaled to like slopes
    free: list[int]  # storage ports that were not given

    def determined(self, unknown: int) -> bool:
        """Return True if w[unknown] (or behind it the stored quantities that were not given) is determined."""
        return not self.null.size or float(np.abs(self.null[unknown]).max()) < 1e-6

    def effort(self, bond: int) -> float:
        return float(self.w[bond])

    def flow(self, bond: int) -> float:
        return float(self.w[self.network.bonds + bond])


def solve(network: Network, given: dict[int, float], time: float, order: int = 1, guess: Any = None) -> Solution:
    """All efforts, flows and stored quantities, for given stored quantities (by storage port), with `order` derivatives.

    `guess`: efforts and flows, and all stored quantities, to start from.
    """
    n, m = 2 * network.bonds, len(network.storages)
    free = [i for i in range(m) if i not in given]
    fixed = np.array([given.get(i, 0.0) for i in range(m)])
    count = order + 1
    inside = n + len(free)

    def split(z: Array) -> tuple[Array, Array, Array]:
        s = np.empty((m, *z.shape[1:]), dtype=z.dtype)
        s[:] = fixed.reshape(m, *[1] * (z.ndim - 1))
        s[free] = z[n:inside]
        return z[:n], s, z[inside:]

    def function(z: Array) -> Array:
        """F and its Taylor coefficients, one order after the other."""
        w, s, higher = split(z)
        series = np.concatenate([w[None], higher.reshape(order, n, *z.shape[1:])])
        stored = np.concatenate([s[None], [network.rates(series[k]) / (k + 1) for k in range(order)]])
        clock = np.zeros((count, *z.shape[1:]), dtype=z.dtype)
        clock[0], clock[1] = time, 1.0
        return network.taylor(series, stored, clock)

    z = np.zeros(inside + order * n)
    with np.errstate(all="ignore"):
        if guess is not None:
            z[:n], z[n:inside] = guess[0], guess[1][free]
            z[inside:] = _following(lambda higher: function(_behind(z[:inside], higher)), order * n)
        for damped in (False, True):  # most networks are monotone: full steps converge; the others get a second try
            found, jacobian, error = _newton(function, z, damped)
            if error < CLOSE:
                break
    if not np.isfinite(jacobian).all():
        jacobian = np.zeros_like(jacobian)
    w, s, _ = split(found)
    return Solution(network, w, s, error < CLOSE, error, _open(jacobian, inside), free)


def _open(jacobian: Array, inside: int) -> Array:
    """Directions of the first unknowns that the equations do not determine. The others, the derivatives, are not needed.

    They are eliminated first: otherwise large terms in an equation for them would hide small ones in an equation without them.
    """
    rows, columns = balance(jacobian[:, inside:])
    u, sizes, _ = np.linalg.svd(jacobian[:, inside:] / rows[:, None] / columns)
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    rest = u[:, rank:].T @ (jacobian[:, :inside] / rows[:, None])
    rows, columns = balance(rest)
    _, sizes, vt = np.linalg.svd(rest / rows[:, None] / columns)
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    return vt[rank:].T


def completed(network: Network, w: Array, s: Array, time: float, bonds: Sequence[int]) -> Array:
    """Efforts and flows with those of some bonds, between junctions, as all others demand it."""
    if not bonds:
        return w
    places = [*bonds, *(b + network.bonds for b in bonds)]
    w = w.copy()
    w[places] = 0.0
    slopes = network.jacobians(w, s, time)[0][:, places]
    chosen = slopes.any(axis=1)
    w[places] = np.linalg.lstsq(slopes[chosen], -network.residual(w, s, time)[chosen], rcond=None)[0]
    return w


def _behind(first: Array, higher: Array) -> Array:
    """One vector, or several of them in columns, behind what all of them begin with."""
    return np.concatenate(
        [np.broadcast_to(first.reshape(-1, *[1] * (higher.ndim - 1)), (len(first), *higher.shape[1:])), higher]
    )


def _following(function: Callable[[Array], Array], count: int) -> Array:
    """Derivatives that belong to known efforts, flows and stored quantities: exact values must not be
    spoilt by first steps that have no derivatives yet.
    """
    found, _, _ = _newton(function, np.zeros(count), damped=False)
    return np.where(np.isfinite(found), found, 0.0)


def balance(matrix: Array) -> tuple[Array, Array]:
    """Divisors for rows and columns after which the largest magnitudes in all of them are near 1 (Ruiz, RAL-TR-2001-034): laws of
    exponentials and cubes make slopes of many decades, which would look like a lack of rank."""
    rows, columns = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    for _ in range(12):
        sizes = np.abs(matrix) / rows[:, None] / columns
        for axis, divisors in ((1, rows), (0, columns)):
            largest = np.sqrt(sizes.max(axis=axis, initial=0.0))
            divisors *= np.where(largest > 0, largest, 1.0)
    return rows, columns


def _newton(function: Callable[[Array], Array], z: Array, damped: bool) -> tuple[Array, Array, float]:
    """A zero of a function, by Newton with least squares; the last matrix comes with it and the largest residual, each as a
    share of the terms of its equation."""
    eye = np.eye(len(z)) * TINY
    value = function(z)
    jacobian = np.zeros((len(value), len(z)))
    best, stalled, error = np.inf, 0, np.inf
    for _ in range(150):
        jacobian = function(z[:, None] + 1j * eye).imag / TINY
        if not np.isfinite(jacobian).all():
            break
        error = _share(value, jacobian, z)
        stalled = stalled + 1 if error > 0.5 * best else 0
        best = min(best, error)
        if not np.isfinite(error) or error < 1e-16 or (stalled > 1 and error < 1e-13) or stalled > 15:
            break
        rows, columns = balance(jacobian)
        step = scipy.linalg.lstsq(jacobian / rows[:, None] / columns, -value / rows, cond=RANK, lapack_driver="gelsy")[
            0
        ]
        step, length = step / columns, 1.0
        trial = function(z + step)
        size = np.linalg.norm(value / rows)
        while damped and not np.linalg.norm(trial / rows) < (1 - 1e-4 * length) * size and length > 1e-10:
            length /= 2
            trial = function(z + length * step)
        z, value = z + length * step, trial
    return z, jacobian, error


def _share(value: Array, jacobian: Array, z: Array) -> float:
    """The largest residual as a share of the terms of its equation, which are at least of size 1e-3."""
    terms = np.abs(jacobian) @ np.abs(z) + LEAST * np.abs(jacobian).max(axis=1, initial=0.0)
    return float((np.abs(value) / np.where(terms > 0, terms, LEAST)).max(initial=0.0))


def is_regular(network: Network, rng: np.random.Generator) -> bool:
    """Return True if the linearised equations have one solution for some choice of states: det(sE - A) is not zero."""
    n, m = 2 * network.bonds, len(network.storages)
    regular = False
    for _ in range(2):
        w, s = rng.uniform(0.5, 1.5, n), rng.uniform(0.5, 1.5, m)
        f_w, f_s, _ = network.jacobians(w, s, 0.3)
        if f_w.shape[0] != n:
            return False
        # What a source fixes has its value, for the laws that it modulates: two of them may be the same at all times.
        fixed = np.flatnonzero(((f_w != 0).sum(axis=1) == 1) & ~f_s.any(axis=1))
        places = np.argmax(f_w[fixed] != 0, axis=1)
        w[places] -= network.residual(w, s, 0.3)[fixed].real / f_w[fixed, places]
        f_w, f_s, _ = network.jacobians(w, s, 0.3)
        rates = network.rates(np.eye(n))
        matrix = np.block([[f_w, f_s], [-rates, rng.uniform(0.6, 0.9) * np.eye(m)]])
        rows = np.abs(matrix).max(axis=1, keepdims=True)
        if (rows == 0).any():
            continue
        sizes = np.linalg.svd(matrix / rows, compute_uv=False)
        regular = regular or bool(sizes[-1] > 1e-9 * sizes[0])
    return regular


def constraints(network: Network, rng: np.random.Generator) -> tuple[Array, Array]:
    """Constraints on the stored quantities alone: rows over s, and over time; linearised at a random point.

    A row that is not zero means that some of these storages cannot be chosen freely.
    """
    n, m = 2 * network.bonds, len(network.storages)
    f_w, f_s, f_t = network.jacobians(rng.uniform(0.5, 1.5, n), rng.uniform(0.5, 1.5, m), 0.3)
    u, sizes, _ = np.linalg.svd(f_w)
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    left = u[:, rank:].T
    return left @ f_s, left @ f_t
