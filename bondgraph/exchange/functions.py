"""Table of the functions of FMI 2.0 and 3.0: their names, arguments, and the functions of the runtime that do the work.

The table is written as LLVM IR and as C, so both have the same interface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..simulation.integrators.compiled.advance import STEPS
from ..simulation.integrators.methods import EXPLICIT, RADAU
from .runtime import exchange, memory, stepping, values

# Types of C, and of LLVM.
TYPES = {
    "pointer": ("void *", "ptr"),
    "size": ("size_t ", "i64"),
    "int": ("int ", "i32"),
    "bool": ("_Bool ", "i8"),
    "double": ("double ", "double"),
}


@dataclass(frozen=True, slots=True)
class FmiFunction:
    """A row: name, names of the arguments by type, the function that does the work, and its arguments.

    An argument of the work `a=b` is a, or -1 where b is another number; other names than those of the arguments are constants.
    """

    name: str
    arguments: tuple[tuple[str, str], ...]
    work: Callable[..., Any]
    passed: tuple[str, ...]

    @property
    def result(self) -> str:
        """Return the type of the result: a status, a pointer, or nothing."""
        if self.work.__annotations__["return"] == "None":
            return "void"
        return "pointer" if self.name.startswith("Instantiate") else "status"


@dataclass(frozen=True, slots=True)
class FmiVersion:
    """A version: beginning of the names of its functions, the table of these, and those that return a text."""

    number: str
    prefix: str
    rows: tuple[FmiFunction, ...]
    texts: Mapping[str, str]

    def exported(self) -> tuple[str, ...]:
        """Return the names that an importer looks for."""
        return tuple(f"{self.prefix}{name}" for name in (*(row.name for row in self.rows), *self.texts))

    def sources(self) -> list[Callable[..., Any]]:
        """Return the functions of the runtime that the table calls."""
        return [*dict.fromkeys(row.work for row in self.rows), memory.tell]


def _row(name: str, arguments: str, work: Callable[..., Any], passed: str | None = None) -> FmiFunction:
    """Return a row from texts such as `c: pointer, time: double`."""
    pairs = tuple((n, t) for n, t in (item.split(": ") for item in arguments.split(", ")))
    own = tuple(n for n, _ in pairs) if passed is None else tuple(passed.split(", "))
    return FmiFunction(name, pairs, work, own)


_STATE = "c: pointer, state: pointer"
_SOME = "c: pointer, vr: pointer, count: size, value: pointer"
_ALONG = "c: pointer, unknowns: pointer, rows: size, knowns: pointer, columns: size, seed: pointer"
_COMMON = (
    _row("FreeInstance", "c: pointer", memory.release),
    _row("Reset", "c: pointer", memory.prepare, "c, fmu_model"),
    _row("ExitInitializationMode", "c: pointer", exchange.end_initialization),
    _row("Terminate", "c: pointer", exchange.terminate),
    _row("EnterEventMode", "c: pointer", exchange.enter_events),
    _row("EnterContinuousTimeMode", "c: pointer", exchange.enter_continuous),
    _row("SetTime", "c: pointer, time: double", exchange.set_time),
    _row("SetContinuousStates", "c: pointer, states: pointer, count: size", exchange.set_states),
    _row("GetContinuousStates", "c: pointer, states: pointer, count: size", exchange.get_states),
    _row("GetNominalsOfContinuousStates", "c: pointer, nominals: pointer, count: size", exchange.get_nominals),
    _row("GetEventIndicators", "c: pointer, indicators: pointer, count: size", exchange.get_indicators),
)


def _of_states(state: str, deserialize: str) -> tuple[FmiFunction, ...]:
    """Return the rows for copies of an instance, in the spelling of a version."""
    return (
        _row(f"Get{state}", _STATE, memory.get_state, "c, state, fmu_model"),
        _row(f"Set{state}", _STATE, memory.set_state, "c, state, fmu_model"),
        _row(f"Free{state}", _STATE, memory.free_state, "state, state"),
        _row(f"Serialized{state}Size", f"{_STATE}, size: pointer", memory.get_size, "size, fmu_model"),
        _row(f"Serialize{state}", f"{_STATE}, data: pointer, size: size", memory.serialize, "state, data, size, fmu_model"),
        _row(f"{deserialize}{state}", "c: pointer, data: pointer, size: size, state: pointer", memory.deserialize, "data, size, state, fmu_model"),
    )  # fmt: skip


FMI_2 = (
    *_COMMON,
    _row("SetDebugLogging", "c: pointer, on: int, count: size, categories: pointer", memory.do_nothing, "c"),
    _row(
        "Instantiate",
        "name: pointer, kind: int, guid: pointer, resources: pointer, callbacks: pointer, visible: int, logging: int",
        memory.instantiate_2, "name, kind, guid, callbacks, fmu_model",
    ),
    _row("SetupExperiment", "c: pointer, has_tolerance: int, tolerance: double, start: double, has_stop: int, stop: double", exchange.set_up),
    _row("EnterInitializationMode", "c: pointer", values.may_start),
    _row("GetReal", _SOME, values.get_values),
    _row("SetReal", _SOME, values.set_values),
    *(_row(f"{way}{kind}", _SOME, values.have_none, "c, count") for way in ("Get", "Set") for kind in ("Integer", "Boolean", "String")),
    _row("GetDirectionalDerivative", f"{_ALONG}, result: pointer", values.get_slopes),
    *_of_states("FMUstate", "DeSerialize"),
    _row("NewDiscreteStates", "c: pointer, events: pointer", exchange.update_events, "c, events, events"),
    _row("CompletedIntegratorStep", "c: pointer, no_return: int, events: pointer, ends: pointer", exchange.end_step),
    _row("GetDerivatives", "c: pointer, value: pointer, count: size", exchange.get_rates),
    _row("DoStep", "c: pointer, time: double, size: double, no_return: int", stepping.do_step, "c, time, size"),
    _row("CancelStep", "c: pointer", values.refuse),
    *(
        _row(name, "c: pointer, vr: pointer, count: size, order: pointer, value: pointer", values.have_none, "c, count")
        for name in ("SetRealInputDerivatives", "GetRealOutputDerivatives")
    ),
    *(
        _row(f"Get{kind}Status", "c: pointer, kind: int, value: pointer", values.refuse, "c") for kind in ("", "Integer", "String")
    ),
    _row("GetRealStatus", "c: pointer, kind: int, value: pointer", exchange.get_number),
    _row("GetBooleanStatus", "c: pointer, kind: int, value: pointer", exchange.get_truth),
)  # fmt: skip
_SIZED = f"{_SOME}, size: size"
_HEAD_3 = "name: pointer, token: pointer, resources: pointer, visible: bool, logging: bool"
_TIMES = "c: pointer, vr: pointer, count: size, counters: pointer, resolutions: pointer"
_INTEGERS = (f"{sign}Int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "U"))
_OTHER_TYPES = ("Float32", *_INTEGERS, "Boolean", "String")
FMI_3 = (
    *_COMMON,
    _row("SetDebugLogging", "c: pointer, on: bool, count: size, categories: pointer", memory.do_nothing, "c"),
    _row(
        "InstantiateModelExchange", f"{_HEAD_3}, environment: pointer, logger: pointer", memory.instantiate_3,
        "name, token, environment, logger, fmu_model",
    ),
    _row(
        "InstantiateCoSimulation",
        f"{_HEAD_3}, events: bool, early: bool, vr: pointer, count: size, environment: pointer, logger: pointer, update: pointer",
        memory.instantiate_steps_3, "name, token, events, early, environment, logger, fmu_model",
    ),
    _row(
        "InstantiateScheduledExecution",
        f"{_HEAD_3}, environment: pointer, logger: pointer, update: pointer, lock: pointer, unlock: pointer", memory.nothing, "fmu_model",
    ),
    _row(
        "EnterInitializationMode", "c: pointer, has_tolerance: bool, tolerance: double, start: double, has_stop: bool, stop: double",
        exchange.set_up_and_start,
    ),
    _row("GetFloat64", _SIZED, values.get_values, "c, vr, count=size, value"),
    _row("SetFloat64", _SIZED, values.set_values, "c, vr, count=size, value"),
    *(_row(f"{way}{kind}", _SIZED, values.have_none, "c, count") for way in ("Get", "Set") for kind in _OTHER_TYPES),
    *(
        _row(f"{way}Binary", "c: pointer, vr: pointer, count: size, sizes: pointer, value: pointer, size: size", values.have_none, "c, count")
        for way in ("Get", "Set")
    ),
    _row("GetClock", _SOME, values.get_clocks),
    _row("SetClock", _SOME, values.have_none, "c, count"),
    _row("GetNumberOfVariableDependencies", "c: pointer, vr: int, count: pointer", values.refuse, "c"),
    _row(
        "GetVariableDependencies",
        "c: pointer, vr: int, elements: pointer, vrs: pointer, places: pointer, kinds: pointer, count: size", values.refuse, "c",
    ),
    _row("GetDirectionalDerivative", f"{_ALONG}, seeds: size, result: pointer, size: size", values.get_slopes,
         "c, unknowns, rows=size, knowns, columns=seeds, seed, result"),
    _row("GetAdjointDerivative", f"{_ALONG}, seeds: size, result: pointer, size: size", values.get_adjoint_slopes,
         "c, unknowns, rows=seeds, knowns, columns=size, seed, result"),
    *_of_states("FMUState", "Deserialize"),
    *(_row(name, "c: pointer", values.refuse) for name in ("EnterConfigurationMode", "ExitConfigurationMode", "EvaluateDiscreteStates")),
    _row("GetIntervalDecimal", f"{_SOME}, kinds: pointer", values.have_none, "c, count"),
    _row("GetIntervalFraction", f"{_TIMES}, kinds: pointer", values.have_none, "c, count"),
    *(_row(name, _SOME, values.have_none, "c, count") for name in ("GetShiftDecimal", "SetIntervalDecimal", "SetShiftDecimal")),
    *(_row(name, _TIMES, values.have_none, "c, count") for name in ("GetShiftFraction", "SetIntervalFraction", "SetShiftFraction")),
    _row(
        "UpdateDiscreteStates",
        "c: pointer, again: pointer, ends: pointer, nominals: pointer, values: pointer, timed: pointer, time: pointer",
        exchange.update_discrete_states,
    ),
    _row("CompletedIntegratorStep", "c: pointer, no_return: bool, events: pointer, ends: pointer", exchange.complete_step, "c, events, ends"),
    _row("GetContinuousStateDerivatives", "c: pointer, value: pointer, count: size", exchange.get_rates),
    _row("GetNumberOfEventIndicators", "c: pointer, number: pointer", exchange.count_indicators),
    _row("GetNumberOfContinuousStates", "c: pointer, number: pointer", exchange.count_states),
    _row("EnterStepMode", "c: pointer", exchange.enter_continuous),
    _row("GetOutputDerivatives", "c: pointer, vr: pointer, count: size, orders: pointer, value: pointer, size: size", values.have_none, "c, count"),
    _row(
        "DoStep", "c: pointer, time: double, size: double, no_return: bool, events: pointer, ends: pointer, early: pointer, reached: pointer",
        stepping.step_or_return, "c, time, size, events, ends, early, reached",
    ),
    _row("ActivateModelPartition", "c: pointer, clock: int, time: double", values.refuse, "c"),
)  # fmt: skip
VERSIONS = {
    "2": FmiVersion("2.0", "fmi2", FMI_2, {"GetTypesPlatform": "default", "GetVersion": "2.0"}),
    "3": FmiVersion("3.0", "fmi3", FMI_3, {"GetVersion": "3.0"}),
}
# Methods with which no unit integrates.
LEFT_OUT = frozenset(STEPS) - {STEPS[EXPLICIT], STEPS[RADAU]}
