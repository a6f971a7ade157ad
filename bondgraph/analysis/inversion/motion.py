"""States and inputs along a path: Newton's method on the equations of all instants at once.

Where the outputs determine everything, each instant is solved separately. Otherwise the internal dynamics are integrated along with them by the
Radau IIA method of order 5 (Hairer and Wanner, Solving ODEs II, 1996, IV.5), all steps in one sparse system. This includes growing motions: they
have a condition at the end instead of the beginning, so that they stay bounded (Devasia, Chen and Paden, IEEE Trans. Autom. Control 41, 1996).
Inputs then begin before the outputs do.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray

from ...errors import RunFailed
from ...numerics.scales import group_numbers, largest_of_group, nonzero
from .equations import Evaluated, InversionEquations, together

ITERATIONS = 25
CLOSE = 1e-13  # relative to the magnitudes: size of the last step
ENOUGH = 1e-8  # the same, where rounding prevents a smaller one
PATIENCE = 4  # number of steps that may grow
STAGES = 32  # most stages from rest to the whole path
SINGULAR = 1e-13  # relative to the largest singular value, scaled
STILL = 1e-9  # relative to the fastest internal rate, or over the whole path: rate of a neutral motion
LARGEST_STEP = 3.0  # growth rate times step: beyond, a step of the method turns growth into decay
ROOT = math.sqrt(6.0)
NODES = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1.0])
WEIGHTS = np.array(
    [
        [(88 - 7 * ROOT) / 360, (296 - 169 * ROOT) / 1800, (-2 + 3 * ROOT) / 225],
        [(296 + 169 * ROOT) / 1800, (88 + 7 * ROOT) / 360, (-2 - 3 * ROOT) / 225],
        [(16 - ROOT) / 36, (16 + ROOT) / 36, 1 / 9],
    ]
)

PrescribedOutputs = Callable[[Any], Any]  # times (N,) -> (outputs, degree + 1, N)


@dataclass(frozen=True, eq=False)
class Motion:
    """Solution `unknowns` (columns, N) at `times` (N,): states, unknowns of loops, strengths.

    `internal`: eigenvalues of the internal dynamics, at the beginning, in 1/s.
    """

    times: Any
    unknowns: Any
    internal: Any


@dataclass(frozen=True, eq=False)
class Ends:
    """Equilibria at the first and the last instant, (columns,) each; the last may be unknown."""

    first: Any
    last: Any | None


def motion(equations: InversionEquations, times: Array, wanted: PrescribedOutputs, ends: Ends) -> Motion:
    """Return the states and strengths at `times` with which the outputs follow `wanted`. Raises `RunFailed`."""
    solver = _Solver(equations, np.asarray(times, dtype=float), wanted, ends)
    found = solver.solve()
    keep = slice(None) if solver.steps is None else slice(0, None, len(NODES))
    return Motion(solver.times[keep], found[:, keep], solver.internal)


class _Solver:
    def __init__(self, equations: InversionEquations, times: Array, wanted: PrescribedOutputs, ends: Ends) -> None:
        self.equations, self.ends = equations, ends
        self.steps = None if equations.free == 0 else np.diff(times)
        if self.steps is not None:
            between = times[:-1, None] + self.steps[:, None] * NODES
            times = np.concatenate([times[:1], between.ravel()])
        self.times, self.wanted = times, wanted(times)
        self.begun = np.repeat(ends.first[:, None], len(times), axis=1)
        self.internal, self.held = np.zeros(0, dtype=complex), (np.zeros((0, 0)), np.zeros((0, 0)))
        if self.steps is not None:
            self._look_inside()

    # ------------------------------------------------------------ what the outputs leave
    def _look_inside(self) -> None:
        """Compute the internal dynamics at both ends: decaying motions are at rest at the beginning, growing ones at the end."""
        eigenvalues, decaying, _ = self._internal(0, self.ends.first)
        self.internal = eigenvalues
        growth = float(eigenvalues.real.max(initial=0.0))
        growing = np.zeros((0, decaying.shape[1]))
        if growth > self._still(eigenvalues):
            assert self.steps is not None
            if growth * self.steps.max() > LARGEST_STEP:
                least = math.ceil((self.times[-1] - self.times[0]) * growth / LARGEST_STEP) + 1
                raise RunFailed(
                    "BR315", f"with these outputs prescribed something inside grows with {growth:.6g} 1/s: the steps are too long for that,",
                    f"ask for {least} points or more, or for other outputs",
                )  # fmt: skip
            if self.ends.last is None:
                raise RunFailed(
                    "BR316", f"with these outputs prescribed something inside grows with {growth:.6g} 1/s, so the path has to end at rest:",
                    "let it stay there for a while",
                )  # fmt: skip
            growing = self._internal(-1, self.ends.last)[2]
        self.held = decaying, growing
        if len(decaying) + len(growing) != self.equations.free:
            raise RunFailed("BR317", "what the outputs leave to move by itself grows at one end of the path and decays at the other")  # fmt: skip

    def _internal(self, at: int, unknowns: Array) -> tuple[Any, Any, Any]:
        """Return eigenvalues, and the conditions on the states (k, n) that keep decaying, and growing, motions at rest."""
        from scipy.linalg import schur

        place = slice(at, at + 1) if at >= 0 else slice(len(self.times) - 1, None)
        found = self.equations(self.times[place], unknowns[:, None], self._at_rest(place))
        n, scale = self.equations.count, self._magnitudes(np.abs(unknowns)[:, None])
        space = _free_space(found.jacobian[0] * scale, self.equations.free) * scale[:, None]
        inside = np.linalg.pinv(space[:n] / scale[:n, None]) / scale[:n]
        matrix = inside @ (found.rate_slopes[0] @ space)
        eigenvalues = np.linalg.eigvals(matrix)
        least = self._still(eigenvalues)
        parts = []
        for chosen in (lambda re, im: re <= least, lambda re, im: re > least):
            _, basis, count = schur(matrix.T, output="real", sort=chosen)
            parts.append(basis[:, :count].T @ inside)
        quiet = np.abs(eigenvalues) <= least
        return np.where(quiet, 0.0, eigenvalues)[np.argsort(-eigenvalues.real)], parts[0], parts[1]

    def _still(self, eigenvalues: Array | ComplexArray) -> float:
        """Return a rate that counts as zero: rounding, or no change over the length of the path."""
        return STILL * max(float(np.abs(eigenvalues).max(initial=0.0)), 1.0 / float(self.times[-1] - self.times[0]))

    def _at_rest(self, place: slice) -> Any:
        wanted = np.zeros_like(self.wanted[:, :, place])
        wanted[:, 0] = self.wanted[:, 0, place]
        return wanted

    # ------------------------------------------------------------ Newton's method, in stages
    def solve(self) -> Any:
        """Return the solution (columns, instants)."""
        unknowns, start = self.begun, self._resting()
        reached, step = 0.0, 1.0
        while reached < 1.0:
            step = min(step, 1.0 - reached)
            share = reached + step
            found, worst = self._newton(unknowns, start + share * (self.wanted - start))
            if found is None:
                step *= 0.5
                if step < 1.0 / STAGES:
                    raise self._lost(reached, worst)
                continue
            unknowns, reached, step = found, share, 2 * step
        return unknowns

    def _resting(self) -> Any:
        """Return the outputs of the model staying at its initial rest."""
        rest = np.zeros_like(self.wanted)
        zero = np.zeros((len(self.wanted), self.wanted.shape[1], 1))
        found = self.equations(self.times[:1], self.begun[:, :1], zero)
        row = 0
        for output, degree in enumerate(self.equations.degrees):
            rest[output, 0] = found.missed[0, row]
            row += degree + 1
        return rest

    def _lost(self, reached: float, worst: int) -> RunFailed:
        names = ", ".join(f"`{n}`" for n in self.equations.outputs)
        return RunFailed(
            "BR326", f"no inputs were found that lead {names} along the path: Newton's method fails at t = {self.times[worst]:.6g} s, "
            f"at {100 * reached:.3g} % of the way from rest",
        )  # fmt: skip

    def _newton(self, unknowns: Array, wanted: Array) -> tuple[Any | None, int]:
        before = math.inf
        for number in range(ITERATIONS):
            found = self.equations(self.times, unknowns, wanted)
            good = np.isfinite(found.missed).all(axis=1) & np.isfinite(found.jacobian).all(axis=(1, 2))
            if not good.all():
                return None, int(np.argmin(good))
            scale = self._magnitudes(np.abs(unknowns))
            step = self._alone(found, scale) if self.steps is None else self._together(found, unknowns, scale)
            if step is None:
                return None, 0
            size = np.abs(step) / scale[:, None]
            norm = float(size.max(initial=0.0))
            if not math.isfinite(norm) or (number > PATIENCE and norm > 2 * before):
                return None, int(np.argmax(size.max(axis=0)))
            unknowns = unknowns + step
            if norm < CLOSE or (norm < ENOUGH and norm >= 0.5 * before):
                return unknowns, 0
            before = norm
        return None, int(np.argmax(size.max(axis=0)))

    def _magnitudes(self, size: Array) -> Any:
        """Return magnitudes of the unknowns, (columns,): those of one unit share the largest."""
        return nonzero(largest_of_group(size.max(axis=1), group_numbers(self.equations.units)))

    def _alone(self, found: Evaluated, scale: Array) -> Any:
        """Return the Newton step of each instant separately."""
        matrix = found.jacobian * scale
        rows = nonzero(np.abs(matrix).max(axis=2, keepdims=True))
        matrix = matrix / rows
        columns = nonzero(np.abs(matrix).max(axis=1, keepdims=True))
        self._refuse_singular(matrix[0] / columns[0])
        try:
            step = np.linalg.solve(matrix / columns, (found.missed[:, :, None] / rows))[:, :, 0]
        except np.linalg.LinAlgError:
            return None
        return -(step / columns[:, 0]).T * scale[:, None]

    def _refuse_singular(self, matrix: Array) -> None:
        sizes = np.linalg.svd(matrix, compute_uv=False)
        if sizes[-1] < SINGULAR * sizes[0]:
            names = together(self.equations.outputs, self.equations.degrees)
            raise RunFailed("BR325", f"the inputs cannot move {names}")

    def _together(self, found: Evaluated, unknowns: Array, scale: Array) -> Any:
        """Return the Newton step of one sparse system: the equations of all instants, the steps of the internal dynamics, and their end conditions."""
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        builder = _Blocks(self.equations.columns)
        for at, (block, missed) in enumerate(zip(found.jacobian, found.missed, strict=True)):
            builder.row([(at, block)], missed)
        self._step_rows(builder, found, unknowns, scale)
        last = len(self.times) - 1
        for at, held, rest in ((0, self.held[0], self.ends.first), (last, self.held[1], self.ends.last)):
            if len(held) and rest is not None:
                n = self.equations.count
                wide = np.concatenate([held, np.zeros((len(held), self.equations.columns - n))], axis=1)
                builder.row([(at, wide)], held @ (unknowns[:n, at] - rest[:n]))
        rows, columns, values, right = builder.done()
        matrix = csc_matrix((values, (rows, columns)))
        across = np.tile(scale, len(self.times))
        matrix = matrix.multiply(across[None]).tocsr()
        sizes = nonzero(np.abs(matrix).max(axis=1).toarray().ravel())
        matrix = matrix.multiply(1.0 / sizes[:, None]).tocsc()
        try:
            step = -splu(matrix).solve(right / sizes) * across
        except RuntimeError:
            return None
        return step.reshape(len(self.times), -1).T

    def _step_rows(self, builder: _Blocks, found: Evaluated, unknowns: Array, scale: Array) -> None:
        """Add x_j - x_0 - h sum of a_jl f_l, in the directions of the internal dynamics."""
        assert self.steps is not None
        n, width, stages = self.equations.count, self.equations.columns, len(NODES)
        picked = np.eye(n, width)
        for number, h in enumerate(self.steps):
            first = number * stages
            free = _free_space(found.jacobian[first] * scale, self.equations.free)[:n].T / scale[:n]
            for j in range(stages):
                at = first + 1 + j
                blocks = [(first, -free @ picked)]
                defect = unknowns[:n, at] - unknowns[:n, first]
                for i in range(stages):
                    weight = h * WEIGHTS[j, i]
                    block = -weight * (free @ found.rate_slopes[first + 1 + i])
                    if i == j:
                        block = block + free @ picked
                    blocks.append((first + 1 + i, block))
                    defect = defect - weight * found.rates[first + 1 + i]
                builder.row(blocks, free @ defect)


class _Blocks:
    """A sparse matrix and its right-hand side, composed of blocks of `width` columns for each instant."""

    def __init__(self, width: int) -> None:
        self.width, self.next = width, 0
        self.parts: list[tuple[Any, Any, Any]] = []
        self.right: list[Any] = []

    def row(self, blocks: list[tuple[int, Any]], right: Array) -> None:
        """Add rows with a block at each of some instants."""
        for at, block in blocks:
            down = self.next + np.repeat(np.arange(len(block)), self.width)
            self.parts.append((down, np.tile(np.arange(self.width), len(block)) + self.width * at, block.ravel()))
        self.right.append(np.atleast_1d(right))
        self.next += len(np.atleast_1d(right))

    def done(self) -> tuple[Any, Any, Any, Any]:
        """Return rows, columns, values, right-hand side."""
        down, across, values = (np.concatenate([p[i] for p in self.parts]) for i in range(3))
        return down, across, values, np.concatenate(self.right)


def _free_space(jacobian: Array, free: int) -> Any:
    """Return an orthonormal basis (columns, free) of the null space of the equations, in the scaled unknowns."""
    rows = nonzero(np.abs(jacobian).max(axis=1, keepdims=True))
    _, _, right = np.linalg.svd(jacobian / rows, full_matrices=True)
    return right[len(right) - free :].T
