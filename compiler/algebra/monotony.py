"""Courses of expressions: proofs that a function rises or falls in one of its variables, from its form and the signs of its coefficients.

The rules compose (a sum of rising functions rises, a rising function of a falling one falls), so nothing is sampled and no rounding matters. Where no
rule applies there is no answer, also for functions that do rise (Fourer, Maheshwari, Neumaier, Orban and Schichl, Convexity and concavity detection,
INFORMS J. Computing 22, 2010, section 2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import TypeAlias

from ..fast_dataclass import dataclass
from .expression import Apply, Expression, Number, Symbol, apply, depends_on
from .operators import OPERATORS

Signs: TypeAlias = Callable[[Symbol], int]  # 1 or -1 of a symbol that never is zero or of the other sign, else 0


@dataclass(frozen=True, slots=True)
class Course:
    """Direction of a function of one variable: 1 if it never falls, -1 if it never rises, 0 if it is constant. `strict`: it has no flat parts."""

    direction: int
    strict: bool


CONSTANT = Course(0, False)


def sign_of(x: Expression, signs: Signs) -> int:
    """Return 1 or -1 if an expression is positive or negative throughout, else 0: not known, or zero somewhere."""
    if isinstance(x, Number):
        return (x.value > 0) - (x.value < 0)
    if isinstance(x, Symbol):
        return signs(x)
    assert isinstance(x, Apply)
    operands = x.operands
    match x.operator:
        case "add":
            of_terms = {sign_of(term, signs) for term in operands}
            return of_terms.pop() if len(of_terms) == 1 else 0
        case "multiply" | "divide":
            return math.prod(sign_of(factor, signs) for factor in operands)
        case "power":
            return int(sign_of(operands[0], signs) > 0)
        case "sqrt" | "abs":
            return sign_of(operands[0], signs) ** 2 if x.operator == "abs" else int(sign_of(operands[0], signs) > 0)
        case "exp" | "cosh":
            return 1
        case "sinh" | "tanh" | "atan" | "asinh" | "erf":
            return sign_of(operands[0], signs)
    return 0


def course_of(x: Expression, variable: Symbol, signs: Signs) -> Course | None:
    """Return the course of an expression in a variable, for all its values and those of the other symbols that have these signs; None if no rule applies."""
    if not depends_on(x, variable):
        return CONSTANT
    if x == variable:
        return Course(1, True)
    assert isinstance(x, Apply)
    operands = x.operands
    match x.operator:
        case "add":
            return reduce(_sum, (course_of(term, variable, signs) for term in operands))
        case "multiply":
            return _product(x, variable, signs)
        case "divide":
            return _quotient(operands[0], operands[1], variable, signs)
        case "power" | "root":
            return _power(x, variable, signs)
        case "min" | "max":
            return _one_of(*(course_of(operand, variable, signs) for operand in operands))
    row = OPERATORS[x.operator]
    if row.arity == 1 and row.course in ("rising", "falling"):
        return _times(1 if row.course == "rising" else -1, course_of(operands[0], variable, signs))
    if x.operator == "abs":
        return _times(sign_of(operands[0], signs), course_of(operands[0], variable, signs))
    return None


def _sum(a: Course | None, b: Course | None) -> Course | None:
    if a is None or b is None or a.direction * b.direction < 0:
        return None
    return Course(a.direction or b.direction, a.strict or b.strict)


def _one_of(a: Course | None, b: Course | None) -> Course | None:
    """Course of the smaller or larger of two functions."""
    if a is None or b is None or a.direction * b.direction < 0:
        return None
    return Course(a.direction or b.direction, a.strict and b.strict)


def _times(sign: int, course: Course | None) -> Course | None:
    return None if course is None or not sign else Course(sign * course.direction, course.strict)


def _product(x: Apply, variable: Symbol, signs: Signs) -> Course | None:
    """Course of a product with constant factors of known signs, and one factor with the variable, or such a one (or its sign) times a power of its size."""
    moving = [factor for factor in x.operands if depends_on(factor, variable)]
    sign = math.prod(sign_of(factor, signs) for factor in x.operands if not depends_on(factor, variable))
    if len(moving) == 1:
        return _times(sign, course_of(moving[0], variable, signs))
    for factor, size in (moving, moving[::-1]) if len(moving) == 2 else ():
        inner = factor.operands[0] if isinstance(factor, Apply) and factor.operator == "sign" else factor
        if _is_power_of_size(size, inner):
            return _times(sign, course_of(inner, variable, signs))
    return None


def _is_power_of_size(x: Expression, inner: Expression) -> bool:
    """Return True for abs(f), its root or a positive power of it, or an even power of f: times f or sign(f) it rises with f."""
    if not isinstance(x, Apply):
        return False
    if x.operator == "power" and isinstance(x.operands[1], Number) and x.operands[1].value > 0:
        return x.operands[0] == apply("abs", inner) or (x.operands[0] == inner and x.operands[1].value % 2 == 0)
    return x == apply("abs", inner) or (x.operator == "sqrt" and x.operands[0] == apply("abs", inner))


def _quotient(a: Expression, b: Expression, variable: Symbol, signs: Signs) -> Course | None:
    if not depends_on(b, variable):
        return _times(sign_of(b, signs), course_of(a, variable, signs))
    if depends_on(a, variable) or not sign_of(b, signs):
        return None
    return _times(-sign_of(a, signs), course_of(b, variable, signs))


def _power(x: Apply, variable: Symbol, signs: Signs) -> Course | None:
    """Course of an odd power or root, or of any constant power of what is positive."""
    base, exponent = x.operands
    if not isinstance(exponent, Number):
        return None
    if exponent.value > 0 and exponent.value % 2 == 1:
        return course_of(base, variable, signs)
    if x.operator == "power" and sign_of(base, signs) > 0:
        return _times((exponent.value > 0) - (exponent.value < 0), course_of(base, variable, signs))
    return None
