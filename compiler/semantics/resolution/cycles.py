"""Rates of angles where cycles are counted: 10 rad/s is no 10 Hz, though both are 1/s."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from typing import Protocol

from ...graph.domains import Domain
from ...graph.network import Reading
from ...graph.units import ONE, SECOND, Scale
from ...syntax import tree
from ..expressions.rates import opened
from ..expressions.scales import bare, counts_cycles, counts_radians, is_decibel, readings, scale_of
from ..expressions.template import Check
from ..names.errors import DimensionMismatch
from ..names.scope import Entry, Pending, Scalar, Scope
from ..names.statement_errors import Wrong


class KnownNames(Protocol):
    """Resolver, as far as it knows what names denote."""

    def file_entry(self, name: str, scope: Scope) -> Entry | None:
        """Return what a name of the file denotes."""

    def step(
        self, entry: Entry, step: tree.Member | tree.Index, name: str, path: tree.PathSyntax, scope: Scope
    ) -> Entry:
        """Return what a name or index after another denotes. Raises `Wrong`."""

    def port_domain(self, node: str, port: str) -> Domain:
        """Return the domain of a port."""


MOST_NAMES = 20  # names that stand for each other
# Digits of 2 pi, pi, 1/(2 pi), 1/pi, 60/(2 pi) and 2 pi/60.
OF_A_TURN = re.compile(r"6\.28|3\.14|\.159|\.318|9\.5[45]|\.104")


def counts_angle(
    names: KnownNames, expression: object, scope: Scope, counts: Callable[[str], bool] = counts_radians, most: int = MOST_NAMES
) -> bool:  # fmt: skip
    """Return True for the rate of an angle: by its unit, the unit that a name is declared or given in, or as the flow of a rotation.

    `counts`: True for a unit that has one, or with `counts_cycles` for those of frequencies.
    """
    parts: Iterable[object] = ()
    match expression:
        case tree.Literal(unit=tree.Unit() as unit):
            return counts(unit.span.text)
        case tree.Negative(operand=operand):
            parts = (operand,)
        case tree.Sum(terms=terms):
            parts = [term for _, term in terms]
        case tree.Call(function="abs" | "min" | "max", arguments=parts) | tree.VectorSyntax(items=parts):
            pass
        case tree.ChoiceSyntax(value=value, otherwise=otherwise):
            parts = (value, otherwise)
        case tree.Product(factors=factors):
            others = [factor for _, factor in factors if not counts_angle(names, factor, scope, counts, most)]
            return len(others) == len(factors) - 1 and all(_is_number(names, o, scope) for o in others)
        case tree.Call(function=name, arguments=arguments):
            own = scope.function(name)
            function = own[0] if own is not None else scope.definition.file.functions.get(name)
            if function is None or len(arguments) != len(function.parameters):
                return False
            body = opened(function.body, (dict(zip(function.parameters, arguments, strict=True)), None))
            return most > 0 and counts_angle(names, body, scope, counts, most // 2)
        case tree.PathSyntax():
            entry = _read(names, expression, scope)
            if isinstance(entry, Pending):
                if entry.item.unit is not None:
                    return counts(entry.item.unit.span.text)
                return most > 0 and counts_angle(names, entry.value, entry.scope, counts, most - 1)
            if isinstance(entry, Scalar) and isinstance(entry.reference, Reading) and counts is counts_radians:
                at = entry.reference
                return at.variable == "f" and names.port_domain(at.node, at.port).name == "rotation"
    return any(counts_angle(names, part, scope, counts, most) for part in parts)


def _read(names: KnownNames, path: tree.PathSyntax, scope: Scope) -> object:
    """Return what a path names; None for `pi`, and for a variable of the law in which it stands."""
    entry = scope.find(path.head) or names.file_entry(path.head, scope)
    try:
        for step in path.steps:
            entry = names.step(entry, step, path.head, path, scope) if entry is not None else None
    except Wrong:
        return None
    return entry


def _is_number(names: KnownNames, expression: object, scope: Scope) -> bool:
    """Return True for a bare number, also by name, unless it turns angles into cycles: a ratio of lengths may do so."""
    if isinstance(expression, tree.PathSyntax):
        entry = _read(names, expression, scope)
        expression = entry.value if isinstance(entry, Pending) else None
    return isinstance(expression, tree.Literal) and bare(expression) and not OF_A_TURN.search(expression.span.text)


def refuse_other_readings(
    names: KnownNames, value: tree.ExpressionSyntax, scope: Scope, item: tree.Item, owner: Scope
) -> None:
    """Raise `Wrong` for the rate of an angle as a quantity in Hz, for a frequency as one in rad/s or rpm, by its declaration or default, and for
    what is set without a unit where it has another reading with that of the declaration or default, which `owner` declares."""
    unit = item.unit if value is item.value else unit_of(item)
    if value is not item.value:
        _refuse_bare_items(names, owner, value, item)
    if unit is not None and not is_decibel(unit) and scale_of(unit).dimension == ONE / SECOND:
        _refuse_rate(names, value, scope, unit.span.text.strip("[] "))


def unit_of(item: tree.Item, place: str = "") -> tree.Unit | None:
    """Return the unit of a declaration, else that of the number in a place of it, as `[1, 2]`; of a sum or product the first one that it has."""
    value: object = item.value
    for number in re.findall("[0-9]+", place):
        value = value.items[min(int(number), len(value.items)) - 1] if isinstance(value, tree.VectorSyntax) else None
    return item.unit or _unit_in(value)


def _unit_in(value: object) -> tree.Unit | None:
    match value:
        case tree.Literal(unit=unit):
            return unit
        case tree.Negative(operand=operand):
            return _unit_in(operand)
        case tree.Sum(terms=parts) | tree.Product(factors=parts):
            return next((unit for _, part in parts if (unit := _unit_in(part)) is not None), None)
    return None


def _unit_by_name(
    names: KnownNames, value: object, scope: Scope, place: str, most: int = MOST_NAMES
) -> tree.Unit | None:
    """Return the unit of a quantity that a name, its negative or a multiple of it stands for; None for anything else."""
    match value:
        case tree.Negative(operand=operand):
            return _unit_by_name(names, operand, scope, place, most)
        case tree.Product(factors=factors):
            rest = [(exponent, factor) for exponent, factor in factors if not bare(factor)]
            return _unit_by_name(names, rest[0][1], scope, place, most) if len(rest) == 1 and rest[0][0] > 0 else None
        case tree.PathSyntax() if most > 0 and isinstance(entry := _read(names, value, scope), Pending):
            own = unit_of(entry.item, place)
            return own or _unit_by_name(names, entry.item.value, entry.owner, place, most - 1)
    return None


def counted(names: KnownNames, owner: Scope, item: tree.Item, place: str = "") -> str:
    """Return the unit of a number if it is another one without it, though both fit: deg, %, dB, and of zero degC; else nothing."""
    unit = unit_of(item, place) or _unit_by_name(names, item.value, owner, place)
    if unit is None or not (
        is_decibel(unit) or (scale := scale_of(unit)).offset or (scale.dimension == ONE and scale != Scale(ONE))
    ):
        return ""
    return unit.span.text.strip("[] ")


def _refuse_bare_items(
    names: KnownNames, owner: Scope, value: tree.ExpressionSyntax, item: tree.Item, place: str = ""
) -> None:
    """Raise `Wrong` for a bare number, alone or in a list, that a quantity is set to."""
    for number, part in enumerate(value.items, 1) if isinstance(value, tree.VectorSyntax) else ():
        _refuse_bare_items(names, owner, part, item, f"{place}[{number}]")
    if bare(value):
        refuse_bare(value, item.name, counted(names, owner, item, place))


def refuse_bare(value: tree.ExpressionSyntax, name: str, unit: str) -> None:
    """Raise `Wrong` for a bare number in the place of one with a unit, but for a zero that is one in all units."""
    if unit and bare(value) and (both := readings(value.span.text, unit)):
        what = f"`{name}` is in {unit}, but `{value.span.text}` is a bare number"
        raise Wrong(DimensionMismatch(value.span, what, f"Write {' or '.join(f'`{one}`' for one in both)}."))


def _refuse_rate(names: KnownNames, value: tree.ExpressionSyntax, scope: Scope, words: str) -> None:
    """Raise `Wrong` for the rate of an angle in cycles, or a frequency as that of an angle."""
    if counts_cycles(words) and counts_angle(names, value, scope):
        what = f"`{value.span.text}` is the rate of an angle, and {words} counts cycles"
        raise Wrong(DimensionMismatch(value.span, what, f"Write `{in_cycles(value)}`."))
    if counts_radians(words):
        refuse_frequencies(names, scope, value, words)


def refuse_frequencies(names: KnownNames, scope: Scope, value: tree.ExpressionSyntax, angle: str) -> None:
    """Raise `Wrong` for a frequency as the rate of an angle, in words or a unit."""
    if counts_angle(names, value, scope, counts_cycles):
        what = f"`{value.span.text}` counts cycles, and {angle} an angle"
        raise Wrong(DimensionMismatch(value.span, what, f"Write `2*pi*({value.span.text})`."))


def refuse_rates_of_angles(names: KnownNames, scope: Scope, *frequencies: tree.ExpressionSyntax) -> None:
    """Raise `Wrong` if one of some frequencies, which count cycles, is the rate of an angle."""
    for node in frequencies:
        if counts_angle(names, node, scope):
            what = f"A frequency counts cycles here, and `{node.span.text}` an angle"
            raise Wrong(DimensionMismatch(node.span, what, f"Write `{in_cycles(node)}`."))


def refuse_mixed_rates(names: KnownNames, scope: Scope, check: Check) -> None:
    """Raise `Wrong` for the rate of an angle as a frequency of a `chirp`, or beside what is one."""
    parts = check.cycles
    if check.function == "chirp" or any(counts_angle(names, part, scope, counts_cycles) for part in parts):
        refuse_rates_of_angles(names, scope, *parts)


def in_cycles(rate: tree.ExpressionSyntax) -> str:
    """Return the rate of an angle as a frequency, as text."""
    words = rate.span.text
    if isinstance(rate, tree.Literal) and rate.unit is not None:
        return f"{scale_of(rate.unit).to_si(rate.number) / (2 * math.pi):.10g} Hz"
    if isinstance(rate, tree.Sum | tree.ChoiceSyntax) and not words.startswith("("):
        words = f"({words})"
    return f"{words}/(2*pi)"
