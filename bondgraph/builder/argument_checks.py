"""Argument checks of the builder's calls: names, texts of the language, numbers, ports.

Every function returns text for one place in a statement, and raises `UsageError` or `CompilationFailed` for text that could have another meaning
there. Texts are parsed, never evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, SupportsFloat

from compiler.api import DOMAINS, Literal, PathSyntax, Source, number_text, parse_expression, parse_law, read_unit

from ..errors import UsageError
from .parts import NamedQuantity, Part, name_of

Value = Any  # a number, an expression of the language as text, a handle, or a sequence of these
Ports = Mapping[str, str] | Sequence[str]  # the names of ports, with or without their domains


def description_of(text: object) -> str:
    """Return a text that fits into one literal, which has no way to write a quotation mark or a line break."""
    if not isinstance(text, str) or '"' in text or not text.isprintable():
        raise UsageError("BR501", f"a description has no quotation marks, line breaks or control characters: {text!r}")
    return text


def literal_of(description: object) -> str:
    """Return a description as it follows a declaration."""
    return f' "{description_of(description)}"' if description != "" else ""


def domain_of(domain: object, also: Iterable[str] = ()) -> str:
    """Return a domain of the language, with its width if it has one: `translation[n]`."""
    known = [*DOMAINS, *also]
    name, bracket, width = str(domain).partition("[")
    if name not in known or (bracket and not width.endswith("]")):
        raise UsageError("BR502", f"there is no domain {domain!r}; domains are {', '.join(known)}")
    return f"{name}[{expression_of(width[:-1], f'the width of {name}')}]" if bracket else name


def ports_of(ports: Ports, also: Iterable[str] = ()) -> tuple[str, tuple[str, ...]]:
    """Return ports in parentheses, and their names; `also` are domains of multibonds."""
    if not isinstance(ports, Mapping | list | tuple):
        raise UsageError("BR503", f"ports are a list of names or a mapping from names to domains, not {ports!r}")
    given = dict(ports) if isinstance(ports, Mapping) else dict.fromkeys(ports, "")
    if len(given) < len(ports) or any("[" in name_of(p) for p in given):
        raise UsageError(
            "BR504", f"the ports of an element have different names, without indices: {', '.join(map(str, ports))}"
        )
    listed = ", ".join(f"{p}: {domain_of(d, also)}" if d else p for p, d in given.items())
    return (f"({listed})" if listed else ""), tuple(given)


def _one_line(text: object, what: str, quoting: str = "") -> str:
    """Return the text on one line, without hidden characters. Quotation marks end nothing in what is parsed whole."""
    if not isinstance(text, str):
        raise UsageError("BR505", f"{what} is a text of the language, not {text!r}")
    line = " ".join(text.split())
    if "#" in line or '"' in line.replace(quoting, "") or not line.isprintable():
        raise UsageError("BR506", f"{what} has no comments, quotation marks or control characters: {text!r}")
    return line


def expression_of(text: object, what: str) -> str:
    """Return one expression of the language."""
    line = _one_line(text, what, '"')
    parse_expression(Source(what, line))
    return line


def law_of(text: object, what: str) -> str:
    """Return one law of the language."""
    line = _one_line(text, what, '"')
    parse_law(Source(what, line))
    return line


def path_of(text: object) -> str:
    """Return a dotted name; handles have theirs."""
    line = _one_line(str(text) if isinstance(text, Part | NamedQuantity) else text, "a path")
    found = parse_expression(Source("path", line))
    if not isinstance(found, PathSyntax):
        raise UsageError("BR507", f"{text!r} is no dotted name")
    return found.words


def unit_of(unit: object, what: str) -> str:
    """Return one unit of the language."""
    line = _one_line(unit, what)
    read_unit(Source(what, line))
    return line


def mapping_of(given: object, what: str) -> Mapping[Any, Any]:
    """Return a mapping from names to values."""
    if not isinstance(given, Mapping):
        raise UsageError("BR508", f"{what} is a mapping, {{name: value}}, not {given!r}")
    return given


def value_of(value: Value, what: str, unit: str = "", declared: bool = False) -> str:
    """Return a value as an expression; numbers are in the unit, which precedes them if it is `declared`."""
    if isinstance(value, str | NamedQuantity | Part):
        return expression_of(str(value), what)
    if hasattr(value, "tolist"):  # numbers and arrays of numpy
        value = value.tolist()
    if is_number(value):
        return _number(value, what, unit, declared)
    if isinstance(value, list | tuple):
        if not value:
            raise UsageError("BR509", f"{what}: a list has an item or more")
        return f"[{', '.join(value_of(v, what, unit, declared) for v in value)}]"
    raise UsageError("BR510", f"{what} is a number, a text of the language, or a list of these, not {value!r}")


def is_one_number(text: str) -> bool:
    """Return True if an expression is a number with its unit, which needs no brackets."""
    return isinstance(parse_expression(Source("value", text)), Literal)


def is_number(value: object) -> bool:
    """Return True if the value is a real number, of Python or numpy."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _number(value: SupportsFloat, what: str, unit: str, declared: bool) -> str:
    """Return a number as text that reads back as the same double."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise UsageError("BR511", f"{what} is no finite number: {value!r:.40}")
    text = number_text(number)
    lone = "^" not in text  # otherwise the number is too large or small for a literal
    if not unit or number == 0 or (lone and declared):
        return text
    after = unit if unit.isidentifier() else f"[{unit}]"
    return f"{text} {after}" if lone else f"{text}*1 {after}"
