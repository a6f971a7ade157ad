"""Equilibrium search: rates and their derivatives by the states, with dense matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.scales import equilibrated, group_numbers, largest_of_group, nonzero, null_basis
from ..constraints.constraints import Constraints
from ..monitors.step_failure import not_finite
from ..segments.timeline import Segment
from .steady import CANCELLED, SHARE, drivers, given_terms, unread_states

LARGEST = 1e100  # states beyond it have no equilibrium
SINGULAR = 1e-12  # relative to the largest singular value
VECTORS = 0.1  # in units of the error of a row, which has `NULL_ENTRIES` n roundings: a component of a singular vector has some n
CLOSE = 1e-9  # size of the last correction, relative to the magnitude of a state
ROUNDING = 1e-12  # relative to the terms in a rate: a smaller rate is rounding where they cancel
RESTING = 1e-8  # relative to the terms in a rate: a larger rate is a motion
FIRST = 0.1  # of the time in which the first rates reach a magnitude: without restoring forces eigenvalues give no time
# Relative to the rates of the start: what a state far away leaves of them at most, a hundred times the error of the vectors that combine them.
BALANCED = 100 * SINGULAR
POLISHING, HALVES = 60, (0.3, 0.8)  # last corrections; the share that a root of several orders leaves of each
NOTHING = 1e-40  # relative to the magnitude of a state: zero, far below the squared rounding that Newton's method leaves of one
STEADY = 1e-7  # relative to the terms in a rate: a smaller change along a motion is none
AWAY = 1e6  # magnitudes of the start: a state beyond hides in its terms what drives those that it has made small
FAR = 1e9  # rad: an angle that something must restore
ALIKE = 0.1  # relative: a change of rates that is as derivatives say
FEW = 16  # values of a rate, of four times as many, if each is a rounding apart from the next
PLACES = (-1.7, 0.6, 3.1)  # along a motion, in magnitudes of the state that moves most: the rates are compared there


class EquilibriumSearch:
    """Rates and their derivatives by the states, with the unknowns of loops solved for."""

    def __init__(self, constraints: Constraints, first: Segment) -> None:
        self.constraints, self.program, self.count = constraints, constraints.program, constraints.count
        self.time, self.fixed = first.start, (constraints.inputs, constraints.constants, first.mode)
        self.loops, self.mode = constraints.loops(), first.mode
        self.largest, self.unseen = np.zeros(self.count), np.zeros(self.count)
        self.names = self.program.states.names
        self.group(self.program.states.units)
        self.basis: Any = None  # basis of the directions that loop joints allow at the current state
        self.farthest = LARGEST
        self.loop_terms: Any = 0.0  # terms of the loop unknowns in each rate at the current state
        self.terms: Any = None  # sizes of the terms in the derivatives at the current state
        # magnitudes, rates and terms of loop unknowns of the start, (n,) each, if there is a search
        self.begun: Any = None
        self.drag: Any = np.zeros(self.count)  # 1/s, on speeds
        self.largest_rate: tuple[Any, float] = (None, 0.0)  # derivatives, and their largest eigenvalue
        self.unread: Any = None  # mask (n,) of the states that nothing reads, set with the first state
        self.longest = 0.0  # length of the last step, s
        # factors of the states in sums that every motion keeps, a row for each, (sums, n)
        self.sums: Any = np.zeros((0, self.count))

    def group(self, units: Sequence[str]) -> None:
        """Set the groups of states of one unit, which are speeds, coordinates, and angles: those without a unit, unless no state has one."""
        self.kind = group_numbers(units)
        self.dimensional = np.array([unit != "1" for unit in units], dtype=bool)
        self.speeds, self.positions = np.isin(units, ("m/s", "1/s")), np.isin(units, ("m", "1"))
        self.turns = ~self.dimensional & ("1/s" in units)

    def at(self, full: Array) -> tuple[Any, Any, Any]:
        """Return state, rates, and their derivatives by the states alone."""
        full = self.constraints.project(self.time, full, self.mode)
        full = self.loops.solve(self.time, full, self.mode)
        if self.constraints:
            self.basis = self.constraints.tangents(self.time, full, self.mode)
        n = self.count
        self.leave_unread(full)
        slope = self.rates(full)
        whole = np.asarray(self.program.jacobian(self.time, full, *self.fixed))
        jacobian = whole[:n, :n].copy()
        self.loop_terms, self.terms = np.abs(whole[:n, n:]) @ np.abs(full[n:]), np.abs(jacobian)
        if len(full) > n:
            followed = np.linalg.solve(whole[n:, n:], whole[n:, :n])
            jacobian -= whole[:n, n:] @ followed
            self.terms += np.abs(whole[:n, n:]) @ np.abs(followed)
        jacobian -= np.diag(self.drag)
        jacobian[self.unread] = self.terms[self.unread] = 0.0
        self.largest = np.maximum(self.largest, np.abs(full[:n]))
        return full, slope, jacobian

    def leave_unread(self, full: Array) -> None:
        """Set which states nothing reads, with the first state: they are no part of the search, nor are sums with them."""
        if self.unread is None:
            self.unread = unread_states(self.constraints, self.time, full, self.mode)
            left, sizes, _ = np.linalg.svd(self.sums[:, self.unread])
            self.sums = left[:, int((sizes > CLOSE).sum()) :].T @ self.sums

    def derivatives_with_terms(self, full: Array) -> Any:
        """Return the derivatives by the states alone as a dense matrix (n, n), and put the sizes of their terms into `terms`; None where they have none."""
        return EquilibriumSearch.at(self, full)[2]

    def rates(self, full: Array) -> Any:
        """Return the rates of the states (n,), zero for those that nothing reads."""
        slope = np.array(self.program.derivative(self.time, full, *self.fixed))[: self.count]
        slope -= self.drag * full[: self.count]
        slope[self.unread] = 0.0
        return slope

    def first(self, slope: Array, jacobian: Any) -> float:
        """Return the length of the first step: that of the fastest mode, or of the relative rates of the states and of what these rates move."""
        size, moved = self.scale(np.zeros(self.count)), np.abs(jacobian) @ np.abs(slope)
        directly, later = slope != 0, moved > 0
        reach = float((size[directly] / np.abs(slope[directly])).min())
        reach = min(reach, float(np.sqrt(2 * size[later] / moved[later]).min(initial=np.inf)))
        fastest = self.fastest(jacobian)
        # half of it: where the fastest mode grows, an implicit step of just its time has no solution
        return min(0.5 / fastest, FIRST * reach) if fastest > 0 else FIRST * reach

    def fastest(self, jacobian: Array) -> float:
        """Return the largest eigenvalue, in 1/s."""
        if jacobian is not self.largest_rate[0]:
            self.largest_rate = jacobian, float(np.abs(np.linalg.eigvals(jacobian)).max(initial=0.0))
        return self.largest_rate[1]

    def scale(self, change: Array) -> Any:
        """Return magnitudes of the states, as far as they are known: states of one unit share the largest."""
        return nonzero(self.size(np.where(np.isfinite(change), np.abs(change), 0.0)))

    def size(self, change: Any) -> Any:
        """Return the same, 0 where nothing is known."""
        seen = largest_of_group(np.maximum(self.largest, change), self.kind)
        return np.where(seen > 0, seen, self.unseen)

    def begin(self, slope: Array, jacobian: Any) -> None:
        """Set magnitudes for units of which no state has a value: how far the first rates lead within the time of the fastest mode, and what follows."""
        self.begun = self.largest, np.abs(slope), self.loop_terms
        fastest = self.fastest(jacobian)
        if not 0 < fastest < np.inf:
            return
        # an angle at zero may turn by a radian, however long the fastest mode takes where gravity has no moment
        least = np.where(self.turns & ~(largest_of_group(self.largest, self.kind) > 0), 1.0, self.largest)
        reach = np.where(least > 0, least, np.abs(slope) / fastest)
        for _ in range(self.count):
            further = np.where(reach > 0, reach, np.abs(jacobian) @ reach / fastest)
            if (further == reach).all():
                break
            reach = further
        self.unseen = largest_of_group(np.where(np.isfinite(reach), reach, 0.0), self.kind)

    def close(self, full: Array, slope: Array, jacobian: Any) -> bool:
        """Return True if the equilibrium is near, in units of the magnitudes here and at the start: not of those on the way."""
        if self.distance(slope, jacobian) > CLOSE:
            return False
        self.largest = np.maximum(np.where(self.begun[0] > 0, self.begun[0], self.unseen), np.abs(full[: self.count]))
        return self.distance(slope, jacobian) <= CLOSE

    def step(self, full: Array, slope: Array, jacobian: Any, size: float) -> tuple[Any, Any, Any] | None:
        """Make one implicit Euler step; None if its result is not finite."""
        try:
            change, self.longest = self.euler(slope, jacobian, size), size
            trial = self.at(np.concatenate([full[: self.count] + change, full[self.count :]]))
        except (np.linalg.LinAlgError, RunFailed):
            return None
        return trial if np.isfinite(trial[1]).all() and np.isfinite(trial[2].sum()) else None

    def euler(self, slope: Array, jacobian: Array, size: float) -> Any:
        """Return the change of the states in one implicit step. Raises LinAlgError."""
        if self.basis is None:
            changes = np.linalg.solve(np.eye(self.count) / size - jacobian, np.column_stack([slope, self.sums.T]))
            return self.with_sums(changes)
        inner = self.basis.T @ jacobian @ self.basis
        return self.basis @ np.linalg.solve(np.eye(len(inner)) / size - inner, self.basis.T @ slope)

    def with_sums(self, found: Array) -> Any:
        """Return the first column, the change of a step, without what its rounding makes of conserved sums: as much as there is where a step is as long as
        the slowest motion. The other columns are what the same step makes of the factors of the sums."""
        change, ways = found[:, 0], found[:, 1:]
        if not ways.shape[1] or self.drag.any():
            return change
        return change - ways @ np.linalg.solve(self.sums @ ways, self.sums @ change)

    def correction(self, slope: Array, jacobian: Any, noise: Any = None) -> Any:
        """Return Newton's minimum-norm step, which is zero along directions without restoring force. Infinite if nothing balances the rates.

        `noise`: rounding error of each rate, if not that of the current state."""
        seen = self.scale(np.zeros(self.count))
        noise = ROUNDING * (np.abs(jacobian) @ seen + self.loop_terms) if noise is None else noise
        seen = self.moved(seen, jacobian)
        if self.basis is not None:  # only along the directions that loop joints allow
            basis, size = self.basis, np.abs(self.basis)
            terms = None if self.terms is None else size.T @ self.terms @ size
            change = self._least(
                basis.T @ slope, basis.T @ jacobian @ basis, size.T @ noise, np.ones(basis.shape[1]), terms
            )
            return basis @ change if np.isfinite(change).all() else np.full(self.count, np.inf)
        return self._least(slope, jacobian, noise, seen, self.terms)

    def null_spaces(self, jacobian: Array, terms: Array) -> tuple[Any, Any]:
        """Return bases (n, k) of the left and right null spaces of derivatives up to the rounding of their terms."""
        matrix, rows, columns = equilibrated(jacobian)
        left, sizes, right = np.linalg.svd(matrix)
        rank = self._rank(matrix, terms / rows[:, None] / columns, sizes, right)
        return left[:, rank:] / rows[:, None], right[rank:].T / columns[:, None]

    @staticmethod
    def _rank(matrix: Array, terms: Array | None, sizes: Array, right: Array) -> int:
        """Return the rank: a slow mode beside stiff ones is as small as rounding, but its rates are none."""
        rank = int((sizes > SINGULAR * sizes[0]).sum())
        while terms is not None and rank < len(sizes) and not null_basis(matrix, terms, right[rank:], VECTORS)[1].all():
            rank += 1
        return rank

    def _least(self, slope: Array, jacobian: Array, noise: Array, size: Array, terms: Array | None) -> Any:
        rows = np.abs(jacobian).max(axis=1)
        if not (np.isfinite(rows).all() and np.isfinite(slope).all()):
            return np.full(len(slope), np.inf)
        matrix, rows, columns = equilibrated(jacobian * size)
        columns = columns / size
        left, sizes, right = np.linalg.svd(matrix)
        rank = self._rank(matrix, None if terms is None else terms / rows[:, None] / columns, sizes, right)
        needed = -slope / rows
        if rank < len(slope):  # part of the rates that no change of the states can cancel
            lost = left[:, rank:].T
            allowed = CLOSE * (np.abs(lost) @ np.abs(needed)) + np.abs(lost) @ (noise / rows)
            if (np.abs(lost @ needed) > allowed).any():
                return np.full(len(slope), np.inf)
            conserved = lost / rows / columns  # conserved quantities (w with w J = 0) stay unchanged
            conserved = conserved / np.linalg.norm(conserved, axis=1, keepdims=True)
            whole, wanted = np.concatenate([matrix, conserved]), np.concatenate([needed, np.zeros(len(conserved))])
            smallest = sizes[rank - 1] / sizes[0] if rank else 1.0
            change = np.linalg.lstsq(whole, wanted, rcond=min(SINGULAR, 0.1 * smallest))[0]
            # a conserved quantity may drive the rates: then there is no equilibrium
            beside = np.abs(whole @ change - wanted)
            allowed = CLOSE * max(np.abs(needed).max(), np.abs(change).max()) + np.concatenate(
                [noise / rows, np.zeros(len(conserved))]
            )
            return change / columns if (beside <= allowed).all() else np.full(len(slope), np.inf)
        change = right[:rank].T @ ((left[:, :rank].T @ needed) / sizes[:rank])
        return change / columns

    def distance(self, slope: Array, jacobian: Any) -> float:
        """Return the distance of the equilibrium, in units of the magnitudes."""
        if (np.abs(slope) <= ROUNDING * (np.abs(jacobian) @ self.largest + self.loop_terms)).all():
            return 0.0  # the magnitude of a change is unknown where only rounding moves
        change = self.correction(slope, jacobian)
        seen = self.moved(self.scale(change), jacobian)
        return float((np.abs(change) / seen).max(initial=0.0))

    def moved(self, seen: Array, jacobian: Any) -> Any:
        """Return magnitudes (n,) raised by the effect of other states within the time of the fastest mode.

        So a speed that only rounding ever moves has a magnitude nevertheless.
        """
        fastest = self.fastest(jacobian)
        return np.maximum(seen, np.abs(jacobian) @ seen / fastest) if fastest > 0 else seen

    def polished(self, full: Array, slope: Array, jacobian: Any) -> Any:
        """Apply the last corrections, to round-off; those of a root of several orders go on to where its rates are nothing."""
        last, n = 0.0, self.count
        for number in range(POLISHING):
            try:
                self.longest *= 2.0
                keeps = len(self.sums) and self.longest
                change = self.euler(slope, jacobian, self.longest) if keeps else self.correction(slope, jacobian)
            except np.linalg.LinAlgError:
                break
            size = float((np.abs(change) / self.scale(np.zeros(n))).max(initial=0.0))
            if not np.isfinite(size) or (number > 2 and not HALVES[0] * last < size < HALVES[1] * last):
                break  # the remainder is rounding
            last = size
            full, slope, jacobian = self.at(np.concatenate([full[:n] + change, full[n:]]))
        size = NOTHING * self.scale(np.zeros(self.count))
        return np.concatenate(
            [np.where(np.abs(full[: self.count]) < size, 0.0, full[: self.count]), full[self.count :]]
        )

    # ------------------------------------------------------------ messages
    def steady_motion(self, full: Array, slope: Array, jacobian: Any) -> RunFailed | None:
        """Return the refusal of a start whose rates stay what they are while it moves: a rolling wheel or a rotor whose angle the laws read.

        From there a search would stop the motion, and its rest would be another one. None for any other start."""
        if self.program.hybrid is not None:  # a condition may see the motion
            return None
        size = self.scale(np.zeros(self.count))
        terms = np.abs(jacobian) @ self.moved(size, jacobian) + self.loop_terms
        moving = np.where(np.abs(slope) > RESTING * terms, slope, 0.0)
        if not moving.any() or (self.size(0.0)[(moving != 0) & self.dimensional] == 0).any():  # how far is unknown
            return None
        way = moving / (np.abs(moving) / size).max()  # as far as one state moves by its magnitude
        allowed = STEADY * terms
        if not (np.abs(jacobian @ way) <= allowed).all():
            return None
        largest, basis, loop_terms = self.largest, self.basis, self.loop_terms
        try:
            ahead = [self.at(np.concatenate([full[: self.count] + s * way, full[self.count :]])) for s in PLACES]
        except (np.linalg.LinAlgError, RunFailed):
            ahead = []
        self.largest, self.basis, self.loop_terms = largest, basis, loop_terms
        if not ahead or not all((np.abs(rates - slope) <= allowed).all() for _, rates, _ in ahead):
            return None
        name = self.names[int(np.argmax(np.abs(way) / size))]
        return RunFailed(
            "BR754", f"no equilibrium was found: the start is a steady motion, in which `{name}` goes on and nothing else changes;",
            'start it without that motion, or analyse what is near the motion with `--at start` (in Python `state="start"`)',
        )  # fmt: skip

    def rested(self, full: Array) -> Any:
        """Return the state, if all its rates vanish at its scales. Raises `RunFailed` otherwise."""
        full, slope, jacobian = self.at(full)
        terms = np.abs(jacobian) @ self.moved(self.scale(np.zeros(self.count)), jacobian) + self.loop_terms
        # accelerations are solved for together: rounding of one affects all
        shared = largest_of_group(terms, self.kind)
        resting = np.abs(slope) <= np.maximum(RESTING * terms, CANCELLED * shared)
        if not resting.all() and not self.cancels(full, np.where(resting, 0.0, slope)):
            raise self.no_rest(slope)
        if self.begun is None:
            return full
        self.refuse_spin(full, slope, jacobian)
        self.largest = self.begun[0]  # what a motion has made large hides nothing that drives it
        here, scale = np.abs(full[: self.count]), self.scale(np.zeros(self.count))
        own = np.abs(jacobian) @ np.maximum(here, ROUNDING * scale) + self.loop_terms
        if (here > AWAY * scale).any() and (np.abs(slope) > np.maximum(RESTING * own, BALANCED * self.begun[1])).any():
            raise self.no_rest(slope)
        terms = np.abs(jacobian) @ self.scale(np.zeros(self.count)) + self.begun[2]
        noise = ROUNDING * terms + BALANCED * self.begun[1]
        if (np.abs(slope) > noise).any() and not (
            np.isfinite(self.correction(slope, jacobian, noise)).all() or self.cancels(full, slope)
        ):
            raise self.no_rest(slope)
        return full

    def refuse_spin(self, full: Array, slope: Array, jacobian: Any) -> None:
        """Raise `RunFailed` for an angle that turned so far that rounding stopped it: nothing restores it there as the derivatives say."""
        for i in np.flatnonzero(self.turns & (np.abs(full[: self.count]) > FAR)):
            step = np.where(np.arange(len(full)) == i, SHARE * full, 0.0)
            change, expected = self.at(full + step)[1] - slope, jacobian @ step[: self.count]
            if not expected.any() or (np.abs(change - expected) > ALIKE * np.abs(expected).max()).any():
                raise RunFailed(
                    "BR789", f"no equilibrium was found: `{self.names[i]}` turns for ever, and nothing stops that motion;",
                    'start it without that motion, or analyse what is near the motion with `--at start` (in Python `state="start"`)',
                )  # fmt: skip

    def cancels(self, full: Array, slope: Array) -> bool:
        """Return True if all rates are rounding of terms of parameters and inputs that cancel each other."""
        terms = given_terms(self.constraints, self.time, full, self.mode)
        terms[self.unread] = np.inf
        return bool((np.abs(slope) <= CANCELLED * terms).all())

    def steps_by_rounding(self, full: Array) -> bool:
        """Return True if all rates of the start take few values on the way that should bring them to zero and beyond: each a rounding apart, of numbers
        that cancel. Far from the start it would be what a motion has made large."""
        full, slope, jacobian = self.at(full)
        change = self.correction(slope, jacobian)
        if not np.isfinite(change).all():
            return False
        way = np.concatenate([change, np.zeros(len(full) - self.count)])
        rates = np.array([self.at(full + share * way)[1] for share in np.linspace(0.0, 2.0, 4 * FEW)])
        if not np.isfinite(rates).all():
            return False
        counts = [np.unique(row, return_counts=True)[1] for row in rates.T[slope != 0]]
        return all(
            len(often) <= FEW and often.min() > 1 for often in counts
        )  # a law with ends has one value once, and few beyond

    def not_finite(self, slope: Array, full: Array) -> RunFailed:
        """Return the error for rates that are not finite where the search begins."""
        return not_finite(self.program, self.time, slope, full, self.mode)

    def drivers(self, place: int) -> str:
        """Return the states that a rate reads, for messages."""
        return drivers(self.program, place)

    def no_rest(self, slope: Array) -> RunFailed:
        """Return the error that names the state that keeps moving, and its drivers."""
        if self.begun is not None:
            self.largest = self.begun[0]  # beside what it has become, a state that drifts has a small rate
        sizes = np.abs(slope) / self.scale(np.zeros(self.count))
        worst = int(np.argmax(np.where(np.isfinite(sizes), sizes, np.inf)))
        return RunFailed(
            "BR755", f"no equilibrium was found: the rate of `{self.names[worst]}` does not vanish (now {slope[worst]:.6g}); {self.drivers(worst)}; does "
            "something drive the model for ever, is it unstable there, or does rounding of large terms hide what restores it?",
        )  # fmt: skip
