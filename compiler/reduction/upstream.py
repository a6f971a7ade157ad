"""Part of a model on which some outputs depend: its states, and the ports and storages that are functions of these."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from ..equations.system import EquationSystem
from .order import needed


def upstream(system: EquationSystem, states: Set[int]) -> EquationSystem:
    """Return the equations with these states alone, of which no rate reads another, and with the energies of this part."""
    inputs: list[list[int]] = [[] for _ in system.variables]
    for assignment in system.assignments:
        inputs[assignment.target] = [*assignment.read]
    for derivative in system.derivatives:
        inputs[derivative.target] = [derivative.of]
    behind: set[int] = set()  # all that depends on the other states
    users: dict[int, list[int]] = {}
    for target, sources in enumerate(inputs):
        for source in sources:
            users.setdefault(source, []).append(target)
    read = [users.get(v, []) for v in range(len(inputs))]
    needed([s.variable for s in system.states if s.variable not in states], read, behind)
    return replace(
        system, states=tuple(s for s in system.states if s.variable in states),
        ports=tuple(p for p in system.ports if behind.isdisjoint((p.effort, p.flow))),
        storages=tuple(s for s in system.storages if behind.isdisjoint(s.stored)),
        stored={name: v for name, v in system.stored.items() if v not in behind},
    )  # fmt: skip
