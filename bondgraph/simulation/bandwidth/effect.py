"""What a ringing that was left out would have done in the rest of the run: its amplitude in the outputs, and what it does to what is kept.

The modes are followed along the slow motion, whose states are known at the reported instants: a mode that changes slowly keeps the product of its
amplitude and its left vector's (to the first order of the WKB method: c v with w.v' = 0), and decays by its own rate. In the mean over its phase
a ringing pushes the slow motion by what is of second order in the rates (for a lossless one the slope of its action's frequency); the slow motion
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
INSTANTS = 200  # at which the push on the slow motion is computed
ALIKE = 0.7  # of a mode's share in the modes before: else it is taken for several that turn alike
TERMS = 12  # of the series of an exponential
PHASES = np.exp(0.5j * np.pi * np.arange(4))


@dataclass(frozen=True, eq=False)
class Place:
    """Where the slow motion is at an instant, in SI, with its unknowns; what is fast there."""

    time: float
    state: Any
    mode: Any
    split: Split
    shapes: Any  # (n, m): the complex amplitudes of the ringing there, m modes, over the magnitudes of the flow


@dataclass(frozen=True, eq=False)
class Trace:
    """The slow motion at the reported instants from a removal on."""

    times: Any
    states: Any
    modes: Sequence[Any]


def traced(removal: Removal, instants: Any, states: Any, pieces: Sequence[Segment]) -> Trace:
    """From where something was removed to the end, at `INSTANTS` instants or fewer."""
    chosen = np.flatnonzero(instants > removal.time)
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(INSTANTS, len(chosen))).round().astype(int))]
    starts = np.array([p.start for p in pieces])
    numbers = np.searchsorted(starts, instants[chosen], "left") - 1  # an instant at which a piece ends belongs to it
    modes = [removal.mode, *(pieces[max(0, k)].mode for k in numbers)]
    return Trace(np.append(removal.time, instants[chosen]), np.vstack([removal.after, states[chosen]]), modes)


def followed(flow: Flow, removal: Removal, trace: Trace, bandwidth: float) -> list[Place]:
    """The modes of a ringing at some places of the trace, up to where there are others."""
    now = removal.found.split
    shapes = now.right * (now.dual @ removal.found.removed)
    vectors, duals, values, decay = now.right, now.dual, now.values, np.zeros(len(now.values))
    amplitudes = now.dual @ removal.found.removed
    found = [Place(float(trace.times[0]), trace.states[0], trace.modes[0], now, shapes)]
    last = len(trace.times) - 1
    for k in np.unique(np.linspace(0, last, min(PLACES, last + 1)).round().astype(int))[1:]:
        new = flow.split(float(trace.times[k]), trace.states[k], trace.modes[k], bandwidth)
        if isinstance(new, str) or len(new.values) != len(values):
            break
        vectors, duals, rates = carried(vectors, duals, new)
        decay = decay + 0.5 * (values.real + rates.real) * (trace.times[k] - found[-1].time)
        values = rates
        shapes = vectors * (amplitudes * np.exp(np.minimum(decay, 0.0)))
        found.append(Place(float(trace.times[k]), trace.states[k], trace.modes[k], new, shapes))
    return found


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


def amplitudes(flow: Flow, places: Sequence[Place]) -> Any:
    """Of the ringing in each output (outputs,): the largest at the places, all modes at their largest at once."""
    found = [_amplitudes_at(flow, place) for place in places]
    return np.max(found, axis=0)


def _amplitudes_at(flow: Flow, place: Place) -> Any:
    shapes = _once(place.split, place.shapes)
    ways = np.concatenate([shapes.real, shapes.imag], axis=1).T
    middle = place.state[: flow.count] / flow.magnitude
    scaled = np.concatenate([middle + ways, middle - ways])
    values = _outputs(flow, np.full(len(scaled), place.time), scaled, place.mode, place.state)
    up, down = values[: len(ways)], values[len(ways) :]
    moved = (0.5 * (up - down)).reshape(2, len(ways) // 2, -1)
    return np.hypot(*moved).sum(axis=0)


def _once(split: Split, shapes: Any) -> Any:
    """Amplitudes of motions Re(a exp(i w t)): of a conjugate pair one, twice as large."""
    chosen = split.values.imag >= 0
    return shapes[:, chosen] * np.where(split.values[chosen].imag > 0, 2.0, 1.0)


def _outputs(flow: Flow, times: Any, scaled: Any, mode: Any, near: Any) -> Any:
    whole = flow.whole(times, scaled, mode, np.broadcast_to(near, (len(scaled), len(near))))
    return np.asarray(flow.program.output(times, whole, *flow.fixed, mode))


def kept(flow: Flow, places: Sequence[Place], trace: Trace) -> Any:
    """What the ringing does to the motion that is kept, the largest in each output (outputs,)."""
    answer, largest = np.zeros(flow.count), 0.0
    pushes = [_push(flow, place) for place in places]
    for first, second, g, h in zip(places, places[1:], pushes, pushes[1:], strict=False):
        inside = (trace.times > first.time) & (trace.times <= second.time)
        times = np.append(first.time, trace.times[inside])
        count = len(times) - 1
        moved = _answers(first.split, answer, (g, h), times)
        answer = moved[-1]
        share = ((times[1:] - first.time) / (second.time - first.time))[:, None]
        static = first.split.inverse @ g * (1 - share) + second.split.inverse @ h * share
        middle = trace.states[inside][:, : flow.count] / flow.magnitude
        both = np.concatenate([middle + moved - static, middle])
        values = _outputs(flow, np.tile(times[1:], 2), both, first.mode, first.state)
        largest = np.maximum(largest, np.abs(values[:count] - values[count:]).max(axis=0))
    return largest


def _push(flow: Flow, place: Place) -> Any:
    """The mean of the rates over the phases of the ringing, less those without it (n,)."""
    shapes = _once(place.split, place.shapes)
    middle = place.state[: flow.count] / flow.magnitude
    ways = (shapes.T[:, None, :] * PHASES[:, None]).real.reshape(-1, flow.count)
    scaled = np.concatenate([middle[None], middle + ways])
    near = np.broadcast_to(place.state, (len(scaled), len(place.state)))
    rates = flow.rates(np.full(len(scaled), place.time), scaled, place.mode, near)
    return (rates[1:] - rates[0]).mean(axis=0) * shapes.shape[1]


def _answers(at: Split, start: Any, pushes: tuple[Any, Any], times: Any) -> Any:
    """The slow answer to a push that changes evenly from one to the other, at times[1:]; x' = A x + g, both on what is slow."""
    n, (g, h) = len(start), pushes
    span = times[-1] - times[0]
    slow = at.slow
    known: dict[float, Any] = {}
    x = np.concatenate([slow @ start, [1.0, 0.0]])
    found = np.empty((len(times) - 1, n))
    for k, length in enumerate(np.diff(times)):
        key = float(np.round(length / span, 9))
        if key not in known:
            whole = np.zeros((n + 2, n + 2))
            whole[:n, :n] = length * (at.matrix @ slow)
            whole[:n, n], whole[:n, n + 1] = length * (slow @ g), length * (slow @ (h - g))
            whole[n + 1, n] = length / span  # the share of the way
            known[key] = _exponential(whole, float(np.abs(whole[:n, :n]).sum(axis=0).max(initial=0.0)))
        x = known[key] @ x
        found[k] = x[:n]
    return found


def _exponential(matrix: Any, norm: float) -> Any:
    """By Taylor's series and squaring; to some ten digits, which is plenty for an estimate. `norm`: of the part that is no forcing."""
    halvings = max(0, int(np.ceil(np.log2(norm))) + 1) if 0 < norm < np.inf else 0
    part = matrix / 2.0**halvings
    result = term = np.eye(len(matrix))
    for order in range(1, TERMS):
        term = term @ part / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result
