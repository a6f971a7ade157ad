"""Dependence of expressions on parameters, time, inputs, states and the mode, as bits."""

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
)  # bits of a dependence; EVENT: on states at an event


BITS = {"parameter": PARAMETER, "time": TIME, "input": INPUT, "state": STATE, "mode": MODE}


def dependences_of(roots: Iterable[Expression], symbols: dict[Expression, int]) -> dict[int, int]:
    """Dependences of all nodes behind the roots, by identity. `symbols` gives those of the symbols."""
    found: dict[int, int] = {}
    for root in roots:
        stack: list[Expression | None] = [root]
        while stack:
            node = stack.pop()
            if node is None:  # the node below it follows its operands
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
    """Dependence of one node. `known` holds dependences that are computed already; new ones are added."""
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
