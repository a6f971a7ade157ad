"""Segments of time on which the right-hand side is smooth: between the instants of steps, pulses, ramps and `if` on time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from itertools import pairwise
from math import ulp
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from compiler.api import Array, Hybrid, Program, Ranges, TimeFunction, TimeFunctions, dataclass

from ...errors import RunFailed
from ...numerics.roots import crossing
from .sampling import MOST_SAMPLES, sampling_of, ticks_between, too_often

if TYPE_CHECKING:
    from .crossings import Zeros
    from .resolution import Resolution

GRID = 256  # places of a short segment at which signals are sampled
UNBOUNDED = 65_536  # places at which a segment is searched for zeros of functions without interval ranges
NODES = 4096  # places at which signals of time are sampled in a whole run
PER_PERIOD = 8  # such places for each period of a noise, if there are more
MAXIMUM_GRID = 2_000_000
SPARSE = 16  # least number of places for each change of sign; with fewer, more are added
GOLDEN = 0.6180339887498949
BESIDE = (GOLDEN * np.arange(NODES) + 0.5) % 1.0  # offset of each place from the regular grid, in grid widths
SHARE = 1e-4  # fraction of a signal's range that a step may overlook; about twelve steps per period of a sine
OFFSET = 0.1180339887498949  # fraction of a part by which parts begin before round instants
ROUNDING = 16  # units in the last place of a time
# Nodes of a step, places between them, and the weights of the cubic through the nodes at those places.
SEEN = np.array([0.0, 0.155, 0.645, 1.0])
LOOKS = np.concatenate([SEEN, [0.075, 0.3, 0.5, 0.85]])
BETWEEN = np.linalg.solve(np.vander(SEEN).T, np.vander(LOOKS[4:], 4).T).T
# from the values at the nodes to the coefficients of the cubic, highest degree first
CUBIC = np.linalg.inv(np.vander(SEEN))


@dataclass(frozen=True, slots=True)
class Segment:
    """Interval of time, and the truth values of the conditions on time within it."""

    start: float
    stop: float
    mode: Any
    # of the timeline that it is a part of
    resolution: Resolution | None = field(default=None, compare=False, repr=False)
    # cache of `signals_on`
    seen: dict[float, tuple[Any, ...]] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def key(self) -> tuple[object, ...]:
        """All that it is, to compare with; with its sampling places, whose notes belong to a run."""
        return self.start, self.stop, np.asarray(self.mode).tobytes(), self.resolution

    def up_to(self, start: float, stop: float, mode: Array | None = None) -> Segment:
        """Return a part of the segment, in another mode if one is given; the segment itself if the part is all of it."""
        if mode is None and (start, stop) == (self.start, self.stop):
            return self
        return Segment(start, stop, self.mode if mode is None else mode, self.resolution)


@dataclass(frozen=True, slots=True)
class Timeline:
    """Segments of a run, and notes for the user on how they were found."""

    segments: list[Segment]
    notes: tuple[str, ...] = ()


def segments(program: Program, constants: Array, start: float, stop: float) -> list[Segment]:
    """Cut [start, stop] at the jumps and kinks of expressions of time."""
    return timeline(program, constants, start, stop).segments


def timeline(program: Program, constants: Array, start: float, stop: float) -> Timeline:
    """Cut [start, stop] at the jumps and kinks of expressions of time. The last answer of a program is cached with its arguments."""
    key = np.asarray(constants).tobytes(), start, stop
    last = program.kept.get("timeline")
    if last is None or last[0] != key:
        with np.errstate(all="ignore"):
            edges, notes = _edges(program, constants, start, stop)
            modes = _modes(program, constants, edges)
            last = program.kept["timeline"] = key, edges, modes, notes, _resolution(program, edges, modes)
    _, edges, modes, notes, resolution = last
    rows = [modes] * (len(edges) - 1) if modes.ndim == 1 else map(np.array, modes)
    spans = zip(pairwise(edges.tolist()), rows, strict=True)
    return Timeline([Segment(a, b, mode, resolution) for (a, b), mode in spans], notes)


def _resolution(program: Program, edges: Array, modes: Array) -> Resolution | None:
    """Return the places of narrow signals on all segments; None if there is no such signal."""
    if program.time_functions is None or not program.time_functions.narrow:
        return None
    from .resolution import Resolution

    return Resolution(edges, modes)


def _edges(program: Program, constants: Array, start: float, stop: float) -> tuple[Any, tuple[str, ...]]:
    """Return the ends of all segments, rising, shape (segments + 1,); and notes."""
    cuts = np.concatenate([np.atleast_1d(program.instants(constants)), *_recurring(program, constants, start, stop)])
    base = _distinct(np.concatenate([[start], np.sort(cuts[(start < cuts) & (cuts < stop)]), [stop]]))
    edges = base
    if program.hybrid is not None:
        sampled = [ticks_between(row, start, stop) for row in sampling_of(program.hybrid.sampling(constants))]
        edges = _distinct(np.sort(np.concatenate([edges, *sampled])))
    functions = program.time_functions
    if functions is None or not functions.crossings:
        return edges, ()
    notes: dict[str, None] = {}
    for number, function in enumerate(functions.crossings):
        cut = edges if function.moded else base
        found, note = _crossings(program, functions, number, constants, cut)
        edges = _distinct(np.sort(np.concatenate([edges, found[(start < found) & (found < stop)]])))
        notes |= dict.fromkeys(note)
    return edges, tuple(notes)


def _crossings(
    program: Program, functions: TimeFunctions, number: int, constants: Array, edges: Array
) -> tuple[Any, tuple[str, ...]]:
    """Return the zeros of one function of time; the last answer is cached with the constants that the function reads."""
    function = functions.crossings[number]
    modes = _modes(program, constants, edges) if function.moded else np.empty(0)
    kept = program.kept.setdefault("crossings", {})
    places = (function.place, max(function.slope, 0))
    used, key, found = kept.get(number) or (functions.constants_of(places), None, None)
    asked = np.asarray(constants)[used].tobytes(), np.asarray(edges).tobytes(), modes.tobytes()
    if key != asked:
        found = _searched(program, functions, number, constants, edges, modes)
        kept[number] = used, asked, found
    return cast("tuple[Any, tuple[str, ...]]", found)


def _searched(
    program: Program, functions: TimeFunctions, number: int, constants: Array, edges: Array, modes: Array
) -> tuple[Any, tuple[str, ...]]:
    """Return the zeros of one function of time; without interval ranges, those found by sampling, with a note about it."""
    from .crossings import OneFunction, Undecided, crossings

    function = functions.crossings[number]
    ranges = Ranges(functions, (function.place, max(function.slope, 0)), constants)
    alone = Ranges(functions, (function.place,), constants)
    if any(functions.nodes[i][0] == "noise" for i in alone.order):
        # refuses functions that change in each of millions of periods
        _places(program, constants, float(edges[-1] - edges[0]))
    if function.slope >= 0 and not ranges.unbounded:
        try:
            found = crossings(OneFunction(ranges, alone, edges, modes))
        except Undecided:
            pass
        else:
            return found.cuts, tuple(_notes(program, function, found))
    sampled, closest = _sampled(program, constants, number, edges)
    if not function.condition:
        return np.array(sampled), ()
    return np.array(sampled), (
        f"{_named(function)} has no bounds that tell all instants at which it changes: it was looked at every "
        f"{closest:.3g} s, and a change of shorter duration may have been missed",
    )


def _notes(program: Program, function: TimeFunction, found: Zeros) -> Iterator[str]:
    """Yield notes for the user on a condition on time: equality to rounding, or truth at single instants only."""
    if function.condition and found.hidden is not None:
        first, last = found.hidden
        yield (
            f"the two sides of {_named(function)} are equal to within rounding between t = {first:.9g} s and {last:.9g} s: what holds there is "
            "what rounding makes of it"
        )
    single = found.touched
    if function.condition == "equal" and len(found.cuts):
        single = float(found.cuts[0])
    if (
        single is not None
        and function.condition in ("less_equal", "equal")
        and program.hybrid is not None
        and program.hybrid.events
    ):
        yield (
            f"{_named(function)} holds at single instants only, the first at t = {single:.9g} s: no event acts on that; "
            "write it as one that holds for a while"
        )


def _named(function: TimeFunction) -> str:
    """Return the name of a condition or kink in messages: its owner and its line."""
    return f"a condition on time of `{function.owner}` ({function.span.file_and_line})"


def timeline_in_parts(program: Program, constants: Array, ends: tuple[float, float], parts: int) -> Timeline:
    """Return the segments between two instants, searched separately in each of `parts` parts; no part begins at a round instant."""
    start, stop = ends
    if parts == 1:
        return timeline(program, constants, start, stop)
    between = start + (stop - start) * (np.arange(1, parts) - OFFSET) / parts
    edges = [start, *(t for t in between.tolist() if start < t < stop), stop]
    found = [timeline(program, constants, a, b) for a, b in pairwise(edges)]
    return Timeline(
        [s for part in found for s in part.segments], tuple(dict.fromkeys(n for part in found for n in part.notes))
    )


def rest_of(stretches: list[Segment], start: float) -> list[Segment]:
    """Return the remainder of the segments from an instant on; the last one always remains, even if only its end is left."""
    first = bisect_right(stretches, start, key=attrgetter("stop"))
    while first < len(stretches) - 1 and stretches[first].stop - start <= ROUNDING * ulp(start):
        first += 1
    rest = stretches[min(first, len(stretches) - 1) :]
    rest[0] = rest[0].up_to(start, rest[0].stop)
    return rest


def aligned(stretches: list[Segment], instants: Array) -> list[Segment]:
    """Return the segments with ends moved down to reported instants that differ from them by rounding: values hold from a jump on."""
    edges, parts = [s.start for s in stretches[1:]], list(stretches)
    if not edges:
        return parts
    below = np.maximum(instants.searchsorted(edges) - 1, 0)
    for i, (edge, near) in enumerate(zip(edges, instants[below].tolist(), strict=True)):
        if stretches[i].start < near < edge and edge - near <= ROUNDING * ulp(edge):
            parts[i] = parts[i].up_to(parts[i].start, near)
            parts[i + 1] = parts[i + 1].up_to(near, parts[i + 1].stop)
    return parts


def _recurring(program: Program, constants: Array, start: float, stop: float) -> Iterator[Any]:
    """Yield the instants at which each function linear in time is an integer."""
    if program.recurring is None:
        return
    for at_zero, slope in np.reshape(program.recurring(constants), (-1, 2)).tolist():
        if not abs(slope) * (stop - start) <= MOST_SAMPLES:
            raise too_often(abs(1 / slope), stop - start)
        if slope != 0:
            first, last = sorted((at_zero + slope * start, at_zero + slope * stop))
            yield (np.arange(np.floor(first), np.ceil(last) + 1) - at_zero) / slope


@dataclass(frozen=True, slots=True)
class Signals:
    """Signals that depend on time alone, on a segment: their tolerated error, and their values at many places."""

    allowed: Any  # (signals,): part of each signal that a step may overlook
    times: Any  # (places,), rising
    values: Any  # (places, signals)
    steady: bool  # True if they are equal at all places


def _irregular(start: float, span: float, count: int) -> Any:
    """Return irregular places: on a regular grid a fast oscillation would look like a slow one."""
    numbers = np.arange(count)
    beside = BESIDE[:count] if count <= NODES else (GOLDEN * numbers + 0.5) % 1.0
    return start + span * (numbers + beside) / count


def signals_on(program: Program, inputs: Array, constants: Array, stretch: Segment, whole: float = 0.0) -> Signals:
    """Return the signals on a segment at irregular places, the denser, the larger its share of the `whole` run is.

    A signal with narrow peaks is also sampled at each of them. All users of a segment share these places: they are computed once, unless delayed
    signals are among them.
    """
    asked, seen = (program, inputs, constants), stretch.seen.get(whole)
    if seen is not None and all(a is b for a, b in zip(seen, asked, strict=False)):
        return cast("Signals", seen[-1])
    found = _signals(program, inputs, constants, stretch, whole)
    if program.delays is None:
        stretch.seen[whole] = (*asked, found)
    return found


def _signals(program: Program, inputs: Array, constants: Array, stretch: Segment, whole: float) -> Signals:
    span = stretch.stop - stretch.start
    share = span / whole if whole > 0 else 0.0
    begin, end = inside(stretch)  # a narrow pulse may have its crest there
    first = program.signals(begin, inputs, constants, stretch.mode)
    if not len(first):
        return Signals(np.zeros(0), np.zeros(0), np.zeros((0, 0)), False)
    count = int(min(NODES, max(GRID, NODES * share)))
    times = np.empty(count + 2)
    times[0], times[-1] = begin, end
    np.clip(_irregular(stretch.start, span, count), begin, end, out=times[1:-1])
    resolution = stretch.resolution or _resolution(program, np.array([begin, end]), np.asarray(stretch.mode)[None, :])
    if resolution is not None:
        more = resolution.places(program, inputs, constants, stretch.mode, begin, end)
        times = np.sort(np.concatenate([times, more])) if len(more) else times
    values = program.signals(times, inputs, constants, stretch.mode)
    columns = np.ascontiguousarray(values.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    allowed = SHARE * (high - low) + 1e-9 * np.maximum(high, -low)  # the second term covers rounding
    return Signals(allowed, times, values, not (high - low).any())


def follower(
    program: Program, inputs: Array, constants: Array, stretch: Segment, known: Signals | None = None, coarse: float = 1.0
) -> Callable[[float, float], bool]:  # fmt: skip
    """Return a function of the ends of a step that is True if the step resolves the signals of time.

    The cubic through the nodes of the step must be close to the signal between them, to a fraction of the signal's range, at fixed places and
    at every place in the step at which the signal is known. Otherwise a rectifier whose diode is off at all nodes of a step would not see the next
    peak, and a pulse that is short beside a step would not be seen at all. `known`: the signals there, if already computed; `coarse`: factor on
    the tolerated error, for a pilot run.
    """
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
    """Return True: every step resolves signals that are constant."""
    return True


def inside(stretch: Segment) -> tuple[float, float]:
    """Return the first and last instant at which a signal is evaluated: just inside the segment, because its ends are rounded."""
    margin = ROUNDING * ulp(max(abs(stretch.start), abs(stretch.stop)))
    return stretch.start + margin, stretch.stop - margin


def mode_size(program: Program, constants: Array) -> int:
    """Return the number of entries of a program's mode, the same for all constants."""
    if "mode size" not in program.kept:
        hybrid = program.hybrid
        program.kept["mode size"] = np.shape(program.switches(0.0, constants))[-1] if hybrid is None else hybrid.size
    return cast("int", program.kept["mode size"])


def mode_after(program: Program, constants: Array, instant: float, last: Segment) -> Any:
    """Return the conditions just after the end of a run, which an output at a jump shows (values hold from the jump on)."""
    if program.hybrid is None and not len(last.mode):
        return last.mode
    later = max(1e-10 * (last.stop - last.start), 4 * ROUNDING * float(np.spacing(abs(instant))))
    return with_time_of(program, _mode(program, constants, instant + later), last.mode)


def with_time_of(program: Program, mode: Array, before: Array) -> Any:
    """Return the mode `before`, with the conditions on time alone taken from `mode`."""
    if program.hybrid is None:
        return mode
    timed = list(program.hybrid.timed)
    result = np.array(before, dtype=float)
    result[timed] = mode[timed]
    return result


def discrete_variables(hybrid: Hybrid, mode: Array) -> dict[str, float]:
    """Return the discrete variables of a mode, which come first, by name."""
    return dict(zip(hybrid.modes.names, mode.tolist(), strict=False))


def with_discrete_variables(hybrid: Hybrid, mode: Array, values: Mapping[str, float]) -> Any:
    """Return a mode with other values of some discrete variables, by name."""
    named = [values.get(name, x) for name, x in zip(hybrid.modes.names, mode, strict=False)]
    return np.concatenate([named, mode[len(named) :]])


def _modes(program: Program, constants: Array, edges: Array) -> Any:
    """Return the modes between the edges, shape (segments, mode); (0,) where there is none."""
    mode = _mode(program, constants, edges[:-1] + GOLDEN * np.diff(edges))  # a place at which no periods meet
    return mode if mode.shape[-1] else np.empty(0)


def _mode(program: Program, constants: Array, time: Array | float) -> Any:
    """Return the conditions on time; with events, the entries that only events change are as at the start. Shape (…, mode)."""
    hybrid = program.hybrid
    if hybrid is None and not mode_size(program, constants):
        return np.empty((*np.shape(time), 0))
    switches = program.switches(time, constants)
    if hybrid is None:
        return switches
    start = hybrid.start(constants)
    mode = np.zeros((*np.shape(time), hybrid.size))
    mode[..., : len(start)] = start
    mode[..., list(hybrid.timed)] = switches
    return mode


def _distinct(edges: Array) -> Any:
    """Return sorted instants without those that rounding has split; the first and the last stay.

    Intervals below the rounding of the whole run are no segments: a root of high order at time 0 is found anywhere below 1e-60 s.
    """
    span = float(edges[-1] - edges[0])
    apart = np.diff(edges) > 4 * np.spacing(np.maximum(span, np.maximum(np.abs(edges[:-1]), np.abs(edges[1:]))))
    if apart.all():
        return edges
    kept = [float(edges[0])]
    for edge in edges[1:].tolist():
        if edge - kept[-1] > 4 * np.spacing(max(span, abs(edge), abs(kept[-1]))):
            kept.append(edge)
    if kept[-1] != edges[-1]:
        kept[-1] = float(edges[-1])
    return np.array(kept)


def _places(program: Program, constants: Array, length: float) -> int:
    """Return the number of places at which a segment is searched."""
    period = float(min(np.abs(program.periods(constants)), default=np.inf))
    places = max(UNBOUNDED, int(min(PER_PERIOD * length / period, 10 * MAXIMUM_GRID)))
    if places > MAXIMUM_GRID:
        raise RunFailed(
            "BR762", f"a condition on a noise with a period of {period:g} s changes too often to be followed for {length:g} s;",
            "give the noise a longer period, or a smooth law instead of the condition",
        )  # fmt: skip
    return places


def _looked_at(program: Program, constants: Array, start: float, stop: float) -> tuple[Any, Any]:
    """Return times and values of the functions whose zeros are searched; more places where signs change often."""
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
                "BR763", f"a condition on time changes too often to be followed: some {changes} times or more between {start:.6g} s and {stop:.6g} s;",
                "end the run earlier, or use a smooth law instead of the condition",
            )  # fmt: skip


def _sampled(program: Program, constants: Array, number: int, edges: Array) -> tuple[list[float], float]:
    """Return zeros of a function of time without ranges (signs at many places, then bisection), and the largest distance of these places.

    Two zeros closer than that can be missed.
    """
    found: list[float] = []
    apart = 0.0
    for a, b in pairwise(edges.tolist()):
        times, values = _looked_at(program, constants, a, b)
        apart = max(apart, (b - a) / len(times))
        column = values[:, number]
        signs = np.sign(column)
        for i in np.flatnonzero(signs[:-1] * signs[1:] < 0):
            mode = _mode(program, constants, times[i])

            def g(t: float, mode: Array = mode) -> float:
                return float(program.crossings(t, constants, mode)[number])

            if g(times[i]) * g(times[i + 1]) < 0:
                found.append(crossing(g, times[i], times[i + 1], 4e-16 * max(abs(b), 1e-300)))
        found += [times[i] for i in np.flatnonzero(signs[1:-1] == 0) + 1 if signs[i - 1] * signs[i + 1] < 0]
    return found, apart
