"""Uniqueness of the solution of an algebraic loop, proved from monotone laws in a structure that conserves power.

Two solutions differ by dx in the arguments and dy in the values of the laws y = g(x) of the loop's resistors. The rest of the loop is
linear relations between dx and dy. Where each g rises or falls strictly, in the direction d, every product d dx dy is positive unless both are zero. Where by
these relations the products add up to zero (junctions, transformers and gyrators neither store nor lose power, whatever their ratios), all of them are zero,
and with them the rest of the loop (Duffin, Nonlinear networks, Bull. Am. Math. Soc. 53, 1947; Minty, Monotone networks, Proc. R. Soc. A 257, 1960).
Coefficients are residues modulo a prime, as fractions grow at each step, and one that is constant in the loop but not a number stands there as an arbitrary
one: a combination that is not zero passes for zero with a probability of 2^-61.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from math import isfinite, prod
from random import Random

from ..algebra.affine import jointly_affine
from ..algebra.expression import Apply, Expression, Number, Symbol, symbols
from ..algebra.monotony import course_of, sign_of
from ..equations.system import Assignment, EquationSystem
from .order import blocks

MOST, LONGEST = 64, 512  # laws, and assignments in all, of a loop that is examined
PRIME = 2**61 - 1  # larger than the mantissa of a float: no number but 0 has the residue 0
Row = Mapping[int, int]  # a difference as a combination of others
Law = tuple[int | None, int]  # argument, if there is one, and direction of the value


def is_unique(loop: Sequence[Assignment], system: EquationSystem, signs: Callable[[Symbol], int]) -> bool:
    """Return True if an algebraic loop, given by all its assignments, surely has at most one solution; False if that is not known.

    `signs`: of the parameters, by variable. The claim holds for all values of these signs.
    """
    if not 0 < len(loop) <= LONGEST:
        return False
    inside = frozenset(a.target for a in loop)
    resistors = {p.element for p in system.ports if p.group == "loss"}
    laws, structure = dict[int, Law](), dict[int, Row]()
    for assignment in loop:
        own = [s for s in dict.fromkeys(symbols(assignment.expression)) if s.key in inside]
        rows = jointly_affine(assignment.expression, own)
        if assignment.owner in resistors or rows is None:
            law = _law(assignment, own, signs)
            if law is None or len(laws) == MOST:
                return False
            laws[assignment.target] = law
        elif assignment.implicit:
            return False
        else:
            structure[assignment.target] = {int(s.key): _residue(k) for s, k in zip(own, rows[0], strict=True)}
    differences = _differences(laws, structure)
    return _is_lossless(laws, differences) and _vanish(laws, differences)


def _law(assignment: Assignment, own: Sequence[Symbol], signs: Callable[[Symbol], int]) -> Law | None:
    """Return the argument of a strictly monotone law, and the direction of its value; no argument if the value is fixed. None for others."""
    courses = [course_of(assignment.expression, s, signs) for s in own]
    if any(c is None or not c.strict for c in courses):
        return None
    directions = {s.key: c.direction for s, c in zip(own, courses, strict=True) if c is not None}
    if not assignment.implicit:
        return None if len(own) != 1 or own[0].key == assignment.target else (int(own[0].key), directions[own[0].key])
    value = directions.pop(assignment.target, 0)
    if not value or len(directions) > 1:
        return None
    return next(((int(key), -value * d) for key, d in directions.items()), (None, 1))


def _differences(laws: Mapping[int, Law], structure: Mapping[int, Row]) -> dict[int, Row]:
    """Return the difference of each variable of a loop as a combination of differences that the structure leaves open."""
    names = [*laws, *structure]
    places = {name: place for place, name in enumerate(names)}
    inputs = [[places[v] for v in structure.get(name, ())] for name in names]
    rows: dict[int, Row] = {}
    for block in blocks(list(range(len(names))), inputs):
        members = [names[place] for place in block]
        if members[0] in laws:
            rows[members[0]] = {members[0]: 1} if laws[members[0]][0] is not None else {}
        elif len(members) == 1 and members[0] not in structure[members[0]]:
            rows[members[0]] = _combined(structure[members[0]], rows)
        else:  # a loop of the structure itself: each member is open until an equation determines it, or something else
            rows |= {name: {name: 1} for name in members}
            for name in members:
                rest = _combined({**structure[name], name: structure[name].get(name, 0) - 1}, rows)
                rows = _without(rest, rows) if rest else rows
    return rows


def _without(zero: Row, rows: Mapping[int, Row]) -> dict[int, Row]:
    """Return the same rows where a combination of open differences is zero: one of them is expressed by the others."""
    pivot = next(iter(zero))
    inverse = -pow(zero[pivot], -1, PRIME)
    value = {v: part * inverse % PRIME for v, part in zero.items() if v != pivot}
    return {v: _combined(row, {pivot: value}) if pivot in row else row for v, row in rows.items()}


def _vanish(laws: Mapping[int, Law], rows: Mapping[int, Row]) -> bool:
    """Return True if all differences are zero where those of the laws' arguments and values are."""
    remaining = dict(rows)
    for value, (argument, _) in laws.items():
        for name in (value, value if argument is None else argument):
            if remaining[name]:
                remaining = _without(remaining[name], remaining)
    return not any(remaining.values())


def _combined(slopes: Row, rows: Mapping[int, Row]) -> Row:
    """Return a combination of rows; a variable without a row stands for itself."""
    total: dict[int, int] = {}
    for variable, slope in slopes.items():
        for v, part in rows.get(variable, {variable: 1}).items():
            total[v] = (total.get(v, 0) + slope * part) % PRIME
    return {v: part for v, part in total.items() if part}


def _is_lossless(laws: Mapping[int, Law], differences: Mapping[int, Row]) -> bool:
    """Return True if the directed products of all laws' arguments and values add up to zero."""
    entries: dict[frozenset[int], int] = {}
    for value, (argument, direction) in laws.items():
        for a, part in differences[argument].items() if argument is not None else ():
            for b, other in differences[value].items():
                pair = frozenset((a, b))
                entries[pair] = entries.get(pair, 0) + direction * part * other
    return not any(entry % PRIME for entry in entries.values())


@lru_cache(maxsize=65536)
def _residue(x: Expression) -> int:
    """Return the residue of a coefficient: arithmetic of numbers, and of an arbitrary one for each thing that is none."""
    if isinstance(x, Number) and isfinite(x.value):
        numerator, denominator = x.value.as_integer_ratio()
        return numerator * pow(denominator, -1, PRIME) % PRIME
    if isinstance(x, Apply) and x.operator in ("add", "multiply", "divide"):
        first, *others = map(_residue, x.operands)
        if x.operator == "add":
            return (first + sum(others)) % PRIME
        if x.operator == "multiply":
            return first * prod(others) % PRIME
        if others[0]:
            return first * pow(others[0], -1, PRIME) % PRIME
    return Random(repr(x)).randrange(1, PRIME)


def parameter_signs(system: EquationSystem) -> Callable[[Symbol], int]:
    """Return the signs of the variables that are computed from parameters alone, as they are written."""
    assigned = {a.target: a for a in system.assignments if not a.implicit}

    behind = set[int]()

    @cache
    def sign(variable: int) -> int:
        quantity, assignment = system.variables[variable], assigned.get(variable)
        if quantity.role == "parameter":
            return 0 if quantity.value is None else (quantity.value > 0) - (quantity.value < 0)
        if quantity.role != "computed" or assignment is None or variable in behind:
            return 0
        behind.add(variable)
        result = sign_of(assignment.expression, lambda s: sign(s.key))
        behind.discard(variable)
        return result

    return lambda symbol: sign(symbol.key)
