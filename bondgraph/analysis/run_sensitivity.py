"""Sensitivity of a run to parameters: the derivatives of its outputs at every instant, integrated together with the states.

With S = dx/dp the derivatives of the states follow S' = f_x S + f_p (forward sensitivities; Hindmarsh et al., ACM Trans. Math. Softw. 31, 2005),
with the exact derivatives of the compiled equations; unknowns of loops are eliminated. States and S are one system for Radau IIA of order 5
(`scipy.integrate`), whose Newton matrix has f_x on its diagonal blocks: the missing coupling costs iterations and no accuracy. Where the instant
of a jump of the right-hand side depends on a parameter, S jumps by (f before - f after) times the derivative of the instant.
Loop joints tie states: with their multipliers eliminated f is defined for all states and preserves the constraints, and so S preserves their
derivative, g_x S + g_p = 0, which holds at the start; rounding of the integration is corrected at each reported instant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, symbols

from ..compiled_model import CompiledModel
from ..errors import RunFailed, UsageError
from ..rendering import OfModel, Summarised
from ..results.json_values import head, named, with_units
from .movable import refuse_structural
from .operating_point import AnalysisRequest, OperatingPoint
from .sensitivity import balanced_step, independent, place_in, unit_directions
from .singular_slopes import Beside

SCHEMA = "bondgraph-run-sensitivity/1"
RTOL = 1e-8
SAME_INSTANT = 1e-12  # relative difference of equal instants
TIED = 1e-9  # relative to the derivatives at a start: remainder under the constraints of loop joints


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
    rtol: float = RTOL, moved: Mapping[str, float] | None = None,
) -> RunSensitivity:  # fmt: skip
    """Return the sensitivity of a run by parameters (None: all independent ones), at `instants` (t,).

    `instants` may also be the time at which the run ends (None: that of the experiment) and the number of instants.
    `moved`: values of the parameters, as for `operating_point`. Raises `CompilationFailed`, `UsageError` for models that jump with states, `RunFailed`.
    """
    from ..simulation.run_options import end_of
    from ..simulation.settings import settle

    by, fixed = independent(model, parameters, asked.experiment, asked.settings or {})
    settled = settle(model, asked.experiment, fixed, asked.outputs, True, "numpy")
    made = model.compiled_scene(replace(settled.scene, free=frozenset(by), by=by), True, "numpy")
    refuse_structural(made.compilation, by)
    plan = made.plan
    if isinstance(instants, tuple):
        to, points = instants
        instants = np.linspace(plan.start, end_of(plan, to), points)
    if instants[0] < plan.start:
        raise UsageError("BR238", f"a run begins at {plan.start:g} s: nothing is known of t = {instants[0]:g} s")
    asked = replace(asked, settings=fixed, by=by)
    flow = LinearizedDynamics(made, asked, instants, {**settled.values, **(moved or {})}, rtol)
    with np.errstate(all="ignore"):
        values, slopes = flow.go()
    program = made.program
    units = dict(zip(program.outputs.names, program.outputs.units, strict=True))
    units |= {n: q.unit for n, q in made.compilation.whole_graph.quantities.items() if n in by}
    return RunSensitivity(
        program.name, plan.experiment, instants, program.outputs.names, by, flow.point(flow.leg.state, flow.begins).values_of(by), values, slopes, units
    )  # fmt: skip


class PointInside(OperatingPoint):
    """Operating point inside a segment of a run, which passes kinks without staying there: the start of the segment is searched for them."""

    def smoothed(self, beside: Beside, found: Array, name: Callable[[int], str]) -> Array:
        """Return the slopes unchanged."""
        return found


class LinearizedDynamics:
    """States and their derivatives along the segments of a run."""

    def __init__(self, made: Any, asked: AnalysisRequest, instants: Array, values: Mapping[str, float], rtol: float) -> None:  # fmt: skip
        from ..simulation.phase import Phase, PhaseOptions

        program = made.program
        if program.hybrid is not None or program.delays is not None:
            raise UsageError(
                "BR239", "events, conditions on states and delays have no derivatives here: no sensitivities of runs are made of them",
            )  # fmt: skip
        if made.facts.claims:
            raise UsageError(
                "BR240", "starts that are given to what is computed: no sensitivities of runs are made of them"
            )
        self.ways = unit_directions(made.compilation, asked.by, len(asked.by))  # of the symbols of the parameters
        self.made, self.asked, self.instants, self.rtol, self.values = made, asked, instants, rtol, values
        self.begins = self.after = made.plan.start  # after the start of a segment points are inside
        span = np.concatenate([[self.begins], instants[instants > self.begins]])
        if len(span) < 2:
            raise UsageError("BR241", "a run has an end after its start")
        self.leg = Phase(made, span, PhaseOptions(replace(made.plan, tolerances={}), 1e-6, None, False, values))
        self.n, self.k, self.size = len(program.states.names), len(asked.by), len(self.leg.state)
        self.loops = self.leg.constraints.loops()
        self.mode, self.unknowns = self.leg.stretches[0].mode, self.leg.state[self.n :]

    def point(self, state: Array, time: float, inside: bool = False) -> OperatingPoint:
        """Return the operating point at a state (n,), with the unknowns solved for."""
        full = self.loops.solve(time, np.concatenate([state[: self.n], self.unknowns]), self.mode)
        self.unknowns = full[self.n :]
        kind = PointInside if inside else OperatingPoint
        return kind(self.made, self.leg.constraints, full, self.mode, time, self.asked.by, self.values)

    def rates(self, time: float, y: Array) -> Array:
        """Return the rates of the states, then of S row by row."""
        point = self.point(y[: self.n], time, inside=time > self.after)
        A, B = point.reduced.by_states(point.rate_slopes(range(self.n)))
        return np.concatenate([point.rates, (A @ y[self.n :].reshape(self.n, self.k) + B).ravel()])

    def jacobian(self, time: float, y: Array) -> Array:
        """Return the diagonal blocks of the Jacobian."""
        point = self.point(y[: self.n], time, inside=time > self.after)
        A, _ = point.reduced.by_states(point.rate_slopes(range(self.n)))
        whole = np.zeros((len(y), len(y)))
        whole[: self.n, : self.n] = A
        whole[self.n :, self.n :] = np.kron(A, np.eye(self.k))
        return whole

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

    def go(self) -> tuple[Array, Array]:
        """Return values (t, m) and derivatives (t, m, k) of the outputs at the instants."""
        lowered = self.made.compilation.lowered
        read = {symbol for root in lowered.crossings for symbol in symbols(root)} | lowered.curves_in_modes()
        if any(symbol.key in self.ways for symbol in read):
            raise UsageError(
                "BR243", "an instant at which a signal jumps or bends moves with a parameter in a way that is not linear in time",
            )  # fmt: skip
        jumps, moving = self._jumps()
        y = np.concatenate([self.leg.state[: self.n], self.begin().ravel()])
        size = self._sizes()
        values, slopes = [], []
        stretches = self.leg.stretches
        for number, stretch in enumerate(stretches):
            self.mode, self.after = stretch.mode, stretch.start
            last = number + 1 == len(stretches)
            inside = [float(t) for t in self.instants if stretch.start <= t and (t < stretch.stop or last)]
            for time, state in self._along(stretch, y, inside, size):
                if time in inside:
                    value, slope = self._seen(time, state)
                    values.append(value)
                    slopes.append(slope)
                y = state
            if not last:
                y = self._over(stretch.stop, y, stretches[number + 1].mode, jumps, moving)
        return np.array(values), np.array(slopes)

    def _jumps(self) -> tuple[Array, Array]:
        """Return the known instants of jumps, and their derivatives (instants, k)."""
        program, constants, lowered = self.made.program, self.leg.constants, self.made.compilation.lowered
        jumps = [np.atleast_1d(program.instants(constants))]
        moving = [self._slopes_of("instants", lowered.instants)]
        if program.recurring is not None:
            ends = np.array([s.stop for s in self.leg.stretches[:-1]])
            pairs = np.reshape(program.recurring(constants), (-1, 2))
            slopes = self._slopes_of("recurring instants", [x for pair in lowered.recurring for x in pair])
            for (at_zero, rate), (by_zero, by_rate) in zip(pairs, slopes.reshape(len(pairs), 2, -1), strict=True):
                count = at_zero + rate * ends
                near = ends[np.abs(count - np.round(count)) <= SAME_INSTANT * np.maximum(np.abs(count), 1.0)]
                jumps.append(near)
                moving.append(-(by_zero + near[:, None] * by_rate) / rate if rate else np.zeros((len(near), self.k)))
        return np.concatenate(jumps), np.concatenate(moving)

    def _sizes(self) -> Array:
        """Return magnitudes of the states, and of S: the change of a state for a parameter change of its own size."""
        states = np.asarray(self.leg._magnitudes())[: self.n]
        own = np.abs(self.point(self.leg.state, self.begins).values_of(self.asked.by))
        return np.concatenate([states, np.outer(states, 1 / np.where(own > 0, own, 1.0)).ravel()])

    def _along(self, stretch: Any, y: Array, inside: Sequence[float], size: Array) -> list[tuple[float, Array]]:
        """Return the reported instants of a segment, and its end, with states and S."""
        from scipy.integrate import solve_ivp

        if not len(y) or stretch.stop <= stretch.start:
            return [(t, y) for t in (*inside, stretch.stop)]
        at = sorted({*inside, float(stretch.stop)})
        done = solve_ivp(
            self.rates, (stretch.start, stretch.stop), y, "Radau", at, jac=self.jacobian, rtol=self.rtol, atol=self.rtol * 1e-2 * size
        )  # fmt: skip
        if not done.success:
            raise RunFailed(
                "BR244", f"the derivatives could not be followed beyond t = {done.t[-1] if len(done.t) else stretch.start:.9g} s: {done.message}",
            )  # fmt: skip
        return list(zip(at, done.y.T, strict=True))

    def _over(self, time: float, y: Array, mode: Array, jumps: Array, moving: Array) -> Array:
        """Return S after an instant that depends on parameters."""
        near = [i for i, t in enumerate(jumps) if abs(t - time) <= SAME_INSTANT * max(abs(time), 1e-300)]
        way = moving[near[0]] if near else np.zeros(self.k)
        if not way.any():
            self.mode = mode
            return y
        if any((moving[i] != way).any() for i in near[1:]):
            raise UsageError(
                "BR245", f"at t = {time:.9g} s two instants meet that move with parameters each in its own way: there is no derivative",
            )  # fmt: skip
        before = self.point(y[: self.n], time).rates
        self.mode = mode
        after = self.point(y[: self.n], time).rates
        return np.concatenate([y[: self.n], y[self.n :] + np.outer(before - after, way).ravel()])

    def _seen(self, time: float, y: Array) -> tuple[Array, Array]:
        constraints = self.leg.constraints
        state = np.concatenate([y[: self.n], self.unknowns])
        if constraints:
            state = constraints.project(time, state, self.mode)
        point = self.point(state, time).check_limits()
        outputs = list(point.compilation.state_space.outputs.values())
        C, D = point.reduced.by_states(point.slopes(outputs))
        return point.outputs, C @ point.reduced.held(y[self.n :].reshape(self.n, self.k)) + D
