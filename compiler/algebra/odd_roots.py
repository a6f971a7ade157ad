"""Laws with a root that passes through zero, in one form for all forms of the text.

`sqrt(x) if x > 0 else -sqrt(-x)`, `x/sqrt(abs(x))`, `x*abs(x)^-0.5` and `sqrt(max(x, 0)) - sqrt(max(-x, 0))` are one function of x, which is
`sign(x)*sqrt(abs(x))`. Only this form has a value on both sides of its condition and at zero, so that a run can end and rest there.
Coefficients under the root stay there: if they are negative there is no value, as in the author's text. Two sides are compared at random values.
Roots on one side of a condition, as of a relief valve, keep to that side: at its instant rounding may leave their argument on the other.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from functools import reduce
from itertools import combinations
from math import isclose
from random import Random

from .affine import affine_parts
from .expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    depends_on,
    divide,
    evaluate,
    multiply,
    negate,
    operations,
    power,
    rebuild,
    select,
    substitute,
    symbols,
)

DRAWS = 8  # random values of all symbols at which sides are compared
ENOUGH = 3  # of them at which both sides have a value
EQUAL = 1e-11  # relative difference
STEEPEST = 0.33  # least exponent of a root as an unknown: the power of a lower one is so flat about zero that the flow there has an error of percents


def with_odd_roots(x: Expression) -> Expression:
    """Return the expression with every root that goes through zero written with sign and abs."""
    if not any(node.operator in ("sqrt", "power") for node in operations(x)):
        return x
    return _rewritten(x)


def _rewritten(x: Expression) -> Expression:
    if not isinstance(x, Apply):
        return x
    operands = tuple(map(_rewritten, x.operands))
    if operands != x.operands:
        x = rebuild(x.operator, operands)
    forms: dict[str, Callable[[Apply], Expression | None]] = {
        "select": _two_sided,
        "multiply": _quotient,
        "divide": _quotient,
        "add": _halves,
    }
    form = forms.get(x.operator) if isinstance(x, Apply) else None
    other = None if form is None or not isinstance(x, Apply) else form(x)
    return x if other is None else other


def with_sides(x: Expression) -> Expression:
    """Return the expression with the roots in each branch of a choice on the side of its condition."""
    if not isinstance(x, Apply) or not any(map(_is_root, operations(x))):
        return x
    operands = tuple(map(with_sides, x.operands))
    if x.operator == "select":
        condition, value, otherwise = operands
        return select(condition, _on_its_side(value, condition, True), _on_its_side(otherwise, condition, False))
    return x if operands == x.operands else rebuild(x.operator, operands)


def with_unknown_roots(x: Expression, unknown: Callable[[Expression, float], Expression | None]) -> Expression:
    """Return the expression with u = sign(h) abs(h)^q in its roots of abs(h) and max(h, 0), where `unknown` gives one for h and q."""
    if not isinstance(x, Apply):
        return x
    above, below = _factors(x)
    for root in above:
        if (ends := _end_at_zero(root)) is None:
            continue
        magnitude, slope, share = ends
        h = next(o for o in magnitude.operands if o != ZERO)
        if (u := unknown(h, share)) is None:
            continue
        sign = call("sign", h)
        odd = magnitude.operator == "abs" and sign in above
        value = u if odd else rebuild(magnitude.operator, [u if o == h else o for o in magnitude.operands])
        rest = [f for f in above if f is not root and not (odd and f == sign)]
        return with_unknown_roots(reduce(divide, below, multiply(value, power(slope, Number(share)), *rest)), unknown)
    operands = tuple(with_unknown_roots(o, unknown) for o in x.operands)
    return x if operands == x.operands else rebuild(x.operator, operands)


def _end_at_zero(x: Expression) -> tuple[Apply, Expression, float] | None:
    """Return m, k and q for a root (k m)^q of a magnitude m, which is abs(h) or max(h, 0)."""
    match x:
        case Apply(operator="sqrt", operands=(base,)):
            share = 0.5
        case Apply(operator="power", operands=(base, Number(share))) if STEEPEST <= share < 1:
            pass
        case _:
            return None
    placeholder = Symbol("magnitude")
    for node in operations(base):
        if node.operator == "abs" or (node.operator == "max" and ZERO in node.operands):
            parts = affine_parts(_put(base, node, placeholder), placeholder)
            if parts is not None and parts[0] != ZERO and parts[1] == ZERO:
                return node, parts[0], share
    return None


def _on_its_side(x: Expression, condition: Expression, holds: bool) -> Expression:
    """Return a branch of a choice in which `sqrt(c*(a - b))` is `sqrt(c*max(a - b, 0))` where the condition keeps a above b."""
    match condition:
        case Apply(operator="not", operands=(opposite,)):
            return _on_its_side(x, opposite, not holds)
        case Apply(operator="and" | "or" as operator, operands=parts) if holds == (operator == "and"):
            return reduce(lambda y, part: _on_its_side(y, part, holds), parts, x)
        case Apply(operator="less" | "less_equal", operands=(low, high)) if any(map(_is_root, operations(x))):
            positive = high - low if holds else low - high
            kept = call("max", positive, ZERO)
            return _with_factors(x, {positive: kept, negate(positive): negate(kept)}, False)
    return x


def _with_factors(x: Expression, kept: Mapping[Expression, Expression], below: bool) -> Expression:
    """Return an expression with factors below its roots replaced; `below`: it is below one."""
    if below and x in kept:
        return kept[x]
    if not isinstance(x, Apply) or (below and x.operator not in ("multiply", "divide")):
        return x
    operands = tuple(_with_factors(o, kept, below or _is_root(x)) for o in x.operands)
    return x if operands == x.operands else rebuild(x.operator, operands)


def _is_root(x: Apply) -> bool:
    """Return True if an operation has no value where its first operand is negative, or may have none."""
    match x:
        case Apply(operator="power", operands=(_, Number(n))):
            return n != int(n)
    return x.operator in ("sqrt", "power")


def _two_sided(x: Apply) -> Expression | None:
    """Return sign(v) A(abs(v)) for `A(v) if v > 0 else -A(-v)`, if A has a root that is zero at v = 0."""
    condition, above, below = x.operands
    if not isinstance(condition, Apply) or condition.operator not in ("less", "less_equal"):
        return None
    low, high = condition.operands
    if low != ZERO and high != ZERO:
        return None
    variable = low if high == ZERO else high
    if not isinstance(variable, Symbol):
        return None
    if high == ZERO:  # v < 0
        above, below = below, above
    above, below = (_without_rest(side, variable, positive) for side, positive in ((above, True), (below, False)))
    if not _has_root(above, variable) or not _agree(above, negate(_at(below, negate(variable))), variable):
        return None
    rest = _at(below, ZERO, variable)
    if _agree(rest, rest, variable) and not _agree(rest, ZERO, variable):
        return None  # a value of its own at v = 0
    return _odd(above, variable)


def _without_rest(side: Expression, variable: Symbol, positive: bool) -> Expression:
    """Return A for `A if v > 0 else 0` on the side where v is positive (or negative): zero is left for v = 0 alone."""
    if isinstance(side, Apply) and side.operator == "select" and side.operands[2] == ZERO:
        condition = side.operands[0]
        strict = call("less", ZERO, variable) if positive else call("less", variable, ZERO)
        if condition == strict:
            return side.operands[1]
    return side


def _halves(x: Apply) -> Expression | None:
    """Return a sum in which `A(max(v, 0)) - A(max(-v, 0))` is sign(v) A(abs(v)); None if it has no such terms."""
    terms = list(x.operands)
    for one, other in combinations([t for t in terms if any(n.operator in ("max", "min") for n in operations(t))], 2):
        for variable in symbols(one):
            for above, below in ((one, other), (other, one)):
                if not _has_root(above, variable):
                    continue
                mirrored = negate(_at(below, negate(variable)))
                flat = (_agree(_at(side, negate(variable)), ZERO, variable) for side in (above, mirrored))
                if _agree(above, mirrored, variable) and all(flat):
                    rest = [t for t in terms if t is not one and t is not other]
                    return add(_odd(above, variable), *rest)
    return None


def _quotient(x: Apply) -> Expression | None:
    """Return sign(h) (s abs(h))^(1 - q)/s instead of h/(s abs(h))^q; None if the product has no such factors."""
    above, below = _factors(x)
    for place, factor in enumerate((*above, *below)):
        under = place >= len(above)
        root = _root_of_magnitude(factor, under)
        if root is None:
            continue
        base, inner, slope, share = root
        for variable in symbols(inner):
            parts = affine_parts(inner, variable)
            if parts is None or parts[1] != ZERO:
                continue
            for numerator in above:
                own = affine_parts(numerator, variable)
                if numerator is factor or own is None or own[0] == ZERO or own[1] != ZERO:
                    continue
                rest = [f for f in above if f is not numerator and f is not factor]
                others = [f for f in below if f is not factor]
                found = multiply(*rest, divide(own[0], multiply(parts[0], slope)), call("sign", inner), power(base, Number(1 - share)))  # fmt: skip
                return divide(found, multiply(*others)) if others else found
    return None


def _factors(x: Expression) -> tuple[list[Expression], list[Expression]]:
    """The factors above and below the line of a product of quotients."""
    if isinstance(x, Apply) and x.operator == "multiply":
        both = [_factors(f) for f in x.operands]
        return [f for a, _ in both for f in a], [f for _, b in both for f in b]
    if isinstance(x, Apply) and x.operator == "divide":
        (a, b), (c, d) = map(_factors, x.operands)
        return a + d, b + c
    return [x], []


def _root_of_magnitude(factor: Expression, under: bool) -> tuple[Expression, Expression, Expression, float] | None:
    """For a factor 1/(s abs(h))^q, 0 < q < 1: s abs(h), h, s and q. `under`: the factor is below the line."""
    if not isinstance(factor, Apply) or factor.operator not in ("sqrt", "power"):
        return None
    exponent = Number(0.5) if factor.operator == "sqrt" else factor.operands[1]
    if not isinstance(exponent, Number):
        return None
    share = exponent.value if under else -exponent.value
    magnitudes = [n for n in operations(factor.operands[0]) if n.operator == "abs"]
    if not 0 < share < 1 or len(magnitudes) != 1:
        return None
    base, magnitude = factor.operands[0], Symbol("magnitude")
    parts = affine_parts(_put(base, magnitudes[0], magnitude), magnitude)
    inner = magnitudes[0].operands[0]
    if parts is None or parts[1] != ZERO or any(depends_on(parts[0], s) for s in symbols(inner)):
        return None
    return base, inner, parts[0], share


def _put(x: Expression, old: Expression, new: Expression) -> Expression:
    """Return the expression with one node replaced."""
    if x == old:
        return new
    if not isinstance(x, Apply):
        return x
    return rebuild(x.operator, tuple(_put(o, old, new) for o in x.operands))


def _odd(side: Expression, variable: Symbol) -> Expression:
    """Return sign(v) A(abs(v))."""
    magnitude = call("abs", variable)
    inner = _at(side, magnitude)
    for node in list(operations(inner)):
        if node.operator == "max" and ZERO in node.operands and magnitude in node.operands:
            inner = _put(inner, node, magnitude)
    return multiply(call("sign", variable), inner)


def _at(x: Expression, value: Expression, variable: Symbol | None = None) -> Expression:
    """Return the expression with a symbol (that of the value) replaced by a value."""
    (symbol,) = symbols(value) if variable is None else (variable,)
    return substitute(x, lambda s: value if s == symbol else s)


def _has_root(x: Expression, variable: Symbol) -> bool:
    """Return True if a root of x has no slope at v = 0, where x is zero itself."""
    roots = [
        n.operands[0]
        for n in operations(x)
        if (n.operator == "sqrt" or (n.operator == "power" and isinstance(n.operands[1], Number) and 0 < n.operands[1].value < 1))
        and depends_on(n.operands[0], variable)
    ]  # fmt: skip
    return any(_agree(_at(r, ZERO, variable), ZERO, variable) for r in roots) and _agree(
        _at(x, ZERO, variable), ZERO, variable
    )


def _agree(one: Expression, other: Expression, variable: Symbol) -> bool:
    """Return True if two expressions are equal at random values of their symbols, that of a positive variable among them."""
    random, agreed = Random(0), 0
    known = list(dict.fromkeys([*symbols(one), *symbols(other)]))
    for draw in range(DRAWS):
        signs = (1.0,) if draw < DRAWS // 2 else (1.0, -1.0)
        values: dict[Hashable, float] = {s.key: random.choice(signs) * random.uniform(0.1, 10.0) for s in known}
        values[variable.key] = abs(values.get(variable.key, 1.0))
        found = _value(one, values), _value(other, values)
        if None in found:
            if found != (None, None):
                return False
            continue
        if not isclose(*found, rel_tol=EQUAL, abs_tol=1e-300):  # type: ignore[arg-type]
            return False
        agreed += 1
    return agreed >= ENOUGH


def _value(x: Expression, values: dict[Hashable, float]) -> float | None:
    """The value; None where there is none."""
    try:
        return float(evaluate(x, values.__getitem__))
    except (ArithmeticError, ValueError):
        return None
