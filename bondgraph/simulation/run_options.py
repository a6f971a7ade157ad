"""Options of a run: checked, and completed by those of the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from functools import lru_cache
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import dataclass

from ..compiled_scene import chosen_target
from ..errors import UsageError
from .integrators.methods import chosen_solver
from .phase import PhaseOptions

if TYPE_CHECKING:
    from compiler.api import Compilation, Plan

    from ..compiled_model import CompiledModel

DEFAULT_RTOL = 1e-6
LEAST_RTOL = 1e-13
RTOL = LEAST_RTOL, 0.1
ACCURACY = 1e-12, 0.1
ATOL = 1e-200, 1e200  # range in SI units: squares of values relative to it must be finite
DEFAULT_POINTS = 501


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of a run; each value that is not None overrides the experiment."""

    to: str | float | None = None
    points: int | None = None
    rtol: float | None = None
    atol: float | None = None
    energy: bool = False
    target: str | None = None
    solver: str | None = None
    bandwidth: str | float | None = None  # a frequency as text, or in Hz
    accuracy: float | None = None  # largest error of an output relative to its magnitude
    check: bool = False
    error: bool = False
    extremes: bool = False
    parts: int = field(default=1, kw_only=True)  # number of parts; the integrator restarts between them


options_of = lru_cache(typed=True)(RunOptions)  # most calls have those of the call before


@dataclass(frozen=True, slots=True)
class RunRequest:
    """Request of a run: its experiment ("": the first, None: none), settings, the outputs that it reports (None: those of the experiment), and options."""

    experiment: str | None = ""
    settings: Mapping[str, str | float] = field(default_factory=dict)
    outputs: tuple[str, ...] | None = None
    options: RunOptions = RunOptions()

    def at(self, settings: Mapping[str, str | float]) -> RunRequest:
        """Return the same with further settings."""
        return replace(self, settings={**self.settings, **settings})

    def compilation(self, model: CompiledModel) -> Compilation:
        """Return the stages of its scene."""
        return model.compilation(model.scene(self.experiment, self.settings, outputs=self.outputs))


def check_run_options(wanted: RunOptions) -> None:
    """Raise `UsageError` for options with which no run is possible."""
    chosen_target(wanted.target)
    chosen_solver(wanted.solver)
    if isinstance(wanted.to, str):
        seconds(wanted.to)
    if wanted.bandwidth is not None:
        hertz(wanted.bandwidth)
    if wanted.rtol is not None:
        _checked("rtol", wanted.rtol, *RTOL)
    if wanted.atol is not None:
        _checked("atol", wanted.atol, *ATOL)
    if wanted.accuracy is not None:
        _checked("accuracy", wanted.accuracy, *ACCURACY)
    if wanted.points is not None:
        _count(wanted.points)


def planned(plan: Plan, wanted: RunOptions, values: Mapping[str, float]) -> tuple[Any, PhaseOptions, float | None]:
    """Return the reported instants of a run, the options of its phases, and its accuracy if there is one. Raises `UsageError`."""
    stop = end_of(plan, wanted.to)
    solver = chosen_solver(wanted.solver if wanted.solver is not None else plan.solver)
    rtol, accuracy = _rtol(plan, wanted)
    count = _count(wanted.points if wanted.points is not None else round(plan.settings.get("points", DEFAULT_POINTS)))
    atol = wanted.atol if wanted.atol is not None else plan.settings.get("atol")
    if atol is not None:
        _checked("atol", atol, *ATOL)
    bandwidth = plan.bandwidth if wanted.bandwidth is None else hertz(wanted.bandwidth)
    options = PhaseOptions(plan, rtol, atol, wanted.energy, values, solver, bandwidth, wanted.parts, wanted.extremes)
    return np.linspace(plan.start, stop, count), options, accuracy


def _rtol(plan: Plan, wanted: RunOptions) -> tuple[float, float | None]:
    """Return the tolerance of a run, and its accuracy if there is one, from which the tolerance is chosen."""
    rtol, accuracy = wanted.rtol, wanted.accuracy
    if accuracy is None:
        accuracy = plan.settings.get("accuracy")
    else:
        _checked("accuracy", accuracy, *ACCURACY)
    if rtol is None and accuracy is not None:
        rtol = max(min(accuracy / 10, plan.settings.get("rtol", accuracy)), LEAST_RTOL)
    return _checked("rtol", rtol if rtol is not None else plan.settings.get("rtol", DEFAULT_RTOL), *RTOL), accuracy


def end_of(plan: Plan, to: str | float | None) -> float:
    """Return the time at which a run ends. Raises `UsageError`."""
    stop = plan.stop if to is None else seconds(to)
    if stop is None:
        raise UsageError(
            "BR701", "nothing says how long to run:", "give an end with --to, or an experiment with `simulate 0 .. 1 s`"
        )
    if not plan.start < stop < float("inf"):
        raise UsageError("BR702", f"the end of the run, {stop:g} s, does not lie after its start, {plan.start:g} s")
    return stop


def seconds(text: str | float) -> float:
    """Return the time in s of a text such as `20 ms`, or of a bare number of seconds. Raises `UsageError`."""
    found = _number("--to", text, "s") if isinstance(text, str) else float(text)
    if found is None:
        raise UsageError("BR703", f"`{text}` is no time:", "write `20 ms`, or a number of seconds")
    return found


def hertz(given: str | float) -> float:
    """Return the frequency in Hz of a text such as `50 kHz`, or of a bare number of Hz. Raises `UsageError`."""
    found = _number("--bandwidth", given, "Hz") if isinstance(given, str) else float(given)
    if found is None or not 0 < found < float("inf"):
        raise UsageError("BR704", f"`{given}` is no bandwidth:", "write `50 kHz`, or a number of Hz")
    return found


@lru_cache(maxsize=256)  # called again at each point of a sweep
def _number(where: str, text: str, unit: str) -> float | None:
    """Return a number in SI, written bare or in a unit of the same kind as `unit`; None if the text is not a number."""
    from compiler.api import CompilationFailed, Literal, Source, counts_radians, parse_expression, read_unit

    try:
        tree = parse_expression(Source(where, text))
        if isinstance(tree, Literal):
            if tree.unit is None:
                return float(tree.number)
            scale = read_unit(Source(where, tree.unit.span.text))
            if scale.dimension == read_unit(Source(where, unit)).dimension and not counts_radians(tree.unit.span.text):
                return scale.to_si(tree.number)
    except CompilationFailed:
        pass  # no expression, or no unit: the same answer as for a number of another kind
    return None


def _count(points: int) -> int:
    try:
        count = index(points)
    except TypeError:
        count = 0
    if not 2 <= count <= 10_000_000:
        raise UsageError("BR705", "--points is a whole number from 2 to 10 000 000")
    return count


def _checked(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise UsageError("BR706", f"{name} = {value:g} is outside {low:g} to {high:g}")
    return value
