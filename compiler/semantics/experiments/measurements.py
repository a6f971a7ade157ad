"""Files of measurements for `fit`, in the project folder. Their headings are quantities of the model with units."""

from __future__ import annotations

import re
from functools import partial

from ...errors import CompilationFailed
from ...graph.units import ONE, SECOND, Dimension
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ..expressions.columns import heading, locate
from ..names.column_file import read_sheet
from ..names.errors import WrongColumn
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong, describe
from ..network.elaborate import Elaborator
from .step_attributes import together

_OF_MODES = re.compile(r"(frequency|damping) [1-9][0-9]*")
_SIGMA = "sigma "


def read_headings(
    elaborator: Elaborator, text: tree.TextSyntax, root: Scope, sought: set[str]
) -> tuple[str, tuple[str, ...]]:
    """Return the file name as written and the names of the measured quantities.

    Raises `Wrong` or `AlreadyTold` unless the model has every quantity of the headings, in such units.
    """
    path = locate(text.span, text.value, root.definition.file)
    sheet = read_sheet(text.span, text.value, path)
    columns = zip(sheet.names, sheet.headers, strict=True)
    found = together(elaborator, *(partial(_column, elaborator, text, root, sought, column) for column in columns))
    measured = tuple(name for name in found if name)
    if not measured:
        hint = "A column of an output, or of `frequency 1 [Hz]`, says what was found."
        raise Wrong(WrongColumn(text.span, f"Nothing is measured in {text.value}", hint))
    return text.value, measured


def _column(
    elaborator: Elaborator, text: tree.TextSyntax, root: Scope, sought: set[str], head: tuple[str, Span]
) -> str:
    """Name of the measured quantity in a column; "" for a column of anything else. Raises `Wrong`."""
    written, place = head
    name, scale = heading(text, written, place)
    bare = name.removeprefix(_SIGMA)
    wanted, is_set = _kind(elaborator, text, root, bare, place)
    if is_set and bare in sought:
        hint = "What is looked for has one value for all lines."
        what = f"`{bare}` is looked for, and set line by line"
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    found, named = ONE if scale is None else scale.dimension, elaborator.quantities.get(bare)
    if named is not None and named.counted and "[" not in written:
        what = f"`{bare}` is in {named.counted}, but {text.value} has it without a unit"
        hint = f"Write `{bare} [{named.counted}]`, or `{bare} [1]` for bare numbers."
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    if found != wanted:
        what = f"`{bare}` is {describe(wanted)}, but {text.value} has it {'without a unit' if scale is None else describe(found)}"
        raise Wrong(WrongColumn(text.span, what, "Headings are names with units: `x [um]`.", ((place, "this header"),)))
    return "" if is_set or name != bare or bare == "time" else bare


def _kind(elaborator: Elaborator, text: tree.TextSyntax, root: Scope, name: str, place: Span) -> tuple[Dimension, bool]:
    """Dimension of the quantity in a heading, and True if the person who measures sets it."""
    if name == "time":
        return (ONE if root.plain else SECOND), False
    if _OF_MODES.fullmatch(name):
        return (ONE if name.startswith("damping") or root.plain else ONE / SECOND), False
    try:
        path = parse_expression(Source(text.value, name))
        scalar = elaborator.lookup(path, root) if isinstance(path, tree.PathSyntax) else None
    except (CompilationFailed, Wrong):
        scalar = None
    if not isinstance(scalar, Scalar):
        what = f"`{name}` in {text.value} is nothing that the model has"
        hint = "A heading is `time [s]`, `frequency 1 [Hz]`, a quantity of the model, or `sigma` before one of these."
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    return scalar.dimension or ONE, scalar.role in ("parameter", "input")
