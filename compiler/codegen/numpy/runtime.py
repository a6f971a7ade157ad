"""Beginning of a generated module: the functions that its lines call, only those that it needs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence, Set
from inspect import getsource
from typing import Any

from ...algebra import interpolate
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

BATCHES = '''def _at_each(function, numbers, lists=()):
    """The values of a function of numbers and of lists of numbers, at each point where some of these are arrays."""
    plain = [isinstance(x, np.ndarray) or all(isinstance(v, float) for v in x) for x in lists]
    if all(plain) and all(isinstance(x, (int, float)) for x in numbers):
        return np.array(function(*numbers, *lists))[()]  # a plain float would raise where it is divided by zero
    items = [v for x, same in zip(lists, plain) if not same for v in x]
    shape = np.broadcast_shapes(*map(np.shape, (*numbers, *items)))
    points = [np.broadcast_to(x, shape).ravel() for x in numbers]
    for x, same in zip(lists, plain):
        points.append([x] * int(np.prod(shape)) if same else np.array([np.broadcast_to(v, shape).ravel() for v in x]).T)
    values = np.array([function(*point) for point in zip(*points)], dtype=float)
    return values.T.reshape((*values.shape[1:], *shape))[()]
'''

CURVE = '''def _{name}(order, x, *lists):
    """As `{name}`, of numbers and of batches."""
    return _at_each(lambda x, *lists: {name}(order, x, *lists, len(lists[0])), (x,), lists)
'''

SLOPES = '''def _{name}(*lists):
    """The slopes that `{name}` computes, of numbers and of batches."""

    def slopes(knots, values):
        out = [0.0] * len(knots)
        {name}(len(knots), knots, values, [0.0] * len(knots), out)
        return out

    return _at_each(slopes, (), lists)
'''

NOISE = '''floor, nan, _MASK, _GOLDEN = np.floor, np.nan, 0xFFFFFFFFFFFFFFFF, 0x9E3779B97F4A7C15
_SMOOTH_STEP = {steps}


def _noise(order, place, seed):
    """As `noise`, of numbers and of batches."""
    steps = _SMOOTH_STEP[order]
    return _at_each(lambda place, seed: noise(order, place, seed, steps, len(steps)), (place, seed))
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

# Operators, the functions of `algebra/interpolate.py` that they need, and the text that calls the last of these.
INTERPOLATED: Sequence[tuple[Set[str], Sequence[Callable[..., Any]], str]] = (
    ({"linear"}, (interpolate.segment, interpolate.linear), CURVE),
    ({"cubic", "monotone"}, (interpolate.segment, interpolate.hermite), CURVE),
    ({"inverse"}, (interpolate.segment, interpolate.hermite, interpolate.inverse), CURVE),
    ({"natural_slope"}, (interpolate.natural_slope,), SLOPES),
    ({"monotone_slope"}, (interpolate.end_slope, interpolate.monotone_slope), SLOPES),
    ({"noise"}, (interpolate.mixed, interpolate.random_number, interpolate.noise), NOISE),
)
_TYPES = re.compile(r": (Floats|float|int)\b| -> \w+|  # noqa.*")


def beginning(operators: Set[str]) -> str:
    """Text of a module's beginning, with the functions for these operators."""
    return "\n\n".join([BEGINNING, *operator_functions(operators)])


def operator_functions(operators: Set[str]) -> list[str]:
    """Texts of the functions that numpy lacks."""
    needed = [row for row in INTERPOLATED if row[0] & operators]
    sources = dict.fromkeys(_TYPES.sub("", getsource(f)) for _, functions, _ in needed for f in functions)
    calls = [text.format(name=functions[-1].__name__, steps=interpolate.SMOOTH_STEP) for _, functions, text in needed]
    banded = [BANDED] if "banded" in operators else []
    own = [row.numpy_source for row in OPERATORS.values() if row.name in operators and row.numpy_source]
    return [*sources, *([BATCHES] if needed else []), *calls, *banded, *own]
