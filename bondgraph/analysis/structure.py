"""Coupling of the elements of a bond graph: rates and efforts as linear combinations of the outputs of storages and sources.

Junctions and transducers are linear in their bonds' variables, whatever modulates them; so is a linear resistor. A resistor of one port is
replaced by the ratio of its effort to its flow at the point. The rows are eliminated one by one, in numbers or in sympy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from compiler.api import (
    DOMAINS,
    Assignment,
    Compilation,
    Element,
    Expression,
    Junction,
    Kind,
    Number,
    PowerPort,
    Symbol,
    affine_parts,
    blocks,
    depends_on,
    derivative,
    letters,
    substitute,
)  # fmt: skip

from ..errors import UsageError
from .singular_slopes import jumps, slopes_from_beside

Row = dict[int, Any]  # variable -> coefficient
Coefficient = Callable[[Any], Any]  # an expression over variables -> its value, in numbers or sympy


@dataclass(frozen=True, slots=True)
class StoragePort:
    """Port of a storage: its element, the stored variable, its rate, and its co-energy variable (derivative of the energy)."""

    element: str
    name: str  # name of the stored quantity, as of a state
    stored: int
    rate: int
    slope: int


@dataclass(frozen=True, slots=True)
class Network:
    """Storages in integral form, dependent ones, sources, resistors, and every variable as a combination of their outputs.

    `states` includes displacements that are also known from others' (two springs on one flow): they have the same x'.
    """

    states: tuple[StoragePort, ...]
    dependent: tuple[StoragePort, ...]
    sources: tuple[PowerPort, ...]
    given: tuple[int, ...]  # the variable that each source imposes
    resistors: tuple[PowerPort, ...]
    rows: Mapping[int, Row] = field(default_factory=dict)

    def row(self, variable: int) -> Row:
        """Return a variable as a row over co-energy variables of states, rates of dependent storages and sources."""
        return self.rows.get(variable, {variable: 1})


def network(compilation: Compilation, value: Coefficient, values: Mapping[int, float] | None) -> Network:
    """Return the structure with its coefficients; `values` at a point, for nonlinear resistors. Raises `UsageError`."""
    _check_supported(compilation)
    system = compilation.equations
    states, dependent = _storages(compilation)
    sources = tuple(p for p in system.ports if p.kind in letters("source"))
    given = tuple(p.effort if p.kind == "Se" else p.flow for p in sources)
    resistors = tuple(p for p in system.ports if p.kind in letters("loss"))
    free = {*(s.slope for s in states), *(d.rate for d in dependent), *given}
    on_bonds = set(range(2 * len(compilation.graph.bonds)))  # efforts and flows of bonds are the first variables
    power = on_bonds | {v for p in system.ports for v in (p.effort, p.flow)}
    joining = {
        n.name for n in compilation.graph.nodes if isinstance(n, Junction) or n.kind.value in letters("transducer")
    }
    structural = [a for a in system.assignments if a.owner in joining and a.target in on_bonds]
    rows: dict[int, Row] = {}
    for assignment in structural:
        if assignment.target not in free:
            rows[assignment.target] = _linear(assignment, (power, on_bonds), value)
    own: dict[str, list[PowerPort]] = {}
    for port in resistors:
        own.setdefault(port.element, []).append(port)
    for assignment in system.assignments:
        if assignment.owner in own and assignment.target in power and assignment.target not in free:
            ports = own[assignment.owner]
            if assignment.target in {v for p in ports for v in (p.effort, p.flow)}:
                rows[assignment.target] = _resistive(assignment, ports, value, values)
    return Network(states, dependent, sources, given, resistors, _eliminated(rows))


def _check_supported(compilation: Compilation) -> None:
    for node in compilation.graph.nodes:
        if node.kind is Kind.MECHANISM:
            raise UsageError(
                "BR254", f"`{node.name}` is a mechanism: its states are coordinates and speeds, not momenta, so that its port-Hamiltonian form is not made;",
                "write it with C, I and transformers",
            )  # fmt: skip
    for name in compilation.equations.stored:
        raise UsageError("BR255", f"`{name}` stores energy in a form of its own: its port-Hamiltonian form is not made")


def _storages(compilation: Compilation) -> tuple[tuple[StoragePort, ...], tuple[StoragePort, ...]]:
    """Return the ports in integral form, in the order of the states, and those in derivative form."""
    system = compilation.equations
    ports: dict[str, list[PowerPort]] = {}
    for port in system.ports:
        ports.setdefault(port.element, []).append(port)
    derivatives = {(d.target, d.of) for d in system.derivatives}
    order = {s.variable: i for i, s in enumerate(system.states)}
    nodes = {n.name: n for n in compilation.graph.nodes}
    states: list[StoragePort] = []
    dependent: list[StoragePort] = []
    for storage in system.storages:
        node = nodes[storage.element]
        assert isinstance(node, Element)
        for number, (port, stored) in enumerate(zip(ports[storage.element], storage.stored, strict=True)):
            rate, slope = (port.flow, port.effort) if node.stored[number] == "q" else (port.effort, port.flow)
            name = node.ports[number].name or DOMAINS[node.ports[number].domain].letter(node.stored[number])
            item = StoragePort(storage.element, f"{storage.element}.{name}", stored, rate, slope)
            (dependent if (rate, stored) in derivatives else states).append(item)
    unknown = {p.element for p in system.ports if p.kind in letters("storage")} - {s.element for s in system.storages}
    if unknown:
        raise UsageError(
            "BR256", f"the law of `{min(unknown)}` gives no slope of an energy: no port-Hamiltonian form is made"
        )
    return tuple(sorted(states, key=lambda s: order.get(s.stored, len(order)))), tuple(dependent)


def _linear(assignment: Assignment, tries: tuple[set[int], ...], value: Coefficient) -> Row:
    """Return the row of a junction's sum, or of a transducer's product: its modulus is no variable of its bonds.

    A source's effort may be a parameter that a ratio reads as well: then variables on bonds alone are tried.
    """
    found = (
        _joint(assignment, [v for v in assignment.arguments if isinstance(v, int) and v in power]) for power in tries
    )
    parts = next((p for p in found if p is not None), None)
    if parts is None:  # a product with a factor that is a variable of another bond
        raise UsageError(
            "BR257", f"`{assignment.owner}` is modulated by the effort or flow of another bond: no port-Hamiltonian form is made",
        )  # fmt: skip
    return {v: value(x) for v, x in parts.items()}


def _joint(assignment: Assignment, inputs: list[int]) -> dict[int, Any] | None:
    """Return the derivatives by some variables of an expression that is linear and homogeneous in them; else None."""
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
    """Return the row of a resistor: linear in its own variables, or with the ratio of effort and flow at the point."""
    name, target = assignment.owner, assignment.target
    own = {v for p in ports for v in (p.effort, p.flow)} - {target}
    inputs = [v for v in assignment.arguments if isinstance(v, int) and v in own]
    linear = None if assignment.implicit else _joint(assignment, inputs)
    if linear is not None:
        return {v: value(x) for v, x in linear.items()}
    if values is None:
        raise UsageError(
            "BR258", f"the law of `{name}` is not linear: there is no form in symbols, but one at each state"
        )
    if len(ports) > 1:
        raise UsageError(
            "BR259", f"`{name}` has several ports and its law is not linear: no port-Hamiltonian form is made"
        )
    (other,) = own
    if values[other] == 0.0:
        if values[target] != 0.0:
            raise UsageError(
                "BR260", f"`{name}` gives something without being given anything: it is a source as well, no port-Hamiltonian form is made",
            )  # fmt: skip
        slope = _two_sided(assignment, other, value)
        return {other: -slope / _two_sided(assignment, target, value) if assignment.implicit else slope}
    return {other: values[target] / values[other]}


def _two_sided(assignment: Assignment, variable: int, value: Coefficient) -> float:
    """Return the derivative of a law by a variable that is zero. Raises `UsageError` at a kink or a jump."""
    law, symbol = assignment.expression, Symbol(variable)

    def beside(x: Expression, side: float, distance: float, _: int) -> Any:
        return np.array([value(substitute(x, lambda s: Number(side * distance) if s == symbol else s))])

    slope = derivative(law, symbol)
    (two_sided,), infinite, kinks = slopes_from_beside(partial(beside, slope), np.array([value(slope)]))
    if len(infinite) or len(kinks) or len(jumps(partial(beside, law), np.array([value(law)]))):
        raise UsageError(
            "BR264", f"the law of `{assignment.owner}` has no slope, or one on each side of this state: no port-Hamiltonian form is made"
        )  # fmt: skip
    return float(two_sided)


def _eliminated(rows: dict[int, Row]) -> dict[int, Row]:
    """Return each variable as a row over variables that no row computes: rows are substituted in order, and loops are solved."""
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
    """Solve a loop by elimination with the best pivot and, among equals, the least fill-in."""
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
    """Replace a variable in a row by its own row."""
    factor = row.pop(variable)
    for other, coefficient in known.items():
        row[other] = row.get(other, 0) + factor * coefficient


def _gain(own: object) -> float:
    """Return the cost of a division by 1 - own: zero if there is no loop."""
    if isinstance(own, int | float):
        return 0.0 if own == 0.0 else 1.0 + 1.0 / max(abs(1.0 - own), 1e-300)
    return 2.0
