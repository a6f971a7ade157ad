"""What an expression depends on: parameters, time, inputs, states, the mode, as bits."""

from __future__ import annotations

from collections.abc import Iterable

from ..algebra.expression import Apply, Expression, Symbol
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
        stack: list[Expression | None] = [root]
        while stack:
            node = stack.pop()
            if node is None:  # what stands below it has its operands before it
                node = stack.pop()
                assert type(node) is Apply
                bits = 0
                for operand in node.operands:
                    bits |= found[id(operand)]
                found[id(node)] = bits
            elif id(node) not in found:
                if type(node) is Apply:
                    stack += (node, None)
                    stack += node.operands
                else:
                    found[id(node)] = dependence_of(node, symbols)
    return found


def dependence_of(x: Expression, known: dict[Expression, int]) -> int:
    """Of one node; `known` is what is known already, and grows."""
    found = known.get(x)
    if found is not None:
        return found
    stack: list[Expression | None] = [x]
    while stack:
        node = stack.pop()
        if node is None:
            node = stack.pop()
            assert type(node) is Apply
            bits = 0
            for operand in node.operands:
                bits |= known[operand]
            known[node] = bits
        elif node not in known:
            if type(node) is Apply:
                stack += (node, None)
                stack += node.operands
            elif type(node) is Symbol:
                assert isinstance(node.key, Leaf)
                known[node] = BITS[node.key.role]
            else:
                known[node] = 0
    return known[x]
