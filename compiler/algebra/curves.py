"""Curves through points as polynomials: values and ranges of `linear`, `cubic` and `monotone`, over many places or boxes at once.

Each interval between two places has the coefficients of a polynomial in the distance from its first place, beyond the ends a straight line. The
range over a box is that of the parts at its two ends and of the whole intervals between them, from a table of extrema over 2^k intervals.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from .interpolate import MARGIN

ROUNDING = 2.0**-48  # relative to the sum of the terms of a polynomial


class Curve:
    """One curve, or its derivative of an order: `places` (n,), `values` (n,) and `slopes` (n,), None for straight lines."""

    def __init__(self, places: Any, values: Any, slopes: Any | None, order: int) -> None:
        h, rises = np.diff(places), np.diff(values)
        secants = rises / h
        rows = np.zeros((len(h) + 2, 4))  # coefficients, lowest degree first; straight lines at both ends
        rows[1:-1, 0], rows[0, 0], rows[-1, 0] = values[:-1], values[0], values[-1]
        if slopes is None:
            rows[1:-1, 1], rows[0, 1], rows[-1, 1] = secants, secants[0], secants[-1]
        else:
            rows[1:-1, 1], rows[0, 1], rows[-1, 1] = slopes[:-1], slopes[0], slopes[-1]
            rows[1:-1, 2] = (3 * secants - 2 * slopes[:-1] - slopes[1:]) / h
            rows[1:-1, 3] = (slopes[:-1] + slopes[1:] - 2 * secants) / h**2
        for _ in range(order):
            rows = np.column_stack([rows[:, 1:] * np.arange(1, rows.shape[1]), np.zeros(len(rows))])
        margin = MARGIN * (places[-1] - places[0]) if order == 0 else np.inf
        self.domain = places[0] - margin, places[-1] + margin
        self.inner, self.rows = places, rows
        self.bases = np.concatenate([[places[0]], places[:-1], [places[-1]]])
        self.turns = self._turns()
        terms = np.abs(rows) * np.concatenate([[0.0], h, [0.0]])[:, None] ** np.arange(4)
        self.blur = ROUNDING * terms.sum(axis=1)
        self._extrema(places)

    def _turns(self) -> Any:
        """Distances from the first place at which a polynomial may turn, shape (intervals, 2); NaN where it does not."""
        _, b, c, d = self.rows.T
        with np.errstate(all="ignore"):
            part = np.sqrt(c * c - 3 * b * d)
            q = -(c + np.where(c < 0, -part, part))
            return np.stack([q / (3 * d), b / q], axis=1)

    def _extrema(self, places: Any) -> None:
        """Tables of least and greatest values over 2^k neighbouring inner intervals, a row for each k."""
        inner = np.arange(1, len(places))
        least, most = self._part(inner, places[:-1], places[1:])
        self.least, self.most = [least], [most]
        while len(self.least[-1]) > 2 ** (len(self.least) - 1):
            shift = 2 ** (len(self.least) - 1)
            self.least.append(np.minimum(self.least[-1][:-shift], self.least[-1][shift:]))
            self.most.append(np.maximum(self.most[-1][:-shift], self.most[-1][shift:]))

    def _at(self, piece: Any, x: Any) -> Any:
        s = x - self.bases[piece]
        a, b, c, d = self.rows[piece].T
        value = ((d * s + c) * s + b) * s
        # straight beyond an end, however far
        return a + np.where(np.isfinite(value), value, np.where(b == 0, 0.0, b * s))

    def values(self, x: Any) -> Any:
        """Values at places of any shape; not a number outside of the table, unless it is of a derivative."""
        x = np.asarray(x, dtype=float)
        flat = x.ravel()
        with np.errstate(all="ignore"):
            found = self._at(np.searchsorted(self.inner, flat, side="right"), flat)
        found[~((flat >= self.domain[0]) & (flat <= self.domain[1]))] = np.nan
        return found.reshape(x.shape)

    def over(self, low: Any, high: Any) -> tuple[Any, Any]:
        """Lower and upper bounds over boxes, with rounding. At a place of the curve both sides count."""
        with np.errstate(all="ignore"):
            return self._over(*np.broadcast_arrays(np.atleast_1d(np.asarray(low, dtype=float)), high))

    def _over(self, low: Any, high: Any) -> tuple[Any, Any]:
        bad = np.isnan(low) | np.isnan(high)
        first = np.searchsorted(self.inner, low, side="left")
        last = np.searchsorted(self.inner, high, side="right")
        ends = np.concatenate([self.inner, [np.inf]])
        starts = np.concatenate([[-np.inf], self.inner])
        a, b = self._part(first, low, np.minimum(high, ends[first]))
        c, d = self._part(last, np.maximum(low, starts[last]), high)
        least, most = np.minimum(a, c), np.maximum(b, d)
        between = np.flatnonzero(last - first > 1)
        if len(between):
            # inner intervals are numbered from 1, their tables from 0
            begin, count = first[between], last[between] - first[between] - 1
            level = np.frexp(count)[1] - 1
            for k in sorted(set(level.tolist())):
                chosen = level == k
                at, end = begin[chosen], begin[chosen] + count[chosen] - 2**k
                where = between[chosen]
                least[where] = np.minimum(least[where], np.minimum(self.least[k][at], self.least[k][end]))
                most[where] = np.maximum(most[where], np.maximum(self.most[k][at], self.most[k][end]))
        least[bad] = most[bad] = np.nan
        return least, most

    def _part(self, piece: Any, low: Any, high: Any) -> tuple[Any, Any]:
        """Bounds over boxes that lie within one interval each."""
        at = [self._at(piece, low), self._at(piece, high)]
        for turn in self.turns[piece].T:
            place = self.bases[piece] + turn
            inside = (place > low) & (place < high)
            at.append(np.where(inside, self._at(piece, np.where(inside, place, low)), at[0]))
        least, most = np.minimum.reduce(at), np.maximum.reduce(at)
        blur = self.blur[piece]
        return least - np.maximum(blur, ROUNDING * np.abs(least)), most + np.maximum(blur, ROUNDING * np.abs(most))


@lru_cache(maxsize=64)
def curve(kind: str, order: int, points: tuple[float, ...]) -> Curve:
    """The curve of an operator from its operands: places and values, and slopes where it is not `linear`; places may fall."""
    count = len(points) // (2 if kind == "linear" else 3)
    lists = [np.array(points[i * count : (i + 1) * count]) for i in range(len(points) // count)]
    lists = [part[::-1] for part in lists] if lists[0][0] > lists[0][-1] else lists
    return Curve(lists[0], lists[1], None if kind == "linear" else lists[2], order)
