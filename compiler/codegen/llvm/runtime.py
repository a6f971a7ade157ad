"""Runtime functions that generated code calls: linear systems, curves through points, random numbers.

They are written in the subset that `native.translate` compiles, and compute the same as the functions of the same names at the
beginning of a numpy module (`numpy/beginning.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import floor, isfinite, log, nan, pow
from typing import TYPE_CHECKING, Any

from ...algebra.interpolate import random_number

if TYPE_CHECKING:
    from ...jit.arrays import Floats

# time, state, inputs, constants, mode, where the values go: every function of a program.
Function = Callable[[float, "Floats", "Floats", "Floats", "Floats", "Floats"], None]

INFINITE = float("inf")
WELL, ENOUGH = 1e-11, 1e-3  # by how much the solution 1 … 1 may be missed
MEANS = 12  # rounds of means of magnitudes


def batch(
    function: Function,
    count: int,
    times: Floats,
    states: Floats,
    inputs: Floats,
    constants: Floats,
    modes: Floats,
    out: Floats,
    by_time: int,
    by_state: int,
    by_inputs: int,
    by_constants: int,
    by_mode: int,
    size: int,
) -> None:
    """Call a function at `count` points. The last arguments are the strides between points in each array (0: the same for all)."""
    for i in range(count):
        function(
            times[i * by_time],
            states[i * by_state :],
            inputs[i * by_inputs :],
            constants[i * by_constants :],
            modes[i * by_mode :],
            out[i * size :],
        )


# ---------------------------------------------------------------- linear systems


def solve(count: int, entries: Floats, work: Floats, out: Floats) -> None:
    """Solve a linear system: the matrix by rows, then the right side. If it has no unique solution, the result is NaN.

    `work` has room for 2 count^2 + 6 count numbers.
    """
    missed = solution(count, entries, entries[count * count :], work, out)
    if not missed < WELL:
        # Unknowns of several units may make it look singular: means of magnitudes bring it to a scale without units.
        rest = work[count * count + 3 * count :]
        other = rest[count * count + 2 * count :]
        balance(count, entries, rest)
        rows = rest[count * count :]
        columns = rest[count * count + count :]
        for i in range(count):
            for j in range(count):
                rest[i * count + j] = entries[i * count + j] / rows[i] / columns[j]
            rows[i] = entries[count * count + i] / rows[i]
        better = solution(count, rest, rows, work, other)
        if not better > missed:
            missed = better
            for i in range(count):
                out[i] = other[i] / columns[i]
    if not missed < ENOUGH:
        for i in range(count):
            out[i] = nan


def balance(count: int, entries: Floats, out: Floats) -> None:
    """Scale factors, powers of two, that bring rows and columns to similar magnitudes. They follow count^2 numbers of `out`."""
    rows = out[count * count :]
    columns = out[count * count + count :]
    for i in range(count):
        columns[i] = 0.0
        for j in range(count):
            size = abs(entries[i * count + j])
            out[i * count + j] = log(size) / log(2.0) if size != 0.0 else 0.0
    for _ in range(MEANS):
        for i in range(count):
            total = 0.0
            found = 0
            for j in range(count):
                if entries[i * count + j] != 0.0:
                    total += out[i * count + j] - columns[j]
                    found += 1
            rows[i] = total / float(max(1, found))
        for j in range(count):
            total = 0.0
            found = 0
            for i in range(count):
                if entries[i * count + j] != 0.0:
                    total += out[i * count + j] - rows[i]
                    found += 1
            columns[j] = total / float(max(1, found))
    for i in range(count):
        rows[i] = pow(2.0, floor(rows[i] + 0.5))
        columns[i] = pow(2.0, floor(columns[i] + 0.5))


def solution(count: int, matrix: Floats, right: Floats, work: Floats, out: Floats) -> float:
    """Solve by partial pivoting; return the error of a second solution, known to be 1 … 1, which indicates a nearly singular matrix."""
    columns = work[count * count :]
    ones = columns[count:]
    for i in range(count):
        largest = 0.0
        for j in range(count):
            largest = max(largest, abs(matrix[i * count + j]))
        for j in range(count):
            work[i * count + j] = matrix[i * count + j] / largest
        out[i] = right[i] / largest
    for j in range(count):
        columns[j] = 0.0
        for i in range(count):
            columns[j] = max(columns[j], abs(work[i * count + j]))
    for i in range(count):
        ones[i] = 0.0
        for j in range(count):
            work[i * count + j] = work[i * count + j] / columns[j]
            ones[i] += work[i * count + j]
    for k in range(count):
        best = k
        for i in range(k + 1, count):
            if abs(work[i * count + k]) > abs(work[best * count + k]):
                best = i
        if not abs(work[best * count + k]) > 0.0:
            return INFINITE
        if best != k:
            for j in range(count):
                kept = work[k * count + j]
                work[k * count + j] = work[best * count + j]
                work[best * count + j] = kept
            kept = out[k]
            out[k] = out[best]
            out[best] = kept
            kept = ones[k]
            ones[k] = ones[best]
            ones[best] = kept
        for i in range(k + 1, count):
            factor = work[i * count + k] / work[k * count + k]
            for j in range(k + 1, count):
                work[i * count + j] -= factor * work[k * count + j]
            out[i] -= factor * out[k]
            ones[i] -= factor * ones[k]
    missed = 0.0
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            out[i] -= work[i * count + j] * out[j]
            ones[i] -= work[i * count + j] * ones[j]
        out[i] = out[i] / work[i * count + i]
        ones[i] = ones[i] / work[i * count + i]
        off = abs(ones[i] - 1.0)
        missed = off if not off <= missed else missed
    for i in range(count):
        out[i] = out[i] / columns[i]
    return missed


def room(count: int, lower: int, upper: int) -> int:
    """Number of doubles that `banded` needs in `work`."""
    return count * (3 * lower + 2 * upper + 2) + 5 * count


def banded(count: int, lower: int, upper: int, entries: Floats, work: Floats, out: Floats) -> None:
    """The same as `solve` for a matrix given by rows, with `lower` diagonals below and `upper` above the main one; size of `work`: `room`."""
    width = lower + upper + 1
    missed = banded_solution(count, lower, upper, entries, entries[count * width :], work, out)
    if not missed < WELL:
        scaled = work[count * (width + lower) + 2 * count :]
        rows = scaled[count * width :]
        columns = rows[count:]
        other = columns[count:]
        banded_balance(count, lower, upper, entries, scaled)
        for i in range(count):
            for j in range(max(0, i - lower), min(count, i + upper + 1)):
                place = i * width + j - i + lower
                scaled[place] = entries[place] / rows[i] / columns[j]
            rows[i] = entries[count * width + i] / rows[i]
        better = banded_solution(count, lower, upper, scaled, rows, work, other)
        if not better > missed:
            missed = better
            for i in range(count):
                out[i] = other[i] / columns[i]
    if not missed < ENOUGH:
        for i in range(count):
            out[i] = nan


def banded_balance(count: int, lower: int, upper: int, entries: Floats, out: Floats) -> None:
    """The same as `balance` for a banded matrix. The powers of two follow the entries in `out`."""
    width = lower + upper + 1
    rows = out[count * width :]
    columns = rows[count:]
    for i in range(count):
        columns[i] = 0.0
        for k in range(i * width, (i + 1) * width):
            size = abs(entries[k])
            out[k] = log(size) / log(2.0) if size != 0.0 else 0.0
    for _ in range(MEANS):
        for i in range(count):
            total = 0.0
            found = 0
            for j in range(max(0, i - lower), min(count, i + upper + 1)):
                if entries[i * width + j - i + lower] != 0.0:
                    total += out[i * width + j - i + lower] - columns[j]
                    found += 1
            rows[i] = total / float(max(1, found))
        for j in range(count):
            total = 0.0
            found = 0
            for i in range(max(0, j - upper), min(count, j + lower + 1)):
                if entries[i * width + j - i + lower] != 0.0:
                    total += out[i * width + j - i + lower] - rows[i]
                    found += 1
            columns[j] = total / float(max(1, found))
    for i in range(count):
        rows[i] = pow(2.0, floor(rows[i] + 0.5))
        columns[i] = pow(2.0, floor(columns[i] + 0.5))


def banded_solution(
    count: int, lower: int, upper: int, matrix: Floats, right: Floats, work: Floats, out: Floats
) -> float:
    """The same as `solution` for a banded matrix. The fill-in of pivoting is stored in `lower` more diagonals above the others."""
    width = lower + upper + 1
    wide = width + lower
    columns = work[count * wide :]
    ones = columns[count:]
    for j in range(count):
        columns[j] = 0.0
    for i in range(count):
        first = max(0, i - lower)
        end = min(count, i + upper + 1)
        largest = 0.0
        for j in range(first, end):
            largest = max(largest, abs(matrix[i * width + j - i + lower]))
        for k in range(i * wide, (i + 1) * wide):
            work[k] = 0.0
        for j in range(first, end):
            share = matrix[i * width + j - i + lower] / largest
            work[i * wide + j - i + lower] = share
            columns[j] = max(columns[j], abs(share))
        out[i] = right[i] / largest
    for i in range(count):
        ones[i] = 0.0
        for j in range(max(0, i - lower), min(count, i + upper + 1)):
            place = i * wide + j - i + lower
            work[place] = work[place] / columns[j]
            ones[i] += work[place]
    for k in range(count):
        last = min(count, k + lower + 1)
        end = min(count, k + lower + upper + 1)
        best = k
        for i in range(k + 1, last):
            if abs(work[i * wide + k - i + lower]) > abs(work[best * wide + k - best + lower]):
                best = i
        if not abs(work[best * wide + k - best + lower]) > 0.0:
            return INFINITE
        if best != k:
            for j in range(k, end):
                kept = work[k * wide + j - k + lower]
                work[k * wide + j - k + lower] = work[best * wide + j - best + lower]
                work[best * wide + j - best + lower] = kept
            kept = out[k]
            out[k] = out[best]
            out[best] = kept
            kept = ones[k]
            ones[k] = ones[best]
            ones[best] = kept
        for i in range(k + 1, last):
            factor = work[i * wide + k - i + lower] / work[k * wide + lower]
            for j in range(k + 1, end):
                work[i * wide + j - i + lower] -= factor * work[k * wide + j - k + lower]
            out[i] -= factor * out[k]
            ones[i] -= factor * ones[k]
    missed = 0.0
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, min(count, i + lower + upper + 1)):
            out[i] -= work[i * wide + j - i + lower] * out[j]
            ones[i] -= work[i * wide + j - i + lower] * ones[j]
        out[i] = out[i] / work[i * wide + lower]
        ones[i] = ones[i] / work[i * wide + lower]
        off = abs(ones[i] - 1.0)
        missed = off if not off <= missed else missed
    for i in range(count):
        out[i] = out[i] / columns[i]
    return missed


# ---------------------------------------------------------------- curves through points


def segment(x: float, knots: Floats, count: int) -> int:
    """Number of the interval that contains x; the first or last one if x is outside."""
    sign = -1.0 if knots[count - 1] < knots[0] else 1.0
    low = 0
    high = count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if sign * x >= sign * knots[middle]:
            low = middle
        else:
            high = middle
    return low


def linear(order: int, x: float, knots: Floats, values: Floats, count: int) -> float:
    """Straight lines between points, continued beyond the ends. `order` is the order of the derivative."""
    i = segment(x, knots, count)
    slope = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    return slope if order > 0 else values[i] + slope * (x - knots[i])


def hermite(order: int, x: float, knots: Floats, values: Floats, slopes: Floats, count: int) -> float:
    """Cubic Hermite curve through points with slopes, straight beyond the ends. `order` is the order of the derivative."""
    i = segment(x, knots, count)
    a = knots[i]
    m = slopes[i]
    n = slopes[i + 1]
    h = knots[i + 1] - a
    at = x
    if at < knots[0]:
        at = knots[0]
    if at > knots[count - 1]:
        at = knots[count - 1]
    d = at - a
    secant = (values[i + 1] - values[i]) / h
    c2 = (3.0 * secant - 2.0 * m - n) / h
    c3 = (m + n - 2.0 * secant) / (h * h)
    slope = m + d * (2.0 * c2 + 3.0 * d * c3)
    if order == 0:
        return values[i] + d * (m + d * (c2 + d * c3)) + (x - at) * slope
    if order == 1:
        return slope
    if x != at:
        return 0.0
    return 2.0 * c2 + 6.0 * d * c3 if order == 2 else 6.0 * c3


def inverse(y: float, knots: Floats, values: Floats, slopes: Floats, count: int) -> float:
    """Argument at which a monotone curve has the value y, by Newton's method with bisection as safeguard."""
    sign = 1.0 if values[count - 1] > values[0] else -1.0
    i = segment(y, values, count)
    low = knots[i]
    high = knots[i + 1]
    width = high - low
    x = low + (y - values[i]) / (values[i + 1] - values[i]) * width
    if not (low < x and x < high):
        return x
    for _ in range(100):
        error = sign * (hermite(0, x, knots, values, slopes, count) - y)
        if error < 0.0:
            low = x
        else:
            high = x
        slope = sign * hermite(1, x, knots, values, slopes, count)
        new = x - error / slope if slope > 0.0 else low
        if not (low < new and new < high):
            new = 0.5 * (low + high)
        moved = abs(new - x)
        x = new
        if moved <= 1e-14 * (abs(x) + width):
            break
    return x


def natural_slope(count: int, knots: Floats, values: Floats, work: Floats, out: Floats) -> None:
    """Slopes of the natural cubic spline, by elimination. `work` has room for `count` numbers."""
    above = 0.0
    right = 0.0
    for i in range(count):
        before = 1.0 if i > 0 else 0.0
        after = 1.0 if i < count - 1 else 0.0
        here = 2.0
        given = 0.0
        if i == 0:
            given = 3.0 * (values[1] - values[0]) / (knots[1] - knots[0])
        elif i == count - 1:
            given = 3.0 * (values[i] - values[i - 1]) / (knots[i] - knots[i - 1])
        else:
            a = knots[i] - knots[i - 1]
            b = knots[i + 1] - knots[i]
            before = 1.0 / a
            after = 1.0 / b
            here = 2.0 / a + 2.0 / b
            given = 3.0 * ((values[i] - values[i - 1]) / a / a + (values[i + 1] - values[i]) / b / b)
        pivot = here - before * above
        right = (given - before * right) / pivot
        above = after / pivot
        work[i] = above
        out[i] = right
    for i in range(count - 2, -1, -1):
        out[i] -= work[i] * out[i + 1]


def end_slope(near: float, far: float, first: float, second: float) -> float:
    """Slope at an end from its two intervals, limited so that the curve stays monotone."""
    slope = ((2.0 * near + far) * first - near * second) / (near + far)
    if slope * first <= 0.0:
        return 0.0
    return 3.0 * first if first * second < 0.0 and abs(slope) > 3.0 * abs(first) else slope


def monotone_slope(count: int, knots: Floats, values: Floats, work: Floats, out: Floats) -> None:
    """Slopes that keep the curve monotone where the points are (Fritsch and Butland 1984)."""
    for i in range(count - 1):
        work[i] = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    last = count - 1
    if count == 2:
        out[0] = work[0]
        out[1] = work[0]
        return
    out[0] = end_slope(knots[1] - knots[0], knots[2] - knots[1], work[0], work[1])
    for i in range(1, last):
        a = knots[i] - knots[i - 1]
        b = knots[i + 1] - knots[i]
        p = work[i - 1]
        q = work[i]
        out[i] = 3.0 * (a + b) / ((2.0 * b + a) / p + (b + 2.0 * a) / q) if p * q > 0.0 else 0.0
    out[last] = end_slope(
        knots[last] - knots[last - 1], knots[last - 1] - knots[last - 2], work[last - 1], work[last - 2]
    )


# ---------------------------------------------------------------- single values


def noise(order: int, place: float, seed: float, steps: Floats, count: int) -> float:
    """A random number at each integer, joined by smooth steps. `steps` are the coefficients of the step by rising powers."""
    if not abs(place) < 4611686018427387904.0:  # 2^62
        return nan
    whole = int(floor(place))  # noqa: RUF046 - a float in machine code
    part = place - floor(place)
    first = random_number(whole, int(seed))
    second = random_number(whole + 1, int(seed))
    step = 0.0
    for i in range(count - 1, -1, -1):
        step = step * part + steps[i]
    return (second - first) * step + (first if order == 0 else 0.0)


def root(x: float, n: float) -> float:
    """The real n-th root of x for odd n; not defined for even n."""
    whole = isfinite(n) and n == floor(n)
    if whole and n == 2.0 * floor(n / 2.0):
        return nan
    sign = 1.0
    if whole:
        sign = 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    return sign * pow(x * sign, 1.0 / n)


# Functions of this file, by the operators that call them.
BY_OPERATOR: Mapping[str, Callable[..., Any]] = {
    "solve": solve, "banded": banded, "linear": linear, "cubic": hermite, "monotone": hermite, "inverse": inverse,
    "natural_slope": natural_slope, "monotone_slope": monotone_slope, "noise": noise, "root": root,
}  # fmt: skip
