"""Units: a closed list of symbols, dimensions as exponents of the seven SI bases, scales exact until the last step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from fractions import Fraction
from functools import lru_cache

from ..fast_dataclass import dataclass

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")


@dataclass(frozen=True, slots=True, eq=False)
class Dimension:
    """Exponents of kg, m, s, A, K, mol, cd.

    A large model has few dimensions, used very often: their hash is stored, and products, powers and names are cached.
    """

    exponents: tuple[Fraction, ...]
    _hash: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_hash", hash(self.exponents))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Dimension):
            return NotImplemented
        return self._hash == other._hash and self.exponents == other.exponents

    def __mul__(self, other: Dimension) -> Dimension:
        return _product(self, other)

    def __truediv__(self, other: Dimension) -> Dimension:
        return _quotient(self, other)

    def __pow__(self, power: Fraction | int) -> Dimension:
        return _power_of(self, power)

    def __str__(self) -> str:
        """Unit in an engineer's notation: `N*s/m`; `1` for a bare number."""
        return _name(self)


_REMEMBERED = 4096  # results; a model has some dozens of dimensions


@lru_cache(_REMEMBERED)
def _interned(exponents: tuple[Fraction, ...]) -> Dimension:
    return Dimension(exponents)


@lru_cache(_REMEMBERED)
def _product(a: Dimension, b: Dimension) -> Dimension:
    return _interned(tuple(x + y for x, y in zip(a.exponents, b.exponents, strict=True)))


@lru_cache(_REMEMBERED)
def _quotient(a: Dimension, b: Dimension) -> Dimension:
    return _interned(tuple(x - y for x, y in zip(a.exponents, b.exponents, strict=True)))


@lru_cache(_REMEMBERED)
def _power_of(a: Dimension, power: Fraction | int) -> Dimension:
    return _interned(tuple(x * power for x in a.exponents))


def _dimension(**powers: int) -> Dimension:
    return _interned(tuple(Fraction(powers.get(base, 0)) for base in _BASES))


ONE = _dimension()
KILOGRAM, METRE, SECOND, AMPERE, KELVIN, MOLE = (_dimension(**{b: 1}) for b in _BASES[:6])
NEWTON = KILOGRAM * METRE / SECOND**2
JOULE = NEWTON * METRE
WATT = JOULE / SECOND
VOLT = WATT / AMPERE
PASCAL = NEWTON / METRE**2


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit: value in SI = number * pi^pi_power * value in the unit + offset."""

    dimension: Dimension
    number: Fraction = Fraction(1)
    pi_power: int = 0
    offset: Fraction = Fraction(0)

    def __mul__(self, other: Scale) -> Scale:
        return Scale(self.dimension * other.dimension, self.number * other.number, self.pi_power + other.pi_power)

    def __pow__(self, power: Fraction) -> Scale | None:
        if power.denominator != 1:
            root = _root(self.number, power.denominator)
            if root is None or self.pi_power % power.denominator:
                return None
            return Scale(
                self.dimension**power, root**power.numerator, self.pi_power // power.denominator * power.numerator
            )
        return Scale(self.dimension**power, self.number**power.numerator, self.pi_power * power.numerator)

    def to_si(self, value: Fraction) -> float:
        """Value in SI, rounded once; infinite beyond the range of doubles."""
        exact = value * self.number + self.offset if self.offset else value * self.number
        try:
            return float(exact) * math.pi**self.pi_power if self.pi_power else float(exact)
        except OverflowError:
            return math.inf if exact > 0 else -math.inf

    def from_si(self, value: float) -> float:
        """A value in SI expressed in this unit."""
        return (value - float(self.offset)) / (float(self.number) * math.pi**self.pi_power)


def _root(number: Fraction, degree: int) -> Fraction | None:
    top = round(number.numerator ** (1 / degree))
    bottom = round(number.denominator ** (1 / degree))
    return Fraction(top, bottom) if Fraction(top, bottom) ** degree == number else None


PREFIXES = {
    "f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "c": -2, "d": -1, "": 0, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12,
}  # fmt: skip

_PREFIXED: Mapping[str, Scale] = {
    "m": Scale(METRE),
    "g": Scale(KILOGRAM, Fraction(1, 1000)),
    "s": Scale(SECOND),
    "A": Scale(AMPERE),
    "K": Scale(KELVIN),
    "mol": Scale(MOLE),
    "cd": Scale(_dimension(cd=1)),
    "N": Scale(NEWTON),
    "J": Scale(JOULE),
    "W": Scale(WATT),
    "V": Scale(VOLT),
    "ohm": Scale(VOLT / AMPERE),
    "S": Scale(AMPERE / VOLT),
    "F": Scale(AMPERE * SECOND / VOLT),
    "H": Scale(VOLT * SECOND / AMPERE),
    "C": Scale(AMPERE * SECOND),
    "Wb": Scale(VOLT * SECOND),
    "T": Scale(VOLT * SECOND / METRE**2),
    "Pa": Scale(PASCAL),
    "bar": Scale(PASCAL, Fraction(100000)),
    "Hz": Scale(ONE / SECOND),
    "L": Scale(METRE**3, Fraction(1, 1000)),
    "eV": Scale(JOULE, Fraction(1602176634, 10**28)),
    "rad": Scale(ONE),
    "Nm": Scale(JOULE),
    "VA": Scale(WATT),
    "Wh": Scale(JOULE, Fraction(3600)),
    "Ah": Scale(AMPERE * SECOND, Fraction(3600)),
    "cal": Scale(JOULE, Fraction(4184, 1000)),  # thermochemical
}
# Exact by definition.
_INCH, _POUND, _GRAVITY = Fraction(254, 10000), Fraction(45359237, 10**8), Fraction(980665, 10**5)
_PLAIN: Mapping[str, Scale] = {
    "deg": Scale(ONE, Fraction(1, 180), 1),
    "rev": Scale(ONE, Fraction(2), 1),
    "rpm": Scale(ONE / SECOND, Fraction(2, 60), 1),
    "min": Scale(SECOND, Fraction(60)),
    "h": Scale(SECOND, Fraction(3600)),
    "day": Scale(SECOND, Fraction(86400)),
    "percent": Scale(ONE, Fraction(1, 100)),
    "ppm": Scale(ONE, Fraction(1, 10**6)),
    "degC": Scale(KELVIN, offset=Fraction(27315, 100)),
    "atm": Scale(PASCAL, Fraction(101325)),
    "t": Scale(KILOGRAM, Fraction(1000)),
    "inch": Scale(METRE, _INCH),
    "ft": Scale(METRE, 12 * _INCH),
    "mile": Scale(METRE, 63360 * _INCH),
    "mph": Scale(METRE / SECOND, 63360 * _INCH / 3600),
    "kn": Scale(METRE / SECOND, Fraction(1852, 3600)),
    "lb": Scale(KILOGRAM, _POUND),
    "lbf": Scale(NEWTON, _POUND * _GRAVITY),
    "kgf": Scale(NEWTON, _GRAVITY),
    "psi": Scale(PASCAL, _POUND * _GRAVITY / _INCH**2),
    "Torr": Scale(PASCAL, Fraction(101325, 760)),
    "mmHg": Scale(PASCAL, Fraction(133322387415, 10**9)),
    "gal": Scale(METRE**3, 231 * _INCH**3),
    "hp": Scale(WATT, 550 * 12 * _INCH * _POUND * _GRAVITY),
    "degF": Scale(KELVIN, Fraction(5, 9), offset=Fraction(45967, 180)),
    "angstrom": Scale(METRE, Fraction(1, 10**10)),
    "week": Scale(SECOND, Fraction(7 * 86400)),
    "year": Scale(SECOND, Fraction(31557600)),
    "%": Scale(ONE, Fraction(1, 100)),
}


def _table() -> dict[str, Scale]:
    table = dict(_PLAIN)
    for symbol, scale in _PREFIXED.items():
        for prefix, exponent in PREFIXES.items():
            if prefix in "cdh" and prefix and symbol not in ("m", "L", "Pa"):
                continue
            table.setdefault(prefix + symbol, Scale(scale.dimension, scale.number * Fraction(10) ** exponent))
    for symbol, scale in _PREFIXED.items():  # a symbol without prefix wins: `Pa` is no peta-anything, `m` no milli
        table[symbol] = scale
    return table | dict(_PLAIN)


UNITS: Mapping[str, Scale] = _table()

_NAMED = {
    NEWTON: "N", JOULE: "N*m", WATT: "W", VOLT: "V", PASCAL: "Pa", VOLT / AMPERE: "ohm", AMPERE * SECOND / VOLT: "F",
    VOLT * SECOND / AMPERE: "H", AMPERE * SECOND: "C", VOLT * SECOND: "V*s", NEWTON / METRE: "N/m", NEWTON * SECOND / METRE: "N*s/m",
    NEWTON * SECOND: "N*s", JOULE * SECOND: "N*m*s", METRE / SECOND: "m/s", METRE / SECOND**2: "m/s^2", METRE**2: "m^2",
    METRE**3: "m^3", METRE**3 / SECOND: "m^3/s", ONE / SECOND: "1/s", KILOGRAM * METRE**2: "kg*m^2", ONE: "1",
    WATT / KELVIN: "W/K", JOULE / KELVIN: "J/K", PASCAL * SECOND: "Pa*s", NEWTON / METRE**2: "Pa", NEWTON / METRE**3: "N/m^3",
    AMPERE * SECOND / VOLT / METRE: "F/m", KILOGRAM / METRE**3: "kg/m^3", JOULE / MOLE: "J/mol", MOLE / SECOND: "mol/s",
}  # fmt: skip


@lru_cache(_REMEMBERED)
def _name(dimension: Dimension) -> str:
    if dimension in _NAMED:
        return _NAMED[dimension]
    powers = [(b, e) for b, e in zip(_BASES, dimension.exponents, strict=True) if e]
    top = "*".join(_power(b, e) for b, e in powers if e > 0) or "1"
    return top + "".join(f"/{_power(b, -e)}" for b, e in powers if e < 0)


def _power(base: str, exponent: Fraction) -> str:
    if exponent == 1:
        return base
    return f"{base}^{exponent}" if exponent.denominator == 1 else f"{base}^({exponent})"
