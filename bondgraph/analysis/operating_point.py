"""Operating point: a model at one state and instant, with all derivatives there; the basis of all linear analyses.

Dependent quantities are eliminated by the derivatives of their equations: unknowns of algebraic loops by their residuals, multipliers of loop
joints likewise. Among the coordinates that loop joints tie, a choice is made (QR with pivots) of which the others are functions.
Both are exact: the rates satisfy the constraints, so the Jacobian preserves the directions that the constraints allow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Assignment, IntArray, Leaf, Tape

from ..compiled_scene import CompiledScene
from ..errors import RunFailed, UsageError
from ..results.json_values import named
from .reduced import Follower, Reduced, followed_unknowns, followers, tied_coordinates
from .singular_slopes import CLOSEST, SIGNS, Beside, Slopes, departure, jumps, slopes_from_beside  # fmt: skip
from .sizes import sizes
from .thresholds import Thresholds, acting, thresholds

if TYPE_CHECKING:
    from compiler.api import Compilation, Expression, Lowered, Plan, Program

    from ..results.records import LimitLeft
    from ..simulation.constraints.constraints import Constraints
    from ..simulation.events.indicators import EventIndicators

JUMP = 1e-9  # relative to the terms of a rate: a smaller change at a condition is rounding
Lookup = Callable[[Leaf], float]
LIMITS = 1e-9  # relative to a table's range: rounding beyond its ends
ROUNDING, AT_ONCE = 1e-12, 1e-200  # relative, and s: just after an instant
AHEAD = 1.0  # s: length of time that is looked at where no experiment tells one


def length_of(plan: Plan) -> float:
    """Return the length of time beside which an instant is short: that of the experiment's run, s."""
    return AHEAD if plan.stop is None or plan.stop <= plan.start else plan.stop - plan.start


class OperatingPoint:
    """States (n,) and unknowns (m,) of a model at an instant. Derivatives have a column for each of them and for each of `by`."""

    def __init__(
        self, made: CompiledScene, constraints: Constraints, state: Array, mode: Array, time: float, by: tuple[str, ...],
        values: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self.made, self.constraints, self.mode, self.time = made, constraints, mode, time
        self.program: Program = made.program
        self.values = values or {}  # parameters that were set at the beginning
        self.state, self.by = np.asarray(state, dtype=float), by
        self.count, self.all = len(self.program.states.names), len(self.state)
        self.inputs, self.constants = constraints.inputs, constraints.constants
        self.notes: tuple[str, ...] = ()  # of the start
        self.kinks: list[str] | None = None  # variables that bend or jump here; None: these are refused

    @property
    def compilation(self) -> Compilation:
        """Stages of the compiler, created only if more than the program is needed."""
        return self.made.compilation

    @property
    def lowered(self) -> Lowered:
        """Expressions from which the program was made."""
        return self.compilation.lowered

    # ------------------------------------------------------------ the same elsewhere
    def set_at(self, name: str) -> tuple[str, int]:
        """Return the role ("parameter" or "input") and index of a quantity that can take other values. Raises `UsageError`."""
        for role, names in (("parameter", self.program.parameters.names), ("input", self.program.inputs.names)):
            if name in names:
                return role, names.index(name)
        raise UsageError("BR213", f"nothing in the model reads `{name}`, or it follows from others: it cannot be moved")

    def elsewhere(self, given: Mapping[str, float], state: Array) -> OperatingPoint:
        """Return the point at other values of parameters or inputs, with the nearest state on constraints and loops. Raises `RunFailed`."""
        from ..simulation.constraints.constraints import Constraints

        old = self.constraints
        parameters, inputs = np.array(old.parameters), np.array(self.inputs)
        for name, value in given.items():
            role, place = self.set_at(name)
            (parameters if role == "parameter" else inputs)[place] = value
        constraints = Constraints(self.program, parameters, inputs, old.magnitude)
        if constraints and not old.taking.all():
            constraints.leave_out(old.taking)
        mode = self._mode_with(constraints.constants)
        return self._within(constraints, state, mode)

    def in_mode(self, mode: Array) -> OperatingPoint:
        """Return the same point in another mode, with the nearest state on constraints and loops. Raises `RunFailed`."""
        return self._within(self.constraints, self.state, mode)

    def _within(self, constraints: Constraints, state: Array, mode: Array) -> OperatingPoint:
        state = constraints.project(self.time, np.asarray(state, dtype=float), mode)
        state = constraints.loops().solve(self.time, state, mode)
        point = OperatingPoint(self.made, constraints, state, mode, self.time, self.by, self.values)
        return point if self.kinks is None else point.one_sided()

    def _mode_with(self, constants: Array) -> Array:
        """Return the mode with the conditions on time that other constants change, just after the instant."""
        place = self.time + max(ROUNDING * abs(self.time), AT_ONCE)
        before, after = (np.asarray(self.program.switches(place, c)) for c in (self.constants, constants))
        if np.array_equal(before, after):
            return self.mode
        hybrid, mode = self.program.hybrid, np.array(self.mode, dtype=float)
        places = np.arange(len(after)) if hybrid is None else np.array(hybrid.timed, dtype=int)
        mode[places] = np.where(before == after, mode[places], after)
        return mode

    def one_sided(self) -> OperatingPoint:
        """Return the same point for Newton's method: at a kink it has the slopes of one side, and `kinks` has the name."""
        point = copy(self)
        point.kinks = []
        return point

    # ------------------------------------------------------------ values
    def lookup(self, leaf: Leaf) -> float:
        """Return the value of a symbol of the program."""
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
        """Rates of the states, (n,)."""
        found = self.program.derivative(self.time, self.state, self.inputs, self.constants, self.mode)
        return np.asarray(found, dtype=float)[: self.count]

    @cached_property
    def steady(self) -> dict[str, float]:
        """Rates, by name, of angles that rotate steadily while all else is at rest; meaningful at an equilibrium only."""
        from ..simulation.equilibrium.steady import steady_rates

        return steady_rates(self.constraints, self.time, self.state, self.mode)

    @cached_property
    def outputs(self) -> Any:
        """Values of `program.outputs`, in SI."""
        with np.errstate(all="ignore"):  # an output may have no finite value at this point, and is shown so
            found = self.program.output(self.time, self.state, self.inputs, self.constants, self.mode)
        return np.asarray(found, dtype=float)

    def values_of(self, names: Sequence[str]) -> Any:
        """Return values of quantities by name, (len(names),); quantities that nothing reads have the value that the author gave them."""
        space, whole = self.compilation.state_space, self.compilation.whole_graph.quantities
        found = {n: space.quantities[n] for n in names if space.quantities.get(n) in self.lowered.values}
        values = dict(
            zip(found, Tape([self.lowered.values[v] for v in found.values()]).values(self.lookup), strict=True)
        )
        given = {n: whole[n].value for n in names if n in whole} | dict(self.values)
        return np.array([values.get(n, given.get(n)) for n in names], dtype=float)

    def stored(self, state: Array) -> dict[str, float]:
        """Return states (n,) by name, and the quantities that share them."""
        found = named(self.program.states.names, state[: self.count])
        return found | {name: follower.at(state) for name, follower in self.followers.items()}

    @cached_property
    def followers(self) -> Mapping[str, Follower]:
        """Storages and integrals that share a state."""
        return followers(self.compilation, self.constraints.parameters) if self.made.facts.following else {}

    @property
    def unneeded(self) -> tuple[str, ...]:
        """States that no requested output depends on, if those are left out."""
        return self.made.certificate.unneeded if self.made.scene.upstream else ()

    @property
    def left(self) -> tuple[LimitLeft, ...]:
        """Requirements of the model violated here. Raises `RunFailed` for a table that is read outside its range."""
        from ..simulation.monitors.validity import ValidityMonitor

        watch = ValidityMonitor(self.program, self.constants, self.inputs, LIMITS)
        watch.look(np.array([self.time]), self.mode, lambda times: np.repeat(self.state[None], len(times), axis=0))
        return watch.warnings

    def check_limits(self) -> OperatingPoint:
        """Return the same point if all requirements of the model hold. Raises `RunFailed`."""
        left = self.left
        if left:
            raise refused_limit(left[0])
        return self

    # ------------------------------------------------------------ slopes
    def rate_slopes(self, states: Sequence[int]) -> Any:
        """Return derivatives of the rates of states (by their indices, in order), as `slopes`."""
        if not self.by:
            return self.jacobian[states]
        return self.slopes([self.compilation.state_space.states[i].rate for i in states])

    def residual_slopes(self) -> Any:
        """Return derivatives of the loop residuals, as `slopes`."""
        if not self.by:
            return self.jacobian[self.count :]
        return self.slopes([u.residual for u in self.compilation.state_space.unknowns])

    @cached_property
    def sizes(self) -> Any:
        """Sizes of states and unknowns, (n + m,)."""
        return sizes(self.program, self.constraints.parameters, self.state, self.rates, self.slopes_here)

    @cached_property
    def slopes_here(self) -> Any:
        """The same as `jacobian`, by the rules of the compiler alone: one side's at a kink, and not finite at a root of zero."""
        with np.errstate(all="ignore"):
            return np.asarray(self.program.jacobian(self.time, self.state, self.inputs, self.constants, self.mode))

    @cached_property
    def jacobian(self) -> Any:
        """Jacobian of the rates and then of the loop residuals, by states and unknowns, (n + m, n + m), from the program. Raises `RunFailed`."""
        found = self.slopes_here
        bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
        if len(bad):
            raise self._without_slope(self.program.variables.names[bad[0]])
        names = self.program.variables.names
        at, modes = (self.time, self.state, self.inputs, self.constants), self._sides if self._changes else [self.mode]
        rates = [self.program.derivative(*at, mode) for mode in modes]  # with both truths of conditions
        jumping = np.flatnonzero(np.ptp(rates, axis=0) > JUMP * (np.abs(found) @ np.abs(self.state)))
        self.refuse_kinks([names[int(i)] for i in jumping], "jumps at")
        return self.smoothed(self._jacobian_beside, found, lambda place: names[place // self.all])

    def smoothed(self, beside: Beside, found: Array, name: Callable[[int], str]) -> Array:
        """Return slopes that hold on both sides; `beside` has those at a distance along a direction, `name` that of the variable at a flat index."""
        ways = range(len(SIGNS) if self._changes or self.program.bends is not None else 1)
        smooth, infinite, kinks = slopes_from_beside(beside, found, ways)
        if len(infinite):
            raise self._without_slope(name(int(infinite[0])))
        self.refuse_kinks([name(int(place)) for place in kinks], "has another slope on each side of")
        return smooth

    def refuse_kinks(self, names: Sequence[str], words: str) -> None:
        """Raise `RunFailed` if there are names, or keep them at a one-sided point."""
        if self.kinks is not None:
            self.kinks += names
        if self.kinks is not None or not names:
            return
        places = dict.fromkeys(f"`{law.owner}` (line {law.span.line})" for law in self._bent_laws())
        law = f", by the law of {', '.join(places)}" if places else ""
        raise RunFailed(
            "BR263", f"the equation of `{names[0]}` {words} this state (t = {self.time:.9g} s){law}: there is no linear model;",
            'start the model beside it and analyse that (`--at start`), or smooth the law, as `tanh(x/w)` does `sign(x)`',
        )  # fmt: skip

    def _bent_laws(self) -> list[Any]:
        """Return the conditions that change here, else the first equation with a kink in the order of computation."""
        if self.program.hybrid is not None and self._changes:
            return [self.program.hybrid.conditions[k] for k in self._changes]
        sided = self.one_sided()
        for step in self.compilation.state_space.steps:
            if isinstance(step, Assignment):
                sided.sparse_slopes([step.target])
                if sided.kinks:
                    return [step]
        return []

    @cached_property
    def _sides(self) -> list[Array]:
        """Modes at the point, and on both sides along each direction."""
        return [self.mode, *(self._beside(side, CLOSEST, way)[1] for way in range(len(SIGNS)) for side in (1.0, -1.0))]

    @cached_property
    def _changes(self) -> tuple[int, ...]:
        """Conditions, by index, that are true on one side of the point only."""
        conditions = () if self.program.hybrid is None else self.program.hybrid.conditions
        return tuple(k for k, c in enumerate(conditions) if c.steers and np.ptp([m[c.position] for m in self._sides]))

    def _jacobian_beside(self, side: float, distance: float, way: int) -> Any:
        state, mode = self._beside(side, distance, way)
        return self.program.jacobian(self.time, state, self.inputs, self.constants, mode)

    def _beside(self, side: float, distance: float, way: int = 0) -> tuple[Any, Any]:
        """State at a distance from the point, and its mode."""
        state = self.state + side * departure(self.sizes, distance, way)
        if self.program.hybrid is None or not self.program.hybrid.conditions:
            return state, self.mode
        from ..simulation.events.indicators import HybridState

        return state, self.conditions.guess(HybridState(self.time, state, self.mode))

    @cached_property
    def conditions(self) -> EventIndicators:
        """Conditions of the model at the values of this point, made once for all points of the program."""
        from ..simulation.events.indicators import EventIndicators

        first: EventIndicators | None = self.made.kept.get("conditions")
        if first is None:
            first = self.made.kept["conditions"] = EventIndicators(
                self.constraints, self.sizes, length_of(self.made.plan)
            )
        return first.with_values(self.constraints, self.sizes)

    def _without_slope(self, name: str) -> RunFailed:
        return RunFailed("BR215", f"`{name}` has no finite slope at this state (t = {self.time:.9g} s)")

    def slopes(self, variables: Sequence[int]) -> Any:
        """Return dense derivatives of variables by states, unknowns and `by`, (len(variables), n + m + k). Raises `RunFailed`."""
        return self.sparse_slopes(variables).toarray()

    def sparse_slopes(self, variables: Sequence[int]) -> Any:
        """Return the same, sparse by rows."""
        from scipy.sparse import csr_array

        slopes = self.slopes_of(tuple(variables))
        values, numbers = np.array(slopes.tape.values(self.lookup), dtype=float), slopes.rows
        bad: IntArray = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise self._without_slope(self.compilation.state_space.variables[variables[numbers[bad[0]]]].name)
        if self._changes:
            _ = self.jacobian  # refuses rates that jump
        if slopes.guarded:
            name, at = [self.compilation.state_space.variables[v].name for v in variables], self.lookup_beside
            values = self.smoothed(lambda *to: slopes.tape.values(at(*to)), values, lambda place: name[numbers[place]])
        return csr_array((values, (numbers, slopes.columns)), shape=(len(variables), self.all + len(self.by)))

    def lookup_beside(self, side: float, distance: float, way: int, held: Sequence[int] = ()) -> Lookup:
        """Return `lookup` at a distance from the point, with `by` and held values (by their places in the mode) moved as well."""
        state, mode = self._beside(side, distance, way)
        mode, places = np.array(mode, dtype=float), list(held)
        size = np.where(mode[places] != 0, np.abs(mode[places]), 1.0)
        # in another direction than the states: all in one proportion, a linear model stays at rest, and only rounding changes
        mode[places] += side * departure(size, distance, (way + 1) % len(SIGNS))
        values = {"state": state, "mode": mode, **self._settings_beside(side, distance)}
        return lambda leaf: float(values[leaf.role][leaf.position]) if leaf.role in values else self.lookup(leaf)

    def _settings_beside(self, side: float, distance: float) -> dict[str, Array]:
        """Return the parameters and inputs, with those of `by` at a distance."""
        values = {"parameter": np.array(self.constraints.parameters), "input": np.array(self.inputs, dtype=float)}
        steps = departure(np.ones(len(self.by)), side * distance, len(SIGNS) - 1)
        for name, step in zip(self.by, steps, strict=True):
            if name in self.program.parameters.names or name in self.program.inputs.names:
                role, place = self.set_at(name)
                values[role][place] += step * (abs(values[role][place]) or 1.0)
        return values

    def jumping(self) -> tuple[str, ...]:
        """Return states whose rates, and outputs that are not continuous at this point along states and `by`."""
        program = self.program

        def beside(side: float, distance: float, way: int) -> Any:
            state, mode = self._beside(side, distance, way)
            moved = self._settings_beside(side, distance)
            at = self.time, state, moved["input"], program.constants(moved["parameter"]), mode
            return np.concatenate([np.ravel(program.derivative(*at))[: self.count], np.ravel(program.output(*at))])

        places = jumps(beside, np.concatenate([self.rates, self.outputs]))
        return (*((*program.states.names, *program.outputs.names)[i] for i in places), *self.thresholds.outputs)

    def slopes_of(self, variables: tuple[int, ...]) -> Slopes:
        """Return the same as expressions, with their places."""
        found: Slopes | None = self.made.kept.get(variables)
        if found is None:
            rows = [self.lowered.slopes.get(v, {}) for v in variables]
            by = [self.compilation.state_space.quantities.get(n) for n in self.by]
            columns = [*range(self.all), *(self.all + by.index(v) for v in self.lowered.by)]
            tape = Tape([x for row in rows for x in row.values()])
            found = self.made.kept[variables] = Slopes(
                tape, np.repeat(np.arange(len(rows)), [len(row) for row in rows]),
                np.array([columns[c] for row in rows for c in row], dtype=int), tape.jumps(),
            )  # fmt: skip
        return found

    def tape(self, word: str, roots: Callable[[], Sequence[Expression]]) -> Tape:
        """Return a tape by its name, made once for all points of the program."""
        found: Tape | None = self.made.kept.get(word)
        if found is None:
            found = self.made.kept[word] = Tape(roots())
        return found

    @cached_property
    def conserved(self) -> Any:
        """Conserved sums of the states, (k, n)."""
        from ..simulation.equilibrium.conserved import conserved_sums

        return conserved_sums(self.made, self.constraints.parameters)

    @cached_property
    def reduced(self) -> Reduced:
        """Reduction with unknowns and tied coordinates eliminated. Raises `UsageError` for sampled models."""
        sampled = [e for e in getattr(self.program.hybrid, "events", ()) if e.sampled]
        if sampled:
            raise UsageError(
                "BR216", f"`{sampled[0]}` is sampled, and this analysis is one of continuous equations: "
                "`equilibrium` and `bode` (`response`) are made of the sampled loop;", "for others write what it does as a continuous law, or simulate",
            )  # fmt: skip
        return reduction(self)

    @cached_property
    def thresholds(self) -> Thresholds:
        """Events that are exactly at their thresholds here."""
        if self.program.hybrid is None:
            return Thresholds()
        from ..simulation.events.indicators import HybridState

        return thresholds(self.conditions, HybridState(self.time, self.state, self.mode), self.sizes)

    @cached_property
    def acting(self) -> tuple[Array, tuple[str, ...]]:
        """Mode with the conditions that hold here; and the events and junctions that act here and change the equations, in words."""
        if self.program.hybrid is None:
            return self.mode, ()
        from ..simulation.events.indicators import HybridState

        return acting(self.conditions, HybridState(self.time, self.state, self.mode), self.sizes)

    def refuse_thresholds(self) -> None:
        """Raise `RunFailed` if an event is exactly at its threshold, or keep it at a one-sided point."""
        names = self.thresholds.names
        if self.kinks is not None:
            self.kinks += names
        elif names:
            raise RunFailed(
                "BR266", f"{' and '.join(names[:3])} at this state (t = {self.time:.9g} s) is exactly at its threshold, and on one side of it changes what the "
                "model does: there is no linear model;", "start the model beside it and analyse that (`--at start`), or give the condition a hysteresis",
            )  # fmt: skip

    def of_states(self, variables: Sequence[int]) -> tuple[Any, Any]:
        """Return the derivatives of variables by the free coordinates and by `by`, with tied coordinates following."""
        slopes, reduced = self.slopes(variables), self.reduced
        return reduced.through(slopes)


def refused_limit(left: LimitLeft) -> RunFailed:
    """Return the error of an analysis where a requirement of the model is violated."""
    return RunFailed("BR214", f"no analysis is made where the model does not hold: {left.words_at_rest}")


def reduction(point: OperatingPoint) -> Reduced:
    """Return the reduction with unknowns and tied coordinates eliminated. Raises `RunFailed`."""
    point.refuse_thresholds()
    n, size, k = point.count, point.all, len(point.by)
    follow = np.zeros((0, n + k))
    if size > n:
        try:
            follow = followed_unknowns(point.residual_slopes(), n)
        except np.linalg.LinAlgError as problem:
            names = ", ".join(f"`{u}`" for u in point.program.unknowns.names[:6])
            raise RunFailed(
                "BR217", f"the algebraic loop of {names} has no slope at this state: two of its solutions meet"
            ) from problem
    if not point.program.invariants.names:
        return Reduced(np.arange(n), np.eye(n), np.zeros((n, k)), follow)
    space = point.compilation.state_space
    positions, rates = [i.position for i in space.invariants], [i.velocity for i in space.invariants]
    values = [v for v in (*positions, *rates) if v is not None]
    slopes = point.slopes(values)
    chosen, directions, following = tied_coordinates(slopes[:, :n], slopes[:, size:], point.sizes[:n])
    return Reduced(chosen, directions, following, follow)
