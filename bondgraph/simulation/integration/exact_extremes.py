"""Extremes of the outputs of a linear model, whose exact solution has no steps: it is searched on panels that its modes need.

A mode exp(a t) is searched on panels of a quarter of the time since the start, and on sixteen a turn for as long as it is there. In each panel the states
are the quintics through values, rates and second derivatives at both ends; what is found is evaluated exactly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from compiler.api import Array

from ..integrators import exponential
from ..integrators.exponential import DEGREE, NODES, TO_COEFFICIENTS
from ..monitors.extremes import PLACES, ExtremesMonitor

if TYPE_CHECKING:
    from ..segments.timeline import Segment
    from .integration_state import IntegrationState

ALIVE = 37.0  # time constants after which a mode is below rounding
TURN = 2 * np.pi / 16
PARTS = 4  # panels of one length, before the next ones are twice as long
FORCED = 2  # panels of an interval on which the forcing is no parabola
CURVED = 1e-9  # relative size of its terms of higher degree from which on it is none
MOST_PANELS = 20_000  # of a segment
AT_ONCE = 2_048  # panels
TOLD = "from t = {:.6g} s to {:.6g} s minimum and maximum of the outputs are those of the reported instants: the model turns too often to search between them"

# Slopes at both ends of an interval of length 1, from the values of a polynomial at `NODES`; shape (2, nodes).
_SLOPES = [chebyshev.chebval([-1.0, 1.0], chebyshev.chebder(row)) for row in np.eye(DEGREE + 1)]
SLOPES = 2.0 * np.array(_SLOPES).T @ TO_COEFFICIENTS
# Values at `PLACES`, from those of a quintic at 0 and 1, its slopes there and its second derivatives there; shape (places, 6).
QUINTIC = polynomial.polyvander(PLACES, 5) @ np.linalg.inv(
    np.concatenate([polynomial.polyval([0.0, 1.0], polynomial.polyder(np.eye(6), order)).T for order in range(3)])
)


def look_exactly(
    stepper: IntegrationState, extremes: ExtremesMonitor, form: exponential.Linear, stretch: Segment, x: Array
) -> None:
    """Search a segment from state x for the extremes of the outputs."""
    edges = _edges(form, stretch)
    cut = exponential.intervals(form, edges, np.inf)
    if cut is not None and _is_curved(form, cut):
        cut = exponential.intervals(form, edges, float(cut.lengths.min()) / FORCED) or cut
    states = None if cut is None else exponential.march(form, cut, x)
    if cut is None or states is None:
        stepper.result.notes.append(TOLD.format(stretch.start, stretch.stop))
        return
    searched = len(cut.starts)
    if len(edges) >= MOST_PANELS:
        searched = int(np.searchsorted(cut.starts, edges[-1]))
        stepper.result.notes.append(TOLD.format(edges[-1], stretch.stop))
    search = extremes.ahead()
    for first in range(0, searched, AT_ONCE):
        part = slice(first, min(first + AT_ONCE, searched))
        starts, lengths = cut.starts[part], cut.lengths[part]
        ends = states[first : first + len(starts) + 1]
        times = np.minimum(starts[:, None] + lengths[:, None] * PLACES, stretch.stop)
        search.look(times, _within(form, starts, lengths, ends), stretch.mode)
    new = np.unique(search.time[~np.isnan(search.time)])
    if len(new):
        extremes.look_at(new, exponential.at(form, cut, states)(new), stretch.mode)
    poles = np.isposinf(search.value) & ~np.isnan(search.time)
    extremes.value[poles], extremes.time[poles] = np.inf, search.time[poles]


def _edges(form: exponential.Linear, stretch: Segment) -> Any:
    """Return the inner ends of the panels of a segment, rising; their lengths are powers of two times the first."""
    span = stretch.stop - stretch.start
    modes = np.linalg.eigvals(form.matrix)
    modes = modes[np.abs(modes) * span > TURN]
    if not len(modes):
        return np.empty(0)
    first = TURN / float(np.abs(modes).max())
    waves = np.abs(modes.imag) + np.maximum(modes.real, 0.0)
    until = np.where(modes.real < 0, ALIVE / np.maximum(-modes.real, ALIVE / np.finfo(float).max), np.inf)
    order = np.argsort(until)
    ahead = np.maximum.accumulate(waves[order][::-1])[::-1].tolist()  # the fastest wave from each end of a mode on
    ends, edges, now = until[order].tolist(), list[float](), 0.0
    while now < span and len(edges) < MOST_PANELS:
        while ends and ends[0] <= now:
            del ends[0], ahead[0]
        most = TURN / ahead[0] if ahead and ahead[0] > 0 else np.inf
        longest = min(most, max(first, now / PARTS))
        now += first * 2.0 ** np.floor(np.log2(longest / first))
        edges.append(now)
    inner = stretch.start + np.array(edges)
    return inner[inner < stretch.stop]


def _is_curved(form: exponential.Linear, cut: exponential.Intervals) -> bool:
    """Return True if the forcing is more than a parabola on some interval."""
    if not len(form.active):
        return False
    values = form.forcing(cut.starts[:, None] + cut.lengths[:, None] * NODES)
    terms = np.abs(np.einsum("cj,kjs->kcs", TO_COEFFICIENTS, values))[:, 3:].max(axis=(0, 1))
    return bool((terms > CURVED * np.abs(values).max(axis=(0, 1))).any())


def _within(form: exponential.Linear, starts: Array, lengths: Array, states: Array) -> Any:
    """Return the states at the places of panels, shape (panels, places, n) in SI; `states` (panels + 1, n): at their ends."""
    balanced = states / form.scale
    ends = np.stack([balanced[:-1], balanced[1:]], axis=1)  # (panels, 2, n)
    rates, bends = ends @ form.matrix.T, np.zeros_like(ends)
    if len(form.active):
        forcing = form.forcing(starts[:, None] + lengths[:, None] * NODES)
        rates[..., form.active] += forcing[:, [0, -1]]
        bends[..., form.active] = np.einsum("ej,kjs->kes", SLOPES, forcing) / lengths[:, None, None]
    bends += rates @ form.matrix.T
    size = lengths[:, None, None]
    jets = np.concatenate([ends, size * rates, size * size * bends], axis=1)  # (panels, 6, n)
    return np.einsum("pg,kgn->kpn", QUINTIC, jets) * form.scale
