"""Errors of one statement, raised as exceptions while it is read, and the advice of their messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from itertools import islice

from ...algebra.interpolate import OutsideTable
from ...errors import Diagnostic
from ...graph.domains import BUNDLES, DOMAINS
from ...graph.elements import ELEMENTS
from ...graph.units import ONE, Dimension
from ...syntax import tree
from .compound_units import ambiguous_products
from .errors import DimensionMismatch, WrongLaw

MAXIMUM_COMPARED = 500  # names that a suggestion is chosen from: comparing is slow

MAXIMUM_MISTAKES = 200  # errors reported for one file


class NotImportable(Exception):
    """Raised for a file that is no unit, or one that no model can hold; its texts are what is wrong, and advice."""


class Wrong(Exception):
    """An error in one statement. It is collected, and the next statement is read."""

    def __init__(self, diagnostic: Diagnostic) -> None:
        self.diagnostic = diagnostic
        super().__init__(diagnostic.code)


class AlreadyTold(Exception):
    """A reference to a name whose declaration has an error that is already reported."""


def no_law(declaration: tree.Declaration, name: str) -> WrongLaw:
    """Return the error of an element without a law, or with a number or an expression in its place."""
    row, written, start = ELEMENTS[declaration.kind], declaration.definition, f"{declaration.kind} {name} : "
    is_domain = isinstance(written, tree.PathSyntax) and written.head in (*DOMAINS, *BUNDLES)
    if written is None or is_domain or not row.of_value:
        hint = f"Write it after a colon, as in `{start}{row.example}`."
        return WrongLaw(declaration.span, f"`{declaration.kind} {name}` has no law", hint)
    words = (
        written.span.words
        if isinstance(written, tree.PathSyntax | tree.Literal | tree.Call)
        else f"({written.span.words})"
    )
    laws = " or ".join(f"`{start}{law.format(words)}`" for law in row.of_value)
    return WrongLaw(written.span, f"`{written.span.words}` is no law", f"A law is an equation: {laws}.")


def suggestion(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """ "Did you mean …?", if something is close."""
    name = name[:60]
    near = (
        word
        for word in islice(known, 20 * MAXIMUM_COMPARED)
        if min(len(word), len(name)) >= 0.4 * max(len(word), len(name))  # others are never close enough
    )
    close = get_close_matches(name, list(islice(near, MAXIMUM_COMPARED)), n=2, cutoff=0.6)
    if not close:
        return otherwise
    return "Did you mean " + " or ".join(f"`{c}`" for c in close) + "?"


def describe(dimension: Dimension | None) -> str:
    """A dimension in words."""
    if dimension is None:
        return "a bare zero"
    return "a bare number" if dimension == ONE else f"in [{dimension}]"


def unit_hint(found: Dimension | None, wanted: Dimension | None, written: tree.ExpressionSyntax | None = None) -> str:
    """Advice for a quantity of another unit; `written` is its expression in the text."""
    if found == ONE and wanted is not None:
        return f"A number needs its unit, in brackets if it has several symbols: `2 [{wanted}]`; only zero needs none."
    if isinstance(written, tree.Literal) and wanted == ONE:
        return "Write a bare number; an angle may be in `deg`, a share in `percent`."
    if isinstance(written, tree.Literal) and wanted is not None:
        return f"Write a quantity in [{wanted}], as `2 [{wanted}]`."
    otherwise = "Check the units of the names in it, and whether a factor is missing."
    return otherwise if written is None else reading_of(written) or otherwise


def wrong_unit(what: str, wanted: Dimension | None, value: tree.ExpressionSyntax, found: Dimension | None) -> Wrong:
    """Error for an expression in another unit than that of `what`."""
    sentence = f"{what} is {describe(wanted)}, but `{value.span.text}` is {describe(found)}"
    return Wrong(DimensionMismatch(value.span, sentence, unit_hint(found, wanted, value)))


def reading_of(written: tree.ExpressionSyntax) -> str:
    """Return how a unit without brackets is read in an expression, because of a name of the model; "" if there is none."""
    reading = next(ambiguous_products(written, written.span.source), None)
    return "" if reading is None else f"{reading.partition(': ')[2]}."


def reason_of(error: Exception) -> str:
    """Cause of a failed calculation, in words."""
    if isinstance(error, OutsideTable):
        return str(error)
    if isinstance(error, ZeroDivisionError):
        return "a division by zero"
    if isinstance(error, OverflowError):
        return "it overflows"
    return "a root or logarithm of a negative number, or an inverse function outside its range"
