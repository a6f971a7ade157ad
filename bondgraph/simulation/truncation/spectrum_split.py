"""Spectrum split: separation of the motions faster than the bandwidth from the others, and of a state into both parts.

The fast motions are the invariant subspace of the oscillating eigenvalues beyond the circle of the bandwidth, of the Jacobian with the unknowns
of loops eliminated. Oscillating means abs(Im) >= abs(Re), a damping ratio of 0.71 at most (the next period of a more damped motion is smaller by
a factor of more than 500). Motions that decay faster than that shorten only the steps in which they decay, and are followed. The projector needs
only the right and left fast eigenvectors: the remaining motions may have Jordan blocks (rigid motion).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, BoolArray, ComplexArray

from ...numerics.scales import nonzero
from ..loops.loops import Eliminated

if TYPE_CHECKING:
    from ..integration.integration_state import IntegrationState

LARGEST = 200  # most states for which all eigenvectors are computed
TOLD_APART = 1e-8  # least singular value of the products of left and right unit vectors, for modes to be separable
RINGS = 1.0  # least ratio of frequency to decay rate of an oscillating mode
PART = 0.2  # least share of a known mode in a mode that continues it
STEADY = 1e-8  # relative to the rate: growth that may come from rounding
GROWN = 1.0  # powers of e by which a fast motion may grow in a run and still be truncated


@dataclass(frozen=True, eq=False)
class Split:
    """Split of n scaled states (states over their magnitudes) with m fast eigenvalues.

    `matrix` (n, n); `values` (m,) in 1/s; `right` (n, m), `dual` (m, n) with dual right = 1. The n - m eigenvalues of the slow part: `others` within
    the circle of the bandwidth, `decays` beyond it, which do not oscillate.
    """

    matrix: Any
    values: Any
    right: Any
    dual: Any
    others: Any
    decays: Any

    @property
    def slowest(self) -> float:
        """Rate of the fastest motion within the circle of the bandwidth, 1/s."""
        return float(np.abs(self.others).max(initial=0.0))

    @cached_property
    def slow(self) -> Any:
        """Projector onto the slow part."""
        return np.eye(len(self.matrix)) - (self.right @ self.dual).real

    def envelope(self, change: Array) -> Any:
        """Return the largest value of each state due to the fast part of a change, for any phases of its modes."""
        return np.abs(self.right) @ np.abs(self.dual @ change)

    @cached_property
    def inverse(self) -> Any:
        """Inverse of the matrix on the fast motions, zero on the others."""
        return (self.right / self.values @ self.dual).real

    def grows(self, span: float) -> bool:
        """Return True if a motion beyond the circle grows within `span` seconds."""
        values = np.append(self.values, self.decays)
        return bool((values.real > np.maximum(GROWN / span, STEADY * np.abs(values))).any())

    @property
    def gap(self) -> float:
        """Smallest distance between an eigenvalue of the slow part and a fast one, 1/s."""
        kept = np.append(self.others, self.decays)
        return float(np.abs(self.values[:, None] - kept).min(initial=np.inf))


@dataclass(frozen=True, eq=False)
class PlaceModes:
    """Discrete modes at k places: `numbers` (k,) are indices into `kinds`."""

    kinds: tuple[Any, ...]
    numbers: Any

    def __getitem__(self, places: Any) -> PlaceModes:
        return PlaceModes(self.kinds, self.numbers[places])

    def each(self, function: Callable[[Any, Any, Any], Any], times: Array, states: Array) -> Any:
        """Evaluate a function of times, states and one mode, once per mode for all places with that mode."""
        if len(self.kinds) == 1:
            return np.asarray(function(times, states, self.kinds[0]))
        places = [np.flatnonzero(self.numbers == kind) for kind in np.unique(self.numbers)]
        values = [np.asarray(function(times[at], states[at], self.kinds[self.numbers[at[0]]])) for at in places]
        return np.concatenate(values)[np.argsort(np.concatenate(places), kind="stable")]


def one(mode: Array, count: int = 1) -> PlaceModes:
    """Return `PlaceModes` with the same mode at `count` places."""
    return PlaceModes((mode,), np.zeros(count, dtype=int))


def several(modes: Sequence[Any]) -> PlaceModes:
    """Return `PlaceModes` from one mode per place; equal modes are stored once."""
    kinds = {np.asarray(mode).tobytes(): mode for mode in modes}
    if len(kinds) == 1:
        return one(modes[0], len(modes))
    numbers = {key: number for number, key in enumerate(kinds)}
    return PlaceModes((*kinds.values(),), np.array([numbers[np.asarray(mode).tobytes()] for mode in modes]))


class ScaledDynamics:
    """Program as a function that gives the rates of scaled states (states over `magnitude` (n,)), with any unknowns of its loops solved."""

    def __init__(self, stepper: IntegrationState) -> None:
        self.stepper, self.program = stepper, stepper.program
        self.count = len(self.program.states.names)
        self.magnitude = stepper.tolerances.magnitude[: self.count]
        self.fixed = (stepper.inputs, stepper.constants)
        self.eliminated = Eliminated(self.program)

    @property
    def allowed(self) -> Any:
        """Tolerance of each state over its magnitude (n,); later searches for magnitudes do not change the ones stored here."""
        found: Any = self.stepper.tolerances.absolute[: self.count] / self.magnitude
        return found

    def whole(self, times: Array, modes: PlaceModes, near: Array, scaled: Array) -> Any:
        """Return states and unknowns in SI.

        `scaled` (k, n) at `times` (k,), with one mode per place; `near` (k, …): states whose unknowns are an initial guess.
        """
        states = np.concatenate([scaled * self.magnitude, near[:, self.count :]], axis=1)
        return states if states.shape[1] == self.count else modes.each(self.stepper.loops.solve_all, times, states)

    def rate(self, time: float, mode: Array, near: Array, scaled: Array) -> Any:
        """Return the rates (n,) of one scaled state; `near`: a state in SI whose unknowns are an initial guess."""
        state = scaled * self.magnitude
        if len(near) > self.count:
            state = self.stepper.loops.solve(time, np.concatenate([state, near[self.count :]]), mode)
        return self.program.derivative(time, state, *self.fixed, mode)[: self.count] / self.magnitude

    def rates(self, times: Array, modes: PlaceModes, near: Array, scaled: Array) -> Any:
        """Return the rates at several instants (k, n)."""

        def at(times: Array, states: Array, mode: Array) -> Any:
            return self.program.derivative(times, states, *self.fixed, mode)

        return modes.each(at, times, self.whole(times, modes, near, scaled))[:, : self.count] / self.magnitude

    def outputs(self, times: Array, modes: PlaceModes, near: Array, scaled: Array) -> Any:
        """Return the outputs (k, outputs)."""

        def at(times: Array, states: Array, mode: Array) -> Any:
            return self.program.output(times, states, *self.fixed, mode)

        return modes.each(at, times, self.whole(times, modes, near, scaled))

    def matrices(self, times: Array, modes: PlaceModes, states: Array) -> Any:
        """Return the Jacobians (k, n, n) of the rates with the unknowns eliminated. `states`: in SI, with their unknowns. Raises `LinAlgError`."""

        def entries(times: Array, states: Array, mode: Array) -> Any:
            return self.eliminated.entries(times, states, *self.fixed, mode)

        size, n = states.shape[1], self.count
        whole = np.zeros((len(times), size, size))
        whole[:, *self.program.pattern] = modes.each(entries, times, states)
        found = whole[:, :n, :n]
        if size > n:
            rows = np.abs(whole[:, n:]).max(axis=2, keepdims=True)
            below = whole[:, n:] / nonzero(rows)
            found = found - whole[:, :n, n:] @ np.linalg.solve(below[:, :, n:], below[:, :, :n])
        return found * self.magnitude / self.magnitude[:, None]

    def splits(self, times: Array, states: Array, modes: PlaceModes, bandwidth: float) -> list[Split | str]:
        """Return, for each state in SI, the split at a bandwidth in Hz, or the reason as text why the fast motions are not separable."""
        if not len(times):
            return []
        if self.count > LARGEST:
            why = f"it has {self.count} states, of which up to {LARGEST} are split into fast and slow ones"
            return [why] * len(times)
        try:
            return split(self.matrices(times, modes, states), 2 * np.pi * bandwidth)
        except np.linalg.LinAlgError:
            return ["its modes are not found"] * len(times)


def split(matrices: Array, rate: float, known: tuple[Any, Any] | None = None) -> list[Split | str]:
    """Split each of several matrices (k, n, n) at a rate in 1/s; or return the reason as text why that is not possible.

    `known`: right and left vectors of modes that belong to the fast part wherever their eigenvalues have moved to. Raises `LinAlgError`.
    """
    values, right = np.linalg.eig(matrices)
    try:
        inverses: Any = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        inverses = np.full_like(right, np.inf)
    sizes, small = np.abs(values), np.linalg.norm(inverses, axis=2).max(axis=1) * TOLD_APART < 1
    found: list[Split | str] = []
    for matrix, value, size, vectors, inverse, fine in zip(
        matrices, values, sizes, right, inverses, small, strict=True
    ):
        beyond = size > rate
        rings = beyond & (np.abs(value.imag) >= RINGS * np.abs(value.real))
        if known is not None and fine:
            rings |= _partners(value, np.abs((inverse @ known[0]) * (known[1] @ vectors).T).max(axis=1) > PART)
        chosen = np.flatnonzero(rings)
        dual = inverse[chosen] if fine or not len(chosen) else _dual(matrix, value[chosen], vectors[:, chosen])
        if dual is None:
            found.append("its fast motions hang together in one that has no modes")
            continue
        fast, right_of = value[chosen].astype(complex), vectors[:, chosen].astype(complex)
        kept = ~rings
        found.append(Split(matrix, fast, right_of, dual.astype(complex), value[kept & ~beyond], value[kept & beyond]))
    return found


def _partners(values: ComplexArray, chosen: BoolArray) -> Any:
    """Return the mask `chosen` extended by the conjugates of the chosen eigenvalues."""
    return chosen | (values[:, None] == values[chosen].conj()).any(axis=1)


def _dual(matrix: Array, fast: ComplexArray, right: Array) -> Any:
    """Return the left vectors of the fast eigenvalues and right vectors, if the slow part is defective (rigid motion); None if the fast part is."""
    values, left = np.linalg.eig(matrix.T)
    left = left[:, np.argsort(np.abs(values[:, None] - fast).min(axis=1), kind="stable")[: len(fast)]].T
    products = left @ right
    if np.linalg.svd(products, compute_uv=False).min() < TOLD_APART:
        return None
    return np.linalg.solve(products, left)
