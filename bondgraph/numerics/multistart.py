"""Multistart: Newton's method from many guesses at once, for loops whose solutions may lie anywhere.

Guesses lie in steps over several decades around the known values and in units of the magnitudes, for all unknowns of a loop together, for each
alone, and for some mixtures that are the same in every run. Some hundred guesses cost about 20 ms.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from compiler.api import Array

ITERATIONS = 60
HALVINGS = 8
ENTRIES = 500_000  # most entries of all matrices of one search
AROUND = 10.0 ** (np.arange(-18, 19) / 6)  # factors on the known values
UNITS = 10.0 ** np.arange(-6, 4)
MIXTURES = 48
FAR = 200  # number of guesses over many decades


class SquareSystem(Protocol):
    """As many equations as unknowns, for many points at once: z has shape (…, n), and so has the residual; the matrix (…, n, n)."""

    @property
    def magnitude(self) -> Array: ...

    def residual(self, z: Array) -> Array: ...

    def matrix(self, z: Array) -> Array: ...


def guesses(known: Array, magnitude: Array) -> Array:
    """Return guesses around known values, and over decades of the magnitudes; shape (guesses, unknowns)."""
    count = len(known)
    size = np.where(known != 0, np.abs(known), magnitude)
    signed = np.where(known != 0, known, magnitude)
    together = [s * r * signed for r in AROUND for s in (1, -1)] + [s * u * magnitude for u in UNITS for s in (1, -1)]
    alone: list[Array] = []
    mixed: list[Array] = []
    if count > 1:
        unit = np.eye(count)
        shares = (*(s * r for r in AROUND[::6] for s in (1, -1)), 0.0)
        alone = [np.where(e > 0, share * size, known) for e in unit for share in shares]
        random = np.random.default_rng(0)
        mixed = [size * random.choice((-1, 1), count) * 10 ** random.uniform(-2, 2, count) for _ in range(MIXTURES)]
    return np.array([*together, *mixed, *alone])[: max(8, ENTRIES // count**2)]


def far_guesses(magnitude: Array) -> Array:
    """Return mixtures over many decades, in which the steepest law dominates; shape (guesses, unknowns)."""
    random = np.random.default_rng(1)
    count = len(magnitude)
    shape = (min(FAR, max(8, ENTRIES // count**2)), count)
    return random.choice((-1, 1), shape) * 10 ** random.uniform(-3, 6, shape) * magnitude


def arrivals(equations: SquareSystem, guesses: Array) -> list[Array]:
    """Return the points to which Newton's method, damped by halving, converges; guesses that do not converge are dropped."""
    z, done = np.array(guesses, dtype=float), []
    value = equations.residual(z)
    for _ in range(ITERATIONS):
        alive = np.isfinite(value).all(axis=1)
        z, value = z[alive], value[alive]
        if not len(z):
            break
        z, value, scale, step = _steps(equations, z, value)
        arrived = np.abs(step / np.maximum(np.abs(z), 1e-6 * equations.magnitude)).max(axis=1, initial=0.0) < 1e-8
        done += list(z[arrived])
        rest = ~arrived
        z, value = _damped(equations, z[rest], value[rest], scale[rest], step[rest])
    return done


def _steps(equations: SquareSystem, z: Array, value: Array) -> tuple[Array, Array, Array, Array]:
    """Return Newton's steps, with the scales of the rows, for the guesses that have one."""
    matrix = equations.matrix(z) * equations.magnitude
    scale = np.abs(matrix).max(axis=-1, initial=0.0)
    good = np.isfinite(scale).all(axis=1) & (scale > 0).all(axis=1)
    z, value, matrix, scale = z[good], value[good], matrix[good], scale[good]
    scaled = matrix / scale[..., None]
    good = np.linalg.slogdet(scaled)[0] != 0
    z, value, scaled, scale = z[good], value[good], scaled[good], scale[good]
    step = np.linalg.solve(scaled, -(value / scale)[..., None])[..., 0] * equations.magnitude
    return z, value, scale, step


def _damped(equations: SquareSystem, z: Array, value: Array, scale: Array, step: Array) -> tuple[Array, Array]:
    """Return the guesses after a step; each step is halved until the residual falls, otherwise its guess is dropped."""
    norm = np.linalg.norm(value / scale, axis=1)
    moved, found = np.full_like(z, np.nan), np.full_like(value, np.nan)
    open_ = np.arange(len(z))
    factor = 1.0
    for _ in range(HALVINGS):
        if not len(open_):
            break
        trial = z[open_] + factor * step[open_]
        new = equations.residual(trial)
        falls = np.linalg.norm(new / scale[open_], axis=1) <= (1 - 1e-4 * factor) * norm[open_]
        moved[open_[falls]], found[open_[falls]] = trial[falls], new[falls]
        open_, factor = open_[~falls], 0.5 * factor
    return moved, found
