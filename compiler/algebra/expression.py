"""Expressions: immutable, over numbers, symbols and a closed set of operators. All laws are made of them.

They have no names, units or syntax; the meaning of a symbol (a slot of a law, a variable of a model) is known to its maker.
The constructors below fold numbers and drop zeros and ones, so terms that vanish are removed completely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeGuard

from ..fast_dataclass import dataclass
from .operators import CONDITIONS, OPERATORS, value_of


class Expression:
    """A number, a symbol or an operator applied to operands; compared by structure."""

    __slots__ = ()

    def __add__(self, other: Expression | float) -> Expression:
        return add(self, lift(other))

    def __radd__(self, other: float) -> Expression:
        return add(lift(other), self)

    def __sub__(self, other: Expression | float) -> Expression:
        return add(self, negate(lift(other)))

    def __rsub__(self, other: float) -> Expression:
        return add(lift(other), negate(self))

    def __mul__(self, other: Expression | float) -> Expression:
        return multiply(self, lift(other))

    def __rmul__(self, other: float) -> Expression:
        return multiply(lift(other), self)

    def __truediv__(self, other: Expression | float) -> Expression:
        return divide(self, lift(other))

    def __rtruediv__(self, other: float) -> Expression:
        return divide(lift(other), self)

    def __pow__(self, other: Expression | float) -> Expression:
        return power(self, lift(other))

    def __rpow__(self, other: float) -> Expression:
        return power(lift(other), self)

    def __neg__(self) -> Expression:
        return negate(self)


@dataclass(frozen=True, slots=True)
class Number(Expression):
    """A double."""

    value: float


@dataclass(frozen=True, slots=True)
class Symbol(Expression):
    """A placeholder with a key: a slot number in a formula, a variable in a model."""

    key: Any


class Apply(Expression):
    """An operator applied to operands. The hash is stored, as nodes are looked up very often.

    A `closed` sum or product stays one operand when it is added or multiplied again, because it is also used elsewhere.
    """

    __slots__ = ("_hash", "closed", "operands", "operator")
    operator: str
    operands: tuple[Expression, ...]

    def __init__(self, operator: str, operands: tuple[Expression, ...], closed: bool = False) -> None:
        self.operator = operator
        self.operands = operands
        self.closed = closed
        self._hash = hash((operator, operands))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Apply) or self._hash != other._hash or self.operator != other.operator:
            return False
        if self.operands != other.operands:
            return False
        other.operands = self.operands  # one object from now on: shared nodes are compared once, not once for each path
        return True

    def __repr__(self) -> str:
        return f"{self.operator}({', '.join(map(repr, self.operands))})"


ZERO, ONE, MINUS_ONE = Number(0.0), Number(1.0), Number(-1.0)


def lift(value: Expression | float) -> Expression:
    """A float as an expression; an expression as it is."""
    return value if isinstance(value, Expression) else Number(float(value))


# ---------------------------------------------------------------- constructors


# operands of a sum or product that is opened in another: a product squared fifty times has 2^50 factors
LONGEST_OPENED = 64


def _opens(x: Expression, operator: str) -> TypeGuard[Apply]:
    return type(x) is Apply and x.operator == operator and not x.closed and len(x.operands) <= LONGEST_OPENED


def add(*terms: Expression) -> Expression:
    """Sum: nested sums are opened, numbers collected, zeros dropped."""
    number = 0.0
    rest: list[Expression] = []
    for term in terms:
        if type(term) is Number:
            number += term.value
        elif type(term) is Apply and _opens(term, "add"):
            for part in term.operands:
                if type(part) is Number:
                    number += part.value
                else:
                    rest.append(part)
        else:
            rest.append(term)
    if number != 0.0:
        rest.append(Number(number))
    if not rest:
        return ZERO
    return rest[0] if len(rest) == 1 else Apply("add", tuple(rest))


def multiply(*factors: Expression) -> Expression:
    """Product: nested products are opened, numbers collected in front, ones dropped; zero if a factor is zero."""
    number = 1.0
    rest: list[Expression] = []
    for factor in factors:
        if type(factor) is Number:
            number *= factor.value
        elif type(factor) is Apply and _opens(factor, "multiply"):
            for part in factor.operands:
                if type(part) is Number:
                    number *= part.value
                else:
                    rest.append(part)
        else:
            rest.append(factor)
    if number == 0.0:
        return ZERO
    if len(rest) > 1:
        rest = _join_roots(rest)
    if not rest:
        return Number(number)
    if number != 1.0:
        if len(rest) == 1 and _opens(rest[0], "add") and number == -1.0:
            return Apply("add", tuple([negate(term) for term in rest[0].operands]))
        rest.insert(0, Number(number))
    return rest[0] if len(rest) == 1 else Apply("multiply", tuple(rest))


def _join_roots(factors: list[Expression]) -> list[Expression]:
    """abs(x) sign(x) = x: keeps V = gain sqrt(abs(c)) sign(c), squared, smooth at c = 0; sign(x) x^2 = x abs(x), which has a slope everywhere."""
    for factor in factors:
        if type(factor) is Apply and factor.operator == "sign":
            break
    else:
        return factors
    signs = {f.operands[0] for f in factors if isinstance(f, Apply) and f.operator == "sign"}
    result = list(factors)
    for inner in signs:
        magnitude, sign = Apply("abs", (inner,)), Apply("sign", (inner,))
        while magnitude in result and sign in result:
            result.remove(sign)
            result[result.index(magnitude)] = inner
        if sign in result and inner in result:  # x sign(x) = abs(x)
            result.remove(sign)
            result[result.index(inner)] = magnitude
        for place, factor in enumerate(result if sign in result else ()):
            match factor:
                case Apply(operator="power", operands=(base, Number(n))) if n >= 2 and (
                    base == magnitude or (base == inner and n % 2 == 0)
                ):
                    result[place] = multiply(inner, power(magnitude, Number(n - 1)))
                    result.remove(sign)
                    break
    return result


def negate(x: Expression) -> Expression:
    """-x."""
    return multiply(MINUS_ONE, x)


def divide(a: Expression, b: Expression) -> Expression:
    """a / b."""
    if isinstance(b, Number):
        if b.value == 1.0:
            return a
        if b.value == -1.0:
            return negate(a)
        if isinstance(a, Number) and b.value != 0.0:
            return Number(a.value / b.value)
    if isinstance(a, Number) and a.value == 0.0 and not (isinstance(b, Number) and b.value == 0.0):
        return ZERO
    if isinstance(b, Apply) and b.operator == "multiply" and b.operands[0] == MINUS_ONE:
        return divide(negate(a), multiply(*b.operands[1:]))
    if isinstance(a, Apply) and a.operator == "multiply" and a.operands[0] == MINUS_ONE:
        return negate(divide(multiply(*a.operands[1:]), b))
    return Apply("divide", (a, b))


def power(base: Expression, exponent: Expression) -> Expression:
    """base ^ exponent. Integer powers of products and roots are opened, so that sqrt(x)^2 is x for x >= 0."""
    if isinstance(exponent, Number):
        n = exponent.value
        if n == 0.0:
            return ONE
        if n == 1.0:
            return base
        if n == 0.5:
            return call("sqrt", base)
        if isinstance(base, Number):
            return call("power", base, exponent)
        if n != int(n) and (root := _of_sizes(base, n)) is not None:
            return root
        if isinstance(base, Apply) and n == int(n):
            if base.operator == "multiply":
                return multiply(*(power(f, exponent) for f in base.operands))
            if base.operator == "sqrt" and n % 2 == 0 and never_negative(base.operands[0]):
                return power(base.operands[0], Number(n / 2))
            if base.operator == "sign" and n > 0:
                return base if n % 2 else multiply(base, base)
            if base.operator == "abs" and n % 2 == 0:
                return power(base.operands[0], exponent)
    return call("power", base, exponent)


def _of_sizes(x: Expression, exponent: float) -> Expression | None:
    """A root of even powers alone, by the absolute values of their bases: sqrt(4 x^2) = 2 abs(x), whose bend is known; None for any other base."""
    totals: dict[Expression, float] = {}
    for factor in x.operands if _opens(x, "multiply") else (x,):
        match factor:
            case Apply(operator="power", operands=(base, Number(n))) if n == int(n):
                totals[base] = totals.get(base, 0.0) + n
            case _:
                totals[factor] = totals.get(factor, 0.0) + 1.0
    if any(n % 2 and not (isinstance(b, Number) and b.value >= 0) for b, n in totals.items()) or not any(
        n % 2 == 0 for n in totals.values()
    ):
        return None
    return multiply(*(power(call("abs", base), Number(n * exponent)) for base, n in totals.items()))


def never_negative(x: Expression) -> bool:
    match x:
        case Number(value):
            return value >= 0
        case Apply(operator="power", operands=(_, Number(n))) if n == int(n) and n % 2 == 0:
            return True
        case Apply(operator=("multiply" | "add"), operands=parts):
            return all(map(never_negative, parts))
        case Apply(operator=operator) if operator in OPERATORS:
            return OPERATORS[operator].never_negative
    return False


def call(operator: str, *operands: Expression) -> Expression:
    """Any operator; folded if it has one value, all operands are numbers and the value is finite."""
    if operator == "add":
        return add(*operands)
    if operator == "multiply":
        return multiply(*operands)
    if operator == "select":
        return select(*operands)
    if operator == "sqrt" and (root := _of_sizes(operands[0], 0.5)) is not None:
        return root
    numbers = [x.value for x in operands if isinstance(x, Number)]
    if operator in OPERATORS and operator not in CONDITIONS and len(numbers) == len(operands):
        try:
            value = value_of(operator, numbers)
        except (ArithmeticError, ValueError):
            return Apply(operator, operands)  # reported, with a place, when it is evaluated
        if operator in ("sin", "cos") and abs(value) < 4e-16 and abs(numbers[0]) > 0.1:
            value = 0.0  # a multiple of 90 deg: the rounding error would couple independent variables
        if math.isfinite(value):
            return Number(value)
    return Apply(operator, operands)


def apply(operator: str, *operands: Expression | float) -> Expression:
    """Any operator over expressions and numbers, for the rules of the table of operators."""
    return call(operator, *map(lift, operands))


def select(condition: Expression, value: Expression, otherwise: Expression) -> Expression:
    """`value if condition else otherwise`."""
    if value == otherwise:
        return value
    truth = truth_of(condition)
    if truth is not None:
        return value if truth else otherwise
    return Apply("select", (condition, value, otherwise))


def truth_of(condition: Expression) -> bool | None:
    """Truth value of a condition over numbers; None if it depends on a symbol."""
    if any(True for _ in symbols(condition)):
        return None
    try:
        return bool(evaluate(condition, {}.__getitem__))
    except (ArithmeticError, ValueError):
        return None


JOINING = frozenset({"abs", "sign", "sqrt", "power", "root"})  # factors that may cancel with others


def closed(x: Expression) -> Expression:
    """The same expression for use in several places: a sum or product that is not opened inside another."""
    if not isinstance(x, Apply) or x.closed or x.operator not in ("add", "multiply"):
        return x
    if x.operator == "multiply" and (x.operands[0] == MINUS_ONE or any(isinstance(o, Apply) and o.operator in JOINING for o in x.operands)):  # fmt: skip
        return x
    return Apply(x.operator, x.operands, True)


# ---------------------------------------------------------------- walking


def symbols(x: Expression) -> Iterator[Symbol]:
    """Distinct symbols, in the order of their first occurrence."""
    seen: set[Expression] = set()
    stack = [x]
    while stack:
        node = stack.pop()
        if type(node) is Number or node in seen:
            continue
        seen.add(node)
        if isinstance(node, Symbol):
            yield node
        elif isinstance(node, Apply):
            stack.extend(node.operands[::-1])


def operations(x: Expression) -> Iterator[Apply]:
    """Distinct operations."""
    seen: set[Expression] = set()
    stack = [x]
    while stack:
        node = stack.pop()
        if isinstance(node, Apply) and node not in seen:
            seen.add(node)
            yield node
            stack.extend(node.operands)


def depends_on(x: Expression, symbol: Symbol) -> bool:
    """Return True if the symbol occurs in x."""
    return any(s == symbol for s in symbols(x))


def substitute(x: Expression, replacement: Callable[[Symbol], Expression]) -> Expression:
    """Replace every symbol, folding operations on numbers."""
    if isinstance(x, Apply):
        return _substituted(x, replacement, {})
    return replacement(x) if isinstance(x, Symbol) else x


def _substituted(node: Apply, replacement: Callable[[Symbol], Expression], done: dict[Apply, Expression]) -> Expression:
    """Return a node with its symbols replaced. `done`: the same of nodes before. No closure, as each would be a cycle for the garbage collector."""
    result = done.get(node)
    if result is None:
        operands = []
        for operand in node.operands:
            kind = type(operand)
            if kind is Apply:
                operand = _substituted(operand, replacement, done)  # type: ignore[arg-type]
            elif kind is Symbol:
                operand = replacement(operand)  # type: ignore[arg-type]
            operands.append(operand)
        done[node] = result = rebuild(node.operator, operands)
    return result


def rebuild(operator: str, operands: Sequence[Expression]) -> Expression:
    """Return the operator applied to new operands, simplified as its own constructor does."""
    if operator == "multiply":
        return multiply(*operands)
    if operator == "add":
        return add(*operands)
    if operator == "divide":
        return divide(*operands)
    if operator == "power":
        return power(*operands)
    return call(operator, *operands)


def evaluate(x: Expression, lookup: Callable[[Any], float]) -> float:
    """Value for floats. Raises ArithmeticError or ValueError if there is none."""
    return _evaluated(x, lookup, {})


def _evaluated(node: Expression, lookup: Callable[[Any], float], done: dict[Expression, float]) -> float:
    if isinstance(node, Number):
        return node.value
    result = done.get(node)
    if result is None:
        if isinstance(node, Symbol):
            result = lookup(node.key)
        else:
            assert isinstance(node, Apply)
            if node.operator == "select":  # the branch not taken may have no value
                condition, a, b = node.operands
                result = _evaluated(a if _evaluated(condition, lookup, done) else b, lookup, done)
            else:
                result = value_of(node.operator, [_evaluated(o, lookup, done) for o in node.operands])
        done[node] = result
    return result
