"""Rates of angles where cycles are counted: 10 rad/s is no 10 Hz, though both are 1/s."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...graph.network import Reading
from ...syntax import tree
from ..expressions.scales import check_cycles, counts_radians
from ..names.errors import DimensionMismatch
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong

if TYPE_CHECKING:
    from .resolver import Resolver

MOST_NAMES = 20  # names that stand for each other


def counts_angle(resolver: Resolver, expression: object, scope: Scope, most: int = MOST_NAMES) -> bool:
    """Return True for the rate of an angle: by its unit, the unit that a name is declared or given in, or as the flow of a rotation."""
    match expression:
        case tree.Literal(unit=tree.Unit() as unit):
            return counts_radians(unit.span.text)
        case tree.Negative(operand=operand):
            return counts_angle(resolver, operand, scope, most)
        case tree.Sum(terms=terms):
            return any(counts_angle(resolver, term, scope, most) for _, term in terms)
        case tree.PathSyntax():
            entry = resolver.lookup(expression, scope)
            if not isinstance(entry, Scalar):
                return False
            if isinstance(entry.reference, Reading):
                at = entry.reference
                return at.variable == "f" and resolver.port_domain(at.node, at.port).name == "rotation"
            own = next((p for p in resolver.pending if p.name == entry.name), None)
            if own is None or own.item.unit is None:
                return own is not None and most > 0 and counts_angle(resolver, own.value, own.scope, most - 1)
            return counts_radians(own.item.unit.span.text)
    return False


def refuse_rates_of_angles(resolver: Resolver, scope: Scope, *frequencies: tree.ExpressionSyntax) -> None:
    """Raise `Wrong` if one of some frequencies, which count cycles, is the rate of an angle."""
    check_cycles(*frequencies)
    for node in frequencies:
        if counts_angle(resolver, node, scope):
            what = f"A frequency counts cycles here, and `{node.span.text}` an angle"
            raise Wrong(DimensionMismatch(node.span, what, f"Write `{in_cycles(node)}`."))


def in_cycles(rate: tree.ExpressionSyntax) -> str:
    """Return the rate of an angle as a frequency, as text."""
    words = rate.span.text
    return f"({words})/(2*pi)" if isinstance(rate, tree.Sum) and not words.startswith("(") else f"{words}/(2*pi)"
