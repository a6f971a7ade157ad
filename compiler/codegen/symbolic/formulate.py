"""State space to state equations: each assignment becomes one equation in sympy, as the author wrote it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

import sympy
from sympy import Basic

from ...algebra.expression import Expression, Symbol, operations, symbols
from ...algebra.sympy_form import as_written, number_as_written, quotient
from ...algebra.table import counted, is_stepped
from ...equations.system import Assignment, Variable
from ...reduction import LinearLoop, StateSpace
from ...reduction.order import needed
from ...source import Span
from ..events import behind_the_run, event_variables
from .partials import partials, size_of
from .state_equations import (
    Entry,
    EventEquations,
    Indicator,
    Line,
    LinearSystem,
    NamedSymbol,
    Partials,
    ResetEquation,
    SolvedEquation,
    StateEquations,
)

COMPARISONS = frozenset({"less", "less_equal", "equal"})
WHOLE = ("floor", "ceil")  # they jump where the sine of pi times their argument is zero
JUMPS = (*WHOLE, "sign")
SMALL = 12  # operations up to which an unnamed intermediate result stands in the equation that uses it
_NAMED = re.compile(r"[^\W\d]\w*(\[[\d, ]*\])?(\.\w+(\[[\d, ]*\])?)*")  # what an author can name


def formulate(space: StateSpace, descriptions: Mapping[str, str] | None = None) -> StateEquations:
    """State equations of a state space. `descriptions` are the author's words on quantities, by name."""
    return _Formulation(space, descriptions or {}).equations()


class _Formulation:
    """Symbols of the variables, and the equations over them."""

    def __init__(self, space: StateSpace, descriptions: Mapping[str, str]) -> None:
        self.space, self.descriptions = space, descriptions
        self.names: Counter[str] = Counter()
        self.symbols: dict[int, Basic] = {}
        self.inlined: dict[int, Basic] = {}
        self.constant = {i for i, v in enumerate(space.variables) if v.role == "parameter"}
        self.lines: list[Line] = []
        self._write_lines()

    def symbol(self, entry: int | float) -> Basic:
        """The sympy object of a variable or number."""
        if isinstance(entry, float):
            return number_as_written(entry)
        if entry in self.inlined:
            return self.inlined[entry]
        if entry not in self.symbols:
            self.symbols[entry] = self.fresh(self.space.variables[entry].name)
        return self.symbols[entry]

    def fresh(self, name: str) -> Basic:
        """A new symbol; a name that is taken gets a number."""
        self.names[name] += 1
        number = self.names[name]
        return sympy.Symbol(name if number == 1 else f"{name} ({number})")

    # ------------------------------------------------------------ assignments
    def _write_lines(self) -> None:
        space = self.space
        uses = _uses(space)
        roots = {*_roots(space)}
        read = needed(roots, space.inputs)
        for variable, given in enumerate(space.variables):  # the author's names first, without numbers
            if given.role != "computed":
                self.symbol(variable)
        for step in space.steps:
            if read.isdisjoint(step.targets):
                continue  # of a storage behind a junction that is off: its law says what an impulse would do
            if isinstance(step, LinearLoop):
                self._loop(step)
                continue
            if all(isinstance(a, float) or a in self.constant for a in step.arguments):
                self.constant.add(step.target)
            right = as_written(step.expression, self.symbol)
            unnamed = not _NAMED.fullmatch(space.variables[step.target].name)
            if unnamed and uses[step.target] == 1 and step.target not in roots and size_of(right) <= SMALL:
                self.inlined[step.target] = right
            else:
                self.lines.append(SolvedEquation(self.symbol(step.target), right, step.span, step.owner))

    def _loop(self, loop: LinearLoop) -> None:
        matrix = tuple(tuple(self.symbol(e) for e in row) for row in loop.matrix)
        right = tuple(self.symbol(e) for e in loop.right)
        targets = tuple(self.symbol(t) for t in loop.targets)
        owner = f"loop of {', '.join(loop.members)}"
        if len(targets) == 1:
            self.lines.append(SolvedEquation(targets[0], quotient(right[0], matrix[0][0]), loop.span, owner))
        else:
            self.lines.append(LinearSystem(targets, matrix, right, loop.span, owner))

    # ------------------------------------------------------------ the whole
    def equations(self) -> StateEquations:
        space, variables = self.space, self.space.variables
        roles: dict[str, list[int]] = {"parameter": [], "input": [], "time": []}
        read = needed(_roots(space), space.inputs)
        for number, variable in enumerate(variables):
            if variable.role in roles and number in read:
                roles[variable.role].append(number)
        states = [s.variable for s in space.states]
        moving = [*states, *(u.variable for u in space.unknowns)]
        rows = [*(s.rate for s in space.states), *(u.residual for u in space.unknowns)]
        modes = {d.variable for d in space.discretes}
        events = tuple(self._events())
        computed = list(
            dict.fromkeys(s.target for e in space.events for s in e.settings if s.target not in {*states, *modes})
        )
        time = self.symbol(roles["time"][0]) if roles["time"] else sympy.Symbol("time")
        static = frozenset(
            self.symbols[v] for v in self.constant if v in self.symbols and variables[v].role != "parameter"
        )
        by_states = partials(space, computed, states, self.symbol, self.fresh) if computed else Partials({}, ())
        return StateEquations(
            space.name, time,
            self._quantities(roles["parameter"]),
            self._quantities([*roles["input"], *(d.variable for d in space.delays)]),
            self._quantities(states), self._quantities(moving[len(states) :]),
            self._quantities([d.variable for d in space.discretes]),
            tuple(self.lines), static,
            tuple(self._entry(s.variable, s.rate, s.span) for s in space.states),
            tuple(self._entry(u.variable, u.residual, u.span) for u in space.unknowns),
            tuple(Entry(name, self.symbol(v), variables[v].unit) for name, v in space.outputs.items()),
            tuple(self._entry(s.variable, s.start, s.span) for s in space.states),
            tuple(self._initial()),
            tuple(self._entry(d.variable, d.start, None) for d in space.discretes),
            tuple(self._constraints()),
            tuple(Entry(f"{v.owner} {v.words}".strip(), self.symbol(v.condition), "", v.span) for v in space.limits),
            tuple(self._indicators()), events,
            tuple(Entry(s.junction, self.symbol(s.condition), "", s.span) for s in space.switches),
            tuple((self._entry(d.variable, d.value, d.span), self.symbol(d.lag)) for d in space.delays),
            partials(space, rows, moving, self.symbol, self.fresh), by_states,
            tuple(self.symbol(v) for v in computed),
        )  # fmt: skip

    def _quantities(self, numbers: Iterable[int]) -> tuple[NamedSymbol, ...]:
        def quantity(number: int, v: Variable) -> NamedSymbol:
            return NamedSymbol(self.symbol(number), v.name, v.unit, v.value, self.descriptions.get(v.name, ""))

        return tuple(quantity(n, self.space.variables[n]) for n in numbers)

    def _entry(self, variable: int, value: int | float, span: Span | None) -> Entry:
        return Entry(self.space.variables[variable].name, self.symbol(value), self.space.variables[variable].unit, span)

    def _initial(self) -> Iterator[Entry]:
        for claim in self.space.claims:
            given = sympy.Mul(-1, self.symbol(claim.start), evaluate=False)
            residual = sympy.Add(self.symbol(claim.variable), given, evaluate=False)
            yield Entry(claim.element, residual, self.space.variables[claim.variable].unit, claim.span)

    def _constraints(self) -> Iterator[Entry]:
        for item in self.space.invariants:
            if item.position is not None:
                yield Entry(item.name, self.symbol(item.position), self.space.variables[item.position].unit, item.span)
        for item in self.space.invariants:
            if item.velocity is not None:
                unit = self.space.variables[item.velocity].unit
                yield Entry(f"rate of {item.name}", self.symbol(item.velocity), unit, item.span)

    def _events(self) -> Iterator[EventEquations]:
        for event in self.space.events:
            resets = tuple(ResetEquation(self.symbol(s.target), self.symbol(s.value), s.words) for s in event.settings)
            sampling = tuple(map(self.symbol, event.sampling))
            yield EventEquations(event.words, self.symbol(event.condition), resets, sampling, event.span)

    def _indicators(self) -> Iterator[Indicator]:
        """Conditions behind rates, residuals and events; those on parameters alone change nothing during a run."""
        space, seen = self.space, set[Expression]()
        behind = behind_the_run(space) - space.pieced
        for step in space.steps:
            if not isinstance(step, Assignment) or step.target not in behind or step.target in self.constant:
                continue
            for node in operations(step.expression):
                stepped = is_stepped(node)
                if not (stepped or node.operator in (*COMPARISONS, *JUMPS)) or node in seen:
                    continue
                if all(symbol.key in self.constant for symbol in symbols(node)):
                    continue
                seen.add(node)
                operands = (counted(node, node.operands[1]),) if stepped else node.operands
                left, *rest = (as_written(o, self.symbol) for o in operands)
                if stepped or node.operator in WHOLE:
                    left = sympy.sin(sympy.Mul(sympy.pi.evalf(17), left, evaluate=False))
                right = rest[0] if rest else 0
                difference = sympy.Add(left, sympy.Mul(-1, right, evaluate=False), evaluate=False)
                yield Indicator(left if right == 0 else -right if left == 0 else difference, step.owner, step.span)


def _roots(space: StateSpace) -> list[int]:
    """Variables that the results are made of."""
    found = [*space.outputs.values(), *(s.rate for s in space.states), *(u.residual for u in space.unknowns)]
    entries = [*(s.start for s in space.states), *(v for c in space.claims for v in (c.variable, c.start))]
    entries += [v for d in space.delays for v in (d.value, d.lag)]
    entries += [d.start for d in space.discretes]
    entries += [x for e in space.events for x in e.sampling]
    found += [v for i in space.invariants for v in (i.position, i.velocity) if v is not None]
    found += [*event_variables(space), *(v.condition for v in space.limits)]
    return [*found, *(e for e in entries if isinstance(e, int))]


def _uses(space: StateSpace) -> Counter[int]:
    """Number of places at which each variable stands in the assignments."""
    uses: Counter[int] = Counter()
    for step in space.steps:
        if isinstance(step, LinearLoop):
            uses.update(step.read)
            continue
        expression = step.expression
        tops = [expression, *(o for node in operations(expression) for o in node.operands)]
        uses.update(x.key for x in tops if isinstance(x, Symbol))
    return uses
