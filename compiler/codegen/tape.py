"""Lowered expressions evaluated as they are, without code: for what is asked once, or where second derivatives are.

Values and derivatives along any number of directions at once, by forward accumulation with the compiler's own rules of
differentiation (Griewank and Walther, Evaluating Derivatives, 2008, chapter 3). The derivatives of a Jacobian's entries along the
directions in which an equilibrium moves are the second derivatives that eigenvalues need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..algebra.derivative import partial
from ..algebra.expression import Apply, Expression, Number, Symbol, value_of
from .limits import Leaf

Lookup = Callable[[Leaf], float]


class Tape:
    """Roots in the order in which they are computed. `values` and `slopes` may be asked at as many points as needed."""

    def __init__(self, roots: Sequence[Expression]) -> None:
        self.roots = tuple(roots)
        self._order = _order(self.roots, {})

    def values(self, lookup: Lookup) -> list[float]:
        """The roots at a point; NaN where one has no value there."""
        known = self._known(lookup)
        return [known[root] for root in self.roots]

    def slopes(self, lookup: Lookup, directions: Mapping[Leaf, Any], count: int) -> tuple[list[float], list[Any]]:
        """The roots, and their derivatives along `count` directions, each an array (count,) or None where nothing moves.

        `directions`: how each leaf moves along all of them, an array (count,); what is left out stands still.
        """
        known = self._known(lookup)
        moved: dict[Expression, Any] = {}
        for node in self._order:
            found = _moved(node, known, moved, directions, count)
            if found is not None:
                moved[node] = found
        return [known[root] for root in self.roots], [moved.get(root) for root in self.roots]

    def _known(self, lookup: Lookup) -> dict[Expression, Any]:
        known: dict[Expression, Any] = {}
        for node in self._order:
            known[node] = _value(node, known, lookup)
        return known


def _order(roots: Sequence[Expression], known: Mapping[Expression, Any]) -> list[Expression]:
    """All nodes behind the roots that are not known, operands first."""
    order: list[Expression] = []
    done: set[Expression] = set()
    for root in roots:
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if ready:
                order.append(node)
            elif node not in done and node not in known:
                done.add(node)
                stack.append((node, True))
                if isinstance(node, Apply):
                    stack += [(o, False) for o in reversed(node.operands)]
    return order


def _value(node: Expression, known: Mapping[Expression, Any], lookup: Lookup) -> Any:
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Symbol):
        return float(lookup(node.key))
    assert isinstance(node, Apply)
    values = [known[o] for o in node.operands]
    match node.operator:
        case "solve":
            return _solved(values)
        case "item":
            return float(values[0][int(values[1])])
        case "select":  # the branch not taken may have no value
            return values[1] if values[0] else values[2]
    try:
        return value_of(node.operator, values)
    except (ArithmeticError, ValueError):
        return math.nan


def _solved(values: Sequence[float]) -> Any:
    """The solution of a linear system: matrix by rows, then right side."""
    import numpy as np

    n = math.isqrt(len(values))
    matrix = np.array(values[: n * n], dtype=float).reshape(n, n)
    try:
        return np.linalg.solve(matrix, np.array(values[n * n :], dtype=float))
    except np.linalg.LinAlgError:
        return np.full(n, math.nan)


def _moved(
    node: Expression, known: dict[Expression, Any], moved: Mapping[Expression, Any], directions: Mapping[Leaf, Any], count: int
) -> Any:  # fmt: skip
    """How a node moves; None if it stands still."""
    if isinstance(node, Symbol):
        return directions.get(node.key)
    if not isinstance(node, Apply) or not any(o in moved for o in node.operands):
        return None
    match node.operator:
        case "select":
            return moved.get(node.operands[1 if known[node.operands[0]] else 2])
        case "less" | "less_equal" | "equal" | "and" | "or" | "not":
            return None
        case "solve":
            return _system_moved(node, known, moved, count)
        case "item":
            return moved[node.operands[0]][int(known[node.operands[1]])]
        case "add":
            return sum(moved[o] for o in node.operands if o in moved)
    return sum(_factor(node, i, known) * moved[o] for i, o in enumerate(node.operands) if o in moved)


def _factor(node: Apply, i: int, known: dict[Expression, Any]) -> float:
    """The derivative of an operator by its operand number i."""
    if node.operator == "multiply":
        return float(math.prod(known[o] for j, o in enumerate(node.operands) if j != i))
    slope = partial(node, i)
    for inner in _order((slope,), known):
        known[inner] = _value(inner, known, _no_leaf)
    return float(known[slope])


def _no_leaf(leaf: Leaf) -> float:
    raise AssertionError(leaf)  # all leaves are known before anything is differentiated


def _system_moved(node: Apply, known: Mapping[Expression, Any], moved: Mapping[Expression, Any], count: int) -> Any:
    """A t = r, so A dt = dr - dA t; an array (n, count)."""
    import numpy as np

    n = math.isqrt(len(node.operands))
    values = [known[o] for o in node.operands]
    slopes = np.array([moved.get(o, np.zeros(count)) for o in node.operands])
    matrix = np.array(values[: n * n], dtype=float).reshape(n, n)
    right = slopes[n * n :] - np.einsum("ijk,j->ik", slopes[: n * n].reshape(n, n, count), known[node])
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full((n, count), math.nan)
