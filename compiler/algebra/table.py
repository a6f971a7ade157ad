"""Curves through points as expressions. Operands: order of the derivative, argument, places, values, slopes.

Places, values and slopes may be numbers or expressions of parameters; all are constant during a run.
"""

from __future__ import annotations

from collections.abc import Sequence

from . import interpolate
from .expression import ONE, ZERO, Apply, Expression, Number, call, divide, select

KINDS = ("linear", "cubic", "monotone")
_SLOPES = {"cubic": "natural_slope", "monotone": "monotone_slope"}
_LISTS = {"linear": 2, "cubic": 3, "monotone": 3, "inverse": 3}  # lists of one length behind the first two operands
_SMOOTH = {"linear": 1, "cubic": 3, "monotone": 3, "noise": 5}  # derivatives of a higher order are zero


def table(kind: str, x: Expression, places: Sequence[Expression], values: Sequence[Expression]) -> Expression:
    """Value at x of a curve through points: `linear`, `cubic` (natural spline) or `monotone`."""
    if kind == "linear":
        return call(kind, ZERO, x, *places, *values)
    return call(kind, ZERO, x, *places, *values, *_slopes(kind, places, values))


def sloped(x: Expression, places: Sequence[float], values: Sequence[float], slopes: Sequence[float]) -> Expression:
    """Value at x of a curve of cubics through points with slopes: one continuous derivative, as `monotone` has."""
    return call("monotone", ZERO, x, *(Number(float(v)) for part in (places, values, slopes) for v in part))


def chosen_slopes(node: Apply) -> tuple[Expression, ...] | None:
    """Slopes of a curve that do not follow from its points; None for any other."""
    places, values, *slopes = lists(node)
    if (
        node.operator != "monotone"
        or _numbers(slopes[0]) is None
        or [*slopes[0]] == _slopes("monotone", places, values)
    ):
        return None
    return slopes[0]


def _slopes(kind: str, places: Sequence[Expression], values: Sequence[Expression]) -> list[Expression]:
    """Slopes of a curve at its points, computed at once if the points are numbers."""
    xs, ys = _numbers(places), _numbers(values)
    if xs is not None and ys is not None:
        slopes = interpolate.natural_slopes if kind == "cubic" else interpolate.monotone_slopes
        return [Number(m) for m in slopes(xs, ys)]
    return [call(_SLOPES[kind], Number(float(i)), *places, *values) for i in range(len(places))]


def is_table(x: Expression) -> bool:
    """Return True for a curve through points."""
    return isinstance(x, Apply) and x.operator in _LISTS


def lists(node: Apply) -> tuple[tuple[Expression, ...], ...]:
    """Lists of a table: places, values and, except for straight lines, slopes."""
    count = _LISTS[node.operator]
    points = node.operands[2:]
    n = len(points) // count
    return tuple(points[i * n : (i + 1) * n] for i in range(count))


def order_of(node: Apply) -> int:
    """Order of the derivative of a curve or noise."""
    order = node.operands[0]
    assert isinstance(order, Number)
    return int(order.value)


def domain(node: Apply) -> tuple[Expression, ...]:
    """List in which the argument of a table is looked up."""
    return lists(node)[1 if node.operator == "inverse" else 0]


def curve_slope(node: Apply) -> Expression:
    """Derivative of a curve by its argument."""
    order, x, *rest = node.operands
    if node.operator == "inverse":
        slope = Apply("monotone", (ONE, node, *rest))
        return select(call("equal", slope, ZERO), ZERO, divide(ONE, slope))  # infinite there, like that of a root
    assert isinstance(order, Number)
    if order.value >= _SMOOTH[node.operator]:
        return ZERO
    return call(node.operator, Number(order.value + 1), x, *rest)


def counted(node: Apply, x: Expression) -> Expression:
    """An argument of a curve, counted from point to point: 0 at the first, 1 at the second."""
    places = domain(node)
    return table("linear", x, places, [Number(float(i)) for i in range(len(places))])


def jumps_at_knots(node: Apply) -> bool:
    """Return True for a derivative of a curve that jumps at its points."""
    order = node.operands[0]
    return isinstance(order, Number) and order.value >= {"linear": 1, "cubic": 3, "monotone": 2}.get(node.operator, 9)


def last_derivative(node: Apply) -> Apply:
    """Derivative of a curve that is constant between its points."""
    return Apply(node.operator, (Number(float(_SMOOTH[node.operator])), *node.operands[1:]))


def is_stepped(x: Expression) -> bool:
    """Return True for a derivative of a curve that is constant between its points."""
    return isinstance(x, Apply) and x.operator in KINDS and x == last_derivative(x)


def turned_round(node: Apply, y: Expression) -> Expression | None:
    """Inverse of the curve at the value y; None if its numbers show that it is not unique.

    Points that are parameters are checked when their values are known, before the program is made.
    """
    if node.operands[0] != ZERO or node.operator == "inverse":
        return None
    places, values, *slopes = (_numbers(part) for part in lists(node))
    if values is not None and not interpolate.one_way(values):
        return None
    if node.operator == "linear":
        here, there = lists(node)
        return call("linear", ZERO, y, *there, *here)
    if (node.operator == "cubic" or chosen_slopes(node) is not None) and (
        places is None or values is None or slopes[0] is None or interpolate.turns(places, values, slopes[0])
    ):
        return None
    return call("inverse", ZERO, y, *node.operands[2:])


def _numbers(part: Sequence[Expression]) -> tuple[float, ...] | None:
    found = tuple(x.value for x in part if isinstance(x, Number))
    return found if len(found) == len(part) else None


def noise(place: Expression, seed: Expression) -> Expression:
    """A random number at each integer `place`, joined smoothly."""
    return call("noise", ZERO, place, seed)
