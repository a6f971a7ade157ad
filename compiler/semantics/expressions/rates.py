"""Rates that stand beside each other in the text, with what is written for parameters of functions: frequencies are no rates of angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from fractions import Fraction
from typing import Any

from ...graph.units import ONE, SECOND
from ...source import Source, Span
from ...syntax import tree
from .lists import parts_of
from .template import Check, OwnVariable, Typed, Value

RATE = ONE / SECOND
_RADIANS = Span(Source("", "rad/s"), 0, 5)
RATE_OF_ANGLE = tree.Literal(_RADIANS, 0, Fraction(1), tree.Unit(_RADIANS, (), Fraction(1)))  # a law's own `omega`
# Names, with what is written for them, and those around where that is written.
Written = tuple[Mapping[str, tree.ExpressionSyntax], "Written | None"]


def own_rates(own: Mapping[str, OwnVariable | Sequence[OwnVariable]]) -> Written | None:
    """Return the rates of angles among a law's own variables."""
    rates = {
        words: RATE_OF_ANGLE
        for words, variables in own.items()
        for one in ([variables] if isinstance(variables, OwnVariable) else variables)
        if one.own.variable == "f" and one.dimension == RATE
    }
    return (rates, None) if rates else None


def rates_in(node: tree.ExpressionSyntax, value: Value, written: Written | None) -> tuple[Check, ...]:
    """Return a check of the frequencies of a chirp, and of rates beside each other. `value`: that of the node, or of the sides of a comparison."""
    match node:
        case tree.Call(function="chirp", arguments=(_, *rates)):
            return (Check("chirp", node.span, (), (), cycles=opened(tuple(rates[:2]), written)),)
        case tree.Call(function="min" | "max", arguments=rates):
            pass
        case tree.Sum():
            rates = [term for _, term in node.terms]
        case tree.Comparison():
            rates = [node.left, node.right]
        case _:
            return ()
    if (isinstance(value, Typed) and value.truth) or not any(part.dimension == RATE for part in parts_of(value)):
        return ()
    put = opened(tuple(rates), written)
    return (
        ()
        if all(isinstance(r, tree.Literal) and r.unit is RATE_OF_ANGLE.unit for r in put)
        else (Check("", node.span, (), (), cycles=put),)
    )


def opened(node: Any, written: Written | None) -> Any:
    """Return a part of the text with what is written for names in their places, which is read with the names around the call."""
    match node:
        case tree.PathSyntax() if written is not None and (node.words in written[0] or node.head in written[0]):
            put = written[0].get(node.words, written[0].get(node.head))
            return replace(put, span=node.span) if put is RATE_OF_ANGLE else opened(put, written[1])
        case tree.SyntaxNode() if written is not None:
            return replace(node, **{f.name: opened(getattr(node, f.name), written) for f in fields(node)})
        case tuple():
            return tuple([opened(part, written) for part in node])
    return node
