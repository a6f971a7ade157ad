"""Words of other languages, with what stands for them here: functions, units, names and kinds of elements."""

from __future__ import annotations

import re
from collections.abc import Container
from pathlib import Path

from ...graph.units import PREFIXES, UNITS
from ...source import read_text
from ...syntax.outline import Outline

_RATES = (
    "A rate is `der(x)`; elements have theirs, `spring.v` of `spring.x` of a C, `mass.F` of `mass.p` of an I. A law has none: "
    "`I mass : p = m*v` and `C spring : F = k*x` store."
)
_INTEGRAL = "An integral over time is `integral(rate, start)`."
_CURVE = 'A curve through points is `linear(x, xs, ys)`, `cubic(…)` or `monotone(…)`; a column of a file is the list `column("file.csv", "name")`.'
FUNCTIONS = {
    "ddt": _RATES, "diff": _RATES, "int": _INTEGRAL, "integrate": _INTEGRAL, "idt": _INTEGRAL,
    "table": _CURVE, "interp": _CURVE, "interp1": _CURVE,
    "inv": "The inverse of a matrix is `inverse(A)`; `A*x = b` is solved by `solve(A, b)`.", "eye": "The unit matrix is `identity(3)`.",
    "pow": "A power is written with `^`: `a^2`.",
    "round": "A rounded number is `floor(x + 0.5)`.",
    "rem": "A remainder is `mod(x, length)`, of two quantities of one unit.",
    "fmod": "A remainder is `mod(x, length)`, of two quantities of one unit.",
    "pre": "In an event the right sides read the values before it: write the name alone.",
}  # fmt: skip
NAMES = {
    "t": "Time is `time`.",
    "PI": "It is written `pi`.",
    "Pi": "It is written `pi`.",
    "e": "Euler's number is `exp(1)`.",
    "inf": "No number is infinite.",
}
_UNIT_WORDS = {
    "second": "s", "sec": "s", "minute": "min", "hour": "h", "hr": "h", "meter": "m", "metre": "m", "gram": "g", "newton": "N", "volt": "V",
    "amp": "A", "ampere": "A", "ohm": "ohm", "farad": "F", "henry": "H", "watt": "W", "joule": "J", "pascal": "Pa", "hertz": "Hz", "hz": "Hz",
    "kelvin": "K", "celsius": "degC", "degree": "deg", "radian": "rad", "liter": "L", "litre": "L", "l": "L", "pound": "lb", "feet": "ft",
    "foot": "ft", "knot": "kn", "tesla": "T", "weber": "Wb", "coulomb": "C", "siemens": "S", "turn": "rev",
}  # fmt: skip
_PREFIX_WORDS = {"nano": "n", "micro": "u", "milli": "m", "centi": "c", "kilo": "k", "mega": "M", "giga": "G"}
_JUNCTION = re.compile(r"(?P<one>one|j1|1)|(?P<zero>zero|j0|0)|.*junction", re.IGNORECASE)


def function_advice(name: str, functions: Container[str]) -> str:
    """Return the advice for a function that there is not; empty if nothing is known of it."""
    small = name.lower()
    return FUNCTIONS.get(small, "") or (
        f"Functions are written in small letters: `{small}`." if small in functions else ""
    )


def unit_advice(symbol: str) -> str:
    """Return the advice for a word that is no unit; empty if nothing is known of it."""
    if symbol in PREFIXES:
        return f"A prefix stands before a unit: `10 {symbol}ohm`."
    notation = re.fullmatch(r"([pnumkMG])(\d+)", symbol)
    if notation:
        return f"A prefix stands before a unit, and a point between digits: `4.{notation[2]} {notation[1]}ohm`."
    unit = _unit_of(symbol.lower())
    if unit:
        return f"Write `{unit}`."
    for cut in range(1, len(symbol)):
        if symbol[:cut] in UNITS and symbol[cut:] in UNITS:
            return f"A product is written in brackets: `[{symbol[:cut]}*{symbol[cut:]}]`."
    other_case = [f"`{unit}`" for unit in UNITS if unit.lower() == symbol.lower()]
    return f"Case matters: did you mean {' or '.join(other_case[:4])}?" if other_case else ""


def _unit_of(word: str) -> str:
    """Return the symbol of a unit that is written out; empty if it is none."""
    for written in (word, word.removesuffix("s"), word.removesuffix("es")):
        if written in _UNIT_WORDS:
            return _UNIT_WORDS[written]
        for prefix, letter in _PREFIX_WORDS.items():
            if written.startswith(prefix) and letter + _UNIT_WORDS.get(written.removeprefix(prefix), "-") in UNITS:
                return letter + _UNIT_WORDS[written.removeprefix(prefix)]
    return ""


def name_advice(name: str) -> str:
    """Return the advice for a name that is not declared; empty if nothing is known of it."""
    if name in NAMES:
        return NAMES[name]
    unit = name if name in UNITS else _unit_of(name.lower())
    return f"As a part of a unit it stands in brackets behind the number: `5 [N*{unit}]`." if unit else ""


def kind_advice(kind: str, kinds: list[str], library: Path | None) -> str:
    """Return the advice for a word that is neither a kind of element nor a model; empty if nothing is known of it."""
    junction = _JUNCTION.fullmatch(kind)
    if junction:
        numbers = ["1"] if junction["one"] else ["0"] if junction["zero"] else ["1", "0"]
        return f"A junction is declared by its number: {' or '.join(f'`{number} name`' for number in numbers)}."
    for other in kinds:
        if other.lower() == kind.lower():
            return f"Case matters: write `{other}`."
    for file in sorted(library.glob("*.bg")) if library is not None else []:
        for model in Outline(read_text(file)).models:
            if model.lower() == kind.lower():
                return f"The library has it: write `import {model} from {file.stem}` at the top of the file."
    return ""
