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
_LIMITED = "A limited quantity is `min(max(x, low), high)`."
_LATER = "What was some time ago is `delay(x, 1 ms)`; what a sample keeps is a `mode` that an `every` sets."
_ASIDE = "Write its argument alone: where a condition changes, integration stops and starts again without it."
_LISTED = "A list is written out, `(0, 0, 0)`, or one number in each round, `for i in 1..3 { constant a[i] = 0 }`."
_SHOWN = "What is to be seen is an output, `output y = x`, and an experiment reports it."
_TO_ZERO = "Down it is `floor(a)`, towards zero `sign(a)*floor(abs(a))`."
_RATE = "Declare it; an angular velocity is `omega`, of the sides of a TF or GY `omega1`, `omega2`."
_SUM = "Numbers of a list are added by `dot(x, (1, 1, 1))`."
FUNCTIONS = {
    "ddt": _RATES, "diff": _RATES, "derivative": _RATES, "deriv": _RATES, "int": _INTEGRAL, "integrate": _INTEGRAL, "idt": _INTEGRAL,
    "resint": "An integral that an event resets is a signal `integral(rate, start)`, which a `when` sets.",
    "table": _CURVE, "interp": _CURVE, "interp1": _CURVE, "lookup": _CURVE, "limit": _LIMITED, "saturate": _LIMITED, "saturation": _LIMITED, "clip": _LIMITED,
    "clamp": _LIMITED, "tdelay": _LATER, "dly": _LATER, "transport": _LATER, "absdelay": _LATER, "noevent": _ASIDE, "smooth": _ASIDE, "homotopy": _ASIDE,
    "zeros": _LISTED, "ones": _LISTED, "fill": _LISTED, "linspace": _LISTED, "sum": _SUM, "mean": "A mean is the sum over the number: `dot(x, (1, 1, 1))/3`.",
    "disp": _SHOWN, "print": _SHOWN, "printf": _SHOWN, "fprintf": _SHOWN,
    "sqr": "A square is `a^2`.", "square": "A square is `a^2`, a square wave `pwm(time, 1 s, 0.5)`.", "sawtooth": "A sawtooth is `mod(time, 1 s)`.",
    "cbrt": "A root of three is `a^(1/3)`.", "hypot": "The length of a vector is `norm((a, b))`.", "sgn": "It is written `sign`.",
    "arcsin": "It is written `asin`.", "arccos": "It is written `acos`.", "arctan2": "It is written `atan2`.",
    "sind": "An angle has its unit: `sin(30 deg)`.", "cosd": "An angle has its unit: `cos(30 deg)`.", "tand": "An angle has its unit: `tan(30 deg)`.",
    "deg2rad": "An angle has its unit: `30 deg`.", "rad2deg": "A result is reported in a unit: `report phi in deg`.",
    "log2": "A logarithm to the base 2 is `log(a)/log(2)`.", "div": "A whole quotient is `floor(a/b)`, which rounds down.",
    "integer": "A whole number is `floor(a)`.",
    "trunc": _TO_ZERO, "fix": _TO_ZERO,
    "semilinear": "A choice is `a if condition else b`: `k*x if x > 0 else r*x`.", "rand": "Random numbers are `noise(time, 1 ms, 1)`.",
    "random": "Random numbers are `noise(time, 1 ms, 1)`.", "heaviside": "A step is `step(time - 1 s)`.",
    "sample": "What is sampled is a `mode` that an `every` sets: `mode held = 0; every 1 ms { held = 1 }`.",
    "edge": "What happens at an instant is a `when`: `when x > 1 { … }`.", "change": "What happens at an instant is a `when`: `when x > 1 { … }`.",
    "event": "What happens at an instant is a `when`: `when x > 1 { … }`.",
    "inv": "The inverse of a matrix is `inverse(A)`; `A*x = b` is solved by `solve(A, b)`.", "eye": "The unit matrix is `identity(3)`.",
    "pow": "A power is written with `^`: `a^2`.",
    "round": "A rounded number is `floor(x + 0.5)`.",
    "rem": "A remainder is `mod(x, length)`, of two quantities of one unit.",
    "fmod": "A remainder is `mod(x, length)`, of two quantities of one unit.",
    "pre": "In an event the right sides read the values before it: write the name alone.",
}  # fmt: skip
OTHER_JOINTS = {
    "revolute": "hinge", "pivot": "hinge", "pin": "hinge", "rotational": "hinge", "prismatic": "slide", "slider": "slide", "translational": "slide",
    "fixed": "weld", "rigid": "weld", "spherical": "ball", "cylindrical": "cylinder", "cardan": "universal", "part": "body", "link": "body", "mass": "body",
}  # fmt: skip
NAMES = {
    "w": _RATE, "w1": _RATE, "w2": _RATE, "torque": "Declare it; a torque is `M`.", "tau": "Declare it; a torque is `M`.",
    "force": "Declare it; a force is `F`.", "t": "Time is `time`.", "PI": "It is written `pi`.", "Pi": "It is written `pi`.",
    "g": "Gravity is a parameter, `parameter g = 9.81 [m/s^2]`; grams stand behind a number: `5 g`.",
    "e": "Euler's number is `exp(1)`.", "inf": "No number is infinite.", "Inf": "No number is infinite.", "NaN": "Every number has a value.",
    "True": "It is written `true`.", "False": "It is written `false`.", "Time": "Time is `time`.",
}  # fmt: skip
_UNIT_WORDS = {
    "second": "s", "sec": "s", "minute": "min", "hour": "h", "hr": "h", "meter": "m", "metre": "m", "gram": "g", "newton": "N", "volt": "V",
    "amp": "A", "ampere": "A", "ohm": "ohm", "farad": "F", "henry": "H", "watt": "W", "joule": "J", "pascal": "Pa", "hertz": "Hz", "hz": "Hz",
    "kelvin": "K", "celsius": "degC", "degree": "deg", "radian": "rad", "liter": "L", "litre": "L", "l": "L", "pound": "lb", "feet": "ft",
    "foot": "ft", "knot": "kn", "tesla": "T", "weber": "Wb", "coulomb": "C", "siemens": "S", "turn": "rev",
}  # fmt: skip
_PREFIX_WORDS = {
    "nano": "n",
    "micro": "u",
    "milli": "m",
    "centi": "c",
    "kilo": "k",
    "mega": "M",
    "meg": "M",
    "giga": "G",
}
_POWER = re.compile("(?:[num]?[ms]|cm|dm|km)[234]")  # as `m2` for m^2
_JUNCTION = re.compile(r"(?P<one>one|j1|1)|(?P<zero>zero|j0|0)|.*junction", re.IGNORECASE)


def function_advice(name: str, functions: Container[str]) -> str:
    """Return the advice for a function that there is not; empty if nothing is known of it."""
    small = name.lower()
    return FUNCTIONS.get(small, "") or (
        f"Functions are written in small letters: `{small}`." if small in functions else ""
    )


def unit_advice(symbol: str) -> str:
    """Return the advice for a word that is no unit; empty if nothing is known of it."""
    symbol = _PREFIX_WORDS.get(symbol.lower(), symbol)
    if symbol in PREFIXES:
        return f"A prefix stands before a unit: `10 {symbol}ohm`."
    if _POWER.fullmatch(symbol):
        return f"A power is written with `^`: `[{symbol[:-1]}^{symbol[-1]}]`."
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
    if _POWER.fullmatch(name):
        return f"A power of a unit is written with `^`, `{name[:-1]}^{name[-1]}`; a quantity is declared with `parameter`, `constant`, `signal` or `input`."
    unit = name if name in UNITS else _unit_of(name.lower())
    return f"Declare it; as a part of a unit it stands in brackets behind the number: `5 [N*{unit}]`." if unit else ""


_SIGNAL = "Blocks are expressions: `signal y = 2*u - integral(x, 0 s)`; parts of controllers are in the library, `bondgraph library control`."
_OUTSIDE = "A model stands outside of other models, `model Name { … }`, and an instance in them, `Name part`."
_SOURCE = "A source is an element: `Se supply : u = 5 V*sin(2*pi*50 Hz*time)`."
_TYPED = "A number with a name is declared, `parameter c = 3`; what changes is a signal, `signal s = …`, what events change a `mode`."
KINDS = {
    "real": _TYPED, "boolean": _TYPED, "integer": _TYPED, "global": "What all models of a file share is a `constant` of the file.",
    "extends": "A model contains others: an instance is declared as `Base part`, and its ports are bonded.",
    "within": "A file holds models, without packages.", "package": "A file holds models, without packages.",
    "end": "Statements stand between the braces of `model Name { … }`, in any order.",
    "submodel": _OUTSIDE, "component": _OUTSIDE, "class": _OUTSIDE, "block": _OUTSIDE,
    "gain": _SIGNAL, "sum": _SIGNAL, "product": _SIGNAL, "step": _SIGNAL, "saturation": _SIGNAL, "integrator": _INTEGRAL, "scope": _SHOWN,
    "voltagesource": _SOURCE, "constantvoltage": _SOURCE, "sinevoltage": _SOURCE, "stepvoltage": _SOURCE,
    "ground": "What is held at zero is a source: `Se earth : u = 0 V`.",
    "switch": "A choice is `a if condition else b`, of parts `if … { … } else { … }`.",
    "clear": "A file holds models; each run begins from nothing.",
    "syms": "Names need no declaration as symbols: a `parameter` has a value, what changes is a `signal`.",
}  # fmt: skip


def kind_advice(kind: str, kinds: list[str], library: Path | None) -> str:
    """Return the advice for a word that is neither a kind of element nor a model; empty if nothing is known of it."""
    if kind.lower() in KINDS and kind != "Switch":
        return KINDS[kind.lower()]
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
