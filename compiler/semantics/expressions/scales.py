"""Units as they are written: symbols, prefixes and powers become scales."""

from __future__ import annotations

import math
import re

from ...errors import CompilationFailed
from ...graph.units import ONE, UNITS, Scale
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ...syntax.tree import Literal
from ..names.errors import DimensionMismatch, UnknownUnit
from ..names.foreign_words import unit_advice
from ..names.statement_errors import Wrong, suggestion


def scale_of(unit: tree.Unit) -> Scale:
    """The scale of a unit as written."""
    key = (*[(symbol, exponent) for symbol, exponent, _ in unit.factors], unit.number)
    found = _SCALES.get(key)
    if found is None:
        found = _scale_of(unit)
        if len(_SCALES) < 4096:
            _SCALES[key] = found
    return found


_SCALES: dict[tuple[object, ...], Scale] = {}  # a large file has many quantities and few units


def _scale_of(unit: tree.Unit) -> Scale:
    result = Scale(ONE, unit.number)
    for symbol, exponent, span in unit.factors:
        scale = UNITS.get(symbol)
        if scale is None:
            raise Wrong(UnknownUnit(span, f"`{symbol}` is not a unit", _unit_advice(symbol)))
        if scale.offset and (len(unit.factors) > 1 or exponent != 1):
            what = f"`{symbol}` is an absolute temperature and cannot stand in a product"
            raise Wrong(UnknownUnit(span, what, "Use K."))
        raised = scale if exponent == 1 else scale**exponent
        if raised is None:
            hint = "Convert it first."
            raise Wrong(UnknownUnit(span, f"`{symbol}^({exponent})` is no rational number of SI units", hint))
        result = raised if len(unit.factors) == 1 and unit.number == 1 else result * raised
    return result


def is_absolute(unit: tree.Unit) -> bool:
    """Return True for a unit of temperature with an offset from 0 K."""
    return any(UNITS[symbol].offset for symbol, _, _ in unit.factors if symbol in UNITS)


def is_decibel(unit: tree.Unit) -> bool:
    """Return True for a ratio in dB, which is no scale."""
    return [symbol for symbol, _, _ in unit.factors] == ["dB"]


def counts_radians(unit: str) -> bool:
    """Return True for the text of a unit that has an angle: rad/s and rpm are no frequencies where cycles are counted."""
    return re.search(r"(rad|rev|deg|rpm)\b", unit) is not None


def counts_cycles(unit: str) -> bool:
    """Return True for the text of a unit that is a frequency."""
    return re.fullmatch(r"\[?\s*[a-zA-Zµ]?Hz\s*\]?", unit) is not None


def check_cycles(*frequencies: tree.ExpressionSyntax) -> None:
    """Raise `Wrong` if one of some frequencies, which count cycles, is written as a rate of an angle."""
    for node in frequencies:
        if isinstance(node, tree.Literal) and node.unit is not None and counts_radians(node.unit.span.text):
            cycles = scale_of(node.unit).to_si(node.number) / (2 * math.pi)
            what = f"A frequency counts cycles here, and `{node.span.text}` an angle"
            raise Wrong(DimensionMismatch(node.span, what, f"Write `{cycles:.10g} Hz`."))


def _unit_advice(symbol: str) -> str:
    if symbol == "dB":
        return "A ratio in dB stands alone after its number: `20 dB`."
    if symbol.startswith("_"):
        return "Digits stand without separators: `1000`."
    return unit_advice(symbol) or suggestion(symbol, list(UNITS), "See the list of units in the language reference.")


def bare(expression: tree.ExpressionSyntax) -> bool:
    """Return True for a number without unit, with or without a sign."""
    if isinstance(expression, tree.Negative):
        return bare(expression.operand)
    return isinstance(expression, tree.Literal) and expression.unit is None


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
