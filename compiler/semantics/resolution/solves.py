"""`solve EQUATIONS for UNKNOWNS`: the unknowns make the equations true. They are read when all names are known."""

from __future__ import annotations

from dataclasses import replace

from ...algebra.expression import Apply, Expression, Number, divide, multiply
from ...algebra.formula import Bound, Formula
from ...graph.network import Quantity, quantities_in
from ...source import Span
from ...syntax import tree
from ..expressions.lists import parts_of
from ..names.errors import DimensionMismatch, WrongLaw
from ..names.scope import Items, Pending, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, unit_hint
from .quantities import QuantityResolver


def read_solves(resolver: QuantityResolver) -> None:
    """Read the equations of each `solve`. Errors are collected."""
    differences: dict[int, tree.Sum] = {}  # of the sides of an equation: one node for all instances, as templates are
    for scope, statement, unknowns in resolver.solves:
        for e in statement.equations:
            depth = max(e.left.depth, e.right.depth) + 1
            differences.setdefault(id(e), tree.Sum(e.span, depth, ((1, e.left), (-1, e.right))))
        resolver.guard(_read, resolver, scope, statement, unknowns, differences)


def _read(
    resolver: QuantityResolver, scope: Scope, statement: tree.Quantities, unknowns: tuple[Pending, ...], differences: dict[int, tree.Sum]
) -> None:  # fmt: skip
    entered = [resolver.quantity(pending) for pending in unknowns]
    names = [s.name for e in entered for s in (e.items if isinstance(e, Items) else (e,))]
    zeros = list[Bound]()
    for equation in statement.equations:
        _check_sides(resolver, equation, scope)
        template = resolver.template(differences[id(equation)], scope)
        zeros += [resolver.bind(template, formula, scope) for formula in template.formulas]
    if len(zeros) != len(names):
        many = (f"{n} {word}{'s' * (n != 1)}" for n, word in ((len(zeros), "equation"), (len(names), "unknown")))
        hint = "Each number that is looked for needs one equation; one between lists counts for each item."
        raise Wrong(WrongLaw(statement.span, f"`solve` has {' for '.join(many)}", hint))
    for name, zero in zip(names, zeros, strict=True):
        named, formula = (
            resolver.quantities[name],
            Formula(zero.formula.arity + len(names), _once(zero.formula.expression)),
        )
        definition = Bound(formula, (*zero.arguments, *map(Quantity, names)))  # they depend on each other: one loop
        guess = None if named.definition is None else _guess(resolver, named.definition, named.span)
        resolver.quantities[name] = replace(named, definition=definition, guess=guess)


def _once(x: Expression) -> Expression:
    """Return a product that is zero where x is, with each factor once: a solution of several orders, as z = a of (z - a)^3*(z + 2), has no slope."""
    match x:
        case Apply(operator="multiply", operands=factors):
            return multiply(*dict.fromkeys(map(_once, factors)))
        case Apply(operator="divide", operands=(above, below)):
            return divide(_once(above), below)
        case Apply(operator="power", operands=(base, Number(n))) if n > 1 and n == int(n):
            return _once(base)
        case Apply(operator="abs", operands=(base,)):
            return _once(base)
    return x


def _check_sides(resolver: QuantityResolver, equation: tree.Equation, scope: Scope) -> None:
    """Raise `Wrong` for sides of two dimensions."""
    left, right = (resolver.template(side, scope).value for side in (equation.left, equation.right))
    for a, b in zip(parts_of(left), parts_of(right), strict=False):
        if None not in (a.dimension, b.dimension) and a.dimension != b.dimension:
            sides = f"`{equation.left.span.text}` is {describe(a.dimension)}, but `{equation.right.span.text}` is {describe(b.dimension)}"
            hint = unit_hint(b.dimension, a.dimension, equation.right)
            raise Wrong(DimensionMismatch(equation.span, f"The two sides differ: {sides}", hint))


def _guess(resolver: QuantityResolver, bound: Bound, span: Span) -> float:
    """Value of a guess, for which a program is made."""
    resolver.structural |= quantities_in(bound)
    value = resolver.value_of(bound, span)
    if value is None:
        resolver.need_no_values()
        raise AlreadyTold
    return value
