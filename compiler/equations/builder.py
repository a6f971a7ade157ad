"""Builder of equations: a collection that gives each quantity and reading of the text its variable, on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..algebra.expression import ZERO, Expression, Number, Symbol
from ..algebra.formula import Bound, Formula, leaf, over
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
from .collection import EquationCollection
from .errors import NothingLeft, SignalOfItself
from .system import Argument, Assignment, Delayed, Discrete, EquationSystem, Validity, bond_names, port_name, unit_of

_Row = tuple[Iterator[Reference], Callable[[], None]]  # references of a quantity, and the action after them


class EquationBuilder(EquationCollection):
    """Collection of the equations of a graph. `derive` adds those of the nodes and `multibody` those of a mechanism."""

    def __init__(self, graph: BondGraph, zeros: frozenset[str], free: frozenset[str]) -> None:
        super().__init__()
        self.graph, self.zeros, self.free = graph, zeros, free
        self.readings: dict[Reading, int] = {}
        self.bond_of = {end: n for n, b in enumerate(self.graph.bonds) for end in (b.tail, b.head)}
        self.efforts: list[int] = []
        self.flows: list[int] = []
        self._node_numbers = {node.name: number for number, node in enumerate(self.graph.nodes)}
        for number in range(len(graph.bonds)):
            names = bond_names(graph, number)
            self.efforts.append(self.variable(names[0], "computed", names[2]))
            self.flows.append(self.variable(names[1], "computed", names[3]))

    def system(self) -> EquationSystem:
        """All collected equations, with one number for each set of aliases."""
        outputs = {
            name: self._output(named.name, named.definition, named.unit, named.span)
            for name, named in self.graph.outputs.items()
        }
        limits = [self._limit(requirement) for requirement in self.graph.requirements]
        return self.resolved(self.graph.name, outputs, limits)

    def _limit(self, required: Requirement) -> Validity:
        """A condition as a variable that is 1 if it holds."""
        condition = self.variable(f"{required.words} of {required.name}".removesuffix(" of "), "computed", "1")
        self.apply(condition, required.condition, required.span, required.name)
        values = tuple((words, self.reference(reference), unit) for words, reference, unit in required.readings)
        return Validity(
            required.name, required.words, required.text, condition, values, required.span, required.stands, required.refuses
        )  # fmt: skip

    def apply(self, target: int, bound: Bound, span: Span, owner: str) -> None:
        """`target := formula(references)`, for a bound expression of the text."""
        arguments = tuple(self.reference(a) for a in bound.arguments)
        expression = bound.formula.expression
        if isinstance(expression, Symbol) and isinstance(arguments[0], int) and self.same_unit(target, arguments[0]):
            if self.root(target) == self.root(arguments[0]):
                self.diagnostics.append(SignalOfItself(span, owner))
            else:
                self.join(target, arguments[0], span, owner)
            return
        self.add(Assignment(target, bound.formula, arguments, span, owner))

    @property
    def switching(self) -> bool:
        """True if junctions of the model switch."""
        return bool(self.graph.switches)

    def folded(self, bound: Bound) -> Expression:
        """A bound expression of the text over variable numbers, with known zeros put in."""
        return over(bound.formula.expression, bound.arguments, lambda a: leaf(self.reference(a)))

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
        if adjustable(named) and (named.role == "parameter" or name in self.free or "*" in self.free):
            value = named.value if named.value is not None else _number(named.definition)
            self.quantities[name] = self.variable(name, named.role, named.unit, value)
            return iter(()), _nothing
        definition, role = named.definition, "mode" if named.role == "mode" else "computed"
        assert definition is not None
        self.quantities[name] = variable = self.variable(name, role, named.unit)
        return iter(definition.arguments), lambda: self._define(variable, named, definition)

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

    def _define(self, variable: int, named: Named, definition: Bound) -> None:
        """Write a definition, after all that it reads: it may read its own variable."""
        name, span = named.name, named.span
        match named.role:
            case "mode":  # a discrete variable is defined by its start
                start = self.static(self.folded(definition), f"{name} at the start", span)
                self.discretes.append(Discrete(variable, start))
            case "rate":  # index reduction writes it as it writes those of storages in derivative form
                of = self.held(self.folded(definition), f"argument of {name}", "", span)
                self.differentiated(variable, of, span, name)
            case "solve":  # the unknown makes its definition zero
                arguments = tuple(self.reference(a) for a in definition.arguments)
                self.add(Assignment(variable, definition.formula, arguments, span, name, True, None, named.guess))
            case _:
                self.apply(variable, definition, span, name)

    def reading(self, reading: Reading) -> int:
        """Variable of a reading at a node's port."""
        found = self.readings.get(reading)
        if found is not None:
            return found
        through = self.graph.walls.get((reading.node, reading.port))
        if through is not None:  # of the bond that passes through a port of a model
            return (self.efforts if reading.variable == "e" else self.flows)[through]
        number = self._node_numbers[reading.node]
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


def _number(definition: Bound | None) -> float | None:
    if definition is not None and isinstance(definition.formula.expression, Number):
        return definition.formula.expression.value
    return None


def _nothing() -> None:
    """No action, for a quantity without definition."""
