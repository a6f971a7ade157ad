"""Operations in an order in which each has its operands before it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..algebra.expression import Apply, Expression


def operations_in_order(roots: Sequence[Expression], known: Mapping[Expression, object]) -> list[Apply]:
    """The operations behind the roots that are not known, operands first."""
    order: list[Apply] = []
    met: set[int] = set()  # by identity, which is quick; of equal ones the first counts
    done: set[Expression] = set()
    for root in roots:
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if ready:
                assert isinstance(node, Apply)
                order.append(node)
                continue
            if id(node) in met or not isinstance(node, Apply):
                continue
            met.add(id(node))
            if node in done or node in known:
                continue
            done.add(node)
            stack.append((node, True))
            stack += [(o, False) for o in reversed(node.operands)]
    return order
