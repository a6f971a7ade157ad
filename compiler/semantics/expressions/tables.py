"""Tables and noise in expressions: `linear(x, xs, ys)`, `column("curve.csv", "force")`, `noise(time, period, seed)`.

The points of a table and the seed of a noise are known before the run. Literal numbers are checked at once, parameters in each instance.

Files of columns lie in the project folder. A header gives name and unit of each column:
    # a comment
    position [mm], force [N]
    0, 0.1
    1.5, 0.25
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from pathlib import Path

from ...algebra.expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    add,
    call,
    divide,
    evaluate,
    multiply,
    operations,
    select,
)
from ...algebra.formula import Bound
from ...algebra.interpolate import OutsideTable, surface_slopes
from ...algebra.table import KINDS, noise, sloped, table
from ...errors import CompilationFailed
from ...fast_dataclass import dataclass
from ...graph.units import ONE, Dimension, Scale
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ..names.column_file import Sheet, read_sheet, word_of
from ..names.errors import WrongArguments, WrongColumn, WrongTable, WrongType
from ..names.imports import is_there, within_project
from ..names.scope import FileScope, TextValue
from ..names.statement_errors import Wrong, suggestion
from .lists import parts_of, rows_of, sort_of
from .scales import scale_of
from .template import Check, Typed, Value, bare_number, common_dimension

MAXIMUM_POINTS = 200  # of a table whose points are parameters
MAXIMUM_CURVES = 50  # along the shorter side of a table of two variables
GRID = "linear(x, (x1, x2), y, (y1, y2), ((z11, z12), (z21, z22)))"

USAGE = {
    **{kind: f"{kind}(x, (x1, x2, x3), (y1, y2, y3))" for kind in KINDS},
    "column": 'column("curve.csv", "force")',
    "noise": "noise(time, 10 ms, 1)",
}
# what functions divide by, which must not be zero: a second argument, or made of a matrix or an axis
DIVISORS = {
    "mod": "length", "stairs": "tread", "pwm": "period", "inverse": "determinant", "solve": "determinant", "rotation": "axis",
}  # fmt: skip
SINGULAR = 1e-14  # of the sum of the sizes of its terms: a smaller determinant is rounding
_GRID = ("x", "xs", "y", "ys", "rows")  # arguments of a table of two variables
_COUNTS = {**dict.fromkeys(KINDS, 3), "column": 2, "noise": 3}
_HEADER = re.compile(r"(.*?)[ \t]*(?:\[(.*)\])?")


@dataclass(frozen=True, slots=True)
class Arguments:
    """Readers of the arguments of a call, and the list that collects the checks left to each instance."""

    value: Callable[[tree.ExpressionSyntax], Value]
    scalar: Callable[[tree.ExpressionSyntax], Typed]
    checks: list[Check]


def compile_table(arguments: Arguments, node: tree.Call) -> Value:
    """A call of one of the functions in `USAGE`. Raises `Wrong`."""
    if node.function in KINDS and len(node.arguments) == len(_GRID):
        return _surface(arguments, node)
    if len(node.arguments) != _COUNTS[node.function] and (node.function, len(node.arguments)) != ("monotone", 4):
        count = f"{_COUNTS[node.function]} arguments"
        raise Wrong(WrongArguments(node.span, node.function, count, len(node.arguments), USAGE[node.function]))
    if node.function == "column":
        column = read_column(node, _texts(arguments, node))
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
    places, values, *chosen = (_points(arguments, node, argument) for argument in node.arguments[1:])
    at = [(x, node.arguments[0].span), *_placed(places, node.arguments[1])]
    unit = common_dimension(at, f"What `{node.function}` is asked at and its places need one unit") or ONE
    placed = _placed(values, node.arguments[2])
    for slope, span in _placed(chosen[0], node.arguments[3]) if chosen else ():
        placed.append((Typed(slope.expression, None if slope.dimension is None else slope.dimension * unit), span))
    what = f"The values of `{node.function}`{' and its slopes, times a place,' if chosen else ''} need one unit"
    dimension = common_dimension(placed, what)
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
    if chosen:
        numbers = [
            [t.expression.value for t in part if isinstance(t.expression, Number)] for part in (places, values, *chosen)
        ]
        if len({len(xs), len(chosen[0]), *map(len, numbers)}) > 1:
            hint = "Every place has one value and one slope, and all are numbers, not parameters."
            raise Wrong(WrongTable(node.arguments[3].span, "The slopes of `monotone` do not fit its points", hint))
        result = sloped(x.expression, *numbers)
    if isinstance(x.expression, Number) and isinstance(result, Apply):
        _ask(result, node)
    return Typed(result, dimension)


def _surface(arguments: Arguments, node: tree.Call) -> Typed:
    """A table of two variables: the tensor product of two curves, a sum over one axis of the curve of each row times its share.

    The share of a row is the curve through 1 at its place and 0 at the others, so values, slopes, bends and bounds are those of curves. Both
    `linear` and `cubic` are linear in their values, so it does not matter over which axis the sum goes: it is the shorter one. Slopes of
    `monotone` are not linear in the values: they are computed here, from all of them.
    """
    kind = node.function
    axes = [_axis(arguments, node, node.arguments[i], node.arguments[i + 1]) for i in (0, 2)]
    rows = _rows(arguments, node, node.arguments[4])
    counts = [len(places) for _, places in axes]
    if len(rows) != counts[0] or any(len(row) != counts[1] for _, row in rows):
        bad = next((row for row in rows if len(row[1]) != counts[1]), None)
        size = f"{len(rows)} rows" if bad is None else f"a row of {len(bad[1])}"
        what = f"`{kind}` of {counts[0]} by {counts[1]} places has {size}"
        raise Wrong(
            WrongTable(
                node.arguments[4].span if bad is None else bad[0].span,
                what,
                f"One row for each place of the first axis: `{GRID}`.",
            )
        )
    placed = [cell for argument, row in rows for cell in _placed(row, argument)]
    dimension = common_dimension(placed, f"The values of `{kind}` need one unit")
    cells = [[t.expression for t in row] for _, row in rows]
    fixed = all(isinstance(z, Number) for row in cells for z in row)
    if kind == "monotone" and not (fixed and all(isinstance(z, Number) for _, places in axes for z in places)):
        hint = "Its slopes follow from all points at once: write numbers, or take `linear` or `cubic`."
        raise Wrong(WrongTable(node.span, "The points of a surface by `monotone` are numbers, not parameters", hint))
    if min(counts) > MAXIMUM_CURVES or (not fixed and counts[0] * counts[1] > MAXIMUM_POINTS):
        hint = f"One side has {MAXIMUM_CURVES} places at most; values that are parameters are {MAXIMUM_POINTS} at most."
        raise Wrong(WrongTable(node.span, f"`{kind}` has {counts[0]} by {counts[1]} places", hint))
    if counts[1] < counts[0]:
        axes, cells = axes[::-1], [list(column) for column in zip(*cells, strict=True)]
    (x, xs), (y, ys) = axes
    units = [[Number(float(i == j)) for j in range(len(xs))] for i in range(len(xs))]
    if kind == "monotone":
        terms = _bicubic(x, y, *([z.value for z in part if isinstance(z, Number)] for part in (xs, ys, *cells)))
    else:
        terms = [
            multiply(table(kind, x, xs, unit), table(kind, y, ys, row)) for unit, row in zip(units, cells, strict=True)
        ]
    for part in (operation for term in terms for operation in operations(term)):
        if part.operator == kind and isinstance(part.operands[1], Number):
            _ask(part, node)
    return Typed(add(*terms), dimension)


def _bicubic(x: Expression, y: Expression, xs: list[float], ys: list[float], *rows: list[float]) -> list[Expression]:
    """A surface of two terms for each row: its curve times its share, and the curve of its slopes across times a curve that is zero at all places."""
    across, along, twists = surface_slopes(xs, ys, rows)
    zeros = [0.0] * len(xs)
    terms = []
    for i, row in enumerate(rows):
        unit = [float(i == j) for j in range(len(xs))]
        terms.append(multiply(sloped(x, xs, unit, zeros), sloped(y, ys, row, along[i])))
        if any((*across[i], *twists[i])):
            terms.append(multiply(sloped(x, xs, zeros, unit), sloped(y, ys, across[i], twists[i])))
    return terms


def _axis(
    arguments: Arguments, node: tree.Call, argument: tree.ExpressionSyntax, listed: tree.ExpressionSyntax
) -> tuple[Expression, tuple[Expression, ...]]:
    """Argument of a table along one axis, and its places there."""
    x, places = arguments.scalar(argument), _points(arguments, node, listed)
    at = [(x, argument.span), *_placed(places, listed)]
    common_dimension(at, f"What `{node.function}` is asked at and its places need one unit")
    if len(places) < 2:
        raise Wrong(
            WrongTable(
                listed.span, f"`{node.function}` has {len(places)} place here", "An axis needs two places or more."
            )
        )
    xs = tuple(t.expression for t in places)
    _settle(arguments, Check(node.function, listed.span, xs, (), _cells(arguments, listed)))
    return x.expression, xs


def _rows(
    arguments: Arguments, node: tree.Call, argument: tree.ExpressionSyntax
) -> list[tuple[tree.ExpressionSyntax, tuple[Typed, ...]]]:
    """Rows of values, each a list written in place, the name of one, or a column of a file, with its place in the text; or those of a matrix."""
    if not isinstance(argument, tree.VectorSyntax):
        rows = rows_of(arguments.value(argument))
        if not rows:
            hint = f"Write one list for each place of the first axis: `{GRID}`."
            raise Wrong(WrongType(argument.span, "A list of rows", f"`{argument.span.words}`", hint))
        return [(argument, row) for row in rows]
    return [(row, _points(arguments, node, row, GRID)) for row in argument.items]


def _ask(result: Apply, node: tree.Call) -> None:
    """Check that a table read at a literal number has a value there. Raises `Wrong`."""
    try:
        evaluate(result, dict[object, float]().__getitem__)
    except OutsideTable as outside:
        hint = "Give it more points, or ask it elsewhere."
        raise Wrong(WrongTable(node.arguments[0].span, str(outside), hint)) from None
    except LookupError:
        pass  # its points are parameters


def _points(
    arguments: Arguments, node: tree.Call, argument: tree.ExpressionSyntax, usage: str = ""
) -> tuple[Typed, ...]:
    """A list of single numbers."""
    value = arguments.value(argument)
    if isinstance(value, Typed) or rows_of(value):
        hint = f"Write {usage or USAGE[node.function]}, the name of a list, or a column of a file."
        raise Wrong(WrongType(argument.span, "A list", sort_of(value), hint))
    if any(t.truth for t in parts_of(value)):
        raise Wrong(WrongType(argument.span, "A list of numbers", "a list of conditions"))
    return parts_of(value)


def _placed(points: Sequence[Typed], argument: tree.ExpressionSyntax) -> list[tuple[Typed, Span]]:
    """Points with their places in the text."""
    if isinstance(argument, tree.VectorSyntax):
        return [(t, item.span) for t, item in zip(points, argument.items, strict=True)]
    return [(t, argument.span) for t in points]


def _cells(arguments: Arguments, argument: tree.ExpressionSyntax) -> tuple[Span, ...]:
    """Places in the text or file of the numbers in a list, if they differ from the place of the argument."""
    if isinstance(argument, tree.Call) and argument.function == "column":
        return read_column(argument, _texts(arguments, argument)).cells
    return tuple(item.span for item in argument.items) if isinstance(argument, tree.VectorSyntax) else ()


def _texts(arguments: Arguments, node: tree.Call) -> list[TextValue | None]:
    """The texts that a call is given; None for an argument that is none."""
    return [getattr(arguments.value(argument), "text", None) for argument in node.arguments]


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
    if check.function in DIVISORS:
        _check_divisor(check, known)
    elif check.function == "noise":
        _check_noise(check, known, [x for x in values if x is not None])
    elif len(known) == len(places):
        _check_rising(check, known)


def must_hold(check: Check, put: Callable[[Expression], Bound | None]) -> list[Expression]:
    """Return expressions that are negative where `check_static` raises `Wrong`; `put` returns one over what is known before the run, else None."""
    places, values = ([x.expression for x in map(put, part) if x is not None] for part in (check.places, check.values))
    if check.function == "noise":
        whole = [call("equal", x, call("floor", x)) for x in values]
        conditions = [*(call("less", ZERO, x) for x in places), *whole]
    elif check.function in DIVISORS and len(places) == len(check.places):
        size = places[0] if check.function == "pwm" else call("abs", places[0])
        least = multiply(Number(SINGULAR), places[-1]) if len(places) > 1 else ZERO
        conditions = [call("less", least, size)]
    else:
        conditions = [call("less", a, b) for a, b in pairwise(places) if check.function in KINDS]
    guards = [g.expression for g in map(put, check.guards) if g is not None and check.function not in KINDS]
    signs = [select(x, Number(1.0), Number(-1.0)) for x in conditions]
    return [reduce(lambda sign, guard: select(guard, sign, Number(1.0)), guards, sign) for sign in signs]


def settle_divisor(checks: list[Check], function: str, span: Span, *sizes: Expression) -> None:
    """Check what a function in `DIVISORS` divides by, or leave that to each instance; a second size is that without rounding."""
    check = Check(function, span, sizes, ())
    if all(isinstance(size, Number) for size in sizes):
        _check_divisor(check, [size.value for size in sizes if isinstance(size, Number)])
    else:
        checks.append(check)


def _check_divisor(check: Check, sizes: Sequence[float]) -> None:
    """Raise `Wrong` for a divisor of zero, and for a period that is not positive."""
    positive = check.function == "pwm"
    if sizes and (abs(sizes[0]) <= SINGULAR * sizes[-1] * (len(sizes) > 1) or (positive and sizes[0] < 0)):
        hint = "A period is positive." if positive else "Give it another value."
        hint = "Its rows, or its columns, depend on each other; give it other values." if len(sizes) > 1 else hint
        value = f"{sizes[0]:g}{' up to rounding' * (sizes[0] != 0 and not positive)}"
        raise Wrong(WrongTable(check.span, f"The {DIVISORS[check.function]} of `{check.function}` is {value}", hint))


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


@dataclass(frozen=True, slots=True)
class MeasuredColumn:
    """One column in SI; `cells` are its places in the file."""

    values: tuple[float, ...]
    dimension: Dimension
    cells: tuple[Span, ...]


def read_column(node: tree.Call, texts: Sequence[TextValue | None]) -> MeasuredColumn:
    """The column that a call of `column` names by two texts. Raises `Wrong`."""
    first, second = texts if len(texts) == 2 else (None, None)
    if first is None or second is None:
        hint = 'The texts name a file beside this one, and a column: `column("curve.csv", "force")`.'
        raise Wrong(WrongColumn(node.span, "`column` needs two texts", hint))
    file, name = first.file, second.value
    path = locate(node.arguments[0].span, first.value, file)
    if path not in file.sheets:
        file.sheets[path] = read_sheet(node.arguments[0].span, first.value, path)
    sheet = file.sheets[path]
    names = [_HEADER.fullmatch(name).group(1) for name in sheet.names]  # type: ignore[union-attr]
    if names.count(name) != 1:
        hint = suggestion(name, names, f"It has: {', '.join(f'`{n}`' for n in names)}.")
        what = "There is no" if name not in names else "There is more than one"
        raise Wrong(WrongColumn(node.arguments[1].span, f"{what} column `{name}` in {first.value}", hint))
    return _column(node, sheet, names.index(name))


def locate(span: Span, name: str, file: FileScope) -> Path:
    """A file of columns in the project folder. Raises `Wrong`."""
    if file.source.path is None:
        hint = "Save the model as a file to read columns from files beside it."
        raise Wrong(WrongColumn(span, f"`{name}` cannot be found: this text is no file", hint))
    target = (file.source.path.parent / name).resolve()  # links are resolved before the check
    # a part of the library, in a text that is no file
    root = file.root if file.root is not None else file.source.path.parent
    if not within_project(target, root, file.library):
        hint = "Only files below the project folder are read, as with `import`."
        raise Wrong(WrongColumn(span, f"`{name}` lies outside the project folder", hint))
    if target.suffix.lower() != ".csv" or not is_there(target):
        near = [p.name for p in file.source.path.parent.glob("*.csv")]
        hint = suggestion(name, near, "The path is relative to the file that names it, and ends in `.csv`.")
        raise Wrong(WrongColumn(span, f"There is no file of columns `{name}`", hint))
    return target


def _column(node: tree.Call, sheet: Sheet, number: int) -> MeasuredColumn:
    """The numbers of one column, in the unit of its header. Raises `Wrong`."""
    _, scale = heading(node, sheet.names[number], sheet.headers[number])
    values, cells = [], []
    for row in sheet.rows:
        cell = row[number] if number < len(row) else Span(sheet.source, row[-1].end, row[-1].end)
        text = word_of(cell)
        value = _number(text)
        if value is None:
            what = f"A number is missing in {sheet.source.name}, line {cell.line}"
            if text:
                what = f"`{text}` in {sheet.source.name}, line {cell.line}, is no number"
            hint = "Numbers have a point, not a comma, and no unit: units stand in the header."
            raise Wrong(WrongColumn(node.span, what, hint, ((cell, "this cell"),)))
        values.append(float(value) if scale is None else scale.to_si(value))
        cells.append(cell)
    return MeasuredColumn(tuple(values), ONE if scale is None else scale.dimension, tuple(cells))


def heading(node: tree.ExpressionSyntax, text: str, place: Span) -> tuple[str, Scale | None]:
    """The name in a header, and the scale of its unit (None: a bare number). `node` names the file. Raises `Wrong`."""
    header = _HEADER.fullmatch(text)
    assert header is not None
    unit = header.group(2)
    parsed = None if unit is None else _unit(node, unit, place, place.source.name)
    return header.group(1).strip(), None if parsed is None else scale_of(parsed)


def _unit(node: tree.ExpressionSyntax, unit: str, header: Span, name: str) -> tree.Unit | None:
    """The unit of a header, read as after a number."""
    try:
        literal = parse_expression(Source(name, f"1 [{unit}]"))
        if isinstance(literal, tree.Literal) and literal.unit is not None:
            scale_of(literal.unit)
            return None if literal.unit.factors == () and literal.unit.number == 1 else literal.unit
    except (CompilationFailed, Wrong):
        pass
    hint = "In brackets stands one unit, as in `2 [N*m]`; a bare number has none."
    raise Wrong(WrongColumn(node.span, f"`{unit}` in {name} is not a unit", hint, ((header, "this header"),)))


def _number(text: str) -> Fraction | None:
    if len(text) > 400 or not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?", text):
        return None
    return Fraction(text) if math.isfinite(float(text)) else None
