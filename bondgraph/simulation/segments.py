"""The stretches of time on which the right side is smooth: between the instants of steps, pulses, ramps and `if` on time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, cast

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
BESIDE = (GOLDEN * np.arange(NODES) + 0.5) % 1.0  # how far beyond its equal share each of many places lies
MOST_SAMPLES = 1_000_000  # of one sampled event
SHARE = 1e-4  # of a signal's range: what a step may overlook of it; some twelve steps for each period of a sine
OFFSET = 0.1180339887498949  # of a part, by which parts begin earlier than they would at round instants
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
    seen: dict[float, tuple[Any, ...]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )  # by `signals_on`

    def up_to(self, start: float, stop: float) -> Segment:
        """A part of it; itself, if that is all of it."""
        return self if (start, stop) == (self.start, self.stop) else Segment(start, stop, self.mode)


def segments(program: Program, constants: Any, start: float, stop: float) -> list[Segment]:
    """Cut [start, stop] where an expression of time jumps or bends."""
    cuts = [t for t in np.atleast_1d(program.instants(constants)) if start < t < stop]
    if program.hybrid is not None:
        cuts += [t for p in program.hybrid.sampling(constants) for t in _multiples(float(p), start, stop)]
    edges = _distinct([start, *sorted(cuts), stop])
    edges = _distinct(sorted([*edges, *_zeros(program, constants, edges)]))
    return [Segment(a, b, _mode(program, constants, 0.5 * (a + b))) for a, b in pairwise(edges)]


def segments_in_parts(program: Program, constants: Any, ends: tuple[float, float], parts: int) -> list[Segment]:
    """The segments between two instants, looked for in each of `parts` parts by itself; no part begins at a round instant."""
    start, stop = ends
    between = start + (stop - start) * (np.arange(1, parts) - OFFSET) / parts
    edges = [start, *(t for t in between.tolist() if start < t < stop), stop]
    return [s for a, b in pairwise(edges) for s in segments(program, constants, a, b)]


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


def _irregular(start: float, span: float, count: int) -> Any:
    """Places that lie irregularly: on a regular grid a fast oscillation would look like a slow one."""
    numbers = np.arange(count)
    beside = BESIDE[:count] if count <= NODES else (GOLDEN * numbers + 0.5) % 1.0
    return start + span * (numbers + beside) / count


def signals_on(program: Program, inputs: Any, constants: Any, stretch: Segment, whole: float = 0.0) -> Signals:
    """The signals on a stretch, at places that lie irregularly: the denser, the larger its share of the `whole` run is.

    What turns up at none of these places (shorter than 1/4096 of a run) is not known, and may be stepped over. All that looks at
    a stretch asks for them: they are found once, unless what is delayed is among them.
    """
    asked, seen = (program, inputs, constants), stretch.seen.get(whole)
    if seen is not None and all(a is b for a, b in zip(seen, asked, strict=False)):
        return cast("Signals", seen[-1])
    found = _signals(program, inputs, constants, stretch, whole)
    if program.delays is None:
        stretch.seen[whole] = (*asked, found)
    return found


def _signals(program: Program, inputs: Any, constants: Any, stretch: Segment, whole: float) -> Signals:
    span = stretch.stop - stretch.start
    share = span / whole if whole > 0 else 0.0
    begin, end = inside(stretch)  # where a narrow pulse may have its crest
    first = program.signals(begin, inputs, constants, stretch.mode)
    if not len(first):
        return Signals(np.zeros(0), np.zeros(0), np.zeros((0, 0)), False)
    count = int(min(NODES, max(GRID, NODES * share)))
    times = np.empty(count + 2)
    times[0], times[-1] = begin, end
    np.clip(_irregular(stretch.start, span, count), begin, end, out=times[1:-1])
    values = program.signals(times, inputs, constants, stretch.mode)
    columns = np.ascontiguousarray(values.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    allowed = SHARE * (high - low) + 1e-9 * np.maximum(high, -low)  # the latter for rounding
    return Signals(allowed, times, values, not (high - low).any())


def follower(
    program: Program, inputs: Any, constants: Any, stretch: Segment, known: Signals | None = None, coarse: float = 1.0
) -> Callable[[float, float], bool]:
    """Tells whether a step sees what time alone moves: the cubic through the places at which the step looks must be close to
    the signal between them, to a share of the range that the signal has; and so at every place in the step at which the signal
    is known. A rectifier whose diode is off at all of a step's places would else not see the next peak, and a pulse
    that is short beside a step would not be seen at all. `known`: the signals there, if they have been asked for; `coarse`: times as much may be missed, for a
    first look."""
    known = known or signals_on(program, inputs, constants, stretch)
    first, last = inside(stretch)
    allowed = coarse * known.allowed
    if not len(allowed) or (known.steady and coarse > 1.0):
        return always

    def follows(start: float, stop: float) -> bool:
        times = np.minimum(np.maximum(start + (stop - start) * LOOKS, first), last)
        values = program.signals(times, inputs, constants, stretch.mode)
        seen = values[: len(SEEN)]
        if (np.abs(BETWEEN @ seen - values[len(SEEN) :]) > allowed).any():
            return False
        passed = slice(*np.searchsorted(known.times, (start, stop)))
        shares = ((known.times[passed] - start) / (stop - start))[:, None]
        a, b, c, d = CUBIC @ seen
        return not (np.abs(((a * shares + b) * shares + c) * shares + d - known.values[passed]) > allowed).any()

    return follows


def always(start: float, stop: float) -> bool:
    """What a step sees of what does not move."""
    return True


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
    hybrid = program.hybrid
    if hybrid is None and not _count(program, "switches", lambda: program.switches(0.0, constants)):
        return np.empty((*np.shape(time), 0))
    switches = program.switches(time, constants)
    if hybrid is None:
        return switches
    start = hybrid.start(constants)
    mode = np.zeros((*np.shape(time), hybrid.size))
    mode[..., : len(start)] = start
    mode[..., list(hybrid.timed)] = switches
    return mode


def _count(program: Program, name: str, values: Callable[[], Any]) -> int:
    """How many values a function of a program has, whatever they are."""
    kept = program.kept
    if name not in kept:
        kept[name] = int(np.shape(values())[-1])
    return cast("int", kept[name])


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
    """Times and the values there of the functions whose zeros are looked for; more places where signs change often."""
    places = _places(program, constants, stop - start)
    while True:
        times = _irregular(start, stop - start, places)
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
    if not _count(
        program, "crossings", lambda: program.crossings(middle, constants, _mode(program, constants, middle))
    ):
        return []
    found: list[float] = []
    for a, b in pairwise(edges):
        times, values = _looked_at(program, constants, a, b)
        for column in range(values.shape[1]):
            signs = np.sign(values[:, column])
            for i in np.flatnonzero(signs[:-1] * signs[1:] < 0):
                mode = _mode(program, constants, times[i])
                ends = [float(t) for t in times[i : i + 2]]
                known = dict(zip(ends, values[i : i + 2, column].tolist(), strict=True)) if not mode.size else {}

                def g(t: float, column: int = column, mode: Any = mode, known: dict[float, float] = known) -> float:
                    return known[t] if t in known else float(program.crossings(t, constants, mode)[column])

                if g(ends[0]) * g(ends[1]) < 0:
                    found.append(crossing(g, ends[0], ends[1], 4e-16 * max(abs(b), 1e-300)))
            found += [times[i] for i in np.flatnonzero(signs[1:-1] == 0) + 1 if signs[i - 1] * signs[i + 1] < 0]
    return found
