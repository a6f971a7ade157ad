"""A ringing that was left out, followed along the slow motion, which is known at the reported instants: its amplitude in the outputs.

A mode that changes slowly keeps c v with w.v' = 0 (v, w its right and left vector, w.v = 1; the first order of the WKB method), and decays at
its own rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..segments import Segment
from .leave import Removal
from .split import Flow, Modes, Split, several, split

PLACES = 4  # of a run at which modes are computed, after its start
SMALL = 1e-4  # of the largest: modes that ring by less are of no account
ALIKE = 0.7  # of a mode's share in the modes before: else it is taken for several that turn alike


@dataclass(frozen=True, eq=False)
class Way:
    """The slow motion from a removal on, at k instants with their modes; `states` (k, size) in SI."""

    times: Any
    states: Any
    modes: Modes

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, places: Any) -> Way:
        return Way(self.times[places], self.states[places], self.modes[places])

    def moved(self, flow: Flow, by: Any) -> tuple[Any, Any, Any, Any]:
        """Times, modes, states and scaled states for states that are moved (k, m, n)."""
        k, m, n = by.shape
        scaled, places = self.states[:, None, :n] / flow.magnitude + by, np.repeat(np.arange(k), m)
        return self.times[places], self.modes[places], self.states[places], scaled.reshape(k * m, n)

    def outputs(self, flow: Flow, by: Any) -> Any:
        """At states that are moved (k, m, n): (k, m, outputs)."""
        return flow.outputs(*self.moved(flow, by)).reshape(*by.shape[:2], -1)


@dataclass(frozen=True, eq=False)
class Ringing:
    """`shapes` (k, n, p) are the complex amplitudes a of p modes at some places of a way, the sum of Re(a exp(i w t)), over the magnitudes of the flow;
    `values` (k, p) their eigenvalues in 1/s."""

    way: Way
    splits: Sequence[Split]
    shapes: Any
    values: Any


def way_of(removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment]) -> Way:
    """The reported instants after a removal, and that."""
    chosen = np.flatnonzero(instants > removal.time)
    numbers = np.searchsorted([p.start for p in pieces], instants[chosen], "left") - 1  # an end belongs to its piece
    modes = several([removal.mode, *(p.mode for p in pieces)])[np.append(0, 1 + np.maximum(numbers, 0))]
    return Way(np.append(removal.time, instants[chosen]), np.vstack([removal.after, states[chosen]]), modes)


def followed(flow: Flow, removal: Removal, way: Way) -> Ringing:
    """The modes of a ringing at places from the start of a way to its end, or to where there are others."""
    last = len(way) - 1
    places = [last * k // PLACES for k in range(1, PLACES + 1)] if last >= PLACES else list(range(1, last + 1))
    at, removed = removal.found.split, removal.found.removed
    shares = np.abs(at.dual @ removed) * np.linalg.norm(at.right, axis=0)
    once = (at.values.imag >= 0) & (shares > SMALL * shares.max())  # of a conjugate pair one, twice as large
    vectors, duals, values, decay = at.right[:, once], at.dual[once], at.values[once], np.zeros(once.sum())
    amplitudes = duals @ removed * np.where(values.imag > 0, 2.0, 1.0)
    splits, shapes, rates = [at], [vectors * amplitudes], [values]
    there = way[places]
    found = split(flow.matrices(there.times, there.modes, there.states), removal.rate) if places else []
    for span, new in zip(np.diff(way.times[[0, *places]]), found, strict=True):
        if isinstance(new, str) or len(new.values) != len(at.values):
            break
        vectors, duals, values = carried(vectors, duals, new)
        decay = decay + 0.5 * span * (rates[-1].real + values.real)
        splits.append(new)
        shapes.append(vectors * (amplitudes * np.exp(np.minimum(decay, 0.0))))
        rates.append(values)
    return Ringing(way[[0, *places][: len(splits)]], splits, np.array(shapes), np.array(rates))


def carried(vectors: Any, duals: Any, new: Split) -> tuple[Any, Any, Any]:
    """Right and left vectors of the modes at the next place, scaled so that c v changes by nothing but its phase; and the modes' rates there."""
    here, back = new.dual @ vectors, duals @ new.right  # (new, old), (old, new)
    shares = np.abs(here * back.T)  # of the old modes in the new ones: 1 where they are the same
    nearest = shares.argmax(axis=0)
    right, dual, rates = np.empty_like(vectors), np.empty_like(duals), new.values[nearest]
    for old, j in enumerate(nearest):
        if shares[j, old] < ALIKE:  # modes that turn alike mix as they like: what they do together stays
            right[:, old], dual[old] = new.right @ here[:, old], back[old] @ new.dual
            continue
        factor = np.sqrt(here[j, old] / back[old, j])
        factor = -factor if (factor * back[old, j]).real < 0 else factor
        right[:, old], dual[old] = factor * new.right[:, j], new.dual[j] / factor
    return right, dual, rates


def amplitudes(flow: Flow, ringing: Ringing) -> Any:
    """In each output (outputs,): the largest at the places, all modes at their largest at once."""
    shapes = ringing.shapes.transpose(0, 2, 1)  # (k, p, n)
    ways = np.concatenate([shapes.real, shapes.imag, -shapes.real, -shapes.imag], axis=1)
    values = ringing.way.outputs(flow, ways).reshape(len(shapes), 4, shapes.shape[1], -1)
    moved = 0.5 * (values[:, :2] - values[:, 2:])
    return np.hypot(moved[:, 0], moved[:, 1]).sum(axis=1).max(axis=0)
