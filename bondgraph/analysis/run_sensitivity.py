"""Sensitivity of a run to parameters: the derivatives of its outputs at every instant, along the states of the run.

With S = dx/dp the derivatives of the states follow S' = f_x S + f_p (forward sensitivities; Hindmarsh et al., ACM Trans. Math. Softw. 31, 2005),
with the exact derivatives of the compiled equations; unknowns of loops are eliminated. Along the states of a run, at a tighter tolerance, this is
linear: collocation turns parts of the run into affine maps of S, all at once. A part is halved where its map differs from that of its two halves.
Where the instant of a jump of the right-hand side depends on a parameter, S jumps by (f before - f after) times the derivative of the instant; where
a condition on states flips, this derivative follows from the condition's own, - (g_x S + g_p) / g'.
Loop joints tie states: with their multipliers eliminated f is defined for all states and preserves the constraints, and so S preserves their
derivative, g_x S + g_p = 0, which holds at the start; rounding of the integration is corrected at each reported instant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Leaf, Reported, symbols

from ..compiled_model import CompiledModel
from ..compiled_scene import chosen_target
from ..errors import RunFailed, UsageError
from ..keywords import AnalysisRequest
from ..numerics.collocation import NODES, affine_steps
from ..rendering import OfModel, Summarised
from ..results.json_values import head, named, with_units
from .movable import differentiable_program, refuse_structural
from .operating_point import JUMP, OperatingPoint, refused_limit
from .reduced import by_states, followed_unknowns, tied_step
from .sensitivity import balanced_step, independent, place_in, unit_directions

if TYPE_CHECKING:
    from ..simulation.phase import Phase
    from ..simulation.segments.timeline import Segment

SCHEMA = "bondgraph-run-sensitivity/1"
RTOL = 1e-8
GRAZING = 1e-6  # of the terms of a condition's rate: a slower crossing touches its threshold
SAME_INSTANT = 1e-12  # relative difference of equal instants
FINER, FINEST = 1e-2, 1e-12  # tolerance of the run in that of S, and the least one
MOST_PARTS = 50_000  # pairs; where so many do not suffice, the run is not known well enough
# Differences of a part from its halves that are allowed, in tolerances: relative to S, and in sizes of the state and the parameter, which is above
# the error of the run. The errors of the halves are at least 32 times smaller, where the run is smooth 512 times.
RELATIVE, ABSOLUTE = 4.0, 0.3
TIED = 1e-9  # relative to the derivatives at a start: remainder under the constraints of loop joints

Part = tuple[int, float, float]  # of a run: number of the segment, start, stop
Parts = tuple[int, float, float, float]  # two of them, next to each other
Partitions = dict[tuple[float, ...], list[Parts]]  # by the ends of segments and the reported instants


@dataclass(frozen=True, eq=False, repr=False)
class RunSensitivity(OfModel, Summarised):
    """Values `values` (t, m) of `outputs` over `time` (t,), and `slopes` (t, m, k), their derivatives by `parameters` (k), in SI."""

    time: Array
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    at: Array
    values: Array
    slopes: Array
    units: Mapping[str, str]
    report: tuple[Reported, ...]

    def of(self, output: str, parameter: str) -> Array:
        """Return one derivative over time (t,). Raises `UsageError`."""
        return self.slopes[:, place_in(output, self.outputs), place_in(parameter, self.parameters)]

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-run-sensitivity/1`.

        {schema, model, experiment, time, parameters: {name: {value, unit}}, outputs: {name: {unit, values, slopes: {parameter: [SI over SI]}}}}.
        """
        outputs = {
            n: {
                "unit": self.units[n], "values": self.values[:, i].tolist(),
                "slopes": {p: self.slopes[:, i, j].tolist() for j, p in enumerate(self.parameters)},
            }
            for i, n in enumerate(self.outputs)
        }  # fmt: skip
        parameters = with_units(named(self.parameters, self.at), self.units)
        return {**head(SCHEMA, self), "time": self.time.tolist(), "parameters": parameters, "outputs": outputs}


def run_sensitivity(
    model: CompiledModel, parameters: tuple[str, ...] | None, asked: AnalysisRequest, instants: Array | tuple[str | float | None, int],
    rtol: float = RTOL, moved: Mapping[str, float] | None = None, known: Partitions | None = None,
) -> RunSensitivity:  # fmt: skip
    """Return the sensitivity of a run by parameters (None: all independent ones), at `instants` (t,).

    `instants` may also be the time at which the run ends (None: that of the experiment) and the number of instants.
    `moved`: values of the parameters, as for `operating_point`; `known`: partitions of similar runs, with which the search for one begins.
    Raises `CompilationFailed`, `UsageError` for models that jump with states, `RunFailed`.
    """
    from ..simulation.run_options import end_of
    from ..simulation.settings import settle

    by, fixed = independent(model, parameters, asked.experiment, asked.settings or {})
    target = chosen_target(None)
    settled = settle(model, asked.experiment, fixed, asked.outputs, True, target)
    made = model.compiled_scene(replace(settled.scene, free=frozenset(by), by=by), False, target)
    refuse_structural(made.compilation, by)
    program, plan = differentiable_program(made), made.plan
    if isinstance(instants, tuple):
        to, points = instants
        instants = np.linspace(plan.start, end_of(plan, to), points)
    if instants[0] < plan.start:
        raise UsageError("BR238", f"a run begins at {plan.start:g} s: nothing is known of t = {instants[0]:g} s")
    asked = replace(asked, settings=fixed, by=by)
    flow = LinearizedDynamics(made, asked, instants, {**settled.values, **(moved or {})}, rtol)
    with np.errstate(all="ignore"):
        values, slopes = flow.go({} if known is None else known)
    units = dict(zip(program.outputs.names, program.outputs.units, strict=True))
    units |= {n: q.unit for n, q in made.compilation.whole_graph.quantities.items() if n in by}
    return RunSensitivity(
        program.name, plan.experiment, instants, program.outputs.names, by, flow.point(flow.leg.state, flow.begins).values_of(by), values, slopes,
        units, plan.report,
    )  # fmt: skip


def lost_at(time: float) -> RunFailed:
    """Return the error of derivatives that have no end of finer parts."""
    return RunFailed("BR244", f"the derivatives could not be followed beyond t = {time:.9g} s")


class LinearizedDynamics:
    """States and their derivatives along the segments of a run."""

    def __init__(self, made: Any, asked: AnalysisRequest, instants: Array, values: Mapping[str, float], rtol: float) -> None:  # fmt: skip
        from ..simulation.phase import Phase, PhaseOptions

        program = made.program
        hybrid = program.hybrid
        acts = hybrid is not None and (hybrid.events or hybrid.modes.names or hybrid.counted or hybrid.junctions)
        if acts or made.facts.valves or program.delays is not None:
            raise UsageError(
                "BR239", "events, whole numbers of states, switched junctions, ideal valves and delays have no derivatives here: "
                "no sensitivities of runs are made of them",
            )  # fmt: skip
        if made.facts.claims:
            raise UsageError(
                "BR240", "starts that are given to what is computed: no sensitivities of runs are made of them"
            )
        self.ways = unit_directions(made.compilation, asked.by, len(asked.by))  # of the symbols of the parameters
        self.made, self.asked, self.instants, self.rtol, self.values = made, asked, instants, rtol, values
        self.begins = made.plan.start
        span = np.concatenate([[self.begins], instants[instants > self.begins]])
        if len(span) < 2:
            raise UsageError("BR241", "a run has an end after its start")
        self.options = PhaseOptions(replace(made.plan, tolerances={}), max(rtol * FINER, FINEST), None, False, values)
        self.leg = Phase(made, span, self.options)
        self.n, self.k = len(program.states.names), len(asked.by)
        self.loops = self.leg.constraints.loops()
        self.bent: set[Part] = set()  # parts in which a law has a kink
        self.segments = self.leg.stretches
        if hybrid is not None:  # conditions on states end more of them
            self.segments = self._run(span).trajectory.pieces
        self.mode, self.unknowns = self.segments[0].mode, self.leg.state[self.n :]
        lowered, quantities = made.compilation.lowered, made.compilation.state_space.quantities
        numbers = [quantities.get(name) for name in asked.by]
        columns = np.array([*range(len(self.leg.state)), *(len(self.leg.state) + numbers.index(v) for v in lowered.by)])
        self.rows, self.slopes = lowered.moving_rows(), program.functions.get("moving_slopes")
        self.places = np.array([place for place, _ in lowered.moving_slopes()], dtype=int).reshape(-1, 2).T
        self.places[1] = columns[self.places[1]]
        own = np.abs(self.point(self.leg.state, self.begins).values_of(asked.by))
        self.size, self.own = np.asarray(self.leg._magnitudes())[: self.n, None], np.where(own > 0, own, 1.0)

    def point(self, state: Array, time: float) -> OperatingPoint:
        """Return the operating point at a state (n,), with the unknowns solved for."""
        full = self.loops.solve(time, np.concatenate([state[: self.n], self.unknowns]), self.mode)
        self.unknowns = full[self.n :]
        return OperatingPoint(self.made, self.leg.constraints, full, self.mode, time, self.asked.by, self.values)

    def _run(self, span: Array) -> Phase:
        """Return a run that reports these instants."""
        from ..simulation.phase import Phase
        from ..simulation.segments.trajectory import empty

        leg = Phase(self.made, span, self.options)
        leg.trajectory = empty(leg.program, span)
        leg.integrate(None)
        return leg

    def _states(self, times: Array) -> Any:
        """Return states and unknowns of the run at some instants, (t, n + m); keep those at the reported ones and where segments start."""
        starts = np.array([s.start for s in self.segments])
        span = np.unique(np.concatenate([[self.begins], self.instants, starts, times]))
        self.leg = leg = self._run(span)
        if len(leg.trajectory.pieces or leg.stretches) != len(self.segments):
            raise lost_at(self.begins)
        self.reported, self.starting, states = (
            leg.trajectory.states[np.searchsorted(span, at)] for at in (self.instants, starts, times)
        )
        return states

    def _slopes(self, times: Array, states: Array, mode: Array) -> tuple[Any, Any]:
        """Return the derivatives (t, rows, n) and (t, rows, k) of rates, residuals, invariants and outputs by states and parameters."""
        slopes, leg = np.zeros((len(times), len(self.rows), states.shape[1] + self.k)), self.leg
        if self.slopes is None:  # nothing reads any of the parameters
            return slopes[..., : self.n], slopes[..., : self.k]
        slopes[:, *self.places] = self.slopes(times, states, leg.inputs, leg.constants, mode)
        bad = np.argwhere(~np.isfinite(slopes).all(axis=2))
        if len(bad):
            name = self.made.compilation.state_space.variables[self.rows[bad[0, 1]]].name
            raise RunFailed("BR215", f"`{name}` has no finite slope at this state (t = {times[bad[0, 0]]:.9g} s)")
        return by_states(slopes, followed_unknowns(slopes[:, self.n : states.shape[1]], self.n), self.n)

    def begin(self) -> Array:
        """Return S at the start: from the author's start values, or from the equilibrium."""
        state = self.leg.state
        if self.made.plan.equilibrium:
            point = self.point(state, self.begins)
            reduced = point.reduced
            A, B = reduced.through(point.rate_slopes(reduced.chosen))
            moved = np.asarray(balanced_step(A, B)[0])
            return reduced.directions @ moved + reduced.following if reduced.tied else moved
        return self._assembled(self._slopes_of("starts", self.made.compilation.lowered.starts[: self.n]))

    def _assembled(self, moved: Array) -> Array:
        """Return S at a start with loop joints: derivatives of given start values hold, the others follow, if they are unique."""
        reduced = self.point(self.leg.state, self.begins).reduced
        if not reduced.tied:
            return moved
        given = np.array([s.given for s in self.made.compilation.state_space.states], dtype=bool)
        missed = moved - reduced.held(moved)
        size = np.abs(moved).max(initial=0.0) + np.abs(reduced.following).max(initial=0.0)
        if np.abs(missed).max(initial=0.0) <= TIED * size:
            return moved
        ways = reduced.directions[given]  # derivatives of the given start values by the free coordinates
        if np.linalg.matrix_rank(ways) < ways.shape[1]:
            raise UsageError(
                "BR242", "parameters move where a loop is closed at the start, and the model does not say which of its coordinates stay:",
                "give starts to as many as are free",
            )  # fmt: skip
        free, *_ = np.linalg.lstsq(ways, moved[given] - reduced.following[given], rcond=None)
        return np.asarray(reduced.directions @ free + reduced.following)

    def _slopes_of(self, word: str, roots: Sequence[Any]) -> Array:
        """Return derivatives of expressions of parameters alone, (len(roots), k)."""
        point = self.point(self.leg.state, self.begins)
        _, found = point.tape(f"{word} of a run", lambda: list(roots)).slopes(point.lookup, self.ways, self.k)
        return np.array([np.zeros(self.k) if x is None else x for x in found]).reshape(len(roots), self.k)

    def go(self, known: Partitions) -> tuple[Array, Array]:
        """Return values (t, m) and derivatives (t, m, k) of the outputs at the instants; add the partition to those that are known."""
        lowered = self.made.compilation.lowered
        read = {symbol for root in lowered.crossings for symbol in symbols(root)} | lowered.curves_in_modes()
        if any(symbol.key in self.ways for symbol in read):
            raise UsageError(
                "BR243", "an instant at which a signal jumps or bends moves with a parameter in a way that is not linear in time",
            )  # fmt: skip
        stretches, moved = self.segments, dict[tuple[int, float], Array]()
        first, maps = self.begin() / self.size * self.own, dict[Part, tuple[Array, Array]]()
        cuts, jumps = (*(s.stop for s in stretches), *self.instants.tolist()), list[tuple[Array, Array]]()
        parts = known.get(cuts) or [pair for number, s in enumerate(stretches) for pair in self._pairs(number, s)]
        while True:
            self._map({part for n, a, m, b in parts for part in ((n, a, b), (n, a, m), (n, m, b))} - maps.keys(), maps)
            jumps = jumps or self._over(*self._jumps())
            S, finer, number = first, [], 0
            for n, a, m, b in parts:
                for P, q in jumps[number:n]:
                    S = P @ S + q
                number = n
                (P, q), (P1, q1), (P2, q2) = maps[n, a, b], maps[n, a, m], maps[n, m, b]
                moved[n, a], moved[n, m] = S, P1 @ S + q1
                whole, S = P @ S + q, P2 @ moved[n, m] + q2
                if not self.bent.isdisjoint(((n, a, m), (n, m, b))):  # no node may be on one side of a kink
                    whole = moved[n, a]
                error = (whole - S) / (self.rtol * (RELATIVE * np.abs(S) + ABSOLUTE))
                if np.linalg.norm(error) <= math.sqrt(error.size):
                    finer.append((n, a, m, b))
                else:
                    finer += self._finer(n, a, m, b)
            if len(finer) == len(parts):
                break
            if len(finer) > MOST_PARTS:
                raise lost_at(finer[-1][1])
            parts = finer
        known[cuts] = parts
        for P, q in jumps[number:]:
            S = P @ S + q
        moved[len(stretches) - 1, stretches[-1].stop] = S
        return self._seen(moved)

    def _jumps(self) -> tuple[Array, Array]:
        """Return the known instants of jumps, and their derivatives (instants, k)."""
        program, constants, lowered = self.made.program, self.leg.constants, self.made.compilation.lowered
        jumps = [np.atleast_1d(program.instants(constants))]
        moving = [self._slopes_of("instants", lowered.instants)]
        if program.recurring is not None:
            ends = np.array([s.stop for s in self.segments[:-1]])
            pairs = np.reshape(program.recurring(constants), (-1, 2))
            slopes = self._slopes_of("recurring instants", [x for pair in lowered.recurring for x in pair])
            for (at_zero, rate), (by_zero, by_rate) in zip(pairs, slopes.reshape(len(pairs), 2, -1), strict=True):
                count = at_zero + rate * ends
                near = ends[np.abs(count - np.round(count)) <= SAME_INSTANT * np.maximum(np.abs(count), 1.0)]
                jumps.append(near)
                moving.append(-(by_zero + near[:, None] * by_rate) / rate if rate else np.zeros((len(near), self.k)))
        return np.concatenate(jumps), np.concatenate(moving)

    def _pairs(self, number: int, stretch: Segment) -> list[Parts]:
        """Return pairs of parts of a segment, between the reported instants."""
        inside = self.instants[(self.instants > stretch.start) & (self.instants < stretch.stop)].tolist()
        grid, pairs, i = [stretch.start, *inside, stretch.stop], list[Parts](), 0
        while i + 1 < len(grid) and stretch.stop > stretch.start:
            a, m, *after = grid[i : i + 3]
            # beside a much shorter part one is not halved
            is_pair = bool(after) and 0.5 <= (after[0] - m) / (m - a) <= 2
            pairs.append((number, a, m, after[0]) if is_pair else (number, a, (a + m) / 2, m))
            i += 1 + is_pair
        return pairs

    def _finer(self, number: int, start: float, middle: float, stop: float) -> list[Parts]:
        """Return both parts with halves of their own; sixteen, if there is a kink. Raises `RunFailed`."""
        if not stop - start > SAME_INSTANT * max(abs(start), abs(stop)):
            raise lost_at(start)
        count = 1 if self.bent.isdisjoint(((number, start, middle), (number, middle, stop))) else 8
        edges = np.concatenate([np.linspace(start, middle, count + 1), np.linspace(middle, stop, count + 1)[1:]])
        return [(number, a, (a + b) / 2, b) for a, b in pairwise(edges.tolist())]

    def _map(self, parts: Set[Part], maps: dict[Part, tuple[Array, Array]]) -> None:
        """Add the affine maps of S, in sizes of states and parameters, over some parts."""
        rows = np.array(sorted(parts)).reshape(-1, 3)
        start, stop = rows[:, 1], rows[:, 2]
        times = start[:, None] + (stop - start)[:, None] * np.array([0.0, *NODES])
        times[:, -1] = stop
        states, bends = self._states(times.ravel()).reshape(*times.shape, -1), self.made.program.bends
        for number in np.unique(rows[:, 0]).astype(int).tolist():
            own = np.flatnonzero(rows[:, 0] == number)
            stretch, at, x = (
                self.segments[number],
                times[own, 1:].ravel(),
                states[own, 1:].reshape(-1, states.shape[-1]),
            )
            self.mode = stretch.mode
            if bends is not None:
                signs = np.signbit(bends(times[own], states[own], self.leg.inputs, self.leg.constants, self.mode))
                bent = (signs != signs[:, :1]).any(axis=(1, 2))
                self.bent |= {(number, float(start[i]), float(stop[i])) for i in own[bent]}
            if x.shape[1] > self.n:
                for row in np.flatnonzero(at == stretch.stop):
                    x[row] = self.point(x[row], stretch.stop).state
            A, B = self._slopes(at, x, stretch.mode)
            A, B = A[:, : self.n] * self.size.T / self.size, B[:, : self.n] * self.own / self.size
            shape = len(own), len(NODES), self.n
            P, q = affine_steps((stop - start)[own], A.reshape(*shape, self.n), B.reshape(*shape, self.k))
            maps |= {(number, float(start[i]), float(stop[i])): (P[j], q[j]) for j, i in enumerate(own)}

    def _over(self, jumps: Array, moving: Array) -> list[tuple[Array, Array]]:
        """Return the affine maps of S, in sizes, over the ends of segments."""
        maps = []
        for number, (segment, state) in enumerate(zip(self.segments, self.starting, strict=True)):
            time, self.mode, self.unknowns = segment.start, segment.mode, state[self.n :]
            later = self.point(state, time)
            if not self._flipped(number):
                later.rate_slopes(range(self.n))  # refuses kinks
            if not number:
                continue
            self.mode = self.segments[number - 1].mode
            earlier = self.point(state, time)
            step = (earlier.rates - later.rates)[:, None] / self.size
            near = [i for i, t in enumerate(jumps) if abs(t - time) <= SAME_INSTANT * max(abs(time), 1e-300)]
            ways = [np.concatenate([np.zeros(self.n), moving[i]]) for i in near]
            if np.abs(step).max(initial=0.0) > JUMP * np.abs(later.rates / self.size[:, 0]).max(initial=0.0):
                ways += self._moved_crossings(earlier, self._flipped(number))
            way = ways[0] if ways else np.zeros(self.n + self.k)
            if any((np.abs(other - way) > SAME_INSTANT * np.abs(way)).any() for other in ways[1:]):
                raise UsageError(
                    "BR245", f"at t = {time:.9g} s two instants meet that move with parameters each in its own way: there is no derivative",
                )  # fmt: skip
            maps.append((np.eye(self.n) + step * way[: self.n] * self.size.T, step * way[self.n :] * self.own))
        return maps

    def _flipped(self, number: int) -> list[int]:
        """Return the conditions on states that end the segment before this one."""
        if not number or self.made.program.hybrid is None:
            return []
        before, after = self.segments[number - 1].mode, self.segments[number].mode
        return [k for k, c in enumerate(self.made.program.hybrid.conditions) if before[c.position] != after[c.position]]

    def _moved_crossings(self, point: OperatingPoint, flipped: Sequence[int]) -> list[Array]:
        """Return the derivatives (n + k,) of the instant at which conditions flip, by states and parameters; those that do not move before it follow
        from others. Raises `UsageError`."""
        located, width = self.made.compilation.lowered.events.located, self.n + self.k + 1
        unit, crossings = np.eye(width), list[Array]()
        ways = {Leaf("state", i): unit[i] for i in range(self.n)} | {Leaf("time", 0): unit[-1]}
        ways |= unit_directions(self.made.compilation, self.asked.by, width, self.n)
        for place in flipped:
            root = located[place].root
            (slope,) = point.tape(f"condition {place}", partial(list, (root,))).slopes(point.lookup, ways, width)[1]
            if slope is None or not slope.any():
                continue
            terms = np.append(slope[: self.n] * point.rates, slope[-1])
            behind = any(s.key.role == "state" and s.key.position >= self.n for s in symbols(root))
            if behind or not abs(terms.sum()) > GRAZING * np.abs(terms).sum():
                crossings = []
                break
            crossings.append(-slope[:-1] / terms.sum())
        if flipped and not crossings:
            raise UsageError(
                "BR279", f"at t = {point.time:.9g} s the rates jump where a condition only touches its threshold, or reads what a loop decides: "
                "there is no derivative",
            )  # fmt: skip
        return crossings

    def _seen(self, moved: Mapping[tuple[int, float], Array]) -> tuple[Array, Array]:
        """Return values and derivatives of the outputs at the instants, from the derivatives of the states by segment and time."""
        times, states, stretches = self.instants, self.reported, self.segments
        if self.leg.watch.warnings:
            raise refused_limit(self.leg.watch.warnings[0])
        numbers = np.searchsorted([s.start for s in stretches], times, "right") - 1
        values, slopes = [], []
        outputs, variables = len(self.made.program.outputs.names), self.made.compilation.state_space.outputs.values()
        for number in np.unique(numbers).tolist():
            stretch, rows = stretches[number], np.flatnonzero(numbers == number)
            self.mode, x = stretch.mode, states[rows]
            if self.leg.constraints:
                x = np.array(
                    [self.leg.constraints.project(t, y, self.mode) for t, y in zip(times[rows], x, strict=True)]
                )
            starts = times[rows[0]] == stretch.start
            if starts:
                self.unknowns = x[0, self.n :]
                point = self.point(x[0], stretch.start)
                x[0] = point.state
            by_state, by_parameter = self._slopes(times[rows], x, self.mode)
            if starts and not self._flipped(number):
                by_state[0, -outputs:], by_parameter[0, -outputs:] = point.reduced.by_states(point.slopes([*variables]))
            S = np.array([moved[number, t] for t in times[rows].tolist()]) * self.size / self.own
            kept = slice(x.shape[1], by_state.shape[1] - outputs)
            if kept.stop > kept.start:
                S = S - self.size * tied_step(
                    by_state[:, kept] * self.size.T, by_state[:, kept] @ S + by_parameter[:, kept]
                )
            slopes.append(by_state[:, -outputs:] @ S + by_parameter[:, -outputs:])
            values.append(self.made.program.output(times[rows], x, self.leg.inputs, self.leg.constants, self.mode))
        return np.concatenate(values), np.concatenate(slopes)
