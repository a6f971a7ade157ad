"""What joins the elements of a bond graph: rates and efforts as linear combinations of what storages and sources give.

Junctions and transducers are linear in their bonds' variables, whatever modulates them; so is a linear resistor, and one of
one port has the ratio of its effort to its flow at the point. The rows are eliminated one by one, in numbers or in sympy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..door import (
    Assignment,
    Compilation,
    Element,
    Junction,
    Kind,
    PowerPort,
    Symbol,
    affine_parts,
    blocks,
    depends_on,
    derivative,
)
from ..errors import UsageError

Row = dict[int, Any]  # variable -> coefficient
Coefficient = Callable[[Any], Any]  # an expression over variables -> its value, in numbers or sympy
STORAGES = ("C", "I", "IC")


@dataclass(frozen=True, slots=True)
class StoragePort:
    """A port of a storage: its element, the variable stored, its rate, and what the storage gives (the slope of its energy)."""

    element: str
    port: str
    stored: int
    rate: int
    slope: int


@dataclass(frozen=True, slots=True)
class Network:
    """The storages that are states, those that depend on them, sources, resistors, and every variable over what is given."""

    states: tuple[StoragePort, ...]
    dependent: tuple[StoragePort, ...]
    sources: tuple[PowerPort, ...]
    given: tuple[int, ...]  # the variable that each source gives
    resistors: tuple[PowerPort, ...]
    rows: Mapping[int, Row] = field(default_factory=dict)

    def row(self, variable: int) -> Row:
        """A variable over slopes of states, rates of dependent storages and sources."""
        return self.rows.get(variable, {variable: 1})


def network(compilation: Compilation, value: Coefficient, values: Mapping[int, float] | None) -> Network:
    """The structure with its coefficients; `values` at a point, for resistors that are not linear. Raises `UsageError`."""
    _check_supported(compilation)
    system = compilation.equations
    nodes = {node.name: node for node in compilation.graph.nodes}
    states, dependent = _storages(compilation)
    sources = tuple(p for p in system.ports if p.kind in ("Se", "Sf"))
    given = tuple(p.effort if p.kind == "Se" else p.flow for p in sources)
    resistors = tuple(p for p in system.ports if p.kind == "R")
    free = {*(s.slope for s in states), *(d.rate for d in dependent), *given}
    power = {v for p in system.ports for v in (p.effort, p.flow)}
    structural = [a for a in system.assignments if isinstance(nodes.get(a.owner), Junction) or _is_transducer(nodes, a)]
    power |= {a.target for a in structural}
    rows: dict[int, Row] = {}
    for assignment in structural:
        if assignment.target not in free:
            rows[assignment.target] = _linear(assignment, power, value)
    own: dict[str, list[PowerPort]] = {}
    for port in resistors:
        own.setdefault(port.element, []).append(port)
    for assignment in system.assignments:
        if assignment.owner in own and assignment.target in power and assignment.target not in free:
            ports = own[assignment.owner]
            if assignment.target in {v for p in ports for v in (p.effort, p.flow)}:
                rows[assignment.target] = _resistive(assignment, ports, value, values)
    return Network(states, dependent, sources, given, resistors, _eliminated(rows))


def _is_transducer(nodes: Mapping[str, Any], assignment: Assignment) -> bool:
    node = nodes.get(assignment.owner)
    return isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR)


def _check_supported(compilation: Compilation) -> None:
    for node in compilation.graph.nodes:
        if node.kind is Kind.MECHANISM:
            raise UsageError(
                f"`{node.name}` is a mechanism: its states are coordinates and speeds, not momenta, so that its port-Hamiltonian form "
                "is not made; write it with C, I and transformers"
            )
    for name in compilation.equations.stored:
        raise UsageError(f"`{name}` stores energy in a form of its own: its port-Hamiltonian form is not made")


def _storages(compilation: Compilation) -> tuple[tuple[StoragePort, ...], tuple[StoragePort, ...]]:
    """Ports in integral form, in the order of the states, and those in derivative form."""
    system = compilation.equations
    ports: dict[str, list[PowerPort]] = {}
    for port in system.ports:
        ports.setdefault(port.element, []).append(port)
    rates = {(s.rate, s.variable) for s in system.states}
    derivatives = {(d.target, d.of) for d in system.derivatives}
    found: dict[int, StoragePort] = {}
    dependent = []
    for storage in system.storages:
        node = next(n for n in compilation.graph.nodes if n.name == storage.element)
        assert isinstance(node, Element)
        for number, (port, stored) in enumerate(zip(ports[storage.element], storage.stored, strict=True)):
            rate, slope = (port.flow, port.effort) if node.stored[number] == "q" else (port.effort, port.flow)
            item = StoragePort(storage.element, node.ports[number].name, stored, rate, slope)
            if (rate, stored) in rates:
                found[stored] = item
            elif (rate, stored) in derivatives:
                dependent.append(item)
            else:
                raise UsageError(
                    f"`{storage.element}` reads what it stores from elsewhere: no port-Hamiltonian form is made"
                )
    unknown = {p.element for p in system.ports if p.kind in STORAGES} - {s.element for s in system.storages}
    if unknown:
        raise UsageError(f"the law of `{min(unknown)}` gives no slope of an energy: no port-Hamiltonian form is made")
    return tuple(found[s.variable] for s in system.states if s.variable in found), tuple(dependent)


def _linear(assignment: Assignment, power: set[int], value: Coefficient) -> Row:
    """A junction's sum, or a transducer's product: what modulates it is no variable of its bonds."""
    parts = _joint(assignment, [v for v in assignment.arguments if isinstance(v, int) and v in power])
    if parts is None:  # a product with something that is a variable of some bond too
        raise UsageError(
            f"`{assignment.owner}` is modulated by the effort or flow of another bond: no port-Hamiltonian form is made"
        )
    return {v: value(x) for v, x in parts.items()}


def _joint(assignment: Assignment, inputs: list[int]) -> dict[int, Any] | None:
    """The slopes over some variables of an expression that is linear in them together, without a rest; else None."""
    rest = assignment.expression
    slopes: dict[int, Any] = {}
    for variable in dict.fromkeys(inputs):
        parts = affine_parts(rest, Symbol(variable))
        if parts is None:
            return None
        slopes[variable], rest = parts
    if getattr(rest, "value", None) != 0.0:
        return None
    if any(depends_on(s, Symbol(v)) for s in slopes.values() for v in inputs):
        return None
    return slopes


def _resistive(
    assignment: Assignment, ports: list[PowerPort], value: Coefficient, values: Mapping[int, float] | None
) -> Row:  # fmt: skip
    """A resistor: linear in its own variables, or with the ratio that effort and flow have at the point."""
    name, target = assignment.owner, assignment.target
    own = {v for p in ports for v in (p.effort, p.flow)} - {target}
    inputs = [v for v in assignment.arguments if isinstance(v, int) and v in own]
    linear = None if assignment.implicit else _joint(assignment, inputs)
    if linear is not None:
        return {v: value(x) for v, x in linear.items()}
    if values is None:
        raise UsageError(f"the law of `{name}` is not linear: there is no form in symbols, but one at each state")
    if len(ports) > 1:
        raise UsageError(f"`{name}` has several ports and its law is not linear: no port-Hamiltonian form is made")
    (other,) = own
    if values[other] == 0.0:
        if values[target] != 0.0:
            raise UsageError(
                f"`{name}` gives something without being given anything: it is a source as well, no port-Hamiltonian form is made"
            )
        return {other: _slope_at_rest(assignment, target, other, value)}
    return {other: values[target] / values[other]}


def _slope_at_rest(assignment: Assignment, target: int, other: int, value: Coefficient) -> Any:
    slope = value(derivative(assignment.expression, Symbol(other)))
    return -slope / value(derivative(assignment.expression, Symbol(target))) if assignment.implicit else slope


def _eliminated(rows: dict[int, Row]) -> dict[int, Row]:
    """Each variable over what no row computes: rows are put into each other in order, and loops solved where they close."""
    inputs: list[list[int]] = [[] for _ in range(1 + max(rows, default=-1))]
    for target, row in rows.items():
        inputs[target] = [v for v in row if v in rows]
    for block in blocks(sorted(rows), inputs):
        inside = set(block)
        for target in block:
            for variable in [v for v in rows[target] if v in rows and v not in inside]:
                _put(rows[target], variable, rows[variable])
        _solve(rows, block)
    return rows


def _solve(rows: dict[int, Row], block: list[int]) -> None:
    """A loop, by elimination with the pivot that is best and, among equals, fills in least."""
    users = {v: {t for t in block if v in rows[t]} for v in block}
    left = set(block)
    while left:
        target = min(left, key=lambda v: (_gain(rows[v].get(v, 0)), len(rows[v]) * len(users[v]), v))
        left.remove(target)
        row = rows[target]
        own = row.pop(target, 0)
        if own != 0:
            for variable in row:
                row[variable] = row[variable] / (1 - own)
        for user in users[target] - {target}:
            _put(rows[user], target, row)
            for variable in row:
                if variable in users:
                    users[variable].add(user)


def _put(row: Row, variable: int, known: Row) -> None:
    """Replace a variable in a row by what it is."""
    factor = row.pop(variable)
    for other, coefficient in known.items():
        row[other] = row.get(other, 0) + factor * coefficient


def _gain(own: Any) -> float:
    """How bad it is to divide by 1 - own: nothing for no loop at all."""
    if isinstance(own, int | float):
        return 0.0 if own == 0.0 else 1.0 + 1.0 / max(abs(1.0 - own), 1e-300)
    return 2.0
