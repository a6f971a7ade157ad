"""Step failure: the reason why a run gets no further, with the names of the model's text."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...errors import RateNotFinite, RunFailed, StepsCollapsed
from ..segments.trajectory import LastStep, SegmentContext, Tolerances
from .step_size_diagnosis import advice, limiting_mode

MOST_STEPS = 1_000_000  # most steps of one segment; a run that needs more is limited by an unusual cause
LOOSE = 1e-8  # relative tolerance above which a tighter one is advised
HUGE = 1e280  # near the largest number there is
MOST_COMPILED = 30_000_000  # the same for steps in machine code: about the same computing time


# Distances to look ahead for the cause of collapsed steps: fractions of the time that moves a state by its magnitude, and of the run.
REACHES = (1e-15, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1e-1, 1.0)
SHARES = (1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-4)


def ahead(
    program: Program, tolerances: Tolerances, whole: float, time: float, state: Array, slope: Array
) -> tuple[tuple[float, Any], ...]:
    """Return points ever further along the rates from a state, where the cause of collapsed steps lies. `whole`: length of the run, s."""
    step = np.where(np.arange(len(state)) < len(program.states.names), slope, 0.0)
    speed = float((np.abs(step) / np.maximum(tolerances.magnitude, np.abs(state))).max(initial=0.0))
    reach = min(whole, 1 / speed if speed > 0 else np.inf)
    least = 10 * float(np.spacing(max(abs(time), 1e-300)))
    spans = sorted({max(least, x) for x in (*(r * reach for r in REACHES), *(s * whole for s in SHARES))})
    return tuple((time + x, state + x * step) for x in spans if x <= max(reach, 1e-9 * whole, least))


def not_finite(program: Program, time: float, slope: Array, state: Array, mode: Array) -> RateNotFinite:
    names = program.variables.names
    bad = [names[i] for i in np.flatnonzero(~np.isfinite(slope))[:4]]
    values = ", ".join(f"{n} = {v:.6g}" for n, v in list(zip(names, state, strict=True))[:6])
    rates = " and ".join(f"`{b}`" for b in bad)
    found = RateNotFinite("BR781", f"at t = {time:.9g} s the rate of {rates} is not finite (with {values})")
    return found.at(time, state, mode)


def failure(context: SegmentContext, solver: LastStep, what: str, mode: Array, explicit: bool, most: int) -> RunFailed:
    """Return the error of a run that cannot go on from the solver's current state; `what`: the part that failed last; `most`: the allowed steps."""
    program, tolerances = context.program, context.tolerances
    state = solver.state * tolerances.magnitude
    slope = np.zeros(len(state))
    if what != "steps":
        slope = program.derivative(solver.time, state, context.inputs, context.constants, mode)
    if not np.isfinite(slope).all():
        return not_finite(program, solver.time, slope, state, mode)
    found = None
    if what == "steps":
        start, stop = solver.last_step
        found = limiting_mode(context, float(stop), state, mode, float(stop - start), np.array(solver.error))
    limit = "" if found is None else f". The steps follow {found}: {advice(found, explicit)}"
    if explicit and what == "error":
        limit = ". No explicit method passes a law that is steep beside its storage, as a root at zero: name `radau`, or leave the solver to choose"
    error = _cause(context, solver, what, (state, slope), f"{most} steps", limit).at(solver.time, state, mode)
    if what in ("newton", "error") or (what == "round-off" and len(program.unknowns.names)):
        error.ahead = ahead(program, tolerances, context.whole, solver.time, state, slope)
    return error


def _cause(context: SegmentContext, solver: LastStep, what: str, here: tuple[Any, Any], most: str, limit: str) -> StepsCollapsed:  # fmt: skip
    """Return the error by the part that failed last, at a state with its slope `here`; `limit`: words on the mode that limits the steps."""
    program, tolerances, (state, slope) = context.program, context.tolerances, here
    names, units = program.variables.names, program.variables.units
    share = np.abs(solver.error)
    worst = (
        int(np.argmax(np.where(np.isfinite(share), share, np.inf))) if share.any() else int(np.argmax(np.abs(slope)))
    )
    value = f"`{names[worst]}` (now {state[worst]:.6g} {units[worst]})"
    begin = f"the solver cannot hold rtol = {tolerances.relative:g} at t = {solver.time:.9g} s"
    huge = int(np.argmax(np.maximum(np.abs(state), np.abs(slope))))
    if max(abs(state[huge]), abs(slope[huge])) > HUGE:
        return StepsCollapsed(
            "BR782", f"{begin}: `{names[huge]}` (now {state[huge]:.6g} {units[huge]}, and changing by {slope[huge]:.6g} a second) becomes too large "
            "for a number.", f"Likely causes: a law that grows like an exponential, or a unit that is missing{limit}",
        )  # fmt: skip
    flat = ". Between laws that are all flat, as of diodes that block, a node has no value but for rounding: put a large resistor (1 Gohm, 1 Mohm) beside each"
    bend = ". A loop with a law that bends within the tolerance, as a diode's at hundreds of volts, needs a tighter one"
    steep = flat + bend * (tolerances.relative > LOOSE) if len(program.unknowns.names) else ""
    if what == "steps":
        return StepsCollapsed(
            "BR783", f"the run gets no further than t = {solver.time:.9g} s within {most}; {value} holds the steps down.",
            f"Likely causes: a fast oscillation that nothing damps, or a tolerance below what doubles can hold{limit}",
        )  # fmt: skip
    if what == "round-off":
        return StepsCollapsed(
            "BR784", f"{begin}: shorter steps make the error of {value} no smaller, so it is round-off: quantities of very different size "
            "are subtracted from each other.", f"Loosen the tolerance, or give its `nominal`{steep}",
        )  # fmt: skip
    if what == "newton":
        return StepsCollapsed(
            "BR785", f"{begin}: its equations could not be solved, however short the step; {value} is involved.",
            f"Likely causes: a law that jumps, an algebraic loop that loses its solution there, or a singular model{steep}",
        )  # fmt: skip
    return StepsCollapsed(
        "BR786", f"{begin}: its step fell below round-off; {value} changes fastest.",
        f"Likely causes: a jump in a law, a solution that grows without bound, or a tolerance below what doubles can hold{limit}",
    )  # fmt: skip
