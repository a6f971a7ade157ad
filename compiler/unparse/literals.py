"""The smallest pieces of text: numbers, units, descriptions, comments, names, and bonds in chains."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any

from ..errors import CompilationFailed, Diagnostic, InternalError, printable
from ..graph.units import Dimension
from ..semantics.expressions.scales import read_unit
from ..source import Source, Span
from .errors import UnwrittenUnit

MAXIMUM_FAN = 12  # places of one line


class NotWritable(Exception):
    """Something that cannot be written. Its place is added by a caller."""

    def __init__(self, kind: Callable[..., Diagnostic], **values: Any) -> None:
        self.kind, self.values = kind, values
        super().__init__(values)

    def diagnostic(self, span: Span, name: str) -> Diagnostic:
        return self.kind(span, name, **self.values)


def number_text(value: float) -> str:
    """A finite number that is read back as the same double, also beyond the range of the language's literals."""
    size = abs(value)
    if size and not 1e-299 < size < 1e299:  # powers of two cost no digit
        return f"{value * 2.0**600!r}/2^600" if size < 1 else f"{value / 2.0**600!r}*2^600"
    short = f"{value:.6g}"
    if float(short) == value:
        return short
    return repr(int(value)) if value == int(value) and size < 1e15 else repr(float(value))


@cache
def dimension_of(unit: str) -> Dimension:
    """Dimension of a unit in the notation of graphs. Raises `NotWritable` if the language cannot read it."""
    try:
        return read_unit(Source("unit", unit)).dimension
    except CompilationFailed:
        raise NotWritable(UnwrittenUnit, unit=unit) from None


def unit_text(dimension: Dimension) -> str:
    """SI unit of a dimension. Raises `NotWritable` if the language cannot write it."""
    if any(abs(e.numerator) > 20 or e.denominator > 20 for e in dimension.exponents):
        raise NotWritable(UnwrittenUnit, unit=str(dimension))
    return str(dimension)


def unit_after(dimension: Dimension) -> str:
    """Unit as it follows a number: in brackets, unless it is one symbol."""
    unit = unit_text(dimension)
    return f" {unit}" if unit.isidentifier() else f" [{unit}]"


def word_of(name: str) -> str | None:
    """`mass` for the names `mass` and `mass[2]`; None for an invalid name."""
    match = re.fullmatch(r"([A-Za-z_][A-Za-z_0-9]*)(\[(?:0|[1-9][0-9]{0,8})\])?", name)
    return None if match is None else match.group(1)


def braces(attributes: Iterable[str]) -> str:
    """Attributes as they follow a declaration."""
    inner = ", ".join(attributes)
    return f" {{ {inner} }}" if inner else ""


def description_text(text: str) -> str:
    """A description as it follows a declaration. Descriptions from a text have neither quotation marks nor line breaks."""
    if '"' in text or "\n" in text:
        raise InternalError(f"a description that no text can have: {text!r}")
    return f' "{text}"' if text else ""


def former_name(before: str, now: str) -> str:
    """Comment with the name in the graph, if the text has another."""
    return "" if before == now else f"  # {printable(before.replace(chr(9), ' '))}"


def bond_lines(bonds: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    """Bonds (tail, arrow, head) as chains and fans that are read back in the same order."""
    groups: list[list[str]] = []
    arrows: list[str] = []
    for tail, arrow, head in bonds:
        short = bool(groups) and len(groups) + len(groups[-1]) < MAXIMUM_FAN
        if short and groups[-2] == [tail] and arrows[-1] == arrow:
            groups[-1].append(head)
        elif short and groups[-1] == [tail]:
            groups.append([head])
            arrows.append(arrow)
        else:
            yield from _chain(groups, arrows)
            groups, arrows = [[tail], [head]], [arrow]
    yield from _chain(groups, arrows)


def _chain(groups: list[list[str]], arrows: list[str]) -> Iterator[str]:
    if groups:
        yield "".join(f"{', '.join(g)} {a} " for g, a in zip(groups, arrows, strict=False)) + ", ".join(groups[-1])
