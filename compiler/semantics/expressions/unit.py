"""A unit on its own, outside of any expression."""

from __future__ import annotations

from ...errors import CompilationFailed
from ...graph.units import Scale
from ...source import Source, Span
from ...syntax import parse_expression
from ...syntax.tree import Literal
from ..names.errors import UnknownUnit
from ..names.statement_errors import Wrong
from .scales import counts_radians, scale_of


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


def readings(number: str, unit: str) -> tuple[str, ...]:
    """Return a bare number in the place of one in `unit`, which it fits, with the unit and as it is; nothing for a zero that is one in all units."""
    scale = None if unit == "dB" else read_unit(Source("unit", unit))
    if not number.strip("+-0. ") and scale is not None and not scale.offset:
        return ()
    if scale is None:
        return (f"{number} dB",)
    other = "rad" if counts_radians(unit) else "K" if scale.offset else ""
    itself = number if other else f"{scale.from_si(float(number.replace(' ', ''))):.12g}"
    written = unit if unit.isalpha() or unit == "%" else f"[{unit}]"
    return f"{number} {written}", f"{itself} {other or written}"
