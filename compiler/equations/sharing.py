"""Shared states: storages and `integral` signals with proportional rates share one state.

Two springs on one junction, inertias that share an effort, a capacitor behind a transformer of constant ratio: their rates are one flow
times constants, so their contents differ by constants of the run, which follow from the starts. One of them stays a state (the
leader), the others follow it: `b.x := factor*a.x + (b's start - factor*a's start)`. A displacement that the geometry of a mechanism
determines follows in the same way (`derive.py`).

States that an event or a claim sets separately are not shared; no states are shared where junctions switch. Sums of three and more rates
that cancel are left: a stiff spring between two masses would become the difference of two large displacements. Analyses keep such sums
at their start (`conserved`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import replace
from functools import cache

from ..algebra.affine import jointly_affine
from ..algebra.expression import ONE, ZERO, Apply, Expression, Number, Symbol, add, divide, evaluate, multiply, symbols
from ..algebra.formula import Formula, bind, leaf
from .system import Argument, Assignment, EquationSystem, State, StateFollower, Variable

MOST = 32  # terms of a rate: a longer one counts as a flow of its own
DIGITS = 13  # of a factor by which two rates are the same

Row = dict[int, Expression]  # variable -> constant coefficient


class Rates:
    """Variables as sums of flows with constant coefficients, through junctions, transducers and signals.

    A law of an element ends the sum: its variable is a flow of its own, and so is a variable in a loop. With `products`, each product of what moves
    in a law is a flow as well: `k*e*s` of a reaction that is written as rates.
    """

    def __init__(self, system: EquationSystem, products: bool = False) -> None:
        self._products: dict[frozenset[tuple[Expression, float]], int] | None = {} if products else None
        self.variables = system.variables
        self.assigned = {a.target: a for a in system.assignments if not a.implicit}
        self.elements = {p.element for p in system.ports}
        self.on_bonds = {v for p in system.ports for v in (p.effort, p.flow)}
        self._moving = _moving(self.variables, self.assigned, self.on_bonds)
        self._known: dict[int, Row] = {}
        self._rows: dict[int, Row | None] = {}
        self._laws: dict[Expression, tuple[int, Expression]] = {}

    def sum_of(self, variable: int) -> Row:
        """Flows in the sum of a variable, with their coefficients; the variable alone if it is no sum."""
        stack = {} if variable in self._known else {variable: None}
        while stack:  # not by recursion: a row of transformers may be longer than Python nests calls
            here = next(reversed(stack))
            row = self._row(here)
            inner = next((v for v in row or () if v not in self._known and v not in stack), None)
            if inner is not None:
                stack[inner] = None
                continue
            stack.popitem()
            self._known[here] = self._own(here) if row is None else self._put(here, row)
        return self._known[variable]

    def _put(self, target: int, row: Row) -> Row:
        total: dict[int, list[Expression]] = {}
        for variable, factor in row.items():
            for flow, inner in self._known.get(variable, {variable: ONE}).items():
                total.setdefault(flow, []).append(multiply(factor, inner))
        summed = {flow: add(*parts) for flow, parts in total.items()}
        summed = {flow: factor for flow, factor in summed.items() if factor != ZERO}
        return {target: ONE} if target in summed or len(summed) > MOST else summed

    def _own(self, variable: int) -> Row:
        """A flow of its own, or a constant times another with the same law, as for the flows of a reaction."""
        assignment = self.assigned.get(variable)
        law = None if assignment is None or len(assignment.arguments) > MOST else assignment.expression
        if not isinstance(law, Apply) or law.operator != "multiply":
            first, factor = self._laws.setdefault(law, (variable, ONE)) if isinstance(law, Apply) else (variable, ONE)
            return {first: divide(ONE, factor)}
        still = [x for x in law.operands if all(self.is_static(s.key) for s in symbols(x))]
        own = multiply(*still)
        first, factor = self._laws.setdefault(multiply(*(x for x in law.operands if x not in still)), (variable, own))
        return {first: ONE if own == factor else divide(own, factor)}

    def _row(self, variable: int) -> Row | None:
        """Terms of the assignment of a variable; None if it is no sum with constant coefficients."""
        if variable not in self._rows:
            self._rows[variable] = self._terms(self.assigned.get(variable))
        return self._rows[variable]

    def _terms(self, assignment: Assignment | None) -> Row | None:
        if assignment is None or len(assignment.arguments) > MOST:
            return None
        if assignment.owner in self.elements:
            law = None if self._products is None else self._by_products(assignment.expression, self._products, True)
            return law if law is not None and len(law) > 1 else None
        factors, places = _factors(assignment.formula), assignment.arguments
        if (
            factors is not None
            and len({*places}) == len(places)
            and not any(isinstance(v, float) or self.is_static(v) for v in places)
        ):
            return dict(zip((v for v in places if isinstance(v, int)), factors, strict=True))
        moving = [s for s in symbols(assignment.expression) if not self.is_static(s.key)]
        parts = jointly_affine(assignment.expression, moving)
        if parts is None or parts[1] != ZERO:
            return None if self._products is None else self._by_products(assignment.expression, self._products)
        return {symbol.key: slope for symbol, slope in zip(moving, parts[0], strict=True)}

    def _by_products(
        self, x: Expression, numbers: dict[frozenset[tuple[Expression, float]], int], ends: bool = False
    ) -> Row | None:
        """Terms of an expression, each product of what moves a flow with a number beyond those of the variables, and each variable if the sum `ends`."""
        terms = self._expanded(x)
        if len(terms) > MOST:
            return None
        total: dict[int, list[Expression]] = {}
        for factor, powers in terms:
            match [*powers.items()]:
                case [(Symbol(int(flow)), 1.0)] if not ends:
                    pass
                case _:
                    flow = numbers.setdefault(frozenset(powers.items()), len(self.variables) + len(numbers))
            total.setdefault(flow, []).append(factor)
        return {flow: add(*factors) for flow, factors in total.items()}

    def _expanded(self, x: Expression) -> list[tuple[Expression, dict[Expression, float]]]:
        """Terms of an expression: factors that do not move, and powers of what moves; products of sums are multiplied out."""
        if all(self.is_static(s.key) for s in symbols(x)):
            return [(x, {})]
        match x:
            case Apply(operator="add", operands=parts):
                return [term for part in parts for term in self._expanded(part)]
            case Apply(operator="multiply", operands=parts):
                terms: list[tuple[Expression, dict[Expression, float]]] = [(ONE, {})]
                for part in parts:
                    if len(terms) > MOST:
                        return [(ONE, {x: 1.0})]
                    inner = self._expanded(part)
                    terms = [(multiply(f, g), _joined(a, b, 1.0)) for f, a in terms for g, b in inner]
                return terms
            case Apply(operator="divide", operands=(above, below)):
                match self._expanded(below):
                    case [(factor, powers)]:
                        pass
                    case _:
                        factor, powers = ONE, {below: 1.0}
                return [(divide(f, factor), _joined(a, powers, -1.0)) for f, a in self._expanded(above)]
            case Apply(operator="power", operands=(base, Number(exponent))):
                return [(ONE, {base: exponent})]
        return [(ONE, {x: 1.0})]

    def is_static(self, variable: int) -> bool:
        """Return True if a variable is computed from parameters alone, and is not on a bond."""
        return variable not in self._moving


def _joined(a: Mapping[Expression, float], b: Mapping[Expression, float], sign: float) -> dict[Expression, float]:
    """Powers of a product, or of a quotient with a negative sign."""
    powers = {x: a.get(x, 0.0) + sign * b.get(x, 0.0) for x in {**a, **b}}
    return {x: n for x, n in powers.items() if n}


def _moving(variables: Sequence[Variable], assigned: Mapping[int, Assignment], on_bonds: Set[int]) -> set[int]:
    """Variables on bonds, those that no assignment computes, except parameters, and all that is computed from them."""
    users: dict[int, list[int]] = {}
    for target, assignment in assigned.items():
        for argument in assignment.arguments:
            if isinstance(argument, int):
                users.setdefault(argument, []).append(target)
    moving = {v for v, x in enumerate(variables) if v in on_bonds or (v not in assigned and x.role != "parameter")}
    waiting = list(moving)
    while waiting:
        further = [user for user in users.get(waiting.pop(), ()) if user not in moving]
        moving.update(further)
        waiting += further
    return moving


@cache
def _factors(formula: Formula) -> tuple[Expression, ...] | None:
    """Numbers of a sum of numbers times its slots. Junctions have one formula for many assignments."""
    parts = jointly_affine(formula.expression, [Symbol(slot) for slot in range(formula.arity)])
    if parts is None or parts[1] != ZERO or not all(isinstance(slope, Number) and slope != ZERO for slope in parts[0]):
        return None
    return tuple(parts[0])


def share_states(system: EquationSystem, signals: frozenset[int], elements: frozenset[str]) -> EquationSystem:
    """Return the same system with one state for each set of proportional rates. `signals` are the states of `integral`.

    `elements` are left out: they became states in the middle of a run, and may never have had their starts.
    """
    if system.switches or len(system.states) < 2:  # a rate that is tied now may have been free before a switching
        return system
    apart = _moved_apart(system) | {v for s in system.storages if s.element in elements for v in s.stored}
    rates, groups = Rates(system), dict[tuple[object, ...], list[tuple[State, Expression]]]()
    for state in system.states:
        if state.variable not in apart and (state.conjugate is not None or state.variable in signals):
            row = rates.sum_of(state.rate)
            if row:
                first = row[min(row)]
                groups.setdefault(_direction(row, first), []).append((state, first))
    writer = _StateReplacement(system, signals)
    for group in groups.values():
        if len(group) > 1:
            writer.share(group)
    return writer.system()


def dependent_rates(system: EquationSystem, states: Sequence[State]) -> dict[int, Row]:
    """Rates of states (by their places) whose sums may be dependent: each of their flows is also one of another's.

    Only sums of these states, with constant factors, can be conserved for every form of the laws.
    """
    rates = Rates(system, products=True)
    rows = {place: rates.sum_of(state.rate) for place, state in enumerate(states)}
    users: dict[int, set[int]] = {}
    for place, row in rows.items():
        for flow in row:
            users.setdefault(flow, set()).add(place)
    waiting = [flow for flow, places in users.items() if len(places) == 1]
    while waiting:
        for place in users.pop(waiting.pop()):
            for flow in rows.pop(place):
                if flow in users:
                    users[flow].discard(place)
                    if len(users[flow]) == 1:
                        waiting.append(flow)
    return rows


def _direction(row: Row, first: Expression) -> tuple[object, ...]:
    """Key that is equal for rows that are multiples of each other."""
    return tuple((flow, 1.0 if row[flow] == first else _rounded(divide(row[flow], first))) for flow in sorted(row))


def _rounded(x: Expression) -> Expression | float:
    return float(f"{x.value:.{DIGITS}e}") if isinstance(x, Number) else x


def _moved_apart(system: EquationSystem) -> set[int]:
    """States that an event or a claim changes, directly or through variables computed from them."""
    assigned = {a.target: a for a in system.assignments}
    waiting = [s.target for e in system.events for s in e.settings] + [c.variable for c in system.claims]
    found = set(waiting)
    while waiting:
        assignment = assigned.get(waiting.pop())
        read: Iterable[Argument] = () if assignment is None else assignment.arguments
        for argument in read:
            if isinstance(argument, int) and argument not in found:
                found.add(argument)
                waiting.append(argument)
    return found


class _StateReplacement:
    """Replacement of states by followers."""

    def __init__(self, system: EquationSystem, signals: frozenset[int]) -> None:
        self.old, self.signals = system, signals
        self.variables, self.assignments = list(system.variables), list(system.assignments)
        self.leaders: dict[int, State] = {}  # by variable, with the data that they take over
        self.following: list[StateFollower] = []
        self.owners = {v: s.element for s in system.storages for v in s.stored}
        self.flows = {p.flow for p in system.ports}
        self.computed = {a.target: a for a in system.assignments if not a.implicit}

    def share(self, group: list[tuple[State, Expression]]) -> None:
        """Make one state for a group, in which each rate is a factor times the same flow."""
        leader, own = min(group, key=lambda member: self._rank(*member))
        taken, left = leader, list[tuple[State, Expression]]()
        for state, factor in group:
            ratio = divide(factor, own)
            if state is not leader and not self._is_safe(state, leader, ratio):
                left.append((state, factor))
            elif state is not leader:
                self._follow(state, leader, ratio)
                if taken.nominal is None and state.nominal is not None and isinstance(ratio, Number):
                    size = divide(leaf(state.nominal), Number(abs(ratio.value)))
                    taken = replace(taken, nominal=self._static(size, f"nominal of {self._name(leader)}", state))
        self.leaders[leader.variable] = taken
        if len(left) > 1:
            self.share(left)

    def _is_safe(self, state: State, leader: State, ratio: Expression) -> bool:
        """Return True if a follower keeps its digits.

        The content that passes from one storage to another is the small rest of a large sum when the first runs empty. So with
        opposite rates, only displacements that are both zero at the start share a state.
        """
        try:
            rising = evaluate(ratio, self._value) > 0
        except (ArithmeticError, ValueError):
            return False
        moments = state.conjugate in self.flows or leader.conjugate in self.flows
        return rising or (state.start == 0.0 and leader.start == 0.0 and not moments)

    def _rank(self, state: State, factor: Expression) -> tuple[bool, bool, bool, float]:
        """Rank for the leader of a group.

        Storages before signals; then those with a number as factor, with a nominal, and nearest to zero at the start: a small
        displacement computed from a large one loses digits.
        """
        start = state.start if isinstance(state.start, float) else self._value(state.start)
        return state.variable in self.signals, not isinstance(factor, Number), state.nominal is None, abs(start)

    def _value(self, variable: int) -> float:
        """Default value of a variable computed from parameters; 1 if it has none."""
        value = self.variables[variable].value
        if value is None and variable in self.computed:
            try:
                value = evaluate(self.computed[variable].expression, self._value)
            except (ArithmeticError, ValueError):
                value = None
        return 1.0 if value is None else value

    def _follow(self, state: State, leader: State, ratio: Expression) -> None:
        name, owner = self._name(state), self.owners.get(state.variable, self._name(state))
        old = self.variables[state.variable]
        self.variables[state.variable] = Variable(old.name, "computed", old.unit)
        offset = add(leaf(state.start), multiply(Number(-1.0), ratio, leaf(leader.start)))
        held = leaf(self._static(offset, f"{name} where {self._name(leader)} is zero", state))
        bound = bind(add(multiply(ratio, Symbol(leader.variable)), held))
        self.assignments.append(Assignment(state.variable, bound.formula, tuple(bound.arguments), state.span, owner))
        factor = ratio.value if isinstance(ratio, Number) else None
        self.following.append(StateFollower(state.variable, leader.variable, factor, state.start))

    def _static(self, x: Expression, name: str, state: State) -> Argument:
        if isinstance(x, Number):
            return x.value
        if isinstance(x, Symbol):
            assert isinstance(x.key, int)
            return x.key
        self.variables.append(Variable(name, "computed"))
        bound = bind(x)
        owner = self.owners.get(state.variable, self._name(state))
        self.assignments.append(
            Assignment(len(self.variables) - 1, bound.formula, tuple(bound.arguments), state.span, owner)
        )
        return len(self.variables) - 1

    def _name(self, state: State) -> str:
        return self.old.variables[state.variable].name

    def system(self) -> EquationSystem:
        """The system with the new assignments."""
        if not self.following:
            return self.old
        gone = {f.variable for f in self.following}
        states = tuple(self.leaders.get(s.variable, s) for s in self.old.states if s.variable not in gone)
        return replace(
            self.old, variables=tuple(self.variables), assignments=tuple(self.assignments), states=states,
            following=tuple(self.following),
        )  # fmt: skip
