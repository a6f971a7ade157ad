"""Curves through points, and reproducible random numbers: values of the operators `linear`, `cubic`, `monotone`, `noise`.

A cubic curve is stored as points with slopes (cubic Hermite). Generated code computes the same with arrays.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

Points = Sequence[float]

MARGIN = 1e-6  # of the range: how far beyond a table's ends rounding and a solver's tolerance may lead


class OutsideTable(ValueError):
    """The argument of a table is outside of its range."""


# ---------------------------------------------------------------- slopes


@lru_cache(maxsize=64)
def natural_slopes(xs: tuple[float, ...], ys: tuple[float, ...]) -> tuple[float, ...]:
    """Slopes of the natural cubic spline: two continuous derivatives, no curvature at the ends.

    The tridiagonal system for slopes (de Boor, A Practical Guide to Splines, chapter IV, eq. 4), by elimination.
    """
    steps, secants = _secants(xs, ys)
    if len(xs) == 2:
        return secants[0], secants[0]
    inner = list(zip(pairwise(steps), pairwise(secants), strict=True))
    rows = [(0.0, 2.0, 1.0, 3 * secants[0])]
    rows += [(1 / a, 2 / a + 2 / b, 1 / b, 3 * (p / a + q / b)) for (a, b), (p, q) in inner]
    rows.append((1.0, 2.0, 0.0, 3 * secants[-1]))
    above, right = 0.0, 0.0
    passed: list[tuple[float, float]] = []
    for before, here, after, given in rows:
        pivot = here - before * above
        above, right = after / pivot, (given - before * right) / pivot
        passed.append((above, right))
    slopes = [passed[-1][1]]
    for after, given in reversed(passed[:-1]):
        slopes.append(given - after * slopes[-1])
    return tuple(reversed(slopes))


@lru_cache(maxsize=64)
def monotone_slopes(xs: tuple[float, ...], ys: tuple[float, ...]) -> tuple[float, ...]:
    """Slopes that keep the curve monotone where the points are.

    Inside the weighted harmonic mean of Fritsch and Butland (1984), which is within the bounds of Fritsch and Carlson
    (1980); at the ends a three-point formula, limited to those bounds.
    """
    steps, secants = _secants(xs, ys)
    if len(xs) == 2:
        return secants[0], secants[0]
    slopes = [_end_slope(steps[0], steps[1], secants[0], secants[1])]
    for (a, b), (p, q) in zip(pairwise(steps), pairwise(secants), strict=True):
        if p * q <= 0:
            slopes.append(0.0)
        else:
            slopes.append(3 * (a + b) / ((2 * b + a) / p + (b + 2 * a) / q))
    slopes.append(_end_slope(steps[-1], steps[-2], secants[-1], secants[-2]))
    return tuple(slopes)


def _secants(xs: Points, ys: Points) -> tuple[list[float], list[float]]:
    steps = [b - a for a, b in pairwise(xs)]
    return steps, [(b - a) / h for (a, b), h in zip(pairwise(ys), steps, strict=True)]


def _end_slope(near: float, far: float, first: float, second: float) -> float:
    """Slope at an end from its two intervals, limited so that the curve stays monotone."""
    slope = ((2 * near + far) * first - near * second) / (near + far)
    if slope * first <= 0:
        return 0.0
    if first * second < 0 and abs(slope) > 3 * abs(first):
        return 3 * first
    return slope


# ---------------------------------------------------------------- values


def linear(order: float, x: float, *points: float) -> float:
    """Straight lines between points with monotone places; `order` is the order of the derivative. Raises `OutsideTable`."""
    n = len(points) // 2
    xs, ys = points[:n], points[n:]
    if xs[0] > xs[-1]:
        xs, ys = xs[::-1], ys[::-1]
    _check_range(order, x, xs)
    i = _segment(x, xs)
    slope = (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i])
    return ys[i] + slope * (x - xs[i]) if order == 0 else slope


def hermite(order: float, x: float, *points: float) -> float:
    """Cubic curve through points with slopes, or a derivative of it. Raises `OutsideTable`."""
    n = len(points) // 3
    xs, ys, slopes = points[:n], points[n : 2 * n], points[2 * n :]
    _check_range(order, x, xs)
    i = _segment(x, xs)
    h = xs[i + 1] - xs[i]
    at = min(max(x, xs[0]), xs[-1])
    d, beyond = at - xs[i], x - at
    secant = (ys[i + 1] - ys[i]) / h
    c2, c3 = (3 * secant - 2 * slopes[i] - slopes[i + 1]) / h, (slopes[i] + slopes[i + 1] - 2 * secant) / h**2
    slope = slopes[i] + d * (2 * c2 + 3 * d * c3)
    if order == 0:
        return ys[i] + d * (slopes[i] + d * (c2 + d * c3)) + beyond * slope
    if order == 1:
        return slope
    if beyond:
        return 0.0
    return 2 * c2 + 6 * d * c3 if order == 2 else 6 * c3


def inverse(order: float, y: float, *points: float) -> float:
    """Argument at which a monotone cubic curve has the value y. Raises `OutsideTable`."""
    n = len(points) // 3
    xs, ys = points[:n], points[n : 2 * n]
    _check_range(order, y, ys)
    sign = 1.0 if ys[-1] > ys[0] else -1.0
    i = _segment(sign * y, [sign * v for v in ys])
    low, high = xs[i], xs[i + 1]
    x = low + (y - ys[i]) / (ys[i + 1] - ys[i]) * (high - low)
    if not low < x < high:  # an end, or the straight continuation
        return x
    for _ in range(100):
        error = sign * (hermite(0, x, *points) - y)
        low, high = (x, high) if error < 0 else (low, x)
        slope = sign * hermite(1, x, *points)
        new = x - error / slope if slope > 0 else low
        new = new if low < new < high else 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * (abs(x) + high - low) or new in (low, high):
            return new
        x = new
    return x


def slope_at(slopes: Callable[..., tuple[float, ...]], number: float, *points: float) -> float:
    """One of the slopes of a curve through points."""
    n = len(points) // 2
    return slopes(points[:n], points[n:])[int(number)]


def _segment(x: float, xs: Points) -> int:
    return min(max(bisect_right(xs, x) - 1, 0), len(xs) - 2)


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
    """Return True if a cubic curve is not monotone, or constant between two points."""
    _, secants = _secants(xs, ys)
    if not one_way(ys):
        return True
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


def noise(order: float, place: float, seed: float) -> float:
    """A random number between -1 and 1 at each integer, joined by smooth steps; or a derivative of that."""
    whole = int(place // 1)
    part = place - whole
    first, second = random_number(whole, int(seed)), random_number(whole + 1, int(seed))
    step = sum(c * part**i for i, c in enumerate(SMOOTH_STEP[int(order)]))
    return (second - first) * step + (first if order == 0 else 0.0)


def random_number(number: int, seed: int) -> float:
    """Number `number` of the stream of a seed, uniform in [-1, 1): splitmix64 (Steele, Lea and Flood 2014)."""
    start = _mixed((seed + _GOLDEN) & _MASK)
    return (_mixed((start + number * _GOLDEN) & _MASK) >> 11) * 2.0**-52 - 1.0


def _mixed(z: int) -> int:
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & _MASK
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & _MASK
    return z ^ (z >> 31)
