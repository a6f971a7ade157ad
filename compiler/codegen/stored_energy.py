"""Stored energy of a model and its gradient by the states, which an energy-conserving method evaluates at each step.

A storage gives its energy, or its law, which is integrated from the start of its state: exactly if it is a polynomial, else by Gauss
quadrature with enough nodes for full accuracy with a smooth law. The gradient follows from the laws directly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..algebra.derivative import derivative
from ..algebra.expression import ZERO, Apply, Expression, Number, Symbol, add, multiply, negate, substitute
from ..equations.system import Storage
from .lowered import Lowered

PLACES = 16  # of the quadrature of a law that is no polynomial
HIGHEST = 2 * PLACES - 1  # degree that it takes exactly


def stored_energy(lowered: Lowered, slopes: Mapping[int, Mapping[int, Expression]]) -> tuple[Expression, ...]:
    """Energy, then its derivative by each state. `slopes`: derivatives of variables, by the places of the states."""
    space, values = lowered.space, lowered.values
    energies: list[Expression] = [values[v] for v in space.stored.values()]
    terms: list[list[Expression]] = [[] for _ in space.states]

    def add_slopes(variable: int, effort: Expression | None) -> None:
        for column, slope in slopes.get(variable, {}).items():
            if column < len(terms):
                terms[column].append(slope if effort is None else multiply(effort, slope))

    for variable in space.stored.values():
        add_slopes(variable, None)
    starts = {state.variable: start for state, start in zip(space.states, lowered.starts, strict=False)}
    for follower in space.following:
        first = follower.start
        starts[follower.variable] = Number(first) if isinstance(first, float) else values[first]
    for storage in space.storages:
        energy, efforts = _of_storage(lowered, storage, starts)
        energies.append(energy)
        for variable, effort in zip(storage.stored, efforts, strict=True):
            add_slopes(variable, effort)
    return (add(*energies), *(add(*t) if t else ZERO for t in terms))


def _of_storage(
    lowered: Lowered, storage: Storage, starts: Mapping[int, Expression]
) -> tuple[Expression, list[Expression]]:
    """Energy of a storage, and its efforts."""
    count = len(storage.stored)
    arguments = [Number(a) if isinstance(a, float) else lowered.values[a] for a in storage.arguments]
    stored = [lowered.values[v] for v in storage.stored]

    def at(expression: Expression, places: Sequence[Expression]) -> Expression:
        given = [*places, *arguments]
        return substitute(expression, lambda slot: given[slot.key])

    if storage.energy is not None:
        return at(storage.energy, stored), [at(derivative(storage.energy, Symbol(i)), stored) for i in range(count)]
    first = [starts.get(v, ZERO) for v in storage.stored]
    ways = [add(x, negate(start)) for x, start in zip(stored, first, strict=True)]
    degrees = [_degree(law, count) for law in storage.laws]
    most = max((HIGHEST if d is None else min(d, HIGHEST) for d in degrees), default=0)
    parts = []
    for place, weight in _gauss(most // 2 + 1):
        between = [add(a, multiply(Number(place), way)) for a, way in zip(first, ways, strict=True)]
        parts += [multiply(Number(weight), at(law, between), way) for law, way in zip(storage.laws, ways, strict=True)]
    return add(*parts), [at(law, stored) for law in storage.laws]


def _gauss(count: int) -> list[tuple[float, float]]:
    """Gauss nodes and weights on [0, 1]."""
    from numpy.polynomial.legendre import leggauss

    places, weights = leggauss(count)
    return [(0.5 + 0.5 * float(p), 0.5 * float(w)) for p, w in zip(places, weights, strict=True)]


def _degree(x: Expression, count: int) -> int | None:
    """Degree of a polynomial in the first `count` slots; None if it is no polynomial."""
    if isinstance(x, Symbol):
        return int(x.key < count)
    if not isinstance(x, Apply):
        return 0
    inner = [_degree(o, count) for o in x.operands]
    if not any(inner) and None not in inner:
        return 0
    known = [d for d in inner if d is not None]
    if len(known) < len(inner):
        return None
    match x.operator, x.operands:
        case "add", _:
            return max(known)
        case "multiply", _:
            return sum(known)
        case "divide", _ if known[1] == 0:
            return known[0]
        case "power", (_, Number(value=exponent)) if exponent == int(exponent) and exponent > 0:
            return known[0] * int(exponent)
    return None
