"""Conditions on numbers that a run sets: checked here if the values are known, else handed on as expressions that must not be negative.

A run evaluates these expressions. If one is negative, the model is compiled again with the numbers, and the usual error is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...algebra.expression import ONE, Expression, Number, add, call, multiply, negate, select
from ...algebra.formula import Bound, bind
from ...source import Span
from .resolver import Resolver

LEAST = Number(1e-300)
Condition = Callable[
    [Sequence[Expression]], Sequence[Expression]
]  # from values to what must not be negative; `list`: they themselves


def known_or_later(
    resolver: Resolver, bounds: Sequence[Bound], span: Span, words: str, condition: Condition
) -> list[float] | None:
    """Return the values, or None if one of them is not known yet.

    In the second case, and in a program for all values, the expressions that `condition` makes of them are added to `positive`: they must not be
    negative when a run begins.
    """
    values = [resolver.value_of(b, span, decides=False) for b in bounds]
    known = [v for v in values if v is not None]
    missing = len(known) < len(values)
    if missing or resolver.for_all_values:
        resolver.positive += [(words, bind(x)) for x in condition([b.expression for b in bounds])]
    return None if missing else known


def not_zero(numbers: Sequence[Expression]) -> list[Expression]:
    """Condition that at least one value differs from zero."""
    return [_less(_squares(numbers))]


def not_negative(numbers: Sequence[Expression]) -> list[Expression]:
    """Condition that no value is negative."""
    return [*numbers]


def in_order(numbers: Sequence[Expression]) -> list[Expression]:
    """Condition that the second of two values is not smaller than the first."""
    return [add(numbers[1], negate(numbers[0]))]


def rising(numbers: Sequence[Expression]) -> list[Expression]:
    """Condition that the second of two values is the larger one."""
    return [select(call("less", *numbers), ONE, negate(ONE))]


def not_parallel(share: float) -> Condition:
    """Condition that two directions in space are not parallel: the sine of their angle is greater than `share`."""

    def condition(numbers: Sequence[Expression]) -> list[Expression]:
        a, b = numbers[:3], numbers[3:]
        normal = [add(multiply(a[i - 2], b[i - 1]), negate(multiply(a[i - 1], b[i - 2]))) for i in range(3)]
        return [_less(add(_squares(normal), negate(multiply(Number(share**2), _squares(a), _squares(b)))))]

    return condition


def apart(share: float) -> Condition:
    """Condition that the distance of two points is greater than `share` times their distance from the origin."""

    def condition(numbers: Sequence[Expression]) -> list[Expression]:
        away = [add(a, negate(b)) for a, b in zip(numbers[:3], numbers[3:], strict=True)]
        return [_less(add(_squares(away), negate(multiply(Number(share**2), _squares(numbers)))))]

    return condition


def takes_energy(rounding: float) -> Condition:
    """Condition that no principal minor of a tensor (xx, yy, zz, xy, xz, yz) is negative, up to rounding."""

    def condition(numbers: Sequence[Expression]) -> list[Expression]:
        xx, yy, zz, xy, xz, yz = (*numbers, *[Number(0.0)] * 3)[:6]
        size = add(*(call("abs", x) for x in (xx, yy, zz)))

        def minor(a: Expression, b: Expression, c: Expression) -> Expression:
            return add(multiply(a, b), negate(multiply(c, c)))

        whole = add(
            multiply(xx, minor(yy, zz, yz)), negate(multiply(xy, add(multiply(xy, zz), negate(multiply(yz, xz))))),
            multiply(xz, add(multiply(xy, yz), negate(multiply(yy, xz)))),
        )  # fmt: skip
        minors = (((xx, yy, zz), 1), ((minor(xx, yy, xy), minor(xx, zz, xz), minor(yy, zz, yz)), 2), ((whole,), 3))
        return [add(x, multiply(Number(rounding), *[size] * degree)) for some, degree in minors for x in some]

    return condition


def _squares(numbers: Sequence[Expression]) -> Expression:
    return add(*(multiply(x, x) for x in numbers))


def _less(x: Expression) -> Expression:
    """Subtract the smallest positive number, so that zero becomes negative."""
    return add(x, negate(LEAST))
