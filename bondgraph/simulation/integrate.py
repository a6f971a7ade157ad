"""The stepping: scipy's Radau (Radau IIA of order 5; Hairer and Wanner, Solving ODEs II, section IV.8) over smooth stretches.

States are divided by their magnitudes before the solver sees them, which keeps its linear algebra well scaled. Every solver
stops and starts again where the right side jumps or bends.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..door import Program
from ..errors import RunFailed
from .segments import Segment

# Radau IIA, 3 stages: the places of its stages in a step, and its quadrature weights.
STAGES = np.array([(4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])
WEIGHTS = np.array([(16 - 6**0.5) / 36, (16 + 6**0.5) / 36, 1 / 9])


@dataclass(slots=True)
class Trajectory:
    """States at the requested instants, and what the solver did."""

    states: Any  # (points, n)
    steps: int = 0
    evaluations: dict[str, int] = field(default_factory=lambda: {"derivative": 0, "jacobian": 0, "factorisation": 0})
    work: Any = None  # integral of the powers, if asked
    final: Any = None


class _NotFinite(Exception):
    def __init__(self, time: float, state: Any, slope: Any) -> None:
        self.time, self.state, self.slope = time, state, slope


def integrate(
    program: Program, constants: Any, inputs: Any, state: Any, stretches: Sequence[Segment], instants: Any, rtol: float,
    atol: Any, magnitude: Any, powers: Callable[[Any, Any, Any], Any] | None,
) -> Trajectory:  # fmt: skip
    """Integrate over the stretches. `atol` (n,) and `magnitude` (n,) in SI. Raises `RunFailed` with time and variable.

    `powers(times, states, mode)` is integrated with the solver's own quadrature, outside its error control: its value is
    that of further states which nothing depends on, so asking for it changes no step.
    """
    result = Trajectory(np.empty((len(instants), len(state))))
    x = np.array(state, dtype=float)
    position = 0
    for stretch in stretches:
        position, x = _stretch(program, constants, inputs, x, stretch, instants, position, rtol, atol, magnitude, powers, result)
    result.states[position:] = x
    result.final = x
    return result


def _stretch(
    program: Program, constants: Any, inputs: Any, x: Any, stretch: Segment, instants: Any, position: int, rtol: float, atol: Any,
    magnitude: Any, powers: Callable[[Any, Any, Any], Any] | None, result: Trajectory,
) -> tuple[int, Any]:  # fmt: skip
    """One smooth stretch; returns the next instant's number and the state at the end."""
    from scipy.integrate import Radau

    n = len(x)
    while position < len(instants) and instants[position] <= stretch.start:
        result.states[position] = x
        position += 1
    if n == 0:
        return position, x

    def derivative(time: float, scaled: Any) -> Any:
        return program.derivative(time, scaled * magnitude, inputs, constants, stretch.mode) / magnitude

    def jacobian(time: float, scaled: Any) -> Any:
        return program.jacobian(time, scaled * magnitude, inputs, constants, stretch.mode) * magnitude / magnitude[:, None]

    first = derivative(stretch.start, x / magnitude)
    if not np.isfinite(first).all():
        raise RunFailed(_not_finite(program, stretch.start, first, x))
    peak = np.maximum(np.abs(x) / magnitude, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scipy warns of a small rtol; the solver's status is checked below
        try:
            solver = Radau(derivative, stretch.start, x / magnitude, stretch.stop, rtol=rtol, atol=atol / magnitude * peak, jac=jacobian)
            while solver.status == "running":
                message = solver.step()
                if solver.status == "failed":
                    raise RunFailed(_stuck(program, solver.t, solver.y * magnitude, derivative(solver.t, solver.y) * magnitude, magnitude, rtol, message))
                result.steps += 1
                position = _sample(solver, stretch, instants, position, magnitude, result)
                if powers is not None:
                    _add_work(solver, powers, magnitude, stretch, result)
                peak = np.maximum(peak, np.abs(solver.y))
                solver.atol = atol / magnitude * peak
        except (ValueError, np.linalg.LinAlgError) as error:  # scipy's factorisation refuses what is not finite
            raise RunFailed(f"the linear algebra of a step failed near t = {solver.t:.9g} s ({error}); is the model singular there?") from error
    result.evaluations["derivative"] += solver.nfev
    result.evaluations["jacobian"] += solver.njev
    result.evaluations["factorisation"] += solver.nlu
    return position, solver.y * magnitude


def _sample(solver: Any, stretch: Segment, instants: Any, position: int, magnitude: Any, result: Trajectory) -> int:
    """States at the instants that the last step passed."""
    last = position
    while last < len(instants) and instants[last] <= solver.t and instants[last] < stretch.stop:
        last += 1
    if last > position:
        result.states[position:last] = solver.dense_output()(instants[position:last]).T * magnitude
    return last


def _add_work(solver: Any, powers: Callable[[Any, Any, Any], Any], magnitude: Any, stretch: Segment, result: Trajectory) -> None:
    """Quadrature at the stages of the step: the collocation polynomial passes through them."""
    step = solver.t - solver.t_old
    times = solver.t_old + STAGES * step
    values = powers(times, solver.dense_output()(times).T * magnitude, stretch.mode)
    work = step * (WEIGHTS @ values)
    result.work = work if result.work is None else result.work + work


def _not_finite(program: Program, time: float, slope: Any, state: Any) -> str:
    bad = [program.states.names[i] for i in np.flatnonzero(~np.isfinite(slope))[:4]]
    values = ", ".join(f"{n} = {v:.6g}" for n, v in list(zip(program.states.names, state, strict=True))[:6])
    return f"at t = {time:.9g} s the rate of {' and '.join(f'`{b}`' for b in bad)} is not finite (with {values}); look for a division by zero, or a root or logarithm of a negative number"


def _stuck(program: Program, time: float, state: Any, slope: Any, magnitude: Any, rtol: float, message: str | None) -> str:
    if not np.isfinite(slope).all():
        return _not_finite(program, time, slope, state)
    worst = int(np.argmax(np.abs(slope) / magnitude))
    name = program.states.names[worst]
    return f"the solver cannot hold rtol = {rtol:g} at t = {time:.9g} s: its step fell below round-off; `{name}` changes fastest ({state[worst]:.6g} {program.states.units[worst]}). Likely causes: a jump in a law, a solution that grows without bound, or a tolerance below what doubles can hold"
