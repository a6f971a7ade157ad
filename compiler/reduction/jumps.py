"""Jumps of what is differentiated: the operations of a formula that may jump, without those that surely join."""

from __future__ import annotations

from functools import lru_cache
from math import isclose
from random import Random

from ..algebra.affine import solve_affine
from ..algebra.expression import ONE, ZERO, Apply, Expression, Number, Symbol, evaluate, operations, symbols
from ..algebra.operators import CURVES
from ..algebra.table import domain, jumps_at_knots, order_of

DRAWS = 6  # random values of all symbols at which both sides of a condition are compared
EQUAL = 1e-11  # relative difference
SMOOTH_NOISE = 2  # continuous derivatives of a noise
COMPARISONS = ("less", "less_equal")
STAIRS = ("sign", "floor", "ceil")


@lru_cache(maxsize=4096)
def jumps_of(x: Expression, moving: frozenset[Symbol]) -> tuple[Apply, ...]:
    """Signs, whole numbers, choices and bends of tables, differentiated already, of an expression that move and may jump.

    A choice or sign joins where both sides have one value at its threshold, which is compared at random values of all symbols.
    """
    nodes = [n for n in operations(x) if n.operator in (*STAIRS, "select", *COMPARISONS) and _moves(n, moving)]
    inside = {n.operands[0] for n in nodes if n.operator == "select"}
    bends = (n for n in operations(x) if n.operator in CURVES and _moves(n, moving) and is_bend(n))
    return (*bends, *(n for n in nodes if not (n in inside or _joins(x, n, moving))))


def is_bend(node: Apply) -> bool:
    """Return True for a derivative of a table or noise that jumps at its points."""
    if node.operator == "noise":
        return order_of(node) > SMOOTH_NOISE
    return jumps_at_knots(node) and len(domain(node)) > 2


def surely(node: Apply) -> bool:
    """Return True for a jump that no value of a parameter removes: a whole number, or a choice between two numbers."""
    if node.operator == "select":
        one, other = node.operands[1:]
        return isinstance(one, Number) and isinstance(other, Number) and one != other
    return node.operator in STAIRS or node.operator in CURVES


def _moves(node: Apply, moving: frozenset[Symbol]) -> bool:
    part = node.operands[0] if node.operator == "select" else node
    return not moving.isdisjoint(symbols(part))


def _joins(x: Expression, node: Apply, moving: frozenset[Symbol]) -> bool:
    """Return True if the expression has one value on both sides of the threshold of a sign or a simple choice."""
    condition = node.operands[0] if node.operator == "select" else node
    sides: tuple[Expression, ...]
    ends: tuple[Expression, Expression]
    if node.operator == "sign":
        ends, sides = (node.operands[0], ZERO), (ONE, Number(-1.0))
    elif isinstance(condition, Apply) and condition.operator in COMPARISONS and node.operator == "select":
        ends, sides = (condition.operands[0], condition.operands[1]), node.operands[1:]
    else:
        return False
    for symbol in symbols(ends[0] - ends[1]):
        place = solve_affine(*ends, symbol) if symbol in moving else None
        if place is not None:
            return all(_alike(_with(x, node, sides), symbol, place, draw) for draw in range(DRAWS))
    return False


def _with(x: Expression, node: Apply, sides: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """The expression with each of some others in the place of one of its operations."""

    def put(y: Expression, side: Expression) -> Expression:
        if y == node:
            return side
        return Apply(y.operator, tuple(put(o, side) for o in y.operands)) if isinstance(y, Apply) else y

    return tuple(put(x, side) for side in sides)


def _alike(sides: tuple[Expression, ...], symbol: Symbol, place: Expression, draw: int) -> bool:
    """Return True if both sides have one value where a symbol is at its place, at one draw of all others."""
    choose = Random(draw)
    values = {s.key: choose.uniform(0.3, 3.0) * choose.choice((-1.0, 1.0)) for x in sides for s in symbols(x)}
    try:
        values[symbol.key] = evaluate(place, lambda key: values.setdefault(key, choose.uniform(0.3, 3.0)))
        one, other = (evaluate(side, values.__getitem__) for side in sides)
    except (ArithmeticError, ValueError):
        return False
    return isclose(one, other, rel_tol=EQUAL, abs_tol=EQUAL * max(map(abs, values.values())))
