"""Stored quantities when other junctions are on: preserved, except that an impulse passes between storages that are now tied to each other.

An impulse does no work on any motion that the ties allow: for all of those, the sum of conjugate (flow of an inertia, effort of a capacitor)
times jump of the stored quantity vanishes. So momentum and charge pass from one to the other and none is lost, unless a tie blocks or shorts
a storage: then its content goes to the world outside the model. (Brogliato, Nonsmooth Mechanics, 2016, section 4.3; for circuits Opal and
Vlach, IEEE Trans. CAS 37, 1990.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.scales import group_numbers, largest_of_group, nonzero
from ...quantities import behind
from ..constraints.constraints import RANK, Constraints
from ..initialization.initial_equations import slopes_of
from ..loops.loops import LoopSolver
from .events import Events
from .indicators import HybridState
from .resets import listed_events

ITERATIONS = 100
HALVES = 20  # of a step that leaves the domain of a law
CLOSE = 1e-12  # relative to the magnitudes: end of the iteration
AFFINE = 1e-13  # relative to the values: rounding error of an affine function
FINEST = 1e-3  # in units of the magnitudes: least size for a difference
LEAST = 1e-6  # relative to the largest of its unit: magnitude of a stored quantity that is smaller
SEEN = 1e-9  # relative to the magnitudes: least change that counts as a jump
STEP = 1e-6  # of a pose, in units of its reach
BESIDE = 1e-2  # of what moves, relative to its magnitude: there a motion that vanishes does not
HELD = 1e-4  # relative to the largest of its unit: jump that no error of a tolerance is
GAIN = 100.0  # of a jump over the change of what is held, both relative: only a ratio that vanishes gives it


@dataclass(frozen=True, slots=True)
class StorageJump:
    """Content of a storage before and after an impulse."""

    name: str
    unit: str
    before: float
    after: float


def after_impulse(
    constraints: Constraints, time: float, full: Array, mode: Array, stored: Mapping[str, float], peaks: Mapping[str, float]
) -> tuple[Any, tuple[StorageJump, ...]]:  # fmt: skip
    """Return the state after the impulse from the stored quantities before, with unknowns, and the jumps. Raises `RunFailed`."""
    program = constraints.program
    assert program.hybrid is not None
    names = (*program.states.names, *program.dependents.names)
    units = (*program.states.units, *program.dependents.units)
    size = np.array([max(abs(stored.get(n, 0.0)), peaks.get(n, 0.0)) for n in names])
    size[: constraints.count] = np.maximum(size[: constraints.count], np.abs(full[: constraints.count]))
    groups = group_numbers(units)
    # what holds nothing yet takes from what holds something: it has the size of that
    scale = nonzero(np.where(size > 0, size, largest_of_group(size, groups)))
    # momenta follow from positions and rates, and may be small differences of large terms
    compared = slice(len(names) - program.hybrid.momenta)
    jumping = np.array(program.hybrid.jumping, dtype=int)
    largest = [peaks.get(n, 0.0) for n in program.variables.names]
    # in units of 1, small unknowns would end rounded
    loops = constraints.loops(np.maximum(np.abs(full), largest))
    contents = _Held(constraints, loops, time, full, mode, jumping, scale[jumping])
    y = full[jumping] / contents.scale
    if not program.dependents.names and not constraints and np.isfinite(full).all():  # nothing is tied to anything
        return contents.full(y), ()
    here = contents.stored(y)
    size = np.maximum(size, np.abs(here))
    size = nonzero(np.maximum(size, LEAST * largest_of_group(size, groups)))
    # quantities that no program computed before start at their computed values
    old = np.array([stored.get(n, np.nan) for n in names])
    old = np.where(np.isfinite(old), old, here)
    if (np.abs(here - old) <= SEEN * size)[compared].all():
        return contents.full(y), ()
    if program.hybrid.momenta:
        contents = _in_scale(contents, y, size)
        y = full[jumping] / contents.scale
    y = _balanced(contents, y, old)
    after = contents.stored(y)
    jumped = np.flatnonzero((np.abs(after - old) > SEEN * size)[compared])
    return contents.full(y), tuple(StorageJump(names[i], units[i], float(old[i]), float(after[i])) for i in jumped)


def refuse_jumps_of_mechanisms(jumps: Sequence[StorageJump], mechanisms: Sequence[str], time: float) -> None:
    """Raise `RunFailed` if an impulse passes within a mechanism: which ideal valves conduct after it is not known."""
    prefixes = tuple(f"{name}." for name in mechanisms)
    jump = next((j for j in jumps if j.name.startswith(prefixes)), None)
    if jump is not None:
        raise RunFailed(
            "BR788", f"at t = {time:.9g} s a junction that goes on or off takes `{jump.name}` from {jump.before:.6g} to {jump.after:.6g} {jump.unit} at once: "
            "impulses within mechanisms are not computed beside ideal valves;", "couple it by a stiff spring and a damper, or by `DryFriction`",
        )  # fmt: skip


def refuse_vanishing_hold(
    before: Events, at: HybridState, after: Events, held: HybridState, jumps: Sequence[StorageJump], peaks: Mapping[str, float]
) -> None:  # fmt: skip
    """Raise `RunFailed` where junctions hold a motion that vanishes of itself, as a piston's at its dead centre, and what goes on behind it jumps.

    The program after a hold has no condition that the hold decides. There it is as if no storage held anything; before, it was nearly so.
    """
    notes, remaining = ([(c.owner, c.span) for c in events.hybrid.conditions] for events in (before, after))
    decided = [i for i in before.log[-1].conditions if remaining.count(notes[i]) < notes.count(notes[i])]
    if decided and not jumps:
        jumps = tuple(_shortly_after(after.constraints, held))
    if not decided or not jumps:
        return
    contents = [*before.program.states.names, *(j.name for j in jumps)]
    groups = group_numbers([*before.program.states.units, *(j.unit for j in jumps)])
    count, peak = before.count, np.array([peaks.get(n, 0.0) for n in contents])
    peak[:count] = np.maximum(peak[:count], before.magnitude[:count])
    largest = nonzero(largest_of_group(peak, groups))
    shares = [abs(j.after - j.before) / own for j, own in zip(jumps, largest[count:], strict=True)]
    moves = ~np.isin(np.arange(count), before.hybrid.jumping)

    def roots(state: Array, content: float = 1.0) -> Any:
        """Return the roots with this share of the contents of all storages."""
        full = np.concatenate([np.where(moves, state, content * state), at.state[count:]])
        return before.roots(at.time, before.loops.solve(at.time, full, at.mode), at.mode)[decided]

    state = at.state[:count]
    reaches = np.abs(slopes_of(roots, state, np.ones(count, dtype=bool), largest[:count])) * largest[:count]
    reach = reaches.max(axis=1, initial=0.0)
    away = np.abs(roots(state) - roots(state, 0.0)) / nonzero(reach)
    beside = state + BESIDE * np.where(moves, largest[:count], 0.0)
    moving = np.abs(roots(beside) - roots(beside, 0.0)) + reaches[:, before.constraints.speeds].sum(axis=1)
    away[moving <= SEEN * reach] = np.inf  # no condition on a motion
    worst = int(np.argmax(shares))
    if not shares[worst] <= max(HELD, GAIN * away.min()):
        jump, acted = jumps[worst], listed_events([before.hybrid.events[i] for i in before.log[-1].events])
        raise RunFailed(
            "BR796", f"at t = {at.time:.9g} s {acted} lets a junction hold a motion that vanishes there of itself, as a piston's at its dead centre, and no "
            f"finite force takes `{jump.name}` from {jump.before:.6g} to {jump.after:.6g}{behind(jump.unit)}:",
            "let the force first reverse, and hold only if the motion is led back, as `DryFriction` does",
        )  # fmt: skip


def _shortly_after(constraints: Constraints, at: HybridState) -> Iterator[StorageJump]:
    """Yield the jumps of rates of mechanisms once these have moved a little: exactly at a dead centre a hold lets them pass."""
    if not constraints:
        return
    program, places, ahead = constraints.program, constraints.positions, np.array(at.state)
    rates = program.derivative(at.time, at.state, constraints.inputs, constraints.constants, at.mode)[places]
    ahead[places] += STEP * rates / np.abs(rates / constraints.reach[places]).max(initial=1e-300)
    ahead = constraints.project(at.time, ahead, at.mode)
    for i in constraints.speeds:
        yield StorageJump(program.states.names[i], program.states.units[i], float(at.state[i]), float(ahead[i]))


@dataclass(frozen=True, slots=True)
class _Held:
    """Stored quantities and their conjugates, as functions of the states that an impulse changes, in units of their `scale`."""

    constraints: Constraints
    loops: LoopSolver
    time: float
    start: Any
    mode: Any
    jumping: Any
    scale: Any

    def full(self, y: Array) -> Any:
        """Return the state with the unknowns of loops."""
        return self.loops.solve(self.time, self._state(y), self.mode)

    def stored(self, y: Array) -> Any:
        """Return the states, then the contents of dependent storages."""
        return np.concatenate(
            [self._state(y)[: self.constraints.count], self._at(self.constraints.program.dependent, y)]
        )

    def conjugates(self, y: Array) -> Any:
        """Return the efforts and flows conjugate to the stored quantities; 0 for what stores nothing."""
        hybrid = self.constraints.program.hybrid
        assert hybrid is not None
        return self._at(hybrid.conjugates, y)

    def motions(self, y: Array) -> Any:
        """Return directions (columns) in which the closing joints of mechanisms let the states jump."""
        loops = self.constraints
        if not loops:
            return np.eye(len(y))
        _, rates = loops.slopes(self.time, self._state(y), self.mode)
        by_state = np.zeros((len(rates), loops.count))
        by_state[:, loops.speeds] = rates / loops.reach[loops.speeds]
        _, sizes, ways = np.linalg.svd((by_state[:, self.jumping] * self.scale)[loops.taking_rates])
        return ways[np.count_nonzero(sizes > RANK * sizes.max(initial=0.0)) :].T

    def closed(self, y: Array) -> Any:
        """Return the nearest values that keep loops of mechanisms closed."""
        if not self.constraints:
            return y
        return self.constraints.project(self.time, self._state(y), self.mode)[self.jumping] / self.scale

    def _state(self, y: Array) -> Any:
        state = np.array(self.start, dtype=float)
        state[self.jumping] = y * self.scale
        return state

    def _at(self, function: Callable[..., Any], y: Array) -> Any:
        return function(self.time, self.full(y), self.constraints.inputs, self.constraints.constants, self.mode)


def _in_scale(held: _Held, y: Array, size: Array) -> _Held:
    """Return the functions with rates of mechanisms in units that share one energy: a mechanism at rest has no magnitudes of its own. `size`: of contents.

    The energy is the largest that the momenta of those sizes give to a state. Rates without inertia get the unit of others of their kind.
    """
    allowed, ways = _slopes(held.conjugates, y), _slopes(held.stored, y)
    inertia = np.einsum("ij,ij->j", allowed, ways)
    firm = inertia > 0
    stake = np.abs(allowed[:, firm]).T @ size
    energy = np.maximum(stake**2 / inertia[firm], inertia[firm]).max(initial=0.0)
    rates = ~allowed[held.jumping].any(axis=1)
    scale = np.array(held.scale)
    scale[rates & firm] *= np.sqrt(energy / inertia[rates & firm])
    units = group_numbers([held.constraints.program.states.units[j] for j in held.jumping])
    usual = largest_of_group(np.where(rates & firm, scale, 0.0), units)
    return replace(held, scale=np.where(rates & ~firm & (usual > 0), usual, scale))


def _balanced(held: _Held, y: Array, old: Array) -> Any:
    """Return the values for which no impulse does work on a motion that the ties allow."""
    last = np.inf
    for _ in range(ITERATIONS):
        motions = held.motions(y)
        if not motions.shape[1]:
            return y
        allowed, ways = _slopes(held.conjugates, y) @ motions, _slopes(held.stored, y) @ motions
        matrix, right = allowed.T @ ways, allowed.T @ (held.stored(y) - old)
        rows = np.abs(matrix).max(axis=1)
        if not (np.isfinite(matrix).all() and (rows > 0).all()):
            break
        try:
            step = np.linalg.solve(matrix / rows[:, None], -right / rows)
        except np.linalg.LinAlgError:
            break
        ahead = _ahead(held.stored, y, motions @ step)
        if ahead is None:
            break
        ahead = held.closed(ahead)
        step, y = ahead - y, ahead
        size_of_step = float(np.abs(step).max())
        # limit of the difference quotients
        if size_of_step <= CLOSE or (size_of_step <= SEEN and size_of_step > 0.1 * last):
            return y
        last = size_of_step
    raise RunFailed(
        "BR772", f"at t = {held.time:.9g} s storages that are tied to each other by a switched junction find no common motion:",
        "put a resistor or a spring between them",
    )  # fmt: skip


def _ahead(function: Callable[[Any], Any], y: Array, step: Array) -> Any:
    """Return the end of a step, or of the longest of its halves that stays in the domain of the laws; None if none does."""
    for _ in range(HALVES):
        try:
            if np.isfinite(function(y + step)).all():
                return y + step
        except RunFailed:
            pass
        step = step / 2
    return None


def _slopes(function: Callable[[Any], Any], y: Array) -> Any:
    """Return central differences, shape (values, n); with a wide step for an affine function, so that rounding has no effect."""
    here, columns = function(y), []
    for way in np.eye(len(y)):
        try:
            ahead, behind = function(y + way), function(y - way)
        except RunFailed:  # a law that ends nearer than that
            return slopes_of(function, y, np.ones(len(y), dtype=bool), np.maximum(np.abs(y), FINEST))
        size = np.maximum(np.abs(ahead), np.abs(behind))
        if not (np.abs(ahead + behind - 2 * here) <= AFFINE * size).all():
            return slopes_of(function, y, np.ones(len(y), dtype=bool), np.maximum(np.abs(y), FINEST))
        columns.append(0.5 * (ahead - behind))
    return np.stack(columns, axis=1) if columns else np.zeros((len(here), 0))
