"""A law in the direction that causality asks for: solved once per law and direction, then shared by all its elements."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from ..algebra.affine import affine_parts, solve_affine
from ..algebra.derivative import derivative
from ..algebra.expression import ONE, ZERO, Expression, Symbol, depends_on, divide, negate, substitute
from ..algebra.invert import solve_nonlinear
from ..graph.network import Kind, Law, Own


@lru_cache(maxsize=4096)
def solved(law: Law, wanted: tuple[Own, ...]) -> tuple[Expression, ...] | None:
    """Each wanted own variable as an expression of the others; None if the law cannot be solved for them.

    Explicit equations are taken as they are, affine ones are solved, others are inverted where they have one inverse.
    """
    if law.energy is not None:
        if all(w.variable in "ef" for w in wanted):  # efforts by displacements, flows by momenta
            stored = {"e": "q", "f": "p"}
            return tuple(derivative(law.energy, Symbol(Own(w.port, stored[w.variable]))) for w in wanted)
        if len(wanted) != 1:
            return None
        slope = derivative(law.energy, Symbol(Own(0, wanted[0].variable)))
        given = Symbol(Own(0, "e" if wanted[0].variable == "q" else "f"))
        return _one(((given, slope),), wanted[0])
    if len(wanted) == 1 and len(law.equations) == 1:
        return _one(law.equations, wanted[0])
    return _several(law, wanted)


def _one(equations: tuple[tuple[Expression, Expression], ...], wanted: Own) -> tuple[Expression, ...] | None:
    ((left, right),) = equations
    found = solve_affine(left, right, Symbol(wanted))
    if found is None:
        found = solve_nonlinear(left, right, Symbol(wanted))
    return None if found is None else (found,)


def _several(law: Law, wanted: tuple[Own, ...]) -> tuple[Expression, ...] | None:
    """Elimination: each equation gives one wanted variable, put into the others."""
    unknown = [Symbol(w) for w in wanted]
    equations = list(law.equations)
    result: dict[Symbol, Expression] = {}
    for symbol in list(unknown):  # explicit ones first: they stay as written
        for equation in equations:
            left, right = equation
            if left == symbol and not any(depends_on(right, u) for u in unknown):
                result[symbol] = right
                equations.remove(equation)
                break
    rest = [s for s in unknown if s not in result]
    while rest:
        pivot = _pivot(equations, rest, result)
        if pivot is None:
            return None
        symbol, expression, equation = pivot
        equations.remove(equation)
        rest.remove(symbol)
        one = {symbol: expression}
        result = {s: _put(x, one) for s, x in result.items()} | one
        equations = [(_put(a, one), _put(b, one)) for a, b in equations]
    if any(depends_on(x, u) for x in result.values() for u in unknown):
        return None
    return tuple(result[s] for s in unknown)


def _put(x: Expression, known: Mapping[Symbol, Expression]) -> Expression:
    return substitute(x, lambda symbol: known.get(symbol, symbol))


def _pivot(
    equations: list[tuple[Expression, Expression]], rest: list[Symbol], known: dict[Symbol, Expression]
) -> tuple[Symbol, Expression, tuple[Expression, Expression]] | None:
    for equation in equations:
        put = (_put(equation[0], known), _put(equation[1], known))
        for symbol in rest:
            found = solve_affine(*put, symbol)
            if found is not None:
                return symbol, found, equation
    return None


@lru_cache(maxsize=4096)
def ratio(law: Law, kind: Kind) -> Expression:
    """The ratio n of a transformer (e1 = n e2, f2 = n f1) or k of a gyrator (e1 = k f2, e2 = k f1).

    From one equation; power continuity e1 f1 = e2 f2 gives the other (Karnopp et al., section 4.3).
    """
    ((left, right),) = law.equations
    rest = left - right

    def slope(own: Own) -> Expression:
        parts = affine_parts(rest, Symbol(own))
        assert parts is not None
        return parts[0]

    a, b = (slope(Own(0, "e")), slope(Own(1, "e" if kind is Kind.TRANSFORMER else "f")))
    if a != ZERO:
        return _quotient(b, a)
    if kind is Kind.TRANSFORMER:  # a f1 + b f2 = 0: f2 = -(a/b) f1 = n f1
        return _quotient(slope(Own(0, "f")), slope(Own(1, "f")))
    return _quotient(slope(Own(0, "f")), slope(Own(1, "e")))


def _quotient(top: Expression, bottom: Expression) -> Expression:
    """-top/bottom."""
    if bottom == ONE:
        return negate(top)
    if bottom == negate(ONE):
        return top
    return negate(divide(top, bottom))
