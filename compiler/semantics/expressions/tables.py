"""Tables and noise in expressions: `linear(x, xs, ys)`, `column("curve.csv", "force")`, `noise(time, period, seed)`.

The points of a table and the seed of a noise are known before the run. Literal numbers are checked at once, parameters in each instance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

from ...algebra.expression import Apply, Expression, Number, divide, evaluate
from ...algebra.interpolate import OutsideTable
from ...algebra.table import KINDS, noise, table
from ...fast_dataclass import dataclass
from ...graph.units import ONE
from ...source import Span
from ...syntax import tree
from ..names.errors import WrongArguments, WrongTable, WrongType
from ..names.scope import FileScope
from ..names.statement_errors import Wrong
from .columns import read_column
from .template import Check, Typed, Value, bare_number, common_dimension

MAXIMUM_POINTS = 200  # of a table whose points are parameters

USAGE = {
    **{kind: f"{kind}(x, (x1, x2, x3), (y1, y2, y3))" for kind in KINDS},
    "column": 'column("curve.csv", "force")',
    "noise": "noise(time, 10 ms, 1)",
}
LENGTHS = {"mod": "length", "stairs": "tread", "pwm": "period"}  # second arguments, which must not be zero
_COUNTS = {**dict.fromkeys(KINDS, 3), "column": 2, "noise": 3}


@dataclass(frozen=True, slots=True)
class Arguments:
    """Readers of the arguments of a call, and the list that collects the checks left to each instance."""

    file: FileScope
    value: Callable[[tree.ExpressionSyntax], Value]
    scalar: Callable[[tree.ExpressionSyntax], Typed]
    checks: list[Check]


def compile_table(arguments: Arguments, node: tree.Call) -> Value:
    """A call of one of the functions in `USAGE`. Raises `Wrong`."""
    if len(node.arguments) != _COUNTS[node.function]:
        count = f"{_COUNTS[node.function]} arguments"
        raise Wrong(WrongArguments(node.span, node.function, count, len(node.arguments), USAGE[node.function]))
    if node.function == "column":
        column = read_column(node, arguments.file)
        return tuple(Typed(Number(v), column.dimension) for v in column.values)
    return _noise(arguments, node) if node.function == "noise" else _curve(arguments, node)


def _noise(arguments: Arguments, node: tree.Call) -> Typed:
    place, period, seed = map(arguments.scalar, node.arguments)
    common_dimension(
        [(place, node.arguments[0].span), (period, node.arguments[1].span)], "Time and period need one unit"
    )
    bare_number(seed, node.arguments[2], "A seed")
    check = Check("noise", node.span, (period.expression,), (seed.expression,))
    _settle(arguments, check)
    return Typed(noise(divide(place.expression, period.expression), seed.expression), ONE)


def _curve(arguments: Arguments, node: tree.Call) -> Typed:
    x = arguments.scalar(node.arguments[0])
    places, values = (_points(arguments, node, argument) for argument in node.arguments[1:])
    at = [(x, node.arguments[0].span), *_placed(places, node.arguments[1])]
    common_dimension(at, f"What `{node.function}` is asked at and its places need one unit")
    dimension = common_dimension(_placed(values, node.arguments[2]), f"The values of `{node.function}` need one unit")
    if len(places) != len(values):
        what = f"`{node.function}` has {len(places)} places but {len(values)} values"
        raise Wrong(WrongTable(node.span, what, "Every place has one value: the two lists are of one length."))
    if len(places) < 2:
        hint = "A curve needs two points or more."
        raise Wrong(WrongTable(node.span, f"`{node.function}` has {len(places)} point", hint))
    xs, ys = tuple(t.expression for t in places), tuple(t.expression for t in values)
    check = Check(node.function, node.arguments[1].span, xs, ys, _cells(arguments, node.arguments[1]))
    if not _settle(arguments, check) and len(xs) > MAXIMUM_POINTS:
        hint = f"More than {MAXIMUM_POINTS} points are numbers of the text: `constant` lists, or columns of a file."
        raise Wrong(WrongTable(node.span, f"`{node.function}` has {len(xs)} points that are parameters", hint))
    result = table(node.function, x.expression, xs, ys)
    if isinstance(x.expression, Number) and isinstance(result, Apply):
        _ask(result, node)
    return Typed(result, dimension)


def _ask(result: Apply, node: tree.Call) -> None:
    """Check that a table read at a literal number has a value there. Raises `Wrong`."""
    try:
        evaluate(result, _unknown)
    except OutsideTable as outside:
        hint = "Give it more points, or ask it elsewhere."
        raise Wrong(WrongTable(node.arguments[0].span, str(outside), hint)) from None
    except LookupError:
        pass  # its points are parameters


def _unknown(key: object) -> float:
    raise LookupError(key)


def _points(arguments: Arguments, node: tree.Call, argument: tree.ExpressionSyntax) -> tuple[Typed, ...]:
    """A list of single numbers."""
    value = arguments.value(argument)
    if not isinstance(value, tuple):
        hint = f"Write {USAGE[node.function]}, the name of a list, or a column of a file."
        raise Wrong(WrongType(argument.span, "A list", "a single number", hint))
    if any(t.truth for t in value):
        raise Wrong(WrongType(argument.span, "A list of numbers", "a list of conditions"))
    return value


def _placed(points: Sequence[Typed], argument: tree.ExpressionSyntax) -> list[tuple[Typed, Span]]:
    """Points with their places in the text."""
    if isinstance(argument, tree.VectorSyntax):
        return [(t, item.span) for t, item in zip(points, argument.items, strict=True)]
    return [(t, argument.span) for t in points]


def _cells(arguments: Arguments, argument: tree.ExpressionSyntax) -> tuple[Span, ...]:
    """Places in the text or file of the numbers in a list, if they differ from the place of the argument."""
    if isinstance(argument, tree.Call) and argument.function == "column":
        return read_column(argument, arguments.file).cells
    return tuple(item.span for item in argument.items) if isinstance(argument, tree.VectorSyntax) else ()


def _settle(arguments: Arguments, check: Check) -> bool:
    """Check the points that are known and return True if all are; otherwise leave the check to each instance."""
    if all(isinstance(x, Number) for x in (*check.places, *check.values)):
        check_static(check, lambda x: x.value if isinstance(x, Number) else None)
        return True
    arguments.checks.append(check)
    return False


def check_static(check: Check, value: Callable[[Expression], float | None]) -> None:
    """Raise `Wrong` unless the places increase, for stairs the length is not zero, for a noise the period is positive and the seed whole, if known.

    `value` returns a number, or None if it has none yet; it raises for a quantity that changes during a run.
    """
    places, values = ([value(x) for x in part] for part in (check.places, check.values))
    known = [x for x in places if x is not None]
    if check.function in LENGTHS:
        _check_length(check, known)
    elif check.function == "noise":
        _check_noise(check, known, [x for x in values if x is not None])
    elif len(known) == len(places):
        _check_rising(check, known)


def settle_length(checks: list[Check], node: tree.Call, length: Typed) -> None:
    """Check the length of the stairs of a function in `LENGTHS`, or leave that to each instance."""
    check = Check(node.function, node.arguments[1].span, (length.expression,), ())
    if isinstance(length.expression, Number):
        _check_length(check, [length.expression.value])
    else:
        checks.append(check)


def _check_length(check: Check, lengths: Sequence[float]) -> None:
    """Raise `Wrong` for a length of zero, and for a period that is not positive."""
    positive = check.function == "pwm"
    if any(x == 0 or (positive and x < 0) for x in lengths):
        hint = "A period is positive." if positive else "Give it another value."
        raise Wrong(
            WrongTable(check.span, f"The {LENGTHS[check.function]} of `{check.function}` is {lengths[0]:g}", hint)
        )


def _check_noise(check: Check, periods: Sequence[float], seeds: Sequence[float]) -> None:
    if any(period <= 0 for period in periods):
        raise Wrong(WrongTable(check.span, f"The period of `noise` is {periods[0]:g}", "A period is positive."))
    if any(seed != round(seed) or abs(seed) > 2**53 for seed in seeds):
        hint = "A seed is a whole number: 1, 2, 3. Each gives other numbers, the same on every machine."
        raise Wrong(WrongTable(check.span, f"The seed of `noise` is {seeds[0]:g}", hint))


def _check_rising(check: Check, places: Sequence[float]) -> None:
    hint = "Sort the points by their places (SI values are shown); each place stands once."
    for i, (a, b) in enumerate(pairwise(places)):
        if not a < b:
            what = f"The places of `{check.function}` must rise, but number {i + 2} ({b:g}) is not larger than number {i + 1} ({a:g})"
            others = ((check.cells[i + 1], f"number {i + 2}"),) if check.cells else ()
            raise Wrong(WrongTable(check.span, what, hint, others))
