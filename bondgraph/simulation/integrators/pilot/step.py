"""One step of the pilot run by implicit Euler, in the subset that becomes machine code."""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats, Ints, Record, sized

from ..linear_algebra.factors import Factors, back, eliminate
from ..linear_algebra.sparse import FINE, SINGULAR, Pattern, real_back, real_factors
from ..workspace import Function

NEWTON_ITERATIONS = 8
CLOSE = 1e-2  # relative change of a state in its last iteration
ROUNDING = 1e-10  # relative to the terms in a rate: remainder where they cancel
PEERS = 1e-6  # relative to the largest state of one unit: changes of smaller states may be rounding
SMALLEST_RATIO = 1e-30  # least ratio of two scales in one step: a front that has not arrived would be divided by zero
INFINITE = float("inf")
KEPT_ITERATIONS = 8  # iterations with factors of an earlier step
FAR = 2.1  # largest ratio of step sizes; it includes the half steps that check a whole one for overshoot
SHRINKS = 0.4  # largest ratio of successive changes with which these factors are used


class Euler(Record):
    """Data of a step. n states and unknowns."""

    derivative: Function
    entries: Function
    inputs: Floats
    constants: Floats
    mode: Floats
    n: int
    differential: int
    entry_count: int
    rows: Ints  # entry_count
    columns: Ints  # entry_count
    by_column: Ints  # entry_count: indices of the entries, column by column
    begins: Ints  # n + 1: where each column begins among these
    queue: Ints = sized("n")  # work array: states in the order in which others bring them to a value
    largest: Floats = sized("n")  # largest values so far
    smallest: Floats = sized("n")  # smaller values are rounding
    kinds: Ints  # n: index of the unit
    most: Floats = sized("n")  # work array, the largest of each unit
    slight: float  # last relative change, with states at least a small fraction of their unit's largest
    start: Floats = sized("n")  # the state at the start of the step
    x: Floats = sized("n")  # the state at its end
    time: float  # time of its end
    size: float
    jacobian: Floats = sized("entry_count")
    scaled: Floats = sized("entry_count")
    sparse: int
    pattern: Pattern
    keeping: int  # 1 if factors of one step are reused in others
    kept: float  # step size of the sparse factors, with `scale`; 0: there are none
    factorised: int  # number of factorisations
    # work arrays
    slope: Floats = sized("n")
    scale: Floats = sized("n")
    reached: Floats = sized("n")
    real: Factors


def euler(e: Euler) -> int:
    """Compute the state at the end of the step, from a guess in its place: `FINE`; `SINGULAR` if it fails; `ANEW` if another order is needed."""
    n = e.n
    if e.keeping != 0 and e.size <= FAR * e.kept <= FAR * FAR * e.size:
        if with_kept_factors(e) == FINE:
            return FINE
        for i in range(n):
            e.x[i] = e.start[i]
    before = INFINITE
    for _ in range(NEWTON_ITERATIONS):
        e.derivative(e.time, e.x, e.inputs, e.constants, e.mode, e.slope)
        e.entries(e.time, e.x, e.inputs, e.constants, e.mode, e.jacobian)
        for i in range(n):
            if not isfinite(e.slope[i]):
                return SINGULAR
        for k in range(e.entry_count):
            if not isfinite(e.jacobian[k]):
                return SINGULAR
        magnitudes(e)
        for i in range(e.differential):
            e.slope[i] = (e.slope[i] - (e.x[i] - e.start[i]) / e.size) / e.scale[i]
        done = solve_step(e)
        if done != FINE:
            return done
        for i in range(n):
            e.slope[i] *= e.scale[i]
        norm = moved_share(e)
        if not isfinite(norm) or (norm > 2.0 * before and e.slight > CLOSE):
            return SINGULAR
        for i in range(n):
            e.x[i] += e.slope[i]
        if norm <= CLOSE or norm > 2.0 * before:
            return FINE
        before = norm
    return FINE if e.slight <= CLOSE else SINGULAR


def with_kept_factors(e: Euler) -> int:
    """Compute the same with the factors of an earlier step, if they converge fast. A single change, however small, does not show that.

    With factors of a step g times as long, slow components move g times too far and stiff ones as far as they should: each change is multiplied by
    2/(1 + g) (as with BDF, Petzold 1983), so that both are missed by the same fraction.
    """
    relaxed = 2.0 / (1.0 + e.kept / e.size)
    before = INFINITE
    for turn in range(KEPT_ITERATIONS):
        e.derivative(e.time, e.x, e.inputs, e.constants, e.mode, e.slope)
        for i in range(e.n):
            if not isfinite(e.slope[i]):
                return SINGULAR
        for i in range(e.n):
            e.slope[i] = (e.slope[i] - (e.x[i] - e.start[i]) / e.size) / e.scale[i]
        real_back(e.pattern, e.slope)
        for i in range(e.n):
            e.slope[i] *= relaxed * e.scale[i]
        norm = moved_share(e)
        if not isfinite(norm) or (turn > 0 and norm > SHRINKS * before):
            return SINGULAR
        for i in range(e.n):
            e.x[i] += e.slope[i]
        if norm == 0.0 or (turn > 0 and norm <= CLOSE):
            return FINE
        before = norm
    return SINGULAR


def solve_step(e: Euler) -> int:
    """Replace the residual by the scaled change of the state."""
    n = e.n
    for k in range(e.entry_count):
        row = e.rows[k]
        unit = e.scale[row] if row < e.differential else 1.0
        e.scaled[k] = e.jacobian[k] * e.scale[e.columns[k]] / unit
    if e.sparse != 0:
        e.kept = 0.0
        done = real_factors(e.pattern, 1.0 / e.size, e.scaled)
        if done == FINE:
            e.kept = e.size
            e.factorised += 1
            real_back(e.pattern, e.slope)
        return done
    matrix = e.real.matrix
    for i in range(n * n):
        matrix[i] = 0.0
    for i in range(e.differential):
        matrix[i * n + i] = 1.0 / e.size
    for k in range(e.entry_count):
        matrix[e.rows[k] * n + e.columns[k]] -= e.scaled[k]
    if not eliminate(e.real):
        return SINGULAR
    back(e.real, e.slope)
    return FINE


def magnitudes(e: Euler) -> None:
    """Compute positive magnitudes for a step: a state that has not moved yet gets the value to which the others bring it, link by link."""
    still = 0
    for i in range(e.n):
        moved = abs(e.size * e.slope[i]) if i < e.differential else 0.0
        e.scale[i] = max(e.largest[i], moved)
        still += e.scale[i] == 0.0
    if still > 0:
        follow_links(e)
    largest = 0.0
    for i in range(e.n):
        if e.scale[i] == 0.0:
            e.scale[i] = 1.0
        largest = max(largest, e.scale[i])
    for i in range(e.n):
        e.scale[i] = max(e.scale[i], SMALLEST_RATIO * largest)


def follow_links(e: Euler) -> None:
    """Give states without a scale the largest value to which those before them bring them. Each link is followed once: in a long ladder at rest each step
    would take the square of its length otherwise."""
    count = 0
    for i in range(e.n):
        e.reached[i] = 0.0
        if e.scale[i] != 0.0:
            e.queue[count] = i
            count += 1
    first = 0
    while first < count:
        last = count
        for place in range(first, last):
            column = e.queue[place]
            for link in range(e.begins[column], e.begins[column + 1]):
                entry = e.by_column[link]
                row = e.rows[entry]
                brought = abs(e.size * e.jacobian[entry]) * e.scale[column]
                if e.scale[row] == 0.0 and brought > e.reached[row]:
                    if e.reached[row] == 0.0:
                        e.queue[count] = row
                        count += 1
                    e.reached[row] = brought
        for place in range(last, count):
            e.scale[e.queue[place]] = e.reached[e.queue[place]]
        first = last


def moved_share(e: Euler) -> float:
    """Return the largest relative change of a state, ignoring rounding of larger ones. Store the second measure in `slight`."""
    for i in range(e.n):
        e.reached[i] = 0.0
        e.most[i] = 0.0
    for k in range(e.entry_count):
        column = e.columns[k]
        e.reached[e.rows[k]] = max(
            e.reached[e.rows[k]], abs(e.size * e.jacobian[k]) * abs(e.x[column] + e.slope[column])
        )
    for k in range(e.entry_count):  # a stiff state follows the terms of its rate, and their rounding moves it less
        if e.rows[k] == e.columns[k]:
            e.reached[e.rows[k]] /= 1.0 + abs(e.size * e.jacobian[k])
    result = 0.0
    for i in range(e.differential):
        whole = max(max(e.largest[i], ROUNDING * e.reached[i]), max(abs(e.x[i]), abs(e.x[i] + e.slope[i])))
        whole = max(whole, e.smallest[i])
        e.reached[i] = whole
        e.most[e.kinds[i]] = max(e.most[e.kinds[i]], whole)
        part = abs(e.slope[i]) / (whole if whole > 0.0 else 1.0)
        result = part if not part <= result else result
    e.slight = 0.0
    for i in range(e.differential):
        whole = max(e.reached[i], PEERS * e.most[e.kinds[i]])
        part = abs(e.slope[i]) / (whole if whole > 0.0 else 1.0)
        e.slight = part if not part <= e.slight else e.slight
    return result
