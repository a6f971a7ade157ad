"""Jumps of what is differentiated in a storage: its energy, and in derivative form what it stores.

A derivative does not see a jump: no effort would give back what it takes to pass one, and a flow would lack an impulse. Both are compared with
themselves on both sides of each threshold of their conditions, signs, whole numbers and of the cut of `atan2`, with the parameters of the run. Thresholds
are roots of one stored quantity: its first slopes cut the line into pieces on which a root changes its sign at most once, so that none lies hidden
between two others. The other quantities have some values, and then such beside their own thresholds.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, lru_cache, partial
from itertools import pairwise

from ..algebra.derivative import derivative
from ..algebra.expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    call,
    evaluate,
    operations,
    substitute,
    symbols,
)
from ..errors import Diagnostic
from ..graph.network import BondGraph, Element, PortVariable
from .errors import EnergyJumps, StoredJumps
from .laws import GIVEN, solved
from .system import port_name
from .tangent import decisive_values

WHOLE = ("floor", "ceil")
STEPS = ("less", "less_equal", "sign", "atan2", *WHOLE)
GRID = sorted(s * 0.7236 * 10 ** (k / 4) for k in range(-60, 49) for s in (-1, 1))  # of no round numbers
TRIALS = 3  # values of the other stored quantities
MORE = 12  # more of them, beside the thresholds that they have themselves
ORDERS = 3  # a root and its first derivatives, at whose signs it is cut into pieces that rise or fall
# Relative distances of the energies by which a jump is measured, no round numbers.
AROUND = (-0.4436, -0.0731, 0.1129, 0.7236)
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
    choose, own = random.Random(0), _own(energy)
    pairs = [(step, key) for step in _steps(energy) for key in _own(step)]
    thresholds: dict[PortVariable, list[float]] = {key: [] for key in own}
    jumps = list[tuple[PortVariable, float, float]]()
    for trial in range((TRIALS + MORE) if len(own) > 1 else 1):
        near = {k: [p + s * (0.1 * abs(p) or 0.1) for p in places for s in (-1, 1)] for k, places in thresholds.items()}
        others = {
            k: choose.uniform(0.2, 1.0) * choose.choice((-1, 1))
            if trial < TRIALS or not near[k]
            else choose.choice(near[k])
            for k in own
        }
        for step, key in pairs:
            if trial < TRIALS or len(_own(step)) > 1 or not thresholds[key]:
                places = list(_places(step, key, others))
                thresholds[key] += places[:MORE]
            else:  # the same as before, whatever the others are
                places = thresholds[key]
            sizes = ((place, _height(energy, step, key, others, place)) for place in places)
            jumps += ((key, place, size) for place, size in sizes if size > 0)
        if jumps:
            break
    return min(jumps, key=lambda jump: abs(jump[1]), default=None)


def _at(x: Expression, key: PortVariable, others: Mapping[PortVariable, float], place: float) -> float:
    """Value of an expression at a place; NaN where it has none."""
    try:
        return evaluate(x, {**others, key: place}.__getitem__)
    except (ArithmeticError, ValueError):
        return math.nan


def _places(step: Apply, key: PortVariable, others: Mapping[PortVariable, float]) -> Iterator[float]:
    """Yield the thresholds of a step: sign changes of its root on the grid, and between two points of the grid about the extrema that its slopes show."""
    left, *rest = step.operands
    root = left if step.operator == "atan2" or not rest else left - rest[0]
    if step.operator in WHOLE:
        root = call("sin", Number(math.pi) * left)
    forms = [root]
    while len(forms) < ORDERS and step.operator not in WHOLE and forms[-1] != ZERO:
        forms.append(derivative(forms[-1], Symbol(key)))
    functions = [cache(partial(_at, form, key, others)) for form in forms if form != ZERO]
    for low, high in pairwise(GRID):
        yield from _changes(functions, low, high)


def _changes(functions: Sequence[Callable[[float], float]], low: float, high: float) -> list[float]:
    """Places between two others at which the first function changes its sign; each further one is the slope of the one before."""
    if not functions:
        return []
    first, *slopes = functions
    ends = [low, *_changes(slopes, low, high), high]
    return [_threshold(first, a, b) for a, b in pairwise(ends) if first(a) * first(b) < 0]


def _height(
    energy: Expression, step: Apply, key: PortVariable, others: Mapping[PortVariable, float], place: float
) -> float:
    """Height of the jump of an energy at a threshold of a step; 0 if both sides were meant to be equal."""
    left, *rest = (_at(operand, key, others, place) for operand in step.operands)
    if step.operator in WHOLE:
        number = round(left) if math.isfinite(left) else MOST + 1
        if abs(number) > MOST:
            return 0.0  # beyond, rounding moves more than the energy
        sides: tuple[float, float] = number, number + (1 if step.operator == "ceil" else -1)
    elif step.operator == "atan2":
        sides = (math.pi, -math.pi) if rest[0] < 0 else (0.0, 0.0)
    else:
        sides = 1, -1 if not rest else 0
    one, other = (_at(_with(energy, step, float(v)), key, others, place) for v in sides)
    around = (_at(energy, key, others, place * (1 + share)) for share in AROUND)
    size = abs(one - other)
    return size if size > EQUAL * max(abs(x) for x in (one, other, *around) if not math.isnan(x)) else 0.0


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
