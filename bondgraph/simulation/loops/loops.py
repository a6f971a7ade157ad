"""Algebraic loops solved separately: the unknowns for given states, by Newton's method to round-off; multipliers directly.

The steps of the integrator include the unknowns; here they are computed at a start, after a jump, and at reported instants. Where Newton's method
fails from the last solution, `numerics/homotopy.py` reduces the residual gradually to zero.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, IntArray, Program

from ...errors import RunFailed
from ...numerics.scales import equilibrated, nonzero

if TYPE_CHECKING:
    from .waves import OpenedLoops

ITERATIONS = 2000  # an exponential law far from its solution needs one for each factor e
HALVINGS = 30
STUCK = 12  # successive steps shortened to less than SHORT: the residual has a local minimum there
SHORT = 1e-3
TOGETHER = 12  # iterations for many instants at once: instants that need more are solved one by one
LARGEST = 100  # most unknowns of a loop that is searched from many guesses
NEAREST = 8
ROUNDED = 1e-5  # relative to its terms: a residual that does not fall counts as rounding below this
HIDDEN = 1e-12  # in SI, of unknowns whose magnitude is not known: a correction below it that no halving makes work is rounding of the 1 in exp(u) - 1
SAMPLED = (0.0, *(10.0 ** np.arange(-9, 9, 0.25)).tolist())  # times at which conditions on time are compared
GUESSES = (0.0, 1e-3, -1e-3, 1.0, -1.0, 1e3, -1e3, 1e5, -1e5, 1e7, -1e7)  # in units of the magnitudes


class LoopSolver:
    """Solver for the unknowns of a program for given states.

    `inputs`: the same always, or for `solve_all` a row for each instant; `magnitude`: of states and unknowns, 0 or None where they are not known: then
    the terms of the equations decide them (`_sizes`); `parameters`: needed to open loops (see `_opened`).
    """

    def __init__(
        self, program: Program, constants: Array, inputs: Array, magnitude: Array | None = None, parameters: Array | None = None
    ) -> None:  # fmt: skip
        self.program, self.constants, self.inputs, self.parameters = program, constants, inputs, parameters
        self.count = len(program.states.names)
        unknown = np.zeros(len(program.variables.names))
        self.magnitude = np.asarray(unknown if magnitude is None else magnitude, dtype=float)[self.count :]
        self.unknown = not (self.magnitude > 0).all()
        self.affine = False
        if not len(self.magnitude):
            return
        rows, columns = program.pattern
        self._chosen = np.flatnonzero((rows >= self.count) & (columns >= self.count))
        self.affine = {*range(len(self.magnitude))} <= {*program.eliminated}
        self._order = np.argsort(program.eliminated)
        self._place = rows[self._chosen] - self.count, columns[self._chosen] - self.count

    def solve(self, time: float, state: Array, mode: Array) -> Any:
        """Return the state with the unknowns that belong to it. Raises `RunFailed`."""
        if not len(self.magnitude):
            return state
        if self.affine:
            return self._multipliers(time, state, mode)
        last = state[self.count :]
        found = self.newton(time, state, mode, last)
        if found is None:
            with np.errstate(all="ignore"):  # a law may have no value at a guess
                waves = self._opened(time, state, mode)
                if waves is not None and waves.rise:
                    found = self._by_waves(waves, time, state, mode)
                if found is None:
                    found = self._one_by_one(time, state, mode)
                if found is None and waves is not None and not waves.rise:
                    found = self._by_waves(waves, time, state, mode)
        if found is None:
            names = ", ".join(f"`{n}`" for n in self.program.unknowns.names[:6])
            raise RunFailed(
                "BR744", f"at t = {time:.9g} s the algebraic loop of {names} has no solution that could be found;",
                "check the laws in it (`bondgraph show FILE --stage causality` shows how they hang together), or put a small storage into it",
            )  # fmt: skip
        return np.concatenate([state[: self.count], found])

    def _opened(self, time: float, state: Array, mode: Array) -> OpenedLoops | None:
        """Return the loops with both variables of each nonlinear law as unknowns; None if not available. Conditions on states are
        evaluated at each iterate; what only events change, and conditions on time, are as in the mode."""
        source = self.program.kept.get("opened")
        if source is None or self.parameters is None:
            return None
        from compiler.api import CompilationFailed, ValuesNeeded

        from .waves import OpenedLoops

        try:
            compiled_scene = source()
            program, laws = compiled_scene.program, compiled_scene.facts.laws
        except (CompilationFailed, ValuesNeeded):
            return None
        if not laws or program.states.names != self.program.states.names:
            return None
        constants = program.constants(self.parameters)
        fitting = self._mode_of(program, constants, np.asarray(mode))
        if fitting is None:
            return None
        names = program.unknowns.names
        opened = LoopSolver(program, constants, self.inputs)
        at = time, state, fitting
        return OpenedLoops(names, partial(opened.residual, *at), partial(opened.matrix, *at), laws)

    def _mode_of(self, opened: Program, constants: Array, mode: Array) -> Any:
        """Mode of the opened program: what only events change, then the conditions on time, whose order may differ there. None if
        they are not the same."""
        hybrid = self.program.hybrid
        modes = () if hybrid is None else hybrid.modes.names
        if modes != (() if opened.hybrid is None else opened.hybrid.modes.names):
            return None
        timed = mode if hybrid is None else mode[list(hybrid.timed)]
        places = _matching(
            *(np.array([p.switches(t, c) for t in SAMPLED]) for p, c in ((self.program, self.constants), (opened, constants)))
        )  # fmt: skip
        return None if places is None else np.concatenate([mode[: len(modes)], timed[places]])

    def _by_waves(self, waves: OpenedLoops, time: float, state: Array, mode: Array) -> Any:
        """Return the unknowns by an iteration in wave variables; None if it does not converge."""
        from .waves import solve_opened

        places = [waves.unknowns.index(name) for name in self.program.unknowns.names]
        guess = np.zeros(waves.size)
        guess[places] = state[self.count :]
        for end in solve_opened(waves, guess):
            found = self.newton(time, state, mode, end[places])
            if found is not None:
                return found
            if self._is_beyond(time, np.concatenate([state[: self.count], end[places]]), mode):
                return end[places]  # the laws as they are there: the mode says otherwise, and is what has to change
        return None

    def _is_beyond(self, time: float, state: Array, mode: Array) -> bool:
        """Return True if a condition that steers differs, at a state, from its truth in a mode."""
        hybrid = self.program.hybrid
        if hybrid is None:
            return False
        roots = np.asarray(hybrid.roots(time, state, self.inputs, self.constants, mode))
        said = np.asarray(mode)[[c.position for c in hybrid.conditions]] == 1.0
        steers = np.array([c.steers for c in hybrid.conditions], dtype=bool)
        return bool((steers & np.isfinite(roots) & (roots != 0) & ((roots < 0) != said)).any())

    def _one_by_one(self, time: float, state: Array, mode: Array) -> Any:
        """Return all unknowns, solved loop after loop; None if one loop fails."""
        if self.unknown:
            return self.measured(time, state, mode)._one_by_one(time, state, mode)
        z = state[self.count :]
        for places in self.separate():
            # first methods that find the nearest solution, then any
            ways = (self.newton, self._homotopy, self._scattered, self._homotopies)
            found = next((y for way in ways if (y := way(time, state, mode, z, places)) is not None), None)
            if found is None:
                return None
            z = found
        return z

    def _scattered(self, time: float, state: Array, mode: Array, last: Array, places: IntArray) -> Any:
        """Return the nearest of the solutions to which many guesses lead; None if there is none."""
        if len(places) > LARGEST:
            return None
        from ...numerics.multistart import arrivals, far_guesses, guesses

        loop = SeparateLoop(self, (time, state, mode), last, places)
        ends = arrivals(loop, guesses(last[places], loop.magnitude)) or arrivals(loop, far_guesses(loop.magnitude))
        ends.sort(key=lambda end: float(np.abs((end - last[places]) / self.magnitude[places]).max()))
        found = (self.newton(time, state, mode, _put(last, places, end), places) for end in ends[:NEAREST])
        return next((z for z in found if z is not None), None)

    def _homotopies(self, time: float, state: Array, mode: Array, last: Array, places: IntArray) -> Any:
        """Return a solution by homotopy from guesses over many decades, since a law may have no value at others; None if all fail."""
        starts = (_put(last, places, share * self.magnitude[places]) for share in GUESSES)
        found = (self._homotopy(time, state, mode, start, places) for start in starts)
        return next((z for z in found if z is not None), None)

    def _multipliers(self, time: Array | float, state: Array, mode: Array) -> Any:
        """Return states at one or several instants with the multipliers of loop joints, which the program computes directly."""
        assert self.program.solved is not None
        solved = np.asarray(self.program.solved(time, state, self.inputs, self.constants, mode))
        multipliers = solved[..., state.shape[-1] :][..., self._order]
        return np.concatenate([state[..., : self.count], multipliers], axis=-1)

    def solve_all(self, times: Array, states: Array, mode: Array) -> Any:
        """Return the states with their unknowns at several instants; shape (times, n)."""
        if not len(self.magnitude):
            return states
        if self.affine:
            return self._multipliers(times, states, mode)
        if self.unknown and len(times):
            return self.measured(times[0], states[0], mode).solve_all(times, states, mode)
        found, known = self._together(times, states, mode)
        for k in np.flatnonzero(~known).tolist():
            guess = states[k]
            if k and (states[k] == states[k - 1]).all():  # the instants differ in time alone: the one before is nearer
                guess = found[k - 1]
            found[k] = self._with_inputs(k).solve(times[k], guess, mode)
        return found

    def _with_inputs(self, row: int) -> LoopSolver:
        """Return the solver for the inputs of one instant."""
        if self.inputs.ndim == 1:
            return self
        single = copy(self)
        single.inputs = self.inputs[row]
        return single

    def _together(self, times: Array, states: Array, mode: Array) -> tuple[Any, Any]:
        """Solve all instants at once by undamped Newton iterations; return the states and a mask of the instants that converged as in `newton`."""
        times, results = np.asarray(times, dtype=float), np.array(states, dtype=float)
        solved, going = np.zeros(len(times), dtype=bool), np.arange(len(times))
        before = np.full(len(times), np.inf)

        def fixed() -> tuple[Any, ...]:
            return self.inputs if self.inputs.ndim == 1 else self.inputs[going], self.constants, mode

        value = self.program.derivative(times, results, *fixed())[:, self.count :]
        for _ in range(TOGETHER):
            matrix = self._matrices(times[going], results[going], fixed())
            scale = np.abs(matrix).max(axis=2)
            usable = np.isfinite(scale).all(axis=1) & (scale > 0).all(axis=1) & np.isfinite(value).all(axis=1)
            going, matrix, scale, value = going[usable], matrix[usable], scale[usable], value[usable]
            try:
                step = np.linalg.solve(matrix / scale[..., None], (-value / scale)[..., None])[..., 0] * self.magnitude
            except np.linalg.LinAlgError:
                break
            there = results[going]
            size = np.abs(step / np.maximum(np.abs(there[:, self.count :]), 1e-3 * self.magnitude)).max(axis=1)
            there[:, self.count :] += step
            after = self.program.derivative(times[going], there, *fixed())[:, self.count :]
            norm, left = (np.linalg.norm(v / scale, axis=1) for v in (value, after))
            good = (left <= (1 - 1e-4) * norm) | ((size < 1e-9) & np.isfinite(after).all(axis=1))
            ended = good & ((size <= 4e-16) | ((size < 1e-9) & (size >= 0.25 * before[going])))
            results[going[good]] = there[good]
            solved[going[ended]], before[going] = True, size
            going, value = going[good & ~ended], after[good & ~ended]
            if not len(going):
                break
        results[~solved] = np.asarray(states)[~solved]
        return results, solved

    def _matrices(self, times: Array, states: Array, fixed: tuple[Any, ...]) -> Any:
        """Return the derivatives of the residuals by the unknowns, in units of the magnitudes, at several instants."""
        count = len(self.magnitude)
        result = np.zeros((len(times), count, count))
        result[(slice(None), *self._place)] = self.program.jacobian_entries(times, states, *fixed)[:, self._chosen]
        return result * self.magnitude

    def residual(self, time: float, state: Array, mode: Array, unknowns: Array) -> Any:
        """Return the residuals of the loop equations; `unknowns` may have a leading axis."""
        full = self._full(state, unknowns)
        return self.program.derivative(time, full, self.inputs, self.constants, mode)[..., self.count :]

    def matrix(self, time: float, state: Array, mode: Array, unknowns: Array) -> Any:
        """Return the derivatives of the residuals by the unknowns (last axis); `unknowns` may have a leading axis."""
        full = self._full(state, unknowns)
        entries = self.program.jacobian_entries(time, full, self.inputs, self.constants, mode)
        result = np.zeros((*unknowns.shape, unknowns.shape[-1]))
        if unknowns.ndim == 1:
            result[self._place] = entries[self._chosen]
        else:
            result[(..., *self._place)] = entries[..., self._chosen]
        return result

    def separate(self) -> list[Any]:
        """Return the unknowns of each separate loop (those that depend on each other); a loop comes after those that it reads."""
        from graphlib import TopologicalSorter

        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count = len(self.magnitude)
        reads = coo_array((np.ones(len(self._chosen)), self._place), shape=(count, count))
        number, labels = connected_components(reads, directed=True, connection="strong")
        before = {(labels[row], labels[column]) for row, column in zip(*self._place, strict=True)}
        waits = {i: {b for a, b in before if a == i and b != i} for i in range(number)}
        return [np.flatnonzero(labels == i) for i in TopologicalSorter(waits).static_order()]

    def _full(self, state: Array, unknowns: Array) -> Any:
        if unknowns.ndim == 1:  # most calls are for one point
            return np.concatenate([state[: self.count], unknowns])
        known = np.broadcast_to(state[: self.count], (*unknowns.shape[:-1], self.count))
        return np.concatenate([known, unknowns], axis=-1)

    def newton(self, time: float, state: Array, mode: Array, guess: Array, places: IntArray | slice = slice(None)) -> Any:  # fmt: skip
        """Solve for some of the unknowns by Newton's method, damped by halving, until the correction is round-off; None if it fails."""
        z = np.array(guess, dtype=float)
        magnitude = self.magnitude[places]
        value = self.residual(time, state, mode, z)[places]
        if not np.isfinite(value).all():
            return None
        before, stuck = np.inf, 0
        for _ in range(ITERATIONS):
            matrix = self.matrix(time, state, mode, z)[places][:, places]
            magnitude = self._sizes(matrix, value, z, places)
            if magnitude is None:
                return None
            matrix = matrix * magnitude
            scale = np.abs(matrix).max(axis=1)
            if not np.isfinite(scale).all() or not (scale > 0).all():
                return None
            try:
                step = np.linalg.solve(matrix / scale[:, None], -value / scale) * magnitude
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(step / np.maximum(np.abs(z[places]), 1e-3 * magnitude)).max())
            if not np.isfinite(size):
                return None
            factor, norm = 1.0, _norm(value / scale)
            for _ in range(HALVINGS):
                trial = _put(z, places, z[places] + factor * step)
                found = self.residual(time, state, mode, trial)[places]
                if np.isfinite(found).all() and _norm(found / scale) <= (1 - 1e-4 * factor) * norm:
                    break
                if size < 1e-9 and np.isfinite(found).all():
                    break  # at round-off the residual does not fall any further
                factor *= 0.5
            else:
                stuck_at = size < 1e-9 or (self.unknown and float(np.abs(step).max()) < HIDDEN)
                return z if stuck_at or self._is_rounding(value, matrix, z[places] / magnitude) else None
            z, value = trial, found
            stuck = stuck + 1 if factor < SHORT else 0
            if stuck == STUCK:
                return None
            if size <= 4e-16 or (size < 1e-9 and size >= 0.25 * before):
                return z
            before = size
        return None

    def _sizes(self, matrix: Array, value: Array, z: Array, places: IntArray | slice) -> Any:
        """Return the magnitudes of the unknowns; where one is not known, the size of the terms that decide it, by which its rounding is measured. None
        if nothing decides it."""
        magnitude = self.magnitude[places]
        if not self.unknown:
            return magnitude
        scaled, rows, columns = equilibrated(matrix)
        if not np.isfinite(scaled).all():
            return None
        try:
            inverse = np.abs(np.linalg.inv(scaled)) / columns[:, None] / rows
        except np.linalg.LinAlgError:
            return None
        reach = np.maximum(np.maximum(np.abs(z[places]), magnitude), inverse @ np.abs(value))
        terms = np.abs(matrix) @ reach
        return np.where(magnitude > 0, magnitude, nonzero(inverse @ terms))

    def measured(self, time: float, state: Array, mode: Array) -> LoopSolver:
        """Return the solver with magnitudes for all unknowns, near those in a state."""
        if not self.unknown:
            return self
        result, first, z = copy(self), self._with_inputs(0), np.asarray(state)[self.count :]
        value, matrix = first.residual(time, state, mode, z), first.matrix(time, state, mode, z)
        sizes = self._sizes(matrix, value, z, slice(None)) if np.isfinite(value).all() else None
        result.magnitude = nonzero(np.maximum(np.abs(z), self.magnitude)) if sizes is None else sizes
        result.unknown = False
        return result

    @staticmethod
    def _is_rounding(value: Array, matrix: Array, z: Array) -> bool:
        """Return True if residuals that no shortened Newton step reduces are rounding: then they are small relative to their terms.

        A law of an argument near zero, exp(u) - 1, leaves more rounding than a unit in the last place, and leakage alone may determine an unknown.
        """
        return bool((np.abs(value) <= ROUNDED * (np.abs(matrix) @ np.abs(z))).all())

    def _homotopy(self, time: float, state: Array, mode: Array, guess: Array, places: IntArray) -> Any:
        """Return a solution by Newton homotopy from the guess; None if that fails."""
        from ...numerics.homotopy import follow

        near = follow(
            lambda y: self.residual(time, state, mode, _put(guess, places, y))[places],
            lambda y: self.matrix(time, state, mode, _put(guess, places, y))[places][:, places],
            guess[places],
            self.magnitude[places],
        )
        return None if near is None else self.newton(time, state, mode, _put(guess, places, near), places)


def _matching(ours: Array, theirs: Array) -> Any:
    """Index, for each column of the second table, of an equal column of the first (the same index if equal); None if one has none."""
    places = []
    for k in range(theirs.shape[1]):
        equal = np.flatnonzero((ours == theirs[:, k : k + 1]).all(axis=0))
        if not len(equal):
            return None
        places.append(k if k in equal else int(equal[0]))
    return np.array(places, dtype=int)


def _norm(values: Array) -> float:
    """Return the Euclidean norm, as numpy's function does, in a quarter of its time."""
    return sqrt(values.dot(values))


def _put(z: Array, places: IntArray | slice, values: Array) -> Any:
    result = np.array(z, dtype=float)
    result[places] = values
    return result


@dataclass(frozen=True, slots=True)
class SeparateLoop:
    """One loop, while the others keep their solution: `places` are the indices of its unknowns."""

    loops: LoopSolver
    at: tuple[float, Any, Any]  # time, state, mode
    known: Any  # unknowns of all loops
    places: Any

    @property
    def magnitude(self) -> Any:
        return self.loops.magnitude[self.places]

    def full(self, z: Array) -> Any:
        """Return the unknowns of all loops, with `z` for those of this one."""
        result = np.tile(self.known, (*z.shape[:-1], 1))
        result[..., self.places] = z
        return result

    def residual(self, z: Array) -> Any:
        return self.loops.residual(*self.at, self.full(z))[..., self.places]

    def matrix(self, z: Array) -> Any:
        return self.loops.matrix(*self.at, self.full(z))[..., self.places[:, None], self.places]


class Eliminated:
    """Rates and Jacobian as functions of states and other unknowns; multipliers in the state are ignored.

    The rates are those of `derivative`, with zeros in the rows of the multipliers; the Jacobian is that of the larger system, at the multipliers that
    belong to the state.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.size = len(program.states.names) + len(program.unknowns.names)
        self.places = np.array([len(program.states.names) + m for m in program.eliminated], dtype=int)

    def rates(self, *arguments: Any) -> Any:
        """Return the rates (…, n) for time, state, inputs, constants and mode."""
        solved = self.program.solved
        return (
            self.program.derivative(*arguments) if solved is None else np.asarray(solved(*arguments))[..., : self.size]
        )

    def entries(self, time: Array | float, state: Array, *fixed: Any) -> Any:
        """Return the entries of the Jacobian for the same arguments."""
        solved = self.program.solved
        if solved is not None:
            state = np.array(state)
            state[..., self.places] = np.asarray(solved(time, state, *fixed))[..., self.size :]
        return self.program.jacobian_entries(time, state, *fixed)
