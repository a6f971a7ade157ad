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
PARTS = 16  # of the way from one to the next, in which the slow motion answers
ALIKE = 0.7  # of a mode's share in the modes before: else it is taken for several that turn alike
PHASES = np.exp(0.5j * np.pi * np.arange(4))
TERMS = 12  # of the series of an exponential


@dataclass(frozen=True, eq=False)
class Way:
    """Places of the slow motion from a removal on. `states` (k, size) in SI; `splits` what is fast there, `shapes` (k, n, p) the complex
    amplitudes a of the ringing there, the sum of Re(a exp(i w t)), over the magnitudes of the flow."""

    times: Any
    states: Any
    modes: Sequence[Any]
    splits: Sequence[Split]
    shapes: Any


def followed(
    flow: Flow, removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment], bandwidth: float
) -> Way:
    """The modes of a ringing along the states at the reported instants, up to where there are others."""
    chosen = np.flatnonzero(instants > removal.time)
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(PLACES, len(chosen))).round().astype(int))]
    starts = np.array([p.start for p in pieces])
    numbers = np.searchsorted(starts, instants[chosen], "left") - 1  # an instant at which a piece ends belongs to it
    modes = [removal.mode, *(pieces[max(0, k)].mode for k in numbers)]
    times = np.append(removal.time, instants[chosen])
    whole = np.vstack([removal.after, states[chosen]])
    now = removal.found.split
    amplitudes = now.dual @ removal.found.removed
    vectors, duals, values, decay = now.right, now.dual, now.values, np.zeros(len(now.values))
    splits, shapes = [now], [_once(values, vectors * amplitudes)]
    for k, new in enumerate(flow.splits(times[1:], whole[1:], modes[1:], bandwidth), 1):
        if isinstance(new, str) or len(new.values) != len(values):
            break
        vectors, duals, rates = carried(vectors, duals, new)
        decay = decay + 0.5 * (values.real + rates.real) * (times[k] - times[k - 1])
        values = rates
        splits.append(new)
        shapes.append(_once(now.values, vectors * (amplitudes * np.exp(np.minimum(decay, 0.0)))))
    count = len(splits)
    return Way(times[:count], whole[:count], modes[:count], splits, np.array(shapes))


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
    """Of the ringing in each output (outputs,): the largest on the way, all modes at their largest at once."""
    count, n, modes = way.shapes.shape
    ways = np.stack([way.shapes.real, way.shapes.imag, -way.shapes.real, -way.shapes.imag], axis=1)  # (k, 4, n, p)
    values = _outputs(flow, way, ways.transpose(0, 1, 3, 2).reshape(count, 4 * modes, n)).reshape(count, 4, modes, -1)
    moved = 0.5 * (values[:, :2] - values[:, 2:])
    return np.hypot(moved[:, 0], moved[:, 1]).sum(axis=1).max(axis=0)


def _outputs(flow: Flow, way: Way, moved: Any) -> Any:
    """At states that are moved (k, m, n) from the places of the way: (k, m, outputs)."""
    k, m, n = moved.shape
    scaled = way.states[:k, None, :n] / flow.magnitude + moved
    return flow.outputs(*_spread(way, k, m), scaled.reshape(k * m, n)).reshape(k, m, -1)


def _spread(way: Way, count: int, m: int) -> tuple[Any, Any, Any]:
    """Times, modes and states of the first places, each m times."""
    return (
        np.repeat(way.times[:count], m),
        [mode for mode in way.modes[:count] for _ in range(m)],
        np.repeat(way.states[:count], m, axis=0),
    )


def kept(flow: Flow, way: Way) -> Any:
    """What the ringing does to the motion that is kept, the largest in each output (outputs,)."""
    pushes = _pushes(flow, way)
    count, n = len(way.times) - 1, flow.count
    if count < 1:
        return np.zeros(len(flow.program.outputs.names))
    spans = np.diff(way.times)
    whole, norm = np.zeros((count, n + 2, n + 2)), 0.0
    for k, (split, span) in enumerate(zip(way.splits[:-1], spans, strict=True)):
        slow, step = split.slow, span / PARTS
        whole[k, :n, :n] = step * (split.matrix @ slow)
        norm = max(norm, float(np.abs(whole[k, :n, :n]).sum(axis=0).max()))
        whole[k, :n, n], whole[k, :n, n + 1] = step * (slow @ pushes[k]), step * (slow @ (pushes[k + 1] - pushes[k]))
    whole[:, n + 1, n] = 1 / PARTS  # the share of the way to the next place
    through = [_exponential(whole, norm)]
    for _ in range(PARTS - 1):
        through.append(through[-1] @ through[0])
    moved, x = np.zeros((count, PARTS + 1, n)), np.zeros(n + 2)
    for k, parts in enumerate(np.array(through).swapaxes(0, 1)):
        x[n:] = 1.0, 0.0
        answers = parts @ x
        moved[k, :PARTS] = answers[:, :n] - way.splits[k].inverse @ pushes[k]
        x = answers[-1]
    values = _outputs(flow, way, moved)  # the last of each place is not moved
    return np.abs(values[:, :-1] - values[:, -1:]).max(axis=(0, 1))


def _pushes(flow: Flow, way: Way) -> Any:
    """The mean of the rates over the phases of the ringing, less those without it (k, n)."""
    count, n, modes = way.shapes.shape
    ways = (way.shapes.transpose(0, 2, 1)[:, :, None, :] * PHASES[:, None]).real.reshape(count, 4 * modes, n)
    moved = np.concatenate([np.zeros((count, 1, n)), ways], axis=1)
    scaled = way.states[:, None, :n] / flow.magnitude + moved
    rates = flow.rates(*_spread(way, count, 4 * modes + 1), scaled.reshape(-1, n)).reshape(count, -1, n)
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
