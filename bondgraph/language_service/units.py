"""Units that may stand behind a number: those of the wanted dimension, else the usual ones."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import cache

from compiler.api import PREFIXES, UNITS, Dimension

from .answers import Suggestion
from .context import Context
from .facts import number

USUAL = tuple(
    "m mm um s ms kg g N kN V mV A mA ohm kohm Hz kHz rad deg rpm Pa bar K degC J W C F uF H mH".split()  # noqa: SIM905
    + "m^2 m^3 m/s m/s^2 N/m N*s/m N*m kg*m^2".split()  # noqa: SIM905
)
RARE = frozenset({"c", "d", "h"})  # prefixes that are offered last


@cache
def _of(dimension: Dimension) -> tuple[str, ...]:
    """Symbols of a dimension: the SI unit first, rare prefixes last."""
    listed = [symbol for symbol, scale in UNITS.items() if scale.dimension == dimension and symbol.isascii()]
    return tuple(
        sorted(listed, key=lambda s: (s[0] in RARE and s[1:] in UNITS, abs(math.log10(UNITS[s].number)), len(s), s))
    )


def unit_suggestions(dimension: Dimension | None, context: Context) -> Iterator[Suggestion]:
    """Yield units, in brackets where a unit of several symbols would else not be one."""
    words = context.statement
    bare = bool(words) and words[-1].kind == "number"
    symbols = list(_of(dimension)) if dimension is not None else USUAL
    if dimension is not None and str(dimension) not in symbols and str(dimension) != "1":
        symbols = [str(dimension), *symbols]
    for symbol in symbols:
        scale = UNITS.get(symbol)
        detail = "" if scale is None or scale.offset else f"{number(scale.to_si(Fraction(1)))} {scale.dimension}"
        several = not symbol.isidentifier() and symbol != "%"
        yield Suggestion(symbol, "unit", detail, "", f"[{symbol}]" if several and bare else symbol)
    if dimension is None:
        yield from (
            Suggestion(s, "unit", str(UNITS[s].dimension)) for s in UNITS if s not in USUAL and s[0] not in PREFIXES
        )


def units_beside(unit: str) -> Iterator[str]:
    """Yield units of the same dimension as one in SI, as they stand behind a number."""
    of_it = next((_of(scale.dimension) for scale in UNITS.values() if str(scale.dimension) == unit), ())
    yield from (
        f"[{s}]" if re.search("[*/^]", s) else s for s in dict.fromkeys((*of_it, *([unit] if unit != "1" else ())))
    )
