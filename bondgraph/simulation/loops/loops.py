"""Algebraic loops solved separately: the unknowns for given states, by Newton's method to round-off; multipliers directly.

The steps of the integrator include the unknowns; here they are computed at a start, after a jump, and at reported instants. Where Newton's method
fails from the last solution, `numerics/homotopy.py` reduces the residual gradually to zero.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, IntArray, Program, zeros_of

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..integrators.compiled.plain import Plain, record_for
from ..integrators.linear_algebra.factors import Factors
from ..integrators.loop_newton import LoopSystem

if TYPE_CHECKING:
    from ..integrators.compiled.record_layout import RecordArray
    from .waves import OpenedLoops

LARGEST = 100  # most unknowns of a loop that is searched from many guesses
NEAREST = 8
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
        if "loops" not in program.kept:
            rows, columns = program.pattern
            chosen = np.flatnonzero((rows >= self.count) & (columns >= self.count))
            affine, place = {*range(len(self.magnitude))} <= {*program.eliminated}, (rows[chosen], columns[chosen])
            program.kept["loops"] = chosen, affine, np.argsort(program.eliminated), tuple(p - self.count for p in place)
        self._chosen, self.affine, self._order, self._place = program.kept["loops"]
        self._systems: dict[bytes, RecordArray | Plain] = {}

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
                "check the laws in it (`bondgraph show FILE --stage causality` shows how they hang together), put a small storage into it, or a large resistor "
                "beside each law that is flat there",
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
        from ...numerics.multistart import far_guesses, guesses

        loop = SeparateLoop(self, (time, state, mode), last, places)
        ends = list(loop.arrivals(guesses(last[places], loop.magnitude)))
        ends = ends or list(loop.arrivals(far_guesses(loop.magnitude)))
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
            found = self.measured(times[0], states[0], mode).solve_all(times, states, mode)
            for k in range(len(times)):
                if not self._with_inputs(k).system(times[k], found[k], mode, slice(None)).call("holds"):
                    found[k] = self._with_inputs(k).solve(times[k], found[k], mode)
            return found
        found, known = self.solved(times, states, mode)
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

    def solved(self, times: Array, states: Array, mode: Array, places: IntArray | slice = slice(None), many: bool = False) -> tuple[Any, Any]:  # fmt: skip
        """Return states with the unknowns by Newton's method, damped by halving, until the correction is round-off, each from its own; and a mask of
        those that are solved. `many`: they are guesses for one state, of which some arrive."""
        times, results = np.ascontiguousarray(times, dtype=float), np.array(states, dtype=float, order="C")
        masks = np.zeros(len(times), dtype=np.int64)
        alike = [slice(None)] if self.inputs.ndim == 1 else [slice(k, k + 1) for k in range(len(times))]
        for rows in alike if len(times) else ():
            system = self._with_inputs(rows.start or 0).system(times[0], results[0], mode, places)
            system.call(
                "solve_rows", int(many), times[rows], results[rows], results.shape[1], masks[rows], len(times[rows])
            )
        return results, masks == 1

    def system(self, time: float, state: Array, mode: Array, places: IntArray | slice) -> RecordArray | Plain:
        """Return the equations of some unknowns at an instant, for Newton's method."""
        which = np.arange(len(self.magnitude))[places]
        key, native = which.tobytes(), self.program.native is not None
        given = {
            "inputs": self.inputs, "constants": self.constants, "mode": np.asarray(mode, dtype=float), "time": time, "state": np.array(state, dtype=float),
            "magnitude": np.array(self.magnitude[places]), "unknown": int(self.unknown),
        }  # fmt: skip
        found = self._systems.get(key)
        if found is None:
            room = partial(self.room, which)
            found = self._systems[key] = record_for(LoopSystem, self.program, key, room, given, native)
        else:
            found.put(given)
        return found

    def room(self, which: IntArray) -> dict[str, Any]:
        """Return the fields of the equations of some unknowns that depend on the program alone."""
        return _room(self.program, which, self._chosen, self._place)

    def residual(self, time: Array | float, state: Array, mode: Array, unknowns: Array) -> Any:
        """Return the residuals of the loop equations; `unknowns` may have a leading axis."""
        full = self.full(state, unknowns)
        return self.program.derivative(time, full, self.inputs, self.constants, mode)[..., self.count :]

    def matrix(self, time: Array | float, state: Array, mode: Array, unknowns: Array) -> Any:
        """Return the derivatives of the residuals by the unknowns (last axis); `unknowns` may have a leading axis."""
        full = self.full(state, unknowns)
        entries = self.program.jacobian_entries(time, full, self.inputs, self.constants, mode)
        result = np.zeros((*unknowns.shape, unknowns.shape[-1]))
        if unknowns.ndim == 1:
            result[self._place] = entries[self._chosen]
        else:
            result[(..., *self._place)] = entries[..., self._chosen]
        return result

    def separate(self) -> list[Any]:
        """Return the unknowns of each separate loop (those that depend on each other); a loop comes after those that it reads."""
        if "separate loops" in self.program.kept:
            return self.program.kept["separate loops"]  # type: ignore[no-any-return]
        from graphlib import TopologicalSorter

        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count = len(self.magnitude)
        reads = coo_array((np.ones(len(self._chosen)), self._place), shape=(count, count))
        number, labels = connected_components(reads, directed=True, connection="strong")
        before = {(labels[row], labels[column]) for row, column in zip(*self._place, strict=True)}
        waits = {i: {b for a, b in before if a == i and b != i} for i in range(number)}
        found = [np.flatnonzero(labels == i) for i in TopologicalSorter(waits).static_order()]
        self.program.kept["separate loops"] = found
        return found

    def full(self, state: Array, unknowns: Array) -> Any:
        """Return a state with unknowns, which may have a leading axis."""
        if unknowns.ndim == 1:  # most calls are for one point
            return np.concatenate([state[: self.count], unknowns])
        known = np.broadcast_to(state[..., : self.count], (*unknowns.shape[:-1], self.count))
        return np.concatenate([known, unknowns], axis=-1)

    def newton(self, time: float, state: Array, mode: Array, guess: Array, places: IntArray | slice = slice(None)) -> Any:  # fmt: skip
        """Solve for some of the unknowns by Newton's method; None if it fails."""
        start = np.concatenate([state[: self.count], guess])
        found, solved = self.solved(np.array([time]), start[None], mode, places)
        return found[0, self.count :] if solved[0] else None

    def measured(self, time: float, state: Array, mode: Array) -> LoopSolver:
        """Return the solver with magnitudes for all unknowns, near those in a state."""
        if not self.unknown:
            return self
        result, z = copy(self), np.asarray(state)[self.count :]
        system = self._with_inputs(0).system(time, state, mode, slice(None))
        system["z"][:] = z
        known = system.call("measured_loops")
        result.magnitude = system["unit"].copy() if known else nonzero(np.maximum(np.abs(z), self.magnitude))
        result.unknown = False
        return result

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


def _room(program: Program, which: IntArray, chosen: IntArray, place: tuple[IntArray, IntArray]) -> dict[str, Any]:
    """Return the fields of the equations of some unknowns that depend on the program alone; `chosen`, `place`: entries of all loops, and their places."""
    n, count, (rows, columns) = len(which), len(program.variables.names), place
    own = np.isin(rows, which) & np.isin(columns, which)
    index = np.zeros(count, dtype=int)
    index[which] = np.arange(n)
    entries = {"entry_count": int(np.count_nonzero(own)), "all_entries": len(program.pattern[0])}
    return zeros_of(LoopSystem, n=n, variables=count, **entries) | {
        "places": len(program.states.names) + which, "chosen": chosen[own], "rows": index[rows[own]], "columns": index[columns[own]],
        "real": zeros_of(Factors, n=n),
    }  # fmt: skip


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

    def arrivals(self, guesses: Array) -> Any:
        """Return the points, shape (points, unknowns), to which Newton's method converges from many guesses."""
        time, state, mode = self.at
        full = np.concatenate([np.tile(state[: self.loops.count], (len(guesses), 1)), self.full(guesses)], axis=1)
        ends, arrived = self.loops.solved(np.full(len(guesses), time), full, mode, self.places, True)
        return ends[arrived][:, self.loops.count + self.places]

    def residual(self, z: Array) -> Any:
        return self.loops.residual(*self.at, self.full(z))[..., self.places]

    def matrix(self, z: Array) -> Any:
        return self.loops.matrix(*self.at, self.full(z))[..., self.places[:, None], self.places]

    def divisors(self, z: Array) -> Any:
        """Return what the laws divide by, shape (points, divisors): none where the program does not have them."""
        loops, (time, state, mode) = self.loops, self.at
        if loops.program.poles is None:
            return np.zeros((len(z), 0))
        full, times = loops.full(state, self.full(z)), np.full(len(z), time)
        return np.asarray(loops.program.poles(times, full, loops.inputs, loops.constants, mode))


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
