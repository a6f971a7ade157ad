"""Dependence on run-time parameters: arguments of a program, by their names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ..algebra.expression import Expression, Symbol
from ..algebra.formula import Bound, leaf, over
from .network import Named, Quantity


def behind(names: Iterable[str], quantities: Mapping[str, Named]) -> frozenset[str]:
    """Some quantities, and all that their definitions read, directly or not."""
    found, waiting = set[str](), list(names)
    while waiting:
        name = waiting.pop()
        if name in found or name not in quantities:
            continue
        found.add(name)
        definition = quantities[name].definition
        if definition is not None:
            waiting += quantities_in(definition)
    return frozenset(found)


def quantities_in(bound: Bound) -> set[str]:
    """Names of the quantities that a formula reads itself."""
    return {a.name for a in bound.arguments if isinstance(a, Quantity)}


def over_arguments(bound: Bound, quantities: Mapping[str, Named]) -> Expression:
    """Expression with all definitions put in: its symbols are the names of quantities without definition."""
    known: dict[str, Expression] = {}

    def value(reference: object) -> Expression:
        return known[reference.name] if isinstance(reference, Quantity) else leaf(reference)

    def read(definition: Bound) -> list[str]:
        return [a.name for a in definition.arguments if isinstance(a, Quantity) and a.name not in known]

    rows: list[tuple[str, Bound]] = [("", bound)]
    while rows:  # not by recursion: a row of quantities may be longer than Python nests calls
        name, definition = rows[-1]
        missing = read(definition)
        if missing:
            inner = quantities[missing[0]].definition
            if inner is None:
                known[missing[0]] = Symbol(missing[0])
            else:
                rows.append((missing[0], inner))
            continue
        rows.pop()
        known[name] = over(definition.formula.expression, definition.arguments, value)
    return known[""]
