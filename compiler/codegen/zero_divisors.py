"""Zero divisors: parameters whose zeros make a divisor of the equations zero, whatever states and inputs are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from functools import reduce

from ..algebra.expression import Apply, Expression, Number, Symbol
from ..reduction.state_space import LinearLoop, StateSpace
from .events import behind_the_run

Sets = frozenset[frozenset[str]]  # the quantity vanishes where all parameters of one set are zero
NEVER: Sets = frozenset()
ALWAYS: Sets = frozenset({frozenset()})
MOST = 64  # sets of one quantity; one with more counts as never zero
THROUGH_ZERO = ("sqrt", "root", "sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "erf", "abs", "sign")


def zero_divisors(space: StateSpace, settable: Set[str]) -> Sets:
    """Return the smallest sets of parameters such that rates or residuals divide by zero where all of one set are zero."""
    sets = {i: frozenset({frozenset({v.name})}) for i, v in enumerate(space.variables) if v.role == "parameter" and v.name in settable}  # fmt: skip
    behind, divisors = behind_the_run(space) if sets else (), set[frozenset[str]]()
    for step in space.steps if sets else ():
        if isinstance(step, LinearLoop):
            continue
        arguments = [sets.get(a, NEVER) if isinstance(a, int) else NEVER if a else ALWAYS for a in step.arguments]
        if any(arguments):
            known: dict[Expression, Sets] = {}
            if not step.implicit:
                sets[step.target] = _vanishing(step.formula.expression, arguments, known)
            for divisor in _divisors(step.formula.expression) if step.target in behind else ():
                divisors |= _vanishing(divisor, arguments, known)
    return _smallest(s for s in divisors if s)


def _divisors(x: Expression) -> Iterator[Expression]:
    """Yield the divisors of an expression, outside of the branches of an `if`, whose condition may keep them from zero."""
    if isinstance(x, Apply) and x.operator != "select":
        if x.operator == "divide":
            yield x.operands[1]
        elif x.operator == "power" and isinstance(x.operands[1], Number) and x.operands[1].value < 0:
            yield x.operands[0]
        for operand in x.operands:
            yield from _divisors(operand)


def _vanishing(x: Expression, arguments: Sequence[Sets], known: dict[Expression, Sets]) -> Sets:
    """Return the smallest sets for an expression: a product vanishes with any factor, a sum with all terms (taken one by one: combinations are too many)."""
    if isinstance(x, Number):
        return NEVER if x.value else ALWAYS
    if isinstance(x, Symbol):
        return arguments[x.key]  # type: ignore[no-any-return]
    if x not in known:
        assert isinstance(x, Apply)
        operands = [_vanishing(o, arguments, known) for o in x.operands]
        if x.operator == "multiply":
            known[x] = _smallest(s for sets in operands for s in sets)
        elif x.operator in ("add", "min", "max"):
            known[x] = reduce(lambda a, b: _smallest(s | t for s in a for t in b), operands) if all(operands) else NEVER
        else:
            positive = x.operator == "power" and isinstance(x.operands[1], Number) and x.operands[1].value > 0
            known[x] = operands[0] if positive or x.operator in ("divide", *THROUGH_ZERO) else NEVER
    return known[x]


def _smallest(sets: Iterable[frozenset[str]]) -> Sets:
    found = sorted(set(sets), key=len)
    return NEVER if len(found) > MOST else frozenset(s for i, s in enumerate(found) if not any(t <= s for t in found[:i]))  # fmt: skip
