"""Dependence of expressions on parameters, time, inputs, states and the mode, as bits."""

from __future__ import annotations

from ..algebra.expression import Apply, Expression, Symbol
from .limits import Leaf

# Bits of a dependence. EVENT: on states at an event.
PARAMETER, TIME, INPUT, STATE, MODE, EVENT = (2**i for i in range(6))
BITS = {"parameter": PARAMETER, "time": TIME, "input": INPUT, "state": STATE, "mode": MODE}


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
