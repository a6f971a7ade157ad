"""Units without brackets: `100 rad/s` is one quantity where `s` is no quantity; where it is one, a note tells both readings."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import fields, replace
from fractions import Fraction
from itertools import takewhile
from typing import Any, TypeVar

from ...errors import Diagnostic
from ...graph.domains import DOMAINS
from ...graph.units import UNITS
from ...source import Source, Span
from ...syntax import SyntaxTree, tree
from ...syntax.blocks import nodes_in
from ...syntax.build import MAXIMUM_UNIT_POWER
from .errors import DimensionMismatch

_CANDIDATE = re.compile(
    r"\d\s*[A-Za-z%\u03a9\u2126\u00b5\u03bc]+\s*(?:[*/]\s*([A-Za-z]\w*)\b(?!\s*(?:\.(?!\.)|[(\[]))|(\^))"
)
_NAME = re.compile(r"[A-Za-z_]\w*")
_CELSIUS = re.compile(r"in \[K\].*(?:is in \[C\]|reported in C$)")
Value = TypeVar("Value")
_SIGNS = {1: "*", -1: "/"}
# Parts are read with a point only, so `9.81 m/s^2` is clear beside an element `m`.
QUANTITIES = tree.Item | tree.Component | tree.LoopSyntax
NAMED = QUANTITIES | tree.PortItem | tree.Declared | tree.MechanismSyntax


def with_compound_units(syntax: SyntaxTree) -> SyntaxTree:
    """Return the tree with one literal for each number and the symbols of units behind it that are no quantities of its model, nor letters of a law."""
    statements = statements_with_compound_units(syntax.statements, syntax.source.text, shared_names(syntax.statements))
    return replace(syntax, statements=statements)


def shared_names(statements: tuple[tree.SyntaxNode, ...]) -> set[str]:
    """Return the names of quantities and functions that a file declares outside of models, which all of its models read."""
    sets = {s.name for s in statements if isinstance(s, tree.ParameterSet)}  # their members are read behind their names
    return sets | names_in(tuple(s for s in statements if not isinstance(s, tree.ModelSyntax | tree.ParameterSet)))


def statements_with_compound_units(
    statements: tuple[tree.SyntaxNode, ...], text: str, shared: Set[str]
) -> tuple[tree.SyntaxNode, ...]:
    """Return the statements of a part of a file, whose text is `text`, as `with_compound_units` would."""
    if not _has_candidate(text):  # else the tree is not walked through
        return statements
    return tuple(_folded(s, shared | names_in(s)) for s in statements)


def in_one_literal(value: Value, names: Set[str]) -> Value:
    """Return an expression that is read where these names are known, as `with_compound_units` does; what is no expression stays as it is."""
    folded: Value = _folded(value, names)
    return folded


def names_in(statements: object, kinds: Any = QUANTITIES) -> set[str]:
    """Return the names of functions and of what is of these kinds that statements declare, at any depth."""
    names: set[str] = set()
    for node in nodes_in(statements, tree.ExpressionSyntax):  # none declares a name
        if isinstance(node, kinds):
            names.add(node.name)
            names.update(name for name, _ in getattr(node, "choices", ()))
        elif isinstance(node, tree.FunctionSyntax):
            names |= {node.name, *node.parameters}
    return names


def _has_candidate(text: str) -> bool:
    return any(candidate[2] or candidate[1] in UNITS for candidate in _CANDIDATE.finditer(text))


def _folded(node: Any, names: Set[str]) -> Any:
    """Return a node, or several, with compound units in one literal; the same object if there are none."""
    if isinstance(node, tuple):
        items = tuple(_folded(item, names) for item in node)
        return items if any(new is not old for new, old in zip(items, node, strict=True)) else node
    if not isinstance(node, tree.SyntaxNode) or (
        isinstance(node, tree.ExpressionSyntax) and not _has_candidate(node.span.text)
    ):
        return node
    if isinstance(node, tree.LawSyntax):
        names = names | _letters(_folded(node.equations, names))
    changes = {
        field.name: new
        for field in fields(node)
        if field.name != "span" and (new := _folded(old := getattr(node, field.name), names)) is not old
    }
    node = replace(node, **changes) if changes else node
    if isinstance(node, tree.Power):
        return _folded_power(node)
    return _folded_product(node, names) if isinstance(node, tree.Product) else node


def _letters(equations: object) -> set[str]:
    """Return the letters of all domains of which these equations use a letter."""
    used = {node.head for node in nodes_in(equations) if isinstance(node, tree.PathSyntax)}
    return {
        letter
        for domain in DOMAINS.values()
        if used.intersection(domain.letters)
        for letter in domain.letters
        if letter
    }


def _folded_power(node: tree.Power) -> tree.ExpressionSyntax:
    """Return `5 m^2` as one literal; `(5 m)^2` as it is."""
    power, literal = _exponent(node.exponent), _bracketless(node.base)
    if power is None or literal is None or literal is not node.base or literal.unit is None:
        return node
    source, start, end = literal.span.source, literal.span.end, node.exponent.span.end
    if source.text[start : node.exponent.span.start].strip() != "^":
        return node
    factors = tuple((symbol, exponent * power, span) for symbol, exponent, span in literal.unit.factors)
    unit = tree.Unit(Span(source, literal.unit.span.start, end), factors, literal.unit.number)
    return replace(literal, span=Span(source, literal.span.start, end), unit=unit)


def _folded_product(product: tree.Product, names: Set[str]) -> tree.ExpressionSyntax:
    factors: list[tuple[int, tree.ExpressionSyntax]] = []
    rest = list(product.factors)
    while rest:
        direction, factor = rest.pop(0)
        literal = _bracketless(factor) if direction > 0 else None
        units = [] if literal is None else list(takewhile(lambda f: _symbol(f[1]) not in {"", *names}, rest))
        if literal is not None and 0 < len(units) <= MAXIMUM_UNIT_POWER:
            number = _with_unit(literal, units)
            factor = replace(factor, operand=number) if isinstance(factor, tree.Negative) else number
            del rest[: len(units)]
        factors.append((direction, factor))
    if len(factors) == len(product.factors):
        return product
    return replace(product, factors=tuple(factors)) if len(factors) > 1 else factors[0][1]


def _with_unit(literal: tree.Literal, units: list[tuple[int, tree.ExpressionSyntax]]) -> tree.Literal:
    """Return the literal with more factors in its unit."""
    assert literal.unit is not None
    source, end = literal.span.source, units[-1][1].span.end
    powers = []
    for sign, factor in units:
        power = _exponent(factor.exponent) if isinstance(factor, tree.Power) else Fraction(1)
        assert power is not None
        powers.append((_symbol(factor), sign * power, factor.span))
    unit = tree.Unit(Span(source, literal.unit.span.start, end), (*literal.unit.factors, *powers), literal.unit.number)
    return replace(literal, span=Span(source, literal.span.start, end), unit=unit)


def _exponent(exponent: tree.ExpressionSyntax) -> Fraction | None:
    """Return a number with its sign; None for anything else, and for one that is too large for a unit."""
    literal = exponent.operand if isinstance(exponent, tree.Negative) else exponent
    if not isinstance(literal, tree.Literal) or literal.unit is not None or literal.number > MAXIMUM_UNIT_POWER:
        return None
    return literal.number if literal is exponent else -literal.number


def _bracketless(factor: tree.ExpressionSyntax) -> tree.Literal | None:
    """Return the number with a unit of one symbol without brackets that a factor is, with or without a sign."""
    literal = factor.operand if isinstance(factor, tree.Negative) else factor
    if isinstance(literal, tree.Literal) and literal.unit is not None and "[" not in literal.span.text:
        return literal
    return None


def unit_notes(syntax: SyntaxTree) -> Iterator[str]:
    """Notes on products in which a number with a unit is followed by names that are also symbols of units."""
    if _has_candidate(syntax.source.text):
        yield from ambiguous_products(syntax.statements, syntax.source)


def with_readings(diagnostics: Sequence[Diagnostic], syntax: SyntaxTree) -> list[Diagnostic]:
    """The same errors; those of units name such products on their lines and behind the names on them: beside a mass `m`, `100 N/m` is 100 N over it."""
    if not any(isinstance(item, DimensionMismatch) for item in diagnostics):
        return [*diagnostics]
    notes = [*unit_notes(syntax)]
    items = [node for node in nodes_in(syntax.statements) if isinstance(node, tree.Item)] if notes else []
    return [
        _with_reading(d, syntax.source, items, notes) if isinstance(d, DimensionMismatch) else d for d in diagnostics
    ]


def _with_reading(
    item: DimensionMismatch, home: Source, items: Sequence[tree.Item], notes: Sequence[str]
) -> Diagnostic:
    if _CELSIUS.search(item.what):
        return replace(item, hint="A temperature in Celsius is in `degC`; `C` is the coulomb.")
    if not notes or item.span.source is not home or "is read as" in item.hint:
        return item
    read, before = set(_NAME.findall(home.line(item.span.line))), 0
    while len(read) > before:  # the names of its line, and those that their definitions read
        before = len(read)
        read |= {word for i in items if i.name in read for word in _NAME.findall(i.span.text)}
    readings = [note for note in notes if note.startswith(f"line {item.span.line}:")]
    readings += [note for i in items if i.name in read for note in ambiguous_products(i, home)]
    return replace(
        item, hint="".join(f"In {n.replace(': ', ' ', 1)}. " for n in [*dict.fromkeys(readings)][:2]) + item.hint
    )


def setting_notes(settings: Iterable[Any], names: Callable[[], Set[str]], home: Source) -> Iterator[str]:
    """The same notes on the values of settings, where these names are known; they are not asked for without a reason."""
    for setting in settings:
        if _has_candidate(setting.span.text):
            yield from ambiguous_products(in_one_literal(setting.value, names()), home)


def ambiguous_products(node: object, home: Source) -> Iterator[str]:
    """Notes on a statement, an expression, or several. A place outside of the text `home` is given with its file name."""
    products = [found for found in nodes_in(node) if isinstance(found, tree.Product)]
    for product in sorted(products, key=lambda p: p.span.start):
        yield from _notes(product, home)


def _notes(product: tree.Product, home: Source) -> Iterator[str]:
    for position, (_, factor) in enumerate(product.factors, 1):
        literal = _bracketless(factor)
        units = list(takewhile(lambda f: _symbol(f[1]), product.factors[position:]))
        if literal is None or not units:
            continue
        assert literal.unit is not None
        rest = "".join(f"{_SIGNS[direction]}{f.span.text}" for direction, f in units)
        names = " and ".join(f"`{n}`" for n in dict.fromkeys(_symbol(f) for _, f in units))
        unit = literal.unit.span.text
        number = literal.span.text.removesuffix(unit).strip()
        span = literal.span
        place = f"line {span.line}" if span.source is home else span.source.name
        are = "is a name" if len(units) == 1 else "are names"
        advice = f"for the unit write `{number} [{unit}{rest}]`"
        yield f"{place}: `{number} {unit}{rest}` is read as `{number} [{unit}]{rest}`, where {names} {are} of the model; {advice}"


def _symbol(factor: tree.ExpressionSyntax) -> str:
    """Unit symbol that a factor, or the base of a power, is written as; else empty."""
    base = factor.base if isinstance(factor, tree.Power) and _exponent(factor.exponent) is not None else factor
    return base.head if isinstance(base, tree.PathSyntax) and not base.steps and base.head in UNITS else ""
