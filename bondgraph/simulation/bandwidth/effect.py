"""What a ringing that was left out would have done in the rest of the run: its amplitude in the outputs, and what it does to what is kept.

The modes are followed along the slow motion, which is known at the reported instants: a mode that changes slowly keeps c v with w.v' = 0 (v, w its
right and left vector, w.v = 1; the first order of the WKB method), and decays at its own rate. In the mean over its phase a ringing
pushes the slow motion by what is of second order in the rates (for a lossless one by the slope of its frequency, times its action), and the slow motion
answers by its own linear equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..segments import Segment
from .leave import Removal
from .split import Flow, Split

PLACES = 12  # of a run at which modes are computed
IN_A_TURN, LEAST, MOST = (
    8,
    48,
    1000,
)  # instants at which the push on the slow motion is computed: in a turn of it, and in all
ALIKE = 0.7  # of a mode's share in the modes before: else it is taken for several that turn alike
PHASES = np.exp(0.5j * np.pi * np.arange(4))
TERMS = 12  # of the series of an exponential


@dataclass(frozen=True, eq=False)
class Way:
    """The slow motion from a removal on, at k instants with their modes; `states` (k, size) in SI. `places` of these have `splits`; `shapes` (k, n, p) are
    the complex amplitudes a of the ringing, the sum of Re(a exp(i w t)), over the magnitudes of the flow."""

    times: Any
    states: Any
    modes: Sequence[Any]
    places: Any
    splits: Sequence[Split]
    shapes: Any


def followed(
    flow: Flow, removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment], bandwidth: float
) -> Way:
    """The modes of a ringing along the states at the reported instants, up to where there are others."""
    now = removal.found.split
    turns = now.slowest * float(instants[-1] - removal.time) / (2 * np.pi) if len(instants) else 0.0
    chosen = np.flatnonzero(instants > removal.time)
    most = min(len(chosen), MOST, max(LEAST, round(IN_A_TURN * turns)))
    chosen = chosen[np.linspace(len(chosen) - 1, 0, most, endpoint=False).round().astype(int)[::-1]]
    starts = np.array([p.start for p in pieces])
    numbers = np.searchsorted(starts, instants[chosen], "left") - 1  # an instant at which a piece ends belongs to it
    modes = [removal.mode, *(pieces[max(0, k)].mode for k in numbers)]
    times, whole = np.append(removal.time, instants[chosen]), np.vstack([removal.after, states[chosen]])
    places = np.unique(np.linspace(0, most, min(PLACES, most) + 1).round().astype(int))
    amplitudes = now.dual @ removal.found.removed
    vectors, duals, values, decay = now.right, now.dual, now.values, np.zeros(len(now.values))
    splits, shapes = [now], [_once(values, vectors * amplitudes)]
    found = flow.splits(times[places[1:]], whole[places[1:]], [modes[k] for k in places[1:]], bandwidth)
    for before, after, new in zip(places, places[1:], found, strict=False):
        if isinstance(new, str) or len(new.values) != len(values):
            break
        vectors, duals, rates = carried(vectors, duals, new)
        decay = decay + 0.5 * (values.real + rates.real) * (times[after] - times[before])
        values = rates
        splits.append(new)
        shapes.append(_once(now.values, vectors * (amplitudes * np.exp(np.minimum(decay, 0.0)))))
    places = places[: len(splits)]
    count = places[-1] + 1
    return Way(times[:count], whole[:count], modes[:count], places, splits, _between(times, places, np.array(shapes)))


def _between(times: Any, places: Any, shapes: Any) -> Any:
    """Shapes at all instants up to the last of the places, evenly from one to the next."""
    if len(places) < 2:
        return shapes
    here = times[: places[-1] + 1]
    k = np.clip(np.searchsorted(times[places], here, "right") - 1, 0, len(places) - 2)
    share = ((here - times[places[k]]) / (times[places[k + 1]] - times[places[k]]))[:, None, None]
    return shapes[k] * (1 - share) + shapes[k + 1] * share


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


def _once(values: Any, shapes: Any) -> Any:
    """Of a conjugate pair one, twice as large."""
    chosen = values.imag >= 0
    return shapes[:, chosen] * np.where(values[chosen].imag > 0, 2.0, 1.0)


def amplitudes(flow: Flow, way: Way) -> Any:
    """Of the ringing in each output (outputs,): the largest at the places, all modes at their largest at once."""
    shapes = way.shapes[way.places].transpose(0, 2, 1)  # (k, p, n)
    ways = np.concatenate([shapes.real, shapes.imag, -shapes.real, -shapes.imag], axis=1)
    values = _outputs(flow, way, way.places, ways).reshape(len(shapes), 4, shapes.shape[1], -1)
    moved = 0.5 * (values[:, :2] - values[:, 2:])
    return np.hypot(moved[:, 0], moved[:, 1]).sum(axis=1).max(axis=0)


def _moved(flow: Flow, way: Way, places: Any, moved: Any) -> tuple[Any, Any, Any, Any]:
    """Times, modes, states and scaled states for states that are moved (k, m, n) from some places."""
    k, m, n = moved.shape
    scaled = way.states[places, None, :n] / flow.magnitude + moved
    modes = [way.modes[place] for place in places for _ in range(m)]
    return np.repeat(way.times[places], m), modes, np.repeat(way.states[places], m, axis=0), scaled.reshape(k * m, n)


def _outputs(flow: Flow, way: Way, places: Any, moved: Any) -> Any:
    """At states that are moved (k, m, n) from some places: (k, m, outputs)."""
    return flow.outputs(*_moved(flow, way, places, moved)).reshape(*moved.shape[:2], -1)


def kept(flow: Flow, way: Way) -> Any:
    """What the ringing does to the motion that is kept, the largest in each output (outputs,)."""
    count, n = len(way.times), flow.count
    if len(way.places) < 2:
        return np.zeros(len(flow.program.outputs.names))
    pushes = _pushes(flow, way)
    parts, spans = np.diff(way.places), np.diff(way.times[way.places])
    whole, norm = np.zeros((len(parts), 2 * n, 2 * n)), 0.0
    for k, (split, length) in enumerate(zip(way.splits, spans / parts, strict=False)):
        whole[k, :n, :n], whole[k, :n, n:] = length * (split.matrix @ split.slow), length * split.slow
        norm = max(norm, float(np.abs(whole[k, :n, :n]).sum(axis=0).max()))
    through = _exponential(whole, norm)[:, :n]
    moved, x, place = np.zeros((count, 2, n)), np.zeros(2 * n), 0
    for k, number in enumerate(parts):
        static = way.splits[k].inverse
        for _ in range(number):
            x[n:] = 0.5 * (pushes[place] + pushes[place + 1])
            x[:n] = through[k] @ x
            place += 1
            moved[place, 0] = x[:n] - static @ pushes[place]
    values = _outputs(flow, way, np.arange(count), moved)
    return np.abs(values[:, 0] - values[:, 1]).max(axis=0)


def _pushes(flow: Flow, way: Way) -> Any:
    """The mean of the rates over the phases of the ringing, less those without it (k, n)."""
    count, n, modes = way.shapes.shape
    ways = (way.shapes.transpose(0, 2, 1)[:, :, None, :] * PHASES[:, None]).real.reshape(count, 4 * modes, n)
    moved = np.concatenate([np.zeros((count, 1, n)), ways], axis=1)
    rates = flow.rates(*_moved(flow, way, np.arange(count), moved)).reshape(count, -1, n)
    return (rates[:, 1:] - rates[:, :1]).mean(axis=1) * modes


def _exponential(matrices: Any, norm: float) -> Any:
    """Of several matrices by Taylor's series and squaring, to some ten digits. `norm`: of their parts that are no forcing."""
    halvings = max(0, int(np.ceil(np.log2(norm))) + 1) if 0 < norm < np.inf else 0
    part = matrices / 2.0**halvings
    result = term = np.eye(matrices.shape[-1])
    for order in range(1, TERMS):
        term = term @ part / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result
