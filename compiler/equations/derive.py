"""Causal graph to equations: each causal stroke determines which side computes; each node contributes its assignments."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from ..algebra.expression import ZERO, Expression, Number, Symbol, add, divide, evaluate, multiply, substitute
from ..algebra.formula import Bound, Formula, bind, leaf, over
from ..algebra.invert import obstacle
from ..causality import CausalGraph
from ..errors import CompilationFailed
from ..graph.domains import DOMAINS
from ..graph.elements import STORAGES, TRANSDUCERS, Kind
from ..graph.mechanism import domain_of
from ..graph.network import BondEnd, Element, Junction, Law, MechanismNode, PortVariable, Quantity, Reading
from ..graph.samples import in_order
from ..multibody import PortMotion, mechanism_equations
from .builder import EquationBuilder
from .errors import NotInvertible
from .events import event_equations
from .fields import is_lost_in_rounding, without_energy
from .integrals import FlowIntegrals
from .laws import GIVEN, paired, ratio, solved, total_residual
from .sharing import share_states
from .storage_jumps import storage_jumps
from .system import (
    Argument,
    Assignment,
    Claim,
    Derivative,
    EquationSystem,
    PowerPort,
    State,
    Storage,
    Variable,
    letter_of,
    port_name,
    unit_of,
)

INTEGRATED = {"q": "f", "p": "e"}  # the variable that a storage integrates

ROUNDED = (
    "Its matrix is singular but for rounding, which would decide the result. Write what is left: two coils with all flux in common are a `TF` and one `I` "
    "on a side of it, two plates one `C` on the `1` between them."
)


def derive_equations(
    causal: CausalGraph, zeros: frozenset[str], free: frozenset[str], apart: frozenset[str] = frozenset()
) -> EquationSystem:
    """Return the assignments of all nodes. The storages `apart` share no state.

    Raises `CompilationFailed` if a law cannot be solved in the direction that causality needs.
    """
    return _Nodes(causal, EquationBuilder(in_order(causal.graph), zeros, free)).equations(apart)


@cache
def _balance(signs: tuple[int, ...]) -> Formula:
    """Formula of a junction's last bond: the sum of the others with these signs. Equal junctions have one formula."""
    return Formula(len(signs), add(*(multiply(Number(float(s)), Symbol(i)) for i, s in enumerate(signs))))


def _energy(law: Law, stored: tuple[str, ...]) -> tuple[Expression | None, tuple[Expression, ...]] | None:
    """An energy, or a law in integral form, over the stored quantities and then the arguments; None if a law has no such form."""
    slots: dict[object, Symbol] = {PortVariable(p, s): Symbol(p) for p, s in enumerate(stored)}
    slots |= {i: Symbol(len(stored) + i) for i in range(law.arity)}

    def put(symbol: Symbol) -> Expression:
        return slots[symbol.key]

    if law.energy is not None:
        return substitute(law.energy, put), ()
    found = solved(law, tuple(PortVariable(p, GIVEN[s]) for p, s in enumerate(stored)))
    return None if found is None else (None, tuple(substitute(x, put) for x in found))


class _Nodes:
    """Traversal of the nodes that writes the assignments of each."""

    def __init__(self, causal: CausalGraph, to: EquationBuilder) -> None:
        self.causal, self.graph, self.to = causal, causal.graph, to
        self.efforts, self.flows, self.bond_of = to.efforts, to.flows, to.bond_of
        self.integrals = FlowIntegrals(to, frozenset((*to.efforts, *to.flows)))
        # For each law once, for any number of elements: its solution in a direction, and its energy.
        self.formulas: dict[
            tuple[Law, tuple[PortVariable, ...], bool], tuple[tuple[Bound, ...], bool, Bound | None]
        ] = {}
        self.energies: dict[tuple[Law, tuple[str, ...]], tuple[Expression | None, tuple[Expression, ...]] | None] = {}
        self.starting: dict[tuple[Law, PortVariable], Bound | None] = {}

    def equations(self, apart: frozenset[str]) -> EquationSystem:
        for number, node in enumerate(self.graph.nodes):
            if isinstance(node, Junction):
                self._junction(number, node)
            elif isinstance(node, MechanismNode):
                self._mechanism(number, node)
        elements = [(n, e) for n, e in enumerate(self.graph.nodes) if isinstance(e, Element)]
        for number, node in elements:  # after the mechanisms, whose poses may modulate them
            if node.kind in TRANSDUCERS:
                self._transducer(number, node)
        for number, node in elements:  # after the nodes that may determine a displacement
            if node.kind not in TRANSDUCERS:
                self._element(number, node)
        event_equations(self.to)
        system = self.to.system()
        if self.to.diagnostics:
            raise CompilationFailed(self.to.diagnostics)
        signals = {self.to.root(v) for name, v in self.to.quantities.items() if name in self.graph.integrals}
        return share_states(system, frozenset(signals), apart)

    def _junction(self, number: int, node: Junction) -> None:
        """Write a junction: one variable for the effort (0) or flow (1) that all bonds share, and a sum for the other."""
        if not self.graph.incident[number]:  # all that hung on it gives nothing
            return
        zero = node.kind is Kind.ZERO
        shared, split = (self.efforts, self.flows) if zero else (self.flows, self.efforts)
        bonds = self.graph.incident[number]
        # The bond that decides: at a 0 the one whose effort comes from outside, at a 1 the one whose flow does.
        decider = next(b for b in bonds if self.causal.decides_effort(b, number) is not zero)
        for bond in bonds:
            if bond != decider:
                self.to.join(shared[bond], shared[decider], node.span, node.name)
        sign = {b: 1 if self.graph.bonds[b].head.node == number else -1 for b in bonds}
        others = [b for b in bonds if b != decider]
        signs = tuple(-sign[decider] * sign[b] for b in others)
        if signs == (1,):
            self.to.assign(split[decider], Symbol(split[others[0]]), node.span, node.name)
            return
        balance = _balance(signs)
        self.to.add(Assignment(split[decider], balance, tuple(split[b] for b in others), node.span, node.name))

    def _transducer(self, number: int, node: Element) -> None:
        """e1 = n e2, f2 = n f1 for a transformer; e1 = k f2, e2 = k f1 for a gyrator."""
        first, second = (self.bond_of[BondEnd(number, p)] for p in (0, 1))
        bound = bind(ratio(node.law, node.kind))
        n = self._instance(bound, node, {})
        transformer = node.kind is Kind.TRANSFORMER
        for here, other in ((first, second), (second, first)):
            source = self.efforts[other] if transformer else self.flows[other]
            if self.causal.decides_effort(here, number):
                forward = here == first or not transformer
                value = multiply(n, Symbol(source)) if forward else divide(Symbol(source), n)
                self.to.assign(self.efforts[here], value, node.span, node.name)
            else:
                source = self.flows[other] if transformer else self.efforts[other]
                forward = here == second and transformer
                value = multiply(n, Symbol(source)) if forward else divide(Symbol(source), n)
                self.to.assign(self.flows[here], value, node.span, node.name)

    def _instance(self, bound: Bound, node: Element, own: Mapping[PortVariable, Expression]) -> Expression:
        """A law's expression with the variables and arguments of this element."""

        def read(key: PortVariable | int) -> Expression:
            return own[key] if isinstance(key, PortVariable) else leaf(self.to.reference(node.arguments[key]))

        return over(bound.formula.expression, bound.arguments, read)

    def _element(self, number: int, node: Element) -> None:
        bonds = [self.bond_of[BondEnd(number, p)] for p in range(len(node.ports))]
        delayed = any(isinstance(a, Quantity) and a.name in self.graph.delays for a in node.arguments)
        for bond, own_port in zip(bonds, node.ports, strict=True):
            sign = 1 if self.graph.bonds[bond].head.node == number else -1
            balanced = DOMAINS[own_port.domain].is_balanced
            port = PowerPort(node.name, node.kind.value, self.efforts[bond], self.flows[bond], sign, delayed, balanced)
            self.to.ports.append(port)
        if node.kind in STORAGES:
            self._storage(number, node, bonds)
            return
        decides = [self.causal.decides_effort(b, number) for b in bonds]
        wanted = tuple(PortVariable(p, "e" if d else "f") for p, d in enumerate(decides))
        own = {
            PortVariable(p, v): (self.efforts if v == "e" else self.flows)[b] for p, b in enumerate(bonds) for v in "ef"
        }
        self._apply_law(
            node, wanted, own, [self.efforts[b] if d else self.flows[b] for b, d in zip(bonds, decides, strict=True)]
        )

    def _apply_law(
        self, node: Element, wanted: tuple[PortVariable, ...], own: Mapping[PortVariable, int], targets: list[int]
    ) -> bool:
        """Assign the wanted variables by the element's law, solved once for all elements that share it.

        A law that cannot be solved for them gives an implicit assignment for each. If the solution is not defined everywhere, the form
        that is gets stored beside it.
        """
        fixed = not node.modulated and not any(self.to.reference(a) == 0.0 for a in node.arguments)
        key = (node.law, wanted, fixed)
        if key not in self.formulas:
            found = solved(node.law, wanted)
            implicit = found is None
            if found is None:
                found = paired(node.law, wanted)
            alone = found is not None and len(wanted) == 1 and not implicit
            total = total_residual(node.law, wanted[0], fixed) if alone else None
            self.formulas[key] = tuple(map(bind, found or ())), implicit, None if total is None else bind(total)
        bounds, implicit, total_form = self.formulas[key]
        is_lost = not implicit and is_lost_in_rounding(node, self.graph, wanted)
        if is_lost or not bounds:
            self._not_decided(node, wanted, ROUNDED * is_lost)
            return False

        def put(keys: tuple[Any, ...]) -> tuple[Argument, ...]:
            return tuple(own[k] if isinstance(k, PortVariable) else self.to.reference(node.arguments[k]) for k in keys)

        residual = None if total_form is None else Bound(total_form.formula, put(total_form.arguments))
        for bound, target in zip(bounds, targets, strict=True):
            arguments = put(bound.arguments)
            first = arguments[0] if arguments else None
            copy = isinstance(bound.formula.expression, Symbol) and not implicit
            if copy and isinstance(first, int) and self.to.same_unit(target, first):
                self.to.join(target, first, node.span, node.name)
            else:
                self.to.add(Assignment(target, bound.formula, arguments, node.span, node.name, implicit, residual))
        return True

    def _not_decided(self, node: Element, wanted: tuple[PortVariable, ...], why: str) -> None:
        words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}
        asked = " and ".join(dict.fromkeys(words[w.variable] for w in wanted))
        effort = wanted[0].variable in "ep"
        sides = [side for equation in node.law.equations for side in equation]
        word = "flow" if effort else "effort"
        hint = (
            why
            or obstacle(sides)
            or f"Say `require = {word}` to see what stands against the other direction, or put a storage beside it."
        )
        self.to.diagnostics.append(NotInvertible(node.span, node.name, asked, hint))

    # ------------------------------------------------------------ storage
    def _storage(self, number: int, node: Element, bonds: list[int]) -> None:
        """Write the ports of a storage.

        In integral form the law gives the effort (or flow), and the stored quantity is a state. In derivative form the law gives the stored
        quantity, and its rate is the flow (or effort).
        """
        problem = without_energy(node, self.graph)
        if problem is not None:
            self.to.diagnostics.append(problem)
            return
        ports = range(len(node.ports))
        quantities = [self.to.reading(Reading(node.name, node.ports[p].name, node.stored[p])) for p in ports]
        variables = {"e": self.efforts, "f": self.flows}
        own = {PortVariable(p, node.stored[p]): quantities[p] for p in ports}
        own |= {
            PortVariable(p, GIVEN[s]): variables[GIVEN[s]][b]
            for p, (s, b) in enumerate(zip(node.stored, bonds, strict=True))
        }
        rates = [variables[INTEGRATED[s]][b] for s, b in zip(node.stored, bonds, strict=True)]
        integral = [BondEnd(number, p) not in self.causal.derivative for p in ports]
        wanted = tuple(PortVariable(p, GIVEN[s] if integral[p] else s) for p, s in enumerate(node.stored))
        if (jump := storage_jumps(node, self.graph, wanted)) is not None:
            self.to.diagnostics.append(jump)
            return
        if not self._apply_law(node, wanted, own, [own[w] for w in wanted]):
            return
        for port in ports:
            if integral[port]:
                self._state(node, port, quantities[port], rates[port], own)
            else:
                conjugate = own[PortVariable(port, GIVEN[node.stored[port]])]
                self.to.derivatives.append(
                    Derivative(rates[port], quantities[port], node.span, node.name, quantities[port], conjugate)
                )
                if port in node.starts and not self._is_zero(node.starts[port][1]):
                    self._claim(node, port, own)
        self._energy_of(node, quantities)

    def _is_zero(self, bound: Bound) -> bool:
        """Return True if a start is zero with the values of its parameters."""
        definitions = self.graph.quantities
        try:
            values = [a if isinstance(a, float) else definitions[a.name].value for a in bound.arguments]
            known = [v for v in values if v is not None]
            return len(known) == len(values) and evaluate(bound.formula.expression, lambda i: known[i]) == 0.0
        except (ArithmeticError, ValueError):
            return False

    def _state(self, node: Element, port: int, quantity: int, rate: int, own: Mapping[PortVariable, int]) -> None:
        """Add a state; if the geometry determines the displacement already, a sum of coordinates instead."""
        start, given = self._start(node, port, own)
        if node.stored[port] == "q" and not self.graph.switches:  # tied now, perhaps free before
            known = self.integrals.integral(rate)
            if known is not None:
                offset = Number(start) if isinstance(start, float) else Symbol(start)
                self.to.assign(quantity, add(Symbol(known), offset), node.span, node.name)
                return
        nominal: Argument | None = None
        if port in node.nominals:
            nominal = self.to.static(self.to.folded(node.nominals[port][1]), f"nominal of {node.name}", node.span)
        variable = self.to.variables[quantity]
        self.to.variables[quantity] = Variable(variable.name, "state", variable.unit)
        conjugate = own[PortVariable(port, GIVEN[node.stored[port]])]
        self.to.states.append(State(quantity, rate, start, nominal, node.span, given, conjugate))

    def _start(self, node: Element, port: int, own: Mapping[PortVariable, int]) -> tuple[Argument, bool]:
        """Start of a port's stored quantity, and True if the author gave it. A zero does not count: it is the default of parts.

        A start of another variable is converted by the law if that can be solved, else it is a claim, by which the other ports of a field do not move.
        """
        beside = any(p != port and node.starts[p][0] != node.stored[p] for p in node.starts)
        if port not in node.starts:
            return 0.0, beside
        variable, bound = node.starts[port]
        stored = node.stored[port]
        value = self.to.folded(bound)
        if variable != stored:
            law = self._stored_by(node, PortVariable(port, stored))
            if law is None:
                self._claim(node, port, own)
                return 0.0, False
            value = self._instance(law, node, {PortVariable(port, GIVEN[stored]): value})
        start = self.to.static(value, f"{port_name(node, port, stored)} at the start", node.span)
        return start, beside or not self._is_zero(bound)

    def _stored_by(self, node: Element, wanted: PortVariable) -> Bound | None:
        """Stored quantity of a one-port storage from its law; None if the law cannot be solved for it."""
        key = node.law, wanted
        if key not in self.starting:
            found = solved(node.law, (wanted,)) if len(node.ports) == 1 else None
            self.starting[key] = None if found is None else bind(found[0])
        return self.starting[key]

    def _claim(self, node: Element, port: int, own: Mapping[PortVariable, int]) -> None:
        """Add a claim for the start of a computed variable: the states then start such that it holds."""
        variable, bound = node.starts[port]
        name = f"{port_name(node, port, variable)} at the start"
        start = self.to.static(self.to.folded(bound), name, node.span)
        self.to.claims.append(Claim(own[PortVariable(port, variable)], start, node.name, node.span))

    def _energy_of(self, node: Element, quantities: list[int]) -> None:
        """Energy of the element, or its law in integral form, over its stored quantities; empty if the law has no such form."""
        key = node.law, node.stored
        if key not in self.energies:
            self.energies[key] = _energy(*key)
        known = self.energies[key]
        if known is not None:
            arguments = tuple(self.to.reference(a) for a in node.arguments)
            self.to.storages.append(Storage(node.name, node.kind.value, tuple(quantities), arguments, *known))

    # ------------------------------------------------------------ mechanisms
    def _mechanism(self, number: int, node: MechanismNode) -> None:
        """Efforts into the mechanism, flows and coordinates out of it."""
        efforts: dict[str, Expression] = {}
        flows: dict[str, Expression] = {}
        signs: dict[str, float] = {}
        for port_number, port in enumerate(node.ports):
            bond = self.bond_of[BondEnd(number, port_number)]
            signs[port.name] = 1.0 if self.graph.bonds[bond].head.node == number else -1.0
            if self.causal.decides_effort(bond, number):
                flows[port.name] = Symbol(self.flows[bond])
            else:
                efforts[port.name] = multiply(Number(signs[port.name]), Symbol(self.efforts[bond]))
        read = [a for definition in self.graph.definitions() for a in definition.arguments]
        read += [a for n in self.graph.nodes if isinstance(n, Element) for a in n.arguments]
        wanted = {a.port for a in read if isinstance(a, Reading) and a.node == node.name}
        targets = [action.target for event in self.graph.events for action in event.actions]
        states = {t.port for t in targets if isinstance(t, Reading) and t.node == node.name}
        if self.graph.switches:  # what is stored before a switching is a state after it too
            states |= {f"{j.name}.{letter}" for j in node.mechanism.joints for letter in j.freedoms}
        result = mechanism_equations(node.mechanism, efforts, flows, wanted, states, self.to)
        if result.diagnostics:  # without its motion nothing that reads it can be written
            raise CompilationFailed([*self.to.diagnostics, *result.diagnostics])
        for port_number, port in enumerate(node.ports):
            motion, bond = result.motions[port.name], self.bond_of[BondEnd(number, port_number)]
            owner = f"{node.name}.{port.name}"
            if port.name in result.efforts:
                effort = multiply(Number(signs[port.name]), result.efforts[port.name])
                self.to.assign(self.efforts[bond], effort, node.span, owner)
            else:
                self.to.assign(self.flows[bond], motion.flow, node.span, owner)
            if motion.displacement is not None:
                self.integrals.know(self.flows[bond], motion.displacement)
        for name, motion in result.motions.items():
            self._readings_of_port(node, name, motion, efforts.get(name, result.efforts.get(name, ZERO)))
        for name, expression in result.readings.items():
            domain = domain_of(name)
            unit = unit_of(domain, "e" if ".reaction." in name else "q")
            held = self.to.held(expression, f"{node.name}.{name}", unit, node.span)
            for variable in "qe":
                self.to.readings[Reading(node.name, name, variable)] = held
        if result.energy is not None:
            self.to.stored[node.name] = result.energy

    def _readings_of_port(self, node: MechanismNode, port: str, motion: PortMotion, effort: Expression) -> None:
        """Add the readings of a mechanism's port: pose, rate and effort."""
        domain = domain_of(port)
        full = f"{node.name}.{port}"
        for variable, expression, suffix in (
            ("q", motion.pose, ""),
            ("f", motion.flow, f".{letter_of(domain, 'f')}"),
            ("e", effort, f".{letter_of(domain, 'e')}"),
        ):
            held = self.to.held(expression, full + suffix, unit_of(domain, variable), node.span)
            self.to.readings[Reading(node.name, port, variable)] = held
