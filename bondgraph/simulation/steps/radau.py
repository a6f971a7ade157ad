"""Radau IIA of order 5 for M y' = f(t, y) with M = diag(1 … 1, 0 … 0): differential equations, and those with unknowns of loops.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.8 (the method, its simplified Newton iteration, its
error estimate) and VI.1 (problems with M). Four things differ from the program that comes with that book:

- Within a step the quintic through values and derivatives at the last three step ends is evaluated, which has the order of the
  method; the derivative at a step's end is that of the collocation polynomial, so that stiffness does not magnify its error.
- The caller gives states divided by their magnitudes, and a factorisation that scales rows.
- At the end of a step, the unknowns of loops must solve their equations, whatever Jacobian the iteration used.
- A step that is rejected repeatedly although it gets shorter is distinguished from one that is too long: the remaining error is round-off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .ends import End, hermite
from .false_position import false_position
from .tolerances import (
    ASIDE,
    FINEST,
    FIRST,
    RINGING,
    STAGNANT,
    allowed_estimate,
    creeping_tolerance,
    first_length,
    newton_tolerance,
    stagnation_tolerance,
)

_S6 = 6**0.5
C = np.array([(4 - _S6) / 10, (4 + _S6) / 10, 1.0])
E = np.array([-13 - 7 * _S6, -13 + 7 * _S6, -1]) / 3  # weights of the error estimate
MU_REAL = 3 + 3 ** (2 / 3) - 3 ** (1 / 3)  # eigenvalues of the inverse of the method's matrix
MU_COMPLEX = 3 + 0.5 * (3 ** (1 / 3) - 3 ** (2 / 3)) - 0.5j * (3 ** (5 / 6) + 3 ** (7 / 6))
T = np.array(
    [
        [0.09443876248897524, -0.14125529502095421, 0.03002919410514742],
        [0.25021312296533332, 0.20412935229379994, -0.38294211275726192],
        [1, 1, 0],
    ]
)
TI = np.array(
    [
        [4.17871859155190428, 0.32768282076106237, 0.52337644549944951],
        [-4.17871859155190428, -0.32768282076106237, 0.47662355450055044],
        [0.50287263494578682, -2.57192694985560522, 0.59603920482822492],
    ]
)
TI_REAL, TI_COMPLEX = TI[0], TI[1] + 1j * TI[2]
# The collocation polynomial is y0 + Z.T P [s, s^2, s^3]; D gives its derivative at the end.
P = np.array(
    [
        [13 / 3 + 7 * _S6 / 3, -23 / 3 - 22 * _S6 / 3, 10 / 3 + 5 * _S6],
        [13 / 3 - 7 * _S6 / 3, -23 / 3 + 22 * _S6 / 3, 10 / 3 - 5 * _S6],
        [1 / 3, -8 / 3, 10 / 3],
    ]
)
D = P @ np.array([1.0, 2.0, 3.0])
INNER = tuple(C[:-1].tolist())  # fractions of a step at which the limits of a model are checked
NEWTON_ITERATIONS = 6
SLOWEST = 0.9  # largest contraction assumed for a single component of the stages
CREEPING = 0.5  # contraction below which components need no separate check
UNSOLVED = 0.5  # ratio to the residual of a loop equation before the last change: a larger one is no solution
SOLVED = 0.01  # in units of the tolerance: error of a loop unknown that counts as solved
NOISE = 1e-15  # relative to the terms of a loop equation: smaller residuals count as zero
ROUNDED = 1e-12  # relative to the terms of such an equation: rounding
STIFF = 300.0  # relative change of a state in a step, if the others did not follow, from which it counts as stiff
SURE = 0.3  # in units of the tolerance: two polynomials within a step that differ by less are accurate
NEAR = 1e-4  # fraction of a step: distance of two values of a difference quotient
SLOW = 0.1  # contraction above which Newton's method computes the Jacobian again there
BACK_ITERATIONS, BACK_PATIENT = 8, 1  # iterations of Newton's method there; successive slow ones with a new Jacobian
LEFT = 1e-3  # in units of the tolerance: its remaining error
FIRST_ULPS = 1e3  # in units in the last place of the time: least first step
SMALLEST, LARGEST = 0.2, 8.0  # ratios of two steps
GROWN = 2.0  # factor behind a step whose estimate is rounding: a longer step has less
# A step over a kink of a law with an error above this fraction of the tolerance ends at the kink instead, unless the kink is nearer to
# its start than a fraction of it; but not repeatedly.
BENT, NEAREST, MOST_BENDS = 0.1, 1e-2, 4
ON_IT = 1e-6  # relative to the values of a kink function in a step: smaller values count as zero
CLOSE = 1e-9  # fraction of a step: accuracy of the place of a kink
BEYOND = 1e-6  # fraction of a step that ends at a kink: distance behind it at which the other side is evaluated
STUBBORN, SHORTER = 8, 1e-3  # rejected tries after which steps shorter by this factor must have reduced the error
PATIENT = 3  # rejected tries after which steps get much shorter


class Factorised(Protocol):
    """A factorised matrix."""

    @property
    def negative(self) -> bool:
        """True if the determinant of a real matrix is negative, where its sign is known."""
        ...

    def solve(self, right: Any) -> Any: ...


Factorise = Callable[[Any], Factorised]


class StepFailed(Exception):
    """Raised if no step is short enough; `what` failed last: newton, error, or round-off where shorter steps were no better."""

    def __init__(self, what: str) -> None:
        self.what = what


@dataclass(slots=True)
class Problem:
    """M y' = f(t, y), with its Jacobian and a matching factorisation. `differential` marks the rows where M is 1."""

    function: Callable[[float, Any], Any]
    jacobian: Callable[[float, Any], Any]
    shifted: Callable[[complex, Any], Factorised]  # (mu/h, J) -> mu/h M - J, factorised
    differential: Any
    relative: float
    absolute: Any  # per state
    follows: Callable[[float, float], bool]  # start, stop -> True if a step resolves the signals of time
    longest: float = np.inf  # no step is longer
    hold: Callable[[float, Any], Any] | None = None  # projects the end of a step on the invariants of the states
    bends: Callable[[float, Any], Any] | None = None  # time, state -> kink functions, zero where a law has a kink
    terms: Callable[[Any, Any], Any] = lambda jacobian, state: 0.0  # per row, the sum of the sizes of its terms
    mode: Any = None  # the conditions used by the functions, to be changed in place


class Radau:
    """Radau IIA from `time` to `stop`; after each `step()` the last one can be sampled."""

    def __init__(self, problem: Problem, time: float, state: Any, stop: float, size: float = np.inf) -> None:
        self.problem, self.time, self.state, self.stop = problem, time, state, stop
        self.evaluations = {"derivative": 0, "jacobian": 0, "factorisation": 0}
        self.rejected = 0
        self.error: Any = np.zeros(len(state))  # error of the last step, in units of its tolerance
        self._rate = self._function(time, state)
        self._size = size if np.isfinite(size) else self._first_size()
        self._newton_tolerance = newton_tolerance(problem.relative)
        self._first_newton_tolerance = newton_tolerance(problem.relative, FIRST)
        self._stagnation_tolerance = stagnation_tolerance(problem.relative)
        self._creeping_tolerance = creeping_tolerance(problem.relative)
        self._allowed = allowed_estimate(problem.relative)
        self.rounded = 0.0  # the most tolerances of rounding that a step was accepted with
        self._jacobian: Any = None
        self._explicit = bool(np.all(problem.differential))  # neither unknowns of loops nor of loop joints
        self._has_loops = not self._explicit and problem.hold is None
        self._current = False  # True if the Jacobian belongs to this state
        self._side: Any = None  # side of the kinks at which it was computed
        self._real: Factorised | None = None
        self.factors: Factorised | None = None  # real factors of the last step
        self._complex: Factorised | None = None
        self._stages: Any = None  # stages of the last step, relative to its start
        self._factorised_size = 0.0
        self._ends = [End(time, state, None)]
        self._last_size, self._last_error = 0.0, 0.0

    # ------------------------------------------------------------ what a run asks
    @property
    def finished(self) -> bool:
        """True if the end is reached."""
        return self.time >= self.stop

    parts = 1  # parts of a step that are searched for events separately

    @property
    def inner(self) -> tuple[float, ...]:
        """Fractions of a step at which the limits of a model are checked."""
        return INNER

    def put_mode(self, mode: Any) -> None:
        """Set the mode from now on."""
        self.problem.mode[:] = mode

    def begin_with(self, size: float) -> None:
        """Limit the next step to this size."""
        self._size = size

    def hold_to(self, absolute: Any) -> None:
        """Set the absolute tolerances from now on."""
        self.problem.absolute = absolute

    @property
    def wish(self) -> float:
        """Size of the next step if nothing else limits it."""
        return self._size

    @property
    def last_step(self) -> tuple[float, float]:
        """Start and end of the last step."""
        return self._ends[-2].time, self._ends[-1].time

    def step(self) -> None:
        """Make one accepted step. Raises `StepFailed`."""
        problem, time, state = self.problem, self.time, self.state
        least = 10 * np.abs(np.nextafter(time, np.inf) - time)
        size, reason = min(self._size, self.stop - time, problem.longest), "error"
        norms: list[float] = []  # errors of the rejected tries
        sizes: list[float] = []
        bent = 0  # number of times that the step was cut at a kink
        if time + 1.01 * size >= self.stop:
            size = self.stop - time
        while size > 2 * least and not problem.follows(time, time + size):
            size *= 0.5
        if self._jacobian is None:
            self._renew(time, state)
        while True:
            if size < least and time + size < self.stop:
                raise StepFailed(reason)
            end = self.stop if time + size >= self.stop else time + size
            size = end - time
            scale = problem.absolute + np.abs(state) * problem.relative
            found = self._newton(time, state, size, self._guess(size), scale)
            if found is None:
                reason = "newton"
                if not self._current:
                    self._renew(time, state)
                else:
                    size *= 0.5
                continue
            stages, iterations, rate = found
            new = state + stages[-1]
            error = self._estimate(time, state, size, stages, new, bool(norms))
            norm = _norm(error)
            safety = 0.9 * (2 * NEWTON_ITERATIONS + 1) / (2 * NEWTON_ITERATIONS + iterations)
            if norm > BENT and bent < MOST_BENDS and problem.bends is not None:
                share = self._bend(time, state, size, stages)
                if share < 1:
                    bent, size = bent + 1, share * size
                    continue
            norm = 1.0 if norm > 1 and self._is_rounding(time, state, norm, scale) else norm
            if norm <= 1 and self._misses(end, new, size, scale):
                reason, size = "newton", 0.5 * size if self._current else size
                self._renew(time, state)
                continue
            if not norm <= 1:
                reason = "error"
                factor = 0.1 if not np.isfinite(norm) else self._factor(size, norm)
                sizes.append(size)
                # The error of an oscillating stiff mode is equal for all steps longer than its period: reduce those quickly.
                size *= max(SMALLEST, safety * factor) if len(norms) < PATIENT else SMALLEST
                self.rejected += 1
                norms.append(norm)
                self.error = error
                stubborn = len(norms) >= STUBBORN and sizes[-1] < SHORTER * sizes[-STUBBORN]
                if stubborn and norm > 0.5 * norms[-STUBBORN]:
                    raise StepFailed("round-off")
                continue
            break
        self._accept(end, new, stages, size, norm, safety, bool(norms), iterations, rate)
        if bent:
            self._ends = [self._ends[-2], self._ends[-1]]  # no polynomial spans a kink
            self._size = max(self._size, size / max(share, NEAREST))
        if problem.bends is not None:
            self._look_at_side(BEYOND * size if bent else 0.0)
        self.error = error

    def _look_at_side(self, ahead: float) -> None:
        """Renew the Jacobian after a step if it belongs to the other side of a kink, also where the step ends at one: it would hide errors filtered by it."""
        time, state = self.time + ahead, self.state + ahead * self._rate
        if (self._side_at(time, state) != self._side).any():
            self._renew(time, state)

    def _side_at(self, time: float, state: Any) -> Any:
        """Return the side of each kink at which a state lies: the signs of the kink functions; None if there are none."""
        bends = self.problem.bends
        return np.sign(bends(time, state)) if bends is not None else None

    def _bend(self, time: float, state: Any, size: float, stages: Any) -> float:
        """Return the fraction of a step at which a law first has a kink, along the collocation polynomial; 1 if there is none."""
        bends = self.problem.bends
        assert bends is not None

        def at(share: float) -> Any:
            powers = np.array([share, share**2, share**3])
            return bends(time + share * size, state + (P @ powers) @ stages)

        seen = np.stack(
            [bends(time, state), *(bends(time + c * size, state + z) for c, z in zip(C, stages, strict=True))]
        )
        seen[0][np.abs(seen[0]) <= ON_IT * np.abs(seen).max(axis=0)] = 0.0  # zero at the end of the last step
        places = np.array([0.0, *C])
        first = 1.0
        for row, column in zip(*np.nonzero(seen[:-1] * seen[1:] < 0), strict=True):
            if places[row] < first:
                ends = (places[row], places[row + 1], seen[row, column], seen[row + 1, column])
                found = false_position(at, column, *ends)
                if found > NEAREST:
                    first = min(first, found)
        return first if first < 1 - CLOSE else 1.0

    def sample(self, times: Any) -> Any:
        """Return states at instants within the last step; shape (times, n).

        The quintic through the last step ends, unless it differs from the collocation polynomial (order 3) by more than that one's error: then a law had a
        kink within the steps that it spans.
        """
        times = np.asarray(times)
        after, cubic = self._ends[-1], self.collocation(times)
        if not self.has_quintic:
            return cubic
        quintic = hermite(self._ends, times)
        problem = self.problem
        limit = 10 * (problem.absolute + problem.relative * np.abs(after.state))
        return np.where((np.abs(quintic - cubic) <= limit) & np.isfinite(limit), quintic, cubic)

    def interpolated(self, times: Any) -> Any:
        """Return the polynomial through the last step ends, or the collocation polynomial where these are too few; shape (times, n)."""
        return hermite(self._ends, times) if self.has_quintic else self.collocation(times)

    @property
    def jacobian(self) -> Any:
        """The Jacobian used last."""
        return self._jacobian

    @property
    def has_quintic(self) -> bool:
        """True if three step ends are known."""
        return len(self._ends) == 3

    @property
    def state_at_end(self) -> Any:
        """State at the end of the last step."""
        return self._ends[-1].state

    def collocation(self, times: Any) -> Any:
        """Return the collocation polynomial of the last step; shape (times, n).

        The step adds its integral to a state: integrals along it agree with the states, stiff parts included.
        """
        before, after = self._ends[-2:]
        s = (np.asarray(times) - before.time) / (after.time - before.time)
        value: Any = before.state + (np.stack([s, s**2, s**3]).T @ P.T) @ self._stages
        return value

    # ------------------------------------------------------------ the step
    def _function(self, time: float, state: Any) -> Any:
        self.evaluations["derivative"] += 1
        return self.problem.function(time, state)

    def _renew(self, time: float, state: Any) -> None:
        self.evaluations["jacobian"] += 1
        self._jacobian = self.problem.jacobian(time, state)
        self._current, self._real = True, None
        self._side = self._side_at(time, state)

    def _first_size(self) -> float:
        """Return the first step size after Hairer, Nørsett and Wanner, Solving ODEs I, section II.4, from rates of the differential part.

        A state below its tolerance, as after a jump from a large value, gives no size: there a step that changes all states by a hundredth of the
        tolerance is short enough.
        """
        problem, span = self.problem, self.stop - self.time
        scale = problem.absolute + np.abs(self.state) * problem.relative

        def size(x: Any) -> float:
            return _norm(np.where(problem.differential & np.isfinite(scale), x / scale, 0.0))

        d0, d1 = size(self.state), size(self._rate)
        h0 = 1e-6 * span if d0 < 1e-5 or d1 * span < 1e-5 else 0.01 * max(d0, 1.0) / d1
        h0 = min(h0, span) if np.isfinite(h0) else 1e-6 * span
        moved = self.state + h0 * np.where(problem.differential, self._rate, 0.0)
        d2 = size(self._function(self.time + h0, moved) - self._rate) / h0
        h1 = first_length(d1, d2, 0.25)
        if not np.isfinite(h1):
            h1 = h0
        return float(min(max(min(100 * h0, h1), FIRST_ULPS * float(np.spacing(self.time))), span))

    def _guess(self, size: float) -> Any:
        """Return stages extrapolated from the last step's polynomial."""
        if self._stages is None or self._last_size == 0:
            return np.zeros((3, len(self.state)))
        s = 1 + C * size / self._last_size
        powers = np.stack([s, s**2, s**3])
        return (powers.T @ P.T) @ self._stages - self._stages[-1]

    def _newton(self, time: float, state: Any, size: float, stages: Any, scale: Any) -> tuple[Any, int, float] | None:
        """Iterate for the stages by simplified Newton; return `(stages, iterations, rate)`, or None if it does not converge."""
        m = self.problem.differential
        if self._real is None or abs(size - self._factorised_size) > 1e-9 * size:
            self.evaluations["factorisation"] += 2
            self._factorised_size = size
            try:
                self._real = self.factors = self.problem.shifted(MU_REAL / size, self._jacobian)
                self._complex = self.problem.shifted(MU_COMPLEX / size, self._jacobian)
            except (ValueError, RuntimeError, np.linalg.LinAlgError):
                self._real = None
                return None
        assert self._complex is not None
        if self._explicit and self._real.negative:
            return None  # a mode grows by exp(MU_REAL) or more within the step, and the method would damp it
        w = TI @ stages
        f = np.empty_like(stages)
        m_real, m_complex = MU_REAL / size * m, MU_COMPLEX / size * m
        last, rate = None, 0.0
        before: Any = None
        noise = self._noise(state) if self._has_loops else None
        for iteration in range(NEWTON_ITERATIONS):
            for i in range(3):
                f[i] = self._function(time + size * C[i], state + stages[i])
            if not np.isfinite(f).all():
                return None
            if noise is not None:
                f[np.abs(f) <= noise] = 0.0
            change = np.empty_like(w)
            change[0] = self._real.solve(TI_REAL @ f - m_real * w[0])
            both = self._complex.solve(TI_COMPLEX @ f - m_complex * (w[1] + 1j * w[2]))
            change[1], change[2] = both.real, both.imag
            share = np.abs(change) * (1 / scale)
            norm = _norm(share)
            if not np.isfinite(norm):
                return None
            if last:
                rate = norm / last
                left = NEWTON_ITERATIONS - iteration
                if rate >= 1 or rate**left / (1 - rate) * norm > self._newton_tolerance:
                    return self._stagnant(time, state, scale, (stages, iteration + 1, 0.0), f[2], norm)
            w += change
            stages = T @ w
            first = self._last_size == 0 and iteration + 1 < NEWTON_ITERATIONS
            asked = self._first_newton_tolerance if first else self._newton_tolerance
            creeps = bool(last) and _left(share, before) >= self._creeping_tolerance
            if norm == 0 or (last and rate / (1 - rate) * norm < asked and not creeps):
                self._residual = f[2]
                return stages, iteration + 1, rate
            last, before = norm, share
        return self._stagnant(time, state, scale, (stages, NEWTON_ITERATIONS, 0.0), f[2], last or np.inf)

    def _stagnant(
        self, time: float, state: Any, scale: Any, answer: tuple[Any, int, float], residual: Any, norm: float
    ) -> tuple[Any, int, float] | None:
        """Return the answer of an iteration that no longer improves, if the remainder is rounding (see `rounding`); else None."""
        if norm > self._stagnation_tolerance or not norm <= STAGNANT * self.rounding(time, state, scale):
            return None
        self._residual, self.rounded = residual, max(self.rounded, norm)
        return answer

    def _is_rounding(self, time: float, state: Any, norm: float, scale: Any) -> bool:
        """Return whether an estimate is rounding, which a shorter step has more of: followed, it leads to modes far below the tolerance."""
        share = norm * self._allowed
        if self.problem.relative >= FINEST or not share <= self._stagnation_tolerance:
            return False
        if share > RINGING * self.rounding(time, state, scale):
            return False
        self.rounded = max(self.rounded, share)
        return True

    def rounding(self, time: float, state: Any, scale: Any) -> float:
        """Return the norm of the rounding error of a stage, in units of the tolerance, from a second difference of the rates over a very short distance.

        Laws with large numbers that nearly cancel, as lengths of a mechanism next to its displacements, have larger rounding errors than the states.
        """
        assert self._real is not None
        aside = ASIDE * state * np.where(np.arange(len(state)) % 2, -1.0, 1.0)
        bent = self._function(time, state + aside) - 2 * self._rate + self._function(time, state - aside)
        return _norm(self._real.solve(np.where(np.isfinite(bent), bent, 0.0)) / scale)

    def _noise(self, state: Any) -> Any:
        """Return the rounding level of the loop equations, shape (n,); negative for the others.

        Where only leakage determines an unknown, corrections by rounding would never end.
        """
        problem = self.problem
        return np.where(problem.differential, -1.0, NOISE * problem.terms(self._jacobian, state))

    def _misses(self, end: float, new: Any, size: float, scale: Any) -> bool:
        """Return True if the unknowns of loops do not solve their equations at the end of a step.

        A Jacobian of another place, as of a diode that no longer conducts, may be so much too steep that iterations change nothing. Where the residual is as
        large as before the last iteration, the Jacobian at the end gives the error.
        """
        if not self._has_loops:
            return False
        self._ahead = self._function(end, new)
        left = np.where(self.problem.differential, 0.0, self._ahead)
        terms = self.problem.terms(self._jacobian, new)
        if (np.abs(left) <= np.maximum(ROUNDED * terms, UNSOLVED * np.abs(self._residual))).all():
            return False
        current = self._current
        self._renew(end, new)
        self.evaluations["factorisation"] += 1
        try:
            self.factors = self.problem.shifted(MU_REAL / size, self._jacobian)
            off = self.factors.solve(left) / scale
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            off = np.array([np.inf])
        self._current = current
        return not np.abs(off[~self.problem.differential]).max() <= SOLVED

    def _estimate(self, time: float, state: Any, size: float, stages: Any, new: Any, rejected: bool) -> Any:
        """Return the error in units of the tolerance, filtered through the real matrix as often as needed for stiff parts."""
        assert self._real is not None
        problem = self.problem
        scale = self._allowed * (problem.absolute + np.maximum(np.abs(state), np.abs(new)) * problem.relative)
        rest = np.where(problem.differential, E @ stages / size, 0.0)
        error = self._real.solve(self._without_noise(self._rate, state) + rest)
        if _norm(error / scale) > 1 and (rejected or self._stages is None or self._last_size == 0):
            error = self._real.solve(self._without_noise(self._function(time, state + error), state) + rest)
        return error / scale

    def _without_noise(self, rates: Any, state: Any) -> Any:
        """Return rates with residuals of loop equations below rounding set to zero."""
        return np.where(np.abs(rates) <= self._noise(state), 0.0, rates) if self._has_loops else rates

    def _factor(self, size: float, norm: float) -> float:
        """Return the step-size factor from the last two errors (Gustafsson; Hairer and Wanner, section IV.8)."""
        if norm == 0:
            return LARGEST
        factor: float = norm**-0.25
        if self._last_error > 0 and self._last_size > 0:
            factor = min(factor, size / self._last_size * (self._last_error / norm) ** 0.25 * factor)
        return factor

    def _accept(
        self, end: float, new: Any, stages: Any, size: float, norm: float, safety: float, rejected: bool, iterations: int, rate: float,
    ) -> None:  # fmt: skip
        if self.problem.hold is not None:
            new = self.problem.hold(end, new)
        self._ends = [*self._ends[-2:], End(end, new, D @ stages / size)]
        factor = (
            1.0 if norm == 1.0 else min(LARGEST, safety * self._factor(size, norm))
        )  # a shorter step rounds by more
        self._last_size, self._last_error = size, max(norm, 1e-2)
        self.time, self.state, self._stages = end, new, stages
        self._rate = self._ahead if self._has_loops else self._function(end, new)
        if self.problem.hold is not None:  # multipliers of another state give no error estimate
            self._rate = np.where(self.problem.differential, self._rate, 0.0)
        stale = iterations > 2 and rate > 1e-3
        if rejected:
            factor = min(factor, 1.0)
        if stale:
            self._renew(end, new)
        else:
            self._current = False
        if not stale and factor < 1.2:
            factor = 1.0  # the factorisation is used once more
        self._size = size * factor


def _norm(x: Any) -> float:
    return float(np.linalg.norm(x) / max(1, x.size) ** 0.5)


def _left(share: Any, before: Any) -> float:
    """Return the largest further change of a single component by more iterations, from the last changes and those before, in units of the tolerance.

    With a Jacobian that is far too steep for it, one component changes slowly, which large changes of the others hide.
    """
    rate = np.minimum(share / np.where(before > 0, before, np.inf), SLOWEST)
    return float(np.where(rate > CREEPING, share * rate / (1 - rate), 0.0).max(initial=0.0))
