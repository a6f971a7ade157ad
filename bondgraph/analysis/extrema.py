"""Peaks and dips of a frequency response, from its poles: independent of the number of points requested.

On a grid that is refined about each pole according to its damping, peaks and dips are bracketed; then the parabola through 1/|G|^2 (peaks) or
|G|^2 (dips), which is exact next to a single pole or zero, leads to them. A pole on the imaginary axis that an input excites and an output shows
is an infinite peak.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, ComplexArray

PER_DECADE = 50  # frequencies in addition to those about poles
NARROWEST = 1e-7  # relative width of the grid about a pole without damping
WIDEST = 0.5
TWINS = 1e-2 * NARROWEST  # relative distance of frequencies that are one
ROUNDS = 40
CLOSE = 1e-11  # relative accuracy of a frequency
NOTHING = 1e-12  # relative to the magnitude nearby: rounding of the response, at a zero on the imaginary axis
DOUBLED = 30.0  # growth of the magnitude at a hundredth of the distance that shows an infinite peak
FLAT = 1e-9  # relative height below which there is no peak

Evaluate = Callable[[Any], Any]  # frequencies (f,) in Hz -> (f, m, k)


@dataclass(frozen=True, slots=True)
class Extremum:
    """A "peak" or a "dip" from `given` to `seen` at a frequency (Hz), with magnitude in SI (infinite at an undamped resonance) and phase (deg)."""

    given: str
    seen: str
    kind: str
    frequency: float
    magnitude: float
    phase: float


def extrema(
    evaluate: Evaluate, poles: ComplexArray, undamped: BoolArray, low: float, high: float, given: tuple[str, ...], seen: tuple[str, ...]
) -> tuple[tuple[Extremum, ...], Array, ComplexArray]:  # fmt: skip
    """Return the extrema of all pairs of input and output, rising, and the frequencies (f,) searched with the response (f, m, k) there.

    `undamped` (n,): mask of the `poles` (n,), in 1/s, on the imaginary axis.
    """
    infinite = np.unique(np.abs(poles[undamped].imag) / (2 * np.pi)) if len(poles) else np.zeros(0)
    infinite = infinite[(infinite >= low) & (infinite <= high)]
    frequencies = _about(poles, infinite, low, high)
    values = evaluate(frequencies)
    size = np.abs(values)
    peaks: list[Extremum] = []
    brackets = []
    for i in range(len(seen)):
        for j in range(len(given)):
            sharp = [f for f in infinite if _is_infinite(evaluate, float(f), i, j)]
            peaks += [Extremum(given[j], seen[i], "peak", float(f), np.inf, np.nan) for f in sharp]
            brackets += [
                (i, j, k, sign) for k, sign in _turns(size[:, i, j])
                if not any(frequencies[k - 1] < f < frequencies[k + 1] for f in sharp)
            ]  # fmt: skip
    for (i, j, k, sign), at, value in zip(brackets, *_refined(evaluate, frequencies, brackets), strict=True):
        beside = max(size[k - 1, i, j], size[k + 1, i, j])
        magnitude = abs(value) if sign > 0 or abs(value) > NOTHING * beside else 0.0
        kind = "peak" if sign > 0 else "dip"
        peaks.append(Extremum(given[j], seen[i], kind, float(at), float(magnitude), float(np.degrees(np.angle(value)))))
    found = tuple(sorted(peaks, key=lambda e: (given.index(e.given), seen.index(e.seen), e.frequency)))
    return found, frequencies, values


def _about(poles: ComplexArray, infinite: Array, low: float, high: float) -> Any:
    """Return the frequencies (Hz) at which peaks and dips are searched; none of them is an infinite peak."""
    count = max(20, int(PER_DECADE * np.log10(high / low)))
    parts = [np.geomspace(low, high, count)]
    for pole in poles:
        centre = abs(pole.imag) / (2 * np.pi)
        if centre == 0 or abs(pole.real) >= abs(pole.imag):
            continue
        narrow = max(abs(pole.real / pole.imag) / 30, NARROWEST)
        widths = np.zeros(0)
        if narrow < WIDEST:
            widths = centre * np.geomspace(narrow, WIDEST, max(2, int(6 * np.log10(WIDEST / narrow))))
        parts += [centre - widths, np.array([centre]), centre + widths]
    every = np.unique(np.concatenate(parts))
    every = every[(every >= low) & (every <= high)]
    every = every[np.diff(every, prepend=0.0) > TWINS * every]  # between equal poles every peak would be flat
    if len(infinite):
        near = np.abs(every[:, None] / infinite - 1).min(axis=1)
        every = every[near > 0.1 * NARROWEST]
    return every


def _is_infinite(evaluate: Evaluate, frequency: float, i: int, j: int) -> bool:
    """Return True if a response goes to infinity at a frequency: at a hundredth of the distance it is much larger."""
    near, nearer = frequency * (1 + 1e-4), frequency * (1 + 1e-6)
    far, close = np.abs(evaluate(np.array([near, nearer]))[:, i, j])
    return bool(close > DOUBLED * far) or not np.isfinite(close)


def _turns(size: Array) -> list[tuple[int, int]]:
    """Return the places of local maxima (sign 1) and minima (-1) of magnitudes, without those that are flat to rounding."""
    result = []
    for sign in (1, -1):
        rising = sign * np.diff(size)
        places = np.flatnonzero((rising[:-1] > 0) & (rising[1:] <= 0)) + 1
        swing = np.minimum(np.abs(size[places] - size[places - 1]), np.abs(size[places] - size[places + 1]))
        result += [
            (int(k), sign) for k, s in zip(places, swing, strict=True) if s > FLAT * size[k] or (sign < 0 and s > 0)
        ]
    return [(k, s) for k, s in result if np.isfinite(size[k - 1 : k + 2]).all()]


def _refined(evaluate: Evaluate, frequencies: Array, brackets: list[tuple[int, int, int, int]]) -> tuple[Any, Any]:
    """Return frequencies of the extrema and the responses there, for all brackets at once."""
    if not brackets:
        return np.zeros(0), np.zeros(0, dtype=complex)
    rows, columns, places, signs = (np.array(part) for part in zip(*brackets, strict=True))

    def at(f: Array) -> tuple[Any, Any]:
        unique, back = np.unique(f, return_inverse=True)
        values = evaluate(unique)[back, rows, columns]
        squares = np.abs(values) ** 2
        with np.errstate(divide="ignore"):
            return values, np.where(signs > 0, 1 / squares, squares)

    x = np.stack([frequencies[places - 1], frequencies[places], frequencies[places + 1]])
    q = np.stack([at(row)[1] for row in x])
    for round_ in range(ROUNDS):
        new = _vertex(x, q) if round_ % 4 != 3 else _halved(x)
        inside = (new > x[0]) & (new < x[2]) & (np.abs(new - x[1]) > 0.25 * CLOSE * x[1])
        new = np.where(inside, new, _halved(x))
        value = at(new)[1]
        done = (x[2] - x[0] <= CLOSE * x[1]) | (np.abs(new - x[1]) <= CLOSE * x[1])
        x, q = _narrowed(x, q, new, value)
        if done.all():
            break
    best = x[1]
    return best, at(best)[0]


def _vertex(x: Array, q: Array) -> Any:
    """Return the vertices of parabolas through three points each."""
    left, right = x[1] - x[0], x[1] - x[2]
    with np.errstate(divide="ignore", invalid="ignore"):  # next to a response of zero
        above = left**2 * (q[1] - q[2]) - right**2 * (q[1] - q[0])
        below = left * (q[1] - q[2]) - right * (q[1] - q[0])
        vertex = x[1] - 0.5 * above / below
    return np.where(np.isfinite(vertex), vertex, x[1])


def _halved(x: Array) -> Any:
    """Return the middles of the longer sides."""
    return np.where(x[2] - x[1] > x[1] - x[0], 0.5 * (x[1] + x[2]), 0.5 * (x[0] + x[1]))


def _narrowed(x: Array, q: Array, new: Array, value: Array) -> tuple[Any, Any]:
    """Return the three points about each minimum, and the values there, updated by a new one."""
    right, better = new > x[1], value < q[1]

    def updated(three: Array, one: Array) -> Any:
        first, middle, last = three
        low = np.where(right, np.where(better, middle, first), np.where(better, first, one))
        high = np.where(right, np.where(better, last, one), np.where(better, middle, last))
        return np.stack([low, np.where(better, one, middle), high])

    return updated(x, new), updated(q, value)
