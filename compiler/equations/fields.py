"""Hidden properties of laws given by equations: a storage must return the energy that it took, a resistor should only take it.

A storage field has an energy exactly if its Jacobian is symmetric (Maxwell): with x the stored quantities and y the variables that its
law gives (effort of a displacement, flow of a momentum), dH = y dx for every port, so dy_i/dx_j = dy_j/dx_i with equal signs for both
kinds of ports, as all bonds point into it. Without an energy it is no storage: an error. A resistor that gives energy may be
intended (an amplifier, a tunnel diode): a note.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache

from ..algebra.derivative import derivative
from ..algebra.expression import (
    ONE,
    ZERO,
    Expression,
    Number,
    Symbol,
    add,
    call,
    evaluate,
    multiply,
    negate,
    operations,
    select,
    substitute,
    symbols,
)
from ..algebra.formula import Bound, bind, over
from ..errors import Diagnostic
from ..graph.domains import DOMAINS
from ..graph.elements import STORAGES, Kind
from ..graph.inertia import inertia_notes
from ..graph.network import BondGraph, Element, Law, PortVariable, Quantity, Requirement, behind
from ..graph.placement import placement_notes
from .errors import NotConservative
from .laws import GIVEN, equations_for, solved
from .system import port_name
from .tangent import (
    Point,
    Relation,
    TangentVector,
    decisive_values,
    known_values,
    numbers,
    parameter_values,
    points,
    relation,
    tangents,
)

UNEQUAL = 1e-6  # slopes that differ by less, in relation to each other, were meant to be equal
MOST_WANTED = 10  # variables of one law that are solved for together
DIGITS = 1e-9  # least determinant, relative to its terms, that leaves the digits of a usual tolerance
COUPLED = 1e-9  # a difference below this share of the field's own stiffness is round-off
ROUND_OFF = 1e-12  # relative to the terms of a sum
WITNESSES = 2  # points that must agree on what is wrong


def without_energy(element: Element, graph: BondGraph) -> Diagnostic | None:
    """Error for a storage field given by equations that has no energy with these derivatives; None if it has one."""
    values = decisive_values(element, graph) if _by_equations(element) else None
    if values is None:
        return None
    found = _asymmetry(element.law, values, element.stored, _magnitudes(element, graph))
    return None if found is None else _told(element, *found)


def is_lost_in_rounding(element: Element, graph: BondGraph, wanted: tuple[PortVariable, ...]) -> bool:
    """Return True if the matrix by which a law is solved for several variables is singular, or so near it that rounding decides the solution."""
    if not 1 < len(wanted) <= MOST_WANTED:
        return False
    slopes = _matrix(element.law, wanted)
    if all(sum(x != ZERO for x in row) < 2 for row in slopes) or _varies(slopes):
        return False
    values = decisive_values(element, graph)
    return values is not None and _is_lost(element.law, wanted, values)


@lru_cache(maxsize=1024)
def _is_lost(law: Law, wanted: tuple[PortVariable, ...], values: tuple[float, ...]) -> bool:
    put = numbers(values)
    return _determinate([[substitute(x, put) for x in row] for row in _matrix(law, wanted)]) == ZERO


def _solvable(element: Element) -> Expression:
    """1 if the stored quantities of a linear field decide what its law gives for them, else 0."""
    slopes = _matrix(element.law, _sides(element.stored)[1])
    return ONE if _varies(slopes) or len(slopes) > MOST_WANTED else _determinate(slopes)


@lru_cache(maxsize=1024)
def _matrix(law: Law, wanted: tuple[PortVariable, ...]) -> tuple[tuple[Expression, ...], ...]:
    """Return the slopes of the equations of a law over the wanted variables."""
    return tuple(tuple(derivative(a - b, Symbol(w)) for w in wanted) for a, b in equations_for(law, wanted))


def _varies(slopes: Iterable[Iterable[Expression]]) -> bool:
    return any(isinstance(s.key, PortVariable) for row in slopes for x in row for s in symbols(x))


def _determinate(slopes: Sequence[Sequence[Expression]]) -> Expression:
    """1 if the determinant of a matrix is larger than rounding leaves of its terms, whatever the units of rows and columns, else 0."""
    minors: dict[tuple[int, ...], tuple[Expression, Expression]] = {
        (): (ONE, ONE)
    }  # by columns: determinant, and sum of the sizes of its terms
    for row in slopes:
        wider: dict[tuple[int, ...], tuple[Expression, Expression]] = {}
        for columns, (value, size) in minors.items():
            for j, x in enumerate(row):
                if x == ZERO or j in columns:
                    continue
                key = tuple(sorted((*columns, j)))
                term = multiply(x, value) if (len(columns) - key.index(j)) % 2 == 0 else negate(multiply(x, value))
                before = wider.get(key, (ZERO, ZERO))
                wider[key] = add(before[0], term), add(before[1], multiply(call("abs", x), size))
        minors = wider
    value, size = minors.get(tuple(range(len(slopes))), (ZERO, ZERO))
    return select(call("less", multiply(Number(DIGITS), size), call("abs", value)), ONE, ZERO)


def _by_equations(element: Element) -> bool:
    """Return True for a field of several ports whose law gives no energy, and that has one."""
    return element.law.energy is None and len(element.ports) > 1 and _has_power(element)


def _has_power(element: Element) -> bool:
    """Return True if effort times flow is a power at all ports, as in a plain model; of heat times temperature no sign says anything."""
    return all(DOMAINS[p.domain].is_balanced for p in element.ports)


def field_checks(graph: BondGraph) -> tuple[list[Requirement], frozenset[str]]:
    """Return what a program for all values must find of the parameters of linear storage fields, so that these have an energy and no matrix that is singular
    but for rounding; and the quantities that decide it for others. Fields that have both for all values need neither."""
    checks: list[Requirement] = []
    decisive: list[str] = []
    for node in graph.nodes:
        if not isinstance(node, Element) or node.kind not in STORAGES or not _by_equations(node):
            continue
        slopes = min(_slopes(node), key=lambda s: sum(1 for row in s for x in row for _ in operations(x)), default=None)
        if slopes is None or _varies(slopes):
            decisive += [a.name for a in node.arguments if isinstance(a, Quantity)] * (not slopes or not _alike(slopes))
        elif (holds := multiply(_symmetric(slopes), _solvable(node))) != ONE:
            bound = bind(over(holds, node.arguments))
            checks.append(Requirement(node.name, bound, f"the field `{node.name}`", "", (), node.span, None, True))
    return checks, behind(decisive, graph.quantities)


def _slopes(element: Element) -> Iterator[list[list[Expression]]]:
    """Yield the Jacobians of a law, solved for one of its sides."""
    sides = _sides(element.stored)
    for given, wanted in (sides, sides[::-1]):
        found = solved(Law(element.law.equations[: len(wanted)], None, element.law.arity), wanted)
        if found is not None:
            yield [[derivative(y, Symbol(x)) for x in given] for y in found]


def _alike(slopes: list[list[Expression]]) -> bool:
    return all(row[j] == slopes[j][i] for i, row in enumerate(slopes) for j in range(i))


def _symmetric(slopes: list[list[Expression]]) -> Expression:
    """1 if a matrix is symmetric up to round-off and rounded numbers, as in `_reciprocal`, else 0."""
    holds: Expression = ONE
    for i, row in enumerate(slopes):
        for j in range(i):
            a, b, own = row[j], slopes[j][i], call("abs", multiply(row[i], slopes[j][j]))
            size = call("max", call("abs", a), call("abs", b))
            least = add(multiply(Number(UNEQUAL), size), multiply(Number(COUPLED), call("sqrt", own)))
            holds = holds if a == b else select(call("less_equal", call("abs", a - b), least), holds, ZERO)
    return holds


def _sides(stored: tuple[str, ...]) -> tuple[tuple[PortVariable, ...], tuple[PortVariable, ...]]:
    """Stored variables, and the variables that the law gives for them."""
    return tuple(PortVariable(p, s) for p, s in enumerate(stored)), tuple(
        PortVariable(p, GIVEN[s]) for p, s in enumerate(stored)
    )


@lru_cache(maxsize=1024)
def _asymmetry(
    law: Law, values: tuple[float, ...], stored: tuple[str, ...], base: tuple[tuple[PortVariable, float], ...]
) -> tuple[Relation, Point, TangentVector, TangentVector] | None:
    """A point at which two directions of a law are not reciprocal, computed once for all elements with this law and values."""
    known = relation(law, values, *_sides(stored))
    if known is None:
        return None
    found = []
    for point in [{}] if known.linear else points(law, known, values, dict(base)):
        basis = tangents(known, point) or []
        pair = next(((a, b) for i, a in enumerate(basis) for b in basis[:i] if not _reciprocal(a, b)), None)
        if pair is not None:
            found.append((known, point, *pair))
        if len(found) >= (1 if known.linear else WITNESSES):
            return found[0]
    return None


def _reciprocal(a: TangentVector, b: TangentVector) -> bool:
    """Return True if dx_a dy_b = dx_b dy_a, summed over the ports, up to round-off and rounded numbers."""
    one = [x * y for x, y in zip(a.x, b.y, strict=True)]
    other = [x * y for x, y in zip(b.x, a.y, strict=True)]
    difference = abs(math.fsum((*one, *(-v for v in other))))
    own = [abs(math.fsum(x * y for x, y in zip(v.x, v.y, strict=True))) for v in (a, b)]
    size = max(math.fsum(map(abs, one)), math.fsum(map(abs, other)))
    return not (difference > UNEQUAL * size and difference > COUPLED * math.sqrt(own[0] * own[1]))


def _told(element: Element, law: Relation, point: Point, a: TangentVector, b: TangentVector) -> NotConservative:
    """Error with the two derivatives that should be equal, under their names."""

    def dual(of: TangentVector, over: tuple[int, bool]) -> tuple[str, float]:
        """Partner of a variable in the energy, and its change along a direction."""
        port, stored = over
        if stored:
            return port_name(element, port, law.y[port].variable), of.y[port]
        return f"-{port_name(element, port, law.x[port].variable)}", -of.x[port]

    def name(of: TangentVector) -> str:
        port, stored = of.free
        return port_name(element, port, (law.x if stored else law.y)[port].variable)

    (first, value), (second, opposite) = dual(b, a.free), dual(a, b.free)
    where = ", ".join(f"`{port_name(element, v.port, v.variable)}` = {point[v]:.3g}" for v in law.x if v in point)
    return NotConservative(
        element.span, element.name, first, name(b), f"{value:.6g}", second, name(a), f"{opposite:.6g}", f" at {where}" * bool(where),
    )  # fmt: skip


def _magnitudes(element: Element, graph: BondGraph) -> tuple[tuple[PortVariable, float], ...]:
    """Magnitudes that the author gave as nominal or start, if they are known."""
    found: dict[PortVariable, float] = {}
    for given in (element.starts, element.nominals):
        for port, (variable, bound) in given.items():
            size = _size(bound, graph)
            if size:
                found[PortVariable(port, variable)] = size
    return tuple(found.items())


def _size(bound: Bound, graph: BondGraph) -> float | None:
    values = known_values(bound.arguments, graph)
    try:
        return None if values is None else abs(evaluate(bound.formula.expression, values.__getitem__))
    except (ArithmeticError, ValueError):
        return None


# ---------------------------------------------------------------- resistors


def notes(graph: BondGraph) -> tuple[str, ...]:
    """Notes on unexpected properties of laws.

    Resistors that create energy or pass it between ports, fields that are not checked, tensors of inertia that no body can have.
    """
    found: list[str] = []
    for node in graph.nodes:
        if isinstance(node, Element) and node.kind is Kind.RESISTOR:
            found += () if not _has_power(node) else _notes(node, graph)
        elif isinstance(node, Element) and node.kind in STORAGES and not _checked(node, graph):
            found.append(
                f"`{node.name}` may create energy: its law can be solved neither way, so its symmetry is not checked"
            )
    return (*found, *inertia_notes(graph), *placement_notes(graph))


def _checked(element: Element, graph: BondGraph) -> bool:
    """Return True if a storage has an energy for certain, or points at which its derivatives were compared."""
    values = decisive_values(element, graph) if _by_equations(element) else None
    if values is None:
        return True
    known = relation(element.law, values, *_sides(element.stored))
    return known is None or known.linear or any(True for _ in points(element.law, known, values, {}))


def _notes(element: Element, graph: BondGraph) -> Iterator[str]:
    values = parameter_values(element, graph)
    if values is None:
        return
    count = len(element.ports) - element.gives_heat
    for finding, point in _findings(element.law, values, count):
        at = ", ".join(f"{port_name(element, v.port, v.variable)} = {x:.3g}" for v, x in point)
        yield f"`{element.name}` {finding}{at}"


@lru_cache(maxsize=1024)
def _findings(
    law: Law, values: tuple[float, ...], count: int
) -> tuple[tuple[str, tuple[tuple[PortVariable, float], ...]], ...]:
    """Unexpected properties of a resistor's law, with a point if needed, computed once for all elements with it."""
    flows, efforts = (tuple(PortVariable(p, v) for p in range(count)) for v in "fe")
    known = relation(law, values, flows, efforts)
    if known is None:
        return ()
    if known.linear and all(_at_rest(known)):
        basis = tangents(known, {}) or []
        positive = _positive([[_power(a, b) for a in basis] for b in basis])
        reciprocal = all(_reciprocal(a, b) for a in basis for b in basis)
        creates = ("creates energy: its resistance is not positive", ())
        gyrates = ("gyrates: a part of its law passes power between its ports", ())
        return (creates,) * (not positive) + (gyrates,) * (not reciprocal)
    found = [
        p
        for p in points(law, known, values, {})
        if sum(p[PortVariable(i, "e")] * p[PortVariable(i, "f")] for i in range(count)) < 0
    ]
    if len(found) < WITNESSES:
        return ()
    return (("creates energy, for example at ", tuple((v, found[0][v]) for v in (*flows, *efforts))),)


def _at_rest(law: Relation) -> Iterator[bool]:
    """For each equation: True if it holds with all variables zero."""
    for rest in law.rests:
        try:
            yield evaluate(rest, lambda _: 0.0) == 0.0
        except (ArithmeticError, ValueError):
            yield False


def _power(a: TangentVector, b: TangentVector) -> float:
    """Bilinear form whose value for a = b is the power; zero if only round-off is left."""
    terms = [*(x * y for x, y in zip(a.x, b.y, strict=True)), *(x * y for x, y in zip(b.x, a.y, strict=True))]
    total = math.fsum(terms)
    return 0.5 * total if abs(total) > ROUND_OFF * math.fsum(map(abs, terms)) else 0.0


def _positive(form: list[list[float]]) -> bool:
    """Return True if a symmetric form is positive semidefinite: elimination with the largest pivot, scaled to a unit diagonal."""
    left = [i for i in range(len(form)) if any(form[i])]
    if any(form[i][i] <= 0 for i in left):  # a zero on the diagonal beside anything else makes the form indefinite
        return False
    rows = [[form[i][j] / math.sqrt(form[i][i]) / math.sqrt(form[j][j]) for j in left] for i in left]
    left = list(range(len(rows)))
    while left:
        pivot = max(left, key=lambda i: rows[i][i])
        if rows[pivot][pivot] <= COUPLED:
            return all(rows[i][i] >= -COUPLED for i in left)
        left.remove(pivot)
        for i in left:
            factor = rows[i][pivot] / rows[pivot][pivot]
            for j in left:
                rows[i][j] -= factor * rows[pivot][j]
    return True
