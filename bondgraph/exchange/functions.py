"""Table of the functions of FMI 2.0: their names, arguments, and the functions of the runtime that do the work.

The table is written as LLVM IR and as C, so both have the same interface. Functions that handle memory and texts are written by hand in both.
"""

from __future__ import annotations

from collections.abc import Callable
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
    "double": ("double ", "double"),
}


@dataclass(frozen=True, slots=True)
class FmiFunction:
    """A row: name, names of the arguments by type, the function that does the work, and its arguments."""

    name: str
    arguments: tuple[tuple[str, str], ...]
    work: Callable[..., int]
    passed: tuple[str, ...]


def _row(name: str, arguments: str, work: Callable[..., int], passed: str | None = None) -> FmiFunction:
    """Return a row from texts such as `c: pointer, time: double`."""
    pairs = tuple((n, t) for n, t in (item.split(": ") for item in arguments.split(", ")))
    own = tuple(n for n, _ in pairs) if passed is None else tuple(passed.split(", "))
    return FmiFunction(name, pairs, work, own)


_SOME = "c: pointer, vr: pointer, count: size, value: pointer"
FMI_2 = (
    _row("SetupExperiment", "c: pointer, has_tolerance: int, tolerance: double, start: double, has_stop: int, stop: double", exchange.set_up),
    _row("EnterInitializationMode", "c: pointer", values.may_start),
    _row("ExitInitializationMode", "c: pointer", exchange.end_initialization),
    _row("Terminate", "c: pointer", exchange.terminate),
    _row("GetReal", _SOME, values.get_values),
    _row("SetReal", _SOME, values.set_values),
    _row("GetInteger", _SOME, values.have_none, "c, count"),
    _row("SetInteger", _SOME, values.have_none, "c, count"),
    _row("GetBoolean", _SOME, values.have_none, "c, count"),
    _row("SetBoolean", _SOME, values.have_none, "c, count"),
    _row("GetString", _SOME, values.have_none, "c, count"),
    _row("SetString", _SOME, values.have_none, "c, count"),
    _row(
        "GetDirectionalDerivative",
        "c: pointer, unknowns: pointer, rows: size, knowns: pointer, columns: size, seed: pointer, result: pointer",
        values.get_slopes,
    ),
    _row("EnterEventMode", "c: pointer", exchange.enter_events),
    _row("NewDiscreteStates", "c: pointer, events: pointer", exchange.update_events, "c, events, events"),
    _row("EnterContinuousTimeMode", "c: pointer", exchange.enter_continuous),
    _row(
        "CompletedIntegratorStep", "c: pointer, no_return: int, events: pointer, ends: pointer", exchange.end_step
    ),
    _row("SetTime", "c: pointer, time: double", exchange.set_time),
    _row("SetContinuousStates", "c: pointer, states: pointer, count: size", exchange.set_states),
    _row("GetContinuousStates", "c: pointer, states: pointer, count: size", exchange.get_states),
    _row("GetDerivatives", "c: pointer, rates: pointer, count: size", exchange.get_rates),
    _row("GetNominalsOfContinuousStates", "c: pointer, nominals: pointer, count: size", exchange.get_nominals),
    _row("GetEventIndicators", "c: pointer, indicators: pointer, count: size", exchange.get_indicators),
    _row("DoStep", "c: pointer, time: double, size: double, no_return: int", stepping.do_step, "c, time, size"),
    _row("CancelStep", "c: pointer", values.refuse),
    _row("SetRealInputDerivatives", "c: pointer, vr: pointer, count: size, order: pointer, value: pointer", values.have_none, "c, count"),
    _row("GetRealOutputDerivatives", "c: pointer, vr: pointer, count: size, order: pointer, value: pointer", values.have_none, "c, count"),
    _row("GetStatus", "c: pointer, kind: int, value: pointer", values.refuse, "c"),
    _row("GetRealStatus", "c: pointer, kind: int, value: pointer", exchange.get_number),
    _row("GetIntegerStatus", "c: pointer, kind: int, value: pointer", values.refuse, "c"),
    _row("GetBooleanStatus", "c: pointer, kind: int, value: pointer", exchange.get_truth),
    _row("GetStringStatus", "c: pointer, kind: int, value: pointer", values.refuse, "c"),
)  # fmt: skip
# Methods with which no unit integrates.
LEFT_OUT = frozenset(STEPS) - {STEPS[EXPLICIT], STEPS[RADAU]}
# Functions that are written by hand, with those that handle memory.
BY_HAND = (
    "GetTypesPlatform", "GetVersion", "SetDebugLogging", "Instantiate", "FreeInstance", "Reset", "GetFMUstate", "SetFMUstate", "FreeFMUstate",
    "SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate",
)  # fmt: skip


def exported() -> tuple[str, ...]:
    """Return the names that an importer of FMI 2.0 looks for."""
    return tuple(f"fmi2{name}" for name in (*(row.name for row in FMI_2), *BY_HAND))


def sources() -> list[Callable[..., Any]]:
    """Return the functions of the runtime that the table calls."""
    return [*dict.fromkeys(row.work for row in FMI_2), memory.place_inside, exchange.reset, exchange.makes_own_steps]
