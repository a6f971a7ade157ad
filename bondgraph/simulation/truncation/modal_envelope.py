"""Modal envelope: amplitude in the outputs of truncated modes, followed along the slow motion, which is known at the reported instants.

A mode that changes slowly keeps c v with w.v' = 0 (v, w: its right and left eigenvector, w.v = 1; first order of the WKB method) and decays
at its own rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, ComplexArray

from ..segments.timeline import Segment
from .mode_truncation import Removal
from .spectrum_split import GROWN, PlaceModes, ScaledDynamics, Split, several, split

# Fractions of a run at which modes are computed after its start; they are no simple fractions of a period of the slow motion.
PLACES = (0.31, 0.67, 1.0)
SHORT = 0.25  # fraction of the run: on a shorter way, modes at its two ends are enough
HALVINGS = 8  # most halvings of an interval across which modes are not recognised
SMALL = 1e-4  # fraction of the largest amplitude: smaller modes are ignored
ALIKE = 0.7  # least share of a mode in one earlier mode; below, it is a mix of modes with equal frequencies
KNOWN = 0.5  # least share of a mode in all modes at the next place for it to be followed there
LOG_SMALL = math.log(SMALL)
EIGHTHS = np.exp(0.25j * np.pi * np.arange(3))  # phases of 0, 1/8 and 1/4 of a turn
INSTANTS = 32  # number of instants with eigenvalues where decay rates change along the way
STEADY = 0.1  # relative change of a decay rate, or powers of e in the run, below which the places are enough
TINY = 1e-300
LARGEST = 40.0  # powers of e: limit of the reported growth of an oscillation


@dataclass(frozen=True, eq=False)
class Way:
    """Slow motion from one removal on, at k instants with their discrete modes; `states` (k, size) in SI."""

    times: Any
    states: Any
    modes: PlaceModes

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, places: Any) -> Way:
        return Way(self.times[places], self.states[places], self.modes[places])

    def moved(self, flow: ScaledDynamics, by: Array) -> tuple[Any, Any, Any, Any]:
        """Return times, modes, states in SI and scaled states for displacements `by` (k, m, n) of the states."""
        k, m, n = by.shape
        scaled, places = self.states[:, None, :n] / flow.magnitude + by, np.repeat(np.arange(k), m)
        return self.times[places], self.modes[places], self.states[places], scaled.reshape(k * m, n)

    def outputs(self, flow: ScaledDynamics, by: Array) -> Any:
        """Return the outputs (k, m, outputs) at states displaced by `by` (k, m, n)."""
        return flow.outputs(*self.moved(flow, by)).reshape(*by.shape[:2], -1)


@dataclass(frozen=True, eq=False)
class Ringing:
    """Truncated modes at some places of a way.

    `shapes` (k, n, p): complex amplitudes a of p modes without growth or decay, over the magnitudes of the flow; the oscillation is the sum of
    Re(a exp(integral of the eigenvalue)). `values` (k, p): eigenvalues at the places. `instants` (f,) with `rates` (f, p): eigenvalues at the
    places and between them, in 1/s. `lost`: time at which a mode that still rings is not recognised, or None.
    """

    way: Way
    splits: Sequence[Split]
    shapes: Any
    values: Any
    instants: Any
    rates: Any
    lost: float | None

    @cached_property
    def logarithms(self) -> Any:
        """Logarithms of the amplitudes at the instants (f, p): integral of the real parts of the eigenvalues."""
        steps = 0.5 * np.diff(self.instants)[:, None] * (self.rates[1:] + self.rates[:-1]).real
        return np.concatenate([np.zeros((1, self.rates.shape[1])), np.cumsum(steps, axis=0)])

    def sizes(self, times: Array) -> Any:
        """Return the amplitudes at rising times (k, p), relative to 1 at the start."""
        if len(self.instants) == 1:
            return np.ones((len(times), self.rates.shape[1]))
        at = np.clip(np.searchsorted(self.instants, times, "right") - 1, 0, len(self.instants) - 2)
        into, real = (times - self.instants[at])[:, None], self.rates.real
        slopes = np.diff(real, axis=0) / np.diff(self.instants)[:, None]
        return np.exp(np.clip(self.logarithms[at] + into * (real[at] + 0.5 * into * slopes[at]), -700.0, LARGEST))

    @cached_property
    def peaks(self) -> Any:
        """Largest amplitude at the instants nearest to each place (k, p)."""
        found = np.exp(np.clip(self.logarithms, -700.0, LARGEST))
        if len(self.instants) == len(self.way):
            return found
        nearest = np.abs(self.instants[:, None] - self.way.times).argmin(axis=1)
        return np.array([found[nearest == k].max(axis=0) for k in range(len(self.way))])

    @cached_property
    def phases(self) -> Any:
        """Phase factors of the modes at the last instant (p,): exp(i times the integral of the imaginary parts of the eigenvalues)."""
        turned = 0.5 * np.diff(self.instants)[:, None] * (self.rates[1:] + self.rates[:-1]).imag
        return np.exp(1j * turned.sum(axis=0))

    @property
    def coming(self) -> Any:
        """Complex amplitudes (n,) of the modes that still ring at the last place."""
        return self.shapes[-1] @ (np.exp(np.clip(self.logarithms[-1], -700.0, LARGEST)) * self.phases)

    @cached_property
    def largest(self) -> Any:
        """Shapes multiplied by their amplitudes at the places."""
        return self.shapes * self.peaks[:, None, :]

    def grows(self) -> tuple[float, float] | None:
        """Return the time since when a mode grows by more than `GROWN` powers of e, and the growth factor; None if no mode grows so much."""
        logarithms = self.logarithms
        grown = logarithms - np.minimum.accumulate(logarithms, axis=0)
        grown = np.where(logarithms > LOG_SMALL, grown, 0.0)
        last, mode = np.unravel_index(grown.argmax(), grown.shape)
        if grown[last, mode] <= GROWN:
            return None
        first = int(logarithms[: last + 1, mode].argmin())
        return float(self.instants[first]), float(np.exp(min(grown[last, mode], LARGEST)))


def ways_of(removals: Sequence[Removal], instants: Array, states: Array, pieces: Sequence[Segment]) -> Iterator[Way]:
    """Yield the slow motion from each removal to the next one or to the end: the reported instants between, and those of the removals."""
    starts, modes = np.array([p.start for p in pieces]), several([p.mode for p in pieces])
    for removal, after in zip_longest(removals, removals[1:]):
        stop = np.inf if after is None else after.time
        first, last = np.searchsorted(instants, removal.time, "right"), np.searchsorted(instants, stop, "left")
        ends = [after] if after is not None and stop > removal.time else []
        times = np.concatenate([[removal.time], instants[first:last], [r.time for r in ends]])
        reached = [removal.after[None], states[first:last], *(r.after[None] for r in ends)]
        numbers = np.searchsorted(starts, times, "left") - 1  # an end belongs to its piece
        numbers[0] = np.searchsorted(starts, removal.time, "right") - 1
        yield Way(times, np.concatenate(reached), modes[np.maximum(numbers, 0)])


def followed(flow: ScaledDynamics, removal: Removal, way: Way, part: float = 1.0, before: Ringing | None = None) -> Ringing:  # fmt: skip
    """Return the modes of an oscillation at places from the start of a way to its end, or to the place at which they are not recognised.

    `part`: fraction of the run that the way covers; `before`: oscillation of the preceding way, which continues on this one.
    """
    last = len(way) - 1
    parts = PLACES if part > SHORT else PLACES[-1:]
    places = sorted({max(1, round(last * p)) for p in parts}) if last else []
    at, coming, lost = removal.found.split, 0.0 if before is None else before.coming, None
    if before is not None:
        both = _with(removal, before)
        at, lost = (at, float(removal.time)) if both is None else (both, None)
    change = 2 * removal.found.removed + coming  # one mode of each conjugate pair is used, with twice the amplitude
    shares = np.abs(at.dual @ change) * np.linalg.norm(at.right, axis=0)
    once = (at.values.imag >= 0) & (shares > SMALL * shares[at.values.imag >= 0].max())
    vectors, duals, values = at.right[:, once], at.dual[once], at.values[once]
    sizes = np.log(shares[once] / shares[once].max())
    amplitudes = duals @ change
    at_places = way[places]
    found = split(flow.matrices(at_places.times, at_places.modes, at_places.states), removal.rate) if places else []
    known: dict[int, Split | str | None] = dict(zip(places, found, strict=True))
    ahead = places[::-1]
    reached, splits, shapes, rates = [0], [at], [vectors * amplitudes], [values]
    while ahead:
        to, span = ahead[-1], way.times[ahead[-1]] - way.times[reached[-1]]
        gone = sizes + 0.5 * span * values.real < LOG_SMALL
        new = _recognised(flow, removal.rate, way[[to]], known.get(to), vectors, duals, gone)
        if new is None and to - reached[-1] > 1 and len(known) < len(places) + HALVINGS:
            ahead.append((reached[-1] + to) // 2)
            known[ahead[-1]] = None
            continue
        if new is None:
            lost = float(way.times[reached[-1]])
            break
        earlier, unknown = values, gone & ~_found(new, vectors, duals) if gone.any() else gone
        vectors, duals, values = carried(vectors, duals, new)
        values = np.where(unknown, earlier, values)  # modes that have decayed and are not recognised keep their rate
        sizes = sizes + 0.5 * span * (earlier + values).real
        reached.append(ahead.pop())
        splits.append(new)
        shapes.append(vectors * amplitudes)
        rates.append(values)
    here = way[reached]
    instants, between = _between(flow, way[: reached[-1] + 1], here.times, np.array(rates))
    return Ringing(here, splits, np.array(shapes), np.array(rates), instants, between, lost)


def _with(removal: Removal, before: Ringing) -> Split | None:
    """Return the split at a removal, with the modes that still ring from before among its fast modes; None if they are not found."""
    at, coming, removed = removal.found.split, before.coming, removal.found.removed

    def has(fast: Split) -> bool:
        rest = coming - fast.right @ (fast.dual @ coming)
        return bool(np.linalg.norm(rest) <= max(KNOWN * np.linalg.norm(coming), SMALL * np.linalg.norm(removed)))

    if has(at):
        return at
    (other,) = split(at.matrix[None], removal.rate, (before.splits[-1].right, before.splits[-1].dual))
    return other if isinstance(other, Split) and has(other) else None


def _recognised(
    flow: ScaledDynamics, rate: float, there: Way, usual: Split | str | None, vectors: ComplexArray, duals: ComplexArray, gone: BoolArray
) -> Split | None:  # fmt: skip
    """Return the split at the one place `there` if it contains all modes that still ring; None otherwise.

    The modes are searched among the fast modes first, then wherever their eigenvalues have moved to.
    """
    if isinstance(usual, Split) and (gone | _found(usual, vectors, duals)).all():
        return usual
    try:
        (other,) = split(flow.matrices(there.times, there.modes, there.states), rate, (vectors, duals))
    except np.linalg.LinAlgError:
        return None
    fits = isinstance(other, Split) and len(other.values) and (gone | _found(other, vectors, duals)).all()
    return other if fits and isinstance(other, Split) else None


def _found(at: Split, vectors: ComplexArray, duals: ComplexArray) -> Any:
    """Return a mask (p,) of the modes that lie in the fast subspace of a split."""
    return np.abs(((at.dual @ vectors) * (duals @ at.right).T).sum(axis=0)) >= KNOWN


def _between(flow: ScaledDynamics, way: Way, places: Array, rates: ComplexArray) -> tuple[Any, Any]:
    """Return instants from the start to the last place, and the eigenvalues there (f, p); more instants where decay rates change."""
    apart, span = np.ptp(rates.real, axis=0), places[-1] - places[0]
    if not (apart > STEADY * np.maximum(np.abs(rates.real).max(axis=0), 1 / max(span, TINY))).any() or len(way) <= len(
        places
    ):
        return places, rates
    chosen = np.union1d(np.linspace(0, len(way) - 1, INSTANTS).astype(int), np.searchsorted(way.times, places))
    there = way[chosen]
    near = np.array(
        [np.interp(there.times, places, part) for part in np.concatenate([rates.real, rates.imag], axis=1).T]
    )
    near = (near[: rates.shape[1]] + 1j * near[rates.shape[1] :]).T
    values = np.linalg.eigvals(flow.matrices(there.times, there.modes, there.states))
    nearest = np.abs(values[:, None, :] - near[:, :, None]).argmin(axis=2)
    found = np.take_along_axis(values, nearest, axis=1).astype(complex)
    found[np.searchsorted(there.times, places)] = rates
    return there.times, found


def carried(vectors: ComplexArray, duals: ComplexArray, new: Split) -> tuple[Any, Any, Any]:
    """Return right and left vectors of the modes at the next place, scaled so that c v changes only in phase, and the eigenvalues there."""
    here, back = new.dual @ vectors, duals @ new.right  # (new, old), (old, new)
    shares = np.abs(here * back.T)  # share of each old mode in each new one: 1 where they are equal
    nearest = shares.argmax(axis=0)
    right, dual, rates = np.empty_like(vectors), np.empty_like(duals), new.values[nearest]
    for old, j in enumerate(nearest):
        if shares[j, old] < ALIKE:  # modes of equal frequency mix arbitrarily: only their sum is preserved
            right[:, old], dual[old] = new.right @ here[:, old], back[old] @ new.dual
            continue
        factor = np.sqrt(here[j, old] / back[old, j])
        factor = -factor if (factor * back[old, j]).real < 0 else factor
        right[:, old], dual[old] = factor * new.right[:, j], new.dual[j] / factor
    return right, dual, rates


def amplitudes(flow: ScaledDynamics, ringing: Ringing) -> Any:
    """Largest amplitude in each output (outputs,) over the places, with all modes at their largest at once.

    For an output that is not linear (a power) the even part is added: its largest value for any phase of a mode, if it grows with the square.
    """
    shapes = ringing.largest.transpose(0, 2, 1)  # (k, p, n)
    count, modes, n = shapes.shape
    ways = (shapes[:, None] * EIGHTHS[:, None, None]).real.reshape(count, -1, n)
    values = ringing.way.outputs(flow, np.concatenate([np.zeros((count, 1, n)), ways, -ways], axis=1))
    moved, back = (values[:, 1:] - values[:, :1]).reshape(count, 2, 3, modes, -1).transpose(1, 2, 0, 3, 4)
    odd, even = 0.5 * (moved - back), 0.5 * (moved + back)
    mean, swing, beside = 0.5 * (even[0] + even[2]), 0.5 * (even[0] - even[2]), even[1] - 0.5 * (even[0] + even[2])
    return (np.hypot(odd[0], odd[2]) + np.abs(mean) + np.hypot(swing, beside)).sum(axis=1).max(axis=0)
