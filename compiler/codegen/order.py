"""Operations in an order in which they can be computed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from ..algebra.expression import Apply, Expression


def operations_in_order(roots: Sequence[Expression], known: Mapping[Expression, object]) -> list[Apply]:
    """Operations behind the roots, operands first, without those in `known`."""
    order: list[Apply] = []
    met: set[int] = set()  # by identity, which is quick; of equal ones the first counts
    done: set[Expression] = set()
    for root in roots:
        if type(root) is not Apply or id(root) in met:
            continue
        stack: list[Apply | None] = [root]
        while stack:
            node = stack.pop()
            if node is None:  # the node below it follows its operands
                ready = stack.pop()
                assert ready is not None
                order.append(ready)
                continue
            if id(node) in met:
                continue
            met.add(id(node))
            before = len(done)
            done.add(node)
            if len(done) == before or (known and node in known):
                continue
            stack += (node, None)
            for operand in node.operands[::-1]:
                if type(operand) is Apply and id(operand) not in met:
                    stack.append(operand)
    return order


def in_order(
    roots: Sequence[Expression], known: Mapping[Expression, object]
) -> tuple[list[Apply], Counter[Expression]]:
    """Operations behind the roots, operands first, and the number of uses of each."""
    order, uses = operations_in_order(roots, known), Counter(roots)
    for node in order:
        uses.update(node.operands)
    return order, uses
