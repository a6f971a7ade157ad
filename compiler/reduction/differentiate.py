"""Storages in derivative form: d/dt of the stored quantity, by the chain rule over the assignments that it depends on.

This is index reduction on a causal graph: a stroke that denies a storage its integral form marks the constraint to be
differentiated, and the storage's own rate is its dummy derivative (Mattsson and Söderlind, SIAM J. Sci. Comput. 14, 1993).
The stored quantity stays computed from the states, so that hidden constraints hold to round-off. The derivative of a
variable is a variable of its own, defined by one assignment; if a loop leads back to it, the equations for the derivatives
form a loop as well, linear in them for any laws (I-TF-I and C||C are the simplest), which joins the others.

Jumps of what is differentiated: the operations of a formula that may jump, without those that surely join.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from functools import lru_cache
from math import isclose
from random import Random

from ..algebra.affine import solve_affine
from ..algebra.derivative import derivative
from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    evaluate,
    multiply,
    operations,
    symbols,
)
from ..algebra.formula import Formula, bind, over
from ..algebra.operators import CURVES
from ..algebra.table import domain, jumps_at_knots, order_of
from ..equations.system import Assignment, Derivative, EquationSystem, Variable
from ..errors import Diagnostic
from .errors import DerivativeWithoutEnd, ForcedByInput, RateWithoutEnd, no_rate, rate_jumps

HIGHEST = 6  # derivatives of derivatives; a chain of more ends nowhere
DRAWS = 6  # random values of all symbols at which both sides of a condition are compared
EQUAL = 1e-11  # relative difference
SMOOTH_NOISE = 2  # continuous derivatives of a noise
COMPARISONS = ("less", "less_equal")
STAIRS = ("sign", "floor", "ceil")


class Differentiator:
    """Builder of the assignments of time derivatives, each on first demand."""

    def __init__(self, system: EquationSystem) -> None:
        self.variables: list[Variable] = list(system.variables)
        self.diagnostics: list[Diagnostic] = []
        self.assigned = {a.target: a for a in system.assignments}
        # variable that is a derivative -> how often something was differentiated for it
        self.order: dict[int, int] = {}
        # what is differentiated and may jump, which a run must not find: variable, that of its derivative, for which
        self.forced: list[tuple[int, int, Derivative]] = []
        self._rates = {s.variable: s.rate for s in system.states}
        self._derivatives: dict[int, int] = {}  # variable -> that of its derivative
        self._waiting: deque[tuple[int, Derivative]] = deque()
        self._moving: dict[int, bool] = {}
        self._system = system

    def run(self) -> None:
        """Write every derivative that the system contains, and those that they need."""
        self._moving = {item.target: True for item in self._system.derivatives}  # until their own assignments are known
        for item in self._system.derivatives:
            self._assign(item.target, self._derivative(item.of, item), item)
        looked_ahead = False
        while self._waiting:
            variable, item = self._waiting.popleft()
            if variable in self.order and not looked_ahead:  # a second derivative: its expressions grow with each order
                looked_ahead = True
                endless = self._without_end()
                if endless is not None:
                    self._tell(self._without_rest(endless))
                    return
            law = self.assigned[variable]
            self._assign(self._derivatives[variable], self._chain(variable, item), item, law.owner, law.implicit)
        self._shorten()

    def _assign(
        self, target: int, expression: Expression, item: Derivative, owner: str | None = None, implicit: bool = False
    ) -> None:
        owner = owner if owner is not None else item.owner
        self.assigned[target] = _bound(Assignment(target, Formula(0, ZERO), (), item.span, owner, implicit), expression)

    def _derivative(self, variable: int, item: Derivative) -> Expression:
        """Time derivative of a variable: a number, or the variable for it."""
        if variable in self._rates:
            return Symbol(self._rates[variable])
        role = self.variables[variable].role
        if role == "time":
            return ONE
        if role in ("input", "delayed", "mode"):
            name = self.variables[variable].name
            forced = item.quantity is not None and role != "mode"
            self._tell(ForcedByInput(item.span, item.owner, name) if forced else no_rate(item.span, role, name))
            return ZERO
        if not self._moves(variable):
            return ZERO
        if variable not in self._derivatives:
            order = self.order.get(variable, 0) + 1
            if order > HIGHEST:
                self._tell(self._without_rest(item))
                return ZERO
            self._derivatives[variable] = len(self.variables)
            self.order[len(self.variables)] = order
            self.variables.append(Variable(f"d({self.variables[variable].name})/dt", "computed"))
            self._waiting.append((variable, item))
        return Symbol(self._derivatives[variable])

    def _tell(self, diagnostic: Diagnostic) -> None:
        """Collect an error, one for each place."""
        if not any(d.span == diagnostic.span for d in self.diagnostics):
            self.diagnostics.append(diagnostic)

    def _without_rest(self, item: Derivative) -> Diagnostic:
        """Error for a derivative that depends on its own derivatives without end."""
        if item.quantity is None:
            return RateWithoutEnd(item.span, item.span.words)
        return DerivativeWithoutEnd(item.span, item.owner, self.variables[item.of].name)

    def _look_for_jumps(self, variable: int, item: Derivative) -> None:
        """Refuse what surely jumps where `der` asks for its rate; a run looks at what may jump."""
        assignment = self.assigned[variable]
        moving = frozenset(
            Symbol(i) for i, a in enumerate(assignment.arguments) if isinstance(a, int) and self._moves(a)
        )
        jumps = () if variable in self._system.pieced else jumps_of(assignment.formula.expression, moving)
        sure = next((x for x in jumps if surely(x) and (variable not in self.order or x.operator in CURVES)), None)
        if item.quantity is None and sure is not None:
            self._tell(rate_jumps(item.span, sure.operator, assignment.span))
        elif jumps:
            self.forced.append((variable, self._derivatives[variable], item))

    def _moves(self, variable: int) -> bool:
        """Return True if a variable changes in time, that is, depends not only on parameters."""
        stack = [variable]
        while stack:
            node = stack[-1]
            if node in self._moving:
                stack.pop()
                continue
            assignment = self.assigned.get(node)
            if assignment is None:
                self._moving[node] = self.variables[node].role != "parameter"
            else:
                inner = assignment.read
                if assignment.implicit or node in self.order or any(self._moving.get(a) for a in inner):
                    self._moving[node] = True
                else:
                    open_ones = [a for a in inner if a not in self._moving and a not in stack]
                    if open_ones:
                        stack.append(open_ones[0])
                        continue
                    # An argument still on the stack closes a loop: it counts as moving, which costs an assignment at most.
                    self._moving[node] = any(a not in self._moving for a in inner)
            stack.pop()
        return self._moving[variable]

    def _chain(self, variable: int, item: Derivative) -> Expression:
        """Chain rule over the assignment of a variable; that of an implicit one is implicit, as its own slope may be zero, but for others of its loop."""
        assignment = self.assigned[variable]
        terms: list[Expression] = []
        self._look_for_jumps(variable, item)
        for slot, argument in enumerate(assignment.arguments):
            if isinstance(argument, float):
                continue
            own = assignment.implicit and argument == variable
            # also if the slope is zero: a jump in time has no derivative
            inner = Symbol(self._derivatives[variable]) if own else self._derivative(argument, item)
            slope = ZERO if inner == ZERO else derivative(assignment.formula.expression, Symbol(slot))
            if slope != ZERO:
                terms.append(multiply(over(slope, assignment.arguments), inner))
        return add(*terms)

    def _without_end(self) -> Derivative | None:
        """The first storage that depends on derivatives of ever higher order; None if there is none, or if it is unknown.

        In an n-th derivative only the terms with n-th derivatives matter: their factors are the partial derivatives of the first one, and the
        other terms need only derivatives of lower order. So orders are counted without writing any expression of higher order.
        """
        of_target = {item.target: item.of for item in self._system.derivatives}
        leading: dict[int, list[tuple[int, int]] | None] = {}
        seen = set[tuple[int, int]]()
        waiting = deque((item.of, 1, item) for item in self._system.derivatives)
        while waiting:
            variable, order, item = waiting.popleft()
            if variable in self._rates:
                variable, order = self._rates[variable], order - 1
            if order == 0 or (variable, order) in seen or not self._moves(variable):
                continue
            if order > HIGHEST:
                return item
            seen.add((variable, order))
            if variable in of_target:
                waiting.append((of_target[variable], order + 1, item))
                continue
            if variable not in leading:
                leading[variable] = self._leading(variable)
            terms = leading[variable]
            if terms is None:
                return None
            waiting.extend((argument, order + less, item) for argument, less in terms)
        return None

    def _leading(self, variable: int) -> list[tuple[int, int]] | None:
        """Variables whose derivatives occur in that of a variable, with the difference of their order: -1 for the rate of a state.

        None if that is unknown, for a variable that is not computed.
        """
        assignment = self.assigned.get(variable)
        if assignment is None:
            return [] if self.variables[variable].role == "time" else None
        terms: list[Expression] = []
        for slot, argument in enumerate(assignment.arguments):
            if isinstance(argument, float) or (assignment.implicit and argument == variable):
                continue
            if self._moves(argument):
                slope = over(derivative(assignment.formula.expression, Symbol(slot)), assignment.arguments)
                terms.append(multiply(slope, Symbol(("rate", self._rates.get(argument, ~argument)))))
        found = symbols(add(*terms))
        keys = [s.key[1] for s in found if isinstance(s.key, tuple)]
        if sum(key in self._rates for key in keys) > 1:  # rates that are states: their own rates may be one
            return None
        return [(~key, 0) if key < 0 else (key, -1) for key in sorted(keys)]

    def _shorten(self) -> None:
        """Remove variables of derivatives that turned out to be a copy or a number, but those by which a run looks for jumps."""
        short: dict[int, int | float] = {}
        for variable in self.order.keys() - {rate for _, rate, _ in self.forced}:
            law = self.assigned.get(variable)
            expression = None if law is None or law.implicit else law.expression
            if isinstance(expression, Number):
                short[variable] = expression.value
            elif isinstance(expression, Symbol) and expression.key != variable:
                short[variable] = expression.key

        def end(argument: int | float) -> int | float:
            seen = set()
            while isinstance(argument, int) and argument in short and argument not in seen:
                seen.add(argument)
                argument = short[argument]
            return argument

        for target in (*self.order, *(d.target for d in self._system.derivatives)):
            if target in self.assigned and target not in short:
                old = self.assigned[target]
                self.assigned[target] = _bound(old, over(old.formula.expression, [end(a) for a in old.arguments]))


def _bound(assignment: Assignment, expression: Expression) -> Assignment:
    """Return an assignment with another expression over variables. An implicit one always depends on its target: a loop is cut there."""
    bound = bind(expression)
    arguments = tuple(bound.arguments)
    if assignment.implicit and assignment.target not in arguments:
        arguments = (*arguments, assignment.target)
    return replace(assignment, formula=replace(bound.formula, arity=len(arguments)), arguments=arguments)


@lru_cache(maxsize=4096)
def jumps_of(x: Expression, moving: frozenset[Symbol]) -> tuple[Apply, ...]:
    """Signs, whole numbers, choices and bends of tables, differentiated already, of an expression that move and may jump.

    A choice or sign joins where both sides have one value at its threshold, which is compared at random values of all symbols.
    """
    nodes = [n for n in operations(x) if n.operator in (*STAIRS, "select", *COMPARISONS) and _moves(n, moving)]
    inside = {n.operands[0] for n in nodes if n.operator == "select"}
    bends = (n for n in operations(x) if n.operator in CURVES and _moves(n, moving) and is_bend(n))
    return (*bends, *(n for n in nodes if not (n in inside or _joins(x, n, moving))))


def is_bend(node: Apply) -> bool:
    """Return True for a derivative of a table or noise that jumps at its points."""
    if node.operator == "noise":
        return order_of(node) > SMOOTH_NOISE
    return jumps_at_knots(node) and len(domain(node)) > 2


def surely(node: Apply) -> bool:
    """Return True for a jump that no value of a parameter removes: a whole number, or a choice between two numbers."""
    if node.operator == "select":
        one, other = node.operands[1:]
        return isinstance(one, Number) and isinstance(other, Number) and one != other
    return node.operator in STAIRS or node.operator in CURVES


def _moves(node: Apply, moving: frozenset[Symbol]) -> bool:
    part = node.operands[0] if node.operator == "select" else node
    return not moving.isdisjoint(symbols(part))


def _joins(x: Expression, node: Apply, moving: frozenset[Symbol]) -> bool:
    """Return True if the expression has one value on both sides of the threshold of a sign or a simple choice."""
    condition = node.operands[0] if node.operator == "select" else node
    sides: tuple[Expression, ...]
    ends: tuple[Expression, Expression]
    if node.operator == "sign":
        ends, sides = (node.operands[0], ZERO), (ONE, Number(-1.0))
    elif isinstance(condition, Apply) and condition.operator in COMPARISONS and node.operator == "select":
        ends, sides = (condition.operands[0], condition.operands[1]), node.operands[1:]
    else:
        return False
    for symbol in symbols(ends[0] - ends[1]):
        place = solve_affine(*ends, symbol) if symbol in moving else None
        if place is not None:
            return all(_alike(_with(x, node, sides), symbol, place, draw) for draw in range(DRAWS))
    return False


def _with(x: Expression, node: Apply, sides: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """The expression with each of some others in the place of one of its operations."""

    def put(y: Expression, side: Expression) -> Expression:
        if y == node:
            return side
        return Apply(y.operator, tuple(put(o, side) for o in y.operands)) if isinstance(y, Apply) else y

    return tuple(put(x, side) for side in sides)


def _alike(sides: tuple[Expression, ...], symbol: Symbol, place: Expression, draw: int) -> bool:
    """Return True if both sides have one value where a symbol is at its place, at one draw of all others."""
    choose = Random(draw)
    values = {s.key: choose.uniform(0.3, 3.0) * choose.choice((-1.0, 1.0)) for x in sides for s in symbols(x)}
    try:
        values[symbol.key] = evaluate(place, lambda key: values.setdefault(key, choose.uniform(0.3, 3.0)))
        one, other = (evaluate(side, values.__getitem__) for side in sides)
    except (ArithmeticError, ValueError):
        return False
    return isclose(one, other, rel_tol=EQUAL, abs_tol=EQUAL * max(map(abs, values.values())))
