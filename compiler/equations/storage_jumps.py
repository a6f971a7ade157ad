"""Jumps of what is differentiated in a storage: its energy, and in derivative form what it stores.

A derivative does not see a jump: no effort would give back what it takes to pass one, and a flow would lack an impulse. Both are compared with
themselves on both sides of each threshold of their conditions, signs and whole numbers, with the parameters of the run.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from itertools import pairwise

from ..algebra.expression import Apply, Expression, Number, call, evaluate, operations, substitute, symbols
from ..errors import Diagnostic
from ..graph.network import BondGraph, Element, PortVariable
from .errors import EnergyJumps, StoredJumps
from .laws import GIVEN, solved
from .naming import port_name
from .tangent import decisive_values

STEPS = ("less", "less_equal", "sign", "floor", "ceil")
GRID = sorted(s * 0.7236 * 10 ** (k / 4) for k in range(-60, 49) for s in (-1, 1))  # of no round numbers
TRIALS = 3  # values of the other stored quantities
EQUAL = 1e-6  # energies that differ by less, in relation to those around, were meant to be equal
MOST = 1000  # whole number of a threshold
HALVINGS = 200


def storage_jumps(element: Element, graph: BondGraph, wanted: tuple[PortVariable, ...]) -> Diagnostic | None:
    """Error for a storage whose energy jumps, or whose stored quantity does in derivative form; None for any other. `wanted`: what its law gives."""
    law, name = element.law, element.name
    derived = [w for w in wanted if w.variable in GIVEN]
    forms = dict(zip(wanted, solved(law, wanted) or (), strict=False)) if derived else {}
    for of, x in ((None, law.energy), *((w, forms.get(w)) for w in derived)):
        values = decisive_values(element, graph) if x is not None and any(True for _ in _steps(x)) else None
        jump = None if x is None or values is None else _jump(x, values)
        if jump is None:
            continue
        variable, place, size = jump
        where = f"`{port_name(element, variable.port, variable.variable)}` = {place:.4g}", f"{size:.4g}"
        if of is None:
            return EnergyJumps(element.span, name, *where)
        return StoredJumps(element.span, port_name(element, of.port, of.variable), *where)
    return None


def _own(x: Expression) -> list[PortVariable]:
    return [s.key for s in symbols(x) if isinstance(s.key, PortVariable)]


def _steps(energy: Expression) -> Iterator[Apply]:
    """Yield the operations of an energy that jump with what is stored."""
    yield from (x for x in operations(energy) if x.operator in STEPS and _own(x))


@lru_cache(maxsize=1024)
def _jump(x: Expression, values: tuple[float, ...]) -> tuple[PortVariable, float, float] | None:
    """A variable of a storage, its value at the jump nearest to zero, and the height of that; None if none was found."""
    energy = substitute(x, lambda s: Number(values[s.key]) if isinstance(s.key, int) else s)
    choose = random.Random(0)
    own, jumps = _own(energy), list[tuple[PortVariable, float, float]]()
    for step in _steps(energy):
        for key in _own(step):
            for _ in range(TRIALS if len(own) > 1 else 1):
                others = {k: choose.uniform(0.2, 1.0) * choose.choice((-1, 1)) for k in own}
                jumps += ((key, *jump) for jump in _heights(energy, step, key, others))
    return min(jumps, key=lambda jump: abs(jump[1]), default=None)


def _heights(
    energy: Expression, step: Apply, key: PortVariable, others: Mapping[PortVariable, float]
) -> Iterator[tuple[float, float]]:
    """Yield the thresholds of a step on the grid at which the energy jumps, each with the height of the jump."""
    left, *rest = step.operands
    whole = step.operator in ("floor", "ceil")
    root = call("sin", Number(math.pi) * left) if whole else left - rest[0] if rest else left

    def at(x: Expression, place: float) -> float:
        try:
            return evaluate(x, {**others, key: place}.__getitem__)
        except (ArithmeticError, ValueError):
            return math.nan

    for low, high in pairwise(GRID):
        a, b = at(root, low), at(root, high)
        if a * b >= 0 or not math.isfinite(a * b):
            continue
        place = _threshold(lambda x: at(root, x), low, high)
        number = round(at(left, place)) if whole else 0
        if abs(number) > MOST:
            continue  # beyond, rounding moves more than the energy
        sides = (number, number + (1 if step.operator == "ceil" else -1)) if whole else (1, -1 if not rest else 0)
        one, other = (at(_with(energy, step, float(v)), place) for v in sides)
        size = abs(one - other)
        if size > EQUAL * max(abs(x) for x in (one, other, at(energy, low), at(energy, high)) if not math.isnan(x)):
            yield place, size


def _threshold(root: Callable[[float], float], low: float, high: float) -> float:
    """Place between two others from which a root no longer has its first sign, by halving."""
    first = root(low)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if root(middle) * first > 0 else (low, middle)
    return high


def _with(x: Expression, node: Apply, value: float) -> Expression:
    """The expression with a number in the place of one of its operations."""
    replaced: dict[Expression, Expression] = {node: Number(value)}

    def walk(y: Expression) -> Expression:
        if isinstance(y, Apply) and y not in replaced:
            replaced[y] = Apply(y.operator, tuple(map(walk, y.operands)))
        return replaced.get(y, y)

    return walk(x)
