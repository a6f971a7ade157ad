"""Causal graph to equations: each stroke says which side computes, each node contributes its assignments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..algebra.affine import affine_parts
from ..algebra.expression import (
    ZERO,
    Expression,
    Number,
    Symbol,
    add,
    depends_on,
    divide,
    evaluate,
    multiply,
    substitute,
    symbols,
)
from ..algebra.formula import Bound, Formula, bind
from ..algebra.invert import obstacle
from ..causality import CausalGraph
from ..errors import CompilationFailed, Diagnostic
from ..graph.network import (
    STORAGES,
    TIME,
    Element,
    End,
    Integral,
    Junction,
    Kind,
    Law,
    MechanismNode,
    Own,
    Quantity,
    Reading,
    Reference,
    Requirement,
)
from ..graph.prune import adjustable
from ..multibody import Motion, mechanism_equations
from ..source import Span
from .errors import DerivativeField, NotInvertible, StartOfDependent, Undetermined
from .laws import ratio, solved
from .naming import bond_names, letter_of, port_name, unit_of
from .system import Argument, Assignment, Derivative, EquationSystem, PowerPort, State, Storage, Validity, Variable

GIVEN = {"q": "e", "p": "f"}  # stored -> what the law gives in integral form; the other one is integrated
INTEGRATED = {"q": "f", "p": "e"}


def derive_equations(causal: CausalGraph, zeros: frozenset[str], free: frozenset[str]) -> EquationSystem:
    """The assignments of all nodes. Raises `CompilationFailed` where a law does not hold in the direction asked for."""
    builder = EquationBuilder(causal, zeros, free)
    return builder.build()


class EquationBuilder:
    """Collects variables and assignments; `multibody` adds a mechanism's through the same three methods."""

    def __init__(self, causal: CausalGraph, zeros: frozenset[str], free: frozenset[str]) -> None:
        self.causal, self.graph, self.zeros, self.free = causal, causal.graph, zeros, free
        self.variables: list[Variable] = []
        self.assignments: list[Assignment] = []
        self.assigned: dict[int, Assignment] = {}
        self.derivatives: list[Derivative] = []
        self.states: list[State] = []
        self.ports: list[PowerPort] = []
        self.storages: list[Storage] = []
        self.stored: dict[str, int] = {}
        self.diagnostics: list[Diagnostic] = []
        self.alias: dict[int, int] = {}
        self.quantities: dict[str, int] = {}
        self.readings: dict[Reading, int] = {}
        self.formulas: dict[tuple[Law, tuple[Own, ...]], tuple[Bound, ...]] = {}
        self.bond_of = {end: n for n, b in enumerate(self.graph.bonds) for end in (b.tail, b.head)}
        self.efforts: list[int] = []
        self.flows: list[int] = []
        self._integrals: dict[int, int | None] = {}
        self._node_numbers = {node.name: number for number, node in enumerate(self.graph.nodes)}
        self._bond_variables: set[int] = set()

    def build(self) -> EquationSystem:
        for number in range(len(self.graph.bonds)):
            names = bond_names(self.graph, number)
            self.efforts.append(self.variable(names[0], "computed", names[2]))
            self.flows.append(self.variable(names[1], "computed", names[3]))
        self._bond_variables = {*self.efforts, *self.flows}
        for number, node in enumerate(self.graph.nodes):
            match node:
                case Junction():
                    self._junction(number, node)
                case MechanismNode():
                    self._mechanism(number, node)
                case Element(kind=(Kind.TRANSFORMER | Kind.GYRATOR)):
                    self._transducer(number, node)
                case Element():
                    pass
        for number, node in enumerate(self.graph.nodes):
            if isinstance(node, Element) and node.kind not in (Kind.TRANSFORMER, Kind.GYRATOR):
                self._element(number, node)
        outputs = {
            name: self._output(named.name, named.definition, named.unit, named.span)
            for name, named in self.graph.outputs.items()
        }
        limits = [self._limit(requirement) for requirement in self.graph.requirements]
        if self.diagnostics:
            raise CompilationFailed(self.diagnostics)
        return EquationSystem(
            self.graph.name, tuple(self.variables), tuple(self._resolved()), tuple(self.derivatives), tuple(self.states),
            {n: self.root(v) for n, v in outputs.items()}, {n: self.root(v) for n, v in self.quantities.items()},
            tuple(self.ports), tuple(self.storages), self.stored, tuple(map(self._resolved_limit, limits)),
        )  # fmt: skip

    # ------------------------------------------------------------ what rooms write with
    def variable(self, name: str, role: str, unit: str = "", value: float | None = None) -> int:
        """A new variable; returns its number."""
        self.variables.append(Variable(name, role, unit, value))
        return len(self.variables) - 1

    def assign(self, target: int, expression: Expression, span: Span, owner: str) -> None:
        """`target := expression` (over variable numbers); a plain copy becomes another name of the same variable."""
        if isinstance(expression, Symbol) and self._same_unit(target, expression.key):
            self._join(target, expression.key, span, owner)
            return
        bound = bind(expression)
        self._add(Assignment(target, bound.formula, tuple(bound.arguments), span, owner))

    def apply(self, target: int, bound: Bound, span: Span, owner: str) -> None:
        """`target := formula(references)`, for what the text bound."""
        arguments = tuple(self.reference(a) for a in bound.arguments)
        expression = bound.formula.expression
        if isinstance(expression, Symbol) and isinstance(arguments[0], int) and self._same_unit(target, arguments[0]):
            self._join(target, arguments[0], span, owner)
            return
        self._add(Assignment(target, bound.formula, arguments, span, owner))

    def _join(self, target: int, source: int, span: Span, owner: str) -> None:
        """Two names for one variable; if they already were, nothing decides it."""
        if self.root(target) == self.root(source):
            self.diagnostics.append(Undetermined(span, owner, self.variables[target].name))
            return
        self.alias[target] = source

    def _same_unit(self, target: int, source: int) -> bool:
        """Whether one name can serve both: u = 1 ohm*i has equal numbers in different units."""
        units = {self.variables[target].unit, self.variables[source].unit}
        return len(units - {""}) < 2

    def _add(self, assignment: Assignment) -> None:
        self.assignments.append(assignment)
        self.assigned[assignment.target] = assignment

    def state(self, variable: int, rate: int, start: Expression, name: str, span: Span) -> None:
        """A state with its rate, and its start as an expression of parameters."""
        self.states.append(State(variable, rate, self._static(start, f"{name} at the start", span), None, span))

    def folded(self, bound: Bound) -> Expression:
        """What the text bound, over variable numbers, with known zeros put in."""

        def put(symbol: Symbol) -> Expression:
            argument = self.reference(bound.arguments[symbol.key])
            return Number(argument) if isinstance(argument, float) else Symbol(argument)

        return substitute(bound.formula.expression, put)

    def root(self, variable: int) -> int:
        """The variable that an alias stands for."""
        while variable in self.alias:
            variable = self.alias[variable]
        return variable

    # ------------------------------------------------------------ references
    def reference(self, reference: Reference) -> Argument:
        """The variable (or number) that a reference of the text stands for."""
        if isinstance(reference, float):
            return reference
        if isinstance(reference, Quantity):
            return self.quantity(reference.name)
        return self.reading(reference)

    def quantity(self, name: str) -> Argument:
        """The variable of a named quantity, with its definition on first use."""
        if name in self.quantities:
            return self.quantities[name]
        if name in self.zeros:
            return 0.0
        if name == TIME.name and name not in self.graph.quantities:
            self.quantities[name] = self.variable("time", "time", "s")
            return self.quantities[name]
        if name in self.graph.integrals:
            return self._integral(self.graph.integrals[name])
        named = self.graph.quantities[name]
        if adjustable(named) and (named.role == "parameter" or name in self.free or "*" in self.free):
            value = named.value if named.value is not None else _number(named.definition)
            self.quantities[name] = self.variable(name, named.role, named.unit, value)
            return self.quantities[name]
        self.quantities[name] = number = self.variable(name, "computed", named.unit)
        assert named.definition is not None
        self.apply(number, named.definition, named.span, name)
        return number

    def _integral(self, integral: Integral) -> int:
        """A signal with memory is a state. It may depend on itself: it is known before its rate is read."""
        unit = self.graph.quantities[integral.name].unit
        self.quantities[integral.name] = variable = self.variable(integral.name, "state", unit)
        rate = self.variable(f"rate of {integral.name}", "computed")
        self.apply(rate, integral.rate, integral.span, integral.name)
        self.state(variable, rate, self.folded(integral.start), integral.name, integral.span)
        return variable

    def reading(self, reading: Reading) -> int:
        """The variable that a reading of a node's port stands for."""
        found = self.readings.get(reading)
        if found is not None:
            return found
        number = self._node_numbers[reading.node]
        node = self.graph.nodes[number]
        if isinstance(node, Junction):
            bond = self.graph.incident[number][0]
            variable = self.flows[bond] if node.kind is Kind.ONE else self.efforts[bond]
        else:
            port = next(i for i, p in enumerate(node.ports) if p.name == reading.port)
            bond = self.bond_of[End(number, port)]
            if reading.variable in "ef":
                variable = (self.efforts if reading.variable == "e" else self.flows)[bond]
            else:  # a storage: made here, filled when its turn comes
                unit = unit_of(node.ports[port].domain, reading.variable)
                variable = self.variable(port_name(node, port, reading.variable), "computed", unit)
        self.readings[reading] = variable
        return variable

    def _output(self, name: str, definition: Bound | None, unit: str, span: Span) -> int:
        if name in self.quantities:
            return self.quantities[name]
        argument = self.quantity(name) if name in self.graph.quantities else None
        if isinstance(argument, int):
            return argument
        variable = self.variable(name, "computed", unit)
        if definition is None:
            definition = Bound(Formula(0, ZERO), ())  # a quantity that is known to be zero
        self.apply(variable, definition, span, name)
        return variable

    def _limit(self, required: Requirement) -> Validity:
        """A condition as a variable that is 1 where it holds."""
        condition = self.variable(f"{required.words} of {required.name}".removesuffix(" of "), "computed", "1")
        self.apply(condition, required.condition, required.span, required.name)
        values = tuple((words, self.reference(reference), unit) for words, reference, unit in required.readings)
        return Validity(required.name, required.words, required.text, condition, values, required.span, required.stands)

    def _resolved_limit(self, limit: Validity) -> Validity:
        values = tuple((name, self._through(value), unit) for name, value, unit in limit.values)
        return replace(limit, condition=self.root(limit.condition), values=values)

    # ------------------------------------------------------------ nodes
    def _junction(self, number: int, node: Junction) -> None:
        """What all bonds share is one variable; what they split is a sum."""
        zero = node.kind is Kind.ZERO
        shared, split = (self.efforts, self.flows) if zero else (self.flows, self.efforts)
        bonds = self.graph.incident[number]
        # The bond that decides: at a 0 the one whose effort comes from outside, at a 1 the one whose flow does.
        decider = next(b for b in bonds if self.causal.decides_effort(b, number) is not zero)
        for bond in bonds:
            if bond != decider:
                self._join(shared[bond], shared[decider], node.span, node.name)
        sign = {b: 1 if self.graph.bonds[b].head.node == number else -1 for b in bonds}
        terms = [multiply(Number(float(-sign[decider] * sign[b])), Symbol(split[b])) for b in bonds if b != decider]
        self.assign(split[decider], add(*terms), node.span, node.name)

    def _transducer(self, number: int, node: Element) -> None:
        """e1 = n e2, f2 = n f1 for a transformer; e1 = k f2, e2 = k f1 for a gyrator."""
        first, second = (self.bond_of[End(number, p)] for p in (0, 1))
        bound = bind(ratio(node.law, node.kind))
        n = self._instance(bound, node, {})
        transformer = node.kind is Kind.TRANSFORMER
        for here, other in ((first, second), (second, first)):
            source = self.efforts[other] if transformer else self.flows[other]
            if self.causal.decides_effort(here, number):
                forward = here == first or not transformer
                value = multiply(n, Symbol(source)) if forward else divide(Symbol(source), n)
                self.assign(self.efforts[here], value, node.span, node.name)
            else:
                source = self.flows[other] if transformer else self.efforts[other]
                forward = here == second and transformer
                value = multiply(n, Symbol(source)) if forward else divide(Symbol(source), n)
                self.assign(self.flows[here], value, node.span, node.name)

    def _instance(self, bound: Bound, node: Element, own: Mapping[Own, Expression]) -> Expression:
        """A law's expression with this element's variables and arguments put in."""

        def put(symbol: Symbol) -> Expression:
            key = bound.arguments[symbol.key]
            if isinstance(key, Own):
                return own[key]
            argument = self.reference(node.arguments[key])
            return Number(argument) if isinstance(argument, float) else Symbol(argument)

        return substitute(bound.formula.expression, put)

    def _element(self, number: int, node: Element) -> None:
        bonds = [self.bond_of[End(number, p)] for p in range(len(node.ports))]
        for bond in bonds:
            sign = 1 if self.graph.bonds[bond].head.node == number else -1
            self.ports.append(PowerPort(node.name, node.kind.value, self.efforts[bond], self.flows[bond], sign))
        if node.kind in STORAGES:
            self._storage(number, node, bonds)
            return
        decides = [self.causal.decides_effort(b, number) for b in bonds]
        wanted = tuple(Own(p, "e" if d else "f") for p, d in enumerate(decides))
        own = {Own(p, v): (self.efforts if v == "e" else self.flows)[b] for p, b in enumerate(bonds) for v in "ef"}
        self._apply_law(
            node, wanted, own, [self.efforts[b] if d else self.flows[b] for b, d in zip(bonds, decides, strict=True)]
        )

    def _apply_law(self, node: Element, wanted: tuple[Own, ...], own: Mapping[Own, int], targets: list[int]) -> bool:
        """Assign the wanted variables by the element's law, solved once for all elements that share it."""
        key = (node.law, wanted)
        if key not in self.formulas:
            found = solved(node.law, wanted)
            self.formulas[key] = () if found is None else tuple(map(bind, found))
        bounds = self.formulas[key]
        if not bounds:
            self._not_invertible(node, wanted)
            return False
        for bound, target in zip(bounds, targets, strict=True):
            arguments = tuple(
                own[k] if isinstance(k, Own) else self.reference(node.arguments[k]) for k in bound.arguments
            )
            first = arguments[0] if arguments else None
            if (
                isinstance(bound.formula.expression, Symbol)
                and isinstance(first, int)
                and self._same_unit(target, first)
            ):
                self._join(target, first, node.span, node.name)
            else:
                self._add(Assignment(target, bound.formula, arguments, node.span, node.name))
        return True

    def _not_invertible(self, node: Element, wanted: tuple[Own, ...]) -> None:
        words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}
        effort = wanted[0].variable in "ep"
        sides = [side for equation in node.law.equations for side in equation]
        hint = obstacle(sides) or (
            f"Write the law the other way round, say `require = {'flow' if effort else 'effort'}` to see what stands against it, "
            "or put a storage beside it."
        )
        self.diagnostics.append(
            NotInvertible(node.span, node.name, " and ".join(dict.fromkeys(words[w.variable] for w in wanted)), hint)
        )

    # ------------------------------------------------------------ storage
    def _storage(self, number: int, node: Element, bonds: list[int]) -> None:
        ports = range(len(node.ports))
        derivative_ports = [p for p in ports if End(number, p) in self.causal.derivative]
        quantities = [self._stored_variable(node, p) for p in ports]
        variables = {"e": self.efforts, "f": self.flows}
        own = {Own(p, node.stored[p]): quantities[p] for p in ports}
        own |= {
            Own(p, GIVEN[s]): variables[GIVEN[s]][b] for p, (s, b) in enumerate(zip(node.stored, bonds, strict=True))
        }
        rates = [variables[INTEGRATED[s]][b] for s, b in zip(node.stored, bonds, strict=True)]
        if derivative_ports:
            if len(bonds) > 1:
                what = {"q": "displacement", "p": "momentum"}[node.stored[derivative_ports[0]]]
                self.diagnostics.append(
                    DerivativeField(node.span, node.name, node.ports[derivative_ports[0]].name, what)
                )
                return
            if any(not self._is_zero(bound) for _, bound in node.starts.values()):
                self.diagnostics.append(StartOfDependent(node.span, node.name))
            if self._apply_law(node, (Own(0, node.stored[0]),), own, quantities):
                self.derivatives.append(Derivative(rates[0], quantities[0], node.span, node.name))
            return
        wanted = tuple(Own(p, GIVEN[s]) for p, s in enumerate(node.stored))
        if not self._apply_law(node, wanted, own, [own[w] for w in wanted]):
            return
        for port in ports:
            self._state(node, port, quantities[port], rates[port])
        self._energy_of(node, wanted, quantities)

    def _is_zero(self, bound: Bound) -> bool:
        """Whether a start is zero, with the values that its parameters have."""
        definitions = self.graph.quantities
        try:
            values = [a if isinstance(a, float) else definitions[a.name].value for a in bound.arguments]
            known = [v for v in values if v is not None]
            return len(known) == len(values) and evaluate(bound.formula.expression, lambda i: known[i]) == 0.0
        except (ArithmeticError, ValueError):
            return False

    def _stored_variable(self, node: Element, port: int) -> int:
        return self.reading(Reading(node.name, node.ports[port].name, node.stored[port]))

    def _state(self, node: Element, port: int, quantity: int, rate: int) -> None:
        """A state; or, if the geometry already knows the displacement, a sum of coordinates."""
        start = self._start(node, port)
        if node.stored[port] == "q":
            known = self.integral(rate)
            if known is not None:
                offset = Number(start) if isinstance(start, float) else Symbol(start)
                self.assign(quantity, add(Symbol(known), offset), node.span, node.name)
                return
        nominal = self.folded(node.nominals[port][1]) if port in node.nominals else None
        self.variables[quantity] = Variable(self.variables[quantity].name, "state", self.variables[quantity].unit)
        self.states.append(
            State(
                quantity,
                rate,
                start,
                None if nominal is None else self._static(nominal, f"nominal of {node.name}", node.span),
                node.span,
            )
        )

    def _static(self, expression: Expression, name: str, span: Span) -> Argument:
        """A number or variable that holds an expression of parameters."""
        if isinstance(expression, Number):
            return expression.value
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        variable = self.variable(name, "computed")
        self.assign(variable, expression, span, name)
        return variable

    def _start(self, node: Element, port: int) -> Argument:
        """The start of what a port stores; a start given for another variable is taken through the law."""
        if port not in node.starts:
            return 0.0
        variable, bound = node.starts[port]
        stored = node.stored[port]
        given = GIVEN[stored]
        value = self.folded(bound)
        name = f"{port_name(node, port, stored)} at the start"
        if variable == given:
            found = solved(node.law, (Own(port, stored),)) if len(node.ports) == 1 else None
            if found is None:
                self._not_invertible(node, (Own(port, stored),))
                return 0.0
            value = self._instance(bind(found[0]), node, {Own(port, given): value})
        return self._static(value, name, node.span)

    def integral(self, flow: int) -> int | None:
        """A variable whose rate is the given flow, known from coordinates of a mechanism; None if there is none."""
        flow = self.root(flow)
        if flow in self._integrals:
            return self._integrals[flow]
        self._integrals[flow] = None
        assignment = self.assigned.get(flow)
        if assignment is not None:
            self._integrals[flow] = self._linear_integral(flow, assignment)
        return self._integrals[flow]

    def knows_integral(self, flow: int, displacement: int) -> None:
        """A mechanism tells that a displacement (zero in the reference) has this flow as its rate."""
        self._integrals[flow] = displacement

    def _linear_integral(self, flow: int, assignment: Assignment) -> int | None:
        """The same sum over integrals, if the flow is a sum of known flows with constant factors."""
        if not self._integrals:
            return None
        rest = assignment.expression
        parts = []
        moving = [s for s in symbols(rest) if not self._is_static(s.key)]
        for symbol in moving:
            found = affine_parts(rest, symbol)
            inner = self.integral(symbol.key)
            if found is None or inner is None or any(depends_on(found[0], other) for other in moving):
                return None
            parts.append(multiply(found[0], Symbol(inner)))
            rest = found[1]
        if rest != ZERO:
            return None
        variable = self.variable(f"{self.variables[flow].name} integrated", "computed")
        self.assign(variable, add(*parts), assignment.span, assignment.owner)
        return variable

    def _is_static(self, variable: int) -> bool:
        variable = self.root(variable)
        if self.variables[variable].role == "parameter":
            return True
        assignment = self.assigned.get(variable)
        if assignment is None or variable in self._bond_variables:
            return False
        return all(isinstance(a, float) or self._is_static(a) for a in assignment.arguments)

    def _energy_of(self, node: Element, wanted: tuple[Own, ...], quantities: list[int]) -> None:
        slots: dict[object, Symbol] = {Own(p, s): Symbol(p) for p, s in enumerate(node.stored)}
        slots |= {i: Symbol(len(quantities) + i) for i in range(node.law.arity)}

        def put(symbol: Symbol) -> Expression:
            return slots[symbol.key]

        energy = None if node.law.energy is None else substitute(node.law.energy, put)
        laws = () if energy is not None else tuple(substitute(x, put) for x in solved(node.law, wanted) or ())
        arguments = tuple(self.reference(a) for a in node.arguments)
        self.storages.append(Storage(node.name, node.kind.value, tuple(quantities), arguments, energy, laws))

    # ------------------------------------------------------------ mechanisms
    def _mechanism(self, number: int, node: MechanismNode) -> None:
        """Efforts into the mechanism, flows and coordinates out of it."""
        efforts: dict[str, Expression] = {}
        for port_number, port in enumerate(node.ports):
            bond = self.bond_of[End(number, port_number)]
            sign = 1.0 if self.graph.bonds[bond].head.node == number else -1.0
            efforts[port.name] = multiply(Number(sign), Symbol(self.efforts[bond]))
        read = [a for definition in self.graph.definitions() for a in definition.arguments]
        read += [a for n in self.graph.nodes if isinstance(n, Element) for a in n.arguments]
        wanted = {a.port for a in read if isinstance(a, Reading) and a.node == node.name}
        result = mechanism_equations(node.mechanism, efforts, wanted, self)
        if result.diagnostics:  # without its motion nothing that reads it can be written
            raise CompilationFailed([*self.diagnostics, *result.diagnostics])
        for port_number, port in enumerate(node.ports):
            motion = result.motions.get(port.name)
            if motion is None:
                continue
            bond = self.bond_of[End(number, port_number)]
            self.assign(self.flows[bond], motion.flow, node.span, f"{node.name}.{port.name}")
            flow = self.root(self.flows[bond])
            if motion.displacement is not None:
                self.knows_integral(flow, motion.displacement)
        for name, motion in result.motions.items():
            self._readings_of_port(node, name, motion, efforts.get(name, ZERO))
        if result.energy is not None:
            self.stored[node.name] = result.energy

    def _readings_of_port(self, node: MechanismNode, port: str, motion: Motion, effort: Expression) -> None:
        """What expressions may read of a mechanism's port: pose, rate and effort."""
        domain = "rotation" if port.endswith("phi") else "translation"
        full = f"{node.name}.{port}"
        for variable, expression, suffix in (
            ("q", motion.pose, ""),
            ("f", motion.flow, f".{letter_of(domain, 'f')}"),
            ("e", effort, f".{letter_of(domain, 'e')}"),
        ):
            held = self._held(expression, full + suffix, unit_of(domain, variable), node.span)
            self.readings[Reading(node.name, port, variable)] = held

    def _held(self, expression: Expression, name: str, unit: str, span: Span) -> int:
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        variable = self.variable(name, "computed", unit)
        self.assign(variable, expression, span, name)
        return variable

    def _resolved(self) -> list[Assignment]:
        """The assignments with aliases replaced by what they stand for."""
        self.states = [
            State(
                self.root(s.variable),
                self.root(s.rate),
                self._through(s.start),
                None if s.nominal is None else self._through(s.nominal),
                s.span,
            )
            for s in self.states
        ]
        self.derivatives = [Derivative(self.root(d.target), self.root(d.of), d.span, d.owner) for d in self.derivatives]
        self.ports = [PowerPort(p.element, p.kind, self.root(p.effort), self.root(p.flow), p.sign) for p in self.ports]
        self.storages = [
            Storage(
                s.element,
                s.kind,
                tuple(map(self.root, s.stored)),
                tuple(map(self._through, s.arguments)),
                s.energy,
                s.laws,
            )
            for s in self.storages
        ]
        self.stored = {n: self.root(v) for n, v in self.stored.items()}
        return [
            Assignment(a.target, a.formula, tuple(map(self._through, a.arguments)), a.span, a.owner)
            for a in self.assignments
        ]

    def _through(self, argument: Argument) -> Argument:
        return argument if isinstance(argument, float) else self.root(argument)


def _number(definition: Bound | None) -> float | None:
    if definition is not None and isinstance(definition.formula.expression, Number):
        return definition.formula.expression.value
    return None
