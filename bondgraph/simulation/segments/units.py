"""Imported functional mock-up units in a run: co-simulated at the instants of their `every`, by FMPy.

At a communication point a unit makes the step that ends there, with what it took at the point before, and its values become those of the model: so it
never goes beyond the end of a run.

An imported unit that has no steps of its own (model exchange): CVode of FMPy integrates it between two communication points, with its events.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from math import inf, isfinite
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any
from weakref import finalize

from ...errors import MissingPackage, RunFailed

if TYPE_CHECKING:
    from compiler.api import EventNote, EventRow, Hybrid, UnitDescription, UnitVariable

ALLOWED = "BONDGRAPH_RUN_FMU"  # environment variable: any value allows the code of units to run
LATE = 1e-9  # fraction of a step by which a run may begin beside a communication point
MOST_TOLD = 300  # characters of a unit's own message
MOST_STEPS = 100_000  # of the solver between two events
MOST_EVENTS = 10_000  # between two communication points, and iterations of one
# The solver begins again in each step, and its errors add up: each may have this part of the unit's tolerance, but not less than rounding leaves.
SHARE, LEAST = 1e-3, 1e-12
NEAR = 1e-13  # fraction of the time; nearer instants are one


def refused(event: EventNote | EventRow) -> RunFailed:
    """Return the failure where something else than a run from its start meets a unit."""
    return RunFailed(
        "BR790", f"`{event.owner or event.words}` is an imported unit ({event.span.source.name}), which has no equations here:",
        "simulate from the start; no analysis, and no run that goes on from a result, can hold it",
    )  # fmt: skip


def refuse_units(hybrid: Hybrid | None) -> None:
    """Raise `RunFailed` if a program holds a unit."""
    for event in () if hybrid is None else hybrid.events:
        if event.span.unit is not None:
            raise refused(event)


@dataclass(eq=False)
class CoSimulatedUnit:
    """An instance of a unit: the event at which it exchanges values, and its communication step in s."""

    event: EventNote
    step: float
    folder: str  # of its files
    description: UnitDescription
    # the first communication points, two at most: their numbers, and what the unit took there
    taken: list[tuple[int, Mapping[str, float]]] = field(default_factory=list)
    number: int = 0  # of the last point
    before: Mapping[str, float] = field(default_factory=dict)  # what the model had there
    messages: list[str] = field(default_factory=list)
    instance: Any = None
    continuous: ContinuousUnit | None = None  # of model exchange

    def exchange(self, time: float, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values that the block sets at a communication point. `values`: as the model has them. Raises `RunFailed`."""
        number = round(time / self.step)
        if self.taken and self.taken[-1][0] == number:
            self.taken.pop()
        if len(self.taken) < 2:
            self.taken.append((number, values))
        with _Reported(self, time):
            if self.instance is None:
                self._begin(number * self.step, values)
            elif number > self.number:
                self._take(self.description.of("input"), self.before)
                self._step(number - 1)
            self.number, self.before = number, values
            return {**values, **self._outputs()}

    def again(self) -> CoSimulatedUnit:
        """Return another instance that has gone as far, one step at most."""
        other = CoSimulatedUnit(self.event, self.step, self.folder, self.description)
        for number, values in self.taken:
            other.exchange(number * self.step, values)
        return other

    def _begin(self, time: float, values: Mapping[str, float]) -> None:
        """Instantiate the unit, and initialize it with its parameters and inputs."""
        from fmpy import fmi2, fmi3, platform, platform_tuple, sharedLibraryExtension

        from compiler.api import check_length

        unit, older = self.description, self.description.version == "2.0"
        if unit.has_steps:
            make = fmi2.FMU2Slave if older else fmi3.FMU3Slave
        else:
            make = fmi2.FMU2Model if older else fmi3.FMU3Model
        own, there = platform if older else platform_tuple, sorted(p.name for p in Path(self.folder).glob("binaries/*"))
        if own not in there:
            raise ValueError(f"it has no library for {own} (it has: {', '.join(there) or 'none'})")
        library = Path(self.folder, "binaries", own, unit.identifier + sharedLibraryExtension)
        if library.is_file():
            check_length(library.read_bytes())
        place = os.getcwd()
        try:
            instance = make(
                guid=unit.token, unzipDirectory=self.folder, modelIdentifier=unit.identifier, instanceName=unit.name
            )
        finally:
            os.chdir(place)  # FMPy stays in the folder of a library that does not load
        if older:
            instance.instantiate(callbacks=_callbacks(self.messages))
            instance.setupExperiment(startTime=time)
            self.instance = instance
            self._take(unit.of("parameter"), values)
            instance.enterInitializationMode()
        else:
            instance.instantiate(logMessage=lambda _, status, category, text: _tell(self.messages, text))
            self.instance = instance
            self._take(unit.of("parameter"), values)
            instance.enterInitializationMode(startTime=time)
        finalize(self, _end, instance)
        self._take(unit.of("input"), values)
        instance.exitInitializationMode()
        if not unit.has_steps:
            self.continuous = ContinuousUnit(instance, unit, time)

    def _take(self, variables: Sequence[UnitVariable], values: Mapping[str, float]) -> None:
        from compiler.api import HELD

        numbers = []
        for item in variables:
            factor, offset = _scale(item)
            numbers.append((values[HELD + item.name] - offset) / factor)
        if numbers:
            write = self.instance.setReal if self.description.version == "2.0" else self.instance.setFloat64
            write([v.reference for v in variables], numbers)

    def _outputs(self) -> dict[str, float]:
        """Return the outputs in SI, by name."""
        outputs = self.description.of("output")
        read = self.instance.getReal if self.description.version == "2.0" else self.instance.getFloat64
        results = {}
        for item, number in zip(outputs, read([v.reference for v in outputs]), strict=True):
            factor, offset = _scale(item)
            results[item.name] = factor * float(number) + offset
            if not isfinite(number):
                raise ValueError(f"its output `{item.own}` is not finite")
        return results

    def _step(self, number: int) -> None:
        start, end = number * self.step, (number + 1) * self.step
        if self.continuous is not None:
            self.continuous.step(start, end)
            return
        answer = self.instance.doStep(start, end - start)
        if answer is not None and answer[1]:
            raise ValueError("it asks to end the run")
        if answer is not None and answer[2]:
            raise ValueError("it returned early from a step")

    def __str__(self) -> str:
        how = "co-simulated" if self.description.has_steps else "integrated by CVode"
        return (
            f"`{self.event.owner}` ({PurePath(self.event.span.source.name).name}) is a unit of FMI {self.description.version}, "
            f"{how} in steps of {self.step:g} s: what it takes and what it gives holds for one step, "
            "which no estimate of an error counts, and no energy balance sees inside of it"
        )


class _Reported:
    """Context in which what a unit raises becomes a `RunFailed`."""

    def __init__(self, unit: CoSimulatedUnit, time: float) -> None:
        self.unit, self.time = unit, time

    def __enter__(self) -> None:
        self.unit.messages.clear()

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, Exception):
            from compiler.api import printable

            words = printable("; ".join([str(error), *self.unit.messages[:2]]))[:MOST_TOLD]
            event = self.unit.event
            raise RunFailed(
                "BR791", f"at t = {self.time:.9g} s the unit `{event.owner}` ({event.span.source.name}) failed: {words}"
            ) from error


class CoSimulatedUnits:
    """Units of a run, by the numbers of their events."""

    def __init__(self, units: Mapping[int, CoSimulatedUnit]) -> None:
        self.units = units

    def ahead(self) -> CoSimulatedUnits | None:
        """Return copies for a pilot run at the start, which do not move those of the run; None later: it ends where they act."""
        if any(len(unit.taken) > 1 for unit in self.units.values()):
            return None
        return CoSimulatedUnits({number: unit.again() for number, unit in self.units.items()})

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the result."""
        return tuple(map(str, self.units.values()))


def units_of(hybrid: Hybrid, steps: Mapping[int, float], start: float) -> CoSimulatedUnits | None:
    """Return the units of a run that begins at a time; None if it has none. `steps`: periods by event. Raises `RunFailed`, `MissingPackage`."""
    units = {}
    for number, step in steps.items():
        event = hybrid.events[number]
        if event.span.unit is None:
            continue
        if not os.environ.get(ALLOWED):
            raise RunFailed(
                "BR792", f"`{event.owner}` is a unit of native code ({event.span.source.name}), which runs only where that is allowed:",
                "if you trust the file, set BONDGRAPH_RUN_FMU=1 in the environment",
            )  # fmt: skip
        if abs(start / step - round(start / step)) > LATE:
            raise RunFailed(
                "BR793", f"the run begins at t = {start:.9g} s, between two communication points of `{event.owner}`:",
                f"begin it at a multiple of {step:.9g} s, or set another `communication_step`",
            )  # fmt: skip
        units[number] = _loaded(event, step, event.span.unit)
    return CoSimulatedUnits(units) if units else None


def _loaded(event: EventNote, step: float, file: Path) -> CoSimulatedUnit:
    from shutil import rmtree
    from tempfile import mkdtemp

    from compiler.api import open_unit, read_unit_description

    try:
        import fmpy.fmi2  # noqa: F401
    except ImportError as error:
        raise MissingPackage("BR794", "imported units need FMPy:", 'pip install "bondgraph-lang[fmi]"') from error
    folder = mkdtemp(prefix="bondgraph-")
    unit = CoSimulatedUnit(event, step, folder, read_unit_description(file))
    finalize(unit, rmtree, folder, ignore_errors=True)
    with _Reported(unit, 0.0), open_unit(file) as archive:
        archive.extractall(folder)
    return unit


@lru_cache(4096)  # read at each communication point
def _scale(item: UnitVariable) -> tuple[float, float]:
    """Return factor and offset by which a value there becomes one in SI."""
    if item.factor is not None:
        return item.factor, item.offset
    from compiler.api import Source, read_unit

    scale = read_unit(Source("unit", item.unit))
    return replace(scale, offset=Fraction(0)).to_si(Fraction(1)), float(scale.offset)


def _tell(messages: list[str], text: bytes) -> None:
    messages.append(text.decode("utf-8", "replace"))


def _callbacks(messages: list[str]) -> Any:
    """Return the structure of functions that a unit of FMI 2.0 calls."""
    from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    functions = fmi2CallbackFunctions()
    functions.logger = fmi2CallbackLoggerTYPE(lambda _, name, status, category, text: _tell(messages, text))
    functions.allocateMemory, functions.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
    return functions


def _end(instance: Any) -> None:
    """End an instance; a unit that fails at this has no run any more."""
    for call in (instance.terminate, instance.freeInstance):
        try:
            call()
        except Exception:
            continue


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
