"""Tangent space of a law at a point, from which symmetry and passivity are computed.

A law of n ports is n equations in 2n variables: y, which the law gives, and x, integrated or other. Its tangent space has the n
directions (dx, dy) that satisfy the linearized law; it does not depend on the form in which the law is written.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from ..algebra.derivative import derivative
from ..algebra.expression import Expression, Number, Symbol, evaluate, substitute, symbols
from ..errors import ValuesNeeded
from ..fast_dataclass import dataclass
from ..graph.network import BondGraph, Element, Law, Named, PortVariable, Quantity, Reference, behind
from .laws import solved

DECADES = (1.0, 0.1, 1e-2, 1e-3, 1e-6, 1e-9, 10.0, 1e3)
POINTS = 3  # of each decade
SINGULAR = 1e-12
Point = Mapping[PortVariable, float]


class TangentVector(NamedTuple):
    """A direction (dx, dy) of the tangent space. `free` is the variable that generates it: a port, and True for its x."""

    x: list[float]
    y: list[float]
    free: tuple[int, bool]


@dataclass(frozen=True, slots=True)
class Relation:
    """A law with its parameters put in: residuals over x and y of each port, and their partial derivatives."""

    rests: tuple[Expression, ...]
    x: tuple[PortVariable, ...]
    y: tuple[PortVariable, ...]
    slopes: tuple[tuple[tuple[Expression, ...], ...], ...]  # over y, over x

    @property
    def linear(self) -> bool:
        """True if all partial derivatives are numbers."""
        return all(isinstance(s, Number) for side in self.slopes for row in side for s in row)


@lru_cache(maxsize=1024)
def relation(
    law: Law, values: tuple[float, ...], x: tuple[PortVariable, ...], y: tuple[PortVariable, ...]
) -> Relation | None:
    """Relation with as many equations of a law as ports are given; None if they read other variables."""
    put = numbers(values)
    own = {*x, *y}
    rests = tuple(substitute(left - right, put) for left, right in law.equations[: len(x)])
    if any(s.key not in own for rest in rests for s in symbols(rest)):
        return None
    slopes = tuple(tuple(tuple(derivative(rest, Symbol(v)) for v in side) for rest in rests) for side in (y, x))
    return Relation(rests, x, y, slopes)


def parameter_values(element: Element, graph: BondGraph) -> tuple[float, ...] | None:
    """Values of a law's slots; None if one of them changes with the rest of the model."""
    return known_values(element.arguments, graph)


def decisive_values(element: Element, graph: BondGraph) -> tuple[float, ...] | None:
    """The same for values that decide about an error. Raises `ValuesNeeded` for those that only a run knows."""
    found = parameter_values(element, graph)
    if found is None:
        waiting = [a.name for a in element.arguments if isinstance(a, Quantity)]
        later = [n for n in behind(waiting, graph.quantities) if _is_later(graph.quantities[n])]
        if later:
            raise ValuesNeeded(dict.fromkeys(later, f"the law of `{element.name}` (line {element.span.line})"))
    return found


def _is_later(named: Named) -> bool:
    """Return True if a parameter gets its value only when a run begins."""
    return named.role == "parameter" and named.value is None and named.definition is None


def known_values(arguments: Sequence[Reference], graph: BondGraph) -> tuple[float, ...] | None:
    """Values of references; None if one is not known before the run."""
    values: list[float] = []
    for argument in arguments:
        if isinstance(argument, float):
            values.append(argument)
            continue
        named = graph.quantities.get(argument.name) if isinstance(argument, Quantity) else None
        if named is None or named.value is None or named.role == "input":
            return None
        values.append(named.value)
    return tuple(values)


def points(law: Law, known: Relation, values: tuple[float, ...], base: Mapping[PortVariable, float]) -> Iterator[Point]:
    """Points that satisfy the law, over decades around the base magnitudes (default 1); the same in every run."""
    choose = random.Random(0)
    compute, given, wanted = _explicit(law, known, values)
    if compute is None:
        return
    for scale in DECADES:
        for _ in range(POINTS):
            chosen = {v: scale * base.get(v, 1.0) * choose.uniform(0.2, 1.0) * choose.choice((-1, 1)) for v in given}
            try:
                yield chosen | dict(zip(wanted, compute(chosen), strict=True))
            except (ArithmeticError, ValueError):
                continue  # outside of the law's domain


def _explicit(
    law: Law, relation: Relation, values: tuple[float, ...]
) -> tuple[Callable[[Point], list[float]] | None, tuple[PortVariable, ...], tuple[PortVariable, ...]]:
    """One side of the law as a function of the other, in a direction in which it can be solved."""
    for given, wanted in ((relation.x, relation.y), (relation.y, relation.x)):
        shorter = Law(law.equations[: len(wanted)], None, law.arity)
        found = solved(shorter, wanted)
        if found is not None:
            explicit = [substitute(e, numbers(values)) for e in found]
            return lambda known, e=explicit: [evaluate(x, known.__getitem__) for x in e], given, wanted
    return None, (), ()


def tangents(law: Relation, point: Point) -> list[TangentVector] | None:
    """Basis of the tangent space at a point, with dx as free as possible; None if the equations are dependent."""
    n = len(law.x)
    try:
        table = [[evaluate(s, point.__getitem__) for s in (*law.slopes[0][i], *law.slopes[1][i])] for i in range(n)]
    except (ArithmeticError, ValueError):
        return None
    found = _kernel(table)
    return None if found is None else [TangentVector(v[n:], v[:n], (c % n, c >= n)) for c, v in found.items()]


def _kernel(table: list[list[float]]) -> dict[int, list[float]] | None:
    """Null space of n rows of 2n columns by free column (Gauss-Jordan), with pivots in the first columns if possible.

    Columns are scaled to one first: their units differ by many orders of magnitude.
    """
    n, width = len(table), 2 * len(table)
    scales = [max(abs(row[c]) for row in table) or 1.0 for c in range(width)]
    rows = [[value / scale for value, scale in zip(row, scales, strict=True)] for row in table]
    sizes = [max(map(abs, row), default=0.0) for row in rows]
    if not all(0.0 < s < float("inf") for s in sizes):
        return None
    rows = [[value / size for value in row] for row, size in zip(rows, sizes, strict=True)]
    pivots: dict[int, int] = {}  # column -> row
    for column in range(width):
        left = [r for r in range(n) if r not in pivots.values()]
        best = max(left, key=lambda r: abs(rows[r][column]), default=None)
        if best is None or abs(rows[best][column]) < SINGULAR:
            continue
        pivots[column] = best
        rows[best] = [value / rows[best][column] for value in rows[best]]
        for r in range(n):
            factor = rows[r][column]
            if r != best and factor:
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[best], strict=True)]
    if len(pivots) < n:
        return None
    basis = {}
    for free in (c for c in range(width) if c not in pivots):
        vector = [0.0] * width
        vector[free] = 1.0
        for column, row in pivots.items():
            vector[column] = -rows[row][free] * scales[free] / scales[column]
        basis[free] = vector
    return basis


def numbers(values: tuple[float, ...]) -> Callable[[Symbol], Expression]:
    """Return the substitution of values for a law's slots."""
    return lambda symbol: Number(values[symbol.key]) if isinstance(symbol.key, int) else symbol
