"""Unknowns of loops at given states by Newton's method, in the subset that becomes machine code."""

from __future__ import annotations

from math import isfinite, sqrt

from compiler.api import Floats, Ints, Record, sized

from .linear_algebra.factors import Factors, back, eliminate
from .workspace import Function

ITERATIONS, HALVINGS = 2000, 30  # an exponential law far from its solution needs one for each factor e
ITERATIONS_OF_MANY, HALVINGS_OF_MANY = 60, 8  # from many guesses, of which some arrive
STUCK = 12  # successive steps shortened to less than SHORT: the residual has a local minimum there
SHORT = 1e-3
CLOSE = 1e-9  # relative correction: rounding is near, and the residual need not fall
SMALLEST = 4e-16  # relative correction that is rounding
ROUNDED = 1e-5  # relative to its terms: a residual that does not fall counts as rounding below this
HIDDEN = 1e-12  # in SI, of unknowns whose magnitude is not known: a correction below it that no halving makes work is rounding of the 1 in exp(u) - 1
ARRIVED = 1e-8  # relative correction at which a guess has arrived
FALLS = 1e-4  # least share of a step by which the residual falls
LEAST, LEAST_OF_MANY = 1e-3, 1e-6  # of the magnitude: smaller unknowns count as large as this
FARTHEST, NEAR = 2.0**-12, 2.0**-21  # of the unknowns: neighbours whose residuals tell of rounding
NEIGHBOURS = 20  # each at a quarter of the distance of that before
ERRATIC = 4.0  # times the distance from a straight line
PART = 0.0625  # of a correction: the farthest place at which residuals should be as derivatives say; each other at a quarter of the one before
ROUGH = 100.0  # residuals: the most that rounding adds to those beside where it hides them
INFINITE = float("inf")


class LoopSystem(Record):
    """Equations of n unknowns, and Newton's method for them."""

    derivative: Function
    entries: Function
    inputs: Floats
    constants: Floats
    mode: Floats
    time: float
    state: Floats  # all states and unknowns
    n: int
    places: Ints  # n: the unknowns among them
    entry_count: int  # of the matrix
    chosen: Ints  # entry_count: places among the entries of the Jacobian
    rows: Ints  # entry_count
    columns: Ints  # entry_count
    magnitude: Floats  # n: 0 where it is not known
    unknown: int  # 1 if one of them is not
    z: Floats = sized("n")  # guess, then solution
    # work arrays
    rates: Floats = sized("variables")
    jacobian: Floats = sized("all_entries")
    unit: Floats = sized("n")
    value: Floats = sized("n")  # residuals
    scale: Floats = sized("n")  # of the rows, in these units
    step: Floats = sized("n")
    trial: Floats = sized("n")
    found: Floats = sized("n")
    inverse: Floats = sized("n", "n")
    real: Factors


def solve_loops(s: LoopSystem, many: int) -> int:
    """Solve from the guess, damped by halving, until the correction is round-off; return 1, or 0 if it fails. `many`: 1 for one of many guesses."""
    before = INFINITE
    stuck = 0
    if not residual(s, s.z, s.value):
        return 0
    for _ in range(ITERATIONS_OF_MANY if many != 0 else ITERATIONS):
        if not newton_step(s):
            return 0
        size = relative_step(s, LEAST_OF_MANY if many != 0 else LEAST)
        if not isfinite(size):
            return 0
        if many != 0 and size < ARRIVED:
            return 1
        factor = damped(s, HALVINGS_OF_MANY if many != 0 else HALVINGS, size < CLOSE)
        if size < CLOSE and (factor < 1.0 or not are_small(s)) and hides_residuals(s, size):
            if factor < 1.0:
                return 0  # laws have no value just beyond
            if size >= 0.25 * before and is_unresolved(s):
                return 1
            before = size
            continue
        if factor == 0.0:
            rounds = many == 0 and (size < CLOSE or is_loop_rounding(s))
            return 1 if rounds or is_erratic(s) or (many == 0 and is_unresolved(s)) else 0
        stuck = stuck + 1 if factor < SHORT else 0
        if stuck == STUCK:
            return 1 if many == 0 and is_unresolved(s) else 0
        if size <= SMALLEST or (size < CLOSE and size >= 0.25 * before):
            return 1
        before = size
    return 0


def solve_rows(s: LoopSystem, many: int, times: Floats, states: Floats, width: int, solved: Ints, count: int) -> int:
    """Solve at several instants, each from the unknowns in its state; return how many are solved."""
    total = 0
    for k in range(count):
        row = states[k * width :]
        s.time = times[k]
        for i in range(width):
            s.state[i] = row[i]
        for i in range(s.n):
            s.z[i] = row[s.places[i]]
        solved[k] = solve_loops(s, many)
        total += solved[k]
        for i in range(s.n):
            row[s.places[i]] = s.z[i]
    return total


def residual(s: LoopSystem, z: Floats, value: Floats) -> bool:
    """Compute the residuals at some unknowns; return True if they are finite."""
    for i in range(s.n):
        s.state[s.places[i]] = z[i]
    s.derivative(s.time, s.state, s.inputs, s.constants, s.mode, s.rates)
    finite = True
    for i in range(s.n):
        value[i] = s.rates[s.places[i]]
        if not isfinite(value[i]):
            finite = False
    return finite


def newton_step(s: LoopSystem) -> bool:
    """Compute a step from where the residuals were computed last; return False if there is none."""
    if not measure_unknowns(s):
        return False
    put_matrix(s, s.unit)
    for i in range(s.n):
        if not (s.scale[i] > 0.0 and isfinite(s.scale[i])):
            return False
        s.step[i] = -s.value[i]
    if not eliminate(s.real):
        return False
    back(s.real, s.step)
    for i in range(s.n):
        s.step[i] *= s.unit[i]
    return True


def put_matrix(s: LoopSystem, unit: Floats) -> None:
    """Put the derivatives of the residuals by the unknowns into the matrix, in units of these; and the largest of each row into `scale`."""
    for i in range(s.n * s.n):
        s.real.matrix[i] = 0.0
    for i in range(s.n):
        s.scale[i] = 0.0
    for k in range(s.entry_count):
        entry = s.jacobian[s.chosen[k]] * unit[s.columns[k]]
        s.real.matrix[s.rows[k] * s.n + s.columns[k]] = entry
        s.scale[s.rows[k]] = max(s.scale[s.rows[k]], abs(entry))


def measure_unknowns(s: LoopSystem) -> bool:
    """Compute the derivatives, and the magnitudes of the unknowns; where one is not known, the size of the terms that decide it, by which its rounding is
    measured. Return False if nothing decides it.
    """
    for i in range(s.n):
        s.state[s.places[i]] = s.z[i]
        s.unit[i] = 1.0 if s.unknown != 0 else s.magnitude[i]
    s.entries(s.time, s.state, s.inputs, s.constants, s.mode, s.jacobian)
    for k in range(s.entry_count):
        if not isfinite(s.jacobian[s.chosen[k]]):
            return False
    if s.unknown == 0:
        return True
    put_matrix(s, s.unit)
    for i in range(s.n):
        s.trial[i] = 0.0
    for k in range(s.entry_count):
        row = s.scale[s.rows[k]]
        entry = abs(s.jacobian[s.chosen[k]]) / (row if row > 0.0 else 1.0)
        s.trial[s.columns[k]] = max(s.trial[s.columns[k]], entry)
    for i in range(s.n):
        s.unit[i] = 1.0 / s.trial[i] if s.trial[i] > 0.0 else 1.0
    put_matrix(s, s.unit)
    if not eliminate(s.real):
        return False
    for j in range(s.n):
        for i in range(s.n):
            s.step[i] = 1.0 if i == j else 0.0
        back(s.real, s.step)
        for i in range(s.n):
            s.inverse[i * s.n + j] = abs(s.step[i]) * s.unit[i]
    for i in range(s.n):
        s.found[i] = max(max(abs(s.z[i]), s.magnitude[i]), through_inverse(s, i, s.value))
        s.trial[i] = 0.0
    for k in range(s.entry_count):
        s.trial[s.rows[k]] += abs(s.jacobian[s.chosen[k]]) * s.found[s.columns[k]]
    for i in range(s.n):
        terms = through_inverse(s, i, s.trial)
        s.unit[i] = s.magnitude[i] if s.magnitude[i] > 0.0 else (terms if terms > 0.0 else 1.0)
    return True


def measured_loops(s: LoopSystem) -> int:
    """Compute the magnitudes of the unknowns near a guess; return 1, or 0 if nothing decides them."""
    return 1 if residual(s, s.z, s.value) and measure_unknowns(s) else 0


def holds(s: LoopSystem) -> int:
    """Return 1 if unknowns solve the equations by the magnitudes that they have there: those of a singular start may hide any correction."""
    return 1 if residual(s, s.z, s.value) and newton_step(s) and relative_step(s, LEAST) < ARRIVED else 0


def through_inverse(s: LoopSystem, i: int, sizes: Floats) -> float:
    """Return how far residuals of some sizes move an unknown."""
    total = 0.0
    for j in range(s.n):
        total += s.inverse[i * s.n + j] * abs(sizes[j])
    return total


def relative_step(s: LoopSystem, least: float) -> float:
    """Return the largest relative correction of an unknown, or one that is not finite."""
    result = 0.0
    for i in range(s.n):
        part = abs(s.step[i]) / max(abs(s.z[i]), least * s.unit[i])
        if not isfinite(part):
            return part
        result = max(result, part)
    return result


def damped(s: LoopSystem, halvings: int, rounds: bool) -> float:
    """Go on by a part of the step with which the residual falls, or by all of it where it `rounds`; return the part, 0 if there is none."""
    norm = weighed(s, s.value)
    factor = 1.0
    for _ in range(halvings):
        for i in range(s.n):
            s.trial[i] = s.z[i] + factor * s.step[i]
        if residual(s, s.trial, s.found):
            if rounds or weighed(s, s.found) <= (1.0 - FALLS * factor) * norm:
                for i in range(s.n):
                    s.z[i] = s.trial[i]
                    s.value[i] = s.found[i]
                return factor
        factor *= 0.5
    return 0.0


def weighed(s: LoopSystem, value: Floats) -> float:
    """Return the norm of residuals, each in units of its row."""
    total = 0.0
    for i in range(s.n):
        part = value[i] / s.scale[i]
        total += part * part
    return sqrt(total)


def is_loop_rounding(s: LoopSystem) -> bool:
    """Return True if residuals that no shortened step reduces are rounding: then they are small relative to their terms.

    A law of an argument near zero, exp(u) - 1, leaves more rounding than a unit in the last place, and leakage alone may determine an unknown.
    """
    largest = 0.0
    for i in range(s.n):
        largest = max(largest, abs(s.step[i]))
    return (s.unknown != 0 and largest < HIDDEN) or are_small(s)


def are_small(s: LoopSystem) -> bool:
    """Return True if residuals are small relative to their terms."""
    for i in range(s.n):
        s.found[i] = 0.0
    for k in range(s.entry_count):
        s.found[s.rows[k]] += abs(s.jacobian[s.chosen[k]] * s.z[s.columns[k]])
    for i in range(s.n):
        if not abs(s.value[i]) <= ROUNDED * s.found[i]:
            return False
    return True


def hides_residuals(s: LoopSystem, size: float) -> bool:
    """Return True if residuals are no rounding, though a correction is: an infinite slope, as of a root at zero, makes any small."""
    for side in range(2):
        for i in range(s.n):
            s.trial[i] = s.z[i] + (1 - 2 * side) * LEAST / size * s.step[i]
        if residual(s, s.trial, s.found):
            for i in range(s.n):
                if abs(s.value[i]) > ROUNDED * abs(s.found[i] - s.value[i]):
                    return True
            return False
    return False


def is_erratic(s: LoopSystem) -> bool:
    """Return True if residuals are rounding of terms that cancel, as in sinh(w) - w: they leave a straight line close to the unknowns."""
    for i in range(s.n):
        s.scale[i] = 0.0
    share = FARTHEST
    for _ in range(NEIGHBOURS):
        for i in range(s.n):
            s.trial[i] = s.z[i] * (1.0 + share)
        if not residual(s, s.trial, s.found):
            return False
        for i in range(s.n):
            s.trial[i] = s.z[i] * (1.0 - share)
        if not residual(s, s.trial, s.step):
            return False
        for i in range(s.n):
            after = s.found[i] - s.value[i]
            before = s.step[i] - s.value[i]
            # farther away both may rise from a minimum that is none of rounding
            if after * before <= 0.0 or share < NEAR:
                s.scale[i] = max(s.scale[i], abs(after + before))
        share *= 0.25
    for i in range(s.n):
        if not abs(s.value[i]) <= ERRATIC * s.scale[i]:
            return False
    return True


def is_unresolved(s: LoopSystem) -> bool:
    """Return True if residuals that are not small are rounding of terms that no unknown shows, of the 1 in exp(u) - 1 or of flows that cancel: at no part
    of a correction, however small, they change as derivatives say, nor by much."""
    if not newton_step(s) or not relative_step(s, 1.0) < 1.0:  # beside a minimum corrections are longer
        return False
    are_small(s)
    for i in range(s.n):
        s.scale[i] = 1.0 if abs(s.value[i]) <= ROUNDED * s.found[i] else 0.0  # 1: nothing is to be shown
    for side in range(2):
        share = PART * (1 - 2 * side)
        much = ROUGH
        for k in range(NEIGHBOURS):
            for i in range(s.n):
                s.trial[i] = s.z[i] + share * s.step[i]
            if not residual(s, s.trial, s.found):
                return False
            for i in range(s.n):
                expected = -share * s.value[i]
                change = s.found[i] - s.value[i]
                answers = abs(change - expected) <= 0.5 * abs(expected)
                if s.scale[i] < 1.0 and ((answers and s.scale[i] < 0.0) or abs(change) > much * abs(s.value[i])):
                    return False
                if s.scale[i] < 1.0:
                    s.scale[i] = -1.0 if answers else 0.0  # once may be by chance
            share *= 0.25
            much = ROUGH if k < NEIGHBOURS - 2 else 0.5
    return True
