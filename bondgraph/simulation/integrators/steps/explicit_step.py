"""One step of DOP853 (see `dop853.py`); one source, as machine code and as Python where there is none (`plain.py`).

No step exceeds the stability limit of the fastest mode: a mode without excitation and damping would otherwise be excited by the steps, up to the
tolerance and beyond, and limit them, and those of the next method, permanently. The rate of that mode comes from the Jacobian, by power
iteration. It is computed again every few steps, and where rates and states at the end of a step show that a faster mode has appeared (Hairer and
Wanner, Solving ODEs II, section IV.2). Where accuracy would repeatedly allow longer steps, another method should go on.
"""

from __future__ import annotations

from math import isfinite, pow, sqrt, ulp

from .. import dop853
from ..outcomes import ERROR, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .dop853_dense import combine, evaluate_stage, first_bend_of_pair, put_cubic
from .evaluation import put_end, rates, renew
from .peaks import first_peak
from .step_control import GROWN, first_size, is_rounding, is_stubborn

C, E5, E3 = dop853.C, dop853.E5, dop853.E3
SEEN, UNSEEN, LOOKS, BETWEEN, THROUGH = dop853.SEEN, dop853.UNSEEN, dop853.LOOKS, dop853.BETWEEN, dop853.THROUGH
NODES = (C[6], C[9], C[10], 1.0)  # some fractions of a step at which it evaluates rates that have a weight
STAGES, CAREFUL, MOST_BENDS, REGAINED = dop853.STAGES, dop853.CAREFUL, dop853.MOST_BENDS, dop853.REGAINED
SHORTEST, LONGEST, SAFETY = dop853.SHORTEST, dop853.LONGEST, dop853.SAFETY
STABLE, SELDOM, LOOK_AGAIN, ITERATIONS = dop853.STABLE, dop853.SELDOM, dop853.LOOK_AGAIN, dop853.ITERATIONS


def explicit_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step; return 0, or the reason why there is none."""
    n = s.n
    least = 10.0 * ulp(s.time)
    if s.since_looked >= LOOK_AGAIN:
        look_for_fastest(s)
    longest = min(s.size, STABLE / s.fastest) if s.fastest > 0.0 else s.size
    size = first_size(s, longest, SEEN, UNSEEN, LOOKS, BETWEEN, THROUGH)
    rejected = 0
    bent = 0
    cut = 1.0
    for i in range(n):
        s.slope[i] = s.rate[i]
    while True:
        if size < least and s.time + size < s.stop:
            return ERROR
        end = s.stop if s.time + size >= s.stop else s.time + size
        size = end - s.time
        for stage in range(1, STAGES):
            evaluate_stage(s, stage, s.time, size, s.state)
        combine(s, STAGES, size, s.state, s.new)
        norm = norm_of_pair(s, size)
        if s.bend_count > 0 and bent < MOST_BENDS and isfinite(norm):
            share = first_bend_of_pair(s, size, least)
            if share < 1.0:
                bent += 1
                cut *= share
                size *= share
                continue
        if norm > 0.1 and is_rounding(s, norm, CAREFUL, size):
            norm = 1.0
            combine(s, STAGES - 1, size, s.state, s.rest)  # that search has used its room
        if norm <= 1.0:
            if has_rates_at(s, end):
                if s.peak_count == 0:
                    break
                put_cubic(s, size, s.state, s.new)
                share = first_peak(s, size, NODES, 0, 4)
                if share == 1.0:
                    break
                size *= share
                continue
            rejected += 1  # the law has no value within the step
            size *= 0.5
            continue
        rejected += 1
        if is_stubborn(s, rejected, size, norm):
            return ROUND_OFF
        size *= max(SHORTEST, SAFETY * pow(norm, -0.125)) if isfinite(norm) else 0.1
    grown = (
        LONGEST if norm == 0.0 else GROWN if norm == 1.0 else max(SHORTEST, min(LONGEST, SAFETY * pow(norm, -0.125)))
    )
    put_explicit_end(s, end, size)
    s.size = size * (min(grown, 1.0) if rejected > 0 else grown)
    if bent > 0:
        s.size = max(s.size, size / max(cut, REGAINED))
    if s.size * s.fastest > STABLE:
        s.held_by_stability += 1
        s.free_steps = 0
    else:
        s.free_steps += 1
        if s.free_steps >= SELDOM:
            s.held_by_stability = 0
    return 0


def has_rates_at(s: IntegratorWorkspace, end: float) -> bool:
    """Return True if the rates at the end of a step are finite; they are stored behind those of its stages."""
    last = s.slope[STAGES * s.n :]
    rates(s, end, s.new, last)
    for i in range(s.n):
        if not isfinite(last[i]):
            return False
    return True


def put_explicit_end(s: IntegratorWorkspace, end: float, size: float) -> None:
    """Complete a step, whose last rates are known, and check if stability limited it."""
    n = s.n
    above = 0.0
    below = 0.0
    for i in range(n):  # the last stage is at the end too, with a different state, which is still in `rest`
        scale = s.absolute[i] + abs(s.new[i]) * s.relative
        a = (s.slope[STAGES * n + i] - s.slope[(STAGES - 1) * n + i]) / scale
        b = (s.new[i] - s.rest[i]) / scale
        above += a * a
        below += b * b
    put_end(s, end, s.slope[STAGES * n :])
    for i in range(n):
        s.rate[i] = s.slope[STAGES * n + i]
    s.last_size = size
    s.dense_known = 0
    s.since_looked += 1
    if below > 0.0 and size * sqrt(above / below) > 1.1 * STABLE:
        s.since_looked = LOOK_AGAIN


def look_for_fastest(s: IntegratorWorkspace) -> None:
    """Compute the rate of the fastest mode at the current state: growth of products with the Jacobian, from the direction of the last search."""
    n = s.n
    renew(s)
    if s.fastest == 0.0:
        for i in range(n):
            s.direction[i] = 1.0 + 0.3 * float((7 * i) % 5)
        product(s)
        product(s)
        for _ in range(ITERATIONS):
            product(s)
            product(s)
    grown = 1.0
    for _ in range(ITERATIONS):  # in pairs: with different scales, every second product is large
        grown *= product(s) * product(s)
    s.fastest = pow(grown, 1.0 / (2.0 * ITERATIONS))
    if not isfinite(s.fastest):
        s.fastest = 0.0
    s.since_looked = 0


def product(s: IntegratorWorkspace) -> float:
    """Multiply the direction by the Jacobian and normalise it; return its growth."""
    for i in range(s.n):
        s.rest[i] = 0.0
    for k in range(s.entry_count):
        s.rest[s.rows[k]] += s.jacobian[k] * s.direction[s.columns[k]]
    size = 0.0
    for i in range(s.n):
        size += s.rest[i] * s.rest[i]
    size = sqrt(size)
    before = 0.0
    for i in range(s.n):
        before += s.direction[i] * s.direction[i]
    before = sqrt(before)
    if size == 0.0:
        return 0.0
    for i in range(s.n):
        s.direction[i] = s.rest[i] / size
    return size / before


def norm_of_pair(s: IntegratorWorkspace, size: float) -> float:
    """Return the estimated error in units of the tolerance: that of order 5, reduced where that of order 3 shows that it is too cautious."""
    n = s.n
    fifth = 0.0
    third = 0.0
    for i in range(n):
        scale = s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative
        a = 0.0
        b = 0.0
        for stage in range(STAGES):
            a += E5[stage] * s.slope[stage * n + i]
            b += E3[stage] * s.slope[stage * n + i]
        s.error[i] = size * a / scale
        b = size * b / scale
        fifth += s.error[i] * s.error[i]
        third += b * b
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return CAREFUL * fifth / sqrt((fifth + 0.01 * third) * float(n))
