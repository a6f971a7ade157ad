"""Functions of lists: products, length and rotation of vectors, as formulas of their components."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...algebra.expression import add, call, negate
from ...graph.units import ONE, Dimension
from ...syntax import tree
from ..names.errors import DimensionMismatch, WrongArguments, WrongType
from ..names.statement_errors import Wrong, describe
from .template import Typed, Value, bare_number, times

Vector = tuple[Typed, ...]
Builder = Callable[[tree.Call, Sequence[Value]], Value]


def compile_vector(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """A call of one of the functions in `VECTORS`. Raises `Wrong`."""
    count, usage, build = VECTORS[node.function]
    if len(arguments) != count:
        words = f"{count} argument{'s' * (count != 1)}"
        raise Wrong(WrongArguments(node.span, node.function, words, len(arguments), usage))
    return build(node, arguments)


def _vector(node: tree.Call, arguments: Sequence[Value], number: int, lengths: Sequence[int] = ()) -> Vector:
    """An argument that is a list, of one of these lengths if there are any."""
    value, span = arguments[number], node.arguments[number].span
    words = "A vector" if not lengths else f"A vector of {' or '.join(map(str, lengths))} components"
    if not isinstance(value, tuple):
        raise Wrong(WrongType(span, words, "a single number", f"A vector is a list: `{VECTORS[node.function][1]}`."))
    if lengths and len(value) not in lengths:
        raise Wrong(WrongType(span, words, f"a list of {len(value)}", f"Write `{VECTORS[node.function][1]}`."))
    return value


def _unit(node: tree.Call, parts: Sequence[Typed], what: str) -> Dimension | None:
    """The unit that all parts share; None if all are bare zeros. Raises `Wrong`."""
    units = list(dict.fromkeys(part.dimension for part in parts if part.dimension is not None))
    if len(units) > 1:
        words = (
            f"`{node.function}` takes {what} of one unit, but one is {describe(units[0])} and one {describe(units[1])}"
        )
        raise Wrong(DimensionMismatch(node.span, words, "Look at the units of the components, one by one."))
    return units[0] if units else None


def _sum(node: tree.Call, terms: Sequence[Typed]) -> Typed:
    return Typed(add(*(t.expression for t in terms)), _unit(node, terms, "products"))


def _less(node: tree.Call, first: Typed, second: Typed) -> Typed:
    return _sum(node, (first, Typed(negate(second.expression), second.dimension)))


def _dot(node: tree.Call, arguments: Sequence[Value]) -> Typed:
    a = _vector(node, arguments, 0)
    b = _vector(node, arguments, 1, (len(a),))
    return _sum(node, [times(x, y, 1) for x, y in zip(a, b, strict=True)])


def _cross(node: tree.Call, arguments: Sequence[Value]) -> Value:
    """In the plane the one component that a vector product has, out of the plane."""
    a = _vector(node, arguments, 0, (2, 3))
    b = _vector(node, arguments, 1, (len(a),))

    def component(i: int, j: int) -> Typed:
        return _less(node, times(a[i], b[j], 1), times(a[j], b[i], 1))

    return component(0, 1) if len(a) == 2 else (component(1, 2), component(2, 0), component(0, 1))


def _norm(node: tree.Call, arguments: Sequence[Value]) -> Typed:
    a = _vector(node, arguments, 0)
    unit = _unit(node, a, "components")
    square = _sum(node, [times(x, x, 1) for x in a])
    return Typed(call("sqrt", square.expression), unit)


def _rotate(node: tree.Call, arguments: Sequence[Value]) -> Value:
    point, angle = arguments
    if not isinstance(point, tuple) or len(point) != 2:
        raise Wrong(WrongType(node.arguments[0].span, "A point (x, y)", "something else"))
    x, y = point
    if not isinstance(angle, Typed) or angle.truth or angle.choices:
        raise Wrong(WrongType(node.arguments[1].span, "An angle", "no number", "Write `rotate((x, y), 30 deg)`."))
    bare_number(angle, node.arguments[1], "The angle")
    c, s = (Typed(call(name, angle.expression), ONE) for name in ("cos", "sin"))
    return _less(node, times(x, c, 1), times(y, s, 1)), _sum(node, (times(x, s, 1), times(y, c, 1)))


# name -> (number of arguments, usage, builder)
VECTORS: dict[str, tuple[int, str, Builder]] = {
    "rotate": (2, "rotate((x, y), angle)", _rotate),
    "dot": (2, "dot(a, b)", _dot),
    "cross": (2, "cross(a, b)", _cross),
    "norm": (1, "norm(a)", _norm),
}
