"""Beginning of a generated module: the functions that its lines call, only those that it needs."""

from __future__ import annotations

from collections.abc import Set

from ...algebra.interpolate import SMOOTH_STEP
from ...algebra.operators import OPERATORS

BEGINNING = '''

import numpy as np


def _select(condition, value, otherwise):
    """`value if condition else otherwise`, for numbers and for arrays."""
    if np.ndim(condition) == 0:
        return np.float64(value if condition else otherwise)  # a plain float would raise where it is divided by zero
    return np.where(condition, value, otherwise)


def _leading(time, *arrays):
    """The leading axes that the arguments have together."""
    if not np.asarray(time).ndim and max([np.asarray(a).ndim for a in arrays]) < 2:
        return ()
    return np.broadcast_shapes(np.shape(time), *(np.shape(a)[:-1] for a in arrays))


def _pack(values, shape, batch):
    """The values as an array whose last axes have the given shape, after the leading axes of a batch."""
    if not batch:
        return np.array(values, dtype=float).reshape(shape)
    like = np.zeros(batch[::-1])
    packed = np.array(np.broadcast_arrays(like, *values)[1:], dtype=float)
    packed = packed.reshape(*shape, *packed.shape[1:]) if values else np.zeros((*shape, *like.shape))
    return np.moveaxis(packed.T, range(-1, -len(shape) - 1, -1), range(-len(shape), 0))


def _solution(matrix, right):
    """The solution of a linear system, and how far that of 1 … 1 is missed."""
    rows = np.abs(matrix).max(axis=-1, keepdims=True)
    matrix = matrix / rows
    columns = np.abs(matrix).max(axis=-2, keepdims=True)
    matrix = matrix / columns
    # The other right side has the solution 1 … 1: how well that is found tells how nearly singular the matrix is.
    rights = np.stack([right / rows[..., 0], matrix.sum(axis=-1)], axis=-1)
    try:
        solution = np.linalg.solve(matrix, rights)
    except np.linalg.LinAlgError:  # one of a batch at least has no solution: the others keep theirs
        solution = np.full(rights.shape, np.nan)
        for index in np.ndindex(*matrix.shape[:-2]):
            if np.isfinite(matrix[index]).all() and np.linalg.matrix_rank(matrix[index]) == len(matrix[index]):
                solution[index] = np.linalg.solve(matrix[index], rights[index])
    return solution[..., 0] / columns[..., 0, :], np.abs(solution[..., 1] - 1).max(axis=-1, keepdims=True)


def _solve(count, *entries):
    """The solution of a linear system; the matrix by rows, then the right side. Without one solution it is not a number."""
    entries = np.array(np.broadcast_arrays(*entries), dtype=float).T
    matrix = entries[..., : count * count].reshape(*entries.shape[:-1], count, count)
    right = entries[..., count * count :]
    solution, missed = _solution(matrix, right)
    if not (missed < 1e-11).all():
        # Unknowns of several units may make it look singular: means of magnitudes bring it to a scale without units.
        present = matrix != 0
        logarithms = np.log2(np.where(present, np.abs(matrix), 1.0))
        columns = np.zeros((*matrix.shape[:-2], 1, count))
        for _ in range(12):
            rows = np.where(present, logarithms - columns, 0.0).sum(-1, keepdims=True) / present.sum(-1, keepdims=True)
            columns = np.where(present, logarithms - rows, 0.0).sum(-2, keepdims=True) / present.sum(-2, keepdims=True)
        rows, columns = 2.0 ** np.rint(rows), 2.0 ** np.rint(columns)
        other, better = _solution(matrix / rows / columns, right / rows[..., 0])
        closer = ~(missed < 1e-11) & ~(better > missed)
        solution, missed = np.where(closer, other / columns[..., 0, :], solution), np.where(closer, better, missed)
    return np.where(missed < 1e-3, solution, np.nan).T
'''

TABLES = '''def _points(values):
    """The points of a table as an array, the points first."""
    if isinstance(values, np.ndarray):
        return values
    numbers = all(isinstance(v, float) for v in values)
    return np.array(values if numbers else np.broadcast_arrays(*values), dtype=float)


def _segment(x, knots):
    """The number of the interval that x lies in; the first or last one where it lies outside."""
    if knots.ndim == 1:
        if knots[-1] < knots[0]:
            knots, x = -knots, -x
        i = np.searchsorted(knots, x, side="right") - 1
        return min(max(int(i), 0), len(knots) - 2) if np.ndim(i) == 0 else np.clip(i, 0, len(knots) - 2)
    sign = np.sign(knots[-1] - knots[0])
    return np.clip(np.sum(sign * x >= sign * knots, axis=0) - 1, 0, len(knots) - 2)


def _pick(values, i):
    """The values with the numbers i."""
    if values.ndim == 1:
        return values[i]
    return np.take_along_axis(np.broadcast_to(values, (len(values), *np.shape(i))), np.asarray(i)[None], axis=0)[0]


def _ends(x, knots):
    """The numbers of the nearer and of the other end of the interval of x."""
    i = _segment(x, knots)
    nearer = np.abs(_pick(knots, i + 1) - x) < np.abs(x - _pick(knots, i))
    return i + nearer, i + 1 - nearer


def _linear(order, x, knots, values):
    """Straight lines between points, continued beyond the ends; `order` counts derivatives."""
    knots, values = _points(knots), _points(values)
    i, j = _ends(x, knots)
    a, y = _pick(knots, i), _pick(values, i)
    slope = (_pick(values, j) - y) / (_pick(knots, j) - a)
    return slope if order else y + slope * (x - a)


def _hermite(order, x, knots, values, slopes):
    """A curve of the third degree through points with slopes, straight beyond the ends; `order` counts derivatives."""
    knots, values, slopes = _points(knots), _points(values), _points(slopes)
    i, j = _ends(x, knots)
    a, y, m, n = _pick(knots, i), _pick(values, i), _pick(slopes, i), _pick(slopes, j)
    h = _pick(knots, j) - a
    at = np.minimum(np.maximum(x, knots[0]), knots[-1])
    d, secant = at - a, (_pick(values, j) - y) / h
    c2, c3 = (3 * secant - 2 * m - n) / h, (m + n - 2 * secant) / h**2
    slope = m + d * (2 * c2 + 3 * d * c3)
    if order == 0:
        return y + d * (m + d * (c2 + d * c3)) + (x - at) * slope
    if order == 1:
        return slope
    return np.where(x == at, 2 * c2 + 6 * d * c3 if order == 2 else 6 * c3, 0.0)[()]
'''

INVERSE = '''def _inverse(order, y, knots, values, slopes):
    """Where a rising or falling curve has the value y: Newton's method, held between two places."""
    knots, values, slopes = _points(knots), _points(values), _points(slopes)
    sign = np.sign(values[-1] - values[0])
    i = _segment(y, values)
    low, high, first = _pick(knots, i), _pick(knots, i + 1), _pick(values, i)
    width = high - low
    start = low + (y - first) / (_pick(values, i + 1) - first) * width
    inside = (low < start) & (start < high)
    x = np.where(inside, start, low + 0.5 * width)
    for _ in range(100):
        error = sign * (_hermite(0, x, knots, values, slopes) - y)
        low, high = np.where(error < 0, x, low), np.where(error < 0, high, x)
        slope = sign * _hermite(1, x, knots, values, slopes)
        new = x - error / np.where(slope > 0, slope, np.inf)
        new = np.where((low < new) & (new < high) & (slope > 0), new, 0.5 * (low + high))
        done = np.abs(new - x) <= 1e-14 * (np.abs(x) + width)
        x = new
        if np.all(done | ~inside):
            break
    return np.where(inside, x, start)[()]
'''

SLOPES = '''def _natural_slope(knots, values):
    """The slopes of the natural cubic spline, by elimination."""
    count = len(knots)
    steps = [knots[i + 1] - knots[i] for i in range(count - 1)]
    secants = [(values[i + 1] - values[i]) / steps[i] for i in range(count - 1)]
    if count == 2:
        return [secants[0], secants[0]]
    rows = [(0.0, 2.0, 1.0, 3 * secants[0])]
    for a, b, p, q in zip(steps, steps[1:], secants, secants[1:]):
        rows.append((1 / a, 2 / a + 2 / b, 1 / b, 3 * (p / a + q / b)))
    rows.append((1.0, 2.0, 0.0, 3 * secants[-1]))
    above, right, passed = 0.0, 0.0, []
    for before, here, after, given in rows:
        pivot = here - before * above
        above, right = after / pivot, (given - before * right) / pivot
        passed.append((above, right))
    slopes = [passed[-1][1]]
    for after, given in reversed(passed[:-1]):
        slopes.append(given - after * slopes[-1])
    return slopes[::-1]


def _monotone_slope(knots, values):
    """Slopes that keep the curve monotone wherever the points are (Fritsch and Butland 1984)."""
    count = len(knots)
    steps = [knots[i + 1] - knots[i] for i in range(count - 1)]
    secants = [(values[i + 1] - values[i]) / steps[i] for i in range(count - 1)]
    if count == 2:
        return [secants[0], secants[0]]

    def end(near, far, first, second):
        slope = ((2 * near + far) * first - near * second) / (near + far)
        cut = (first * second < 0) & (np.abs(slope) > 3 * np.abs(first))
        return np.where(slope * first <= 0, 0.0, np.where(cut, 3 * first, slope))[()]

    slopes = [end(steps[0], steps[1], secants[0], secants[1])]
    for a, b, p, q in zip(steps, steps[1:], secants, secants[1:]):
        same = p * q > 0
        p, q = np.where(same, p, 1.0), np.where(same, q, 1.0)
        slopes.append(np.where(same, 3 * (a + b) / ((2 * b + a) / p + (b + 2 * a) / q), 0.0)[()])
    slopes.append(end(steps[-1], steps[-2], secants[-1], secants[-2]))
    return slopes
'''

NOISE = '''_SMOOTH_STEP = @SMOOTH@


def _mixed(z):
    """The mixing of splitmix64 (Steele, Lea and Flood 2014), modulo 2^64."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _random_number(number, seed):
    """As `_random`, of two whole numbers; several times faster."""

    def mixed(z):
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & mask
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB & mask
        return z ^ (z >> 31)

    mask, golden = (1 << 64) - 1, 0x9E3779B97F4A7C15
    return (mixed((mixed((seed + golden) & mask) + number * golden) & mask) >> 11) * 2.0**-52 - 1.0


def _random(number, seed):
    """Number `number` of the stream of a seed, uniform in [-1, 1); both whole, arrays of at least one axis."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    start = _mixed(seed.astype(np.int64).view(np.uint64) + golden)
    return (_mixed(start + number.astype(np.int64).view(np.uint64) * golden) >> np.uint64(11)) * 2.0**-52 - 1.0


def _noise(order, place, seed):
    """A random number at each whole number, joined by smooth steps; `order` counts derivatives."""
    if np.ndim(place) == 0 and np.ndim(seed) == 0 and abs(place) < 2.0**62:
        whole = int(place // 1)
        first, second = _random_number(whole, int(seed)), _random_number(whole + 1, int(seed))
        step = sum(c * (place - whole) ** i for i, c in enumerate(_SMOOTH_STEP[order]))
        return (second - first) * step + (first if order == 0 else 0.0)
    shape = np.broadcast_shapes(np.shape(place), np.shape(seed))
    place, seed = (np.atleast_1d(np.array(np.broadcast_to(a, shape), dtype=float)) for a in (place, seed))
    place = np.where(np.abs(place) < 2.0**62, place, np.nan)
    known = np.where(np.isnan(place), 0.0, place)
    whole = np.floor(known)
    first, second = _random(whole, seed), _random(whole + 1, seed)
    step = sum(c * (known - whole) ** i for i, c in enumerate(_SMOOTH_STEP[order]))
    value = (second - first) * step + (first if order == 0 else 0.0)
    return np.where(np.isnan(place), np.nan, value).reshape(shape)[()]
'''

BANDED = '''def _banded(count, lower, upper, *entries):
    """The same for a matrix of which only `lower` diagonals below the main one and `upper` above it are given, by rows."""
    width = lower + upper + 1
    full = [0.0] * (count * count)
    for i in range(count):
        for j in range(max(0, i - lower), min(count, i + upper + 1)):
            full[i * count + j] = entries[i * width + j - i + lower]
    return _solve(count, *full, *entries[count * width :])
'''

# Operators, and the functions that a module with one of them needs.
NEEDED = (
    ({"linear", "cubic", "monotone", "inverse"}, TABLES),
    ({"inverse"}, INVERSE),
    ({"natural_slope", "monotone_slope"}, SLOPES),
    ({"noise"}, NOISE.replace("@SMOOTH@", repr(SMOOTH_STEP))),
    ({"banded"}, BANDED),
)


def beginning(operators: Set[str]) -> str:
    """Text of a module's beginning, with the functions for these operators."""
    return "\n\n".join([BEGINNING, *operator_functions(operators)])


def operator_functions(operators: Set[str]) -> list[str]:
    """Texts of the functions that numpy lacks."""
    own = [row.numpy_source for row in OPERATORS.values() if row.name in operators and row.numpy_source]
    return [*(text for needs, text in NEEDED if needs & operators), *own]
