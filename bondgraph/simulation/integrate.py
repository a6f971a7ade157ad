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
from .validity import Watch

DENSE = 100  # states up to which the linear algebra is dense
# Radau IIA, 3 stages: the places of its stages in a step, and its quadrature weights.
STAGES = np.array([(4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0])
WEIGHTS = np.array([(16 - 6**0.5) / 36, (16 + 6**0.5) / 36, 1 / 9])


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative, and per state absolute tolerance and magnitude, in SI; shape (n,).

    `needed` marks the states that the outputs need. Others are only there for an energy balance: they have no part in the
    error control, so that asking for the balance changes no step.
    """

    relative: float
    absolute: Any
    magnitude: Any
    needed: Any

    @property
    def share(self) -> float:
        """The solver divides norms by the root of the number of all states; this restores that of the needed ones."""
        share: float = max(1, int(np.count_nonzero(self.needed))) / max(1, len(self.needed))
        return float(share**0.5)

    @property
    def scaled(self) -> Any:
        """Absolute tolerances of the states divided by their magnitudes, as the solver is to see them."""
        return np.where(self.needed, self.absolute / self.magnitude * self.share, np.inf)


@dataclass(slots=True)
class Trajectory:
    """States at the requested instants, and what the solver did."""

    states: Any  # (points, n)
    steps: int = 0
    evaluations: dict[str, int] = field(default_factory=lambda: {"derivative": 0, "jacobian": 0, "factorisation": 0})
    work: Any = None  # integral of the powers, if asked
    final: Any = None


Powers = Callable[[Any, Any, Any], Any]  # times, states (…, n), mode -> (…, ports)


def integrate(
    program: Program,
    constants: Any,
    inputs: Any,
    state: Any,
    stretches: Sequence[Segment],
    instants: Any,
    tolerances: Tolerances,
    powers: Powers | None,
    watch: Watch,
) -> Trajectory:
    """Integrate over the stretches; `watch` looks at each accepted step. Raises `RunFailed` with time and variable.

    `powers` are integrated with the solver's own quadrature, outside its error control: the value is that of further states
    which nothing depends on, so asking for it changes no step.
    """
    stepper = _Stepper(program, constants, inputs, instants, tolerances, powers, watch)
    x = np.array(state, dtype=float)
    for stretch in stretches:
        x = stepper.run(stretch, x)
    stepper.result.states[stepper.position :] = x
    stepper.result.final = x
    return stepper.result


class _Stepper:
    """Steps through one smooth stretch after another and keeps what was asked for."""

    def __init__(
        self,
        program: Program,
        constants: Any,
        inputs: Any,
        instants: Any,
        tolerances: Tolerances,
        powers: Powers | None,
        watch: Watch,
    ) -> None:
        self.watch = watch
        self.longest = float(min(np.abs(program.periods(constants)), default=np.inf))
        self.program, self.constants, self.inputs = program, constants, inputs
        self.instants, self.tolerances, self.powers = instants, tolerances, powers
        self.position = 0  # the next instant to be reported
        self.result = Trajectory(np.empty((len(instants), len(program.states.names))))

    def run(self, stretch: Segment, x: Any) -> Any:
        """One stretch from state x; returns the state at its end."""
        while self.position < len(self.instants) and self.instants[self.position] <= stretch.start:
            self.result.states[self.position] = x
            self.position += 1
        if not len(x):
            self._look_along(stretch, x)
            return x
        self.watch.look(np.array([stretch.start]), stretch.mode, lambda times: np.tile(x, (len(times), 1)))
        solver = self._solver(stretch, x)
        magnitude = self.tolerances.magnitude
        relative = self.tolerances.scaled
        peak = np.maximum(np.abs(x) / magnitude, 1.0)
        while solver.status == "running":
            self._step(solver)
            before = self.position
            self._sample(solver, stretch)
            self._look(solver, stretch, self.instants[before : self.position])
            if self.powers is not None:
                self._add_work(solver, self.powers, stretch)
            peak = np.maximum(peak, np.abs(solver.y))
            solver.atol = relative * peak  # a state that grows beyond its magnitude sets a new one
        for name, count in (("derivative", solver.nfev), ("jacobian", solver.njev), ("factorisation", solver.nlu)):
            self.result.evaluations[name] += count
        return solver.y * magnitude

    def _solver(self, stretch: Segment, x: Any) -> Any:
        """scipy's solver for the scaled states of one stretch."""
        from scipy.integrate import Radau
        from scipy.sparse import csc_array

        magnitude = self.tolerances.magnitude
        fixed = (self.inputs, self.constants, stretch.mode)

        def derivative(time: float, scaled: Any) -> Any:
            return self.program.derivative(time, scaled * magnitude, *fixed) / magnitude

        rows, columns = self.program.pattern
        ratio = magnitude[columns] / magnitude[rows]
        sparse = len(x) > DENSE and len(rows) < 0.2 * len(x) ** 2

        def jacobian(time: float, scaled: Any) -> Any:
            if not sparse:
                return self.program.jacobian(time, scaled * magnitude, *fixed) * magnitude / magnitude[:, None]
            entries = self.program.jacobian_entries(time, scaled * magnitude, *fixed) * ratio
            return csc_array((entries, (rows, columns)), shape=(len(x), len(x)))

        slope = derivative(stretch.start, x / magnitude)
        if not np.isfinite(slope).all():
            raise RunFailed(_not_finite(self.program, stretch.start, slope, x))
        tolerances = self.tolerances
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scipy warns of a small rtol; its status is looked at after each step
            solver = Radau(
                derivative,
                stretch.start,
                x / magnitude,
                stretch.stop,
                rtol=tolerances.relative * tolerances.share,
                atol=tolerances.scaled,
                jac=jacobian,
                max_step=self.longest,
            )
        solver.newton_tol = max(10 * np.finfo(float).eps / tolerances.relative, min(0.03, tolerances.relative**0.5))
        return solver

    def _step(self, solver: Any) -> None:
        """One accepted step."""
        try:
            solver.step()
        except (ValueError, np.linalg.LinAlgError) as error:  # scipy's factorisation refuses what is not finite
            message = (
                f"the linear algebra of a step failed near t = {solver.t:.9g} s ({error}); is the model singular there?"
            )
            raise RunFailed(message) from error
        if solver.status == "failed":
            magnitude = self.tolerances.magnitude
            slope = solver.fun(solver.t, solver.y) * magnitude
            raise RunFailed(_stuck(self.program, solver.t, solver.y * magnitude, slope, self.tolerances))
        self.result.steps += 1

    def _sample(self, solver: Any, stretch: Segment) -> None:
        """States at the instants that the last step passed."""
        first = last = self.position
        while last < len(self.instants) and self.instants[last] <= solver.t and self.instants[last] < stretch.stop:
            last += 1
        if last > first:
            states = solver.dense_output()(self.instants[first:last]).T
            self.result.states[first:last] = states * self.tolerances.magnitude
            self.position = last

    def _look(self, solver: Any, stretch: Segment, reported: Any) -> None:
        """Look at the limits of the model at the stages of the last step and at the instants that it passed."""
        if self.program.limits:
            step = solver.t - solver.t_old
            stages = [solver.t_old, *(solver.t_old + STAGES[:-1] * step), solver.t]
            times = np.unique(np.concatenate([stages, reported]))
            dense, magnitude = solver.dense_output(), self.tolerances.magnitude
            self.watch.look(times, stretch.mode, lambda t: dense(t).T * magnitude)

    def _look_along(self, stretch: Segment, x: Any) -> None:
        """The same where nothing has a state: at the reported instants of a stretch and its ends."""
        inside = self.instants[(self.instants > stretch.start) & (self.instants < stretch.stop)]
        times = np.array([stretch.start, *inside, stretch.stop])
        self.watch.look(times, stretch.mode, lambda t: np.tile(x, (len(t), 1)))

    def _add_work(self, solver: Any, powers: Powers, stretch: Segment) -> None:
        """Quadrature at the stages of the step: the collocation polynomial passes through them."""
        step = solver.t - solver.t_old
        times = solver.t_old + STAGES * step
        states = solver.dense_output()(times).T * self.tolerances.magnitude
        work = step * (WEIGHTS @ powers(times, states, stretch.mode))
        self.result.work = work if self.result.work is None else self.result.work + work


def _not_finite(program: Program, time: float, slope: Any, state: Any) -> str:
    bad = [program.states.names[i] for i in np.flatnonzero(~np.isfinite(slope))[:4]]
    values = ", ".join(f"{n} = {v:.6g}" for n, v in list(zip(program.states.names, state, strict=True))[:6])
    rates = " and ".join(f"`{b}`" for b in bad)
    return (
        f"at t = {time:.9g} s the rate of {rates} is not finite (with {values}); "
        "look for a division by zero, or a root or logarithm of a negative number"
    )


def _stuck(program: Program, time: float, state: Any, slope: Any, tolerances: Tolerances) -> str:
    if not np.isfinite(slope).all():
        return _not_finite(program, time, slope, state)
    worst = int(np.argmax(np.abs(slope) / tolerances.magnitude))
    name = program.states.names[worst]
    value = f"{state[worst]:.6g} {program.states.units[worst]}"
    return (
        f"the solver cannot hold rtol = {tolerances.relative:g} at t = {time:.9g} s: its step fell below round-off; `{name}` changes fastest "
        f"({value}). Likely causes: a jump in a law, a solution that grows without bound, or a tolerance below what doubles "
        "can hold"
    )
