"""Builder of equations: variables, assignments, references of the text, and aliases (variables that are known to be equal)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from ..algebra.affine import jointly_affine
from ..algebra.expression import ZERO, Expression, Number, Symbol, add, multiply, symbols
from ..algebra.formula import Bound, Formula, bind, leaf, over
from ..errors import Diagnostic
from ..graph.network import (
    TIME,
    BondEnd,
    BondGraph,
    Delay,
    Integral,
    Junction,
    Named,
    Quantity,
    Reading,
    Reference,
    Requirement,
)
from ..graph.prune import adjustable
from ..source import Span
from .errors import NothingLeft, Undetermined
from .naming import bond_names, port_name, unit_of
from .system import (
    Argument,
    Assignment,
    Claim,
    Delayed,
    Derivative,
    Discrete,
    EquationSystem,
    EventRow,
    Invariant,
    JunctionSwitch,
    Momentum,
    MomentumBalance,
    PowerPort,
    State,
    Storage,
    Validity,
    Variable,
)

_Row = tuple[Iterator[Reference], Callable[[], None]]  # references of a quantity, and the action after them


class EquationBuilder:
    """Collection of variables and assignments. `derive` adds those of the nodes and `multibody` those of a mechanism."""

    def __init__(self, graph: BondGraph, zeros: frozenset[str], free: frozenset[str]) -> None:
        self.graph, self.zeros, self.free = graph, zeros, free
        self.variables: list[Variable] = []
        self.assignments: list[Assignment] = []
        self.assigned: dict[int, Assignment] = {}
        self.derivatives: list[Derivative] = []
        self.states: list[State] = []
        self.claims: list[Claim] = []
        self.invariants: list[Invariant] = []
        self.balances: list[MomentumBalance] = []
        self.momenta: list[Momentum] = []
        self.pieced: set[int] = set()
        self.ports: list[PowerPort] = []
        self.storages: list[Storage] = []
        self.stored: dict[str, int] = {}
        self.discretes: list[Discrete] = []
        self.events: list[EventRow] = []
        self.delays: list[Delayed] = []
        self.switches: list[JunctionSwitch] = []
        self.diagnostics: list[Diagnostic] = []
        self.alias: dict[int, int] = {}
        self.quantities: dict[str, int] = {}
        self.readings: dict[Reading, int] = {}
        self.bond_of = {end: n for n, b in enumerate(self.graph.bonds) for end in (b.tail, b.head)}
        self.efforts: list[int] = []
        self.flows: list[int] = []
        self._integrals: dict[int, int | None] = {}
        self._node_numbers = {node.name: number for number, node in enumerate(self.graph.nodes)}
        for number in range(len(graph.bonds)):
            names = bond_names(graph, number)
            self.efforts.append(self.variable(names[0], "computed", names[2]))
            self.flows.append(self.variable(names[1], "computed", names[3]))
        self._bond_variables = {*self.efforts, *self.flows}

    def system(self) -> EquationSystem:
        """All collected equations, with one number for each set of aliases."""
        outputs = {
            name: self._output(named.name, named.definition, named.unit, named.span)
            for name, named in self.graph.outputs.items()
        }
        limits = [self._limit(requirement) for requirement in self.graph.requirements]
        return EquationSystem(
            self.graph.name, tuple(self.variables), tuple(self._resolved()), tuple(self.derivatives), tuple(self.states),
            {n: self.root(v) for n, v in outputs.items()}, {n: self.root(v) for n, v in self.quantities.items()},
            tuple(self.ports), tuple(self.storages), self.stored, tuple(self.claims),
            tuple(replace(t, condition=self.root(t.condition), values=tuple((n, self._through(v), u) for n, v, u in t.values)) for t in limits),
            tuple(self.invariants), tuple(self.balances),
            tuple(replace(d, start=self._through(d.start)) for d in self.discretes), tuple(self._event(e) for e in self.events),
            tuple(replace(s, condition=self.root(s.condition)) for s in self.switches),
            tuple(replace(d, value=self.root(d.value), lag=self._through(d.lag)) for d in self.delays),
            frozenset(self.pieced), momenta=tuple(replace(m, variable=self.root(m.variable), rate=self.root(m.rate)) for m in self.momenta),
        )  # fmt: skip

    def _limit(self, required: Requirement) -> Validity:
        """A condition as a variable that is 1 if it holds."""
        condition = self.variable(f"{required.words} of {required.name}".removesuffix(" of "), "computed", "1")
        self.apply(condition, required.condition, required.span, required.name)
        values = tuple((words, self.reference(reference), unit) for words, reference, unit in required.readings)
        return Validity(required.name, required.words, required.text, condition, values, required.span, required.stands)

    def _event(self, event: EventRow) -> EventRow:
        root = self.root
        settings = tuple(replace(s, target=root(s.target), value=root(s.value)) for s in event.settings)
        sampling = tuple(map(self._through, event.sampling))
        return replace(event, condition=root(event.condition), settings=settings, sampling=sampling)

    # ------------------------------------------------------------ what rooms write with
    def variable(self, name: str, role: str, unit: str = "", value: float | None = None) -> int:
        """Add a variable and return its number."""
        self.variables.append(Variable(name, role, unit, value))
        return len(self.variables) - 1

    def assign(self, target: int, expression: Expression, span: Span, owner: str) -> None:
        """`target := expression` (over variable numbers). A plain copy makes the target an alias."""
        if isinstance(expression, Symbol) and self.same_unit(target, expression.key):
            self.join(target, expression.key, span, owner)
            return
        bound = bind(expression)
        self.add(Assignment(target, bound.formula, tuple(bound.arguments), span, owner))

    def apply(self, target: int, bound: Bound, span: Span, owner: str) -> None:
        """`target := formula(references)`, for a bound expression of the text."""
        arguments = tuple(self.reference(a) for a in bound.arguments)
        expression = bound.formula.expression
        if isinstance(expression, Symbol) and isinstance(arguments[0], int) and self.same_unit(target, arguments[0]):
            self.join(target, arguments[0], span, owner)
            return
        self.add(Assignment(target, bound.formula, arguments, span, owner))

    def join(self, target: int, source: int, span: Span, owner: str) -> None:
        """Make two variables aliases. If they already were, no equation determines them: an error."""
        if self.root(target) == self.root(source):
            self.diagnostics.append(Undetermined(span, owner, self.variables[target].name))
            return
        self.alias[target] = source

    def same_unit(self, target: int, source: int) -> bool:
        """Return True if two variables can be aliases: in u = 1 ohm*i the numbers are equal, but the units are not."""
        units = {self.variables[target].unit, self.variables[source].unit}
        return len(units - {""}) < 2

    def add(self, assignment: Assignment) -> None:
        """Add an assignment without changes."""
        self.assignments.append(assignment)
        self.assigned[assignment.target] = assignment

    def state(
        self, variable: int, rate: int, start: Expression, name: str, span: Span, given: bool = True, drawn: Expression | None = None
    ) -> None:  # fmt: skip
        """Add a state: rate, start over parameters, `given` if the author gave the start, `drawn` for a coordinate's value in the drawing."""
        begins = self.static(start, f"{name} at the start", span)
        rest = None if drawn is None else begins if drawn == start else self.static(drawn, f"{name} drawn", span)
        self.states.append(State(variable, rate, begins, None, span, given, None, rest))

    def claim(self, value: Expression, start: Expression, name: str, span: Span) -> None:
        """Add a start that the author gives to a variable computed from states."""
        variable = self.held(value, name, "", span)
        self.claims.append(Claim(variable, self.static(start, f"{name} at the start", span), name, span))

    def differentiated(self, target: int, of: int, span: Span, owner: str, quantity: int) -> None:
        """`target := d(of)/dt`, which index reduction expands; `quantity`: `of` by its own name and unit."""
        self.derivatives.append(Derivative(target, of, span, owner, quantity))

    def definition(self, variable: int) -> Expression | float | None:
        """Expression that computes a variable explicitly, or the value of a parameter; None otherwise."""
        variable = self.root(variable)
        assignment = self._explicit(variable)
        if assignment is not None:
            return assignment.expression
        found = self.variables[variable]
        return found.value if found.role == "parameter" else None

    def smoothly(self, target: int) -> None:
        """Declare that the pieces of a target's expression join smoothly: none of its conditions is an event."""
        self.pieced.add(target)

    def vanishing(self, target: int, expression: Expression, span: Span, owner: str) -> None:
        """Add an implicit assignment: the target makes the expression zero."""
        bound = bind(expression)
        self.add(Assignment(target, bound.formula, tuple(bound.arguments), span, owner, True))

    def invariant(
        self, position: int | None, velocity: int | None, name: str, span: Span, multiplier: int | None = None, part: int | None = None
    ) -> None:  # fmt: skip
        """Add an invariant: every state of a run keeps it and its rate at zero, or its rate alone. `multiplier` and `part` as in `Invariant`."""
        self.invariants.append(Invariant(position, velocity, name, span, multiplier, part))

    @property
    def switching(self) -> bool:
        """True if junctions of the model switch."""
        return bool(self.graph.switches)

    def momentum(self, variable: int, rate: int) -> None:
        """Add the momentum of a coordinate, which impulses balance."""
        self.momenta.append(Momentum(variable, variable, rate))

    def balance(self, variable: int, told: Diagnostic) -> None:
        """Add an implicit unknown that is solved with the multipliers, see `MomentumBalance`."""
        self.balances.append(MomentumBalance(variable, told))

    def folded(self, bound: Bound) -> Expression:
        """A bound expression of the text over variable numbers, with known zeros put in."""
        return over(bound.formula.expression, bound.arguments, lambda a: leaf(self.reference(a)))

    def root(self, variable: int) -> int:
        """Variable that an alias is equal to."""
        while variable in self.alias:
            variable = self.alias[variable]
        return variable

    # ------------------------------------------------------------ references
    def reference(self, reference: Reference) -> Argument:
        """Variable (or number) of a reference in the text."""
        if isinstance(reference, float):
            return reference
        if isinstance(reference, Quantity):
            return self.quantity(reference.name)
        return self.reading(reference)

    def quantity(self, name: str) -> Argument:
        """Variable of a named quantity, with its definition on first use; zero if it is known to be zero."""
        if not self._is_new(name):
            return self.quantities.get(name, 0.0)
        rows = [self._opened(name)]
        while rows:  # not by recursion: a row of quantities may be longer than Python nests calls
            reads, finish = rows[-1]
            following = self._next_new(reads)
            if following is None:
                rows.pop()
                finish()
            else:
                rows.append(self._opened(following))
        return self.quantities[name]

    def _next_new(self, reads: Iterator[Reference]) -> str | None:
        """Next quantity among the references that has no variable yet. Readings before it are made on the way."""
        for reference in reads:
            if isinstance(reference, Reading):
                self.reading(reference)
            elif isinstance(reference, Quantity) and self._is_new(reference.name):
                return reference.name
        return None

    def _is_new(self, name: str) -> bool:
        return name not in self.quantities and name not in self.zeros

    def _opened(self, name: str) -> _Row:
        """Add the variable of a new quantity. Returns its references, and a function that writes its definition after them."""
        if name == TIME.name and name not in self.graph.quantities:
            self.quantities[name] = self.variable("time", "time", "s")
            return iter(()), _nothing
        if name in self.graph.delays:
            return self._delay(self.graph.delays[name])
        if name in self.graph.integrals:
            return self._integral(self.graph.integrals[name])
        named = self.graph.quantities[name]
        if named.role == "mode":
            return self._discrete(named)
        if adjustable(named) and (named.role == "parameter" or name in self.free or "*" in self.free):
            value = named.value if named.value is not None else _number(named.definition)
            self.quantities[name] = self.variable(name, named.role, named.unit, value)
            return iter(()), _nothing
        self.quantities[name] = number = self.variable(name, "computed", named.unit)
        definition = named.definition
        assert definition is not None
        return iter(definition.arguments), lambda: self.apply(number, definition, named.span, name)

    def _integral(self, integral: Integral) -> _Row:
        """Add a signal with memory as a state. It gets its variable before its rate is read, as it may depend on itself."""
        unit = self.graph.quantities[integral.name].unit
        self.quantities[integral.name] = variable = self.variable(integral.name, "state", unit)
        rate = self.variable(f"rate of {integral.name}", "computed")

        def finish() -> None:
            self.apply(rate, integral.rate, integral.span, integral.name)
            self.state(variable, rate, self.folded(integral.start), integral.name, integral.span)

        return iter(integral.rate.arguments), finish

    def _delay(self, delay: Delay) -> _Row:
        """Add a delayed signal. It gets its variable before its argument is read, as the argument may depend on it."""
        unit = self.graph.quantities[delay.name].unit
        self.quantities[delay.name] = variable = self.variable(delay.name, "delayed", unit)
        value = self.variable(f"what {delay.name} will be", "computed", unit)

        def finish() -> None:
            self.apply(value, delay.value, delay.span, delay.name)
            lag = self.static(self.folded(delay.lag), f"lag of {delay.name}", delay.span)
            self.delays.append(Delayed(variable, value, lag, delay.span))

        return iter(delay.value.arguments), finish

    def _discrete(self, named: Named) -> _Row:
        """Add a discrete variable. Its definition is its start."""
        self.quantities[named.name] = variable = self.variable(named.name, "mode", named.unit)
        definition = named.definition
        assert definition is not None

        def finish() -> None:
            start = self.static(self.folded(definition), f"{named.name} at the start", named.span)
            self.discretes.append(Discrete(variable, start))

        return iter(definition.arguments), finish

    def reading(self, reading: Reading) -> int:
        """Variable of a reading at a node's port."""
        found = self.readings.get(reading)
        if found is not None:
            return found
        through = self.graph.walls.get((reading.node, reading.port))
        if through is not None:  # of the bond that passes through a port of a model
            return (self.efforts if reading.variable == "e" else self.flows)[through]
        number = self._node_numbers.get(reading.node, -1)
        if number < 0:  # a transducer of many ports: each is a junction, and its first bond is the one outside
            number = self._node_numbers[f"{reading.node}.{reading.port}"]
        node = self.graph.nodes[number]
        if isinstance(node, Junction):
            variable = self._at_junction(number, node, reading)
        else:
            port = next(i for i, p in enumerate(node.ports) if p.name == reading.port)
            bond = self.bond_of[BondEnd(number, port)]
            if reading.variable in "ef":
                variable = (self.efforts if reading.variable == "e" else self.flows)[bond]
            else:  # a storage: made here, filled when its turn comes
                unit = unit_of(node.ports[port].domain, reading.variable)
                variable = self.variable(port_name(node, port, reading.variable), "computed", unit)
        self.readings[reading] = variable
        return variable

    def _at_junction(self, number: int, node: Junction, reading: Reading) -> int:
        """Variable of the first bond of a junction. Without bonds, which may all be zero and removed: an error."""
        bonds = self.graph.incident[number]
        if bonds:
            return (self.efforts if reading.variable == "e" else self.flows)[bonds[0]]
        kind = "effort" if reading.variable == "e" else "flow"
        self.diagnostics.append(NothingLeft(node.span, node.name, kind))
        return self.variable(f"{node.name}.{reading.variable}", "computed", "1")

    def _output(self, name: str, definition: Bound | None, unit: str, span: Span) -> int:
        if name in self.quantities:
            return self.quantities[name]
        argument = self.quantity(name) if name in self.graph.quantities else None
        if isinstance(argument, int):
            return argument
        variable = self.variable(name, "computed", unit)
        if definition is None:
            definition = Bound(Formula(0, ZERO), ())  # a quantity known to be zero
        self.apply(variable, definition, span, name)
        return variable

    # ------------------------------------------------------------ nodes
    def static(self, expression: Expression, name: str, span: Span) -> Argument:
        """A number, or a variable with the value of an expression of parameters."""
        if isinstance(expression, Number):
            return expression.value
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        variable = self.variable(name, "computed")
        self.assign(variable, expression, span, name)
        return variable

    def integral(self, flow: int) -> int | None:
        """Variable whose rate is the given flow, from the coordinates of a mechanism; None if there is none."""
        flow = self.root(flow)
        rows = [] if flow in self._integrals else [(flow, self._moving(flow))]
        while rows:  # not by recursion: a row of transformers may be longer than Python nests calls
            current, waiting = rows[-1]
            while waiting and self._integrals.get(waiting[-1]) is not None:
                waiting.pop()
            if waiting and waiting[-1] not in self._integrals:
                rows.append((waiting[-1], self._moving(waiting[-1])))
                continue
            rows.pop()
            if not waiting and self._explicit(current) is not None:
                self._integrals[current] = self._linear_integral(current)
        return self._integrals[flow]

    def _moving(self, flow: int) -> list[int]:
        """Varying variables that a flow is computed from, last first. The flow is entered without integral until one is found."""
        self._integrals[flow] = None
        assignment = self._explicit(flow)
        read = [] if assignment is None else [self.root(v) for v in _read_by(assignment)]
        return [v for v in reversed(read) if not self._is_static(v)]

    def _explicit(self, variable: int) -> Assignment | None:
        assignment = self.assigned.get(variable)
        return None if assignment is None or assignment.implicit else assignment

    def knows_integral(self, flow: int, displacement: int) -> None:
        """Record that the rate of a displacement (zero in the drawing) is this flow."""
        self._integrals[flow] = displacement

    def _linear_integral(self, flow: int) -> int | None:
        """Integral of a flow that is a sum of integrable flows with constant factors: the same sum over their integrals."""
        assignment = self.assigned[flow]
        moving = [s for s in symbols(assignment.expression) if not self._is_static(s.key)]
        slopes = jointly_affine(assignment.expression, moving)
        if slopes is None or slopes[1] != ZERO:
            return None
        integrals = [self._integrals[self.root(symbol.key)] for symbol in moving]
        parts = [multiply(slope, Symbol(integral)) for slope, integral in zip(slopes[0], integrals, strict=True)]
        variable = self.variable(f"{self.variables[flow].name} integrated", "computed")
        self.assign(variable, add(*parts), assignment.span, assignment.owner)
        return variable

    def _is_static(self, variable: int) -> bool:
        """Return True for a variable computed from parameters alone."""
        waiting, seen = [variable], set[int]()
        while waiting:
            variable = self.root(waiting.pop())
            if variable in seen or self.variables[variable].role == "parameter":
                continue
            seen.add(variable)
            assignment = self._explicit(variable)
            if assignment is None or variable in self._bond_variables:
                return False
            waiting += assignment.read
        return True

    def held(self, expression: Expression, name: str, unit: str, span: Span) -> int:
        """Variable with the value of an expression: the expression itself, if it is one (it gets this unit if it has none), or a new one."""
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            old = self.variables[expression.key]
            if unit and not old.unit:
                self.variables[expression.key] = replace(old, unit=unit)
            return expression.key
        variable = self.variable(name, "computed", unit)
        self.assign(variable, expression, span, name)
        return variable

    def _resolved(self) -> list[Assignment]:
        """Assignments with aliases replaced by the variables that they are equal to. Replaces them in everything else too."""
        root, through = self.root, self._through
        self.states = [
            replace(
                s, variable=root(s.variable), rate=root(s.rate), start=through(s.start),
                nominal=None if s.nominal is None else through(s.nominal),
                conjugate=None if s.conjugate is None else root(s.conjugate), drawn=None if s.drawn is None else through(s.drawn),
            )
            for s in self.states
        ]  # fmt: skip
        self.claims = [replace(c, variable=root(c.variable), start=through(c.start)) for c in self.claims]
        self.invariants = [
            replace(
                i,
                position=None if i.position is None else root(i.position),
                velocity=None if i.velocity is None else root(i.velocity),
            )
            for i in self.invariants
        ]
        self.derivatives = [
            replace(
                d, target=root(d.target), of=root(d.of), conjugate=None if d.conjugate is None else root(d.conjugate)
            )
            for d in self.derivatives
        ]
        self.ports = [PowerPort(p.element, p.kind, root(p.effort), root(p.flow), p.sign) for p in self.ports]
        self.storages = [
            replace(s, stored=tuple(map(root, s.stored)), arguments=tuple(map(through, s.arguments)))
            for s in self.storages
        ]
        self.stored = {n: root(v) for n, v in self.stored.items()}
        return [
            Assignment(
                a.target, a.formula, tuple(map(through, a.arguments)), a.span, a.owner, a.implicit,
                None if a.residual is None else Bound(a.residual.formula, tuple(map(through, a.residual.arguments))),
            )
            for a in self.assignments
        ]  # fmt: skip

    def _through(self, argument: Argument) -> Argument:
        return argument if isinstance(argument, float) else self.root(argument)


def _read_by(assignment: Assignment) -> list[int]:
    """Variables that an assignment reads. A number among its arguments may be zero and remove others."""
    if any(isinstance(a, float) for a in assignment.arguments):
        return [s.key for s in symbols(assignment.expression)]
    return list(dict.fromkeys(a for a in assignment.arguments if not isinstance(a, float)))


def _number(definition: Bound | None) -> float | None:
    if definition is not None and isinstance(definition.formula.expression, Number):
        return definition.formula.expression.value
    return None


def _nothing() -> None:
    """No action, for a quantity without definition."""
