"""What an expression depends on: parameters, time, inputs, states, the mode, as bits."""

from __future__ import annotations

from collections.abc import Iterable

from ..algebra.expression import Apply, Expression, Number, Symbol
from .limits import Leaf

PARAMETER, TIME, INPUT, STATE, MODE, EVENT = (
    1,
    2,
    4,
    8,
    16,
    32,
)  # what a node depends on, as bits; EVENT: on states once


BITS = {"parameter": PARAMETER, "time": TIME, "input": INPUT, "state": STATE, "mode": MODE}


def dependences_of(roots: Iterable[Expression], symbols: dict[Expression, int]) -> dict[int, int]:
    """Of all nodes behind the roots, by identity. `symbols`: what is known of these."""
    found: dict[int, int] = {}
    for root in roots:
        stack = [root]
        while stack:
            node = stack[-1]
            if id(node) in found:
                stack.pop()
            elif not isinstance(node, Apply):
                found[id(node)] = dependence_of(node, symbols)
                stack.pop()
            else:
                missing = [o for o in node.operands if id(o) not in found]
                if missing:
                    stack += missing
                    continue
                bits = 0
                for operand in node.operands:
                    bits |= found[id(operand)]
                found[id(node)] = bits
                stack.pop()
    return found


def dependence_of(x: Expression, known: dict[Expression, int]) -> int:
    stack = [x]
    while stack:
        node = stack[-1]
        if node in known:
            stack.pop()
            continue
        if isinstance(node, Symbol):
            assert isinstance(node.key, Leaf)
            known[node] = BITS[node.key.role]
        elif isinstance(node, Number):
            known[node] = 0
        else:
            assert isinstance(node, Apply)
            missing = [o for o in node.operands if o not in known]
            if missing:
                stack += missing
                continue
            bits = 0
            for operand in node.operands:
                bits |= known[operand]
            known[node] = bits
        stack.pop()
    return known[x]
