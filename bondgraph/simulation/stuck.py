"""Why a run gets no further, in the author's names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..door import Program
from ..errors import RateNotFinite, RunFailed
from .crawling import advice, limiting_mode
from .trajectory import Tolerances

if TYPE_CHECKING:
    from .integrate import Solver, Stepper
    from .steps.compiled.interpreted import Interpreted
    from .steps.compiled.run import CompiledRadau
    from .steps.radau import Radau

MOST_STEPS = 1_000_000  # of one stretch; who needs more is being held up by something
MOST_COMPILED = 30_000_000  # the same for steps in machine code: about as long


def _names(program: Program) -> tuple[str, ...]:
    return (*program.states.names, *program.unknowns.names)


def not_finite(program: Program, time: float, slope: Any, state: Any) -> RateNotFinite:
    names = _names(program)
    bad = [names[i] for i in np.flatnonzero(~np.isfinite(slope))[:4]]
    values = ", ".join(f"{n} = {v:.6g}" for n, v in list(zip(names, state, strict=True))[:6])
    rates = " and ".join(f"`{b}`" for b in bad)
    return RateNotFinite(f"at t = {time:.9g} s the rate of {rates} is not finite (with {values})", time, state)


def failure(stepper: Stepper, solver: Solver, what: str, mode: Any) -> RunFailed:
    """Why a run ends where its solver stands; `what` failed last."""
    program = stepper.program
    state = solver.state * stepper.tolerances.magnitude
    slope = np.zeros(len(state))
    if what != "steps":
        slope = program.derivative(solver.time, state, stepper.inputs, stepper.constants, mode)
    if not np.isfinite(slope).all():
        return not_finite(program, solver.time, slope, state)
    told = stuck(program, solver, what, state, slope, stepper.tolerances)
    if what == "steps":
        start, stop = solver.last_step
        found = limiting_mode(stepper, float(stop), state, mode, float(stop - start), np.array(solver.error))
        if found is not None:
            told += f". The steps follow {found}: {advice(found, stepper.solver == 'explicit')}"
    return RunFailed(told)


def stuck(
    program: Program,
    solver: Radau | Interpreted | CompiledRadau,
    what: str,
    state: Any,
    slope: Any,
    tolerances: Tolerances,
) -> str:
    from .steps.compiled.run import CompiledRadau

    names, units = _names(program), (*program.states.units, *program.unknowns.units)
    share = np.abs(solver.error)
    worst = (
        int(np.argmax(np.where(np.isfinite(share), share, np.inf))) if share.any() else int(np.argmax(np.abs(slope)))
    )
    value = f"`{names[worst]}` (now {state[worst]:.6g} {units[worst]})"
    begin = f"the solver cannot hold rtol = {tolerances.relative:g} at t = {solver.time:.9g} s"
    if what == "steps":
        most = MOST_COMPILED if isinstance(solver, CompiledRadau) else MOST_STEPS
        return (
            f"the run gets no further than t = {solver.time:.9g} s within {most} steps; {value} holds the steps down. "
            "Likely causes: a fast oscillation that nothing damps, or a tolerance below what doubles can hold"
        )
    if what == "round-off":
        return (
            f"{begin}: shorter steps make the error of {value} no smaller, so it is round-off: quantities of very different size "
            "are subtracted from each other. Loosen the tolerance, or give its `nominal`"
        )
    if what == "newton":
        return (
            f"{begin}: its equations could not be solved, however short the step; {value} is involved. Likely causes: a law that "
            "jumps, an algebraic loop that loses its solution there, or a singular model"
        )
    return (
        f"{begin}: its step fell below round-off; {value} changes fastest. Likely causes: a jump in a law, a solution that "
        "grows without bound, or a tolerance below what doubles can hold"
    )
