"""Radau IIA of order 5 for M y' = f(t, y) with M = diag(1 … 1, 0 … 0): differential equations, and those with unknowns of loops.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.8 (the method, its simplified Newton iteration, its
error estimate) and VI.1 (problems with M). Four things differ from the program that comes with that book:

- Within a step the quintic through values and slopes of the last three step ends is evaluated, which has the order of the
  method; the slope at a step's end is that of the collocation polynomial, so that stiffness does not magnify its error.
- The caller gives states divided by their magnitudes, and a factorisation that scales rows.
- Where a step ends, the unknowns of loops must solve their equations, whatever the slopes say that iterated them.
- A step that is rejected again and again although it gets shorter is told from one that is too long: what is left is round-off.
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
    FIRST,
    STAGNANT,
    allowed_estimate,
    creeping_tolerance,
    first_length,
    newton_tolerance,
    stagnation_tolerance,
)

_S6 = 6**0.5
C = np.array([(4 - _S6) / 10, (4 + _S6) / 10, 1.0])
E = np.array([-13 - 7 * _S6, -13 + 7 * _S6, -1]) / 3  # of the error estimate
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
# The collocation polynomial is y0 + Z.T P [s, s^2, s^3]; D is its slope at the end.
P = np.array(
    [
        [13 / 3 + 7 * _S6 / 3, -23 / 3 - 22 * _S6 / 3, 10 / 3 + 5 * _S6],
        [13 / 3 - 7 * _S6 / 3, -23 / 3 + 22 * _S6 / 3, 10 / 3 - 5 * _S6],
        [1 / 3, -8 / 3, 10 / 3],
    ]
)
D = P @ np.array([1.0, 2.0, 3.0])
INNER = tuple(C[:-1].tolist())  # places of a step where the limits of a model are looked at
NEWTON_ITERATIONS = 6
SLOWEST = 0.9  # contraction of a single number of the stages by an iteration: what is slower counts as that
CREEPING = 0.5  # and what is faster needs no look of its own
UNSOLVED = 0.5  # of what was left of a loop's equation before the last change: it is no solution where more is left
SOLVED = 0.01  # of the tolerance, by which the unknown of a loop may miss its equation
NOISE = 1e-15  # of the terms of an equation of a loop: what is left of them is none
ROUNDED = 1e-12  # of the terms of such an equation: rounding
STIFF = 300.0  # times its own size a state would change in a step, if the others did not follow
SURE = 0.3  # of the tolerance: polynomials within a step that differ by less are both right
NEAR = 1e-4  # of a step: so far apart two of their values tell a slope
SLOW = 0.1  # contraction beyond which Newton's method takes a Jacobian anew there
BACK_ITERATIONS, BACK_PATIENT = 8, 1  # of Newton's method there; in a row that are slow with a new Jacobian
LEFT = 1e-3  # of a tolerance, which it may leave
FIRST_ULPS = 1e3  # of the time: no run begins with steps that rounding leaves nothing of
SMALLEST, LARGEST = 0.2, 8.0  # factors between two steps
# A step over a bend of a law whose error is more than this share of the tolerance ends at the bend instead, unless that is nearer to
# its start than a share of it; but not again and again.
BENT, NEAREST, MOST_BENDS = 0.1, 1e-2, 4
ON_IT = 1e-6  # of a bend's values in a step: that counts as zero
CLOSE = 1e-9  # of a step, to which a bend is found
BEYOND = 1e-6  # of a step that ends at a bend: so far behind its end the other side is looked at
STUBBORN, SHORTER = 8, 1e-3  # rejected tries after which steps that are so much shorter must have helped
PATIENT = 3  # rejected tries after which steps get shorter at once


class Factorised(Protocol):
    """A factorised matrix."""

    @property
    def negative(self) -> bool:
        """Whether the determinant of a real one is, where that is known."""
        ...

    def solve(self, right: Any) -> Any: ...


Factorise = Callable[[Any], Factorised]


class StepFailed(Exception):
    """No step is short enough; `what` failed last: newton, error, or round-off where shorter steps were no better."""

    def __init__(self, what: str) -> None:
        self.what = what


@dataclass(slots=True)
class Problem:
    """M y' = f(t, y), with its Jacobian and a factorisation that fits it. `differential` marks the rows where M is 1."""

    function: Callable[[float, Any], Any]
    jacobian: Callable[[float, Any], Any]
    shifted: Callable[[complex, Any], Factorised]  # (mu/h, J) -> mu/h M - J, factorised
    differential: Any
    relative: float
    absolute: Any  # per state
    follows: Callable[[float, float], bool]  # whether a step from here to there would see what time alone moves
    longest: float = np.inf  # no step is longer
    hold: Callable[[float, Any], Any] | None = None  # brings the end of a step onto the invariants of the states
    bends: Callable[[float, Any], Any] | None = None  # time, state -> zero where a law bends
    terms: Callable[[Any, Any], Any] = lambda jacobian, state: 0.0  # per row, the sum of the sizes of what it adds up
    mode: Any = None  # what conditions are in the functions, to be changed in place


class Radau:
    """Steps from `time` to `stop`; after each `step()` the last one can be sampled."""

    def __init__(self, problem: Problem, time: float, state: Any, stop: float, size: float = np.inf) -> None:
        self.problem, self.time, self.state, self.stop = problem, time, state, stop
        self.evaluations = {"derivative": 0, "jacobian": 0, "factorisation": 0}
        self.rejected = 0
        self.error: Any = np.zeros(len(state))  # of the last step, in units of its tolerance
        self._rate = self._function(time, state)
        self._size = size if np.isfinite(size) else self._first_size()
        self._newton_tolerance = newton_tolerance(problem.relative)
        self._first_newton_tolerance = newton_tolerance(problem.relative, FIRST)
        self._stagnation_tolerance = stagnation_tolerance(problem.relative)
        self._creeping_tolerance = creeping_tolerance(problem.relative)
        self._allowed = allowed_estimate(problem.relative)
        self._jacobian: Any = None
        self._explicit = bool(np.all(problem.differential))  # no unknowns of loops, nor of closing joints
        self._has_loops = not self._explicit and problem.hold is None
        self._current = False  # whether the Jacobian is that of this state
        self._side: Any = None  # of the bends on which it was taken
        self._real: Factorised | None = None
        self.factors: Factorised | None = None  # of the last step, the real ones
        self._complex: Factorised | None = None
        self._stages: Any = None  # of the last step, relative to its start
        self._factorised_size = 0.0
        self._ends = [End(time, state, None)]
        self._last_size, self._last_error = 0.0, 0.0

    # ------------------------------------------------------------ what a run asks
    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return self.time >= self.stop

    parts = 1  # of a step, each of which is searched for events by itself

    @property
    def inner(self) -> tuple[float, ...]:
        """The places of a step where the limits of a model are looked at."""
        return INNER

    def put_mode(self, mode: Any) -> None:
        """Conditions are like this from now on."""
        self.problem.mode[:] = mode

    def begin_with(self, size: float) -> None:
        """Let the next step be no longer than this."""
        self._size = size

    def hold_to(self, absolute: Any) -> None:
        """Other absolute tolerances from now on."""
        self.problem.absolute = absolute

    @property
    def wish(self) -> float:
        """How long the next step would be if nothing else limited it."""
        return self._size

    @property
    def last_step(self) -> tuple[float, float]:
        """Its start and its end."""
        return self._ends[-2].time, self._ends[-1].time

    def step(self) -> None:
        """One accepted step. Raises `StepFailed`."""
        problem, time, state = self.problem, self.time, self.state
        least = 10 * np.abs(np.nextafter(time, np.inf) - time)
        size, reason = min(self._size, self.stop - time, problem.longest), "error"
        norms: list[float] = []  # of the rejected tries
        sizes: list[float] = []
        bent = 0  # how often the step was made to end at a bend
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
            if norm <= 1 and self._misses(end, new, size, scale):
                reason, size = "newton", 0.5 * size if self._current else size
                self._renew(time, state)
                continue
            if not norm <= 1:
                reason = "error"
                factor = 0.1 if not np.isfinite(norm) else self._factor(size, norm)
                sizes.append(size)
                # What a stiff mode rings with errs alike at all steps that are longer than its period: those are left behind quickly.
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
            self._ends = [self._ends[-2], self._ends[-1]]  # no polynomial spans a bend
            self._size = max(self._size, size / max(share, NEAREST))
        if problem.bends is not None:
            self._look_at_side(BEYOND * size if bent else 0.0)
        self.error = error

    def _look_at_side(self, ahead: float) -> None:
        """After a step, and where it ends at a bend a little further: a Jacobian from the other side of a bend hides errors, which are filtered through it."""
        time, state = self.time + ahead, self.state + ahead * self._rate
        if (self._side_at(time, state) != self._side).any():
            self._renew(time, state)

    def _side_at(self, time: float, state: Any) -> Any:
        """On which side of all bends a state is."""
        bends = self.problem.bends
        return np.sign(bends(time, state)) if bends is not None else None

    def _bend(self, time: float, state: Any, size: float, stages: Any) -> float:
        """The share of a step at which a law bends first, along the collocation polynomial; 1 if none does."""
        bends = self.problem.bends
        assert bends is not None

        def at(share: float) -> Any:
            powers = np.array([share, share**2, share**3])
            return bends(time + share * size, state + (P @ powers) @ stages)

        seen = np.stack(
            [bends(time, state), *(bends(time + c * size, state + z) for c, z in zip(C, stages, strict=True))]
        )
        seen[0][np.abs(seen[0]) <= ON_IT * np.abs(seen).max(axis=0)] = 0.0  # where the last step ended
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
        """States at instants within the last step; shape (times, n).

        The quintic through the last ends, unless it differs from the collocation polynomial (order 3) by more than that can err: then something
        bent within the steps that it spans.
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
        """The polynomial through the last ends, or the collocation polynomial where these are too few; shape (times, n)."""
        return hermite(self._ends, times) if self.has_quintic else self.collocation(times)

    @property
    def jacobian(self) -> Any:
        """The one that served last."""
        return self._jacobian

    @property
    def has_quintic(self) -> bool:
        """Whether three ends are known."""
        return len(self._ends) == 3

    @property
    def state_at_end(self) -> Any:
        """Of the last step."""
        return self._ends[-1].state

    def collocation(self, times: Any) -> Any:
        """The collocation polynomial of the last step; shape (times, n).

        Its integral is what the step adds to a state: what is summed up along it agrees with the states, stiff parts included.
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
        """Hairer, Nørsett and Wanner, Solving ODEs I, section II.4, from slopes of the differential part. A state below its tolerance, as a jump
        leaves it of what was large, tells no length: what moves all by a hundredth of the tolerance is short enough."""
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
        """Stages from the last step's polynomial, carried on."""
        if self._stages is None or self._last_size == 0:
            return np.zeros((3, len(self.state)))
        s = 1 + C * size / self._last_size
        powers = np.stack([s, s**2, s**3])
        return (powers.T @ P.T) @ self._stages - self._stages[-1]

    def _newton(self, time: float, state: Any, size: float, stages: Any, scale: Any) -> tuple[Any, int, float] | None:
        """The simplified Newton iteration for the stages: `(stages, iterations, rate)`, or None if it does not converge."""
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
            return None  # a mode grows by exp(MU_REAL) and more within the step, and the method would damp it
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
        """The answer of an iteration that gets no better, if rounding is all that is left: see `rounding`; else None."""
        if norm > self._stagnation_tolerance or not norm <= STAGNANT * self.rounding(time, state, scale):
            return None
        self._residual = residual
        return answer

    def rounding(self, time: float, state: Any, scale: Any) -> float:
        """The norm of what rounding does to a stage, in units of the tolerance, from a second difference of the rates within which they are straight.

        Laws of large numbers that nearly cancel, as lengths of a mechanism beside its displacements, round by more than states do."""
        assert self._real is not None
        aside = ASIDE * state * np.where(np.arange(len(state)) % 2, -1.0, 1.0)
        bent = self._function(time, state + aside) - 2 * self._rate + self._function(time, state - aside)
        return _norm(self._real.solve(np.where(np.isfinite(bent), bent, 0.0)) / scale)

    def _noise(self, state: Any) -> Any:
        """What rounding leaves of the equations of loops, shape (n,); below zero for the others. Where leakage alone decides an unknown, a correction by
        rounding has no end."""
        problem = self.problem
        return np.where(problem.differential, -1.0, NOISE * problem.terms(self._jacobian, state))

    def _misses(self, end: float, new: Any, size: float, scale: Any) -> bool:
        """Whether the unknowns of loops do not solve their equations where a step ends. Slopes of another place, as of a diode that conducts no more, may be
        so much too steep that iterations change nothing; where as much is left of an equation as before the last one, slopes of the end tell how much it is.
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
        """The error in units of the tolerance, filtered through the real matrix as often as needed for stiff parts."""
        assert self._real is not None
        problem = self.problem
        scale = self._allowed * (problem.absolute + np.maximum(np.abs(state), np.abs(new)) * problem.relative)
        rest = np.where(problem.differential, E @ stages / size, 0.0)
        error = self._real.solve(self._without_noise(self._rate, state) + rest)
        if _norm(error / scale) > 1 and (rejected or self._stages is None or self._last_size == 0):
            error = self._real.solve(self._without_noise(self._function(time, state + error), state) + rest)
        return error / scale

    def _without_noise(self, rates: Any, state: Any) -> Any:
        """Rates with equations of loops that lack no more than rounding taken for solved."""
        return np.where(np.abs(rates) <= self._noise(state), 0.0, rates) if self._has_loops else rates

    def _factor(self, size: float, norm: float) -> float:
        """Step factor by the last two errors (Gustafsson; Hairer and Wanner, section IV.8)."""
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
        factor = min(LARGEST, safety * self._factor(size, norm))
        self._last_size, self._last_error = size, max(norm, 1e-2)
        self.time, self.state, self._stages = end, new, stages
        self._rate = self._ahead if self._has_loops else self._function(end, new)
        if self.problem.hold is not None:  # multipliers that were solved for another state say nothing of an error
            self._rate = np.where(self.problem.differential, self._rate, 0.0)
        stale = iterations > 2 and rate > 1e-3
        if rejected:
            factor = min(factor, 1.0)
        if stale:
            self._renew(end, new)
        else:
            self._current = False
        if not stale and factor < 1.2:
            factor = 1.0  # the factorisation serves once more
        self._size = size * factor


def _norm(x: Any) -> float:
    return float(np.linalg.norm(x) / max(1, x.size) ** 0.5)


def _left(share: Any, before: Any) -> float:
    """The most that further iterations would change a single number: a Jacobian that is far too steep for one of them lets it creep, which hides beside
    large changes of the others. The last changes in units of the tolerance, and those before."""
    rate = np.minimum(share / np.where(before > 0, before, np.inf), SLOWEST)
    return float(np.where(rate > CREEPING, share * rate / (1 - rate), 0.0).max(initial=0.0))
