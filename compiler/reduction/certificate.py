"""State space to certificate: what kind of equations came out, told before anything is run.

Nothing here changes a number. Names appear as the author wrote them and in the order of the text; all else (form, index,
counts, linear or not) does not depend on the order of declarations, but for the sizes of loops: where they are cut is a greedy
choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ..algebra.affine import affine_parts
from ..algebra.expression import Expression, Symbol, depends_on, symbols
from ..equations.system import Assignment, EquationSystem
from .state_space import LinearLoop, StateSpace

SCHEMA = "bondgraph-certificate/1"
SPEEDS = ("m/s", "1/s")
LISTED = 12  # names on one line of text


@dataclass(frozen=True, slots=True)
class Loop:
    """An algebraic loop: how many unknowns are solved for together, and the elements and junctions in it."""

    linear: bool  # solved where it stands; else by Newton's method, together with the step of the run
    size: int
    members: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a compilation gave.

    `form` is what a run solves: `explicit ODE`; `linear-implicit ODE` (linear loops, or dependent storages that share the
    rates: solved in every evaluation); `index-1 DAE` (with unknowns of nonlinear loops); `algebraic` without any state.
    `index` is that of the equations as written: 0 explicit, 1 with loops, from 2 on with storages in derivative form.
    """

    model: str
    form: str
    index: int
    states: tuple[str, ...]
    dependent: tuple[str, ...]  # storages in derivative form: they follow from the states
    loops: tuple[Loop, ...]
    linear: bool  # affine in states and unknowns, for given time and inputs
    time_varying: bool  # whether coefficients change with time or inputs
    driven: bool  # whether time or inputs come in at all; else the equations are autonomous
    left_out: tuple[str, ...]  # elements and junctions that give nothing
    unneeded: tuple[str, ...]  # states behind no requested output
    degrees_of_freedom: int  # states that are momenta, or speeds of a mechanism: independent flows
    notes: tuple[str, ...]  # laws that do what one may not expect, such as a resistor that creates energy

    @property
    def reduced(self) -> bool:
        """Whether derivatives had to be formed to get here."""
        return self.index > 1

    @property
    def line(self) -> str:
        """The certificate in one line."""
        parts = [self.form + (f", reduced from index {self.index}" if self.reduced else "")]
        parts.append(_count(len(self.states), "state"))
        if self.states or self.loops:
            parts.append(("linear" if self.linear else "nonlinear") + (", time-varying" if self.time_varying else ""))
            parts.append("driven" if self.driven else "autonomous")
        if self.dependent:
            parts.append(f"{_count(len(self.dependent), 'storage')} in derivative form")
        for word, linear in (("linear", True), ("nonlinear", False)):
            sizes = sorted(x.size for x in self.loops if x.linear is linear)
            if sizes:
                told = ", ".join(map(str, sizes[:LISTED])) + ", …" * (len(sizes) > LISTED)
                parts.append(f"{_count(len(sizes), f'{word} loop')} ({told} unknown{'s' * (sizes != [1])})")
        return f"{self.model}: {'; '.join(parts)}"

    def __str__(self) -> str:
        lists = (f"  {what}: {_listed(names)}" for what, names in self._lists() if names)
        return "\n".join([self.line, *lists, *(f"  note: {n}" for n in self.notes)])

    def _lists(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        yield f"states, of {_count(self.degrees_of_freedom, 'degree')} of freedom", self.states
        yield "in derivative form", self.dependent
        for loop in self.loops:
            word = "linear" if loop.linear else "nonlinear"
            yield f"{word} loop of {_count(loop.size, 'unknown')} through", loop.members
        yield "left out, as it gives nothing", self.left_out
        yield "left out, as no output needs it", self.unneeded

    def to_json(self) -> dict[str, Any]:
        """For `json.dumps`: `bondgraph-certificate/1`, the fields under their own names."""
        return {
            "schema": SCHEMA, "model": self.model, "form": self.form, "index": self.index, "states": list(self.states),
            "degrees_of_freedom": self.degrees_of_freedom, "dependent": list(self.dependent),
            "loops": [{"linear": x.linear, "size": x.size, "members": list(x.members)} for x in self.loops],
            "linear": self.linear, "time_varying": self.time_varying, "driven": self.driven,
            "left_out": list(self.left_out), "unneeded": list(self.unneeded), "notes": list(self.notes),
        }  # fmt: skip


def certify(
    space: StateSpace, system: EquationSystem, left_out: tuple[str, ...], notes: tuple[str, ...]
) -> Certificate:
    """The certificate of a state space of a system; `left_out` are the nodes that pruning took from the graph, `notes` on its laws."""
    loops = tuple(_loops(space))
    needed = {s.variable for s in space.states}
    dependence = _Dependence(space)
    if not space.states:
        form = "algebraic"
    elif space.unknowns:
        form = "index-1 DAE"
    else:
        form = "linear-implicit ODE" if loops else "explicit ODE"
    return Certificate(
        space.name, form, space.index, tuple(space.variables[s.variable].name for s in space.states), space.dependent, loops,
        dependence.linear, dependence.varying, dependence.driven,
        left_out,
        tuple(system.variables[s.variable].name for s in system.states if s.variable not in needed),
        _degrees_of_freedom(space, system), notes,
    )  # fmt: skip


def _degrees_of_freedom(space: StateSpace, system: EquationSystem) -> int:
    """Momenta are the states whose rate is the effort of an inertia's port; a mechanism's speeds are told by their unit."""
    efforts = {(p.element, p.effort) for p in system.ports if p.kind in ("I", "IC")}
    mechanisms = tuple(f"{name}." for name in system.stored)
    count = 0
    for state in space.states:
        variable = space.variables[state.variable]
        momentum = (variable.name.rpartition(".")[0], state.rate) in efforts
        count += momentum or (variable.unit in SPEEDS and variable.name.startswith(mechanisms))
    return count


def _loops(space: StateSpace) -> Iterator[Loop]:
    for step in space.steps:
        if isinstance(step, LinearLoop):
            yield Loop(True, len(step.targets), step.members)
    sizes: dict[int, int] = {}
    for unknown in space.unknowns:
        sizes[unknown.loop] = sizes.get(unknown.loop, 0) + 1
    members = {u.loop: u.members for u in space.unknowns}
    for loop, size in sizes.items():
        yield Loop(False, size, members[loop])


class _Dependence:
    """How rates and residuals depend on what moves (states and unknowns) and on what is given from outside (time, inputs).

    Step by step: one that is not affine in what moves makes the whole nonlinear, and one whose slopes read what is given
    from outside makes it time-varying. What outputs alone need does not count.
    """

    def __init__(self, space: StateSpace) -> None:
        self.linear, self.varying = True, False
        self.moving = {s.variable for s in space.states} | {u.variable for u in space.unknowns}
        self.given = {i for i, v in enumerate(space.variables) if v.role in ("time", "input")}
        steps = list(_behind_the_rates(space))
        read = {a for step in steps for a in _read(step)} | {s.rate for s in space.states}
        self.driven = bool(read & self.given)
        for step in steps:
            if isinstance(step, LinearLoop):
                self._loop(step)
            else:
                self._assignment(step)

    def _loop(self, loop: LinearLoop) -> None:
        matrix = [e for row in loop.matrix for e in row if isinstance(e, int)]
        self.linear = self.linear and not any(e in self.moving for e in matrix)
        moves = any(e in self.moving for e in (*matrix, *loop.right))
        if moves and any(e in self.given for e in matrix):
            self.varying = True
        self._mark(loop.targets, moves, any(e in self.given for e in (*matrix, *loop.right)))

    def _assignment(self, step: Assignment) -> None:
        moving = frozenset(Symbol(i) for i, a in enumerate(step.arguments) if isinstance(a, int) and a in self.moving)
        given = [Symbol(i) for i, a in enumerate(step.arguments) if isinstance(a, int) and a in self.given]
        if moving:
            slopes = _slopes(step.formula.expression, moving)
            if slopes is None:
                self.linear = False
                self.varying = self.varying or bool(given)
            elif any(depends_on(slope, symbol) for slope in slopes for symbol in given):
                self.varying = True
        self._mark((step.target,), bool(moving), bool(given))

    def _mark(self, targets: Iterable[int], moves: bool, given: bool) -> None:
        if moves:
            self.moving.update(targets)
        elif given:
            self.given.update(targets)


@lru_cache(maxsize=4096)
def _slopes(x: Expression, moving: frozenset[Symbol]) -> list[Expression] | None:
    """The slopes of an expression over what moves; None if it is not affine in it together."""
    slopes = []
    rest = x
    inside = [s for s in symbols(x) if s in moving]
    for symbol in inside:
        parts = affine_parts(rest, symbol)
        if parts is None or any(depends_on(parts[0], other) for other in inside):
            return None
        slopes.append(parts[0])
        rest = parts[1]
    return slopes


def _behind_the_rates(space: StateSpace) -> Iterator[Assignment | LinearLoop]:
    """The steps that rates and residuals need, in order."""
    needed = {s.rate for s in space.states} | {u.residual for u in space.unknowns}
    if not space.states and not space.unknowns:
        needed.update(space.outputs.values())
    kept = []
    for step in reversed(space.steps):
        targets = step.targets if isinstance(step, LinearLoop) else (step.target,)
        if needed.intersection(targets):
            kept.append(step)
            needed |= _read(step)
    return reversed(kept)


def _read(step: Assignment | LinearLoop) -> set[int]:
    entries = (
        (*(e for row in step.matrix for e in row), *step.right) if isinstance(step, LinearLoop) else step.arguments
    )
    return {e for e in entries if isinstance(e, int)}


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'s' * (number != 1)}"


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
