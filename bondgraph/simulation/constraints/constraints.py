"""Projection of states on their invariants: residuals of loop joints, norms of quaternions, and the rates of the residuals.

Positions first: the least change, in units of the magnitudes of the states, that makes the residuals vanish (Gauss-Newton to round-off); then
the least change of the speeds that makes their rates vanish, which is linear. Both use the Cholesky factors of J J', or the singular values where
rows are dependent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Program

from ..integrators.projection.limits import ITERATIONS, NOISE, ROUNDING, WEAK
from ..loops.loops import LoopSolver
from ..segments.run_values import RunValues

if TYPE_CHECKING:
    from ..integrators.compiled.constraint_functions import CompiledConstraints

RANK = 1e-8  # relative to the largest singular value: smaller ones count as lost rank at this pose
NO_SLOPE = 1e-9  # relative to an angle: smaller derivatives are rounding


@dataclass(frozen=True, slots=True)
class Assembled:
    """Facts on the constraints at the start."""

    mobility: int  # number of coordinates (of speeds, where some constrain rates alone) minus number of independent constraints
    redundant: tuple[str, ...]  # constraints that follow from others


def _places(program: Program) -> tuple[Any, ...]:
    """Return the number of residuals, the pattern of their slopes, the indices of their rates, of the states that residuals and that their rates depend on,
    and a mask of residuals that are lengths."""
    gaps = len(program.invariants.names) - sum(row >= 0 for row in program.rates)
    rows, columns = (np.asarray(a, dtype=int) for a in program.invariant_pattern)
    # numpy.unique is avoided: it loads masked arrays, which takes a tenth of the time of a short run.
    positions, speeds = (
        np.flatnonzero(np.bincount(columns[which], minlength=len(program.states.names)))
        for which in (rows < gaps, rows >= gaps)
    )
    lengths = np.array([u == "m" for u in program.invariants.units[:gaps]], dtype=bool)
    pattern = gaps, rows, columns, np.array(program.rates, dtype=int), positions, speeds, lengths
    program.kept["places"] = pattern
    return pattern


class Constraints:
    """Invariants of a program. `parameters` decide which rows are active; `magnitude`: of its states (and unknowns), shape (n,)."""

    def __init__(
        self, program: Program, parameters: Array, inputs: Array, magnitude: Array, values: RunValues | None = None
    ) -> None:
        """`values`: the same parameters and inputs, with answers for them."""
        self.program, self.parameters, self.inputs = program, np.array(parameters, dtype=float), inputs
        self.constants = program.constants(self.parameters) if values is None else values.constants
        self.known = values
        self.count = len(program.states.names)
        self.all = len(program.multipliers)  # residuals first, then the constraints on rates alone
        places = program.kept.get("places") or _places(program)
        self.gaps: int = places[0]
        _, self.rows, self.columns, self.rate_rows, self.positions, self.speeds, self.lengths = places
        self.taking = np.ones(self.all, dtype=bool)
        self.assembled: Assembled | None = None
        self._compiled: CompiledConstraints | None = None
        self._no_loops: LoopSolver | None = None  # the last solver, which without loops is always the same
        self.scale(magnitude)

    def name_of(self, constraint: int) -> str:
        """Return the name of a constraint; those on rates alone come after the residuals."""
        names = self.program.invariants.names
        return (
            names[constraint] if constraint < self.gaps else names[self.rate_rows[constraint]].removeprefix("rate of ")
        )

    def scale(self, magnitude: Array) -> None:
        """Set the magnitudes by which changes are measured."""
        self.magnitude = np.array(magnitude, dtype=float)
        self.reach = self.magnitude[: self.count]
        self.turning = 1.0  # magnitude of the angles
        if self.all:  # without constraints there is nothing to rebuild
            turns = [p for p in self.positions if self.program.states.units[p] == "1"]
            self.turning = float(self.reach[turns].max(initial=0.0)) or 1.0
            self._compiled = None

    def __bool__(self) -> bool:
        return self.all > 0

    @property
    def taking_gaps(self) -> Any:
        """Mask of the active residuals."""
        return self.taking[: self.gaps]

    @property
    def taking_rates(self) -> Any:
        """Mask of the active rows among the rates of the residuals."""
        return self.rate_rows[self.taking & (self.rate_rows >= 0)] - self.gaps

    def loops(self, magnitude: Array | None = None) -> LoopSolver:
        """Return the solver of the program's loops with these inputs and parameters; `magnitude`: of states and unknowns, if they are known."""
        if not self.program.unknowns.names and self._no_loops is not None:
            return self._no_loops
        self._no_loops = LoopSolver(self.program, self.constants, self.inputs, magnitude, self.parameters)
        return self._no_loops

    def leave_out(self, taking: Any) -> None:
        """Deactivate redundant rows, here and, through the program's own parameters, in its equations."""
        self.taking = taking
        for place, takes in zip(self.program.parts, taking, strict=True):
            if place >= 0:
                self.parameters[place] = float(takes)
        self.constants = self.program.constants(self.parameters)
        self._compiled = self._no_loops = None

    def recall(
        self, kind: str, key: tuple[object, ...], find: Callable[[], Any], size: Callable[[Any], int] = lambda answer: 1
    ) -> Any:
        """Return what an earlier run with these parameters has found, else find it. The key has everything else that it depends on, but for the
        active rows and the magnitudes. What delayed signals decide is found again."""
        if self.known is None or self.program.delays is not None:
            return find()
        return self.known.recall(kind, (*key, self.taking.tobytes(), self.magnitude.tobytes()), find, size)

    @property
    def compiled(self) -> CompiledConstraints | None:
        """Native version of the constraints, if the program has machine code."""
        return self.always_compiled(True) if self.all and self.program.native is not None else None

    def always_compiled(self, native: bool) -> CompiledConstraints:
        """Constraints for the source of the steps, empty if there are none; `native`: in machine code."""
        if self._compiled is None or self._compiled.native != native:
            from ..integrators.compiled.constraint_functions import CompiledConstraints

            # without constraints no step reads it, so all runs share one
            shared = {} if self.all or self.program.eliminated else self.program.kept
            if ("no constraints", native) not in shared:
                shared["no constraints", native] = CompiledConstraints(self, native)
            self._compiled = shared["no constraints", native]
        return self._compiled

    # ------------------------------------------------------------ values and Jacobians
    def values(self, time: float, state: Array, mode: Array) -> Any:
        """Return all invariants: residuals, then their rates."""
        return np.asarray(self.program.invariant(time, state, self.inputs, self.constants, mode))

    def slopes(self, time: float, state: Array, mode: Array) -> tuple[Any, Any]:
        """Return the Jacobians of the residuals by the positions and of their rates by the speeds; dense, in units of the magnitudes."""
        entries = self.program.invariant_slopes(time, state, self.inputs, self.constants, mode)
        whole = np.zeros((len(self.program.invariants.names), self.count))
        whole[self.rows, self.columns] = entries * self.reach[self.columns]
        return whole[: self.gaps][:, self.positions], whole[self.gaps :][:, self.speeds]

    def length(self, time: float, state: Array, mode: Array) -> float:
        """Return the length of the mechanism in m: the longest lever arm from an angle to a residual; 0 if there is none."""
        entries = np.asarray(self.program.invariant_slopes(time, state, self.inputs, self.constants, mode))
        arms = [
            abs(entry)
            for entry, row, column in zip(entries, self.rows, self.columns, strict=True)
            if row < self.gaps and self.lengths[row] and self.program.states.units[column] == "1"
        ]
        return float(max(arms, default=0.0))

    def rolling_speed(self, time: float, state: Array, mode: Array) -> float:
        """Return the largest term, in m/s, of a constraint on rates alone; 0 if there is none. Where such terms cancel, a speed is rounding of them."""
        alone = [row for row in self.rate_rows[self.gaps :] if self.program.invariants.units[row] == "m/s"]
        if not alone:
            return 0.0
        entries = np.asarray(self.program.invariant_slopes(time, state, self.inputs, self.constants, mode))
        return float(np.abs(entries * state[self.columns])[np.isin(self.rows, alone)].max(initial=0.0))

    def sizes(self, slopes: Array) -> Any:
        """Return the size of each residual row: rows of one unit share the largest norm, because a row whose derivatives vanish is still a length.

        Where the derivatives of all angular rows vanish (a planar loop in space), rounding must not be the size: then it is that of the angles among the
        positions.
        """
        norms = np.linalg.norm(slopes, axis=1)
        result = np.ones(self.gaps)
        for same in (self.lengths, ~self.lengths):
            if same.any():
                result[same] = norms[same].max() or 1.0
        result[~self.lengths & (result < NO_SLOPE * self.turning)] = self.turning
        return result

    # ------------------------------------------------------------ projection
    def project(self, time: float, state: Array, mode: Array) -> Any:
        """Return the nearest state that satisfies all invariants."""
        if not self.all:
            return state
        if self.compiled is not None:
            return self.project_all(np.array([time]), np.asarray(state)[None], mode)[0]
        return self._projected(time, state, mode)

    def project_by(self, taking: Any, time: float, state: Array, mode: Array) -> Any:
        """Return the nearest state that satisfies the invariants chosen by the mask `taking`."""
        all_of_them, self.taking = self.taking, taking
        try:
            return self._projected(time, state, mode)
        finally:
            self.taking = all_of_them

    def _projected(self, time: float, state: Array, mode: Array) -> Any:
        state = self._closed(time, np.array(state, dtype=float), mode)
        rows = self.taking_rates
        if len(rows):
            _, slopes = self.slopes(time, state, mode)
            solver = Least(slopes[rows])
            for _ in range(2):
                state[self.speeds] -= self.reach[self.speeds] * solver.solve(
                    self.values(time, state, mode)[self.gaps + rows]
                )
        return state

    def _closed(self, time: float, state: Array, mode: Array) -> Any:
        """Return the state with vanishing residuals, by Newton's method with the Jacobian of its first state as long as it converges."""
        taking, solver, before, size = self.taking_gaps, None, np.inf, 1.0
        for _ in range(ITERATIONS):
            gap = self.values(time, state, mode)[: self.gaps][taking]
            worst = float(np.abs(gap / size).max(initial=0.0))
            if not worst > ROUNDING:
                break
            if worst > 0.1 * before:
                if worst < NOISE:
                    break
                solver = None
            if solver is None:
                slopes, _ = self.slopes(time, state, mode)
                size = self.sizes(slopes)[taking]
                solver = Least(slopes[taking])
            state[self.positions] -= self.reach[self.positions] * solver.solve(gap)
            before = worst
        return state

    def tangents(self, time: float, state: Array, mode: Array) -> Any:
        """Orthonormal directions (columns, in units of the magnitudes) in which states may vary on the constraints: of positions, of speeds, of the rest."""
        gaps, rates = self.slopes(time, state, mode)
        free = np.setdiff1d(np.arange(self.count), np.concatenate([self.positions, self.speeds]))
        columns = [np.eye(self.count)[:, free]]
        for slopes, places in ((gaps[self.taking_gaps], self.positions), (rates[self.taking_rates], self.speeds)):
            full = np.zeros((self.count, len(places)))
            full[places, np.arange(len(places))] = 1.0
            columns.append(full @ null_space(slopes))
        return np.concatenate(columns, axis=1)

    def project_all(self, times: Array, states: Array, mode: Array) -> Any:
        """Project the states at several instants; shape (times, n)."""
        if not self.all:
            return states
        if self.compiled is None:
            return np.stack([self._projected(t, x, mode) for t, x in zip(times, states, strict=True)])
        held, weak = self.compiled.project(times, states, mode)
        for k in np.flatnonzero(weak):  # rows are dependent there: use singular values
            held[k] = self._projected(times[k], states[k], mode)
        return held

    def missed(self, time: float, state: Array, mode: Array) -> float:
        """Return the largest remaining residual, relative to its size."""
        slopes, _ = self.slopes(time, state, mode)
        return float(np.abs(self.values(time, state, mode)[: self.gaps] / self.sizes(slopes)).max(initial=0.0))


class Least:
    """Minimum-norm solution of `slopes @ step = gap` (Jacobian, step, residual)."""

    def __init__(self, slopes: Array) -> None:
        self.slopes = slopes
        self.factor = self._cholesky()

    def _cholesky(self) -> Any:
        from scipy.linalg import lapack

        rows = np.linalg.norm(self.slopes, axis=1)
        if not (rows > 0).all():
            return None
        scaled = self.slopes / rows[:, None]
        factor, info = lapack.dpotrf(scaled @ scaled.T, lower=True)
        if info != 0 or np.diag(factor).min(initial=1.0) < WEAK:
            return None
        return lambda gap: scaled.T @ lapack.dpotrs(factor, gap / rows, lower=True)[0]

    def solve(self, gap: Array) -> Any:
        """Return the step for a residual."""
        if self.factor is not None:
            return self.factor(gap)
        step, *_ = np.linalg.lstsq(self.slopes, gap, rcond=RANK)
        return step


def null_space(slopes: Array) -> Any:
    """Return orthonormal columns that span the null space of the Jacobian, whose rows must be independent."""
    if not len(slopes):
        return np.eye(slopes.shape[1])
    q, _ = np.linalg.qr(slopes.T, mode="complete")
    return q[:, len(slopes) :]
