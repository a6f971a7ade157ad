"""Least and greatest values of the outputs in a run, searched in the solution between the reported instants.

Of each step the states at nine places are kept (Chebyshev points of the second kind, both ends among them). The polynomial through them is the dense
output of the step, whose degree is at most eight, so the search evaluates the outputs where it wants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from compiler.api import Array

from ...results.records import Extremes

Outputs = Callable[[Any, Any, Any], Any]  # times (k,), states (k, n), mode -> (k, outputs)

COUNT = 9  # places in a step
PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(COUNT) / (COUNT - 1))
# Barycentric weights of these places (Berrut and Trefethen, Barycentric Lagrange interpolation, SIAM Review 46, 2004, equation 5.4).
WEIGHTS = np.where(np.arange(COUNT) % (COUNT - 1) == 0, 0.5, 1.0) * (-1.0) ** np.arange(COUNT)
# Steps that are searched together for each end of each output, and how often the next ones are.
CANDIDATES, TRIALS = 4, 8
BEYOND = 0.2  # part of the rise to a place of a step by which an estimate may be too low
ROUNDS, PARTS = 5, 8  # times that a bracket is cut into so many parts and the best two are kept
POLE = 17  # times where the value still grows
GROWS = 8.0  # without a bound is what each six of the last times make so many times as large


class ExtremesMonitor:
    """Monitor of the least and greatest values of the outputs, each with its instant."""

    def __init__(self, outputs: Outputs, count: int) -> None:
        self._outputs = outputs
        self.value = np.full((2, count), -np.inf)  # greatest values of the outputs, and of their negatives
        self.time = np.full((2, count), np.nan)

    def look(self, times: Array, states: Array, mode: Array) -> None:
        """Search steps: `times` (steps, COUNT) at the places of each, `states` (steps, COUNT, n) in SI, all in one mode."""
        if not len(times) or not self.value.size:
            return
        signed = self._signed(times, states, mode)
        self._take(times, signed)
        most = _most(signed)  # (steps, 2, outputs)
        for _ in range(TRIALS):
            most[~(most > self.value)] = -np.inf
            order = np.argsort(-most, axis=0)[:CANDIDATES]
            step, sign, output = order, *np.indices(order.shape)[1:]
            chosen = most[step, sign, output] > -np.inf
            if not chosen.any():
                break
            searched = step[chosen], sign[chosen], output[chosen]
            self._zoom(times, states, mode, searched, signed)
            most[searched] = -np.inf

    def look_at(self, times: Array, states: Array, mode: Array) -> None:
        """Take the outputs at single instants (k,) and states (k, n) as they are."""
        if len(times) and self.value.size:
            self._take(times[:, None], self._signed(times[:, None], states[:, None], mode))

    def look_at_values(self, times: Array, values: Array) -> None:
        """Take outputs (k, outputs) at reported instants as they are."""
        if len(times) and self.value.size:
            self._take(times[:, None], np.stack([values, -values], axis=1)[:, None])

    def ahead(self) -> ExtremesMonitor:
        """Return a monitor that takes what exceeds the values found so far, and has no instants yet."""
        other = ExtremesMonitor(self._outputs, self.value.shape[1])
        other.value[:] = self.value
        return other

    def _signed(self, times: Array, states: Array, mode: Array) -> Any:
        """Return the outputs and their negatives; shape (steps, places, 2, outputs)."""
        values = self._outputs(times.reshape(-1), states.reshape(times.size, states.shape[-1]), mode)
        return np.stack([values, -values], axis=1).reshape(*times.shape, *self.value.shape)

    def _take(self, times: Array, found: Array) -> None:
        """Keep the greatest of some values (steps, places, 2, outputs); what is no number outlasts all others."""
        flat = found.reshape(-1, *self.value.shape)
        best: Any = np.argmax(flat, axis=0)  # the first that is no number, if there is one
        value = np.take_along_axis(flat, best[None], axis=0)[0]
        better = ~(value <= self.value) & ~np.isnan(self.value)
        self.value[better], self.time[better] = value[better], times.reshape(-1)[best][better]

    def _zoom(self, times: Array, states: Array, mode: Array, chosen: tuple[Array, Array, Array], found: Array) -> None:
        """Search for the maxima of chosen outputs within chosen steps, on finer and finer parts."""
        step, sign, output = chosen
        place: Any = np.argmax(found[step, :, sign, output], axis=1)
        low, high = PLACES[np.maximum(place - 1, 0)], PLACES[np.minimum(place + 1, COUNT - 1)]
        share = np.linspace(0.0, 1.0, PARTS + 1)
        tops: list[Array] = []  # beside the greatest, which may be on a pole by rounding
        while len(tops) < ROUNDS or (len(tops) < POLE and (tops[-1] > 1.5 * np.abs(tops[-4])).any()):
            places = low[:, None] + (high - low)[:, None] * share
            at = times[step, :1] + (times[step, -1:] - times[step, :1]) * places
            inner = np.einsum("mpk,mkn->mpn", _interpolation(places), states[step])
            values = self._outputs(at.reshape(-1), inner.reshape(at.size, inner.shape[-1]), mode)
            own = values.reshape(*at.shape, -1)[np.arange(len(output)), :, output]
            own = np.where(sign[:, None] == 0, own, -own)
            best = np.argmax(own, axis=1)
            rows = np.arange(len(best))
            for k in np.flatnonzero(own[rows, best] > self.value[sign, output]):
                if own[k, best[k]] > self.value[sign[k], output[k]]:
                    self.value[sign[k], output[k]], self.time[sign[k], output[k]] = own[k, best[k]], at[k, best[k]]
            low, high = places[rows, np.maximum(best - 1, 0)], places[rows, np.minimum(best + 1, PARTS)]
            tops.append(np.sort(own, axis=1)[:, -2])
        if len(tops) == POLE:
            first, middle, last = tops[ROUNDS - 1 :: (POLE - ROUNDS) // 2]
            pole = (first > 0) & (middle > GROWS * first) & (last > GROWS * middle)
            self.value[sign[pole], output[pole]], self.time[sign[pole], output[pole]] = np.inf, at[rows, best][pole]

    def extremes(self) -> Sequence[Extremes]:
        """Return the extremes of each output, in SI."""
        return [
            Extremes(-float(low), float(low_at), float(high), float(high_at))
            for high, low, high_at, low_at in zip(*self.value, *self.time, strict=True)
        ]


def _most(found: Array) -> Any:
    """Return what the values in each step may reach between its places, by the parabola through the greatest and its neighbours, and more.

    `found`: (steps, places, 2, outputs); returns (steps, 2, outputs).
    """
    place = np.clip(np.argmax(found, axis=1, keepdims=True), 1, COUNT - 2)
    left, middle, right = (np.take_along_axis(found, place + k, axis=1)[:, 0] for k in (-1, 0, 1))
    before, after = (PLACES[place[:, 0] + k] - PLACES[place[:, 0] + k - 1] for k in (0, 1))
    rise, fall = (middle - left) / before, (right - middle) / after
    bend = (fall - rise) / (before + after)
    slope = (rise * after + fall * before) / (before + after)
    with np.errstate(all="ignore"):
        vertex = np.where(bend < 0, -0.25 * slope * slope / bend, 0.0)
    change = np.abs(middle - left) + np.abs(right - middle)
    most = np.maximum(np.maximum(middle, left), right) + np.minimum(vertex, change) + BEYOND * change
    return np.where(np.isnan(most), np.inf, most)  # beside a place that hits a pole


def _interpolation(places: Array) -> Any:
    """Return the matrices (m, p, COUNT) from the values at `PLACES` to those at other places (m, p) of a step."""
    away = places[..., None] - PLACES
    same = away == 0
    share = WEIGHTS / np.where(same, 1.0, away)
    share = np.where(same.any(axis=-1, keepdims=True), same, share)
    return share / share.sum(axis=-1, keepdims=True)
