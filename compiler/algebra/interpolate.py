"""Curves through points, and reproducible random numbers: values of the operators `linear`, `cubic`, `monotone`, `noise`.

A cubic curve is stored as points with slopes (cubic Hermite). The functions of arrays are in the subset of Python that `jit` compiles: they
give the values of the operators here, and are called by machine code, C and modules for numpy.
"""

from __future__ import annotations

from collections.abc import Callable, MutableSequence, Sequence
from functools import lru_cache, partial
from itertools import pairwise, product
from math import floor, inf, nan

Points = Sequence[float]
Floats = MutableSequence[float]

MARGIN = 1e-6  # of the range: how far beyond a table's ends rounding and a solver's tolerance may lead


class OutsideTable(ValueError):
    """The argument of a table is outside of its range."""


# ---------------------------------------------------------------- curves, compiled by `jit`


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
    """Straight lines between points, continued beyond the ends. `order` is the order of the derivative.

    From the nearer point, so that no rounding leads beyond the value there: a plateau behind it would be passed on one side.
    """
    i = segment(x, knots, count)
    slope = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    if abs(knots[i + 1] - x) < abs(x - knots[i]):
        i += 1
    return slope if order > 0 else values[i] + slope * (x - knots[i])


def hermite(order: int, x: float, knots: Floats, values: Floats, slopes: Floats, count: int) -> float:
    """Cubic Hermite curve through points with slopes, straight beyond the ends. `order` is the order of the derivative."""
    i = segment(x, knots, count)
    other = i + 1
    if abs(knots[i + 1] - x) < abs(x - knots[i]):
        other = i
        i += 1
    a = knots[i]
    m = slopes[i]
    n = slopes[other]
    h = knots[other] - a
    at = x
    if at < knots[0]:
        at = knots[0]
    if at > knots[count - 1]:
        at = knots[count - 1]
    d = at - a
    secant = (values[other] - values[i]) / h
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


def inverse(order: int, y: float, knots: Floats, values: Floats, slopes: Floats, count: int) -> float:
    """Argument at which a monotone curve has the value y, by Newton's method with bisection as safeguard. `order` is zero."""
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
    """Slopes of the natural cubic spline: two continuous derivatives, no curvature at the ends. `work` has room for `count` numbers.

    The tridiagonal system for slopes (de Boor, A Practical Guide to Splines, chapter IV, eq. 4), by elimination.
    """
    if count == 2:
        out[0] = (values[1] - values[0]) / (knots[1] - knots[0])
        out[1] = out[0]
        return
    above = 0.0
    right = 0.0
    for i in range(count):
        before = 1.0 if i > 0 else 0.0
        after = 1.0 if i < count - 1 else 0.0
        here = 2.0
        given = 0.0
        if i == 0:
            given = 3.0 * ((values[1] - values[0]) / (knots[1] - knots[0]))
        elif i == count - 1:
            given = 3.0 * ((values[i] - values[i - 1]) / (knots[i] - knots[i - 1]))
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
    """Slopes that keep the curve monotone where the points are.

    Inside the weighted harmonic mean of Fritsch and Butland (1984), which is within the bounds of Fritsch and Carlson
    (1980); at the ends a three-point formula, limited to those bounds.
    """
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


# ---------------------------------------------------------------- values of operators


def value_on(curve: Callable[..., float], lists: int, order: float, x: float, *points: float) -> float:
    """Value of a curve from its lists: places, values and, except for straight lines, slopes. Raises `OutsideTable`."""
    n = len(points) // lists
    parts = [points[i * n : (i + 1) * n] for i in range(lists)]
    _check_range(order, x, parts[1 if curve is inverse else 0])
    return curve(int(order), x, *parts, n)


@lru_cache(maxsize=64)
def _slopes(write: Callable[..., None], xs: tuple[float, ...], ys: tuple[float, ...]) -> tuple[float, ...]:
    slopes = [0.0] * len(xs)
    write(len(xs), xs, ys, [0.0] * len(xs), slopes)
    return tuple(slopes)


natural_slopes = partial(_slopes, natural_slope)
monotone_slopes = partial(_slopes, monotone_slope)


def surface_slopes(xs: Points, ys: Points, rows: Sequence[Points]) -> tuple[list[tuple[float, ...]], ...]:
    """Slopes along x, along y, and twists, a row for each place of `xs`, of a bicubic surface that rises and falls only where its points do.

    Slopes are those of the curves along the axes, reduced where those of neighbouring curves differ too much (in the manner of Carlson and Fritsch
    1985). A cubic along x is monotone if its slopes at both ends have the sign of its rise and are at most 3*rise/width. Both are cubics of y here,
    and the condition holds throughout a cell if it holds for their Bernstein coefficients. Reduced slopes meet it without a twist; a twist, the
    mean of the slopes of slopes, is as large as it allows.
    """
    columns = [*zip(*rows, strict=True)]
    across = [monotone_slopes(tuple(xs), column) for column in columns]
    along = [monotone_slopes(tuple(ys), tuple(row)) for row in rows]
    p = [*zip(*_reduced(ys, xs, columns, [*zip(*along, strict=True)], across), strict=True)]
    q = _reduced(xs, ys, rows, [*zip(*across, strict=True)], along)
    bounds = _twist_bounds(xs, ys, rows, p, q)
    turned = _twist_bounds(ys, xs, columns, [*zip(*q, strict=True)], [*zip(*p, strict=True)])
    by_y = [monotone_slopes(tuple(ys), row) for row in p]
    by_x = [monotone_slopes(tuple(xs), column) for column in zip(*q, strict=True)]
    twists = []
    for i, row in enumerate(bounds):
        limits = [(max(low, turned[j][i][0]), min(high, turned[j][i][1])) for j, (low, high) in enumerate(row)]
        twists.append(tuple(min(max(0.5 * (by_y[i][j] + by_x[j][i]), a), b) for j, (a, b) in enumerate(limits)))
    return p, q, twists


def _twist_bounds(
    xs: Points, ys: Points, rows: Sequence[Points], across: Sequence[Points], along: Sequence[Points]
) -> list[list[tuple[float, float]]]:
    """Least and greatest twist, 0 between them, with which cubics along x are monotone where their points are."""
    bounds = [[(-inf, inf)] * len(ys) for _ in xs]
    for i, j in product(range(len(xs) - 1), range(len(ys) - 1)):
        changes = rows[i + 1][j] - rows[i][j], rows[i + 1][j + 1] - rows[i][j + 1]
        if min(changes) < 0 < max(changes):
            continue
        width, height = xs[i + 1] - xs[i], ys[j + 1] - ys[j]
        for side, length in ((j, height), (j + 1, -height)):
            rise = rows[i + 1][side] - rows[i][side] + length * (along[i + 1][side] - along[i][side]) / 3
            for end in (i, i + 1):
                slope = across[end][side]
                none, most = -3 * slope / length, (9 * rise / width - 3 * slope) / length
                low, high = bounds[end][side]
                bounds[end][side] = max(low, min(none, most, 0.0)), min(high, max(none, most, 0.0))
    return bounds


def _reduced(
    xs: Points, ys: Points, rows: Sequence[Points], across: Sequence[Points], along: Sequence[Points]
) -> list[tuple[float, ...]]:
    """Slopes along y that are near enough to those of neighbouring rows."""
    result = [[*row] for row in along]
    for j in range(len(ys)):
        # bounds on how much a slope falls or rises from row to row
        falls, rises = ([inf] * (len(xs) - 1) for _ in range(2))
        for cell in range(max(j - 1, 0), min(j + 1, len(ys) - 1)):
            for i, (a, b) in enumerate(pairwise(rows)):
                width = (xs[i + 1] - xs[i]) * max(abs(across[i][j]), abs(across[i + 1][j]))
                room = max(3 * abs(b[j] - a[j]) - width, 0.0) / (ys[cell + 1] - ys[cell])
                changes = b[cell] - a[cell], b[cell + 1] - a[cell + 1]
                for bounds, sign in ((falls, 1), (rises, -1)):
                    if min(change * (sign if cell == j else -sign) for change in changes) >= 0:
                        bounds[i] = min(bounds[i], room)
        slopes = [row[j] for row in along]
        # both sides of a change of sign take their half
        halves = [0.5 if min(a, b) < 0 < max(a, b) else 1.0 for a, b in pairwise(slopes)]
        for sign, up, down in ((1, rises, falls), (-1, falls, rises)):
            sizes = [max(sign * slope, 0.0) for slope in slopes]
            for i, half in enumerate(halves):
                sizes[i + 1] = min(sizes[i + 1], sizes[i] + half * up[i])
            for i in range(len(halves) - 1, -1, -1):
                sizes[i] = min(sizes[i], sizes[i + 1] + halves[i] * down[i])
            for i, size in enumerate(sizes):
                if sign * slopes[i] > 0:
                    result[i][j] = sign * size
    return [tuple(row) for row in result]


def slope_at(slopes: Callable[..., tuple[float, ...]], number: float, *points: float) -> float:
    """One of the slopes of a curve through points."""
    n = len(points) // 2
    return slopes(points[:n], points[n:])[int(number)]


def _check_range(order: float, x: float, xs: Points) -> None:
    low, high = min(xs[0], xs[-1]), max(xs[0], xs[-1])
    margin = MARGIN * (high - low)
    if order == 0 and not low - margin <= x <= high + margin:
        raise OutsideTable(f"{x:g} lies outside of the table, which goes from {low:g} to {high:g}")


def always_rises(values: Points) -> bool:
    """Return True if the numbers are strictly increasing."""
    return all(a < b for a, b in pairwise(values))


def one_way(values: Points) -> bool:
    """Return True if the numbers are strictly monotone."""
    return always_rises(values) or always_rises(values[::-1])


def turns(xs: Points, ys: Points, slopes: Points) -> bool:
    """Return True if a cubic curve through values that rise or fall throughout does not."""
    secants = [(d - c) / (b - a) for (a, b), (c, d) in zip(pairwise(xs), pairwise(ys), strict=True)]
    for secant, a, b in zip(secants, slopes, slopes[1:], strict=False):
        p, q = a / secant, b / secant
        # The parabola of the slope over 0..1, and its least value inside (Fritsch and Carlson 1980, section 3).
        curvature = p + q - 2
        vertex = (2 * p + q - 3) / (3 * curvature) if curvature else -1.0
        least = min(p, q) if not (curvature > 0 and 0 < vertex < 1) else p - (2 * p + q - 3) ** 2 / (3 * curvature)
        if least < 0:
            return True
    return False


# ---------------------------------------------------------------- random numbers

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15
# The smooth step of the fifth degree and its derivatives, by rising powers.
SMOOTH_STEP = ((0, 0, 0, 10, -15, 6), (0, 0, 30, -60, 30), (0, 60, -180, 120), (60, -360, 360), (-360, 720), (720,))


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


def noise_at(order: float, place: float, seed: float) -> float:
    """Value of `noise`, or a derivative of it."""
    steps = [*map(float, SMOOTH_STEP[int(order)])]
    return noise(int(order), place, seed, steps, len(steps))


def random_number(number: int, seed: int) -> float:
    """Number `number` of the stream of a seed, uniform in [-1, 1): splitmix64 (Steele, Lea and Flood 2014)."""
    start = mixed((seed + _GOLDEN) & _MASK)
    return (mixed((start + number * _GOLDEN) & _MASK) >> 11) * 2.0**-52 - 1.0


def mixed(z: int) -> int:
    """Mixing of splitmix64."""
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & _MASK
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & _MASK
    return z ^ (z >> 31)
