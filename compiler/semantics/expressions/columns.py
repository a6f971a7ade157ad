"""Columns of measured values: `column("curve.csv", "force")`.

The files lie in the project folder. A header gives name and unit of each column:

    # a comment
    position [mm], force [N]
    0, 0.1
    1.5, 0.25
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from ...errors import CompilationFailed
from ...fast_dataclass import dataclass
from ...graph.units import ONE, Dimension, Scale
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ..names.column_file import Sheet, read_sheet, word_of
from ..names.errors import WrongColumn
from ..names.project_folder import is_there, within_project
from ..names.scope import FileScope, TextValue
from ..names.statement_errors import Wrong, suggestion
from .scales import scale_of

_HEADER = re.compile(r"(.*?)[ \t]*(?:\[(.*)\])?")


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
