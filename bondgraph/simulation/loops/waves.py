"""Newton's method in wave variables: solution of loops of monotone laws from any guess.

A loop is opened (`compiler/reduction/opened.py`): each nonlinear law v = g(a) has both its variables among the unknowns, and all else is linear.
Where g rises, a and v are functions of the wave w = a + r v, and neither is steeper than one (Minty, Monotone (nonlinear) operators in Hilbert
space, Duke Math. J. 29, 1962; w is the incident wave of a port in Fettweis, Wave digital filters, Proc. IEEE 74, 1986). In w a diode has neither
a part that overflows nor a flat one, so a damped iteration converges from far away. Undetermined directions (a node between diodes that all
block) are left unchanged: the correction of least length is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from compiler.api import Array

from ...numerics.roots import zeros_between

RESISTANCES = (1e3, 1.0, 1e6, 1e-3)  # tried one after the other as the reference resistance, in SI units
LARGEST = 400  # unknowns
ITERATIONS = 150
HALVINGS = 30
DESCENT = 1e-4  # share of the predicted decrease that a step has to bring
CLOSE = 1e-12  # relative correction at which an iteration ends
ARRIVED = 1e-6  # the same, for an end that is accepted although no step gets closer
UNDECIDED = 1e-13  # relative to the largest singular value: directions below are undetermined and left unchanged
BEGIN = 1e-6  # first value of all unknowns: laws may have no derivative at zero
PROBES = (1e-2, 1.0, 1e2, 1e4)  # arguments at which the sense of a law is determined
# arguments at which derivatives are sampled
SAMPLES = tuple(s * 10.0**e for e in np.arange(-6, 4.5, 0.5).tolist() for s in (-1.0, 1.0))
DOUBLINGS = 120
MOST = 1e150  # largest residual in the search for an argument

# row, indices of argument and value among the unknowns; True if the argument is an effort
Law = tuple[int, int, int, bool]
Function = Callable[[Any], Any]


class OpenedLoops:
    """Opened loops of a program at one instant: `residual` (unknowns,) and its derivatives `matrix` (unknowns, unknowns) as functions of the unknowns."""

    def __init__(self, unknowns: Sequence[str], residual: Function, matrix: Function, laws: Sequence[Law]) -> None:
        self.unknowns, self.residual, self.matrix, self.size = unknowns, residual, matrix, len(unknowns)
        self.rows, self.arguments, self.values = (np.array([law[i] for law in laws], dtype=int) for i in range(3))
        self.efforts = np.array([law[3] for law in laws], dtype=bool)
        self.others = np.setdiff1d(np.arange(self.size), self.rows)

    @cached_property
    def factors(self) -> Any:
        """Derivative of each law's residual by its value, shape (laws,)."""
        return self.matrix(np.full(self.size, BEGIN))[self.rows, self.values]

    @cached_property
    def rounds(self) -> list[Any]:
        """Groups of laws in which each argument occurs once: parallel elements share one voltage."""
        seen: dict[int, int] = {}
        number = np.array([seen.setdefault(a, -1) for a in self.arguments])
        for k, a in enumerate(self.arguments):
            seen[a] += 1
            number[k] = seen[a]
        return [np.flatnonzero(number == i) for i in range(number.max(initial=-1) + 1)]

    def law(self, arguments: Array) -> Any:
        """Return the values v = g(a) of all laws, shape (laws,)."""
        return self._in_rounds(arguments, lambda z: z[self.values] - self.residual(z)[self.rows] / self.factors)

    def slopes(self, arguments: Array) -> Any:
        """Return the derivatives g'(a), shape (laws,)."""
        return self._in_rounds(arguments, lambda z: -self.matrix(z)[self.rows, self.arguments] / self.factors)

    def _in_rounds(self, arguments: Array, function: Function) -> Any:
        """Return the values (laws,) of a function of the unknowns, each with the argument of its law."""
        result = np.empty(len(arguments))
        for group in self.rounds:
            z = np.zeros(self.size)
            z[self.arguments[group]] = arguments[group]
            result[group] = function(z)[group]
        return result

    @cached_property
    def senses(self) -> Any:
        """Sense of each law: 1 if it rises, -1 if it falls."""
        result = np.zeros(len(self.rows))
        for probe in PROBES:
            change = self.law(np.full(len(result), probe)) - self.law(np.full(len(result), -probe))
            result = np.where(result == 0.0, np.sign(np.nan_to_num(change)), result)
        return np.where(result == 0.0, 1.0, result)

    @property
    def rise(self) -> bool:
        """Return True if each law is monotone in its sense at many sampled arguments; no proof."""
        slopes = np.array([self.slopes(np.full(len(self.rows), a)) for a in SAMPLES]) * self.senses
        return bool(((slopes >= 0) | np.isnan(slopes)).all())


def solve_opened(loops: OpenedLoops, guess: Array) -> Iterator[Any]:
    """Yield unknowns at which the iteration ends close to a solution, for one reference resistance after the other.

    `guess`: shape (unknowns,).
    """
    if loops.size > LARGEST or not len(loops.rows):
        return
    for resistance in RESISTANCES:
        for begin in (guess, np.full(loops.size, BEGIN)):
            with np.errstate(all="ignore"):
                left, z = _Iteration(loops, resistance).run(begin)
            if left <= ARRIVED:
                yield z


@dataclass(frozen=True, slots=True)
class _Point:
    """Iterate: waves, then unknowns of no law (y); the resulting arguments and values; all unknowns (z) and residuals of the equations (rest)."""

    y: Any
    arguments: Any
    values: Any
    z: Any
    rest: Any


class _Iteration:
    """Damped Newton iteration in wave variables, with one reference resistance for all laws."""

    def __init__(self, loops: OpenedLoops, resistance: float) -> None:
        self.loops, self.count = loops, len(loops.rows)
        self.per_value = loops.senses * np.where(loops.efforts, resistance, 1 / resistance)  # r
        owner: dict[int, tuple[bool, int]] = {}  # unknown -> True if it is an argument, and index of the law
        self.copies: list[tuple[int, bool, int]] = []  # uses of an unknown by further laws
        for k, (argument, value) in enumerate(zip(loops.arguments, loops.values, strict=True)):
            for place, is_argument in ((int(argument), True), (int(value), False)):
                if place in owner:
                    self.copies.append((place, is_argument, k))
                else:
                    owner[place] = is_argument, k
        self.of_arguments, self.of_values = (
            np.array([k for is_argument, k in owner.values() if is_argument is which], dtype=int)
            for which in (True, False)
        )
        self.free = np.setdiff1d(np.arange(loops.size), list(owner))

    def run(self, guess: Array) -> tuple[float, Any]:
        """Return the relative size of the last correction, and the unknowns."""
        loops = self.loops
        begin = np.where(np.isfinite(guess), guess, BEGIN)
        waves = begin[loops.arguments] + self.per_value * begin[loops.values]
        point = self._at(np.concatenate([waves, begin[self.free]]), begin[loops.arguments])
        size = np.inf
        for _ in range(ITERATIONS):
            if not np.isfinite(point.rest).all():
                return np.inf, point.z
            step, rows, size = self._step(point)
            if size <= CLOSE or not np.isfinite(size):
                break
            found = self._shortened(point, step, rows)
            if found is None:
                break
            point = found
        return size, point.z

    def _at(self, y: Array, near: Array) -> _Point:
        loops = self.loops
        waves = y[: self.count]
        arguments = _arguments(loops.law, waves, self.per_value, near)
        values = (waves - arguments) / self.per_value
        z = np.zeros(loops.size)
        z[loops.arguments[self.of_arguments]] = arguments[self.of_arguments]
        z[loops.values[self.of_values]] = values[self.of_values]
        z[self.free] = y[self.count :]
        doubled = [(arguments if is_argument else values)[k] - z[place] for place, is_argument, k in self.copies]
        return _Point(y, arguments, values, z, np.concatenate([loops.residual(z)[loops.others], doubled]))

    def _step(self, point: _Point) -> tuple[Any, Any, float]:
        """Return Newton's correction of least length, the sizes of the equations' rows, and the relative size of the correction."""
        slopes = self._slopes(point)
        size = np.abs(point.y)
        columns = np.maximum(size, 1e-6 * size.max(initial=0.0) + 1e-12)
        scaled = slopes * columns
        rows = np.abs(scaled).max(axis=1, initial=0.0)
        rows = np.where((rows > 0) & np.isfinite(rows), rows, 1.0)
        matrix = scaled / rows[:, None]
        if not np.isfinite(matrix).all():
            return columns, rows, np.inf
        left, singular, right = np.linalg.svd(matrix)
        damped = singular / (singular**2 + (UNDECIDED * singular.max(initial=0.0)) ** 2)
        step = right.T @ (damped * (left.T @ (-point.rest / rows)))
        return step * columns, rows, float(np.abs(step).max(initial=0.0))

    def _slopes(self, point: _Point) -> Any:
        """Return the derivatives of the equations by waves and free unknowns."""
        loops, count = self.loops, self.count
        slope = loops.slopes(point.arguments)
        finite = np.isfinite(slope)
        steep = np.where(finite, slope, 0.0)
        of_argument = np.where(finite, 1 / (1 + self.per_value * steep), 0.0)
        of_value = np.where(finite, steep / (1 + self.per_value * steep), 1 / self.per_value)
        inner = np.zeros((loops.size, len(point.y)))
        inner[loops.arguments[self.of_arguments], self.of_arguments] = of_argument[self.of_arguments]
        inner[loops.values[self.of_values], self.of_values] = of_value[self.of_values]
        inner[self.free, count + np.arange(len(self.free))] = 1.0
        whole = np.nan_to_num(loops.matrix(point.z)[loops.others], posinf=0.0, neginf=0.0)
        doubled = np.zeros((len(self.copies), len(point.y)))
        for number, (place, is_argument, k) in enumerate(self.copies):
            doubled[number, k] = (of_argument if is_argument else of_value)[k]
            doubled[number] -= inner[place]
        return np.concatenate([whole @ inner, doubled])

    def _shortened(self, point: _Point, step: Array, rows: Array) -> _Point | None:
        """Return the point after a step, halved until the residuals decrease; None if they never do."""
        norm, factor = float(np.linalg.norm(point.rest / rows)), 1.0
        for _ in range(HALVINGS):
            found = self._at(point.y + factor * step, point.arguments)
            if float(np.linalg.norm(found.rest / rows)) <= (1 - DESCENT * factor) * norm:
                return found
            factor *= 0.5
        return None


def _arguments(law: Function, waves: Array, per_value: Array, near: Array) -> Any:
    """Return the arguments a with a + r g(a) = w, shape (laws,): bracketed from nearby, then narrowed, all laws at once."""

    def beyond(a: Array) -> Any:
        value = a + per_value * law(a) - waves
        return np.clip(np.where(np.isnan(value), np.sign(a) * np.inf, value), -MOST, MOST)

    value = beyond(near)
    slope = np.maximum(np.abs(waves - near), 1e-3)
    low, high = np.where(value < 0, near, -np.inf), np.where(value >= 0, near, np.inf)
    at_low, at_high = value.copy(), value.copy()
    reach = np.minimum(2 * np.abs(value), 1e-3 * slope) + 1e-12 * np.abs(near) + 1e-300
    for _ in range(DOUBLINGS):
        below, above = np.isinf(low), np.isinf(high)
        if not (below | above).any():
            break
        middle = np.where(below, high - reach, np.where(above, low + reach, low))
        value = beyond(middle)
        down, up = (below | above) & (value < 0), (below | above) & (value >= 0)
        low, at_low = np.where(down, middle, low), np.where(down, value, at_low)
        high, at_high = np.where(up, middle, high), np.where(up, value, at_high)
        reach = reach * 8
    low, high = np.where(np.isinf(low), high, low), np.where(np.isinf(high), low, high)  # of a law without a bracket
    a, b, at_a, at_b = zeros_between(beyond, low, high, at_low, at_high, lambda best: 2e-16 * np.abs(best) + 1e-300)
    return np.where((at_a == 0) | (np.abs(at_a) < np.abs(at_b)), a, b)
