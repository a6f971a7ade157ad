"""Validity limits of a run: the range of each table, and the author's requirements.

They are checked at points that the run accepts. A solver also evaluates points beyond; there, tables continue as straight lines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    call,
    evaluate,
    never_negative,
    operations,
    select,
    substitute,
    symbols,
)
from ..algebra.formula import Formula
from ..algebra.interpolate import MARGIN, one_way
from ..algebra.operators import OPERATORS, REALS
from ..algebra.table import domain, is_table
from ..equations.system import Argument, Assignment, Validity, Variable
from ..errors import CompilationFailed
from ..fast_dataclass import dataclass
from .errors import EvenPower, TableTurnsBack
from .program import LimitNote

COMPARISONS = frozenset({"less", "less_equal", "equal"})
SIDES = "what it compares has a value"


class Leaf(NamedTuple):
    """A symbol of a program: role and position in its array (time has none)."""

    role: str  # parameter, input, state, time or mode
    position: int


@dataclass(frozen=True, slots=True)
class LimitValue:
    """A quantity that a limit is about."""

    name: str
    unit: str
    expression: Expression


@dataclass(frozen=True, slots=True)
class Limit:
    """A condition (1 or 0), the quantities in it, and the note with which a violation is reported."""

    condition: Expression
    values: tuple[LimitValue, ...]
    note: LimitNote


Put = Callable[[Symbol], Expression]


def ranges(
    step: Assignment, put: Put, variables: Sequence[Variable], parameters: Callable[[Leaf], float]
) -> Iterator[Limit]:
    """Limits for the tables of an assignment where they are evaluated. Raises `CompilationFailed` for an inverse that is not unique."""
    for node, asked in _checked(step.formula):
        if node.operator == "root":
            _check_power(substitute(node, put), step, parameters)
            continue
        x, knots = node.operands[1], domain(node)
        _check_direction([substitute(k, put) for k in knots], step, parameters)
        number = step.arguments[x.key] if isinstance(x, Symbol) else None
        known = variables[number] if isinstance(number, int) else None
        name, unit = (known.name, known.unit) if known is not None else ("its argument", "")
        ends = (substitute(knots[0], put), substitute(knots[-1], put))
        low, high = call("min", *ends), call("max", *ends)
        margin = Number(MARGIN) * (high - low)
        at = substitute(x, put)
        holds = call("and", call("less_equal", low - margin, at), call("less_equal", at, high + margin))
        if asked is not None:
            holds = call("or", call("not", substitute(asked, put)), holds)
        values = (LimitValue(name, unit, at), LimitValue("low", unit, low), LimitValue("high", unit, high))
        note = LimitNote("table", step.owner, node.operator, "", step.span, None, _shown(values))
        yield Limit(select(holds, ONE, ZERO), values, note)


def requirement(
    limit: Validity, entry: Callable[[Argument], Expression], is_fixed: Callable[[Expression], bool]
) -> Limit:
    """A requirement of the author as a limit, with its quantities; `is_fixed`: True for an expression of parameters alone."""
    condition = entry(limit.condition)
    values = tuple(LimitValue(name, unit, entry(value)) for name, value, unit in limit.values)
    note = LimitNote(
        "start" if limit.refuses else "require",
        limit.owner,
        limit.words,
        limit.text,
        limit.span,
        limit.stands,
        _shown(values),
        is_fixed(condition),
    )
    return Limit(condition, values, note)


def sides(
    expression: Expression,
    step: Assignment,
    name: str,
    is_fixed: Callable[[Expression], bool],
    opened: Mapping[Expression, Expression],
) -> Iterator[Limit]:
    """Limits for what conditions in an expression compare, where they are evaluated: no divisor is zero, no logarithm or root is taken of less.

    `opened`: the conditions on time by their items of the mode. All their poles are found, so a divisor that passes zero in time violates nothing.
    """
    done: set[Expression] = set()
    stack: list[tuple[Expression, Expression | None, bool]] = [(expression, None, False)]
    visited = set(stack)
    while stack:
        node, under, compared = stack.pop()
        node = opened.get(node, node)
        if not isinstance(node, Apply):
            continue
        compared = compared or node.operator in COMPARISONS
        needs = _domain(node) if compared else None
        if needs is not None and needs[0] not in done:
            done.add(needs[0])
            holds = needs[0] if under is None else call("or", call("not", under), needs[0])
            values = (LimitValue(needs[1], "1", needs[2]),)
            note = LimitNote("require", "", name, SIDES, step.span, None, _shown(values), is_fixed(holds))
            yield Limit(select(holds, ONE, ZERO), values, note)
        first, *rest = node.operands
        more = [(first, under, compared)]
        if node.operator == "select":
            more += [(rest[0], _both(under, first), compared), (rest[1], _both(under, call("not", first)), compared)]
        elif node.operator in ("and", "or"):
            more += [(o, _both(under, first if node.operator == "and" else call("not", first)), compared) for o in rest]
        else:
            more += [(o, under, compared) for o in rest]
        stack += [item for item in more if item not in visited]
        visited.update(more)


def is_partial(node: Apply) -> bool:
    """Return True if an operation may have no value, or an infinite one of either sign, as far as one operand decides that by itself."""
    return _domain(node) is not None


def _domain(node: Apply) -> tuple[Expression, str, Expression] | None:
    """Condition under which an operation has a value, and no infinite one of either sign, and the operand that decides it, with a name; None if none does."""
    x = node.operands[-1]
    match node:
        case Apply(operator="divide"):  # a factor that is zero is refused, or changes the equations, where it is set
            moves = {s.key.role for s in symbols(x) if isinstance(s.key, Leaf)} - {"parameter"} != {"time"}
            if moves and any(o.operator == "add" for o in operations(x)):
                return call("not", call("equal", x, ZERO)), "divisor", x
        case Apply(operator="power", operands=(base, exponent)) if not never_negative(base):
            if isinstance(exponent, Number) and exponent.value == int(exponent.value):
                return None
            whole = call("equal", exponent, call("floor", exponent))
            return call("or", whole, call("less_equal", ZERO, base)), "base of a power", base
        case Apply(operator=name, operands=(x,)) if name in OPERATORS and OPERATORS[name].domain != REALS:
            low, high = map(Number, OPERATORS[name].domain)  # infinite at an end, a logarithm has a sign
            return call("and", call("less_equal", low, x), call("less_equal", x, high)), name, x
    return None


def _shown(values: Sequence[LimitValue]) -> tuple[tuple[str, str], ...]:
    return tuple((v.name, v.unit) for v in values)


@lru_cache(maxsize=65536)
def _checked(formula: Formula) -> tuple[tuple[Apply, Expression | None], ...]:
    """Tables and roots in a formula, each with the condition under which it is evaluated (None: always)."""
    found: dict[Apply, Expression | None] = {}
    seen: set[tuple[Expression, Expression | None]] = set()
    stack: list[tuple[Expression, Expression | None]] = [(formula.expression, None)]
    while stack:
        node, asked = stack.pop()
        if not isinstance(node, Apply) or (node, asked) in seen:
            continue
        seen.add((node, asked))
        if is_table(node) or node.operator == "root":
            before = found.get(node, asked)
            found[node] = None if asked is None or before is None else call("or", before, asked)
        if node.operator == "select":
            condition, value, otherwise = node.operands
            stack += [
                (condition, asked),
                (value, _both(asked, condition)),
                (otherwise, _both(asked, call("not", condition))),
            ]
        else:
            stack += [(o, asked) for o in node.operands if isinstance(o, Apply)]
    return tuple(found.items())


def _both(asked: Expression | None, condition: Expression) -> Expression:
    return condition if asked is None else call("and", asked, condition)


def _values(expressions: Sequence[Expression], parameters: Callable[[Leaf], float]) -> list[float] | None:
    """Values of expressions of parameters; None if one of them reads something else."""
    try:
        return [evaluate(x, parameters) for x in expressions]
    except (ArithmeticError, ValueError):
        return None


def _check_direction(knots: Sequence[Expression], step: Assignment, parameters: Callable[[Leaf], float]) -> None:
    """Check that an inverted table is strictly monotone. Raises `CompilationFailed`."""
    values = _values(knots, parameters)
    if values is not None and not one_way(values):
        raise CompilationFailed([TableTurnsBack(step.span, step.owner)])


def _check_power(node: Expression, step: Assignment, parameters: Callable[[Leaf], float]) -> None:
    """Check that no even power is inverted: it has two inverses. Raises `CompilationFailed`."""
    if isinstance(node, Apply) and node.operator == "root":
        exponent = _values(node.operands[1:], parameters)
        if exponent is not None and exponent[0] % 2 == 0:
            raise CompilationFailed([EvenPower(step.span, step.owner, f"{exponent[0]:g}")])
