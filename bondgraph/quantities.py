"""Quantities that stand alone in a call or on the command line: `20 ms`, `1 kHz`, `-3 N/m`; a bare number only of what has no other unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from .errors import UsageError

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?)\s*(.*?)\s*", re.DOTALL)
_IN_BRACKETS = re.compile(r"\[.*?\]")
_TRUTHS = {"true": 1.0, "false": 0.0}
_SECOND_UNIT = re.compile(r"[*/]\s*([A-Za-z]+)")


def quantity(text: str | float, unit: str, what: str) -> float:
    """Return the value in SI of a text, or of a number in SI; `unit` is that of its kind. Raises `UsageError`, with `what` for the purpose.

    A text without a unit is refused as in a setting: but for zero, wherever the kind, or the author, has a unit that makes it another number.
    """
    from compiler.api import CompilationFailed, readings

    if not isinstance(text, str):
        return float(text)
    if unit == "1" and text.strip() in _TRUTHS:
        return _TRUTHS[text.strip()]
    found = _NUMBER.fullmatch(text)
    if found is not None:
        number, own = Fraction(found[1]), unit_written(text)
        try:
            if own:
                return _in_si(number, own, unit, what)
            both = () if unit in ("1", "Hz") else readings(found[1], unit)
            if not both:
                return float(number)
            raise UsageError(
                "BR622", f"{what} is in {unit}, but `{text.strip()}` is a bare number;", f"write {' or '.join(f'`{one}`' for one in dict.fromkeys(both))}"
            )  # fmt: skip
        except (CompilationFailed, OverflowError):
            pass  # no unit, or too large: the same error as for a unit of another kind
    kind = "without a unit" if unit == "1" else f"in {unit}"
    raise UsageError("BR604", f"{what}: `{text.strip()}` is no quantity {kind};", "write a number with its unit")


def _in_si(number: Fraction, own: str, unit: str, what: str) -> float:
    """Return a number in a unit of the kind of another, in SI. Raises `CompilationFailed`, `OverflowError` for one that is not."""
    from compiler.api import Source, counts_radians, read_unit

    if own == "dB" and unit in ("1", "dB"):
        return math.pow(10.0, float(number / 20))
    scale, kind = read_unit(Source(what, own)), read_unit(Source(what, "1" if unit == "dB" else unit))
    value: float = scale.to_si(number)
    if scale.dimension != kind.dimension or not math.isfinite(value) or (unit == "Hz" and counts_radians(own)):
        raise OverflowError
    return value


def quantities(text: str, unit: str, what: str) -> list[float]:
    """Return the values of `1 mm, 2 mm`, or of `1 mm .. 2 mm : 11` with both ends. Raises `UsageError`."""
    low, dots, rest = text.partition("..")
    if not dots:
        return [quantity(part, unit, what) for part in text.split(",")]
    high, colon, count = rest.partition(":")
    if not colon or not count.strip().isdigit() or not 2 <= int(count) <= 1_000_000:
        raise UsageError(
            "BR605", f"{what}: a range is written `LOW .. HIGH : COUNT`, with 2 values or more; this is `{text.strip()}`",
        )  # fmt: skip
    first, last, steps = quantity(low, unit, what), quantity(high, unit, what), int(count) - 1
    return [first + (last - first) * i / steps for i in range(steps + 1)]


def unit_written(text: str) -> str:
    """Return the unit behind the number of a text; "" where there is none."""
    found = _NUMBER.fullmatch(text)
    return "" if found is None else found[2].removeprefix("[").removesuffix("]")


def refuse_two_readings(values: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    """Raise `UsageError` for texts with a unit such as `N/m` that in the model is `N` over its own length `m`: the text of a setting is read so."""
    from compiler.api import Source, read_unit

    for what, value in values.items():
        for text in (value,) if isinstance(value, str) else value if isinstance(value, Sequence) else ():
            for name in _SECOND_UNIT.findall(_IN_BRACKETS.sub("", text) if isinstance(text, str) else ""):
                own = known.get(name)
                if (
                    own is None
                    or read_unit(Source(what, own.unit)).dimension != read_unit(Source(what, name)).dimension
                ):
                    continue
                raise UsageError(
                    "BR621", f"{what}: `{text.strip()}` has two readings, since `{name}` is a name of the model, too;",
                    "write the unit in brackets, as in `3 [N/m]`",
                )  # fmt: skip


def in_unit(value: float, unit: str, kind: str, what: str) -> float:
    """Return a value in SI, of a `kind` such as `N/m`, in another unit of that kind; a percentage of a bare number. Raises `UsageError`."""
    from compiler.api import CompilationFailed, Source, read_unit

    try:
        scale, own = (read_unit(Source(what, u)) for u in (unit, kind))
    except CompilationFailed:
        raise UsageError("BR606", f"{what}: `{unit}` is no unit") from None
    if scale.dimension != own.dimension:
        raise UsageError("BR607", f"{what}: it is in {kind}, not in {unit}")
    return float(scale.from_si(value))


def behind(unit: str) -> str:
    """Return a unit as text after a number; empty for a bare number."""
    return "" if unit in ("", "1") else f" {unit}"


def listed(names: Sequence[str], most: int = 6) -> str:
    """Return names as text, in quotes, up to `most` of them."""
    return ", ".join(f"`{n}`" for n in names[:most]) + ("…" if len(names) > most else "")
