"""Exact solution of linear models: x' = A x + b(t) by the matrix exponential, with b as a polynomial on each of many intervals.

The solution at the end of an interval is E x + G c, with E = exp(h A), c the Chebyshev coefficients of h b on it, and G the integrals of
exp((1 - s) h A) T_j(s) ds; both are blocks of one exponential of an augmented matrix (Van Loan, Computing integrals involving the matrix
exponential, 1978). Intervals of one length share it, and equally spaced instants give intervals of one length. So a run costs a product of a
matrix and a vector for each instant, however stiff or long it is, and its only truncation error is that of b, which is reduced to rounding.

Constants, matrices and states may have a leading axis, for runs that differ in constants; then all decisions are common, or the runs part (`RunsPart`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from math import frexp, isqrt, ldexp
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from compiler.api import Array, Program

from ...memo import keep
from ..segments.timeline import Segment, inside, signals_on

DEGREE = 10  # degree of the polynomials
LARGEST = 200  # most states; and largest size of the augmented matrix
LARGEST_MATRIX = 600
MOST_FORMS = 16  # most checked forms that are kept in a run
MOST_INTERVALS = 20_000  # most intervals of a run, in addition to the reported instants
CLOSE = 1e-12  # error of b relative to its largest value
BETWEEN = 1e-10  # the same at places between the nodes of the polynomials
AFFINE = 1e-9  # relative difference of the affine form from the program's rates
ROUNDING = float(np.finfo(float).eps)
BLURRED = 1e-7  # relative change of the states by rounding from which on it matters
TRIED = 33  # instants of a segment at which the affine form is compared with the rates
EXTENDED = 40  # size of a matrix up to which its exponential is computed in extended precision
TERMS = 22  # terms of the series: the remainder is below 1e-24 at a norm of 1/4
BALANCINGS = 20
SHORTENED = 2.0**27  # steps of a length between two powers of two: lengths that differ by less may be one
FIRST_ORDER = 1e-9  # of the change within the difference of two lengths: its square is below rounding
DOUBLED = 1e-9  # largest relative difference of an exponential from the square of that of half the time
DECAYED = 1e-6  # norm of an exponential below which the difference is relative to this: the rest of a start

_ENDS: Any = chebyshev.chebpts2(DEGREE + 1)  # on [-1, 1]
NODES = 0.5 * (_ENDS + 1.0)
TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_ENDS, DEGREE))
# Shift of a polynomial to a later origin: its coefficients change as those of its derivative, over [0, 1].
_UNITS: Any = np.eye(DEGREE + 1)
SHIFT = np.column_stack(
    [np.pad(2.0 * np.asarray(chebyshev.chebder(_UNITS[j])), (0, DEGREE + 1))[: DEGREE + 1] for j in range(DEGREE + 1)]
)
AT_START = (-1.0) ** np.arange(DEGREE + 1)


class RunsPart(Exception):
    """Raised where a decision is not the same for all runs; `those` (runs,) is its mask."""

    def __init__(self, those: Any) -> None:
        super().__init__("a decision is not the same for all runs")
        self.those = those


def common(decision: Any) -> bool:
    """Return a decision, shape (…,), that all runs have in common. Raises `RunsPart`."""
    if not isinstance(decision, np.ndarray):  # of a single run
        return bool(decision)
    result = bool(decision.all())
    if not result and decision.any():
        raise RunsPart(decision)
    return result


@dataclass(slots=True)
class Linear:
    """A program as x' = A x + b(t) on one segment; A is constant."""

    program: Program
    fixed: tuple[Any, Any]  # inputs, constants (…, K)
    stretch: Segment
    matrix: Any  # A, balanced
    norm: Any  # largest sum of the absolute values of a column of it
    scale: Any  # scales of the states
    active: Any  # rows of b that are not zero everywhere
    seen: Any  # places at which b is checked whatever the intervals, rising
    level: Any = None  # b of the balanced states, (active,), where time does not move it
    known: dict[float, tuple[Any, Any]] = field(default_factory=dict)  # E and G by the length of an interval
    near: dict[float, float] = field(default_factory=dict)  # the lengths in `known` by rounded length
    trusted: dict[float, bool] = field(default_factory=dict)  # True for lengths in `known` whose E is accurate

    def share(self, others: dict[tuple[bytes, bytes], tuple[Any, Any, Any]]) -> None:
        """Reuse the exponentials of other segments with the same matrix: pulses of one length give many segments."""
        key = self.matrix.tobytes(), self.active.tobytes()
        if self.matrix.ndim > 2 and key not in others:
            words = self.matrix.view(np.int64)
            for matrix in (matrix for matrix, active in others if active == key[1]):
                common((np.frombuffer(matrix, np.int64).reshape(words.shape) == words).all(axis=(-2, -1)))
        self.known, self.near, self.trusted = others.setdefault(key, (self.known, self.near, self.trusted))

    def held(self, stretch: Segment) -> Linear | None:
        """Return the form on another segment with the same matrix, where only what is held there differs; None where more may."""
        low, high = inside(stretch)
        if _may_blur(self.norm, high - low):
            return None
        zero, inputs, constants = np.zeros(len(self.scale)), *self.fixed
        given = self.program.derivative(low, zero, inputs, constants, stretch.mode)
        last = self.program.derivative(high, zero, inputs, constants, stretch.mode)
        if not np.isfinite(given).all() or (given != last).any():
            return None
        active = given.nonzero()[0]
        if len(self.scale) + len(active) * (DEGREE + 1) > LARGEST_MATRIX:
            return None
        level = (given / self.scale)[active]
        # its exponentials are those of other rows of b
        return Linear(self.program, self.fixed, stretch, self.matrix, self.norm, self.scale, active, self.seen, level)

    def close_to(self, length: float) -> float:
        """Return a known length that is close enough for the first order of the difference to be exact to rounding; otherwise `length`."""
        part, exponent = frexp(length)
        found = self.near.setdefault(ldexp(round(part * SHORTENED), exponent), length)
        return found if found == length or common(abs(found - length) * self.norm <= FIRST_ORDER) else length

    def ahead(self, length: float) -> Any:
        """Return E of an interval, (n, n)."""
        known = self.close_to(length)
        found = self.matrices(known)[0]
        return found if known == length else found + (length - known) * (self.matrix @ found)

    def forcing(self, times: Array) -> Any:
        """Return b for the balanced states; shape (…, times, active)."""
        if self.level is not None:
            held = np.empty((*np.shape(times), len(self.active)))
            held[...] = self.level
            return held
        instants = np.clip(times, *inside(self.stretch)).reshape(-1)
        inputs, constants = self.fixed
        zero = np.zeros((len(instants), self.scale.shape[-1]))
        rates = self.program.derivative(instants, zero, inputs, at_instants(constants), self.stretch.mode)
        rates = (rates / at_instants(self.scale))[..., self.active]
        return rates.reshape((*self.scale.shape[:-1], *np.shape(times), len(self.active)))

    def matrices(self, length: float) -> tuple[Any, Any]:
        """Return E and G of an interval; G is (n, active, DEGREE + 1)."""
        if length not in self.known:
            (*runs, count), sources, more = self.scale.shape, len(self.active), DEGREE + 1
            size = count + sources * more
            whole = np.zeros((*runs, size, size))
            whole[..., :count, :count] = length * self.matrix
            for number, row in enumerate(self.active):
                place = slice(count + number * more, count + (number + 1) * more)
                whole[..., row, place] = AT_START
                whole[..., place, place] = SHIFT
            cached = size <= EXTENDED and not runs
            found = _exponential(whole.tobytes()) if cached else _exponentials(whole)
            integral = found[..., :count, count:].reshape(*runs, count, sources, more)
            self.known[length] = found[..., :count, :count], integral
        return self.known[length]

    def moved(self, start: Array | float, length: float, state: Array, place: float = 1.0) -> Any:
        """Return the balanced state at a place in [0, 1] of an interval, from the one at its start; for many intervals at once."""
        part = length * place
        known = self.close_to(part)
        ahead, integral = self.matrices(known)
        forcing = self.forcing(np.asarray(start)[..., None] + known * NODES)
        coefficients = np.einsum("cj,...js->...sc", TO_COEFFICIENTS, known * forcing)
        carried = state @ ahead.swapaxes(-1, -2)
        if ahead.ndim > 2:  # the same intervals for all runs
            carried, integral = carried[:, None], integral[:, None]
        end = carried + np.einsum("...nsc,...sc->...n", integral, coefficients)
        if known != part:
            rates = end @ self.matrix.swapaxes(-1, -2)
            rates[..., self.active] += forcing[..., -1, :]
            end = end + (part - known) * rates
        return end


@dataclass(frozen=True, slots=True)
class Intervals:
    """One segment cut so that b is a polynomial on each interval; `lengths` has few different numbers."""

    starts: Any
    lengths: Any
    reported: Any  # mask of the intervals that end at a reported instant


def at_instants(values: Array) -> Array:
    """Return values of one run as they are; those of several, shape (runs, m), as (runs, 1, m), to meet several instants."""
    return values[:, None] if values.ndim > 1 else values


def linear_form(
    program: Program, inputs: Array, constants: Array, stretch: Segment, length: float = 0.0, checked: dict[bytes, Linear] | None = None
) -> Linear | None:  # fmt: skip
    """Return the affine form of a program on a segment, checked against its rates; None if it has none or is too large.

    `length`: length of the run; `checked`: forms of its segments so far, by their matrices: between samples that set what is held the matrix stays.
    """
    count = len(program.states.names)
    if not 0 < count <= LARGEST or program.unknowns.names or np.size(program.periods(constants)):
        return None
    (low, high), each = inside(stretch), (-2, -1)
    matrix: Any = np.asarray(program.jacobian(low, np.zeros(count), inputs, constants, stretch.mode), dtype=float)
    same = checked.get(matrix.tobytes()) if checked else None
    if same is not None and (form := same.held(stretch)) is not None:
        return form
    if not common(np.isfinite(matrix).all(axis=each)):
        return None
    scale = _scales(matrix)
    fixed = inputs, at_instants(constants), stretch.mode
    times: Any = np.linspace(low, high, TRIED)
    states = at_instants(scale) * _random(count)
    given = program.derivative(times, np.zeros_like(states), *fixed)
    rates = program.derivative(times, states, *fixed)
    if not common((np.isfinite(given) & np.isfinite(rates)).all(axis=each)):
        return None
    transposed = matrix.swapaxes(-1, -2)
    terms = np.abs(states) @ np.abs(transposed) + np.abs(given)
    if common((np.abs(rates - given - states @ transposed) > AFFINE * terms).any(axis=each)):
        return None
    seen = signals_on(program, inputs, constants if constants.ndim == 1 else constants[0], stretch, length).times
    pushed = program.derivative(seen, np.zeros((len(seen), count)), *fixed)
    moved = (given != 0).any(axis=-2) | (pushed != 0).any(axis=-2)
    if moved.ndim > 1:
        common((moved == moved[0]).all(axis=-1))
        moved = moved[0]
    active = np.flatnonzero(moved)
    if count + len(active) * (DEGREE + 1) > LARGEST_MATRIX:
        return None
    balanced = matrix * scale[..., None, :] / scale[..., None]
    norm = np.abs(balanced).sum(axis=-2).max(axis=-1, initial=0.0)
    if common(_are_blurred(balanced, norm, high - low)):
        return None
    form = Linear(program, (inputs, constants), stretch, balanced, norm, scale, active, seen)
    if checked is not None and (program.hybrid is None or program.hybrid.affine) and not len(seen):
        keep(checked, matrix.tobytes(), form, MOST_FORMS)
    return form


def _scales(matrix: Array) -> Any:
    """Return the scales of the states of each matrix, (…, n)."""
    if matrix.ndim > 2:
        return np.array([_scales(each) for each in matrix])
    return _balance(matrix.tobytes(), len(matrix))


def _are_blurred(matrix: Array, norm: Any, span: float) -> Any:
    """Return `is_blurred` of each matrix, whose norms are known."""
    blurred = _may_blur(norm, span)
    if matrix.ndim == 2:
        return blurred and is_blurred(matrix, span)
    for row in np.flatnonzero(blurred):
        blurred[row] = is_blurred(matrix[row], span)
    return blurred


def _may_blur(norm: Any, span: float) -> Any:
    """Return True for norms of matrices for which rounding may matter."""
    return np.logical_not(ROUNDING * span * norm < BLURRED)


def is_blurred(matrix: Array, span: float) -> bool:
    """Return True if rounding of its entries alone changes the effect of a stiff matrix on slow motions.

    Next to a conductance of 1e12, one of 1 keeps four digits in their sum; the rates themselves, as differences, keep them all.
    """
    if not _may_blur(np.abs(matrix).sum(axis=0).max(), span):
        return False
    values = np.linalg.eigvals(matrix)
    fastest = values[np.argmax(np.abs(values))]
    if fastest.real > -0.5 * abs(fastest):  # it oscillates: steps would have to follow it
        return False
    shaken = matrix * (1 + ROUNDING * np.random.default_rng(1).uniform(-1, 1, matrix.shape))
    return any(
        bool(np.abs(exponential(part * span * matrix) - exponential(part * span * shaken)).max() > BLURRED)
        for part in (1.0, 0.1, 0.01)
    )


@lru_cache(maxsize=256)  # the next run needs the same ones
def _exponential(entries: bytes) -> Any:
    """Return the exponential of a small matrix (its bytes), which nobody writes into."""
    numbers = np.frombuffer(entries)
    return exponential(numbers.reshape(isqrt(len(numbers)), -1))


def _exponentials(matrices: Array) -> Any:
    """Return the exponential of one large matrix, or of many, shape (…, n, n): one for each of those that differ."""
    if matrices.ndim == 2:
        return exponential(matrices)
    numbers: dict[bytes, int] = {}
    places = [numbers.setdefault(matrix.tobytes(), len(numbers)) for matrix in matrices]
    first = [places.index(number) for number in range(len(numbers))]
    return exponential(matrices[first])[places]


def exponential(matrix: Array) -> Any:
    """Return exp(matrix), shape (…, n, n), by Taylor's series of a small part and squaring, for small matrices in extended precision.

    scipy's rational approximation needs fewer squarings but loses digits where modes turn many times: at 20 turns its error is 1e-12, that of this
    one 1e-17 (1e-14 in double precision), and over a long run it does not preserve the amplitude of a lossless system.
    """
    count = matrix.shape[-1]
    exact: Any = np.asarray(matrix, dtype=np.longdouble if count <= EXTENDED else float)
    size = np.abs(exact).sum(axis=-2).max(axis=-1, initial=0.0).astype(float)
    finite = np.isfinite(size)
    exact = np.where(finite[..., None, None], exact, 0.0)
    halvings = np.where(finite & (size > 0), np.ceil(np.log2(np.where(size > 0, size, 1.0))) + 2, 0.0).clip(0.0)
    part = exact / np.exp2(halvings.astype(np.longdouble)).astype(exact.dtype)[..., None, None]
    result = term = part  # minus the identity, so that a small motion keeps its digits
    for order in range(2, TERMS):
        term = term @ part / order
        result = result + term
    for squared in range(int(halvings.max(initial=0.0))):
        going = squared < halvings
        if going.all():
            result = 2 * result + result @ result
        else:
            result[going] = 2 * result[going] + result[going] @ result[going]
    return np.where(finite[..., None, None], np.eye(count) + result, np.nan).astype(float)


@lru_cache(maxsize=16)
def _random(count: int) -> Any:
    """Return random states at the instants at which the form is compared with the rates, shape (TRIED, count)."""
    return np.random.default_rng(1).standard_normal((TRIED, count))


@lru_cache(maxsize=256)  # segments between events often have one matrix, and many runs one each
def _balance(entries: bytes, count: int) -> Any:
    """Return powers of two that give rows and columns of a matrix (its bytes) equal size (Parlett and Reinsch, 1969); shape (n,)."""
    matrix = np.frombuffer(entries).reshape(count, count)
    away = np.abs(matrix) * (1 - np.eye(len(matrix)))
    scale = np.ones(len(matrix))
    for _ in range(BALANCINGS):
        before = scale.copy()
        for i in range(len(matrix)):
            row, column = (away[i] * scale).sum() / scale[i], (away[:, i] / scale).sum() * scale[i]
            if row > 0 and column > 0:
                scale[i] *= np.exp2(np.round(0.5 * np.log2(row / column)))
        if (scale == before).all():
            break
    return scale


def fastest(form: Linear) -> float:
    """Return the time scale of the fastest mode; infinite if nothing changes."""
    rate = np.abs(np.linalg.eigvals(form.matrix)).max()
    return float(1 / rate) if rate > 0 else np.inf


def intervals(form: Linear, instants: Array, longest: float) -> Intervals | None:
    """Cut the segment at the reported instants within it, into intervals no longer than `longest` on which b is a polynomial.

    None if there would be too many.
    """
    stretch = form.stretch
    inner = instants[instants.searchsorted(stretch.start, "right") : instants.searchsorted(stretch.stop)]
    edges = np.empty(len(inner) + 2)
    edges[0], edges[1:-1], edges[-1] = stretch.start, inner, stretch.stop
    gaps = edges[1:] - edges[:-1]
    if form.level is not None and longest >= gaps.max():
        return Intervals(edges[:-1], _few(gaps), np.arange(len(gaps)))
    longest = min(longest, float(gaps.max()))
    while True:
        parts = np.ceil(gaps / longest * (1 - 1e-9)).astype(int).clip(1)
        if parts.sum() > MOST_INTERVALS + len(gaps):
            return None
        ends = np.cumsum(parts)
        begins, wide, several = (np.repeat(a, parts) for a in (edges[:-1], gaps, parts))
        starts = begins + wide * (np.arange(ends[-1]) - np.repeat(ends - parts, parts)) / several
        lengths = _few(np.repeat(gaps / parts, parts))
        if common(_is_followed(form, starts, lengths)):
            return Intervals(starts, lengths, ends - 1)
        longest *= 0.5


def march(form: Linear, cut: Intervals, state: Array) -> Any | None:
    """Return the states at the starts of all intervals and at the end of the last, shape (intervals + 1, …, n), in SI.

    None if the exponentials are not accurate or the solution overflows.
    """
    different = sorted(set(cut.lengths.tolist()))
    if not all(_is_trusted(form, length) for length in different):
        return None
    result = np.empty((len(cut.starts) + 1, *form.scale.shape))
    result[0] = state / form.scale
    pushes = np.empty((len(cut.starts), *form.scale.shape))
    zero = np.zeros(form.scale.shape[-1])
    for length in different:
        chosen = cut.lengths == length
        pushes[chosen] = form.moved(cut.starts[chosen], length, zero).swapaxes(0, -2)
    ahead = {length: form.ahead(length) for length in different}
    # a column for each of many runs, a vector for one
    columns, added = (result, pushes) if result.ndim == 2 else (result[..., None], pushes[..., None])
    rows = list(columns)
    for before, after, push, length in zip(rows, rows[1:], list(added), cut.lengths.tolist()):  # noqa: B905
        np.add(ahead[length] @ before, push, after)
    return result * form.scale if common(np.isfinite(result).all(axis=(0, -1))) else None


def between(form: Linear, cut: Intervals, states: Array, places: Array) -> tuple[Any, Any]:
    """Return times (intervals, places) and states (intervals, places, n) inside the intervals, in SI."""
    times = cut.starts[:, None] + cut.lengths[:, None] * np.asarray(places)
    result = np.empty((*times.shape, form.scale.shape[-1]))
    for length in np.unique(cut.lengths):
        chosen = cut.lengths == length
        for number, place in enumerate(places):
            result[chosen, number] = form.moved(cut.starts[chosen], length, states[:-1][chosen] / form.scale, place)
    return times, result * form.scale


def at(form: Linear, cut: Intervals, states: Array) -> Callable[[Any], Any]:
    """Return a function that gives the state at any instants, each by a separate exponential."""

    def state_at(times: Array) -> Any:
        number = np.clip(np.searchsorted(cut.starts, times, side="right") - 1, 0, len(cut.starts) - 1)
        rows = zip(cut.starts[number], states[number] / form.scale, times, strict=True)
        return np.array([form.moved(start, float(time - start), state) for start, state, time in rows]) * form.scale

    return state_at


def _few(lengths: Array) -> Any:
    """Return the lengths with those that differ by rounding alone made equal."""
    if len(lengths) < 2:
        return lengths
    order = lengths.argsort()
    rising = lengths[order]
    ends = ((rising[1:] - rising[:-1] > 1e-9 * rising[1:]).nonzero()[0] + 1).tolist()
    for begin, end in zip([0, *ends], [*ends, len(rising)], strict=True):
        if end - begin > 1:
            rising[begin:end] = rising[begin:end].sum() / (end - begin)
    result = np.empty(len(lengths))
    result[order] = rising
    return result


def _is_followed(form: Linear, starts: Array, lengths: Array) -> Any:
    """Return True, of each run, if b is a polynomial on each interval, to rounding."""
    if not len(form.active) or form.level is not None:
        return True
    values = form.forcing(starts[:, None] + lengths[:, None] * NODES)
    finite = np.isfinite(values).all(axis=(-3, -2, -1))
    if not finite.any():
        return finite
    most = np.abs(values).max(axis=(-3, -2))
    tails = np.abs(np.einsum("cj,...js->...cs", TO_COEFFICIENTS, values))[..., -2:, :].max(axis=(-3, -2))
    followed = finite & (tails <= CLOSE * most).all(axis=-1)
    if not len(form.seen) or not followed.any():
        return followed
    number = np.clip(np.searchsorted(starts, form.seen, side="right") - 1, 0, len(starts) - 1)
    places = 2 * (form.seen - starts[number]) / lengths[number] - 1
    coefficients = np.einsum("cj,...js->...cs", TO_COEFFICIENTS, values[..., number, :, :])
    found = np.einsum("kc,...kcs->...ks", chebyshev.chebvander(places, DEGREE), coefficients)
    off = np.abs(found - form.forcing(form.seen)).max(axis=-2)
    return followed & (off <= BETWEEN * most).all(axis=-1)


def _is_trusted(form: Linear, length: float) -> bool:
    """Return True if the exponential of an interval is the square of that of its half."""
    length = form.close_to(length)
    if length not in form.trusted:
        whole, half = form.matrices(length)[0], form.matrices(0.5 * length)[0]
        size, off = _norms(np.abs(half) @ np.abs(half)).clip(DECAYED), _norms(whole - half @ half)
        form.trusted[length] = common(np.isfinite(whole).all(axis=(-2, -1)) & (off <= DOUBLED * size))
    return form.trusted[length]


def _norms(matrices: Array) -> Any:
    """Return the norm of each matrix, shape (…,)."""
    return np.linalg.norm(matrices, axis=(-2, -1))
