"""Stability verdict from eigenvalues with error bounds.

Where states fall into two kinds and each rate reads only the other kind (displacements and momenta without loss), eigenvalues come as +-lambda:
those on the imaginary axis are exactly there, and such an equilibrium is stable without damping. A zero eigenvalue does not count if the
equilibrium lies on a continuum of equilibria (something is conserved, or there is no restoring force), which is tested by steps along the null
space, or if its left vector is conserved for all states.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, letters

from ..errors import RunFailed
from ..numerics import scales
from .eigenvalues import EPS, EXTENDED, Eigenvalues, bounded_eigenvalues
from .linear import CANCELLED, rounding_of, state_matrix
from .operating_point import OperatingPoint

NULL = 1e-9  # relative to the largest singular value of the scaled matrix: possible null vectors
WALK = 0.03  # relative to the magnitudes: step along a null space to other equilibria
BESIDE = 0.2  # fraction of that: largest distance of the next equilibrium from the straight line
NEWTON = 8
REST = 1e-10  # relative to the terms of a rate
SEED = 20
# Relative to the fastest: growth or decay that the rounding of terms that cancel may have made, as its root.
DOUBTFUL = 1e-5


@dataclass(frozen=True, eq=False)
class Verdict:
    """Stability of an equilibrium.

    `growth` (1/s): largest real part, with error at most `bound`; `undecided`: eigenvalues whose real part may be zero; `stable`: None if these
    decide. `undamped`: eigenvalues on the imaginary axis by the structure of the equations (of a pair the one with the positive imaginary part);
    `neutral`: number of zero eigenvalues of continua of equilibria.
    """

    growth: float
    bound: float
    stable: bool | None
    undecided: tuple[complex, ...] = ()
    undamped: tuple[complex, ...] = ()
    neutral: int = 0
    kink: str = ""  # name of a state or unknown whose equation has a kink or a jump there: then it is not decided

    @property
    def word(self) -> str:
        """One of `stable`, `unstable` or `not decided`."""
        return {True: "stable", False: "unstable", None: "not decided"}[self.stable]


def verdict(point: OperatingPoint) -> Verdict:
    """Return the verdict of a point at equilibrium."""
    point = point.one_sided()
    A = state_matrix(point)
    return Verdict(math.nan, math.nan, None, kink=point.kinks[0]) if point.kinks else verdict_of(*decisive(point, A))


def decisive(point: OperatingPoint, A: Array, known: int = 0) -> tuple[Eigenvalues, int]:
    """Return the eigenvalues of A that decide on stability, and the number of further neutral ones.

    `known`: number of eigenvalues shown to be neutral at another point of the same branch.
    """
    if point.kinks:
        values, shapes = np.linalg.eig(A)
        return Eigenvalues(values.astype(complex), np.full(len(A), np.inf), np.zeros(len(A), dtype=bool), shapes), known
    active, sizes, neutral = _without_neutral(point, A, np.abs(A), known)
    eigenvalues = bounded_eigenvalues(active, sizes, lossless(point))
    slow = np.abs(eigenvalues.values.real) < DOUBTFUL * np.abs(eigenvalues.values).max(initial=0.0)
    decided = slow & ~eigenvalues.undamped & (np.abs(eigenvalues.values.real) > eigenvalues.bounds)
    if decided.any() and len(A) <= EXTENDED:
        states = point.compilation.state_space.states
        rounding, _ = rounding_of(point, [states[i].rate for i in point.reduced.chosen])
        A = np.where(np.abs(A) > CANCELLED * rounding, A, 0.0)
        active, sizes, neutral = _without_neutral(point, A, np.maximum(np.abs(A), rounding / EPS), known)
        eigenvalues = bounded_eigenvalues(active, sizes, lossless(point))
    return eigenvalues, neutral


def lossless(point: OperatingPoint) -> bool:
    """Return True if only storages and sources of a constant effort or flow exchange energy with the model."""
    key = "constant sources alone"
    if key not in point.made.kept:
        ports = point.compilation.state_space.ports
        given = [p.effort if p.kind == "Se" else p.flow for p in ports if p.kind in letters("source")]
        others = any(p.kind not in letters("storage", "source", "transducer") for p in ports)
        point.made.kept[key] = not others and not any(c < point.all for c in point.slopes_of(tuple(given)).columns)
    return bool(point.made.kept[key])


def verdict_of(found: Eigenvalues, neutral: int = 0) -> Verdict:
    """Return the verdict from the deciding eigenvalues."""
    if not len(found.values):
        return Verdict(0.0 if neutral else -np.inf, 0.0, True, neutral=neutral)
    worst = int(np.argmax(found.values.real))
    undecided, undamped = found.undecided, tuple(complex(v) for v in found.values[found.undamped] if v.imag > 0)
    stable = False if found.growing else None if undecided else True
    growth = float(found.values.real[worst])
    return Verdict(max(growth, 0.0) if neutral else growth, float(found.bounds[worst]), stable, undecided, undamped, neutral)  # fmt: skip


# ---------------------------------------------------------------- neutral directions


def null_space(A: Array) -> Any:
    """Return right null vectors (n, k) of a matrix up to the rounding of its entries, the largest component of each 1 in its scales."""
    n = len(A)
    if not n:
        return np.zeros((0, 0))
    scaled, _, columns = scales.equilibrated(A)
    _, sizes, right = np.linalg.svd(scaled)
    vectors, null = scales.null_basis(
        scaled, np.abs(scaled), right[sizes <= NULL * max(sizes.max(initial=0.0), 1e-300)]
    )
    return vectors[:, null] / columns[:, None]


def _without_neutral(point: OperatingPoint, A: Array, sizes: Array, known: int) -> tuple[Any, Any, int]:
    """Return the matrix without directions of continua of equilibria and of conserved sums, the sizes of its terms, and the number removed."""
    neutral = 0
    vectors = null_space(A)
    if not vectors.shape[1]:
        return A, sizes, 0
    count = vectors.shape[1]
    keep = [i for i in range(count) if count <= known or leads_to_rests(point, vectors[:, i])]
    if not keep:
        return A, sizes, 0
    vectors, places = vectors[:, keep], np.arange(len(A))
    A, sizes, left = _quotient(A, sizes, vectors)
    places, neutral = places[left], len(keep)
    while True:
        kept = null_space(A.T)
        count = kept.shape[1]
        kept = kept[:, [i for i in range(count) if neutral + count <= known or _conserved(point, places, kept[:, i])]]
        if not kept.shape[1]:
            return A, sizes, neutral
        A, sizes, left = _quotient(A.T, sizes.T, kept)
        A, sizes, places, neutral = A.T, sizes.T, places[left], neutral + kept.shape[1]


def _quotient(A: Array, sizes: Array, vectors: Array) -> tuple[Any, Any, Any]:
    """Return the matrix (n - k, n - k) of motions modulo null vectors (n, k), the sizes of its terms, and the remaining indices."""
    from scipy.linalg import qr

    vectors, rows, _ = scales.equilibrated(vectors)  # in any units the same states are left
    _, _, order = qr(vectors.T, pivoting=True, mode="economic")
    pivots, left = np.sort(order[: vectors.shape[1]]), np.sort(order[vectors.shape[1] :])
    follow = np.linalg.solve(vectors[pivots].T, vectors[left].T).T * rows[left][:, None] / rows[pivots]
    inner = A[np.ix_(left, left)] - follow @ A[np.ix_(pivots, left)]
    size = sizes[np.ix_(left, left)] + np.abs(follow) @ sizes[np.ix_(pivots, left)]
    return inner, size, left


def leads_to_rests(point: OperatingPoint, vector: Array) -> bool:
    """Return True if other equilibria lie along a null vector of the free coordinates: a continuum, not a branch point."""
    reduced, n = point.reduced, point.count
    state = np.array(point.state)
    scale = point.sizes[:n]
    along = reduced.directions @ vector
    along = along / np.max(np.abs(along) / scale)
    for share in (WALK, -WALK):
        aim = state[:n] + share * along
        try:
            moved = point.elsewhere({}, np.concatenate([aim, state[n:]]))
            for _ in range(NEWTON):
                rates = resting_rates(moved)
                if not rates.any():
                    break
                step = least_step(state_matrix(moved), rates, scale[reduced.chosen])
                change = reduced.directions @ step
                moved = point.elsewhere({}, np.concatenate([moved.state[:n] + change, moved.state[n:]]))
                if np.max(np.abs(change) / scale) < 1e-9 * WALK:
                    break
            terms = np.abs(state_matrix(moved)) @ scale[reduced.chosen]
        except (RunFailed, np.linalg.LinAlgError):
            return False
        rest = (np.abs(resting_rates(moved)) <= REST * np.maximum(terms, REST * terms.max(initial=0.0))).all()
        if not rest or not np.max(np.abs(moved.state[:n] - aim) / scale) <= BESIDE * WALK:
            return False
    return True


def resting_rates(point: OperatingPoint, steady: Container[str] | None = None) -> Any:
    """Return rates of the free coordinates, zero for angles that rotate steadily; `steady`: their names, if not those of the point."""
    turning = point.steady if steady is None else steady
    chosen = point.reduced.chosen
    return np.where([n in turning for n in np.take(point.program.states.names, chosen)], 0.0, point.rates[chosen])


def least_step(A: Array, rates: Array, scale: Array) -> Any:
    """Return Newton's step to an equilibrium, the shortest in units of `scale`."""
    rows = scales.nonzero(np.abs(A * scale).max(axis=1, initial=0.0))
    return -scale * np.linalg.lstsq(A * scale / rows[:, None], rates / rows, rcond=1e-10)[0]


def _conserved(point: OperatingPoint, places: Sequence[int], vector: Array) -> bool:
    """Return True if a combination of free coordinates has zero rate at all states nearby."""
    if point.reduced.tied:
        return False
    random, n = np.random.default_rng(SEED), point.count
    scale = point.sizes[:n]
    weights = np.zeros(n)
    weights[np.asarray(places)] = vector
    for _ in range(3):
        state = point.state[:n] + 0.1 * scale * random.uniform(-1, 1, n)
        try:
            rates = resting_rates(point.elsewhere({}, np.concatenate([state, point.state[n:]])))
        except RunFailed:
            return False
        terms = np.abs(weights) @ np.abs(rates)
        if not abs(float(weights @ rates)) <= 1e-10 * terms:
            return False
    return True
