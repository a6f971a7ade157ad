"""Power series of lowered expressions in time, for derivatives of any order along a motion.

The coefficients of a product are a convolution, those of a function f(a) follow from f' = w a' with the compiler's own partial derivative w
(Griewank and Walther, Evaluating Derivatives, 2008, chapter 13), so each order costs one pass over the graph. Every coefficient is an
array (1 + d, instants): its value and its derivatives along d directions, or a single row if it does not depend on these. None is zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algebra.derivative import partial
from ..algebra.expression import ONE, Apply, Expression, Number, Symbol, symbols
from ..algebra.intervals import plain
from ..algebra.operators import CONDITIONS
from ..algebra.systems import LEADING, SYSTEMS, banded_shape, dense
from ..fast_dataclass import dataclass
from .limits import Leaf
from .tape import operands_first

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Matrix = NDArray[np.floating[Any]]

MOST_FACTORS = 16  # of a power that is multiplied out


@dataclass(frozen=True, slots=True)
class _Step:
    """A node. `operands` are the places of its operands, all before it; `weights` those of its partial derivatives, anywhere, or -1."""

    node: Expression
    operator: str
    operands: tuple[int, ...]
    moving: bool
    weights: tuple[int, ...] = ()


class TaylorSeries:
    """Roots in the order in which they are computed. Leaves whose role is not in `moving` are constant."""

    def __init__(self, roots: Sequence[Expression], moving: frozenset[str] = frozenset({"state", "time"})) -> None:
        self.steps: list[_Step] = []
        self.places: dict[Expression, int] = {}
        self._roles = moving
        opened: dict[Expression, Expression] = {}
        self.roots = tuple(self._place(self._opened(root, opened)) for root in roots)
        waiting = [i for i, step in enumerate(self.steps) if step.moving]
        while waiting:
            self._weigh(waiting.pop(), opened, waiting)

    def _place(self, root: Expression) -> int:
        for node in operands_first((root,), self.places):
            operands = tuple(self.places[o] for o in node.operands) if isinstance(node, Apply) else ()
            moving = any(self.steps[o].moving for o in operands) or (
                isinstance(node, Symbol) and node.key.role in self._roles
            )
            operator = node.operator if isinstance(node, Apply) else ""
            self.places[node] = len(self.steps)
            self.steps.append(_Step(node, operator, operands, moving))
        return self.places[root]

    def _weigh(self, place: int, opened: dict[Expression, Expression], waiting: list[int]) -> None:
        """Place the partial derivatives that the series of a function needs. Operators with a rule of their own need none."""
        step = self.steps[place]
        if not step.operator or step.operator in _RULES or step.operator in CONDITIONS:
            return
        assert isinstance(step.node, Apply)
        weights = []
        for i, operand in enumerate(step.operands):
            if not self.steps[operand].moving:
                weights.append(-1)
                continue
            known = len(self.steps)
            weights.append(self._place(self._opened(partial(step.node, i), opened)))
            waiting += [n for n in range(known, len(self.steps)) if self.steps[n].moving]
        self.steps[place] = _Step(step.node, step.operator, step.operands, True, tuple(weights))

    def _opened(self, x: Expression, known: dict[Expression, Expression]) -> Expression:
        """Rewrite powers by integers as products, and powers with a varying exponent as exponentials."""
        for node in operands_first((x,), known):
            if not isinstance(node, Apply):
                known[node] = node
                continue
            operands = tuple(known[o] for o in node.operands)
            found: Expression | None = None
            if node.operator == "power":
                base, exponent = operands
                found = _multiplied_out(base, exponent)
                if any(s.key.role in self._roles for s in symbols(exponent)):
                    found = Apply("exp", (Apply("multiply", (exponent, Apply("log", (base,)))),))
            known[node] = found or (node if operands == node.operands else Apply(node.operator, operands))
        return known[x]

    def expand(self, given: Mapping[Leaf, Any]) -> Expansion:
        """Begin an expansion. `given` has the coefficients of order zero of all leaves, (1 + d or 1, instants)."""
        return Expansion(self, given)


def _multiplied_out(base: Expression, exponent: Expression) -> Expression | None:
    """A power by an integer as a product, which has a series where its base is zero."""
    n = exponent.value if isinstance(exponent, Number) else math.nan
    if not math.isfinite(n) or n != int(n) or not 1 <= abs(n) <= MOST_FACTORS:
        return None
    product = Apply("multiply", (base,) * int(abs(n))) if abs(n) > 1 else base
    return product if n > 0 else Apply("divide", (ONE, product))


class Expansion:
    """Coefficients of all nodes, order by order."""

    def __init__(self, series: TaylorSeries, given: Mapping[Leaf, Any]) -> None:
        self.series, self.order = series, 0
        self.values: list[Any] = []
        for step in series.steps:
            self.values.append(_value(step, self.values, given))
        self.found: list[list[Any]] = [[] for _ in series.steps]
        for place, step in enumerate(series.steps):
            self.found[place].append(self._first(place, step, given))

    def __getitem__(self, root: int) -> Any:
        """Coefficient of a root of the order computed last; None is zero."""
        return self.found[self.series.roots[root]][-1]

    def advance(self, given: Mapping[Leaf, Any]) -> None:
        """Compute the next order from its coefficients of the leaves. A leaf without coefficient has zero."""
        self.order += 1
        for place, step in enumerate(self.series.steps):
            self.found[place].append(self._next(place, step, given))

    def back(self) -> None:
        """Drop the last order."""
        self.order -= 1
        for coefficients in self.found:
            coefficients.pop()

    def _first(self, place: int, step: _Step, given: Mapping[Leaf, Any]) -> Any:
        if not step.moving:
            value = self.values[place]
            return value if step.operator in SYSTEMS else np.atleast_2d(np.asarray(value, dtype=float))
        if isinstance(step.node, Symbol):
            return given[step.node.key]
        if step.operator in _RULES:
            return _RULES[step.operator](self, step, place)
        value = np.atleast_2d(np.asarray(self.values[place], dtype=float))
        if step.operator in CONDITIONS:
            return value
        parts = [
            times(np.atleast_2d(np.asarray(self.values[w], dtype=float)), self.found[o][0][1:])
            for o, w in zip(step.operands, step.weights, strict=True) if w >= 0 and len(self.found[o][0]) > 1
        ]  # fmt: skip
        moved = plus(*parts)
        if moved is None:
            return value
        return np.concatenate([np.broadcast_to(value, (1, moved.shape[1])), moved])

    def _next(self, place: int, step: _Step, given: Mapping[Leaf, Any]) -> Any:
        if not step.moving or step.operator in CONDITIONS:
            return None
        if isinstance(step.node, Symbol):
            return given.get(step.node.key)
        if step.operator in _RULES:
            return _RULES[step.operator](self, step, place)
        k, parts = self.order, []
        for operand, weight in zip(step.operands, step.weights, strict=True):
            if weight < 0:
                continue
            for j in range(1, k + 1):
                part = times(self.found[operand][j], self.found[weight][k - j])
                if part is not None:
                    parts.append(part * (j / k))
        return plus(*parts)


def _value(step: _Step, values: Sequence[Any], given: Mapping[Leaf, Any]) -> Any:
    """Value alone, (instants,) or a number."""
    node = step.node
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Symbol):
        return np.asarray(given[node.key])[0]
    operands = [values[o] for o in step.operands]
    with np.errstate(all="ignore"):
        match step.operator:
            case "solve":
                return _solved(operands)
            case "banded":
                return _solved(dense(banded_shape(operands), operands, 0.0))
            case "item":
                return operands[0][int(operands[1])]
        return plain(step.operator, operands)


def _solved(operands: Sequence[Any]) -> Any:
    """Solution of a linear system at all instants, (n, instants)."""
    n = math.isqrt(len(operands))
    full = np.stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(o, dtype=float)) for o in operands)))
    matrix = np.moveaxis(full[: n * n].reshape(n, n, -1), -1, 0)
    return _solution(matrix, full[n * n :].T[..., None])[..., 0].T


def _solution(matrix: Matrix, right: Matrix) -> Matrix:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full(right.shape, math.nan)


# ---------------------------------------------------------------- coefficients: value, and derivatives along directions


def plus(*parts: Any) -> Any:
    """Sum of coefficients; None is zero."""
    total = None
    for part in parts:
        if part is None:
            continue
        if total is None:
            total = part
        elif len(total) == len(part):
            total = total + part
        else:
            short, long = (total, part) if len(total) < len(part) else (part, total)
            width = max(short.shape[1], long.shape[1])
            total = np.array(np.broadcast_to(long, (len(long), width)))
            total[:1] += short
    return total


def times(a: Matrix | None, b: Matrix | None) -> Matrix | None:
    """Product of two coefficients, with derivatives by the product rule."""
    if a is None or b is None:
        return None
    if len(a) == 1 or len(b) == 1:
        return a * b
    product = a * b[:1]
    product[1:] += a[:1] * b[1:]
    return product


def over(a: Matrix | None, b: Matrix) -> Matrix | None:
    """a/b."""
    if a is None:
        return None
    if len(b) == 1:
        return a / b
    share = a[:1] / b[:1]
    moved = -share * b[1:]
    if len(a) > 1:
        moved = moved + a[1:]
    return np.concatenate([np.broadcast_to(share, (1, moved.shape[1])), moved / b[:1]])


def minus(a: Matrix | None) -> Matrix | None:
    """-a."""
    return None if a is None else -a


def convolved(a: Sequence[Any], b: Sequence[Any], k: int) -> Any:
    """Coefficient k of a product."""
    return plus(*(times(a[j], b[k - j]) for j in range(k + 1)))


def _added(of: Expansion, step: _Step, place: int) -> Any:
    return plus(*(of.found[o][of.order] for o in step.operands))


def _multiplied(of: Expansion, step: _Step, place: int) -> Any:
    """Product of several factors. The partial products are stored for the next order."""
    first, *others = (of.found[o] for o in step.operands)
    k = of.order
    partials = of.__dict__.setdefault("partials", {}).setdefault(place, [[] for _ in others])
    whole: Sequence[Any] = first
    for factor, kept in zip(others, partials, strict=True):
        del kept[k:]
        kept.append(convolved(whole, factor, k))
        whole = kept
    return whole[k]


def _divided(of: Expansion, step: _Step, place: int) -> Any:
    a, b = (of.found[o] for o in step.operands)
    k, quotient = of.order, of.found[place]
    known = [minus(times(b[j], quotient[k - j])) for j in range(1, k + 1)]
    with np.errstate(all="ignore"):
        return over(plus(a[k], *known), b[0])


def _raised(of: Expansion, step: _Step, place: int) -> Any:
    """Power, from a f' = n f a'; the exponent is constant."""
    base, exponent = (of.found[o] for o in step.operands)
    n, k, powers = exponent[0][:1], of.order, of.found[place]
    with np.errstate(all="ignore"):
        if k == 0:
            a = base[0]
            value = np.power(a[:1], n)
            return np.concatenate([value, n * value / a[:1] * a[1:]])
        parts = []
        for j in range(1, k + 1):
            part = times(base[j], powers[k - j])
            if part is not None:
                parts.append(part * ((n * j - (k - j)) / k))
        return over(plus(*parts), base[0])


def _chosen(of: Expansion, step: _Step, place: int) -> Any:
    condition = np.atleast_1d(np.asarray(of.values[step.operands[0]])).astype(bool)
    a, b = (of.found[o][of.order] for o in step.operands[1:])
    if a is None and b is None:
        return None
    depth = max(len(x) for x in (a, b) if x is not None)
    width = max(x.shape[1] for x in (a, b, condition[None]) if x is not None)
    full = [np.zeros((depth, width)) for _ in range(2)]
    for target, x in zip(full, (a, b), strict=True):
        if x is not None:
            target[: len(x)] = x
    return np.where(condition[None], *full)


def _system(of: Expansion, step: _Step, place: int) -> Any:
    """Linear system A t = r: A0 t_k = r_k - sum of A_j t_(k-j), values first, then along the directions."""
    k, operands = of.order, list(step.operands)
    if step.operator == "banded":
        operands = dense(banded_shape([of.values[o] for o in operands[:LEADING]]), operands, -1)
    n, nothing = math.isqrt(len(operands)), [None] * (k + 1)
    entries = [of.found[o] if o >= 0 else nothing for o in operands]
    rights = []
    for i in range(n):
        known = [
            minus(times(entries[i * n + c][j], _item(of.found[place][k - j], c)))
            for c in range(n) for j in range(1, k + 1)
        ]  # fmt: skip
        rights.append(plus(entries[n * n + i][k], *known))
    if all(r is None for r in rights):
        return None
    firsts = [entries[i][0] for i in range(n * n)]
    depth = max(len(x) for x in (*firsts, *rights) if x is not None)
    width = max(x.shape[1] for x in (*firsts, *rights) if x is not None)
    matrix = np.stack([_filled(x, depth, width) for x in firsts]).reshape(n, n, depth, width)
    right = np.stack([_filled(x, depth, width) for x in rights])
    plain = np.moveaxis(matrix[:, :, 0], -1, 0)
    solution = np.zeros((n, depth, width))
    solution[:, 0] = _solution(plain, right[:, 0].T[..., None])[..., 0].T
    if depth > 1:
        moved = right[:, 1:] - np.einsum("ijdw,jw->idw", matrix[:, :, 1:], solution[:, 0])
        solution[:, 1:] = np.moveaxis(_solution(plain, np.moveaxis(moved, -1, 0)), 0, -1)
    return solution


def _filled(x: Matrix | None, depth: int, width: int) -> Matrix:
    full = np.zeros((depth, width))
    if x is not None:
        full[: len(x)] = x
    return full


def _item(x: Any, i: int) -> Any:
    return None if x is None else (x[i] if x.ndim == 3 else x[i][None])


def _picked(of: Expansion, step: _Step, place: int) -> Any:
    return _item(of.found[step.operands[0]][of.order], int(of.values[step.operands[1]]))


_RULES: Mapping[str, Any] = {
    "add": _added, "multiply": _multiplied, "divide": _divided, "power": _raised, "select": _chosen, "solve": _system, "banded": _system, "item": _picked,
}  # fmt: skip
