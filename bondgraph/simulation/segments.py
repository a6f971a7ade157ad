"""The stretches of time on which the right side is smooth: between the instants of steps, pulses, ramps and `if` on time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..door import Program
from ..errors import RunFailed
from .events.zeros import crossing

GRID = 256  # places at which a stretch is searched for zeros that have no formula
NODES = 4096  # places at which what time alone moves is known, of a whole run
PER_PERIOD = 8  # such places for each period of a noise, if there are more
MAXIMUM_GRID = 2_000_000
SPARSE = 16  # places for each change of sign, else more are taken
GOLDEN = 0.6180339887498949
MOST_SAMPLES = 1_000_000  # of one sampled event
SHARE = 1e-4  # of a signal's range: what a step may overlook of it; some twelve steps for each period of a sine
ROUNDING = 16  # units in the last place of a time
# Where a step looks, places between, and the weights that a cubic through the former has at the latter.
SEEN = np.array([0.0, 0.155, 0.645, 1.0])
LOOKS = np.concatenate([SEEN, [0.075, 0.3, 0.5, 0.85]])
BETWEEN = np.linalg.solve(np.vander(SEEN).T, np.vander(LOOKS[4:], 4).T).T
CUBIC = np.linalg.inv(np.vander(SEEN))  # from the values there to the coefficients of that cubic, the highest first


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of time and the truth of the conditions on time within it."""

    start: float
    stop: float
    mode: Any


def segments(program: Program, constants: Any, start: float, stop: float) -> list[Segment]:
    """Cut [start, stop] where an expression of time jumps or bends."""
    cuts = [t for t in np.atleast_1d(program.instants(constants)) if start < t < stop]
    if program.hybrid is not None:
        cuts += [t for p in program.hybrid.sampling(constants) for t in _multiples(float(p), start, stop)]
    edges = _distinct([start, *sorted(cuts), stop])
    edges = _distinct(sorted([*edges, *_zeros(program, constants, edges)]))
    return [Segment(a, b, _mode(program, constants, 0.5 * (a + b))) for a, b in pairwise(edges)]


def _multiples(period: float, start: float, stop: float) -> Any:
    """The instants at which an event is sampled."""
    if not period > 0 or (stop - start) / period > MOST_SAMPLES:
        raise RunFailed(
            f"an event every {period:g} s for {stop - start:g} s acts more than {MOST_SAMPLES} times, or never"
        )
    times = period * np.arange(np.floor(start / period), np.ceil(stop / period) + 1)
    return times[(times > start) & (times < stop)]


@dataclass(frozen=True, slots=True)
class Signals:
    """What time alone moves on a stretch: how much of each signal a step may overlook, and what they are at many places."""

    allowed: Any  # (signals,)
    times: Any  # (places,), rising
    values: Any  # (places, signals)
    steady: bool  # whether they are the same at all of them


def signals_on(program: Program, inputs: Any, constants: Any, stretch: Segment, whole: float = 0.0) -> Signals:
    """The signals on a stretch, at places that lie irregularly: the denser, the larger its share of the `whole` run is.

    What turns up at none of these places (shorter than 1/4096 of a run) is not known, and may be stepped over.
    """
    span = stretch.stop - stretch.start
    share = span / whole if whole > 0 else 0.0
    begin, end = inside(stretch)  # where a narrow pulse may have its crest
    if not program.signals(begin, inputs, constants, stretch.mode).shape[-1]:
        return Signals(np.zeros(0), np.zeros(0), np.zeros((0, 0)), False)
    numbers = np.arange(int(min(NODES, max(GRID, NODES * share))))
    times = stretch.start + span * (numbers + (GOLDEN * numbers + 0.5) % 1.0) / len(numbers)
    times = np.concatenate([[begin], np.clip(times, begin, end), [end]])
    values = program.signals(times, inputs, constants, stretch.mode)
    allowed = SHARE * np.ptp(values, axis=0) + 1e-9 * np.abs(values).max(axis=0)  # the latter for rounding
    steady = len(values) > 0 and not np.ptp(values, axis=0).any()
    return Signals(allowed, times, values, bool(steady))


def follower(
    program: Program, inputs: Any, constants: Any, stretch: Segment, known: Signals | None = None, coarse: float = 1.0
) -> Callable[[float, float], bool]:
    """Tells whether a step sees what time alone moves: the cubic through the places at which the step looks must be close to
    the signal between them, to a share of the range that the signal has; and so at every place in the step at which the signal
    is known. A rectifier whose diode is off at all of a step's places would else not see the next peak, and a pulse
    that is short beside a step would not be seen at all. `known`: the signals there, if they have been asked for; `coarse`: times as much may be missed, for a
    first look."""
    known, ends = known or signals_on(program, inputs, constants, stretch), inside(stretch)
    allowed = coarse * known.allowed
    if not len(allowed):
        return lambda start, stop: True

    def follows(start: float, stop: float) -> bool:
        times = np.clip(start + (stop - start) * LOOKS, *ends)
        values = program.signals(times, inputs, constants, stretch.mode)
        seen = values[: len(SEEN)]
        if (np.abs(BETWEEN @ seen - values[len(SEEN) :]) > allowed).any():
            return False
        first, last = np.searchsorted(known.times, (start, stop))
        shares = (known.times[first:last] - start) / (stop - start)
        return not bool((np.abs(np.vander(shares, 4) @ CUBIC @ seen - known.values[first:last]) > allowed).any())

    return follows


def inside(stretch: Segment) -> tuple[float, float]:
    """The first and last instant at which a signal is asked: where a stretch begins and ends is itself rounded."""
    margin = ROUNDING * float(np.spacing(max(abs(stretch.start), abs(stretch.stop))))
    return stretch.start + margin, stretch.stop - margin


def mode_size(program: Program, constants: Any) -> int:
    """How many items the mode of a program has."""
    return len(program.switches(0.0, constants)) if program.hybrid is None else program.hybrid.size


def mode_after(program: Program, constants: Any, instant: float, last: Segment) -> Any:
    """The conditions just after the end of a run, which is what an output at a jump shows (values hold from the jump on)."""
    return with_time_of(program, _mode(program, constants, instant + 1e-6 * (last.stop - last.start)), last.mode)


def with_time_of(program: Program, mode: Any, before: Any) -> Any:
    """The mode before, with the conditions on time alone as they are in `mode`."""
    if program.hybrid is None:
        return mode
    timed = list(program.hybrid.timed)
    result = np.array(before, dtype=float)
    result[timed] = mode[timed]
    return result


def _mode(program: Program, constants: Any, time: Any) -> Any:
    """The conditions on time; with events, what only they change is as at the start. Shape (…, mode)."""
    switches, hybrid = program.switches(time, constants), program.hybrid
    if hybrid is None:
        return switches
    start = hybrid.start(constants)
    mode = np.zeros((*np.shape(time), hybrid.size))
    mode[..., : len(start)] = start
    mode[..., list(hybrid.timed)] = switches
    return mode


def _distinct(edges: list[float]) -> list[float]:
    """Sorted instants without those that rounding has split."""
    kept = [edges[0]]
    for edge in edges[1:]:
        if edge - kept[-1] > 4 * np.spacing(max(abs(edge), abs(kept[-1]))):
            kept.append(edge)
    if kept[-1] != edges[-1]:
        kept[-1] = edges[-1]
    return kept


def _places(program: Program, constants: Any, length: float) -> int:
    """At how many places a stretch is searched."""
    period = float(min(np.abs(program.periods(constants)), default=np.inf))
    places = max(GRID, int(min(PER_PERIOD * length / period, 10 * MAXIMUM_GRID)))
    if places > MAXIMUM_GRID:
        raise RunFailed(
            f"a condition on a noise with a period of {period:g} s changes too often to be followed for {length:g} s; "
            "give the noise a longer period, or a smooth law instead of the condition"
        )
    return places


def _looked_at(program: Program, constants: Any, start: float, stop: float) -> tuple[Any, Any]:
    """Times and the values there of the functions whose zeros are looked for; more places where signs change often.

    The places lie irregularly: on a regular grid a fast oscillation would look like a slow one.
    """
    places = _places(program, constants, stop - start)
    while True:
        numbers = np.arange(places)
        times = start + (stop - start) * (numbers + (GOLDEN * numbers + 0.5) % 1.0) / places
        values = program.crossings(times, constants, _mode(program, constants, times))
        signs = np.sign(values)
        changes = int((signs[:-1] * signs[1:] < 0).sum(axis=0).max(initial=0))
        if SPARSE * changes <= places:
            return times, values
        places *= 4
        if places > MAXIMUM_GRID:
            raise RunFailed(
                f"a condition on time changes too often to be followed: some {changes} times or more between {start:.6g} s and "
                f"{stop:.6g} s; end the run earlier, or use a smooth law instead of the condition"
            )


def _zeros(program: Program, constants: Any, edges: list[float]) -> list[float]:
    """Zeros of the functions of time that are not linear in it: signs on a grid, then bisection.

    Two zeros closer than 1/256 of a smooth stretch (than 1/8 of a period of noise) can be missed, if others do not lie close.
    """
    middle = 0.5 * (edges[0] + edges[-1])
    if not np.size(program.crossings(middle, constants, _mode(program, constants, middle))):
        return []
    found: list[float] = []
    for a, b in pairwise(edges):
        times, values = _looked_at(program, constants, a, b)
        for column in range(values.shape[1]):
            signs = np.sign(values[:, column])
            for i in np.flatnonzero(signs[:-1] * signs[1:] < 0):
                mode = _mode(program, constants, times[i])

                def g(t: float, column: int = column, mode: Any = mode) -> float:
                    return float(program.crossings(t, constants, mode)[column])

                if g(times[i]) * g(times[i + 1]) < 0:
                    found.append(crossing(g, times[i], times[i + 1], 4e-16 * max(abs(b), 1e-300)))
            found += [times[i] for i in np.flatnonzero(signs[1:-1] == 0) + 1 if signs[i - 1] * signs[i + 1] < 0]
    return found
