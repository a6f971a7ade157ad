"""Functions of lists and matrices as formulas of their entries: products, length and rotation of vectors, transposed and inverse matrices.

An inverse is the adjugate over the determinant (Laplace expansion with shared minors): exact in its units, and the same formula for
numbers, parameters and what changes during a run. Its cost grows as n 2^n, so there is none beyond 4 by 4.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...algebra.expression import ONE as NUMBER_ONE
from ...algebra.expression import ZERO, Number, add, call
from ...graph.units import ONE
from ...syntax import tree
from ..names.errors import WrongArguments, WrongType
from ..names.statement_errors import Wrong
from .lists import added, each, parts_of, product, rows_of, shape_of, shared_unit, sort_of
from .tables import settle_divisor
from .template import Check, Matrix, Typed, Value, Vector, bare_number, negated, times

Builder = Callable[[tree.Call, Sequence[Value]], Value]
LARGEST_INVERSE = 4
LARGEST_IDENTITY = 100
NOTHING, UNITY = Typed(ZERO, None), Typed(NUMBER_ONE, ONE)


def compile_vector(node: tree.Call, arguments: Sequence[Value], checks: list[Check]) -> Value:
    """A call of one of the functions in `VECTORS`; the checks of what it divides by are left there. Raises `Wrong`."""
    count, usage, build = VECTORS[node.function]
    if len(arguments) != count and not (node.function == "rotation" and len(arguments) == 1):
        words = f"{count} argument{'s' * (count != 1)}"
        raise Wrong(WrongArguments(node.span, node.function, words, len(arguments), usage))
    value = build(node, arguments)
    if node.function in ("inverse", "solve"):
        whole = _Minors(node, rows_of(arguments[0]))
        settle_divisor(
            checks, node.function, node.arguments[0].span, whole.determinant().expression, whole.size().expression
        )
    elif node.function == "rotation" and len(arguments) == 2:
        square = add(*(times(x, x, 1).expression for x in parts_of(arguments[0])))
        settle_divisor(checks, node.function, node.arguments[0].span, square)
    return value


def _vector(node: tree.Call, arguments: Sequence[Value], number: int, lengths: Sequence[int] = ()) -> Vector:
    """An argument that is a list, of one of these lengths if there are any."""
    value, span = arguments[number], node.arguments[number].span
    words = "A vector" if not lengths else f"A vector of {' or '.join(map(str, lengths))} components"
    if isinstance(value, Typed) or rows_of(value):
        raise Wrong(WrongType(span, words, sort_of(value), f"A vector is a list: `{VECTORS[node.function][1]}`."))
    if lengths and len(value) not in lengths:
        raise Wrong(WrongType(span, words, sort_of(value), f"Write `{VECTORS[node.function][1]}`."))
    return parts_of(value)


def _sum(node: tree.Call, terms: Sequence[Typed]) -> Typed:
    return added(terms, node.span, f"`{node.function}` takes products")


def _dot(node: tree.Call, arguments: Sequence[Value]) -> Typed:
    a = _vector(node, arguments, 0)
    b = _vector(node, arguments, 1, (len(a),))
    return _sum(node, [times(x, y, 1) for x, y in zip(a, b, strict=True)])


def _cross(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """In the plane the one component that a vector product has, out of the plane."""
    a = _vector(node, arguments, 0, (2, 3))
    b = _vector(node, arguments, 1, (len(a),))

    def component(i: int, j: int) -> Typed:
        return _sum(node, (times(a[i], b[j], 1), negated(times(a[j], b[i], 1))))

    return component(0, 1) if len(a) == 2 else (component(1, 2), component(2, 0), component(0, 1))


def _norm(node: tree.Call, arguments: Sequence[Value]) -> Typed:
    a = _vector(node, arguments, 0)
    unit = shared_unit(a, node.span, "`norm` takes components")
    square = _sum(node, [times(x, x, 1) for x in a])
    return Typed(call("sqrt", square.expression), unit)


def _rotate(node: tree.Call, arguments: Sequence[Value]) -> Value:
    point, angle = _vector(node, arguments, 0, (2,)), _angle(node, arguments, 1)
    return product(_turned(angle), point, (node.span, node.arguments[0].span))


def _angle(node: tree.Call, arguments: Sequence[Value], number: int) -> Typed:
    angle, place = arguments[number], node.arguments[number]
    if not isinstance(angle, Typed) or angle.truth:
        raise Wrong(WrongType(place.span, "An angle", "no number", f"Write `{VECTORS[node.function][1]}`."))
    bare_number(angle, place, "The angle")
    return angle


def _turned(angle: Typed) -> Matrix:
    """Rotation in the plane."""
    c, s = (Typed(call(name, angle.expression), ONE) for name in ("cos", "sin"))
    return (c, negated(s)), (s, c)


def _rotation(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """Rotation in the plane; about an axis of any length Rodrigues' formula, 1 + sin(a) S + (1 - cos(a)) S^2 with the axis as unit vector."""
    angle = _angle(node, arguments, len(arguments) - 1)
    if len(arguments) == 1:
        return _turned(angle)
    axis = _vector(node, arguments, 0, (3,))
    shared_unit(axis, node.span, "`rotation` takes an axis")
    length = Typed(call("sqrt", add(*(times(x, x, 1).expression for x in axis))), None)
    e = [Typed(times(x, length, -1).expression, ONE) for x in axis]
    c, s = (call(name, angle.expression) for name in ("cos", "sin"))
    skew = _cross_matrix(e)
    return tuple(
        tuple(
            Typed(
                (c if i == j else ZERO) + s * skew[i][j].expression + (1 - c) * e[i].expression * e[j].expression, ONE
            )
            for j in range(3)
        )
        for i in range(3)
    )


def _cross_matrix(a: Sequence[Typed]) -> Matrix:
    return (NOTHING, negated(a[2]), a[1]), (a[2], NOTHING, negated(a[0])), (negated(a[1]), a[0], NOTHING)


def _identity(node: tree.Call, arguments: Sequence[Value]) -> Value:
    size = arguments[0]
    number = size.expression.value if isinstance(size, Typed) and isinstance(size.expression, Number) else 0
    if number not in range(1, LARGEST_IDENTITY + 1):
        what = f"A whole number from 1 to {LARGEST_IDENTITY}, written as a number"
        raise Wrong(
            WrongType(node.arguments[0].span, what, f"`{node.arguments[0].span.words}`", "Write `identity(3)`.")
        )
    return tuple(tuple(UNITY if i == j else NOTHING for j in range(int(number))) for i in range(int(number)))


def _transpose(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """Of a list, which is a column, the row."""
    value = arguments[0]
    if isinstance(value, Typed):
        raise Wrong(
            WrongType(node.arguments[0].span, "A matrix or a list", sort_of(value), "A number is its own transpose.")
        )
    rows = rows_of(value)
    return tuple(zip(*rows, strict=True)) if rows else (parts_of(value),)


class _Minors:
    """Determinants of the parts of a square matrix, each computed once."""

    def __init__(self, node: tree.Call, rows: Matrix) -> None:
        self.node, self.rows, self.all = node, rows, tuple(range(len(rows)))
        self._known: dict[tuple[tuple[int, ...], tuple[int, ...]], Typed] = {}

    def determinant(self) -> Typed:
        """The determinant of the whole."""
        return self.minor(self.all, self.all)

    def size(self) -> Typed:
        """The sum of the sizes of the terms of the determinant: the permanent of the absolute values."""
        sizes = tuple(tuple(Typed(call("abs", x.expression), x.dimension) for x in row) for row in self.rows)
        return _Minors(self.node, sizes).minor(self.all, self.all, signed=False)

    def minor(self, rows: tuple[int, ...], columns: tuple[int, ...], signed: bool = True) -> Typed:
        """The determinant of some rows and columns, by the first of these rows. Terms without an entry have no unit to fit."""
        if not rows:
            return UNITY
        if (rows, columns) not in self._known:
            terms = []
            for position, column in enumerate(columns):
                entry = self.rows[rows[0]][column]
                rest = (*columns[:position], *columns[position + 1 :])
                if entry.expression != ZERO and (below := self.minor(rows[1:], rest, signed)).expression != ZERO:
                    term = times(entry, below, 1)
                    terms.append(negated(term) if signed and position % 2 else term)
            where = "" if rows == self.all else f"In rows {_listed(rows)} and columns {_listed(columns)}, "
            what = f"{where}`{self.node.function}` adds products"
            self._known[rows, columns] = added(terms, self.node.span, what) if terms else NOTHING
        return self._known[rows, columns]

    def adjugate(self) -> Matrix:
        """The transposed matrix of cofactors."""
        return tuple(tuple(self._cofactor(j, i) for j in self.all) for i in self.all)

    def _cofactor(self, row: int, column: int) -> Typed:
        rows, columns = (tuple(k for k in self.all if k != out) for out in (row, column))
        minor = self.minor(rows, columns)
        return negated(minor) if (row + column) % 2 else minor


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(str(n + 1) for n in numbers)


def _square(node: tree.Call, arguments: Sequence[Value]) -> _Minors:
    rows, span = rows_of(arguments[0]), node.arguments[0].span
    if not rows or len(rows) != len(rows[0]):
        raise Wrong(
            WrongType(span, "A square matrix", sort_of(arguments[0]), "Write it row by row: `[[1, 2], [3, 4]]`.")
        )
    if len(rows) > LARGEST_INVERSE:
        hint = "`solve A*x = b for x = …`, with a list as guess, is solved in the run, of any size."
        what = f"A matrix of {LARGEST_INVERSE} by {LARGEST_INVERSE} at most"
        raise Wrong(WrongType(span, what, sort_of(arguments[0]), hint))
    return _Minors(node, rows)


def _inverse(node: tree.Call, arguments: Sequence[Value]) -> Value:
    minors = _square(node, arguments)
    whole = minors.determinant()
    return each(lambda part: times(part, whole, -1), minors.adjugate()) if whole.expression != ZERO else minors.rows


def _solve(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """Cramer's rule: the adjugate times the right side, over the determinant."""
    minors, (_, right) = _square(node, arguments), arguments
    count = len(rows_of(right)) or shape_of(right)[0]
    if count != len(minors.rows):
        what = f"A list of {len(minors.rows)}, or a matrix of so many rows"
        raise Wrong(WrongType(node.arguments[1].span, what, sort_of(right), f"Write `{VECTORS['solve'][1]}`."))
    whole = minors.determinant()
    if whole.expression == ZERO:
        return right
    spans = node.arguments[0].span, node.arguments[1].span
    return each(lambda part: times(part, whole, -1), product(minors.adjugate(), right, spans))


# name -> (number of arguments, usage, builder)
VECTORS: dict[str, tuple[int, str, Builder]] = {
    "rotate": (2, "rotate((x, y), angle)", _rotate),
    "dot": (2, "dot(a, b)", _dot),
    "cross": (2, "cross(a, b)", _cross),
    "norm": (1, "norm(a)", _norm),
    "transpose": (1, "transpose(A)", _transpose),
    "det": (1, "det(A)", lambda node, arguments: _square(node, arguments).determinant()),
    "inverse": (1, "inverse(A)", _inverse),
    "solve": (2, "solve(A, b)", _solve),
    "identity": (1, "identity(3)", _identity),
    "rotation": (2, "rotation((0, 0, 1), angle)", _rotation),
    "skew": (1, "skew(r)", lambda node, arguments: _cross_matrix(_vector(node, arguments, 0, (3,)))),
}
