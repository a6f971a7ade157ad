"""Interval arithmetic: for each operator a function from intervals to an interval that contains all its values.

An interval is a pair of arrays, lower and upper ends, over many boxes at once. A constant quantity is a pair of equal numbers, and
results from such pairs alone are the values that a program computes. All other results are widened by the rounding of the operation,
relative to their size: an exact zero stays zero (Moore, Kearfott and Cloud, Introduction to Interval Analysis, 2009, chapters 2 to 5).
A range is (-inf, inf) if a box contains the end of a domain or a pole, and NaN if no part of it has a value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial, reduce
from typing import Any

import numpy as np

from .expression import Apply, Expression, Number, Symbol
from .interpolate import SMOOTH_STEP
from .operators import OPERATORS, Operator, value_of

Interval = tuple[Any, Any]  # lower and upper ends, each a number or an array (boxes,)

EPS = 2.0**-52
BASIC, LIBRARY = EPS, 4 * EPS  # rounding of one operation, relative; of one call of the mathematical library
HALF, TURN = 0.5 * math.pi, 2 * math.pi
LARGEST_ANGLE = 2.0**45  # beyond this rounding of an angle is no small part of a turn
EVERYTHING: Interval = (-math.inf, math.inf)
CURVES = ("linear", "cubic", "monotone")


def is_still(x: Interval) -> bool:
    """Return True if a pair is one number for all boxes."""
    return np.ndim(x[0]) == 0 and x[0] == x[1]


def widened(low: Any, high: Any, part: float = BASIC) -> Interval:
    """The interval with its ends moved outward, relative to their size."""
    return low - part * np.abs(low), high + part * np.abs(high)


def _sum(*terms: Interval) -> Interval:
    return reduce(lambda x, y: widened(x[0] + y[0], x[1] + y[1]), terms)


def _product_of_two(a: Interval, b: Interval) -> Interval:
    """Product of two intervals. 0 times infinity is 0: an infinite end stands for finite values of any size."""
    if is_still(a):
        a, b = b, a
    if is_still(b) and b[0] != 0 and math.isfinite(b[0]):
        low, high = a[0] * b[0], a[1] * b[0]
        return widened(low, high) if b[0] > 0 else widened(high, low)
    corners = [_finite_product(x, y) for x in a for y in b]
    return widened(np.minimum.reduce(corners), np.maximum.reduce(corners))


def _finite_product(x: Any, y: Any) -> Any:
    product = np.asarray(x * y)
    return np.where(np.isnan(product) & ~(np.isnan(x) | np.isnan(y)), 0.0, product)


def _product(*factors: Interval) -> Interval:
    """Product of factors. Equal factors give a power, which is never negative for an even exponent."""
    counts: dict[tuple[int, int], list[Interval]] = {}
    for factor in factors:
        counts.setdefault((id(factor[0]), id(factor[1])), []).append(factor)
    parts = [_power(same[0], (float(len(same)),) * 2) if len(same) > 1 else same[0] for same in counts.values()]
    still = math.prod(float(part[0]) for part in parts if is_still(part))
    parts = [part for part in parts if not is_still(part)]
    result = (still, still) if still != 1.0 else parts.pop()
    for part in parts:
        result = _product_of_two(result, part)
    return result


def _quotient(a: Interval, b: Interval) -> Interval:
    low, high = b
    inverse = widened(1.0 / np.asarray(high), 1.0 / np.asarray(low))
    pole = (np.asarray(low) <= 0) & (np.asarray(high) >= 0)
    first = np.where(pole, np.where((low == 0) & (high > 0), inverse[0], -np.inf), inverse[0])
    last = np.where(pole, np.where((high == 0) & (low < 0), inverse[1], np.inf), inverse[1])
    return _product_of_two(a, (first, last))


def _rising(function: Callable[[Any], Any], least: float, most: float) -> Callable[[Interval], Interval]:
    """Range of a function that is increasing on its domain, from `least` to `most`."""

    def over(x: Interval) -> Interval:
        low, high = widened(function(np.maximum(x[0], least)), function(np.minimum(x[1], most)), LIBRARY)
        return _within_domain(x, (low, high), least, most)

    return over


def _within_domain(x: Interval, found: Interval, least: float, most: float) -> Interval:
    """Range for boxes at the end of a domain: (-inf, inf) if a box leaves it in part, NaN if it is outside."""
    if least == -math.inf and most == math.inf:
        return found
    outside = (x[1] < least) | (x[0] > most)
    partly = ~outside & ((x[0] < least) | (x[1] > most))
    low = np.where(outside, np.nan, np.where(partly, -np.inf, found[0]))
    high = np.where(outside, np.nan, np.where(partly, np.inf, found[1]))
    return low, high


def _falling(function: Callable[[Any], Any], least: float, most: float) -> Callable[[Interval], Interval]:
    mirrored = _rising(lambda x: -function(x), least, most)

    def over(x: Interval) -> Interval:
        low, high = mirrored(x)
        return -np.asarray(high), -np.asarray(low)

    return over


def _even(x: Interval) -> Interval:
    """The range of the absolute value."""
    low, high = np.abs(x[0]), np.abs(x[1])
    inside = (np.asarray(x[0]) <= 0) & (np.asarray(x[1]) >= 0)
    return np.where(inside, 0.0, np.minimum(low, high)), np.maximum(low, high)


def _periods(x: Interval, origin: float, period: float) -> Interval:
    """Distance of the ends from an origin in periods, moved outward by its rounding, which is a large part of a period far away."""
    begin, end = (x[0] - origin) * (1 / period), (x[1] - origin) * (1 / period)
    blur = LIBRARY * np.maximum(np.maximum(-begin, end), 1.0)
    return begin - blur, end + blur


def _wave(x: Interval, crest: float, function: Callable[[Any], Any]) -> Interval:
    """The range of a sine: 1 if the box holds a crest, -1 if it holds a trough."""
    first, last = np.asarray(x[0]), np.asarray(x[1])
    ends = function(first), function(last)
    low, high = widened(np.minimum(*ends), np.maximum(*ends), LIBRARY)
    begin, end = _periods(x, crest, TURN)
    high = np.where(np.ceil(begin) <= end, 1.0, np.minimum(high, 1.0))
    low = np.where(np.ceil(begin - 0.5) <= end - 0.5, -1.0, np.maximum(low, -1.0))
    far = np.maximum(-first, last).max(initial=0.0)
    if far < LARGEST_ANGLE:
        return low, high
    whole = ~(np.maximum(np.abs(first), np.abs(last)) < LARGEST_ANGLE)
    bad = np.isnan(first) | np.isnan(last)
    return np.where(bad, np.nan, np.where(whole, -1.0, low)), np.where(bad, np.nan, np.where(whole, 1.0, high))


def _tangent(x: Interval) -> Interval:
    low, high = widened(np.tan(x[0]), np.tan(x[1]), LIBRARY)
    begin, end = _periods(x, HALF, math.pi)
    pole = np.ceil(begin) <= end
    return np.where(pole, -np.inf, low), np.where(pole, np.inf, high)


def _power(base: Interval, exponent: Interval) -> Interval:
    if not is_still(exponent):  # b^e = exp(e log b)
        return TABLE["exp"](_product_of_two(exponent, TABLE["log"](base)))
    n = float(exponent[0])
    if n == int(n) and n < 0:
        return _quotient((1.0, 1.0), _power(base, (-n, -n)))
    if n == int(n):
        low, high = base if n % 2 else _even(base)
        return widened(np.power(low, n), np.power(high, n), LIBRARY)
    return (_rising if n > 0 else _falling)(lambda x: np.power(x, n), 0.0, math.inf)(base)


def _root(x: Interval, degree: Interval) -> Interval:
    if not is_still(degree) or degree[0] % 2 == 0:
        return EVERYTHING
    n = float(degree[0])
    if n == int(n) and n < 0:
        return _quotient((1.0, 1.0), _root(x, (-n, -n)))
    if n == int(n):
        low, high = (np.sign(end) * np.power(np.abs(end), 1 / n) for end in x)
        return widened(low, high, LIBRARY)
    return _power(x, (1 / n, 1 / n))


def _angle(y: Interval, x: Interval) -> Interval:
    """Range of atan2, from the corners. It jumps if a box touches the cut at the negative axis, which is treated like a pole."""
    cut = (np.asarray(x[0]) <= 0) & (np.asarray(y[0]) <= 0) & (np.asarray(y[1]) >= 0)
    corners = [np.arctan2(b, a) for b in y for a in x]
    low, high = widened(np.minimum.reduce(corners), np.maximum.reduce(corners), LIBRARY)
    return np.where(cut, -np.inf, low), np.where(cut, np.inf, high)


def _jumping(function: Callable[[Any], Any]) -> Callable[[Interval], Interval]:
    """Range of a step function: (-inf, inf) if it jumps within a box."""

    def over(x: Interval) -> Interval:
        low, high = function(x[0]), function(x[1])
        return np.where(low == high, low, -np.inf), np.where(low == high, high, np.inf)

    return over


def _truth(surely: Any, perhaps: Any) -> Interval:
    return np.asarray(surely, dtype=float), np.asarray(perhaps, dtype=float)


def _equal(a: Interval, b: Interval) -> Interval:
    meet = (a[0] <= b[1]) & (b[0] <= a[1])
    return _truth(meet & (a[0] == a[1]) & (b[0] == b[1]), meet)


def _chosen(condition: Interval, a: Interval, b: Interval) -> Interval:
    first, second = np.asarray(condition[0]) == 1.0, np.asarray(condition[1]) == 0.0
    low = np.where(first, a[0], np.where(second, b[0], np.minimum(a[0], b[0])))
    high = np.where(first, a[1], np.where(second, b[1], np.maximum(a[1], b[1])))
    return low, high


# ---------------------------------------------------------------- curves through points, random numbers


def _curve(kind: str) -> Callable[..., Interval]:
    """Range of a curve through points, or of a derivative of it, from its polynomials."""

    def over(order: Interval, x: Interval, *points: Interval) -> Interval:
        if not all(map(is_still, points)):
            return EVERYTHING
        from .curves import curve

        return curve(kind, int(order[0]), tuple(float(p[0]) for p in points)).over(*x)

    return over


def _noise(order: Interval, place: Interval, seed: Interval) -> Interval:
    """Range of a noise: between two integers it is a smooth step from one random number to the next, and its derivatives are those of the step."""
    number = int(order[0])
    whole = np.floor(place[0])
    beyond = np.floor(place[1]) - whole
    numbers = [plain("noise", (0.0, whole + i, seed[0])) for i in range(3)]
    if number == 0:
        ends = [plain("noise", (0.0, end, seed[0])) for end in place]
        ends.append(np.where(beyond >= 1, numbers[1], ends[0]))
        low, high, reach = np.minimum.reduce(ends), np.maximum.reduce(ends), 1.0
    else:
        steepest = _steepest(number)
        first = (numbers[1] - numbers[0]) * steepest
        rises = np.stack([first, np.where(beyond >= 1, (numbers[2] - numbers[1]) * steepest, first)])
        least = rises if number == 1 else -np.abs(rises)
        low, high, reach = np.minimum(least.min(axis=0), 0.0), np.maximum(np.abs(rises) if number > 1 else rises, 0.0).max(axis=0), 2 * steepest  # fmt: skip
    low, high = widened(low, high, 4 * LIBRARY)
    near = (beyond <= 1) & (np.abs(place[0]) < LARGEST_ANGLE)
    return np.where(near, low, -reach), np.where(near, high, reach)


@lru_cache(maxsize=8)
def _steepest(order: int) -> float:
    """Bound on the derivative of an order of the smooth step between two numbers of a noise."""
    return float(np.abs(np.polyval(SMOOTH_STEP[order][::-1], np.linspace(0.0, 1.0, 4097))).max()) * 1.01


# ---------------------------------------------------------------- the tables

# Functions of numpy, by operator.
PLAIN: Mapping[str, Callable[..., Any]] = {
    **{r.name: getattr(np, r.in_numpy[3:]) for r in OPERATORS.values() if r.arity and r.in_numpy.startswith("np.")},
    "select": np.where,
}


def plain(operator: str, values: Sequence[Any]) -> Any:
    """Value of an operator for numbers or arrays; NaN where it has none."""
    if operator == "add":
        return sum(values[1:], values[0])
    if operator == "multiply":
        return math.prod(values[1:], start=values[0])
    if operator in PLAIN:
        return PLAIN[operator](*values)
    moving = [i for i, value in enumerate(values) if np.ndim(value)]
    if operator in CURVES and moving == [1]:  # its place alone, not its hundreds of points
        from .curves import curve

        return curve(operator, int(values[0]), tuple(map(float, values[2:]))).values(values[1])
    return _at_each(operator, *values)


def _at_each(operator: str, *values: Any) -> Any:
    """Value of an operator that numpy does not have, number by number."""
    moving = [i for i, value in enumerate(values) if np.ndim(value)]

    def at(*xs: float) -> float:
        operands = list(values)
        for i, x in zip(moving, xs, strict=True):
            operands[i] = x
        return _number(operator, operands)

    return np.vectorize(at, otypes=[float])(*(values[i] for i in moving)) if moving else at()


def _number(operator: str, operands: Sequence[float]) -> float:
    try:
        return value_of(operator, operands)
    except (ArithmeticError, ValueError):
        return math.nan


def _by_course(row: Operator) -> Callable[..., Interval]:
    """Range of a function that rises, falls or jumps."""
    function = PLAIN.get(row.name) or partial(_at_each, row.name)
    if row.course == "jumping":
        return _jumping(function)
    return (_rising if row.course == "rising" else _falling)(function, *row.domain)


TABLE: Mapping[str, Callable[..., Interval]] = {
    **{row.name: _by_course(row) for row in OPERATORS.values() if row.course},
    "add": _sum, "multiply": _product, "divide": _quotient, "power": _power, "root": _root, "atan2": _angle,
    "sin": lambda x: _wave(x, HALF, np.sin), "cos": lambda x: _wave(x, 0.0, np.cos), "tan": _tangent, "abs": _even,
    "cosh": lambda x: _rising(np.cosh, 0.0, math.inf)(_even(x)),
    "min": lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    "max": lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
    "less": lambda a, b: _truth(a[1] < b[0], a[0] < b[1]), "less_equal": lambda a, b: _truth(a[1] <= b[0], a[0] <= b[1]),
    "equal": _equal,
    "and": lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    "or": lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])), "not": lambda a: (1.0 - a[1], 1.0 - a[0]),
    "select": _chosen, "noise": _noise, **{kind: _curve(kind) for kind in CURVES},
}  # fmt: skip


def interval_of(x: Expression, lookup: Callable[[Any], Interval]) -> Interval:
    """Range of an expression, whose symbols have the ranges that `lookup` returns for their keys."""
    ranges: dict[Expression, Interval] = {}

    def walk(node: Expression) -> Interval:
        if isinstance(node, Number):
            return node.value, node.value
        if node not in ranges:
            ranges[node] = lookup(node.key) if isinstance(node, Symbol) else apply(node)
        return ranges[node]

    def apply(node: Expression) -> Interval:
        assert isinstance(node, Apply)
        row = TABLE.get(node.operator)
        return EVERYTHING if row is None else row(*map(walk, node.operands))

    return walk(x)
