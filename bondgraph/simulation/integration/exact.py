"""Segment of a linear model by the matrix exponential: exact at every instant, without step-size control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import SOLVERS, Array

from ...numerics.quadrature import GAUSS, KRONROD, PLACES, too_coarse
from ..integrators import exponential
from ..monitors.step_failure import not_finite
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from .integration_state import IntegrationState

LEFT = (0.0, 1e-6, 1e-3, 1e-2, 0.1)  # fractions of the segment that remain before its end
LASTING = 30.0  # time constants after which a wave is gone
LOOKED_AT = 4097  # places of a segment that are searched for values that are not finite


def exactly(stepper: IntegrationState, stretch: Segment, x: Array) -> Any | None:
    """Integrate a segment as `run`, from state x; return None if it cannot be done this way."""
    fixed = stepper.program, stepper.inputs, stepper.constants
    form = exponential.linear_form(*fixed, stretch, stepper.whole, stepper.forms)
    if form is None:
        return None
    form.share(stepper.exponentials)
    known = len(form.known)
    looked_at = stepper.powers is not None or stepper.watch.moves
    longest = exponential.fastest(form) if looked_at else np.inf
    while True:
        cut = exponential.intervals(form, stepper.instants[stepper.position :], longest)
        states = None if cut is None else exponential.march(form, cut, x)
        if cut is None or states is None:
            return None
        work = None if stepper.powers is None else _work(stepper, form, cut, states, stretch)
        if work is None or work[1]:
            break
        longest = 0.5 * float(cut.lengths.max())
    _look(stepper, form, cut, states, stretch)
    if stepper.extremes is not None:
        from .exact_extremes import look_exactly

        look_exactly(stepper, stepper.extremes, form, stretch, x)
    ends = states[1:][cut.reported][:-1]
    stepper.result.states[stepper.position : stepper.position + len(ends)] = ends
    stepper.position += len(ends)
    if work is not None:
        stepper.add(*work[0])
    stepper.result.rounded = max(stepper.result.rounded, _rounding(stepper, form, stretch))
    stepper.result.steps += len(cut.starts)
    stepper.count({"exponential": len(form.known) - known})
    stepper.result.solvers[SOLVERS["exponential"].name] = None
    return states[-1]


def _rounding(stepper: IntegrationState, form: exponential.Linear, stretch: Segment) -> float:
    """Return the rounding, in tolerances, of the phase of the fastest wave that has lasted since the start of the run."""
    span, rtol = stretch.stop - float(stepper.instants[0]), stepper.watch.rtol
    unit = float(np.finfo(np.longdouble if len(form.matrix) <= exponential.EXTENDED else float).eps)
    if form.norm * span * unit <= rtol:
        return 0.0
    modes = np.linalg.eigvals(form.matrix)
    lasting = np.abs(modes.imag[modes.real * span > -LASTING])
    return float(lasting.max(initial=0.0)) * span * unit / rtol


def check_driven(stepper: IntegrationState, stretch: Segment, x: Array) -> None:
    """Raise `RateNotFinite` at the first instant at which a driving signal has no value, to rounding: no other solver would help then."""
    times: Any = np.linspace(stretch.start, stretch.stop, LOOKED_AT)
    fixed = (stepper.inputs, stepper.constants, stretch.mode)
    slopes = stepper.program.derivative(times, np.tile(x, (len(times), 1)), *fixed)
    bad = np.flatnonzero(~np.isfinite(slopes).all(axis=-1))
    if not len(bad):
        return
    late = float(times[bad[0]])
    early = float(times[max(bad[0] - 1, 0)])
    while early < (middle := 0.5 * (early + late)) < late:
        if np.isfinite(stepper.program.derivative(middle, x, *fixed)).all():
            early = middle
        else:
            late = middle
    for left in LEFT:  # no polynomial fits a signal up to a place where it is unbounded or has no derivative
        stop = early - left * (early - stretch.start)
        end = exactly(stepper, stretch.up_to(stretch.start, stop), x) if stop > stretch.start else None
        if end is not None:
            x = end
            stepper.keep(stop, x, stretch.mode, stretch.start)
            break
    raise not_finite(stepper.program, late, stepper.program.derivative(late, x, *fixed), x, stretch.mode)


def _work(
    stepper: IntegrationState, form: exponential.Linear, cut: exponential.Intervals, states: Array, stretch: Segment
) -> tuple[tuple[Any, float], bool]:
    """Return the work of a segment with the energy turnover, and True if the quadrature is fine enough."""
    assert stepper.powers is not None
    times, inside = exponential.between(form, cut, states, PLACES)
    values = stepper.powers(times.reshape(-1), inside.reshape(-1, inside.shape[-1]), stretch.mode)
    values = values.reshape(*times.shape, -1)
    work = np.einsum("k,p,kpq->kq", cut.lengths, KRONROD, values)
    coarse = np.einsum("k,p,kpq->kq", cut.lengths, GAUSS, values)
    traffic = float(np.abs(work).sum())
    doubt = np.abs(coarse - work).max(initial=0.0) / max(traffic, 1e-300)
    return (work.sum(axis=0), traffic), not too_coarse(doubt, stepper.watch.rtol)


def _look(
    stepper: IntegrationState, form: exponential.Linear, cut: exponential.Intervals, states: Array, stretch: Segment
) -> None:
    """Check the limits of the model at the ends of the intervals and at the places of a quadrature between them."""
    if stepper.watch.moves:
        inner, _ = exponential.between(form, cut, states, PLACES)
        times = np.unique(np.concatenate([cut.starts, inner.reshape(-1), [stretch.stop]]))
        stepper.watch.look(times, stretch.mode, exponential.at(form, cut, states))
