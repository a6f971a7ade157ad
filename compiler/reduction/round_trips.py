"""Terms of a residual that return through the sums of junctions and cancel: a current that circulates between two nodes of a loop.

Without this they are subtracted as numbers. The remainder is the rounding of a current that may be 1e10 times as large as those that
determine the node (a diode that blocks beside a capacitor and its load), and no iteration converges.

So are constants of laws, I exp(u/U) - I, which in the sum of several currents cancel: the rest alone tells how diodes that block share a voltage, and it is
below the rounding of I.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from ..algebra.expression import Apply, Expression, Number, Symbol, add, multiply, symbols

ROUNDING = 5e-15  # of coefficients that are products of numbers
LARGEST = 64  # terms of an opened sum

Terms = dict[Expression, float]


class Sums:
    """Computed members of a loop, opened on demand if they are sums with numbers as coefficients; `members`: all of it, if laws are opened, too."""

    def __init__(self, expressions: Mapping[object, Expression], members: Collection[object] = ()) -> None:
        self.expressions, self.members = expressions, members
        self.opened: dict[object, Terms | None] = {}

    def terms(self, variable: object) -> Terms | None:
        """Coefficients of a member over terms that are no such sums; None if the member is no such sum, or too long."""
        if variable not in self.opened:
            self.opened[variable] = None
            expression = self.expressions.get(variable)
            if expression is not None and (_is_sum(expression) or has_constant(expression, self.members)):
                terms, _ = self.open(expression)
                self.opened[variable] = terms if len(terms) <= LARGEST else None
        return self.opened[variable]

    def open(self, expression: Expression) -> tuple[Terms, bool]:
        """Coefficients of a sum, and True if some of its terms cancelled."""
        total: Terms = {}
        sizes: Terms = {}
        for term in _added(expression):
            value, factor = _scaled(term)
            inner = self.terms(factor.key) if isinstance(factor, Symbol) else None
            for part, share in ({factor: 1.0} if inner is None else inner).items():
                total[part] = total.get(part, 0.0) + value * share
                sizes[part] = sizes.get(part, 0.0) + abs(value * share)
        left = {part: value for part, value in total.items() if abs(value) > ROUNDING * sizes[part]}
        return left, len(left) < len(total)


def without_round_trips(residual: Expression, sums: Sums) -> Expression:
    """The residual without the terms that cancel; unchanged if none do."""
    if not _is_sum(residual):
        return residual
    terms, cancelled = sums.open(residual)
    return add(*(multiply(Number(value), part) for part, value in terms.items())) if cancelled and terms else residual


def without_constants(residual: Expression, sums: Sums) -> Expression | None:
    """The residual with its laws opened, if nothing that is given beside the loop is left of it; else None."""
    terms, cancelled = sums.open(residual)
    if not cancelled or any(_is_given(part, sums.members) for part in terms):
        return None
    return add(*(multiply(Number(value), part) for part, value in terms.items()))


def has_constant(x: Expression, members: Collection[object]) -> bool:
    """Return True for a sum of something given and something that is not linear in the members."""
    parts = [_scaled(term)[1] for term in _added(x)]
    rest = [part for part in parts if not _is_given(part, members)]
    return len(rest) < len(parts) and any(not isinstance(part, Symbol) for part in rest)


def _is_given(x: Expression, members: Collection[object]) -> bool:
    return all(s.key not in members for s in symbols(x))


def _added(x: Expression) -> tuple[Expression, ...]:
    """Terms of a sum, or of its product with a number or variable; for any other expression, the expression alone."""
    match x:
        case Apply(
            operator="multiply", operands=(Number() | Symbol() as factor, Apply(operator="add", operands=terms))
        ):
            return tuple(multiply(factor, term) for term in terms)
    return x.operands if isinstance(x, Apply) and x.operator == "add" else (x,)


def _is_sum(x: Expression) -> bool:
    """Return True for a sum, or a variable with a number as factor."""
    return len(_added(x)) > 1 or isinstance(_scaled(x)[1], Symbol)


def _scaled(term: Expression) -> tuple[float, Expression]:
    """A term as a number times the rest."""
    match term:
        case Number(value):
            return value, Number(1.0)
        case Apply(operator="multiply", operands=(Number(value), rest)):
            return value, rest
    return 1.0, term
