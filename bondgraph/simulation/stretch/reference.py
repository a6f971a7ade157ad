"""Methods in Python for a segment: their functions of a program, for states divided by their magnitudes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..loops.loops import Eliminated
from ..segments.timeline import Segment, follower
from ..steps.methods import EXPLICIT
from ..steps.radau import Problem, Radau

if TYPE_CHECKING:
    from ..steps.compiled.interpreted import Interpreted
    from .stepper import Stepper


def interpreted(
    stepper: Stepper, stretch: Segment, x: Any, method: int = EXPLICIT, size: float = np.inf
) -> Interpreted:
    """Return a method that is written for machine code only, run in Python, from the start of a segment; `size` of all steps, if it needs that."""
    from ..steps.compiled.interpreted import Interpreted

    fixed = (stepper.program, stepper.inputs, stepper.constants, stepper.tolerances, stretch)
    return Interpreted(*fixed, x, stepper.longest, stepper.signals(stretch), method, size)


def reference(
    stepper: Stepper, stretch: Segment, start: float, x: Any, size: float = np.inf, absolute: Any = None
) -> Radau:
    """Return Radau for the scaled states of one segment, from a time and state in it; `size` of the first step, if known.

    `absolute`: tolerances of the scaled states, if they have grown.
    """
    program, magnitude, count = stepper.program, stepper.tolerances.magnitude, len(stepper.program.states.names)
    mode = np.array(stretch.mode, dtype=float)
    fixed = (stepper.inputs, stepper.constants, mode)
    differential = np.arange(len(x)) < count
    rows, columns = program.pattern
    unit = np.where(differential, magnitude, 1.0)  # residuals are scaled by the factorisation
    ratio, per_unit = magnitude[columns] / unit[rows], 1 / unit
    eliminated = Eliminated(program)

    def derivative(time: float, scaled: Any) -> Any:
        return eliminated.rates(time, scaled * magnitude, *fixed) * per_unit

    def jacobian(time: float, scaled: Any) -> Any:
        return eliminated.entries(time, scaled * magnitude, *fixed) * ratio

    def terms(entries: Any, scaled: Any) -> Any:
        return np.bincount(rows, np.abs(entries * scaled[columns]), len(x))

    relative = stepper.tolerances.relative
    from ..steps.factorise import dense, is_large, sparse

    shifted = (sparse if is_large(len(x), len(rows)) else dense)(rows, columns, differential)
    follows = follower(program, stepper.inputs, stepper.constants, stretch, stepper.signals(stretch))
    problem = Problem(
        derivative, jacobian, shifted, differential, relative, stepper.tolerances.scaled if absolute is None else absolute,
        follows, stepper.longest, terms=terms, mode=mode,
    )  # fmt: skip
    if program.bends is not None:
        bends = program.bends
        problem.bends = lambda time, scaled: bends(time, scaled * magnitude, *fixed)
    if stepper.constraints:

        def hold(time: float, scaled: Any) -> Any:
            held = stepper.constraints.project(time, scaled * magnitude, mode) / magnitude
            held[eliminated.places] = 0.0  # the steps' values of eliminated unknowns have no meaning
            return held

        problem.hold = hold
    return Radau(problem, start, x / magnitude, stretch.stop, size)
