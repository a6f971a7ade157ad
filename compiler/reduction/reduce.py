"""Equations to state space: the equations that the run needs, in order, with loops solved.

For searches from far away, a nonlinear loop is cut at both variables of each law that relates two of them, one nonlinearly: both become unknowns.
The rest of the loop is then linear in its unknowns, except for one function of one variable in each of these rows. A solution from
far away needs this: along each law it can move by the one of its two variables that changes less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

from ..algebra.affine import affine_parts
from ..algebra.expression import ONE, ZERO, Expression, Number, Symbol, add, depends_on, multiply, negate, symbols
from ..algebra.formula import bind
from ..equations.system import Assignment, Claim, EquationSystem, EventRow, Invariant, Variable
from ..errors import CompilationFailed, Diagnostic, InternalError
from ..source import Span
from .differentiate import Differentiator
from .errors import NothingToCompute, SingularLoop
from .order import blocks, needed, tear
from .round_trips import Sums, has_constant, without_constants, without_round_trips
from .state_space import Dependent, Entry, Forced, LinearLoop, OpenedLaw, StateSpace, Step, TearingVariable


def reduce_equations(system: EquationSystem, everything: bool, span: Span, opened: bool = False) -> StateSpace:
    """Order the equations that the outputs need (`everything`: all states and powers too, for an energy balance).

    `opened`: nonlinear loops are also cut at both variables of each law.
    """
    return _Reduction(system, everything, span, opened).run()


class _Reduction:
    def __init__(self, system: EquationSystem, everything: bool, span: Span, opened: bool) -> None:
        self.system, self.everything, self.span, self.opened = system, everything, span, opened
        self.derived = [(d, d.quantity) for d in system.derivatives if d.quantity is not None]  # storages
        differentiator = Differentiator(system)
        differentiator.run()
        if differentiator.diagnostics:
            raise CompilationFailed(differentiator.diagnostics)
        self.variables: list[Variable] = differentiator.variables
        self.assigned: dict[int, Assignment] = differentiator.assigned
        self.differentiator = differentiator
        self.pieced = {*differentiator.order, *(d.target for d in system.derivatives), *system.pieced}
        self.unknowns: list[TearingVariable] = []
        self.laws: list[OpenedLaw] = []
        self.loops: dict[int, tuple[Assignment, ...]] = {}
        bound = (i.multiplier for i in system.invariants if i.multiplier is not None)
        self.multipliers = frozenset((*bound, *(b.variable for b in system.balances)))
        self.diagnostics: list[Diagnostic] = []

    def run(self) -> StateSpace:
        system = self.system
        inputs: list[list[int]] = [[] for _ in self.variables]
        for target, assignment in self.assigned.items():
            inputs[target] = [*assignment.read]
        rates = {s.variable: s.rate for s in system.states}
        reach = [*inputs]
        for variable, rate in rates.items():
            reach[variable] = [rate]  # a state needs its rate
        for delay in system.delays:  # and who needs a delayed signal needs what it will be
            reach[delay.variable] = [delay.value]
        wanted = list(system.outputs.values())
        if self.everything or not wanted:
            wanted += [s.variable for s in system.states]
        for limit in system.limits:  # every run checks its validity limits
            wanted += [limit.condition, *(v for _, v, _ in limit.values if isinstance(v, int))]
        if self.everything:
            wanted += [v for p in system.ports for v in (p.effort, p.flow)] + list(system.stored.values())
            wanted += [v for s in system.storages for v in s.stored]
        if not wanted:
            raise CompilationFailed([NothingToCompute(self.span)])
        if system.switches:  # contents continue in other positions of the switches, even if not read here
            wanted += [s.condition for s in system.switches] + [s.variable for s in system.states]
            wanted += [v for d, _ in self.derived for v in (d.target, d.of)]
            conjugates = [s.conjugate for s in system.states] + [d.conjugate for d, _ in self.derived]
            wanted += [v for v in conjugates if v is not None]
            wanted += [v for m in system.momenta for v in (m.variable, m.rate)]
            wanted += [d.variable for d in system.discretes]  # and so does what events set
        used = needed(wanted, reach)
        events = self._events(used, inputs, reach)
        discretes = tuple(d for d in system.discretes if d.variable in used)
        used |= needed([d.start for d in discretes if isinstance(d.start, int)], inputs)
        delays = tuple(d for d in system.delays if d.variable in used)
        used |= needed([d.lag for d in delays if isinstance(d.lag, int)], inputs)
        used |= needed([x for e in events for x in e.sampling if isinstance(x, int)], inputs)
        claims = self._claims(used, inputs, reach)
        dependents = tuple(
            Dependent(d.of, d.owner, stored, d.conjugate) for d, stored in self.derived if d.target in used
        )
        used |= needed([d.variable for d in dependents], reach)
        forced = [
            Forced(v, d.owner, d.span)
            for v, rate, d in self.differentiator.forced
            if rate in used or (d.quantity is not None and v in used)
        ]
        used |= needed([f.variable for f in forced], inputs)
        invariants = self._invariants(used, inputs, reach)
        states = [s for s in system.states if s.variable in used]
        for state in states:  # starts and nominals are computed from parameters alone
            extra = [e for e in (state.start, state.nominal, state.drawn) if isinstance(e, int)]
            used |= needed(extra, inputs)
        following = tuple(f for f in system.following if f.variable in used)
        if dependents:  # of which one may change places with a state that others follow
            dependents += tuple(Dependent(f.variable, "", f.variable) for f in following)
        used |= needed([f.start for f in following if isinstance(f.start, int)], inputs)
        for storage in system.storages if self.everything else ():
            used |= needed([a for a in storage.arguments if isinstance(a, int)], inputs)
        steps: list[Step] = []
        for block in blocks(sorted(used), inputs):
            steps += self._block(block, inputs)
        if self.diagnostics:
            raise CompilationFailed(self.diagnostics)
        return StateSpace(
            system.name, tuple(self.variables), tuple(states), system.outputs, system.quantities,
            system.ports if self.everything else (), system.storages if self.everything else (),
            system.stored if self.everything else {}, claims, system.limits, invariants,
            tuple(b for b in system.balances if b.variable in used), discretes, events, system.switches, delays,
            frozenset(self.pieced), following, tuple(steps), tuple(self.unknowns), dependents, tuple(forced), self._index(used, steps),
            tuple(Dependent(m.variable, "", m.quantity, m.rate) for m in system.momenta), tuple(self.laws), self.loops,
        )  # fmt: skip

    def _events(
        self, used: set[int], inputs: Sequence[Sequence[int]], reach: Sequence[Sequence[int]]
    ) -> tuple[EventRow, ...]:  # fmt: skip
        """Events that end the run, or set a variable of it, or one that nothing can move, which is reported.

        The variables that they read are added to `used`.
        """
        free = {s.variable for s in self.system.states} | {d.variable for d in self.system.discretes}
        kept: dict[tuple[int, int], None] = {}
        used |= needed([event.condition for event in self.system.events if event.stops], reach)
        growing = True
        while growing:
            growing = False
            for i, event in enumerate(self.system.events):
                # a unit exchanges all of its values
                is_whole = event.span.unit is not None and any(i == k for k, _ in kept)
                for j, setting in enumerate(event.settings):
                    moved = {setting.target, *needed([setting.target], inputs)} & free
                    if (i, j) not in kept and (moved & used or not moved or is_whole):
                        kept[i, j] = None
                        used |= needed([event.condition, setting.target, setting.value], reach)
                        growing = True
        rows = [
            replace(e, settings=tuple(s for j, s in enumerate(e.settings) if (i, j) in kept))
            for i, e in enumerate(self.system.events)
        ]
        return tuple(row for row in rows if row.settings or row.stops)

    def _claims(
        self, used: set[int], inputs: Sequence[Sequence[int]], reach: Sequence[Sequence[int]]
    ) -> tuple[Claim, ...]:  # fmt: skip
        """Claims on a state of this run, or on no state of the model, which is reported. The variables that they read are added to `used`."""
        kept: list[Claim] = []
        left = list(self.system.claims)
        states = {s.variable for s in self.system.states}
        poses = {s.variable for s in self.system.states if s.drawn is not None}
        rates = needed([s.rate for s in self.system.states if s.drawn is not None], inputs) & states - poses
        held = {s.variable for s in self.system.states if s.given} - rates
        while left:
            read = {c: needed([c.variable], inputs) & states for c in left}
            found = [c for c in left if read[c] & used or not read[c] or c.variable in used]
            if not found:
                break
            for claim in found:
                left.remove(claim)
                kept.append(replace(claim, on_pose=bool(read[claim] & poses) and read[claim] <= poses | held))
                used |= needed([claim.variable], reach)
                used |= needed([claim.start] if isinstance(claim.start, int) else [], inputs)
        return tuple(kept)

    def _invariants(
        self, used: set[int], inputs: Sequence[Sequence[int]], reach: Sequence[Sequence[int]]
    ) -> tuple[Invariant, ...]:  # fmt: skip
        """Constraints with multipliers that this run needs, and other invariants of its states."""
        kept = []
        states = {s.variable for s in self.system.states}
        behind: set[int] = set()
        for invariant in self.system.invariants:
            values = [v for v in (invariant.position, invariant.velocity) if v is not None]
            bound = invariant.multiplier
            if bound in used if bound is not None else needed(values, inputs) & states & used:
                kept.append(invariant)
                if not behind.issuperset(values):
                    used |= needed(values, reach, behind)
        return tuple(sorted(kept, key=lambda invariant: invariant.position is None))  # residuals first

    def _index(self, used: set[int], steps: Sequence[Step]) -> int:
        """Index of the equations before reduction: one more than the highest derivative that was formed."""
        order = max((self.differentiator.order.get(v, 0) for v in used), default=0)
        if self.multipliers & used:
            rates_alone = {i.multiplier for i in self.system.invariants if i.position is None}
            return max(order, 2 if self.multipliers & used - rates_alone else 1) + 1
        if any(d.target in used for d, _ in self.derived):
            return max(order, 1) + 1
        return 1 if self.unknowns or any(isinstance(s, LinearLoop) for s in steps) else 0

    def _block(self, block: list[int], inputs: Sequence[Sequence[int]]) -> list[Step]:
        """Steps of one strongly connected block: an assignment, or a loop."""
        first = block[0]
        if len(block) == 1 and first not in inputs[first] and first not in self.multipliers:
            if first in self.assigned:
                return [self.assigned[first]]
            if self.variables[first].role == "computed":
                raise InternalError(f"nothing computes {self.variables[first].name}")
            return []
        return self._loop(block, inputs)

    def _loop(self, block: list[int], inputs: Sequence[Sequence[int]]) -> list[Step]:
        """Cut a loop so that the rest is computed in order. A linear loop becomes a linear system, a nonlinear one is solved by the run."""
        bound = [v for v in block if v in self.multipliers]
        free = [v for v in block if v not in self.multipliers]
        members = tuple(dict.fromkeys(self.assigned[v].owner for v in block))
        whole = tuple(self.assigned[v] for v in block)
        partial = self._made_total(free)
        if partial:
            inputs = [*inputs]
            for v in partial:
                inputs[v] = [*self.assigned[v].read]
        cut, order = tear(free, inputs)
        if bound:  # unknowns of a step: the system stays sparse for any number of loops
            return self._nonlinear([*bound, *cut], order, members)
        self.loops |= dict.fromkeys(cut, whole)
        linear = None if partial else self._linear(block, cut, order, members)
        if linear is not None:
            return linear
        if self.opened:
            laws = opened_laws({v: self.assigned[v] for v in block}, {p.flow for p in self.system.ports})
            self.laws += laws
            cut = list(dict.fromkeys([*cut, *(v for law in laws for v in (law.argument, law.value))]))
            order = [v for v in order if v not in set(cut)]
        else:
            cut, order = self._with_laws_computed(cut, order, inputs)
        return self._nonlinear(cut, order, members)

    def _with_laws_computed(
        self, cut: list[int], order: list[int], inputs: Sequence[Sequence[int]]
    ) -> tuple[list[int], list[int]]:  # fmt: skip
        """Take laws with a constant out of the cut where the rest can be computed in order without, if then constants cancel: as unknowns they round to it."""
        members, fewer, longer = {*cut, *order}, cut, order
        for v in cut:
            if self.assigned[v].implicit or not has_constant(self.assigned[v].expression, members):
                continue
            inner = {*longer, v}
            found = blocks([*longer, v], [[i for i in read if i in inner] for read in inputs])
            if all(len(block) == 1 and block[0] not in inputs[block[0]] for block in found):
                fewer, longer = [c for c in fewer if c != v], [block[0] for block in found]
        opened = Sums({v: self.assigned[v].expression for v in longer}, members)
        cancels = any(without_constants(self._residual(v), opened) is not None for v in fewer)
        return (fewer, longer) if cancels else (cut, order)

    def _residual(self, variable: int) -> Expression:
        assignment = self.assigned[variable]
        return assignment.expression if assignment.implicit else assignment.expression - Symbol(variable)

    def _made_total(self, block: list[int]) -> list[int]:
        """Use the implicit form, which is defined everywhere, for members of a loop whose formula is not: an iteration may lead anywhere."""
        partial = [v for v in block if self.assigned[v].residual is not None]
        for v in partial:
            assignment = self.assigned[v]
            assert assignment.residual is not None
            formula, arguments = assignment.residual.formula, assignment.residual.arguments
            self.assigned[v] = replace(assignment, formula=formula, arguments=arguments, implicit=True, residual=None)
        return partial

    def _nonlinear(self, cut: list[int], order: list[int], members: tuple[str, ...]) -> list[Step]:
        """Unknowns for the cut variables. The residual is the computed value minus the unknown."""
        read = {s.key for v in (*cut, *order) for s in symbols(self.assigned[v].expression)}
        for v in cut:
            if self.assigned[v].implicit and v not in read:
                self.diagnostics.append(SingularLoop(self.assigned[v].span, f"`{self.variables[v].name}`"))
        inner: list[Step] = [self.assigned[v] for v in order]
        expressions: dict[object, Expression] = {v: self.assigned[v].expression for v in order}
        sums, opened = Sums(expressions), Sums(expressions, {*cut, *order})
        loop = self.unknowns[-1].loop + 1 if self.unknowns else 0
        for variable in cut:
            assignment = self.assigned[variable]
            old = self.variables[variable]
            self.variables[variable] = Variable(old.name, "unknown", old.unit, assignment.guess)
            residual = self._residual(variable)
            bound = bind(without_constants(residual, opened) or without_round_trips(residual, sums))
            number = len(self.variables)
            self.variables.append(Variable(f"residual of {old.name}", "computed"))
            self.pieced |= {number} if variable in self.pieced else set()
            inner.append(Assignment(number, bound.formula, tuple(bound.arguments), assignment.span, assignment.owner))
            bound_by = variable in self.multipliers
            self.unknowns.append(TearingVariable(variable, number, assignment.span, members, loop, bound_by))
        return inner

    def _linear(
        self, block: list[int], cut: list[int], order: list[int], members: tuple[str, ...]
    ) -> list[Step] | None:  # fmt: skip
        """An affine loop: each member expressed in the cut variables, then solved for these; None if it is not affine."""
        named = ", ".join(f"`{m}`" for m in members[:8]) + ("…" if len(members) > 8 else "")
        inside = set(block)
        parts = {v: self._affine(self.assigned[v].expression, inside) for v in block}
        if any(p is None for p in parts.values()):
            return None
        known: dict[int, tuple[dict[int, Expression], Expression]] = {v: ({v: ONE}, ZERO) for v in cut}
        steps: list[Step] = []
        rows: list[tuple[dict[int, Expression], Expression]] = []
        for variable in (*order, *cut):
            part = parts[variable]
            assert part is not None
            combined = self._combine(part, known)
            if variable in cut:
                rows.append(combined)
            else:
                name = self.variables[variable].name
                known[variable] = self._held(combined, name, self.assigned[variable], steps)
        matrix, right = [], []
        places = {v: i for i, v in enumerate(cut)}
        for variable, (slopes, rest) in zip(cut, rows, strict=True):
            owner = self.assigned[variable]
            own = ZERO if owner.implicit else ONE
            row: list[Entry] = [0.0] * len(cut)  # most of a long loop
            slopes.setdefault(variable, ZERO)
            for v in sorted(slopes, key=places.__getitem__):
                entry = add(own if v == variable else ZERO, negate(slopes[v]))
                row[places[v]] = self._entry(entry, self._gain(v, variable), owner, steps)
            matrix.append(tuple(row))
            right.append(self._entry(rest, f"right side of the loop for {self.variables[variable].name}", owner, steps))
        span = self.assigned[block[0]].span
        if any(all(x == 0.0 for x in row) for row in matrix):
            self.diagnostics.append(SingularLoop(span, named))
            return []
        steps.append(LinearLoop(tuple(cut), tuple(matrix), tuple(right), span, members))
        return [*steps, *(self.assigned[v] for v in order)]

    def _gain(self, column: int, row: int) -> str:
        return f"loop gain of {self.variables[column].name} for {self.variables[row].name}"

    @staticmethod
    def _affine(expression: Expression, block: set[int]) -> tuple[dict[int, Expression], Expression] | None:
        """Slopes by the members of a block and the rest; None if it is not jointly affine in them."""
        slopes: dict[int, Expression] = {}
        inside = [s for s in symbols(expression) if s.key in block]
        rest = expression
        for symbol in inside:
            parts = affine_parts(rest, symbol)
            if parts is None or any(depends_on(parts[0], other) for other in inside):
                return None
            assert isinstance(symbol.key, int)
            slopes[symbol.key], rest = parts
        return slopes, rest

    @staticmethod
    def _combine(
        parts: tuple[dict[int, Expression], Expression], known: dict[int, tuple[dict[int, Expression], Expression]]
    ) -> tuple[dict[int, Expression], Expression]:
        total: dict[int, list[Expression]] = {}
        rest = [parts[1]]
        for variable, slope in parts[0].items():
            inner, constant = known[variable]
            for cut, factor in inner.items():
                total.setdefault(cut, []).append(multiply(slope, factor))
            rest.append(multiply(slope, constant))
        return {v: add(*terms) for v, terms in total.items()}, add(*rest)

    def _held(
        self, combined: tuple[dict[int, Expression], Expression], name: str, assignment: Assignment, steps: list[Step]
    ) -> tuple[dict[int, Expression], Expression]:
        """The same with variables for longer expressions, so that nothing is written twice."""
        slopes, rest = combined
        held = {v: self._name(x, f"{name} per {self.variables[v].name}", assignment, steps) for v, x in slopes.items()}
        return held, self._name(rest, f"{name} without the loop", assignment, steps)

    def _name(self, expression: Expression, name: str, assignment: Assignment, steps: list[Step]) -> Expression:
        entry = self._entry(expression, name, assignment, steps)
        return Number(entry) if isinstance(entry, float) else Symbol(entry)

    def _entry(self, expression: Expression, name: str, assignment: Assignment, steps: list[Step]) -> Entry:
        if isinstance(expression, Number):
            return expression.value
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        variable = len(self.variables)
        self.variables.append(Variable(name, "computed"))
        self.pieced |= {variable} if assignment.target in self.pieced else set()
        bound = bind(expression)
        steps.append(Assignment(variable, bound.formula, tuple(bound.arguments), assignment.span, assignment.owner))
        return variable


def opened_laws(block: Mapping[int, Assignment], flows: Set[int]) -> list[OpenedLaw]:
    """Laws among the assignments of a loop (target -> assignment). `flows`: the variables that are flows of elements."""
    found = []
    for target, assignment in block.items():
        bound = _bound(target, assignment, block)
        if bound is not None:
            found.append(OpenedLaw(target, *bound, bound[0] not in flows))
    return found


def _bound(target: int, assignment: Assignment, block: Mapping[int, Assignment]) -> tuple[int, int] | None:
    """Argument and value of a law of a loop; None if the assignment is no such law."""
    expression = assignment.expression
    inside = [s for s in symbols(expression) if s.key in block]
    if not assignment.implicit:
        nonlinear = len(inside) == 1 and affine_parts(expression, inside[0]) is None
        return (inside[0].key, target) if nonlinear and inside[0].key != target else None
    if len(inside) != 2:
        return None
    for argument, value in (inside, inside[::-1]):
        if _is_shifted(expression, argument, value):
            return argument.key, value.key
    return None


def _is_shifted(expression: Expression, argument: Symbol, value: Symbol) -> bool:
    """Return True if an expression is a nonlinear function of one variable plus a linear one of the other."""
    parts = affine_parts(expression, value)
    if parts is None or parts[0] == ZERO or depends_on(parts[0], argument):
        return False
    return affine_parts(parts[1], argument) is None
