"""What a ringing that was left out would have done in the rest of the run: its amplitude in the outputs, and what it does to what is kept.

The modes are followed along the slow motion, which is known at the reported instants: a mode that changes slowly keeps c v with w.v' = 0 (v, w its
right and left vector, w.v = 1; the first order of the WKB method), and decays at its own rate. In the mean over its phase a ringing
pushes the slow motion by what is of second order in the rates (for a lossless one by the slope of its frequency, times its action), and the slow motion
answers by its own linear equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..segments import Segment
from .leave import Removal
from .split import Flow, Modes, Split, split

PLACES = 8  # of a run at which modes are computed
IN_A_TURN, LEAST = 4, 48  # instants at which the push on the slow motion is computed: in a turn of it, and in all
ROOM = 2_000_000  # numbers in their matrices
APART = 0.01  # of its rate: modes nearer to one are taken together with it
ALIKE = 0.7  # of a mode's share in the modes before: else it is taken for several that turn alike
ALIKE_ENOUGH = (
    0.01  # by which the answer within an interval may differ from that in the first of several that are taken for one
)
PHASES = np.exp(0.5j * np.pi * np.arange(4))
TERMS = 8  # of the series of an exponential, where what it is of is below 1


@dataclass(frozen=True, eq=False)
class Way:
    """The slow motion from a removal on, at k instants with their modes; `states` (k, size) in SI. `places` of these have `splits`; `shapes` (k, n, p) are
    the complex amplitudes a of the ringing, the sum of Re(a exp(i w t)), over the magnitudes of the flow; `later`, alike, is what they
    get by changing on the way; `matrices` (k, n, n)."""

    times: Any
    states: Any
    modes: Modes
    places: Any
    splits: Sequence[Split]
    shapes: Any
    later: Any
    matrices: Any


def followed(flow: Flow, removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment]) -> Way:
    """The modes of a ringing along the states at the reported instants, up to where there are others."""
    times, whole, modes = _trace(flow, removal, instants, states, pieces)
    last = len(times) - 1
    places = np.unique(np.linspace(0, last, min(PLACES, last) + 1).round().astype(int))
    matrices = flow.matrices(times, modes, whole)
    at = removal.found.split
    vectors, duals, values, decay = at.right, at.dual, at.values, np.zeros(len(at.values))
    once = values.imag >= 0  # of a conjugate pair one, twice as large
    amplitudes = (at.dual @ removal.found.removed)[once] * np.where(values[once].imag > 0, 2.0, 1.0)
    splits, shapes = [at], [vectors[:, once] * amplitudes]
    resolvents = [_resolvents(at, vectors, duals, values, once)]
    found = split(matrices[places[1:]], removal.rate) if last else []
    for span, new in zip(np.diff(times[places]), found, strict=True):
        if isinstance(new, str) or len(new.values) != len(values):
            break
        vectors, duals, rates = carried(vectors, duals, new)
        decay, values = decay + 0.5 * span * (values.real + rates.real), rates
        splits.append(new)
        shapes.append(vectors[:, once] * (amplitudes * np.exp(np.minimum(decay[once], 0.0))))
        resolvents.append(_resolvents(new, vectors, duals, values, once))
    places = places[: len(splits)]
    count = places[-1] + 1
    way = Way(times[:count], whole[:count], modes[:count], places, splits, np.array(shapes), 0.0, matrices[:count])
    if count == 1:
        return way
    way = replace(way, shapes=_between(way, resolvents))
    return replace(way, later=_later(way, resolvents))


def _trace(
    flow: Flow, removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment]
) -> tuple[Any, Any, Modes]:
    """Times, states in SI and modes from where something was removed to the end, some of the reported instants."""
    chosen = np.flatnonzero(instants > removal.time)
    turns = removal.found.split.slowest * float(instants[-1] - removal.time) / (2 * np.pi) if len(chosen) else 0.0
    wanted = min(max(LEAST, round(IN_A_TURN * turns)), max(1, ROOM // flow.count**2))
    chosen = chosen[::-1][:: max(1, -(-len(chosen) // wanted))][::-1]  # intervals of one length, but for the first
    numbers = (
        np.searchsorted([p.start for p in pieces], instants[chosen], "left") - 1
    )  # where a piece ends belongs to it
    modes = Modes((removal.mode, *(p.mode for p in pieces)), np.append(0, 1 + np.maximum(numbers, 0)))
    return np.append(removal.time, instants[chosen]), np.vstack([removal.after, states[chosen]]), modes


def _resolvents(at: Split, vectors: Any, duals: Any, values: Any, once: Any) -> Any:
    """For some of the modes (p, n, n): by what the other motions take part in one where the matrix changes a little."""
    unit, rates = np.eye(len(at.matrix)), values[once][:, None, None]
    near = np.abs(values - values[once][:, None]) <= APART * np.abs(values[once])[:, None]
    own = (vectors * near[:, None, :]) @ duals
    return np.linalg.solve(rates * (unit + own) - at.matrix, unit - own)


def _between(way: Way, resolvents: Sequence[Any]) -> Any:
    """Shapes at all instants up to the last of the places: from those on both sides, and to first order by what the matrix is there."""
    found = np.empty((len(way.times), *way.shapes.shape[1:]), dtype=complex)
    for k, (start, stop) in enumerate(pairwise(way.places)):
        here = slice(start, stop + 1)
        share = ((way.times[here] - way.times[start]) / (way.times[stop] - way.times[start]))[:, None, None]
        both = []
        for j in (k, k + 1):
            turned = (way.matrices[here] - way.splits[j].matrix) @ way.shapes[j]
            both.append(way.shapes[j] + _through(resolvents[j], turned))
        found[here] = both[0] * (1 - share) + both[1] * share
    return found


def _later(way: Way, resolvents: Sequence[Any]) -> Any:
    """What shapes get by changing on the way: the next order of the WKB method, out of phase. Small, but a fast rate makes it large again."""
    changes = np.gradient(way.shapes, way.times, axis=0)
    found = np.empty_like(changes)
    for k, (start, stop) in enumerate(pairwise(way.places)):
        here = slice(start, stop + 1)
        found[here] = -_through(resolvents[k], changes[here])
    return found


def _through(resolvents: Any, changes: Any) -> Any:
    """Each mode's (p, n, n) on its changes (c, n, p), for all modes."""
    return (resolvents @ changes.transpose(2, 1, 0)).transpose(2, 1, 0)


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
    scaled, places = way.states[places, None, :n] / flow.magnitude + moved, np.repeat(places, m)
    return way.times[places], way.modes[places], way.states[places], scaled.reshape(k * m, n)


def _outputs(flow: Flow, way: Way, places: Any, moved: Any) -> Any:
    """At states that are moved (k, m, n) from some places: (k, m, outputs)."""
    return flow.outputs(*_moved(flow, way, places, moved)).reshape(*moved.shape[:2], -1)


def kept(flow: Flow, way: Way) -> Any:
    """What the ringing does to the motion that is kept, the largest in each output (outputs,)."""
    count, n = len(way.times), flow.count
    if len(way.places) < 2:
        return np.zeros(len(flow.program.outputs.names))
    pushes = _pushes(flow, way)
    places = np.clip(np.searchsorted(way.places, np.arange(count - 1), "right") - 1, 0, len(way.splits) - 1)
    slow = np.array([at.slow for at in way.splits])[places]
    static = np.array([at.inverse for at in way.splits])[places]
    lengths = np.diff(way.times)[:, None, None]
    answers = slow @ (0.5 * lengths * (way.matrices[:-1] + way.matrices[1:])) @ slow
    changes = np.abs(np.diff(answers, axis=0)).sum(axis=2).max(axis=1)
    groups = np.floor(np.cumsum(np.append(0.0, changes)) / ALIKE_ENOUGH).astype(int)
    _, first, groups = np.unique(groups, return_index=True, return_inverse=True)
    through, mean = (found[groups] for found in _propagators(answers[first]))
    forced = lengths[:, 0] * (mean @ (slow @ (0.5 * (pushes[:-1] + pushes[1:]))[:, :, None]))[:, :, 0]
    moved = np.zeros((count, 2, n))
    x = -slow[0] @ way.later[0].real.sum(axis=1)  # what is removed has none of it
    for k in range(count - 1):
        x = through[k] @ x + forced[k]
        moved[k + 1, 0] = x
    moved[1:, 0] -= (static @ pushes[1:, :, None])[:, :, 0]
    values = _outputs(flow, way, np.arange(count), moved)
    return np.abs(values[:, 0] - values[:, 1]).max(axis=0)


def _pushes(flow: Flow, way: Way) -> Any:
    """The mean of the rates over the phases of the ringing, less those without it (k, n)."""
    count, n, modes = way.shapes.shape
    ways = ((way.shapes + way.later).transpose(0, 2, 1)[:, :, None, :] * PHASES[:, None]).real.reshape(
        count, 4 * modes, n
    )
    moved = np.concatenate([np.zeros((count, 1, n)), ways], axis=1)
    rates = flow.rates(*_moved(flow, way, np.arange(count), moved)).reshape(count, -1, n)
    return (rates[:, 1:] - rates[:, :1]).mean(axis=1) * modes


def _propagators(matrices: Any) -> tuple[Any, Any]:
    """exp(A), and its mean over the way there, of several matrices (k, n, n): by Taylor's series and doubling, to some four digits."""
    norm = float(np.abs(matrices).sum(axis=1).max(initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(norm)))) if 0 < norm < np.inf else 0
    part, unit = matrices / 2.0**halvings, np.eye(matrices.shape[-1])
    mean = term = unit
    for order in range(2, TERMS):
        term = term @ part / order
        mean = mean + term
    through = unit + part @ mean
    for _ in range(halvings):
        mean = 0.5 * (mean + mean @ through)
        through = through @ through
    return through, mean
