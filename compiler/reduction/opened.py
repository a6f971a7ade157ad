"""Laws of a nonlinear loop that relate two of its variables, one of them nonlinearly: when the loop is cut, both become unknowns.

The rest of the loop is then linear in its unknowns, except for one function of one variable in each of these rows. A solution from
far away needs this: along each law it can move by the one of its two variables that changes less.
"""

from __future__ import annotations

from collections.abc import Mapping, Set

from ..algebra.affine import affine_parts
from ..algebra.expression import ZERO, Expression, Symbol, depends_on, symbols
from ..equations.system import Assignment
from .state_space import OpenedLaw


def opened_laws(block: Mapping[int, Assignment], flows: Set[int]) -> list[OpenedLaw]:
    """Laws among the assignments of a loop (target -> assignment). `flows`: the variables that are flows of elements."""
    found = []
    for target, assignment in block.items():
        bound = _bound(target, assignment, block)
        if bound is not None:
            found.append(OpenedLaw(target, *bound, bound[0] not in flows))
    return found


def _bound(target: int, assignment: Assignment, block: Mapping[int, Assignment]) -> tuple[int, int] | None:
    """Argument and value of a law of a loop; None if the assignment is no such law."""
    expression = assignment.expression
    inside = [s for s in symbols(expression) if s.key in block]
    if not assignment.implicit:
        nonlinear = len(inside) == 1 and affine_parts(expression, inside[0]) is None
        return (inside[0].key, target) if nonlinear and inside[0].key != target else None
    if len(inside) != 2:
        return None
    for argument, value in (inside, inside[::-1]):
        if _is_shifted(expression, argument, value):
            return argument.key, value.key
    return None


def _is_shifted(expression: Expression, argument: Symbol, value: Symbol) -> bool:
    """Return True if an expression is a nonlinear function of one variable plus a linear one of the other."""
    parts = affine_parts(expression, value)
    if parts is None or parts[0] == ZERO or depends_on(parts[0], argument):
        return False
    return affine_parts(parts[1], argument) is None
