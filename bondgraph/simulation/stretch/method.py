"""Which method steps through a stretch: what the author asks for, or what a look at the model there says.

An explicit method is the faster one where accuracy and not stability holds its steps. The spectrum of the Jacobian where a stretch begins
decides what is clear; else the explicit method tries some steps, of which nothing is kept. What becomes stiff later is found on the way.
Laws that bend are Radau's, whose steps end there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import UsageError
from ..segments import Segment
from ..steps.methods import AUTOMATIC, ENERGY, EXPLICIT, RADAU, RODAS
from ..steps.radau import StepFailed
from .reference import interpreted

if TYPE_CHECKING:
    from .stepper import Stepper

EASY = 300.0  # turns of the fastest mode in a stretch, in radians: so few that an explicit method needs no more than some fifty steps for them
STIFF = 3000.0  # such turns of a mode that dies out: it has done so long before the end
DAMPED = 0.3  # of its rate: what a mode loses, if it dies out
LARGEST = 200  # states up to which the spectrum is computed
LARGEST_INTERPRETED = 60  # states up to which the explicit steps run as Python
TRIAL = 60  # steps
ENOUGH = 64  # modes that have been looked at: others are like most of them


def method_of(stepper: Stepper, stretch: Segment, x: Any, compiled: bool) -> int:
    """The method that goes on from state x. Raises `UsageError` where the one that is asked for cannot."""
    explicit = _obstacle_to_explicit(stepper)
    if stepper.solver == "explicit" and explicit:
        raise UsageError(
            f"an explicit method cannot step through this model: {explicit}; leave the solver to choose, or name `radau`"
        )
    if stepper.solver == "energy":
        _check_conserving(stepper, explicit)
        return ENERGY
    if stepper.solver == "rodas":
        _check_rodas(stepper, len(x), compiled)
        return RODAS
    if stepper.solver != AUTOMATIC:
        return EXPLICIT if stepper.solver == "explicit" else RADAU
    if (
        explicit
        or stepper.program.bends is not None
        or stepper.history is not None
        or (len(x) > LARGEST_INTERPRETED and not compiled)
    ):
        return RADAU
    if stepper.result.settled is not None:
        return stepper.result.settled
    if stepper.program.hybrid is None:
        return _by_spectrum(stepper, stretch, x, compiled)
    # Events come back to modes that have been looked at.
    known, key = stepper.methods, np.asarray(stretch.mode).tobytes()
    if key not in known and len(known) >= ENOUGH:
        return max(known.values(), key=list(known.values()).count)
    if key not in known:
        known[key] = _by_spectrum(stepper, stretch, x, compiled)
    return known[key]


def _by_spectrum(stepper: Stepper, stretch: Segment, x: Any, compiled: bool) -> int:
    """The method that fits what the modes do on a stretch."""
    rates = _spectrum(stepper, stretch, x)
    if rates is None:
        return RADAU
    turns = np.abs(rates).max(initial=0.0) * (stretch.stop - stretch.start)
    if turns <= EASY:
        return EXPLICIT
    dying = rates[-rates.real >= DAMPED * np.abs(rates)]
    if np.abs(dying).max(initial=0.0) * (stretch.stop - stretch.start) > STIFF:
        return RADAU
    return _tried(stepper, stretch, x, compiled)


def _obstacle_to_explicit(stepper: Stepper) -> str:
    """Why an explicit method cannot step; empty if it can."""
    if stepper.constraints:
        return "closed loops hold its states on constraints"
    return "the unknowns of its algebraic loops are found with each step" if len(stepper.program.unknowns.names) else ""


def _check_rodas(stepper: Stepper, states: int, compiled: bool) -> None:
    """Raises `UsageError` for what a method that wants exact slopes, and solves for a stage once, cannot step through."""
    if stepper.constraints:
        obstacle = "closed loops hold its states on constraints"
    elif stepper.history is not None:
        obstacle = "delayed signals have no exact slope in time"
    elif states > LARGEST and not compiled:
        obstacle = f"without machine code it is for up to {LARGEST} states and unknowns, these are {states}"
    else:
        return
    raise UsageError(f"Rodas5P cannot step through this model: {obstacle}; leave the solver to choose, or name `radau`")


def _check_conserving(stepper: Stepper, obstacle: str) -> None:
    """Raises `UsageError` for what a method that keeps the energy cannot step through."""
    if stepper.program.hybrid is not None:
        obstacle = "events change what it stores"
    elif stepper.history is not None:
        obstacle = "delayed signals are no storage"
    elif stepper.program.bends is not None:
        obstacle = "its laws bend, which equal steps do not see"
    if obstacle:
        raise UsageError(f"no method keeps the energy of this model: {obstacle}; leave the solver to choose")


def _spectrum(stepper: Stepper, stretch: Segment, x: Any) -> Any:
    """The rates of the modes at a state; of a large model a bound of the fastest. None where there is none."""
    program, magnitude = stepper.program, stepper.tolerances.magnitude
    fixed = (stepper.inputs, stepper.constants, stretch.mode)
    rows, columns = program.pattern
    entries = program.jacobian_entries(stretch.start, x, *fixed) * magnitude[columns] / magnitude[rows]
    if not np.isfinite(entries).all():
        return None
    if len(x) > LARGEST:
        sums = np.zeros(len(x))
        np.add.at(sums, rows, np.abs(entries))
        return 1j * sums.max(initial=0.0, keepdims=True)
    matrix = np.zeros((len(x), len(x)))
    matrix[rows, columns] = entries
    try:
        return np.linalg.eigvals(matrix)
    except np.linalg.LinAlgError:
        return None


def _tried(stepper: Stepper, stretch: Segment, x: Any, compiled: bool) -> int:
    """Some explicit steps, of which nothing is kept but what they say of the model."""
    try:
        if compiled:
            from .machine import explicit_trial

            evaluations, stiff, finished = explicit_trial(stepper, stretch, x, TRIAL)
        else:
            solver = interpreted(stepper, stretch, x)
            for _ in range(TRIAL):
                solver.step()
                if solver.finished or solver.is_stiff:
                    break
            evaluations, stiff, finished = solver.evaluations, solver.is_stiff, solver.finished
    except StepFailed:
        return RADAU
    stepper.count(evaluations)
    method = RADAU if stiff and not finished else EXPLICIT
    if not finished:
        stepper.result.settled = method
    return method
