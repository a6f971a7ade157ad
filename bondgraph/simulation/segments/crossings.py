"""Root isolation: all zeros of functions of time, by branch and bound with interval ranges; no zero is missed, however narrow a window is.

A box whose range excludes zero has no zero; one on which the derivative does not change sign has at most one, which the signs at its ends
show; any other box is halved (Moore, Kearfott and Cloud, Introduction to Interval Analysis, 2009, chapter 8). All boxes of a function are
evaluated at once. A function that touches zero, to rounding, without changing its sign has no crossing there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, IntArray, Ranges

from ...numerics.roots import zeros_between

MOST_BOXES = 3_000_000  # boxes at once; with more, the search is given up (`Undecided`)
MOST_CROSSINGS = 1_000_000  # crossings of one function
ROUNDING = 4  # times the rounding error of a value: smaller values count as zero
NARROWEST = 4  # units in the last place of a time: width of a box that is not halved
MOST_BLURRED, NEARLY_ALL = 4096, 0.9  # number of boxes, and fraction of them whose middle value is zero to rounding
BLURRED = 1e-4  # fraction of a run: the longest box that one value, zero to rounding, may decide
HIDDEN = 1e-3  # fraction of a run: a function that is zero for longer does not merely touch zero
FLAT = 1e-9  # fraction of a run: values that are zero for a shorter time are so by rounding
NO_VALUE, UNKNOWN = 2.0, 3.0  # codes in addition to the signs -1, 0 and 1
ITERATIONS = 120
Signs = Callable[[Any, Any], Any]  # times, indices of segments -> signs


def distinct(times: Array) -> Any:
    """Return sorted instants without duplicates.

    numpy.unique is avoided: it loads masked arrays, which takes a tenth of the time of a short run.
    """
    ordered = np.sort(times)
    return ordered[np.diff(ordered, prepend=-np.inf) > 0]


class Undecided(Exception):
    """Raised where interval ranges do not show where a function is zero, or where there are too many boxes."""


@dataclass(frozen=True, slots=True)
class Pieces:
    """Boxes that need no more halving: bounds, index of the segment, and signs at both ends."""

    low: Any
    high: Any
    stretch: Any
    left: Any
    right: Any
    monotone: Any

    def sorted(self) -> Pieces:
        order = np.argsort(self.low, kind="stable")
        return Pieces(*(getattr(self, name)[order] for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class OneFunction:
    """A function of time on segments between `edges`; `modes` has the mode of each segment, shape (segments, mode)."""

    ranges: Ranges  # ranges of the function and of its derivative
    alone: Ranges  # ranges of the function only
    edges: Any
    modes: Any

    def mode(self, stretch: IntArray) -> Any:
        return self.modes[stretch] if self.modes.shape[-1] else self.modes[:0]

    def over(self, low: Array, high: Array, stretch: IntArray) -> tuple[Any, Any, Any, Any]:
        """Return lower and upper bounds of the function and of its derivative over boxes, four arrays (boxes,)."""
        (a, b), (c, d) = self.ranges.over(low, high, self.mode(stretch))
        whole = np.empty((4, len(low)))
        whole[0], whole[1], whole[2], whole[3] = a, b, c, d
        return whole[0], whole[1], whole[2], whole[3]

    def at(self, times: Array, stretch: IntArray) -> tuple[Any, Any]:
        """Return lower and upper bounds of the values at instants, including rounding errors."""
        ((a, b),) = self.alone.over(times, times, self.mode(stretch))
        return np.broadcast_to(a, np.shape(times)), np.broadcast_to(b, np.shape(times))

    def values(self, times: Array, stretch: IntArray) -> Any:
        return np.broadcast_to(self.alone.values(times, self.mode(stretch))[0], np.shape(times)).astype(float)

    def signs(self, times: Array, stretch: IntArray) -> Any:
        values = self.values(times, stretch)
        return np.where(np.isnan(values), NO_VALUE, np.sign(values))


@dataclass(frozen=True, slots=True)
class Zeros:
    """The zeros of a function."""

    cuts: Any  # rising instants at which its sign changes, or at which an interval of zeros begins or ends
    hidden: tuple[float, float] | None  # first and last instant at which rounding hides its sign, if that lasts long
    touched: float | None  # first instant at which it falls to zero and rises again


def crossings(function: OneFunction) -> Zeros:
    """Return the instants at which a function changes its sign inside its segments. Raises `Undecided`."""
    with np.errstate(all="ignore"):
        pieces = _signed(function, _pieces(function))
        changes = np.flatnonzero(pieces.monotone & (pieces.left != pieces.right))
        if len(changes) > MOST_CROSSINGS:
            raise Undecided
        found = [_located(function, pieces, changes), *_in_clusters(function, pieces)]
        beside = (pieces.right[:-1] != pieces.left[1:]) & (pieces.right[:-1] != UNKNOWN) & (pieces.left[1:] != UNKNOWN)
        found.append(pieces.low[1:][beside & (pieces.stretch[1:] == pieces.stretch[:-1])])
    return Zeros(distinct(np.concatenate(found)), _hidden_for_long(function, pieces), _touched(pieces))


def _touched(pieces: Pieces) -> float | None:
    """Return the first instant at which a positive function is zero to rounding and then positive again; None if it stays zero for a while."""
    stays = ~pieces.monotone & (pieces.left == 0)
    signs = np.stack([pieces.left, pieces.right], axis=1)
    signs[signs == UNKNOWN], signs[stays] = 0.0, NO_VALUE
    flat = signs.ravel()
    told = np.flatnonzero(flat)
    over = np.flatnonzero((np.diff(told) > 1) & (flat[told[:-1]] == 1) & (flat[told[1:]] == 1))
    return float(pieces.high[told[over[0]] // 2]) if len(over) else None


def _hidden_for_long(function: OneFunction, pieces: Pieces) -> tuple[float, float] | None:
    """Return the first and last instant at which rounding hides the sign, if that lasts longer than where two sides merely touch."""
    hidden = np.flatnonzero(~pieces.monotone & (pieces.left == UNKNOWN))
    if (pieces.high - pieces.low)[hidden].sum() < HIDDEN * (function.edges[-1] - function.edges[0]):
        return None
    return float(pieces.low[hidden[0]]), float(pieces.high[hidden[-1]])


def _pieces(function: OneFunction) -> Pieces:
    """Halve boxes until each is decided."""
    low, high = function.edges[:-1], function.edges[1:]
    stretch = np.arange(len(low))
    done: list[Any] = []
    while len(low):
        if len(low) > MOST_BOXES:
            raise Undecided
        left, monotone = _decided(function, low, high, stretch)
        decided = monotone | ~np.isnan(left)
        done.append((low[decided], high[decided], stretch[decided], left[decided], monotone[decided]))
        low, high, stretch = low[~decided], high[~decided], stretch[~decided]
        middle = 0.5 * (low + high)
        low, high, stretch = np.concatenate([low, middle]), np.concatenate([middle, high]), np.tile(stretch, 2)
    a, b, stretch, left, monotone = (np.concatenate(part) for part in zip(*done, strict=True))
    return Pieces(a, b, stretch, left, left.copy(), monotone).sorted()


def _decided(function: OneFunction, low: Array, high: Array, stretch: IntArray) -> tuple[Any, Any]:
    """Return for each box its constant sign, `UNKNOWN` where rounding hides it, or NaN if undecided; and a mask of the monotone boxes."""
    least, most, falls, rises = function.over(low, high, stretch)
    sign = _one_sign(least, most)
    monotone = np.isnan(sign) & np.isfinite(least) & np.isfinite(most) & ((falls >= 0) | (rises <= 0))
    rest = np.flatnonzero(np.isnan(sign) & ~monotone)
    if not len(rest):
        return sign, monotone
    middle = 0.5 * (low[rest] + high[rest])
    at_least, at_most = function.at(middle, stretch[rest])
    reach = 0.5 * (high[rest] - low[rest]) * np.maximum(np.abs(falls[rest]), np.abs(rises[rest]))
    # else it may jump
    reach = np.where(np.isfinite(least[rest]) & np.isfinite(most[rest]) & ~np.isnan(reach), reach, np.inf)
    least, most = np.fmax(least[rest], at_least - reach), np.fmin(most[rest], at_most + reach)
    found = _one_sign(least, most)
    blur = ROUNDING * (at_most - at_least)
    short = high[rest] - low[rest] < BLURRED * (function.edges[-1] - function.edges[0])
    blurred = short & np.isfinite(blur) & (np.maximum(np.abs(least), np.abs(most)) <= blur)
    zero = np.isfinite(blur) & (np.maximum(np.abs(at_least), np.abs(at_most)) <= blur)
    if len(rest) > MOST_BLURRED and zero.mean() > NEARLY_ALL:  # both sides are the same, to rounding
        blurred |= zero
    ulp = np.spacing(
        np.maximum(np.maximum(np.abs(low[rest]), np.abs(high[rest])), function.edges[-1] - function.edges[0])
    )
    narrow = (high[rest] - low[rest] <= NARROWEST * ulp) | (middle <= low[rest]) | (middle >= high[rest])
    sign[rest] = np.where(np.isnan(found) & (blurred | narrow), UNKNOWN, found)
    return sign, monotone


def _one_sign(least: Array, most: Array) -> Any:
    """Return the sign of a whole range; NaN if it has several."""
    sign = np.full(len(least), np.nan)
    sign[least > 0], sign[most < 0], sign[(least == 0) & (most == 0)] = 1.0, -1.0, 0.0
    sign[np.isnan(least) | np.isnan(most)] = NO_VALUE
    return sign


def _signed(function: OneFunction, pieces: Pieces) -> Pieces:
    """Return the boxes with the signs at both ends of the monotone ones filled in."""
    at = np.flatnonzero(pieces.monotone)
    pieces.left[at] = function.signs(pieces.low[at], pieces.stretch[at])
    pieces.right[at] = function.signs(pieces.high[at], pieces.stretch[at])
    return pieces


def _in_clusters(function: OneFunction, pieces: Pieces) -> list[Any]:
    """Return the instants at which the sign changes within neighbouring boxes whose sign rounding hides."""
    hidden = (pieces.left == UNKNOWN) & ~pieces.monotone
    if not hidden.any():
        return []
    joined = hidden[1:] & hidden[:-1] & (pieces.stretch[1:] == pieces.stretch[:-1])
    firsts = np.flatnonzero(hidden & ~np.concatenate([[False], joined]))
    lasts = np.flatnonzero(hidden & ~np.concatenate([joined, [False]]))
    before, after = np.maximum(firsts - 1, 0), np.minimum(lasts + 1, len(hidden) - 1)
    inner = (firsts > 0) & (lasts < len(hidden) - 1)
    inner &= (pieces.stretch[before] == pieces.stretch[firsts]) & (pieces.stretch[after] == pieces.stretch[lasts])
    changes = inner & (pieces.right[before] != pieces.left[after])
    firsts, lasts, left = firsts[changes], lasts[changes], pieces.right[before[changes]]
    return [_halved(function.signs, pieces.low[firsts], pieces.high[lasts], pieces.stretch[firsts], left)]


def _located(function: OneFunction, pieces: Pieces, changes: IntArray) -> Any:
    """Return the zeros within monotone boxes; two instants, begin and end, where a function is zero for a while."""
    low, high, stretch = pieces.low[changes], pieces.high[changes], pieces.stretch[changes]
    left, right = pieces.left[changes], pieces.right[changes]
    opposite = left * right == -1.0
    found, exact = _zeros(function, low[opposite], high[opposite], stretch[opposite])
    here = np.flatnonzero(opposite)[exact]  # zero at an instant: for longer than that?
    single = function.signs(np.nextafter(found[exact], low[here]), stretch[here]) == left[here]
    single &= function.signs(np.nextafter(found[exact], high[here]), stretch[here]) == right[here]
    exact[np.flatnonzero(exact)[single]] = False
    flat = ~opposite
    flat[np.flatnonzero(opposite)[exact]] = True
    first = _halved(function.signs, low[flat], high[flat], stretch[flat], left[flat])
    last = _halved(function.signs, high[flat], low[flat], stretch[flat], right[flat])
    least, most, _, _ = function.over(first, last, stretch[flat])
    rounded = (last - first < FLAT * (function.edges[-1] - function.edges[0])) & ((least != 0) | (most != 0))
    return np.concatenate([found[~exact], first[rounded], first[~rounded], last[~rounded]])


def _halved(signs: Signs, here: Array, there: Array, stretch: IntArray, sign: Array) -> Any:
    """Bisect for the end of the interval that has the sign `sign` at `here`."""
    for _ in range(ITERATIONS):
        middle = 0.5 * (here + there)
        going = (middle != here) & (middle != there)
        if not going.any():
            break
        same = going & (signs(middle, stretch) == sign)
        here, there = np.where(same, middle, here), np.where(going & ~same, middle, there)
    return there


def _zeros(function: OneFunction, low: Array, high: Array, stretch: IntArray) -> tuple[Any, Any]:
    """Return a zero between each two instants with different signs, and a mask of those that are exact."""
    least = np.spacing(np.maximum(np.abs(low), np.abs(high)))

    def values(times: Array) -> Any:
        return function.values(times, stretch)

    a, b, at_a, at_b = zeros_between(values, low, high, values(low), values(high), lambda _: least)
    return np.where(np.abs(at_a) < np.abs(at_b), a, b), (at_a == 0) | (at_b == 0)
