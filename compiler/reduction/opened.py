"""Laws of a nonlinear loop that bind two of its variables, one of them nonlinearly: where a loop is opened, both become unknowns.

What is left of the loop is then linear in its unknowns but for one function of one variable in each of these rows. That is what a solution from
far away needs: along each law it can move by whichever of its two variables changes less.
"""

from __future__ import annotations

from collections.abc import Mapping, Set

from ..algebra.affine import affine_parts
from ..algebra.expression import ZERO, Expression, Symbol, depends_on, symbols
from ..equations.system import Assignment
from .state_space import OpenedLaw


def opened_laws(block: Mapping[int, Assignment], flows: Set[int]) -> list[OpenedLaw]:
    """The laws among the assignments of a loop (target -> assignment); `flows`: the variables that are flows of elements."""
    found = []
    for target, assignment in block.items():
        bound = _bound(target, assignment, block)
        if bound is not None:
            found.append(OpenedLaw(target, *bound, bound[0] not in flows))
    return found


def _bound(target: int, assignment: Assignment, block: Mapping[int, Assignment]) -> tuple[int, int] | None:
    """The argument and the value of a law of a loop; None if the assignment is none."""
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
    """Whether something is a nonlinear function of one variable and a linear one of the other, added."""
    parts = affine_parts(expression, value)
    if parts is None or parts[0] == ZERO or depends_on(parts[0], argument):
        return False
    return affine_parts(parts[1], argument) is None
