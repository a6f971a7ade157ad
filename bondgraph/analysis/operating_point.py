"""A model at one state and instant, with the slopes of everything there: what all linear analyses stand on.

What follows from others is eliminated by the derivatives of what ties it: unknowns of algebraic loops by their residuals, multipliers of
closing joints likewise, and of the coordinates that closing joints tie a choice is made (QR with pivots) of which the others are functions.
Both are exact: the rates keep the constraints, so that the directions that these leave are kept by the Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..door import Leaf, NoSlope, Tape
from ..errors import RunFailed, UsageError
from ..prepared import Prepared
from .told import named

if TYPE_CHECKING:
    from ..door import Compilation, Expression, Lowered, Program
    from ..model import Model
    from ..results import LimitLeft
    from ..simulation.closed.constraints import Constraints
    from .following import Follower

RANK = 1e-9  # of the largest: a constraint that says less follows from others
LIMITS = 1e-9  # of a table's range: as far beyond its ends as rounding leads
AHEAD = 1.0  # s: how far ahead instants are looked for, where a model is asked at one


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked of a model, and where: `state` "equilibrium", "start", or values of states by name (the rest at the start).

    `by`: quantities that slopes are wanted by; `outputs`: None all.
    """

    experiment: str | None = None
    settings: Mapping[str, str | float] | None = None
    outputs: tuple[str, ...] | None = None
    by: tuple[str, ...] = ()
    state: str | Mapping[str, float] = "equilibrium"
    time: float | None = None  # None: where the experiment begins


@dataclass(frozen=True, slots=True)
class Slopes:
    """Those of some variables that are not zero: how they are evaluated, and where they stand."""

    tape: Tape
    rows: Any
    columns: Any


class OperatingPoint:
    """States (n,) and unknowns (m,) of a model at an instant. Slopes have a column for each of them and for each of `by`."""

    def __init__(
        self, made: Prepared, constraints: Constraints, state: Any, mode: Any, time: float, by: tuple[str, ...],
        values: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self.made, self.constraints, self.mode, self.time = made, constraints, mode, time
        self.program: Program = made.program
        self.values = values or {}  # that were set when it began
        self.state, self.by = np.asarray(state, dtype=float), by
        self.count, self.all = len(self.program.states.names), len(self.state)
        self.inputs, self.constants = constraints.inputs, constraints.constants

    @property
    def compilation(self) -> Compilation:
        """The stages of the compiler, made only if something asks for more than the program."""
        return self.made.compilation

    @property
    def lowered(self) -> Lowered:
        """The expressions behind the program."""
        return self.compilation.lowered

    # ------------------------------------------------------------ the same elsewhere
    def set_at(self, name: str) -> tuple[str, int]:
        """Where a parameter or input stands that can take other values: "parameter" or "input", and its place. Raises `UsageError`."""
        for role, names in (("parameter", self.program.parameters.names), ("input", self.program.inputs.names)):
            if name in names:
                return role, names.index(name)
        raise UsageError(f"nothing in the model reads `{name}`, or it follows from others: it cannot be moved")

    def elsewhere(self, given: Mapping[str, float], state: Any) -> OperatingPoint:
        """At other values of parameters or inputs, and the state nearest to this one that keeps constraints and loops. Raises `RunFailed`."""
        from ..simulation.closed.constraints import Constraints
        from ..simulation.loops.loops import LoopSolver

        old = self.constraints
        parameters, inputs = np.array(old.parameters), np.array(self.inputs)
        for name, value in given.items():
            role, place = self.set_at(name)
            (parameters if role == "parameter" else inputs)[place] = value
        constraints = Constraints(self.program, parameters, inputs, old.magnitude)
        if constraints and not old.taking.all():
            constraints.leave_out(old.taking)
        state = constraints.project(self.time, np.asarray(state, dtype=float), self.mode)
        size = np.where(state != 0, np.abs(state), 1.0)
        state = LoopSolver(self.program, constraints.constants, inputs, size, constraints.parameters).solve(
            self.time, state, self.mode
        )
        return OperatingPoint(self.made, constraints, state, self.mode, self.time, self.by, self.values)

    # ------------------------------------------------------------ values
    def lookup(self, leaf: Leaf) -> float:
        """The value of a symbol of the program."""
        match leaf.role:
            case "state":
                return float(self.state[leaf.position])
            case "parameter":
                return float(self.constraints.parameters[leaf.position])
            case "input":
                return float(self.inputs[leaf.position])
            case "mode":
                return float(self.mode[leaf.position])
        return self.time

    @cached_property
    def rates(self) -> Any:
        """Of the states, (n,)."""
        found = self.program.derivative(self.time, self.state, self.inputs, self.constants, self.mode)
        return np.asarray(found, dtype=float)[: self.count]

    @cached_property
    def steady(self) -> dict[str, float]:
        """The rates, by name, of angles that turn steadily while all else is at rest; of a point that is not at rest nothing is meant."""
        from ..simulation.start.steady import steady_rates

        return steady_rates(self.program, self.constraints, self.time, self.state, self.inputs, self.mode)

    @cached_property
    def outputs(self) -> Any:
        """Of `program.outputs`, in SI."""
        with np.errstate(all="ignore"):  # an output may have no finite value at this point, and is shown so
            found = self.program.output(self.time, self.state, self.inputs, self.constants, self.mode)
        return np.asarray(found, dtype=float)

    def values_of(self, names: Sequence[str]) -> Any:
        """Of quantities by name, (len(names),); those that nothing reads have the value that the author gave them."""
        space, whole = self.compilation.state_space, self.compilation.whole_graph.quantities
        found = {n: space.quantities[n] for n in names if n in space.quantities}
        values = dict(
            zip(found, Tape([self.lowered.values[v] for v in found.values()]).values(self.lookup), strict=True)
        )
        given = {n: whole[n].value for n in names if n in whole} | dict(self.values)
        return np.array([values.get(n, given.get(n)) for n in names], dtype=float)

    def stored(self, state: Any) -> dict[str, float]:
        """States (n,) by name, and what shares them."""
        found = named(self.program.states.names, state[: self.count])
        return found | {name: follower.at(state) for name, follower in self.followers.items()}

    @cached_property
    def followers(self) -> Mapping[str, Follower]:
        """Storages and integrals that share a state."""
        from .following import followers

        return followers(self.compilation, self.constraints.parameters) if self.made.facts.following else {}

    @property
    def left(self) -> tuple[LimitLeft, ...]:
        """What the model requires and does not hold here. Raises `RunFailed` for a table that is asked outside of its range."""
        from ..simulation.watch.validity import Watch

        watch = Watch(self.program, self.constants, self.inputs, LIMITS)
        watch.look(np.array([self.time]), self.mode, lambda times: np.repeat(self.state[None], len(times), axis=0))
        return watch.warnings

    def check_limits(self) -> OperatingPoint:
        """The same point, in which all holds that the model requires. Raises `RunFailed`."""
        left = self.left
        if left:
            raise RunFailed(f"no analysis is made where the model does not hold: {left[0].words_at_rest}")
        return self

    # ------------------------------------------------------------ slopes
    def rate_slopes(self, states: Sequence[int]) -> Any:
        """Of the rates of states (by their places, in order), as `slopes`."""
        if not self.by:
            return self.jacobian[states]
        return self.slopes([self.compilation.state_space.states[i].rate for i in states])

    def residual_slopes(self) -> Any:
        """Of what unknowns make vanish, as `slopes`."""
        if not self.by:
            return self.jacobian[self.count :]
        return self.slopes([u.residual for u in self.compilation.state_space.unknowns])

    @cached_property
    def jacobian(self) -> Any:
        """Of the rates and then of what unknowns make vanish, by states and unknowns, (n + m, n + m), from the program itself. Raises `RunFailed`."""
        with np.errstate(all="ignore"):
            found = np.asarray(self.program.jacobian(self.time, self.state, self.inputs, self.constants, self.mode))
        bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
        if len(bad):
            raise self._without_slope((*self.program.states.names, *self.program.unknowns.names)[bad[0]])
        return found

    def _without_slope(self, name: str) -> RunFailed:
        return RunFailed(f"`{name}` has no finite slope at this state (t = {self.time:.9g} s)")

    def slopes(self, variables: Sequence[int]) -> Any:
        """Of variables by states, unknowns and `by`, (len(variables), n + m + k), dense. Raises `RunFailed`."""
        return self.sparse_slopes(variables).toarray()

    def sparse_slopes(self, variables: Sequence[int]) -> Any:
        """The same, sparse by rows."""
        from scipy.sparse import csr_array

        slopes = self.slopes_of(tuple(variables))
        values, numbers = np.array(slopes.tape.values(self.lookup), dtype=float), slopes.rows
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            name = self.compilation.state_space.variables[variables[numbers[bad[0]]]].name
            raise self._without_slope(name)
        return csr_array((values, (numbers, slopes.columns)), shape=(len(variables), self.all + len(self.by)))

    def slopes_of(self, variables: tuple[int, ...]) -> Slopes:
        """The same as expressions, with their places."""
        found: Slopes | None = self.made.kept.get(variables)
        if found is None:
            rows = [self.lowered.slopes.get(v, {}) for v in variables]
            columns = [*range(self.all), *(self.all + self.by.index(self._name(v)) for v in self.lowered.by)]
            found = self.made.kept[variables] = Slopes(
                Tape([x for row in rows for x in row.values()]),
                np.repeat(np.arange(len(rows)), [len(row) for row in rows]),
                np.array([columns[c] for row in rows for c in row], dtype=int),
            )
        return found

    def tape(self, word: str, roots: Callable[[], Sequence[Expression]]) -> Tape:
        """A tape by its name, made once for all points of the program."""
        found: Tape | None = self.made.kept.get(word)
        if found is None:
            found = self.made.kept[word] = Tape(roots())
        return found

    def _name(self, variable: int) -> str:
        return next(n for n in self.by if self.compilation.state_space.quantities.get(n) == variable)

    @cached_property
    def conserved(self) -> Any:
        """Sums of the states that every motion keeps, (k, n)."""
        from .conserved import conserved_sums

        return conserved_sums(self)

    @cached_property
    def reduced(self) -> Reduced:
        """With unknowns and tied coordinates eliminated. Raises `UsageError` for what is sampled."""
        sampled = [e for e in getattr(self.program.hybrid, "events", ()) if e.sampled]
        if sampled:
            raise UsageError(
                f"`{sampled[0]}` is sampled, and this analysis is one of continuous equations: `equilibrium` and `bode` (`response`) are made of the "
                "sampled loop; for others write what it does as a continuous law, or simulate"
            )
        return reduction(self)

    def of_states(self, variables: Sequence[int]) -> tuple[Any, Any]:
        """The slopes of variables by the free coordinates and by `by`, what is tied following."""
        slopes, reduced = self.slopes(variables), self.reduced
        return reduced.through(slopes)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Free coordinates (r,) of the states: `chosen` are their places; `directions` (n, r) how all states follow, `following` (n, k)
    how they follow `by` while the free ones stand still; `unknowns` (m, n + k) how unknowns follow states and `by`."""

    chosen: Any
    directions: Any
    following: Any
    unknowns: Any

    @property
    def tied(self) -> bool:
        """Whether some coordinates follow others."""
        return len(self.chosen) < len(self.directions)

    def whole(self, amplitudes: Any) -> Any:
        """All states from the free coordinates."""
        return self.directions @ amplitudes if self.tied else amplitudes

    def by_states(self, slopes: Any) -> tuple[Any, Any]:
        """From columns of states, unknowns and `by` to columns of all states, each by itself, and of `by`."""
        n, (m, width) = len(self.directions), self.unknowns.shape
        whole = np.concatenate([slopes[:, :n], slopes[:, n + m :]], axis=1)
        whole = whole + slopes[:, n : n + m] @ self.unknowns if m else whole
        return whole[:, :n], whole[:, n:width]

    def through(self, slopes: Any) -> tuple[Any, Any]:
        """From columns of states, unknowns and `by` to columns of free coordinates, and of `by`."""
        states, moved = self.by_states(slopes)
        if not self.tied:
            return states, moved
        return states @ self.directions, states @ self.following + moved

    def held(self, moved: Any) -> Any:
        """How states (n, k) follow `by`, with what is tied as the free ones say."""
        return self.directions @ moved[self.chosen] + self.following if self.tied else moved


def reduction(point: OperatingPoint) -> Reduced:
    """With unknowns and tied coordinates eliminated. Raises `RunFailed`."""
    n, size, k = point.count, point.all, len(point.by)
    follow = np.zeros((0, n + k))
    if size > n:
        whole = point.residual_slopes()
        try:
            follow = -np.linalg.solve(whole[:, n:size], np.concatenate([whole[:, :n], whole[:, size:]], axis=1))
        except np.linalg.LinAlgError as problem:
            names = ", ".join(f"`{u}`" for u in point.program.unknowns.names[:6])
            raise RunFailed(
                f"the algebraic loop of {names} has no slope at this state: two of its solutions meet"
            ) from problem
    if not point.program.invariants.names:
        return Reduced(np.arange(n), np.eye(n), np.zeros((n, k)), follow)
    space = point.compilation.state_space
    values = [i.position for i in space.invariants] + [i.velocity for i in space.invariants if i.velocity is not None]
    slopes = point.slopes(values)
    chosen, directions, following = _tied(slopes[:, :n], slopes[:, size:])
    return Reduced(chosen, directions, following, follow)


def _tied(slopes: Any, moved: Any) -> tuple[Any, Any, Any]:
    """Coordinates that stay free where slopes @ x + moved @ p = 0, and how all follow them and p."""
    from scipy.linalg import qr

    n = slopes.shape[1]
    rows = np.abs(slopes).max(axis=1, initial=0.0)
    slopes, moved = (a / np.where(rows > 0, rows, 1.0)[:, None] for a in (slopes, moved))
    _, triangle, order = qr(slopes, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    rank = int((sizes > RANK * sizes.max(initial=0.0)).sum())
    tied, chosen = np.sort(order[:rank]), np.sort(order[rank:])
    directions, following = np.zeros((n, n - rank)), np.zeros((n, moved.shape[1]))
    directions[chosen, np.arange(n - rank)] = 1.0
    solved = np.linalg.lstsq(slopes[:, tied], np.concatenate([slopes[:, chosen], moved], axis=1), rcond=None)[0]
    directions[tied], following[tied] = -solved[:, : n - rank], -solved[:, n - rank :]
    return chosen, directions, following


# ---------------------------------------------------------------- finding one


def operating_point(
    model: Model, asked: Asked, target: str = "numpy", moved: Mapping[str, float] | None = None
) -> OperatingPoint:
    """The model put where it is asked; numbers that are set are arguments of one program, so that others compile nothing.

    `moved`: values of `by` in a program that was made with the author's: what these decide (which parts of a mechanism lie on each other, a
    choice between laws) stays as it is. Raises `CompilationFailed`, `UsageError`, `RunFailed`.
    """
    from ..simulation.settings import settle

    settings = asked.settings or {}
    settled = settle(model, asked.experiment, settings, asked.outputs, True, target)
    if settled.values or moved:
        scene = replace(settled.scene, free=frozenset(asked.by), by=asked.by)
        try:
            return placed(model.prepared(scene, True, target), asked, {**settled.values, **(moved or {})})
        except RunFailed:
            if moved or all(settled.values.values()):
                raise  # else a zero may make other equations of the model: the compiler is told of it
    scene = replace(model.scene(asked.experiment, settings, asked.by, asked.outputs), by=asked.by)
    return placed(model.prepared(scene, True, target), asked)


def placed(made: Prepared, asked: Asked, values: Mapping[str, float] | None = None) -> OperatingPoint:
    """The same from what is compiled already; `values` are set when it begins."""
    from ..simulation.leg import Leg

    try:
        program, plan = made.program, made.plan
    except NoSlope as problem:
        raise UsageError(
            "one of the quantities is a point of a table or a seed of noise: nothing is differentiated by these"
        ) from problem
    begins = plan.start if asked.time is None else asked.time
    plan = replace(plan, equilibrium=asked.state == "equilibrium", start=begins, tolerances={})
    if program.delays is not None:
        raise UsageError(
            "signals that are what others were some time ago (`delay`) are no states: no linear analysis is made"
        )
    with np.errstate(all="ignore"):
        leg = Leg(made, plan, np.array([begins, begins + AHEAD]), 1e-6, None, False, None, values)
        if leg.begins_without != leg.off:
            raise UsageError("junctions go on or off at the very start (`active`): no linear analysis is made there")
        state, mode = leg.state, leg.stretches[0].mode
        if isinstance(asked.state, Mapping):
            state = _given(leg, asked.state, begins, mode)
        elif asked.state not in ("equilibrium", "start"):
            raise UsageError(f"a state is `equilibrium`, `start` or values by name; not `{asked.state}`")
    return OperatingPoint(made, leg.constraints, state, mode, begins, asked.by, values).check_limits()


def _given(leg: Any, given: Mapping[str, float], time: float, mode: Any) -> Any:
    """The state with given values, on the constraints, with the unknowns that belong to it."""
    from ..simulation.loops.loops import LoopSolver
    from .following import led

    names = leg.program.states.names
    if any(n in leg.compilation.facts.following for n in given):
        given = led(leg.compilation.compilation, leg.parameters, given)
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise UsageError(f"`{unknown[0]}` is no state; states are {', '.join(names) or 'none'}")
    state = np.array(leg.state, dtype=float)
    for i, name in enumerate(names):
        state[i] = given.get(name, state[i])
    size = np.where(state != 0, np.abs(state), 1.0)
    state = leg.constraints.project(time, state, mode)
    return LoopSolver(leg.program, leg.constants, leg.inputs, size, leg.parameters).solve(time, state, mode)
