"""State space to certificate: the kind of the resulting equations, reported before a run.

Nothing here changes a number. Names are as the author wrote them and in the order of the text; all other data (form, index,
counts, linear or not) do not depend on the order of declarations, except the sizes of loops, which are cut by a greedy
choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache

from ..algebra.affine import jointly_affine
from ..algebra.expression import Apply, Expression, Symbol, symbols
from ..certificate import Certificate, LoopSummary
from ..equations.system import Assignment, EquationSystem
from .slopes import Slopes, slopes_at_start
from .state_space import LinearLoop, StateSpace, TearingVariable
from .uniqueness import is_unique, parameter_signs

SPEEDS = ("m/s", "1/s")
SMALL = 1e-9  # share of the largest slope of its unit: remainder of dependent rows
LARGEST = 200  # gaps that are looked at


def certify(
    space: StateSpace, system: EquationSystem, left_out: tuple[tuple[str, ...], tuple[str, ...]], notes: tuple[str, ...]
) -> Certificate:
    """Certificate of the state space of a system. `left_out`: nodes that pruning removed from the graph, states that nothing excites; `notes`: on laws."""
    loops = tuple(_loops(space, system))
    needed = {s.variable for s in space.states}
    dependence = _Dependence(space)
    if not space.states:
        form = "algebraic"
    elif any(not u.multiplier for u in space.unknowns):
        form = "index-1 DAE"
    else:
        form = "linear-implicit ODE" if loops or space.unknowns else "explicit ODE"
    bound = sum(i.multiplier is not None for i in space.invariants)
    redundant = redundant_constraints(space) or ()
    return Certificate(
        space.name, form, space.index, tuple(space.variables[s.variable].name for s in space.states), space.dependent, loops,
        dependence.linear, dependence.varying, dependence.driven,
        left_out[0],
        tuple(n for s in system.states if s.variable not in needed and (n := _name(space, s.variable)) not in left_out[1]),
        max(0, _degrees_of_freedom(space, system) - bound + len(redundant)), notes, bound, redundant, tuple(dict.fromkeys(_events(space))),
        tuple(f"{_name(space, f.variable)} follows {_name(space, f.state)}" for f in space.following),
        left_out[1],
    )  # fmt: skip


def _name(space: StateSpace, variable: int) -> str:
    return space.variables[variable].name


def _events(space: StateSpace) -> Iterator[str]:
    """Text of each event, switched junction and delay, with its line."""

    for event in space.events:
        owner = f" of `{event.owner}`" if event.owner else ""
        yield f"{'every' if event.sampling else 'when'} {event.words}{owner} ({event.span.file_and_line})"
    for switch in space.switches:
        yield f"`{switch.junction}` goes on and off ({switch.span.file_and_line})"
    for delay in space.delays:
        yield f"{space.variables[delay.variable].name} ({delay.span.file_and_line})"


def _degrees_of_freedom(space: StateSpace, system: EquationSystem) -> int:
    """Number of momenta and speeds. A momentum is a state whose rate is the effort of an inertia's port; a mechanism's speed has that unit."""
    efforts = {(p.element, p.effort) for p in system.ports if p.kind in ("I", "IC")}
    mechanisms = tuple(f"{name}." for name in system.stored)
    count = 0
    for state in space.states:
        variable = space.variables[state.variable]
        momentum = (variable.name.rpartition(".")[0], state.rate) in efforts
        count += momentum or (variable.unit in SPEEDS and variable.name.startswith(mechanisms))
    return count


def _loops(space: StateSpace, system: EquationSystem) -> Iterator[LoopSummary]:
    if not space.loops:
        return
    signs = parameter_signs(system)

    def unique(variable: int) -> bool:
        return is_unique(space.loops.get(variable, ()), system, signs)

    for step in space.steps:
        if isinstance(step, LinearLoop):
            yield LoopSummary(True, len(step.targets), step.members, unique(step.targets[0]))
    loops: dict[int, list[TearingVariable]] = {}
    for unknown in (u for u in space.unknowns if not u.multiplier):
        loops.setdefault(unknown.loop, []).append(unknown)
    for unknowns in loops.values():
        yield LoopSummary(False, len(unknowns), unknowns[0].members, unique(unknowns[0].variable))


class _Dependence:
    """Dependence of rates and residuals on states and unknowns, and on time and inputs.

    A step that is not affine in states and unknowns makes the whole nonlinear; one whose partial derivatives depend on time or inputs
    makes it time-varying. Steps that only outputs need do not count.
    """

    def __init__(self, space: StateSpace) -> None:
        self.linear, self.varying = True, False
        self.moving = {s.variable for s in space.states} | {u.variable for u in space.unknowns}
        self.given = {i for i, v in enumerate(space.variables) if v.role in ("time", "input")}
        steps = list(_behind_the_rates(space))
        read = {a for step in steps for a in step.read} | {s.rate for s in space.states}
        self.driven = bool(read & self.given)
        for step in steps:
            if isinstance(step, LinearLoop):
                self._loop(step)
            else:
                self._assignment(step)

    def _loop(self, loop: LinearLoop) -> None:
        self.linear = self.linear and not any(e in self.moving for e in loop.gains)
        moves = any(e in self.moving for e in loop.read)
        if moves and any(e in self.given for e in loop.gains):
            self.varying = True
        self._mark(loop.targets, moves, any(e in self.given for e in loop.read))

    def _assignment(self, step: Assignment) -> None:
        moving = frozenset(Symbol(i) for i, a in enumerate(step.arguments) if isinstance(a, int) and a in self.moving)
        given = {Symbol(i) for i, a in enumerate(step.arguments) if isinstance(a, int) and a in self.given}
        if moving:
            slopes = _slopes(step.formula.expression, moving)
            if slopes is None:
                self.linear = False
                self.varying = self.varying or bool(given)
            elif any(symbol in given for slope in slopes for symbol in symbols(slope)):
                self.varying = True
        self._mark((step.target,), bool(moving), bool(given))

    def _mark(self, targets: Iterable[int], moves: bool, given: bool) -> None:
        if moves:
            self.moving.update(targets)
        elif given:
            self.given.update(targets)


@lru_cache(maxsize=65536)
def _slopes(x: Expression, moving: frozenset[Symbol]) -> list[Expression] | None:
    """Partial derivatives of an expression by states and unknowns; None if it is not jointly affine in them."""
    slopes: list[Expression] = []
    if isinstance(x, Apply) and x.operator == "add":  # a junction may have thousands of terms
        for term in x.operands:
            found = _slopes(term, moving)
            if found is None:
                return None
            slopes += found
        return slopes
    parts = jointly_affine(x, [s for s in symbols(x) if s in moving])
    return None if parts is None else parts[0]


def _behind_the_rates(space: StateSpace) -> Iterator[Assignment | LinearLoop]:
    """Steps that rates and residuals need, in order."""
    needed = {s.rate for s in space.states} | {u.residual for u in space.unknowns}
    if not space.states and not space.unknowns:
        needed.update(space.outputs.values())
    kept = []
    for step in reversed(space.steps):
        if needed.intersection(step.targets):
            kept.append(step)
            needed.update(step.read)
    return reversed(kept)


def redundant_constraints(space: StateSpace) -> tuple[str, ...] | None:
    """Constraints that depend on others in the position of the drawing; None if that cannot be computed before a run."""
    bound = [i for i in space.invariants if i.multiplier is not None]
    places = [i.position for i in bound if i.position is not None]  # rows of rates alone come last
    if not 0 < len(bound) <= LARGEST:
        return () if not bound else None
    rows = slopes_at_start(space, places, space.states)
    if rows is None:
        return None
    units = [space.variables[p].unit for p in places]
    for unit in set(units):
        largest = max(
            (abs(x) for row, u in zip(rows, units, strict=True) if u == unit for x in row.values()), default=0.0
        )
        for row, u in zip(rows, units, strict=True):
            if u == unit and largest > 0:
                for state in row:
                    row[state] /= largest
    return tuple(bound[i].name for i in sorted(_dependent(rows)))


def _dependent(rows: list[Slopes]) -> set[int]:
    """Rows that elimination reduces to zero."""
    left = {i: dict(row) for i, row in enumerate(rows)}
    while left:
        best = max(left, key=lambda i: max(map(abs, left[i].values()), default=0.0))
        row = left[best]
        column = max(row, key=lambda c: abs(row[c]), default=-1)
        if column < 0 or abs(row[column]) <= SMALL:
            break
        del left[best]
        for other in left.values():
            if column in other:
                factor = other.pop(column) / row[column]
                for c, x in row.items():
                    if c != column:
                        other[c] = other.get(c, 0.0) - factor * x
    return set(left)
