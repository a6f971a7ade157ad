"""Cancellation of terms of a sum that are the same product of the same quantities, reached by two paths.

A gyrator between two junctions of one flow gives back the power that it takes: the remaining effort is zero for every flow. With these
terms, the sum seems to depend on the flow, and a storage behind it on its own derivatives without end. Only in that case such
terms are searched for: a loop in which they cancel has no solution, which is reported while they are present.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..algebra.expression import Apply, Expression, Number, Symbol, add
from ..algebra.formula import bind
from ..equations.system import Assignment, EquationSystem

ROUNDING = 5e-15  # of coefficients that are products of numbers
LONGEST = 12  # factors of a product; one of more is left as it is

# A number, and the powers of variables and of other factors.
Product = tuple[float, frozenset[tuple[Expression, int]]]


def without_what_cancels(system: EquationSystem) -> EquationSystem | None:
    """Return the same equations without the terms that cancel; None if there are none."""
    products = _products(system.assignments)
    changed = {a.target: left for a in system.assignments if (left := _left(a, products)) is not None}
    if not changed:
        return None
    return replace(system, assignments=tuple(changed.get(a.target, a) for a in system.assignments))


def _left(assignment: Assignment, products: Mapping[int, Product]) -> Assignment | None:
    """The assignment without the terms of its sum that cancel; None if it is no sum, or nothing cancels."""
    expression = assignment.expression
    if not (isinstance(expression, Apply) and expression.operator == "add"):
        return None
    groups: dict[object, list[tuple[float, Expression]]] = {}
    for number, term in enumerate(expression.operands):
        product = _product(term)
        found = None if product is None else _opened(product, products)
        value, key = (1.0, number) if found is None else found
        groups.setdefault(key, []).append((value, term))
    gone = [g for g in groups.values() if abs(sum(v for v, _ in g)) <= ROUNDING * sum(abs(v) for v, _ in g)]
    if not gone:
        return None
    dropped = {id(term) for group in gone for _, term in group}
    bound = bind(add(*(term for term in expression.operands if id(term) not in dropped)))
    return replace(assignment, formula=bound.formula, arguments=tuple(bound.arguments))


def _products(assignments: Sequence[Assignment]) -> dict[int, Product]:
    """Variables whose assignment is only a product."""
    found = {}
    for assignment in assignments:
        if not assignment.implicit:
            product = _product(assignment.expression)
            if product is not None:
                found[assignment.target] = product
    return found


def _product(x: Expression) -> Product | None:
    """An expression as a product of powers; None if the product is too long."""
    if isinstance(x, Number):
        return x.value, frozenset()
    if not (isinstance(x, Apply) and x.operator in ("multiply", "divide")):
        return 1.0, frozenset({(x, 1)})
    parts = [_product(o) for o in x.operands]
    result: Product | None = (1.0, frozenset())
    for position, part in enumerate(parts):
        sign = -1 if x.operator == "divide" and position else 1
        if part is None or result is None or (sign < 0 and part[0] == 0.0):
            return None
        result = _times(result, part, sign)
    return result


def _times(a: Product, b: Product, power: int) -> Product | None:
    """Product of a and a power of b."""
    powers = dict(a[1])
    for factor, of_it in b[1]:
        powers[factor] = powers.get(factor, 0) + power * of_it
    if len(powers) > LONGEST:
        return None
    value = a[0] * b[0] ** power
    return value, frozenset((x, p) for x, p in powers.items() if p)


def _opened(product: Product, products: Mapping[int, Product]) -> Product | None:
    """A product with all products in it opened; None if that does not end."""
    result: Product | None = product
    for _ in range(LONGEST):
        assert result is not None
        inner = next(((x, p) for x, p in result[1] if isinstance(x, Symbol) and x.key in products), None)
        if inner is None:
            return result
        (variable, power), rest = inner, (result[0], result[1] - {inner})
        opened = products[variable.key]
        if opened[0] == 0.0:
            return None
        result = _times(rest, opened, power)
        if result is None:
            return None
    return None
