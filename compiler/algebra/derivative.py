"""Derivatives with our own rules: one-sided at kinks (from the right), no distributions, finite wherever the value is finite.

abs' = +-1, sign' = floor' = 0, sqrt' at 0 is taken as 0 (its one-sided limit is infinite and would turn 0*inf into NaN).
"""

from __future__ import annotations

from collections.abc import Callable

from .expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    apply,
    call,
    lift,
    multiply,
    negate,
    power,
    select,
)
from .operators import CONDITIONS, CURVES, OPERATORS
from .systems import entries_of, with_rights
from .table import curve_slope


class NotDifferentiable(Exception):
    """A derivative by the points of a table or a random number's seed, which are constant in a run."""


def derivative(x: Expression, symbol: Symbol, known: dict[Expression, Expression] | None = None) -> Expression:
    """Partial derivative of x by a symbol. `known`: derivatives by it of other expressions, for what they share; added to."""
    known = {} if known is None else known

    def walk(node: Expression) -> Expression:
        if isinstance(node, Number):
            return ZERO
        if isinstance(node, Symbol):
            return ONE if node == symbol else ZERO
        found = known.get(node)
        if found is None:
            assert isinstance(node, Apply)
            found = _chain(node, walk)
            known[node] = found
        return found

    return walk(x)


def _chain(node: Apply, inner: Callable[[Expression], Expression]) -> Expression:
    operands = node.operands
    if node.operator == "add":
        return add(*map(inner, operands))
    if node.operator == "multiply":
        terms = []
        for i, factor in enumerate(operands):
            slope = inner(factor)
            if slope != ZERO:
                terms.append(multiply(*operands[:i], slope, *operands[i + 1 :]))
        return add(*terms)
    if node.operator == "select":
        return select(operands[0], inner(operands[1]), inner(operands[2]))
    if node.operator in CONDITIONS:
        return ZERO
    if node.operator == "item":
        return _of_solution(node, inner)
    terms = []
    for i, operand in enumerate(operands):
        slope = inner(operand)
        if slope != ZERO:
            terms.append(multiply(partial(node, i), slope))
    return add(*terms)


def _of_solution(node: Apply, inner: Callable[[Expression], Expression]) -> Expression:
    """Derivative of an unknown of a linear system: A t = r, so A dt = dr - dA t."""
    system, number = node.operands
    assert isinstance(system, Apply)
    rows, right = entries_of(system)
    targets = [Apply("item", (system, Number(float(i)))) for i in range(len(right))]
    rights = [
        add(inner(r), *(negate(multiply(inner(a), targets[j])) for j, a in row.items()))
        for r, row in zip(right, rows, strict=True)
    ]
    if all(r == ZERO for r in rights):
        return ZERO
    return Apply("item", (with_rights(system, rights), number))


def partial(node: Apply, i: int) -> Expression:
    """Partial derivative of an operator by its operand number i."""
    if node.operator == "power":
        return _power_slope(node, i)
    if node.operator in CURVES and i == 1:
        return curve_slope(node)
    row = OPERATORS[node.operator]
    if row.kind in ("curve", "slope"):
        raise NotDifferentiable(node.operator)
    return lift(row.partials[i](apply, node, *node.operands))


def _power_slope(node: Apply, i: int) -> Expression:
    base, exponent = node.operands
    if i == 0:
        slope = multiply(exponent, power(base, exponent - 1))
        if isinstance(exponent, Number) and 0 < exponent.value < 1:  # infinite at 0, like that of a root
            return select(call("equal", base, ZERO), ZERO, slope)
        return slope
    return multiply(node, call("log", base))
