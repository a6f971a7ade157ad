"""Location of zero crossings within a step: all zeros of the indicators along the dense output, then the first one narrowed down to rounding.

An indicator is approximated by a polynomial on a part of the step. The part is halved until the polynomial has converged, or is farther from zero
than its error. Zeros and minima of the polynomial show where the indicator itself is to be evaluated; a minimum that the error could hide is
examined on smaller parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, BoolArray, IntArray

from ...errors import RunFailed
from ...numerics.indicators import COEFFICIENTS, FINER, GRID, ON_GRID, SHARES
from ..integrators.acceptance.crossing_search import CHANGES, SEARCHED, WIDTH
from ..integrators.acceptance.first_crossing import FEWEST, GOLDEN, MOST_PARTS, SMALLEST, SUSPICIOUS
from ..integrators.acceptance.zero_crossings import FREE
from ..integrators.compiled.indicator_record import interpreted_record
from .bounds import Overlooked
from .events import Events
from .indicators import HybridState

NARROWEST = 2.0**-44  # smallest part, as a fraction of the interval searched, for conditions with narrow peaks
CONSTANT = 1e-13  # of the largest range of an indicator in a run: a smaller one is rounding
MOST_HIDDEN = 1000  # most parts that are halved for a peak that their places do not show
DOUBTFUL = 1e6  # in units of the rounding of terms where it was asked for last: a larger root is not asked for again
MORE = 1.01  # on a bound, for its own rounding

if TYPE_CHECKING:
    from ..integrators.compiled.run import CompiledMethod

StateAt = Callable[[Any, bool], Any]  # instants (k,), True to solve loops exactly -> states (k, n)


@dataclass(frozen=True, slots=True)
class Flip:
    """First zero crossing in a step: the instant after which conditions differ from the mode, and a mask of these conditions."""

    time: float
    state: Any
    conditions: Any


def first_flip(
    events: Events, start: float, stop: float, mode: Array, state_at: StateAt, within: CompiledMethod | None = None
) -> Flip | None:
    """Return the first zero crossing in (start, stop], or None. At the start itself the mode holds, whatever rounding leaves.

    `within`: the method whose last step it is. Raises `RunFailed` where an indicator changes too often to be followed.
    """
    if not len(events.places):
        return None
    step = _SearchedStep(events, mode, np.asarray(mode)[events.places] == 1.0, (start, stop), state_at, within)
    step.begin()
    record, mask = events.record, step.mask
    resolved = 64 * float(np.spacing(max(abs(start), abs(stop))))
    smallest, least = (max(share * (stop - start), resolved) for share in (SMALLEST, NARROWEST))
    waiting, count, halved = _first_parts(start, stop, record.record.spacing), 0, 0
    while waiting:
        low, high, widths = waiting.pop()
        times = low + (high - low) * SHARES
        times[[0, -1]] = low, high
        step.survey((low, high), times, low == start)
        bounded, moves = step.bounds((low, high), times, widths)
        hidden = np.zeros(len(step.said), dtype=bool)
        if bounded is not None:
            hidden, widths = moves & (bounded.unseen | ~mask("converged")), bounded.widths
            if halved > MOST_HIDDEN:
                events.crowded |= hidden
                hidden[:] = False
        if not record["near_count"] and not hidden.any():
            continue
        count += 1
        if count >= SUSPICIOUS and not count & (count - 1) and step.discount_rounding(high, mask("near") | hidden):
            waiting.append((low, high, widths))
            continue
        if count > MOST_PARTS:
            raise _unresolved(events, low, np.flatnonzero((mask("near") & ~mask("converged")) | hidden))
        if bounded is not None and halved <= MOST_HIDDEN:
            hidden |= moves & mask("dipping") & ~mask("crosses")
        unsure = record["unsure_count"] > 0 and high - low > smallest
        if unsure or hidden.any():
            rounding = step.rounding(high)
            unsure = unsure and bool((mask("unsure") & (record["variation"] > rounding)).any())
            if bounded is not None:
                hidden &= bounded.reach > rounding
        if unsure or (hidden.any() and high - low > least):
            halved += not unsure
            middle = 0.5 * (low + high)
            waiting += [(middle, high, widths), (low, middle, widths)]
            continue
        # Where a dip is behind, what is before it is looked at closely: two may lie between two places.
        behind = step.first_minimum((low, high)) if record["clear_count"] else high
        if low < behind < high:
            waiting += [(behind, high, widths), (low, behind, widths)]
            continue
        found = step.first_in()
        if found is not None:
            changed = step.touching == CHANGES
            if step.discount_rounding(found, changed & ~mask("converged")):
                waiting.append((low, high, widths))
                continue
            record.record.spacing, events.floor = high - low, step.floor
            return Flip(found, state_at(np.array([found]), True)[0], changed)
    record.record.spacing, events.floor = np.inf, step.floor
    last = np.abs(step.roots(np.array([stop]), False)[0])
    if np.isnan(last).any():
        events.check_values(HybridState(stop, state_at(np.array([stop]), True)[0], mode))
    events.floor = np.where((last > FREE * events.floor) & np.isfinite(last), 0.0, events.floor)
    return None


@dataclass(slots=True)
class _SearchedStep:
    """Step that is searched: conditions, and their states and roots along it."""

    events: Events
    mode: Any
    said: Any  # mask of the conditions that hold in the mode
    ends: tuple[float, float]
    state_at: StateAt
    within: CompiledMethod | None  # the method whose last step it is
    noise: Any = None  # rounding of the indicators, found on use
    touching: Any = None  # of the conditions at the zero crossing, as `goes_on` says it
    floor: Any = None  # rounding of the roots before the step
    rounded: Any = np.False_  # mask of the conditions that are nothing else in it
    largest: Any = 0.0  # of the roots in the parts so far

    @property
    def solved_for(self) -> bool:
        """True if loops are solved for exact roots: elsewhere their unknowns come from the dense output."""
        loops = self.events.loops
        return len(loops.magnitude) > 0 and not loops.affine

    def roots(self, times: Array, exactly: bool) -> Any:
        """Return the roots of the conditions at instants, as `state_at`; shape (k, conditions)."""
        if self.within is None or (exactly and self.solved_for):
            return self.events.roots(times, self.state_at(times, exactly), self.mode)
        return self.within.roots(times, self.mode)

    def begin(self) -> None:
        """Put the mode and the rounding of the roots into the record of the conditions."""
        record, self.floor = self.events.record, self.events.floor
        record["said"][:], record["floor"][:] = self.said, self.floor

    def survey(self, part: tuple[float, float], times: Array, begins: bool) -> None:
        """Examine the polynomials of a part through the roots at its places, which are these times; `begins`: it begins the step."""
        record, values = self.events.record, self.roots(times, False)
        self.largest = np.fmax(self.largest, np.abs(values).max(axis=0))
        coefficients = COEFFICIENTS @ np.where(np.isfinite(values), values, 0.0)
        record["values"][:], record["form"][:] = values.reshape(-1), coefficients.reshape(-1)
        record["grid"][:] = (ON_GRID @ coefficients).reshape(-1)
        record.record.low, record.record.high = part
        record.call("survey", int(begins), int(self.events.bounds is not None))

    def mask(self, name: str) -> Any:
        """Return a mask of the conditions that the last survey has marked."""
        return self.events.record[name] != 0

    def rounding(self, time: float) -> Any:
        """Return the rounding of the indicators, at the end of the first part that needs it: smaller changes are ignored."""
        if self.noise is None:
            self.noise = self.events.noise(HybridState(time, self.state_at(np.array([time]), False)[0], self.mode))
        return self.noise

    def discount_rounding(self, time: float, doubtful: BoolArray) -> bool:
        """If one of the doubtful roots may be but the rounding of its terms, let all that are so wherever the step was looked at count as zero in it;
        return False if none is."""
        events = self.events
        if not (doubtful & ~self.rounded & (self.largest <= DOUBTFUL * events.terms)).any():
            return False
        start, stop = self.ends
        times = np.append(start + (stop - start) * SHARES, time)
        states = self.state_at(times, False)
        terms = events.rounding_of_terms(times, states, self.mode)
        events.terms = terms.max(axis=0)
        within = ((np.abs(events.roots(times, states, self.mode)) <= terms) & (terms > 0)).all(axis=0)
        # Where terms do not cancel, the magnitudes of the states tell more of rounding, and the mode just after an instant has heard of it.
        cancel = MORE * terms[-1] >= events.noise(HybridState(time, states[-1], self.mode))
        more = within & cancel & ~self.rounded & (self.largest <= events.terms)
        self.rounded |= more
        events.floor = np.where(more, np.fmax(events.floor, events.terms), events.floor)
        events.record["floor"][:] = events.floor
        return bool(more.any())

    def bounds(self, part: tuple[float, float], times: Array, widths: Array | None) -> tuple[Overlooked | None, Any]:
        """Return bounds on narrow conditions over a part, and a mask of those that may have a zero there and are not constant but for rounding."""
        events = self.events
        if events.bounds is None:
            return None, None
        bounded = events.bounds.over(part, times, self.state_at(times, False), self.mode, events.floor, widths)
        events.reach = np.maximum(events.reach, np.where(np.isfinite(bounded.reach), bounded.reach, 0.0))
        moves = ~(bounded.reach <= CONSTANT * events.reach) & ~self.rounded
        return bounded, np.asarray(bounded.zero, dtype=bool) & moves

    def first_minimum(self, part: tuple[float, float]) -> float:
        """Return the first instant of the surveyed part, before all places that show a crossing, at which a condition that dips differs; else its end."""
        record, near, valid = self.events.record, self.mask("near"), self.mask("converged")
        dips = (record["dips"] == SEARCHED).reshape(-1, len(near))
        beside = [
            (np.fmax(p - 1, 0), np.fmin(p + 1, GRID), j) for p, j in zip(*np.nonzero(dips & near & valid), strict=True)
        ]
        brackets = [(FINER[a], FINER[b], j) for a, b, j in beside]
        brackets += [(0.0, 1.0, j) for j in np.flatnonzero(near & ~valid & ~self.mask("shown"))]
        (low, high), first = part, part[1]
        for a, b, j in sorted(brackets):
            here = low + (high - low) * a
            if here < first and record["variation"][j] > self.rounding(high)[j]:
                there = _bottom(self.events, (here, low + (high - low) * b), j, self.said, self.roots)
                first = first if there is None else min(first, there)
        return float(first)

    def first_in(self) -> float | None:
        """Return the first zero crossing in the surveyed part of the step, or None."""
        record, within = self.events.record, self.within
        times = record["suspects"][: record["suspect_count"]].copy()
        if not len(times):
            return None
        # So far, unknowns of loops came from the dense output; here they are solved for.
        roots = self.roots(times, True)
        if within is not None and not self.solved_for:
            crosses = within.narrow(record, times, roots, self.mode)
        else:

            def exactly(time: float, out: Array) -> None:
                out[:] = self.roots(np.array([time]), True)[0]

            record = interpreted_record(self.events.program, record, {"exactly": exactly})
            crosses = record.call("narrow", None, 1, len(times), times, roots)
        self.touching = record["touching"]
        return float(record["found"]) if crosses else None


def _first_parts(start: float, stop: float, spacing: float) -> list[tuple[float, float, Any]]:
    """Return the parts of an interval that are searched first, the last one first: from `spacing` on each twice as long as that before.
    The third item of a part is `widths` of the part that it is half of, or None.

    After many crossings in a step, the next one is probably as close: parts of that size need not be found by halving the whole step.
    """
    ends, spacing = [start], max(spacing, FEWEST * (stop - start))
    while spacing < 0.5 * (stop - ends[-1]):
        ends.append(ends[-1] + spacing)
        spacing *= 2
    return [(low, high, None) for low, high in pairwise([*ends, stop])][::-1]


def _bottom(
    events: Events, bracket: tuple[float, float], j: int, said: BoolArray, roots: Callable[[Any, bool], Any]
) -> float | None:
    """Return an instant of a bracket at which a condition differs, by golden sections towards where its indicator is nearest to zero; None if there is none.

    A parabola that is below zero for 1e-12 of a part is narrower than the error of its polynomial's extremum.
    """
    low, high = bracket
    width = WIDTH * float(np.spacing(max(abs(low), abs(high))))
    distance: dict[float, float] = {}
    while high - low > width:
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        for time in {first, second} - distance.keys():
            indicators = roots(np.array([time]), True)
            distance[time] = abs(float(indicators[0, j]))
            if _wrong(events, indicators, said)[0, j]:
                return time
        low, high = (low, second) if distance[first] < distance[second] else (first, high)
    return None


def _wrong(events: Events, roots: Array, said: BoolArray) -> Any:
    """Return a mask of the conditions that differ from the mode; shape as the roots."""
    return np.isfinite(roots) & (events.truth(roots) != said) & (np.abs(roots) >= events.floor)


def _unresolved(events: Events, time: float, conditions: IntArray) -> RunFailed:
    return RunFailed(
        "BR778", f"near t = {time:.9g} s {events.listed_conditions(conditions)} changes too often within a step to be followed;",
        "give the noise or the jumps in it a longer period, or let a signal that is smooth decide",
    )  # fmt: skip
