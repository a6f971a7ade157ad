"""A law in the direction that causality needs: solved once per law and direction, then shared by all its elements."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from ..algebra.affine import affine_parts, solve_affine
from ..algebra.derivative import derivative
from ..algebra.domain import is_steep, is_total
from ..algebra.expression import (
    ONE,
    ZERO,
    Expression,
    Symbol,
    depends_on,
    divide,
    negate,
    operations,
    substitute,
    symbols,
)
from ..algebra.invert import solve_nonlinear
from ..graph.elements import Kind
from ..graph.network import Law, PortVariable

Equations = tuple[tuple[Expression, Expression], ...]
PRODUCTS = frozenset({"multiply", "divide", "power", "abs", "sign", "sqrt"})
STORED = {"e": "q", "f": "p"}  # variable that a storage gives -> its stored quantity
GIVEN = {"q": "e", "p": "f"}  # stored quantity -> variable that its law gives in integral form


@lru_cache(maxsize=4096)
def solved(law: Law, wanted: tuple[PortVariable, ...]) -> tuple[Expression, ...] | None:
    """Solve a law: each wanted variable as an expression of the others, or None if it cannot be solved for them.

    Explicit equations are taken as they are, affine ones are solved, others are inverted if the inverse is unique. Solving a
    field for the stored quantities of some ports is a Legendre transformation: its energy gives as many equations as it has
    ports, in every choice of known variables.
    """
    equations = equations_for(law, wanted)
    return _one(equations, wanted[0]) if len(wanted) == len(equations) == 1 else _several(equations, wanted)


@lru_cache(maxsize=4096)
def paired(law: Law, wanted: tuple[PortVariable, ...]) -> tuple[Expression, ...] | None:
    """For each wanted variable an expression that is zero and contains it; None if there are not enough of them.

    For laws that `solved` cannot solve: the run solves them by Newton's method. The pairing of equations and variables is a
    matching in a bipartite graph (Kuhn's augmenting paths).
    """
    rests = [left - right for left, right in equations_for(law, wanted)]
    choice: dict[int, int] = {}  # equation -> wanted

    def place(number: int, tried: set[int]) -> bool:
        for i, rest in enumerate(rests):
            if i not in tried and depends_on(rest, Symbol(wanted[number])):
                tried.add(i)
                if i not in choice or place(choice[i], tried):
                    choice[i] = number
                    return True
        return False

    if not all(place(number, set()) for number in range(len(wanted))):
        return None
    of = {number: rests[i] for i, number in choice.items()}
    return tuple(of[number] for number in range(len(wanted)))


@lru_cache(maxsize=4096)
def total_residual(law: Law, wanted: PortVariable, fixed: bool) -> Expression | None:
    """Residual of a law that is defined and has slopes everywhere, for a law whose solution for the wanted variable has gaps or an infinite slope.
    `fixed`: nothing but the variables of its ports changes in a run, and no parameter of it is zero.

    None if the solution itself is regular, or no form of the law is. A diode's voltage is a logarithm that ends at its saturation current; its
    current is defined for every voltage, and the author may have written either form. A cube root is steep at zero, the cube is not.
    """
    found = solved(law, (wanted,))
    if found is None or law.energy is not None:
        return None
    has_gaps = not is_total(found[0], _is_own)
    if not has_gaps and not is_steep(found[0], _is_own):
        return None
    others = {s.key for left, right in law.equations for s in (*symbols(left), *symbols(right)) if _is_own(s)}
    for other in sorted(others - {wanted}, key=lambda own: (own.port, own.variable)):
        turned = solved(law, (other,))
        if turned is not None and depends_on(turned[0], Symbol(wanted)) and _is_better(turned[0], has_gaps, fixed):
            return turned[0] - Symbol(other)
    return None


def _is_better(turned: Expression, has_gaps: bool, fixed: bool) -> bool:
    """Return True if a form is defined everywhere; in place of one that is steep it has slopes, and divides by nothing that may be zero: an opening."""
    if has_gaps:
        return is_total(turned, _is_own)
    plain = fixed and all(node.operator in PRODUCTS for node in operations(turned))  # a sum of parameters may be zero
    return is_total(turned, _is_own if plain else lambda symbol: True) and not is_steep(turned, _is_own)


def _is_own(symbol: Symbol) -> bool:
    return isinstance(symbol.key, PortVariable)


def equations_for(law: Law, wanted: tuple[PortVariable, ...]) -> Equations:
    """The law as equations. The partial derivatives of an energy are efforts of displacements and flows of momenta."""
    if law.energy is None:
        return law.equations
    stored = [PortVariable(w.port, STORED.get(w.variable, w.variable)) for w in wanted]
    return tuple((Symbol(PortVariable(s.port, GIVEN[s.variable])), derivative(law.energy, Symbol(s))) for s in stored)


def _one(equations: Equations, wanted: PortVariable) -> tuple[Expression, ...] | None:
    ((left, right),) = equations
    found = solve_affine(left, right, Symbol(wanted))
    if found is None:
        found = solve_nonlinear(left, right, Symbol(wanted))
    return None if found is None else (found,)


def _several(given: Equations, wanted: tuple[PortVariable, ...]) -> tuple[Expression, ...] | None:
    """Elimination: each equation gives one wanted variable, which is substituted into the others."""
    unknown = [Symbol(w) for w in wanted]
    equations = list(given)
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
    for solve in (solve_affine, solve_nonlinear):
        for equation in equations:
            put = (_put(equation[0], known), _put(equation[1], known))
            for symbol in rest:
                found = solve(*put, symbol)
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

    def slope(own: PortVariable) -> Expression:
        parts = affine_parts(rest, Symbol(own))
        assert parts is not None
        return parts[0]

    a, b = (slope(PortVariable(0, "e")), slope(PortVariable(1, "e" if kind is Kind.TRANSFORMER else "f")))
    if a != ZERO:
        return _quotient(b, a)
    if kind is Kind.TRANSFORMER:  # a f1 + b f2 = 0: f2 = -(a/b) f1 = n f1
        return _quotient(slope(PortVariable(0, "f")), slope(PortVariable(1, "f")))
    return _quotient(slope(PortVariable(0, "f")), slope(PortVariable(1, "e")))


def _quotient(top: Expression, bottom: Expression) -> Expression:
    """-top/bottom."""
    if bottom == ONE:
        return negate(top)
    if bottom == negate(ONE):
        return top
    return negate(divide(top, bottom))
