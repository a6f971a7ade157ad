"""Measured frequency response: the model is run with a harmonic input until its transients have decayed."""

from __future__ import annotations

import math

from ..compiled_model import CompiledModel
from ..errors import UsageError
from ..keywords import AnalysisRequest
from ..simulation.repetition import simulate
from ..simulation.run_options import RunOptions, RunRequest
from .linear import linearization
from .placement import operating_point
from .response import Measured, first_harmonic, settling_time

PERIODS = 4  # periods evaluated, after the settling time
SAMPLES = 64  # samples per period
MOST_PERIODS = 100_000


def excite(model: CompiledModel, asked: AnalysisRequest, frequency: float, amplitude: float, rtol: float) -> Measured:
    """Measure the response of the requested output to a harmonic motion of the requested input about its value at the equilibrium."""
    (given,), (seen,) = asked.by, asked.outputs or ()
    if given not in model.inputs:
        raise UsageError("BR205", f"`{given}` is no input of the model; inputs are {', '.join(model.inputs) or 'none'}")
    linear = linearization(operating_point(model, asked))
    waited = math.ceil(settling_time(linear, given, seen, frequency) * frequency) + 1
    if waited > MOST_PERIODS:
        raise UsageError("BR206", f"it takes {waited} periods until `{seen}` has settled:", "`bode` gives its response exactly")  # fmt: skip
    unit = linear.units.get(given, "1")
    mean = f"{float(linear.u[0])!r} [{unit}]"
    swing = f"{amplitude!r} [{unit}]*sin(2*pi*{frequency!r}*time/(1 [s]))"
    periods = waited + PERIODS
    wanted = RunOptions(periods / frequency, periods * SAMPLES + 1, rtol)
    settings = {**(asked.settings or {}), given: f"{mean} + {swing}"}
    result = simulate(model, RunRequest(asked.experiment, settings, (seen,), wanted))
    last = slice(waited * SAMPLES, periods * SAMPLES)
    value, rest = first_harmonic(result.time[last], result[seen][last], frequency)
    return Measured(frequency, value / amplitude, rest, waited / frequency)
