"""Expression trees as lines of Python, and their slopes: all that is shared with the compiler is the noun `Expression`.

Lines serve numbers (`math`) and complex steps (`cmath`). `Frozen` lines take the branch of each atom (a comparison, sign, abs, min, max, floor,
ceil) from outside, so that what is integrated is smooth; the others look.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from compiler.algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    multiply,
    negate,
    power,
)

ATOMS = frozenset({"less", "less_equal", "equal", "sign", "abs", "min", "max", "floor", "ceil"})


class NotHeld(Exception):
    """A feature that the second opinion has none of."""


def slope(x: Expression, by: Symbol) -> Expression:
    """The partial derivative, of smooth operators."""
    match x:
        case Symbol():
            return ONE if x == by else ZERO
        case Apply(operator="add", operands=parts):
            return add(*(slope(p, by) for p in parts))
        case Apply(operator="multiply", operands=parts):
            terms = []
            for i, part in enumerate(parts):
                d = slope(part, by)
                if d != ZERO:
                    terms.append(multiply(*parts[:i], d, *parts[i + 1 :]))
            return add(*terms) if terms else ZERO
        case Apply(operator="divide", operands=(a, b)):
            return divide(slope(a, by), b) - divide(multiply(a, slope(b, by)), multiply(b, b))
        case Apply(operator="select", operands=(c, a, b)):
            return call("select", c, slope(a, by), slope(b, by))
        case Apply(operator=operator, operands=(u, *rest)):
            inner = slope(u, by)
            if inner == ZERO and all(slope(r, by) == ZERO for r in rest):
                return ZERO
            return multiply(_outer(operator, u, rest, by), inner)
    return ZERO


def _outer(operator: str, u: Expression, rest: Sequence[Expression], by: Symbol) -> Expression:
    match operator:
        case "sin":
            return call("cos", u)
        case "cos":
            return negate(call("sin", u))
        case "exp":
            return call("exp", u)
        case "log":
            return divide(ONE, u)
        case "sqrt":
            return divide(Number(0.5), call("sqrt", u))
        case "tanh":
            return ONE - power(call("tanh", u), Number(2.0))
        case "power" if slope(rest[0], by) == ZERO:
            return multiply(rest[0], power(u, rest[0] - 1.0))
        case "abs":
            return call("sign", u)
    raise NotHeld(f"the slope of {operator}")


# ---------------------------------------------------------------- functions that lines call
def _segment(x: Any, xs: Any) -> Any:
    return np.clip(np.searchsorted(xs, np.real(x), "right") - 1, 0, len(xs) - 2)


def line_table(x: Any, *points: Any) -> Any:
    """Straight lines between points."""
    xs, ys = np.reshape(points, (2, -1))[:, :: 1 if points[0] <= points[len(points) // 2 - 1] else -1]
    i = _segment(x, xs)
    return ys[i] + (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]) * (x - xs[i])


def curve_table(x: Any, *points: Any) -> Any:
    """Cubics through points with slopes, by the Hermite basis."""
    xs, ys, ms = np.reshape(points, (3, -1))
    i = _segment(x, xs)
    h = xs[i + 1] - xs[i]
    s = (x - xs[i]) / h
    return (
        (1 + 2 * s) * (1 - s) ** 2 * ys[i]
        + s * (1 - s) ** 2 * h * ms[i]
        + s * s * (3 - 2 * s) * ys[i + 1]
        + s * s * (s - 1) * h * ms[i + 1]
    )


def _complex_atan2(y: Any, x: Any) -> Any:
    size = np.real(x) ** 2 + np.real(y) ** 2
    return np.arctan2(np.real(y), np.real(x)) + 1j * (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / size


def _signed_root(a: Any, n: Any) -> Any:
    n = float(np.real(n).flat[0]) if np.ndim(n) else n.real
    return np.where(np.real(a) < 0, -1, 1) * (a * np.sign(np.real(a))) ** (1 / n) if n % 2 == 1 else a ** (1 / n)


_SHARED: dict[str, Any] = {
    "_less": lambda a, b: float(a.real < b.real),
    "_less_equal": lambda a, b: float(a.real <= b.real),
    "_equal": lambda a, b: float(a.real == b.real),
    "_sign": lambda a: float((a.real > 0) - (a.real < 0)),
    "_abs": lambda a: 1.0 if a.real >= 0 else -1.0,
    "_min": lambda a, b: float(a.real <= b.real),
    "_max": lambda a, b: float(a.real >= b.real),
    "_floor": lambda a: float(math.floor(a.real)),
    "_ceil": lambda a: float(math.ceil(a.real)),
    "line_table": line_table,
    "curve_table": curve_table,
    "root": _signed_root,
    "pi": math.pi,
}
_PLAIN = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt")
_INVERSE = ("asin", "acos", "atan", "asinh", "acosh", "atanh")
REAL: dict[str, Any] = {**_SHARED, **{n: getattr(math, n) for n in (*_PLAIN, *_INVERSE, "atan2")}, "real": float}
COMPLEX: dict[str, Any] = {
    **_SHARED,
    **{n: getattr(np, n) for n in _PLAIN},
    **{n: getattr(np, f"arc{n[1:]}") for n in _INVERSE},
    "atan2": _complex_atan2,
    "real": np.real,
}


@dataclass
class Writer:
    """Lines of one function. `name` gives the text for a symbol's key."""

    name: Callable[[Any], str]
    frozen: bool
    lines: list[str] = field(default_factory=list)
    known: dict[Expression, str] = field(default_factory=dict)
    atoms: list[tuple[str, tuple[str, ...], Apply]] = field(default_factory=list)

    def write(self, x: Expression) -> str:
        """The name or number that has the value of an expression."""
        if isinstance(x, Number):
            return f"({x.value!r})"
        if isinstance(x, Symbol):
            return self.name(x.key)
        assert isinstance(x, Apply)
        found = self.known.get(x)
        if found is None:
            if x.operator == "select" and not self.frozen:
                found = self._choice(x)
            else:
                found = self._local(self._value(x))
            self.known[x] = found
        return found

    def _local(self, value: str) -> str:
        name = f"a{len(self.lines)}"
        self.lines.append(f"{name} = {value}")
        return name

    def _choice(self, x: Apply) -> str:
        """The branch not taken may have no value, so it is written behind the condition."""
        condition = self.write(x.operands[0])
        result, block = f"s{len(self.lines)}", [f"if {condition}:"]
        for branch in x.operands[1:]:
            inner = Writer(self.name, False, known=dict(self.known))
            inner.lines = [""] * len(self.lines)
            value = inner.write(branch)
            block += ["    " + part for line in inner.lines[len(self.lines) :] for part in line.split("\n")]
            block += [f"    {result} = {value}", "else:"]
        self.lines.append("\n".join(block[:-1]))
        return result

    def _value(self, x: Apply) -> str:
        v = [self.write(o) for o in x.operands] if x.operator not in TABLES else []
        match x.operator:
            case "add":
                return " + ".join(v)
            case "multiply":
                return "*".join(v)
            case "divide":
                return f"{v[0]}/{v[1]}"
            case "power":
                return f"{v[0]}**{_exponent(v[1])}"
            case "and":
                return f"{v[0]}*{v[1]}"
            case "or":
                return f"max({v[0]}, {v[1]})"
            case "not":
                return f"1.0 - {v[0]}"
            case "select":
                return f"({v[1]} if {v[0]} else {v[2]})"
            case operator if operator in ATOMS:
                return self._atom(x, operator, v)
            case operator if operator in TABLES:
                return self._table(x)
            case "noise" | "inverse" | "natural_slope" | "monotone_slope":
                raise NotHeld(x.operator)
        return f"{x.operator}({', '.join(v)})"

    def _table(self, x: Apply) -> str:
        if x.operands[0] != ZERO:
            raise NotHeld("the slope of a table")
        if any(isinstance(o, Apply) and o.operator.endswith("_slope") for o in x.operands):
            raise NotHeld("a curve through parameters")
        v = [self.write(o) for o in x.operands[1:]]
        return f"{TABLES[x.operator]}({', '.join(v)})"

    def _atom(self, x: Apply, operator: str, v: list[str]) -> str:
        if self.frozen:
            branch = f"b[{len(self.atoms)}]"
            self.atoms.append((operator, tuple(v), x))
        else:
            branch = f"_{operator}({', '.join(v)})"
        if operator == "abs":
            return f"{branch}*{v[0]}"
        if operator in ("min", "max"):
            return f"({v[0]} if {branch} else {v[1]})"
        return branch


TABLES = {"linear": "line_table", "cubic": "curve_table", "monotone": "curve_table"}


def _exponent(v: str) -> str:
    """Whole exponents as integers, which complex numbers raise exactly."""
    try:
        number = float(v.strip("()"))
    except ValueError:
        return v
    return f"({int(number)})" if number == int(number) else v


def function(name: str, arguments: str, lines: Sequence[str], result: str, space: dict[str, Any]) -> Any:
    """A Python function of these lines."""
    body = "\n".join("    " + part for line in lines for part in line.split("\n"))
    scope = dict(space)
    exec(f"def {name}({arguments}):\n{body}\n    return {result}\n", scope)
    return scope[name]
