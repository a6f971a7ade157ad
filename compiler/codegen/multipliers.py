"""Multipliers of closing joints, solved for symbolically: sparse L D L' as straight-line expressions.

The accelerations of the constraint residuals are affine in the multipliers. Their matrix J M^-1 J' is symmetric, positive semidefinite
and as sparse as the connection of the loops. It is factorised in an order of least degree, chosen here on integers, so that the number
of operations grows linearly with the number of loops, not cubically. A pivot that is negligible beside its own diagonal belongs to a
row that depends on those before it: the row is dropped, and its multiplier is zero.

The Jacobian is not formed from this solution, since the inverse of the matrix is full. It is that of the larger system in states and
multipliers, which is as sparse as the mechanism; its users eliminate the multipliers numerically.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ..algebra.expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    multiply,
    negate,
    rebuild,
    select,
)
from ..algebra.systems import SYSTEMS
from ..reduction import StateSpace
from .limits import Leaf
from .lowered import Lowered, Solved

DROPPED = 1e-14  # share of its own diagonal below which a pivot is dropped: round-off of cancelling terms
LARGEST = 40_000  # products of a factorisation that is written out; beyond that it is left to a dense solver

Matrix = dict[tuple[int, int], Expression]  # the lower triangle


def solve_multipliers(lowered: Lowered) -> Solved | None:
    """Solve for the multipliers. Returns None if a run has none."""
    space, states = lowered.space, len(lowered.space.states)
    unknowns = {u.variable: states + i for i, u in enumerate(space.unknowns)}
    bound = [i for i in space.invariants if i.multiplier is not None]
    if not bound:
        return None
    places = [unknowns[v] for v in solved_for(space)]
    leaves: list[Expression] = [Symbol(Leaf("state", p)) for p in places]
    parts: list[Expression] = [Number(1.0) if i.part is None else lowered.values[i.part] for i in bound]
    parts += [Number(1.0) for _ in space.balances]
    matrix: Matrix = {}
    for i, row in enumerate(places):
        for j in range(i + 1):
            entry = lowered.jacobian.get((row, places[j]))
            if entry is not None:
                matrix[i, j] = entry if i == j else multiply(parts[j], entry)
    at_zero = _Replacing(dict.fromkeys(leaves, ZERO))
    right = [negate(at_zero(lowered.rates[p])) for p in places]
    values = _solution(matrix, right, len(bound))
    put = _Replacing(dict(zip(leaves, values, strict=True)))
    chosen = set(places)
    rates = tuple(ZERO if p in chosen else put(x) for p, x in enumerate(lowered.rates))
    return Solved(rates, tuple(values))


def solved_for(space: StateSpace) -> tuple[int, ...]:
    """Unknowns that a program solves for symbolically: multipliers, then balances."""
    return (
        *(i.multiplier for i in space.invariants if i.multiplier is not None),
        *(b.variable for b in space.balances),
    )


def _solution(matrix: Matrix, right: list[Expression], multipliers: int) -> list[Expression]:
    """Solve the system. The first rows belong to multipliers; the other rows have pivots only after these are eliminated, and drop none."""
    count = len(right)
    order, fill, products = _order(matrix, count, multipliers)
    if products > LARGEST:
        whole = [matrix.get((max(i, j), min(i, j)), ZERO) for i in range(count) for j in range(count)]
        node = Apply("solve", (*whole, *right))
        return [Apply("item", (node, Number(float(i)))) for i in range(count)]
    work = dict(matrix)
    rest = list(right)
    inverse: dict[int, Expression] = {}
    lower: dict[int, list[tuple[int, Expression]]] = {}
    for k in order:
        own, pivot = matrix.get((k, k), ZERO), work.get((k, k), ZERO)
        inverse[k] = _inverse(pivot, own if k < multipliers else pivot)
        lower[k] = []
        for i in fill[k]:
            factor = multiply(work[_pair(i, k)], inverse[k])
            lower[k].append((i, factor))
            rest[i] = rest[i] - factor * rest[k]
            for j in fill[k]:
                if j <= i:
                    work[i, j] = work.get((i, j), ZERO) - factor * work[_pair(j, k)]
    values: dict[int, Expression] = {}
    for k in reversed(order):
        values[k] = add(multiply(rest[k], inverse[k]), *(negate(factor * values[i]) for i, factor in lower[k]))
    return [values[k] for k in range(count)]


def _inverse(pivot: Expression, own: Expression) -> Expression:
    if pivot == own:
        return divide(Number(1.0), pivot)
    return select(call("less", multiply(Number(DROPPED), own), pivot), divide(Number(1.0), pivot), ZERO)


def _pair(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i >= j else (j, i)


def _order(
    matrix: Mapping[tuple[int, int], Expression], count: int, first: int
) -> tuple[list[int], dict[int, list[int]], int]:
    """Elimination order of least degree (Tinney and Walker, Proc. IEEE 55, 1967), with the `first` ones before the others.

    Returns the order, the rows that each pivot reaches, and the number of products.
    """
    near: list[set[int]] = [set() for _ in range(count)]
    for i, j in matrix:
        if i != j:
            near[i].add(j)
            near[j].add(i)
    left, order, fill, products = set(range(count)), [], {}, 0
    while left:
        k = min(left, key=lambda v: (v >= first, len(near[v]), v))
        left.discard(k)
        reached = sorted(near[k])
        order.append(k)
        fill[k] = reached
        products += len(reached) * (len(reached) + 3) // 2 + 1
        for i in reached:
            near[i].discard(k)
            near[i].update(j for j in reached if j != i)
    return order, fill, products


class _Replacing:
    """Replacement of symbols in many expressions with shared parts. Not recursive, as the expressions may be deep."""

    def __init__(self, values: Mapping[Expression, Expression]) -> None:
        self.known: dict[Expression, Expression] = dict(values)

    def __call__(self, x: Expression) -> Expression:
        stack = [x]
        while stack:
            node = stack[-1]
            if node in self.known or not isinstance(node, Apply):
                self.known.setdefault(node, node)
                stack.pop()
                continue
            missing = [o for o in node.operands if o not in self.known]
            if missing:
                stack += missing
                continue
            self.known[node] = self._rebuilt(node, (self.known[o] for o in node.operands))
            stack.pop()
        return self.known[x]

    @staticmethod
    def _rebuilt(node: Apply, operands: Iterable[Expression]) -> Expression:
        new = tuple(operands)
        if new == node.operands:
            return node
        plain = node.operator in SYSTEMS or node.operator == "item"
        return Apply(node.operator, new) if plain else rebuild(node.operator, new)
