"""Properties of laws for the choice of causality: invertibility, written form, and values known before the run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from ..algebra.affine import affine_parts
from ..algebra.expression import ZERO, Expression, Symbol, depends_on, evaluate
from ..graph.network import BondGraph, Element, Law, PortVariable, Quantity


def is_linear(node: Element) -> bool:
    """Return True if a one-port's law is linear, so that it holds in both directions."""
    return len(node.ports) == 1 and _is_linear(node.law)


@lru_cache(maxsize=4096)
def _is_linear(law: Law) -> bool:
    if len(law.equations) != 1:
        return False
    ((left, right),) = law.equations
    rest, involved = left - right, 0
    for variable in "efqp":
        symbol = Symbol(PortVariable(0, variable))
        if depends_on(rest, symbol):
            parts = affine_parts(rest, symbol)
            if parts is None or parts[0] == ZERO:
                return False
            involved, rest = involved + 1, parts[1]
    return involved == 2


@lru_cache(maxsize=4096)
def slopes(law: Law, first: PortVariable, second: PortVariable) -> tuple[Expression, Expression] | None:
    """Factors of two variables in the one equation of a law, left minus right; None if it is not linear in them."""
    if len(law.equations) != 1:
        return None
    ((left, right),) = law.equations
    one, other = (affine_parts(left - right, Symbol(own)) for own in (first, second))
    return None if one is None or other is None else (one[0], other[0])


def written_effort(node: Element, port: int) -> bool:
    """Return True if the law is written for the effort of a port, as in F = r*v."""
    for left, right in node.law.equations:
        for side, other in ((left, right), (right, left)):
            if (
                isinstance(side, Symbol)
                and isinstance(side.key, PortVariable)
                and side.key.port == port
                and not depends_on(other, side)
            ):
                return side.key.variable == "e"
    return True


def written_stored(node: Element) -> bool:
    """Return True if a storage's law is written for its stored quantity at every port, as in q = C*u."""
    sides = [pair for left, right in node.law.equations for pair in ((left, right), (right, left))]

    def alone(own: PortVariable) -> bool:
        return any(
            isinstance(side, Symbol) and side.key == own and not depends_on(other, Symbol(own)) for side, other in sides
        )

    return all(alone(PortVariable(port, stored)) for port, stored in enumerate(node.stored))


def wants_effort(node: Element, port: int, word: str) -> bool:
    """Return True if `prefer` or `require` of that word means that the element determines the effort of a port."""
    if word in ("effort", "flow"):
        return word == "effort"
    return (word == "integral") is (node.stored[port] == "q")


def has_start(graph: BondGraph, node: Element) -> bool:
    """Return True if the author gave a start other than zero."""
    bounds = [bound for _, bound in node.starts.values()]
    return any(value_before(graph, b.formula.expression, b.arguments) != 0.0 for b in bounds)


def value_before(graph: BondGraph, expression: Expression, arguments: Sequence[object]) -> float | None:
    """Value of an expression over numbered arguments, if all of them are known before the run; else None."""

    def lookup(key: object) -> float:
        argument: object = arguments[key] if isinstance(key, int) else None
        if isinstance(argument, Quantity):
            named = graph.quantities.get(argument.name)
            argument = None if named is None else named.value
        if not isinstance(argument, float | int):
            raise ValueError
        return argument

    try:
        return evaluate(expression, lookup)
    except (ArithmeticError, ValueError):
        return None
