"""Template of one place of the text: formulas over slots, with units. The readings of the slots are looked up in each instance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from ...algebra.expression import Apply, Expression, Number, Symbol, call, divide, multiply, negate, substitute, symbols
from ...algebra.formula import Bound, Formula
from ...fast_dataclass import dataclass
from ...graph.network import Law, PortVariable, Reference
from ...graph.units import ONE, Dimension
from ...source import Span
from ...syntax import tree
from ..names.errors import DimensionMismatch, WrongType
from ..names.scope import Scope, TextValue
from ..names.statement_errors import Wrong, describe, unit_hint


@dataclass(frozen=True, slots=True)
class Typed:
    """A formula's expression with its dimension; `truth` marks a condition."""

    expression: Expression
    dimension: Dimension | None
    truth: bool = False
    choices: tuple[str, ...] = ()  # the words that a choice is one of: its expression is a number from 1
    text: TextValue | None = None  # then it has no number


Vector = tuple[Typed, ...]
Matrix = tuple[Vector, ...]  # rows of one length
Value = Typed | Vector | Matrix
Shape = tuple[int, int]  # numbers in a list, and the columns of a matrix, else 0
# Units of the numbers in a list (None: zero, whatever the unit), and the columns; where they follow from a text the numbers.
ListUnits = (
    tuple[tuple[Dimension | None, ...], int] | tuple[tuple[Dimension | None, ...], int, tuple[float | None, ...]]
)


@dataclass(frozen=True, slots=True)
class Slot:
    """Reading of a slot: a path of the text, and the item if it is a list."""

    path: tree.PathSyntax | tree.Call  # a call is `integral(…)`, `delay(…)` or `der(…)`, a signal of its own
    item: int | None
    depth: int | None = None  # of a function's reading: loops around the scope of the function, in which it is read

    @property
    def words(self) -> str:
        """The path as written."""
        return self.path.words if isinstance(self.path, tree.PathSyntax) else f"{self.path.function}(…)"


@dataclass(frozen=True, slots=True)
class Check:
    """Points of a table (period and seed of a noise) as expressions over slots, whose values are known only in an instance."""

    function: str
    span: Span
    places: tuple[Expression, ...]
    values: tuple[Expression, ...]
    cells: tuple[Span, ...] = ()  # places of the numbers in the text
    guards: tuple[Expression, ...] = ()  # conditions under which it is asked
    cycles: tuple[tree.ExpressionSyntax, ...] = ()  # frequencies, which count cycles

    def under(self, condition: Expression) -> Check:
        """Return the check in a branch of a choice, each part of a conjunction alone: one may be known where another is not."""
        parts, guards = [condition], []
        while parts:
            part = parts.pop()
            negated_part = part.operands[0] if isinstance(part, Apply) and part.operator == "not" else None
            if isinstance(part, Apply) and part.operator == "and":
                parts += part.operands
            elif isinstance(negated_part, Apply) and negated_part.operator == "or":
                parts += [call("not", p) for p in negated_part.operands]
            else:
                guards.append(part)
        return replace(self, guards=(*self.guards, *guards))


@dataclass(frozen=True, slots=True)
class Template:
    """One compiled place in the text: value(s) over slots, and the reading of each slot."""

    value: Value
    slots: tuple[Slot, ...]
    formulas: tuple[Formula, ...]
    checks: tuple[Check, ...] = ()
    # lists that it reads, with the units that they had, and texts
    lists: tuple[tuple[tree.PathSyntax, ListUnits | TextValue], ...] = ()
    # the model's own that it calls; None where a branch that is not taken has one
    functions: tuple[tuple[str, tree.FunctionSyntax | None], ...] = ()


# Quantity of a path, for the compiler of expressions: its dimension, or those of its items.
@dataclass(frozen=True, slots=True)
class Readable:
    """Quantity that a path denotes in an expression."""

    dimensions: tuple[Dimension | None, ...]
    is_list: bool
    values: tuple[float | None, ...] = ()  # of constants
    truth: bool = False
    fixed: bool = False  # numbers of the text: the same in every instance
    choices: tuple[str, ...] = ()
    columns: int = 0  # of a matrix
    text: TextValue | None = None
    by_text: bool = False  # fixed by the texts that it reads, which instances may set


Resolve = Callable[[tree.PathSyntax | tree.Call, Scope], Readable]


@dataclass(frozen=True, slots=True)
class OwnVariable:
    """A law's own variable."""

    own: PortVariable
    dimension: Dimension


@dataclass(frozen=True, slots=True)
class CompiledLaw:
    """A law, the readings of its slots, and the stored quantity of each port (`q` or `p`; empty for a port that stores nothing)."""

    law: Law
    slots: tuple[Slot, ...]
    stored: tuple[str, ...]
    # integrals of its own flow (`q`) or effort (`p`) that the law reads, in the slots after all others
    remembered: tuple[str, ...]
    checks: tuple[Check, ...]  # points of tables, known per instance
    lists: tuple[tuple[tree.PathSyntax, ListUnits | TextValue], ...]  # lists that it reads, with their units, and texts
    # the model's own that it calls; None where a branch that is not taken has one
    functions: tuple[tuple[str, tree.FunctionSyntax | None], ...] = ()
    ports: tuple[str, ...] = ()  # of the element, as many as it is wide


def bind_template(template: Template, formula: Formula, lookup: Callable[[Slot], Reference]) -> Bound:
    """Bind the formula to the readings of its slots in this instance. Only slots that occur in it remain."""
    if not template.slots:
        return Bound(formula, ())
    kept, used = _kept(formula)
    return Bound(kept, tuple([lookup(template.slots[i]) for i in used]))


@lru_cache(4096)
def _kept(formula: Formula) -> tuple[Formula, tuple[int, ...]]:
    """The formula over the slots that occur in it, and their numbers."""
    used = tuple(sorted({s.key for s in symbols(formula.expression) if isinstance(s.key, int)}))
    if used == tuple(range(formula.arity)):
        return formula, used
    renumbered = {old: new for new, old in enumerate(used)}
    return Formula(len(used), substitute(formula.expression, lambda s: Symbol(renumbered[s.key]))), used


# ---------------------------------------------------------------- numbers


def has_value(x: Expression) -> bool:
    """Return False for an operation on numbers that could not be folded, and for a number outside the range of doubles."""
    if isinstance(x, Number):
        return math.isfinite(x.value)
    return not (isinstance(x, Apply) and all(isinstance(o, Number) for o in x.operands))


def negated(value: Typed) -> Typed:
    """-value."""
    return Typed(negate(value.expression), value.dimension)


def times(a: Typed, b: Typed, direction: int) -> Typed:
    """a*b, or a/b if the direction is -1."""
    if direction > 0:
        if a.dimension is None or b.dimension is None:
            return Typed(multiply(a.expression, b.expression), None)
        return Typed(multiply(a.expression, b.expression), a.dimension * b.dimension)
    bottom = b.dimension or ONE
    return Typed(divide(a.expression, b.expression), None if a.dimension is None else a.dimension / bottom)


def no_choice(value: Typed, span: Span) -> Typed:
    """A value that is a number. Raises `Wrong` for a choice or a text."""
    if value.text is not None:
        hint = "Texts name files and columns, in `column`, and are compared by `==` and `!=`."
        raise Wrong(WrongType(span, "A number", f'the text "{value.text.value}"', hint))
    if value.choices:
        hint = f"Compare it: `{span.words} == {value.choices[0]}`."
        raise Wrong(WrongType(span, "A number", f"a choice of {', '.join(value.choices)}", hint))
    return value


def beside(value: Value, node: tree.Product) -> Value:
    """A factor of a product: a zero beside literals with a unit is a bare number, as in `0/1 s`; any other fits any unit."""
    if not isinstance(value, Typed) or value.dimension is not None:
        return value
    literals = [f.unit for _, f in node.factors if isinstance(f, tree.Literal)]
    return Typed(value.expression, ONE) if len(literals) == len(node.factors) and any(literals) else value


def common_dimension(parts: list[tuple[Typed, Span]], what: str) -> Dimension | None:
    """Dimension that all values share; None if all are bare zeros. Raises `Wrong`."""
    known: tuple[Dimension, Span] | None = None
    for value, span in parts:
        if value.dimension is None:
            continue
        if known is None:
            known = (value.dimension, span)
        elif value.dimension != known[0]:
            text = (
                f"{what}: `{known[1].text}` is {describe(known[0])}, but `{span.text}` is {describe(value.dimension)}"
            )
            bare, other = (value.dimension, known[0]) if value.dimension == ONE else (known[0], value.dimension)
            raise Wrong(DimensionMismatch(span, text, unit_hint(bare, other)))
    return None if known is None else known[0]


def bare_number(value: Typed, node: tree.ExpressionSyntax, what: str) -> None:
    """Raise `Wrong` for a quantity with a unit."""
    if value.dimension not in (None, ONE):
        text = f"{what} `{node.span.text}` must be a bare number, but it is {describe(value.dimension)}"
        raise Wrong(DimensionMismatch(node.span, text, "Divide it by a reference of the same unit."))
