"""Numbers, lists and matrices, number by number: their shapes, sums, products and choices, and the places of their entries in messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...algebra.expression import Expression, add, negate, select
from ...graph.units import Dimension
from ...source import Span
from ...syntax import tree
from ..names.errors import DimensionMismatch, TooMany, WrongType
from ..names.statement_errors import Wrong, describe
from .template import Matrix, Shape, Typed, Value, Vector, common_dimension, times

MAXIMUM_TERMS = 100_000  # of one product of matrices


def rows_of(value: Value) -> Matrix:
    """Return the rows of a matrix; none of any other value."""
    return () if isinstance(value, Typed) else tuple(row for row in value if isinstance(row, tuple))


def parts_of(value: Value) -> Vector:
    """Return the numbers of a value, those of a matrix row by row."""
    if isinstance(value, Typed):
        return (value,)
    return tuple(part for item in value for part in (item if isinstance(item, tuple) else (item,)))


def columns_of(value: Value) -> int:
    """Return the length of the rows of a matrix; 0 for any other value."""
    return len(next(iter(rows_of(value)), ()))


def shape_of(value: Value) -> Shape:
    """Return the shape of a value; that of a single number is (0, 0)."""
    return (0, 0) if isinstance(value, Typed) else (len(parts_of(value)), columns_of(value))


def fitted(value: Value, like: Value) -> Value:
    """Return the list of one that a single number stands for where the other value is such a list: a matrix of one row times a list is a number."""
    return (value,) if isinstance(value, Typed) and shape_of(like) == (1, 0) else value


def shaped(parts: Sequence[Typed], columns: int) -> Vector | Matrix:
    """Return a list, or a matrix with rows of so many columns."""
    if not columns:
        return tuple(parts)
    return tuple(tuple(parts[i : i + columns]) for i in range(0, len(parts), columns))


def sort_of(value: Value) -> str:
    """Return the sort of a value, in words."""
    if isinstance(value, Typed):
        return "a single number"
    return f"a matrix of {len(value)} by {columns_of(value)}" if rows_of(value) else f"a list of {len(value)}"


def place_in(value: Value, number: int) -> str:
    """Return the place of one of the numbers of a list or matrix as it is written behind its name: `[2]`, `[1, 2]`; of a single number nothing."""
    return "" if isinstance(value, Typed) else place(number, columns_of(value))


def place(number: int, columns: int) -> str:
    """Return the place of a number in a list, or in a matrix of so many columns."""
    return f"[{number // columns + 1}, {number % columns + 1}]" if columns else f"[{number + 1}]"


def each(f: Callable[[Typed], Typed], value: Value) -> Value:
    """Apply a function of one number to a number or to each item of a list."""
    return f(value) if isinstance(value, Typed) else shaped([f(part) for part in parts_of(value)], columns_of(value))


def item_of(value: Value, node: tree.PathSyntax) -> Value:
    """Return `points[2]` or `A[1, 2]` in a function, where `points` and `A` are parameters of it. Raises `Wrong`."""
    indices = node.steps[0].items if len(node.steps) == 1 and isinstance(node.steps[0], tree.Index) else ()
    literals = [i.number for i in indices if isinstance(i, tree.Literal)]
    if isinstance(value, Typed) or not literals or len(literals) < len(indices):
        raise Wrong(WrongType(node.span, "An item of a list, as `points[2]`", f"`{node.words}`"))
    item: Value = value
    for number in literals:
        if not isinstance(item, tuple) or number not in range(1, len(item) + 1):
            hint = "Items, rows and columns count from 1."
            raise Wrong(WrongType(node.span, f"An item of {sort_of(value)}", f"`{node.words}`", hint))
        item = item[int(number) - 1]
    return item


def total(terms: Sequence[tuple[int, Span, Value]]) -> Value:
    """Return the sum of terms, each with its sign and place. Raises `Wrong` for other shapes or units."""
    first = next((v for _, _, v in terms if isinstance(v, tuple)), terms[0][2])
    for _, span, value in terms:
        if shape_of(fitted(value, first)) != shape_of(first):
            other = sort_of(value) if isinstance(value, tuple) else f"the single number `{span.text}`"
            hint = f"Only lists of one length can be added, and matrices of one size; one item is `name{place_in(first, 0)}`."
            raise Wrong(WrongType(span, sort_of(first).capitalize(), other, hint))
    totals = []
    for number, column in enumerate(zip(*(parts_of(v) for _, _, v in terms), strict=True)):
        entry = place_in(first, number)
        what = f"The entries {entry} cannot be added" if entry else "These cannot be added"
        dimension = common_dimension([(t, span) for (_, span, _), t in zip(terms, column, strict=True)], what)
        signed = (t.expression if s > 0 else negate(t.expression) for (s, _, _), t in zip(terms, column, strict=True))
        totals.append(Typed(add(*signed), dimension))
    return shaped(totals, columns_of(first)) if isinstance(first, tuple) else totals[0]


def selected(condition: Expression, first: tuple[Value, Span], second: tuple[Value, Span]) -> Value:
    """Return the first value where the condition holds, else the second. Raises `Wrong` for other shapes or units."""
    (value, place), (otherwise, span) = first, second
    value, otherwise = fitted(value, otherwise), fitted(otherwise, value)
    if shape_of(value) != shape_of(otherwise):
        raise Wrong(WrongType(span, sort_of(value).capitalize(), sort_of(otherwise), "Both branches have one size."))
    chosen = []
    for number, (a, b) in enumerate(zip(parts_of(value), parts_of(otherwise), strict=True)):
        entry = place_in(value, number)
        what = f"Both branches need one unit{f' in {entry}' * bool(entry)}"
        dimension = common_dimension([(a, place), (b, span)], what)
        chosen.append(Typed(select(condition, a.expression, b.expression), dimension))
    return shaped(chosen, columns_of(value)) if isinstance(value, tuple) else chosen[0]


def added(terms: Sequence[Typed], span: Span, what: str) -> Typed:
    """Return the sum of terms; `what` says, in an error, what adds them."""
    return Typed(add(*(t.expression for t in terms)), shared_unit(terms, span, what))


def shared_unit(parts: Sequence[Typed], span: Span, what: str) -> Dimension | None:
    """Return the unit that all parts share; None if all are bare zeros. Raises `Wrong`."""
    units = list(dict.fromkeys(part.dimension for part in parts if part.dimension is not None))
    if len(units) > 1:
        words = f"{what} of one unit, but one is {describe(units[0])} and one {describe(units[1])}"
        raise Wrong(
            DimensionMismatch(span, words, "Look at the units of the components, one by one; a bare 0 fits any.")
        )
    return units[0] if units else None


def product(first: Value, second: Value, places: tuple[Span, Span], divides: bool = False) -> Value:
    """Return a matrix times a list, which is a column, or a matrix; a matrix of one row times a list is a number. Raises `Wrong`."""
    left, right = rows_of(first), rows_of(second)
    a, b = (" ".join(span.text.split()) for span in places)
    if divides:
        hint = f"Write `{a}*inverse({b})`."
        if right and isinstance(first, tuple) and not left:
            hint = f"Write `solve({b}, {a})`."
        raise Wrong(
            WrongType(places[1], "A single number", sort_of(second), hint if right else "A list cannot divide.")
        )
    if not left:
        hint = f"A list is a column; `transpose({a})` is the row: `transpose({a})*{b}`."
        hint = hint if right else f"`dot({a}, {b})` and `cross({a}, {b})` multiply two lists."
        raise Wrong(WrongType(places[0], "A matrix", sort_of(first), hint))
    columns: Matrix = tuple(zip(*right, strict=True)) if right else (parts_of(second),)
    if len(columns[0]) != len(left[0]):
        size = f"{'A matrix with' if right else 'A list of'} {len(left[0])}{' rows' * bool(right)}"
        hint = f"`{a}` is {sort_of(first)}: its rows are as long as the columns of what follows."
        raise Wrong(WrongType(places[1], size, sort_of(second), hint))
    if len(left) * len(columns) * len(left[0]) > MAXIMUM_TERMS:
        raise Wrong(TooMany(places[1], "Terms of a product of matrices", MAXIMUM_TERMS))
    number = not right and len(left) == 1
    shape = len(columns) if right else 0
    entries: list[Typed] = []
    for row in left:
        for column in columns:
            what = f"Entry {place(len(entries), shape)} of `{a}*{b}` adds products"
            if number:
                what = f"`{a}*{b}` adds products"
            terms = [times(x, y, 1) for x, y in zip(row, column, strict=True)]
            entries.append(added(terms, places[0].to(places[1]), what))
    return entries[0] if number else shaped(entries, shape)
