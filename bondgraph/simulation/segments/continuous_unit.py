"""An imported unit that has no steps of its own (model exchange): CVode of FMPy integrates it between two communication points, with its events."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compiler.api import UnitDescription

MOST_STEPS = 100_000  # of the solver between two events
MOST_EVENTS = 10_000  # between two communication points, and iterations of one
# The solver begins again in each step, and its errors add up: each may have this part of the unit's tolerance, but not less than rounding leaves.
SHARE, LEAST = 1e-3, 1e-12
NEAR = 1e-13  # fraction of the time; nearer instants are one


class ContinuousUnit:
    """A unit between communication points. It is in event mode there, so that its inputs may jump."""

    def __init__(self, instance: Any, unit: UnitDescription, time: float) -> None:
        from fmpy.sundials import CVodeSolver

        self.instance, older = instance, unit.version == "2.0"
        self.update = instance.newDiscreteStates if older else instance.updateDiscreteStates
        rates = instance.getDerivatives if older else instance.getContinuousStateDerivatives
        size, roots = (unit.states, unit.indicators) if older else (instance.getNumberOfContinuousStates(), instance.getNumberOfEventIndicators())  # fmt: skip
        self.next = inf  # time event
        self.errors: list[Exception] = []
        self._settle()
        instance.enterContinuousTimeMode()
        self.solver = CVodeSolver(
            size, roots, self._held(instance.getContinuousStates), self._held(instance.setContinuousStates), self._held(rates),
            self._held(instance.getEventIndicators), self._held(instance.getNominalsOfContinuousStates), self._held(instance.setTime),
            self, time, relativeTolerance=max(SHARE * unit.tolerance, LEAST), maxNumSteps=MOST_STEPS,
        )  # fmt: skip
        instance.enterEventMode()

    def apply(self, time: float) -> None:
        """Set no input at a time, as the solver asks for: they hold between two communication points."""

    def step(self, start: float, end: float) -> None:
        """Go from one communication point to the next. Raises what the unit does, ValueError, RuntimeError."""
        time, events = start, 0
        self._resume(time)
        while time < end:
            goal = min(end, self.next)
            if goal - time > NEAR * max(abs(goal), end - start):
                time, is_event = self._integrate(time, goal)
            else:
                time, is_event = goal, False
            wants_event, ends = self.instance.completedIntegratorStep()
            if ends:
                raise ValueError("it asks to end the run")
            if time < end and (is_event or wants_event or time >= self.next):
                events += 1
                if events > MOST_EVENTS:
                    raise ValueError(f"it has more than {MOST_EVENTS} events in a step")
                self.instance.enterEventMode()
                self._resume(time)
        self.instance.enterEventMode()
        self._settle()

    def _resume(self, time: float) -> None:
        """Leave event mode, with all that events set."""
        self._settle()
        self.instance.enterContinuousTimeMode()
        self.solver.reset(time)

    def _integrate(self, time: float, goal: float) -> tuple[float, bool]:
        """Return how far the solver went, and whether it met a zero of an event indicator. It asks for nothing beyond the goal."""
        from fmpy.sundials.cvode import c_void_p, sundials_cvode, sunrealtype

        sundials_cvode.CVodeSetStopTime(c_void_p(self.solver.cvode_mem), sunrealtype(goal))
        _, roots, reached = self.solver.step(time, goal)
        if self.errors:
            raise self.errors[0]
        self.instance.setTime(reached)
        return reached, bool(roots.any())

    def _settle(self) -> None:
        """Iterate events at an instant."""
        for _ in range(MOST_EVENTS):
            needed, ends, _, _, is_defined, instant = self.update()
            if ends:
                raise ValueError("it asks to end the run")
            if not needed:
                self.next = instant if is_defined else inf
                return
        raise ValueError("its events at an instant do not come to an end")

    def _held(self, call: Callable[..., object]) -> Callable[..., None]:
        """Return a call for the solver, through which no exception passes; the first one is raised after the step."""

        def within(*values: object) -> None:
            try:
                call(*values)
            except Exception as error:
                self.errors.append(error)

        return within
