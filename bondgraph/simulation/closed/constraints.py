"""States held on their invariants: gaps of closing joints and norms of quaternions, and the rates of gaps.

Position first: the least change, in units of the magnitudes of the states, that closes the gaps (Gauss-Newton to round-off); then the
least change of the speeds that makes the gaps stand still, which is linear. Small systems go through the Cholesky factors of J J',
large ones through a sparse augmented matrix, both through the singular values where the rows hang together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...door import Program

if TYPE_CHECKING:
    from ..steps.compiled.held import CompiledConstraints, NothingHeld

ITERATIONS = 20
ROUNDING = 4e-16  # of the size of a gap: closer it cannot be
NOISE = 1e-13  # of that size: what is left of large positions that are subtracted
DENSE = 60  # rows up to which the linear algebra is dense
RANK = 1e-8  # of the largest singular value: rows that lose more say nothing at this pose
NO_SLOPE = 1e-9  # of an angle: slopes that are rounding
WEAK = 1e-5  # smallest pivot of a Cholesky factor that is trusted


@dataclass(frozen=True, slots=True)
class Assembled:
    """What is known of the constraints at the start."""

    mobility: int  # coordinates less independent constraints
    redundant: tuple[str, ...]  # constraints that follow from others


class Constraints:
    """The invariants of a program. `parameters` say which rows take part; `magnitude`: of its states (and unknowns), shape (n,)."""

    def __init__(self, program: Program, parameters: Any, inputs: Any, magnitude: Any) -> None:
        self.program, self.parameters, self.inputs = program, np.array(parameters, dtype=float), inputs
        self.constants = program.constants(self.parameters)
        self.count = len(program.states.names)
        self.gaps = len(program.multipliers)
        self.rate_rows = np.array(program.rates, dtype=int)
        self.rows, self.columns = (np.asarray(a, dtype=int) for a in program.invariant_pattern)
        of_gaps = self.rows < self.gaps
        # Not by numpy.unique, which loads masked arrays: a tenth of what a short run takes.
        self.positions = np.flatnonzero(np.bincount(self.columns[of_gaps], minlength=self.count))
        self.speeds = np.flatnonzero(np.bincount(self.columns[~of_gaps], minlength=self.count))
        self.taking = np.ones(self.gaps, dtype=bool)
        self.lengths = np.array([u == "m" for u in program.invariants.units[: self.gaps]], dtype=bool)
        self.assembled: Assembled | None = None
        self._compiled: CompiledConstraints | None = None
        self.scale(magnitude)

    def scale(self, magnitude: Any) -> None:
        """The magnitudes that a change is measured by."""
        self.magnitude = np.array(magnitude, dtype=float)
        self.reach = self.magnitude[: self.count]
        turns = [p for p in self.positions if self.program.states.units[p] == "1"]
        self.turning = float(self.reach[turns].max(initial=0.0)) or 1.0  # of the angles
        if self.gaps:  # else it holds nothing that could change
            self._compiled = None

    def __bool__(self) -> bool:
        return self.gaps > 0

    @property
    def taking_rates(self) -> Any:
        """Among the rates of gaps, those of the rows that take part."""
        return self.rate_rows[self.taking & (self.rate_rows >= 0)] - self.gaps

    def leave_out(self, taking: Any) -> None:
        """Rows that are redundant take no part: neither here, nor, by the program's own parameters, in its equations."""
        self.taking = taking
        for place, takes in zip(self.program.parts, taking, strict=True):
            if place >= 0:
                self.parameters[place] = float(takes)
        self.constants = self.program.constants(self.parameters)
        self._compiled = None

    @property
    def compiled(self) -> CompiledConstraints | None:
        """The same in machine code, if the program has some."""
        return self._made() if self.gaps and self.program.native is not None else None

    @property
    def always_compiled(self) -> CompiledConstraints | NothingHeld:
        """The same, empty where nothing is held; a program with machine code."""
        if self.gaps or self.program.eliminated:
            return self._made()
        from ..steps.compiled.held import nothing_held

        return nothing_held()

    def _made(self) -> CompiledConstraints:
        if self._compiled is None:
            from ..steps.compiled.held import CompiledConstraints

            self._compiled = CompiledConstraints(self)
        return self._compiled

    # ------------------------------------------------------------ values and slopes
    def values(self, time: float, state: Any, mode: Any) -> Any:
        """All invariants: gaps, then rates of gaps."""
        return np.asarray(self.program.invariant(time, state, self.inputs, self.constants, mode))

    def slopes(self, time: float, state: Any, mode: Any) -> tuple[Any, Any]:
        """Of the gaps by the positions, and of their rates by the speeds; dense, in units of the magnitudes."""
        entries = self.program.invariant_slopes(time, state, self.inputs, self.constants, mode)
        whole = np.zeros((len(self.program.invariants.names), self.count))
        whole[self.rows, self.columns] = entries * self.reach[self.columns]
        return whole[: self.gaps][:, self.positions], whole[self.gaps :][:, self.speeds]

    def length(self, time: float, state: Any, mode: Any) -> float:
        """That of the mechanism, m: the longest arm with which an angle opens a gap; 0 if there is none."""
        entries = np.asarray(self.program.invariant_slopes(time, state, self.inputs, self.constants, mode))
        arms = [
            abs(entry)
            for entry, row, column in zip(entries, self.rows, self.columns, strict=True)
            if row < self.gaps and self.lengths[row] and self.program.states.units[column] == "1"
        ]
        return float(max(arms, default=0.0))

    def sizes(self, slopes: Any) -> Any:
        """How large a gap of each row can be: rows of one unit share the largest, as one that loses its slopes is still a length.

        Where all angles have lost theirs (a planar loop in space), rounding is no size: then it is that of the angles among the positions.
        """
        norms = np.linalg.norm(slopes, axis=1)
        result = np.ones(self.gaps)
        for same in (self.lengths, ~self.lengths):
            if same.any():
                result[same] = norms[same].max() or 1.0
        result[~self.lengths & (result < NO_SLOPE * self.turning)] = self.turning
        return result

    # ------------------------------------------------------------ projection
    def project(self, time: float, state: Any, mode: Any) -> Any:
        """The nearest state that keeps all invariants."""
        if not self.gaps:
            return state
        if self.compiled is not None:
            return self.project_all(np.array([time]), np.asarray(state)[None], mode)[0]
        return self._projected(time, state, mode)

    def project_by(self, taking: Any, time: float, state: Any, mode: Any) -> Any:
        """The nearest state that keeps some of the invariants; `taking`: which gaps."""
        all_of_them, self.taking = self.taking, taking
        try:
            return self._projected(time, state, mode)
        finally:
            self.taking = all_of_them

    def _projected(self, time: float, state: Any, mode: Any) -> Any:
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

    def _closed(self, time: float, state: Any, mode: Any) -> Any:
        """The gaps closed, by Newton's method with the slopes of its first state while these serve."""
        taking, solver, before, size = self.taking, None, np.inf, 1.0
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

    def tangents(self, time: float, state: Any, mode: Any) -> Any:
        """Orthonormal directions (columns, in units of the magnitudes) in which states may differ on the constraints: of positions,
        of speeds, and of all other states."""
        gaps, rates = self.slopes(time, state, mode)
        free = np.setdiff1d(np.arange(self.count), np.concatenate([self.positions, self.speeds]))
        columns = [np.eye(self.count)[:, free]]
        for slopes, places in ((gaps[self.taking], self.positions), (rates[self.taking_rates], self.speeds)):
            full = np.zeros((self.count, len(places)))
            full[places, np.arange(len(places))] = 1.0
            columns.append(full @ null_space(slopes))
        return np.concatenate(columns, axis=1)

    def project_all(self, times: Any, states: Any, mode: Any) -> Any:
        """The same for several instants; shape (times, n)."""
        if not self.gaps:
            return states
        if self.compiled is None:
            return np.stack([self._projected(t, x, mode) for t, x in zip(times, states, strict=True)])
        held, weak = self.compiled.hold(times, states, mode)
        for k in np.flatnonzero(weak):  # rows hang together there: by singular values
            held[k] = self._projected(times[k], states[k], mode)
        return held

    def missed(self, time: float, state: Any, mode: Any) -> float:
        """The largest gap that is left, as a share of its size."""
        slopes, _ = self.slopes(time, state, mode)
        return float(np.abs(self.values(time, state, mode)[: self.gaps] / self.sizes(slopes)).max(initial=0.0))


class Least:
    """The shortest solution of slopes @ step = gap."""

    def __init__(self, slopes: Any) -> None:
        self.slopes = slopes
        self.factor = self._sparse() if len(slopes) > DENSE else self._cholesky()

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

    def _sparse(self) -> Any:
        from scipy.sparse import block_array, csc_array, eye_array
        from scipy.sparse.linalg import splu

        count = self.slopes.shape[1]
        rows = np.linalg.norm(self.slopes, axis=1)
        if not (rows > 0).all():
            return None
        scaled = csc_array(self.slopes / rows[:, None])
        try:
            factor = splu(block_array([[eye_array(count), scaled.T], [scaled, None]], format="csc"))
        except RuntimeError:
            return None
        if np.abs(factor.U.diagonal()).min() < WEAK**2:
            return None
        return lambda gap: factor.solve(np.concatenate([np.zeros(count), gap / rows]))[:count]

    def solve(self, gap: Any) -> Any:
        """The step for a gap."""
        if self.factor is not None:
            return self.factor(gap)
        step, *_ = np.linalg.lstsq(self.slopes, gap, rcond=RANK)
        return step


def null_space(slopes: Any) -> Any:
    """Orthonormal columns that the slopes map to nothing; for rows that are independent."""
    if not len(slopes):
        return np.eye(slopes.shape[1])
    q, _ = np.linalg.qr(slopes.T, mode="complete")
    return q[:, len(slopes) :]
