"""Roots that end or turn at zero as unknowns of a step: u with `h - u*abs(u) = 0` in the place of `sign(h)*sqrt(abs(h))`.

A root is infinitely steep at zero, so Newton's corrections are nothing there wherever the solution is. The power that it inverts has slopes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from ..algebra.expression import Expression, Number, Symbol, call, multiply, negate, power, symbols
from ..algebra.formula import Formula, bind
from ..algebra.odd_roots import with_unknown_roots
from ..equations.system import Assignment, EquationSystem, Variable
from .order import needed

GIVEN = frozenset({"parameter", "input", "time", "delayed", "mode"})


def with_roots_as_unknowns(system: EquationSystem) -> EquationSystem:
    """Return the equations with an unknown for each root of what states move; the same object if there is none."""
    rooted = [a for a in system.assignments if _has_root(a.formula)]
    if not rooted:
        return system
    variables, assignments = system.variables, {a.target: a for a in system.assignments}
    inputs = [assignments[v].read if v in assignments else () for v in range(len(variables))]
    roots: dict[tuple[Expression, float], Symbol] = {}
    owners: list[Assignment] = []

    def unknown(h: Expression, share: float) -> Expression | None:
        behind = needed([v for s in symbols(h) if isinstance(v := s.key, int)], inputs)
        if all(v in assignments or variables[v].role in GIVEN for v in behind):
            return None
        opposite = roots.get((negate(h), share))
        return negate(opposite) if opposite else roots.setdefault((h, share), Symbol(len(variables) + len(roots)))

    for a in rooted:
        bound = bind(with_unknown_roots(a.expression, unknown))
        owners += [a] * (len(roots) - len(owners))
        if len(roots):
            assignments[a.target] = replace(a, formula=bound.formula, arguments=bound.arguments, residual=None)
    for a, ((h, share), u) in zip(owners, roots.items(), strict=True):
        bound = bind(h - multiply(u, power(call("abs", u), Number(1.0 / share - 1.0))))
        target = len(variables) + len(assignments) - len(system.assignments)
        assignments[target] = Assignment(target, bound.formula, bound.arguments, a.span, a.owner, implicit=True)
    if not roots:
        return system
    named = (Variable(f"root in {variables[a.target].name}", "computed") for a in owners)
    return replace(system, variables=(*variables, *named), assignments=tuple(assignments.values()))


@lru_cache(maxsize=4096)
def _has_root(formula: Formula) -> bool:
    """Return True if a law has a root of a magnitude."""
    shares: list[float] = []
    with_unknown_roots(formula.expression, lambda _, share: shares.append(share))
    return bool(shares)
