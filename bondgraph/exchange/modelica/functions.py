"""Functions of Modelica: names in the language, and what their arguments and values are counted in."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .tree import Term

# The language's name and the number of arguments. BARE take and give bare numbers; ALIKE give what their arguments have.
BARE = {
    "sin": ("sin", 1), "cos": ("cos", 1), "tan": ("tan", 1), "asin": ("asin", 1), "acos": ("acos", 1), "atan": ("atan", 1), "sinh": ("sinh", 1),
    "cosh": ("cosh", 1), "tanh": ("tanh", 1), "exp": ("exp", 1), "log": ("log", 1), "log10": ("log10", 1), "floor": ("floor", 1), "ceil": ("ceil", 1),
}  # fmt: skip
ALIKE = {"abs": ("abs", 1), "min": ("min", 2), "max": ("max", 2)}
WRITTEN = {**BARE, **ALIKE, "sign": ("sign", 1), "atan2": ("atan2", 2), "sqrt": ("sqrt", 1), "delay": ("delay", 2)}
EVENTS = {  # words with places of their own, and advice where they stand elsewhere
    "der": "It takes a variable.", "pre": "It takes a variable.", "edge": "It takes a truth.", "change": "It takes a truth.",
    "sample": "It takes a start and a period.", "reinit": "It stands in a `when`.", "initial": "Write an `initial equation`.",
    "terminate": "Let an experiment end a run: `stop when`.", "connect": "A flattener makes its equations.",
}  # fmt: skip
VALUES: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in BARE}, "abs": abs, "min": min, "max": max, "atan2": math.atan2, "sqrt": math.sqrt,
    "sign": lambda x: (x > 0) - (x < 0),
}  # fmt: skip


def _call(name: str, *parts: Term) -> Term:
    return Term("call", name, parts)


def _of(kind: str, word: str, *parts: Term) -> Term:
    return Term(kind, word, parts)


def _truncated(x: Term) -> Term:
    return _of("product", "**", _call("sign", x), _call("floor", _call("abs", x)))


def _rest(x: Term, count: Term, y: Term) -> Term:
    return _of("sum", "+-", x, _of("product", "**", count, y))


# Functions that other expressions stand for, by the number of their arguments.
REPLACED: dict[tuple[str, int], Callable[..., Term]] = {
    ("noEvent", 1): lambda x: x,
    ("delay", 3): lambda x, time, _: _call("delay", x, time),
    ("smooth", 2): lambda _, x: x,
    ("homotopy", 2): lambda x, _: x,
    ("Real", 1): lambda x: x,
    ("integer", 1): lambda x: _call("floor", x),
    ("mod", 2): lambda x, y: _rest(x, _call("floor", _of("product", "*/", x, y)), y),
    ("div", 2): lambda x, y: _truncated(_of("product", "*/", x, y)),
    ("rem", 2): lambda x, y: _rest(x, _truncated(_of("product", "*/", x, y)), y),
    ("semiLinear", 3): lambda x, a, b: _of("choice", "", _of("compare", ">=", x, Term("number", "0")), *(_of("product", "**", c, x) for c in (a, b))),
}  # fmt: skip

ERRORS = ArithmeticError, ValueError, TypeError, KeyError  # of values


def computed(term: Term, values: list[float]) -> float:
    """Return the value of a term by those of its parts."""
    if term.kind in ("number", "truth"):
        return float(term.word) if term.kind == "number" else term.word == "true"
    if term.kind in ("sum", "product"):
        result = float(term.kind == "product")
        for sign, value in zip(term.word, values, strict=True):
            result = {"+": result + value, "-": result - value, "*": result * value}[sign] if sign != "/" else result / value  # fmt: skip
        return result
    if term.kind == "not":
        return 1 - values[0]
    if term.kind == "compare":
        a, b = values
        return {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b, "<>": a != b}[term.word]
    return values[0] ** values[1] if term.kind == "power" else VALUES[term.word](*values)  # type: ignore[no-any-return]


def number_of(term: Term) -> float:
    """Return the value of a term without names. Raises one of `ERRORS`."""
    return float(computed(term, list(map(number_of, term.parts))))
