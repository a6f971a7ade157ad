"""Vectors and matrices of three, over expressions. Zero components are folded."""

from __future__ import annotations

from collections.abc import Sequence

from ..algebra.expression import ONE, ZERO, Expression, add, multiply, negate

Vector = tuple[Expression, Expression, Expression]
Matrix = tuple[Vector, Vector, Vector]  # by rows
NULL: Vector = (ZERO, ZERO, ZERO)
NO_MATRIX: Matrix = (NULL, NULL, NULL)
UNIT: Matrix = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))


def matrix_of(rows: Sequence[Sequence[Expression]]) -> Matrix:
    a, b, c = ((row[0], row[1], row[2]) for row in rows)
    return a, b, c


def plus(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    return add(*(v[0] for v in vectors)), add(*(v[1] for v in vectors)), add(*(v[2] for v in vectors))


def minus(a: Vector, b: Vector) -> Vector:
    """a - b; zero where both are the same."""
    return difference(a[0], b[0]), difference(a[1], b[1]), difference(a[2], b[2])


def difference(a: Expression, b: Expression) -> Expression:
    """a - b; zero where both are the same."""
    return ZERO if a == b else a - b


def scaled(factor: Expression, v: Vector) -> Vector:
    """factor v."""
    return multiply(factor, v[0]), multiply(factor, v[1]), multiply(factor, v[2])


def negated(v: Vector) -> Vector:
    """-v."""
    return negate(v[0]), negate(v[1]), negate(v[2])


def dot(a: Vector, b: Vector) -> Expression:
    """Scalar product."""
    return add(*(multiply(x, y) for x, y in zip(a, b, strict=True)))


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def applied(m: Matrix, v: Vector) -> Vector:
    """m v."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


def transposed(m: Matrix) -> Matrix:
    return tuple(zip(*m, strict=True))  # type: ignore[return-value]


def product(a: Matrix, b: Matrix) -> Matrix:
    """a b."""
    columns = transposed(b)
    return tuple(tuple(dot(row, column) for column in columns) for row in a)  # type: ignore[return-value]


def summed(a: Matrix, b: Matrix) -> Matrix:
    """Sum of matrices a + b."""
    return plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2])


def skew(v: Vector) -> Matrix:
    """Matrix of `v x`."""
    return (ZERO, negate(v[2]), v[1]), (v[2], ZERO, negate(v[0])), (negate(v[1]), v[0], ZERO)


def is_null(v: Vector) -> bool:
    """Return True if all components are known to be zero."""
    return all(x == ZERO for x in v)
