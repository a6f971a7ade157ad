"""A unit on its own, outside of any expression."""

from __future__ import annotations

from ...errors import CompilationFailed
from ...graph.units import Scale
from ...source import Source, Span
from ...syntax import parse_expression
from ...syntax.tree import Literal
from ..names.errors import UnknownUnit
from ..names.statement_errors import Wrong
from .scales import scale_of


def read_unit(source: Source) -> Scale:
    """Scale of a text that is one unit, `N*s/m`. Raises `CompilationFailed`."""
    number = Source(source.name, f"1 [{source.text}]")
    found = parse_expression(number)
    if not isinstance(found, Literal) or found.unit is None:
        what = f"`{source.text}` is not one unit"
        raise CompilationFailed([UnknownUnit(Span(number, 0, len(number.text)), what, "Write it as in `[N*s/m]`.")])
    try:
        return scale_of(found.unit)
    except Wrong as wrong:
        raise CompilationFailed([wrong.diagnostic]) from None
