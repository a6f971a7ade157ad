"""Lowered expressions evaluated without code, for single evaluations and for second derivatives.

Values and derivatives along any number of directions at once, by forward accumulation with the compiler's own rules of
differentiation (Griewank and Walther, Evaluating Derivatives, 2008, chapter 3). The derivatives of a Jacobian's entries along the
directions in which an equilibrium moves are the second derivatives that eigenvalues need. Nodes are numbered once, so that each of
many points costs one pass over a list of steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial as bound
from typing import Any

from ..algebra.derivative import partial
from ..algebra.expression import Apply, Expression, Number, Symbol
from ..algebra.operators import CURVES, value_of
from ..algebra.systems import LEADING, SYSTEMS, banded_shape, dense
from ..algebra.table import jumps_at_knots
from .limits import Leaf

Lookup = Callable[[Leaf], float]
Step = tuple[int, Callable[[Any], Any], tuple[int, ...]]  # place of a value, function, places of its operands
STILL = frozenset({"less", "less_equal", "equal", "and", "or", "not"})  # operators whose values do not move


class Tape:
    """Roots in the order in which they are computed. `values` and `slopes` may be called at as many points as needed."""

    def __init__(self, roots: Sequence[Expression]) -> None:
        self.roots = tuple(roots)
        self._slots: dict[Expression, int] = {}
        self._nodes: list[Expression] = []
        self._leaves: list[tuple[int, Leaf]] = []
        self._steps = self._appended(self.roots)
        self._count = len(self._nodes)
        self._places = [self._slots[root] for root in self.roots]
        self._forward: dict[frozenset[Leaf], list[_Moved]] = {}
        self._between: list[Step] = []  # to the partial derivatives of operators, for all directions

    def jumps(self) -> bool:
        """True if a root contains a choice, or a derivative of a table that jumps at its points."""
        applied = (node for node in self._nodes if isinstance(node, Apply))
        return any(node.operator == "select" or (node.operator in CURVES and jumps_at_knots(node)) for node in applied)

    def values(self, lookup: Lookup) -> list[float]:
        """Values of the roots at a point; NaN for a root without a value there."""
        known = self._known(lookup)
        return [known[place] for place in self._places]

    def slopes(self, lookup: Lookup, directions: Mapping[Leaf, Any], count: int) -> tuple[list[float], list[Any]]:
        """The roots, and their derivatives along `count` directions, each an array (count,) or None if it is constant.

        `directions`: derivative of each leaf along all of them, an array (count,). A leaf that is missing is constant.
        """
        forward = self._forward.get(key := frozenset(directions))
        if forward is None:
            forward = self._forward[key] = self._moving(key)
        known = self._known(lookup)
        _taken(self._between, known)
        moved: list[Any] = [None] * len(known)
        for slot, leaf in self._leaves:
            moved[slot] = directions.get(leaf)
        for step in forward:
            moved[step.slot] = step.moved(known, moved, count)
        return [known[place] for place in self._places], [moved[place] for place in self._places]

    def _known(self, lookup: Lookup) -> list[Any]:
        """Values of all nodes, with room for those that only derivatives need."""
        known: list[Any] = [node.value if isinstance(node, Number) else None for node in self._nodes]
        for slot, leaf in self._leaves:
            known[slot] = float(lookup(leaf))
        _taken(self._steps, known)
        return known

    def _appended(self, roots: Sequence[Expression]) -> list[Step]:
        """Steps that compute some roots from nodes that have steps already."""
        steps: list[Step] = []
        for node in operands_first(roots, self._slots):
            slot = self._slots[node] = len(self._nodes)
            self._nodes.append(node)
            if isinstance(node, Symbol):
                self._leaves.append((slot, node.key))
            elif isinstance(node, Apply):
                steps.append((slot, _function(node.operator), tuple(self._slots[o] for o in node.operands)))
        return steps

    def _moving(self, leaves: frozenset[Leaf]) -> list[_Moved]:
        """Derivative rules of all nodes that depend on some leaves, operands first."""
        moving = {slot for slot, leaf in self._leaves if leaf in leaves}
        steps: list[_Moved] = []
        for slot in range(self._count):
            node = self._nodes[slot]
            if not isinstance(node, Apply) or node.operator in STILL:
                continue
            operands = tuple(self._slots[o] for o in node.operands)
            along = tuple(i for i, o in enumerate(operands) if o in moving)
            if along:
                moving.add(slot)
                steps.append(_Moved(slot, node.operator, operands, along, self._factors(node, along)))
        return steps

    def _factors(self, node: Apply, along: Sequence[int]) -> list[int]:
        """For each operand that varies, the place of the partial derivative by it."""
        if node.operator in ("add", "multiply", "select", "item") or node.operator in SYSTEMS:
            return []
        slopes = [partial(node, i) for i in along]
        for slope in slopes:
            self._between += self._appended((slope,))
        return [self._slots[slope] for slope in slopes]


class _Moved:
    """Derivative rule of one node."""

    __slots__ = ("along", "factors", "operands", "operator", "slot")

    def __init__(self, slot: int, operator: str, operands: tuple[int, ...], along: tuple[int, ...], factors: list[int]) -> None:  # fmt: skip
        self.slot, self.operator, self.operands, self.along, self.factors = slot, operator, operands, along, factors

    def moved(self, known: list[Any], moved: list[Any], count: int) -> Any:
        """Derivative along the directions: an array (count,), for a solution (n, count); None if it is constant at this point."""
        operands = self.operands
        match self.operator:
            case "select":
                return moved[operands[1 if known[operands[0]] else 2]]
            case "solve":
                return _system_moved(operands, known[self.slot], known, moved, count)
            case "banded":
                places = dense(banded_shape([known[o] for o in operands[:LEADING]]), operands, -1)
                return _system_moved(places, known[self.slot], known, moved, count)
            case "item":
                return None if moved[operands[0]] is None else moved[operands[0]][int(known[operands[1]])]
        result: Any = None
        for number, i in enumerate(self.along):
            change = moved[operands[i]]
            if change is None:
                continue
            if self.operator != "add":
                change = change * self._factor(number, i, known)
            result = change if result is None else result + change
        return result

    def _factor(self, number: int, i: int, known: list[Any]) -> float:
        """Partial derivative of the operator by its operand i."""
        if self.operator == "multiply":
            return float(math.prod(known[o] for j, o in enumerate(self.operands) if j != i))
        return float(known[self.factors[number]])


def _taken(steps: Sequence[Step], known: list[Any]) -> None:
    """Fill in the values that the steps compute; NaN where there is none."""
    for slot, function, operands in steps:
        try:
            known[slot] = function([known[o] for o in operands])
        except (ArithmeticError, ValueError):
            known[slot] = math.nan


def operands_first(roots: Sequence[Expression], known: Mapping[Expression, Any]) -> list[Expression]:
    """All nodes behind the roots that are not in `known`, operands first."""
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


def _function(operator: str) -> Callable[[Any], Any]:
    """Function from the list of its operands to the value of an operator."""
    match operator:
        case "add":
            return math.fsum
        case "multiply":
            return math.prod
        case "solve":
            return _solved
        case "banded":
            return lambda values: _solved(dense(banded_shape(values), values, 0.0))
        case "item":
            return lambda values: float(values[0][int(values[1])])
        case "select":  # the branch not taken may have no value
            return lambda values: values[1] if values[0] else values[2]
    return bound(value_of, operator)


def _solved(values: Sequence[float]) -> Any:
    """Solution of a linear system: matrix by rows, then right side."""
    import numpy as np

    n = math.isqrt(len(values))
    matrix = np.array(values[: n * n], dtype=float).reshape(n, n)
    try:
        return np.linalg.solve(matrix, np.array(values[n * n :], dtype=float))
    except np.linalg.LinAlgError:
        return np.full(n, math.nan)


def _system_moved(
    operands: Sequence[int], solution: Any, known: Sequence[Any], moved: Sequence[Any], count: int
) -> Any:
    """Derivative of the solution of A t = r: A dt = dr - dA t; an array (n, count)."""
    import numpy as np

    n = math.isqrt(len(operands))
    still = np.zeros(count)
    slopes = np.array([still if o < 0 or moved[o] is None else moved[o] for o in operands])
    matrix = np.array([known[o] if o >= 0 else 0.0 for o in operands[: n * n]], dtype=float).reshape(n, n)
    right = slopes[n * n :] - np.einsum("ijk,j->ik", slopes[: n * n].reshape(n, n, count), solution)
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full((n, count), math.nan)
