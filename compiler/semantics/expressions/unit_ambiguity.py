"""Notes on `5 N*m` where `m` is a name: it means five newtons times that quantity, but looks like newton metres."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields
from itertools import takewhile

from ...graph.units import UNITS
from ...source import Source
from ...syntax import SyntaxTree, tree

_CANDIDATE = re.compile(r"\d\s*[A-Za-z]+\s*[*/]\s*([A-Za-z]\w*)\b(?!\s*[.(\[])")
_SIGNS = {1: "*", -1: "/"}


def unit_notes(syntax: SyntaxTree) -> Iterator[str]:
    """Notes on products in which a number with a unit is followed by names that are also symbols of units."""
    if any(
        found[1] in UNITS for found in _CANDIDATE.finditer(syntax.source.text)
    ):  # else the tree is not walked through
        yield from ambiguous_products(syntax.statements, syntax.source)


def ambiguous_products(node: object, home: Source) -> Iterator[str]:
    """Notes on a statement, an expression, or several. A place outside of the text `home` is given with its file name."""
    if isinstance(node, tuple):
        for item in node:
            yield from ambiguous_products(item, home)
    elif isinstance(node, tree.SyntaxNode):
        if isinstance(node, tree.Product):
            yield from _notes(node, home)
        for field in fields(node):
            if field.name != "span":
                yield from ambiguous_products(getattr(node, field.name), home)


def _notes(product: tree.Product, home: Source) -> Iterator[str]:
    for position, (_, signed) in enumerate(product.factors, 1):
        factor = signed.operand if isinstance(signed, tree.Negative) else signed
        if not isinstance(factor, tree.Literal) or factor.unit is None or "[" in factor.span.text:
            continue
        units = list(takewhile(lambda f: _symbol(f[1]), product.factors[position:]))
        if not units:
            continue
        rest = "".join(f"{_SIGNS[direction]}{f.span.text}" for direction, f in units)
        names = " and ".join(f"`{n}`" for n in dict.fromkeys(_symbol(f) for _, f in units))
        unit = factor.unit.span.text
        number = factor.span.text.removesuffix(unit).strip()
        span = factor.span
        place = f"line {span.line}" if span.source is home else span.source.name
        yield (
            f"{place}: `{number} {unit}{rest}` is read as `{number} [{unit}]{rest}`, where {names} {'is a name' if len(units) == 1 else 'are names'} "
            f"of the model; for the unit write `{number} [{unit}{rest}]`"
        )


def _symbol(factor: tree.ExpressionSyntax) -> str:
    """Unit symbol that a factor, or the base of a power, is written as; else empty."""
    power = isinstance(factor, tree.Power) and isinstance(factor.exponent, tree.Literal | tree.Negative)
    base = factor.base if power and isinstance(factor, tree.Power) else factor
    return base.head if isinstance(base, tree.PathSyntax) and not base.steps and base.head in UNITS else ""
