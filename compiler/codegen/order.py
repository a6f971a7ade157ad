"""Operations in an order in which they can be computed."""

from __future__ import annotations

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
) -> tuple[list[Apply], dict[Expression, int]]:
    """Operations behind the roots, operands first, and the number of uses of each."""
    uses: dict[Expression, int] = {}
    order: list[Apply] = []
    done: set[Expression] = set()
    for root in roots:
        uses[root] = uses.get(root, 0) + 1
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if ready:
                assert isinstance(node, Apply)
                order.append(node)
                continue
            if node in done or not isinstance(node, Apply) or node in known:
                continue
            done.add(node)
            stack.append((node, True))
            for operand in node.operands:
                uses[operand] = uses.get(operand, 0) + 1
            stack += [(o, False) for o in reversed(node.operands)]
    return order, uses
