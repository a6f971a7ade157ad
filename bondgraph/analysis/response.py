"""Frequency response: G(i w) = C (i w - A)^-1 B + D, exact from the linear model; and, as a check, measured by harmonic excitation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, ComplexArray, IntArray

from ..errors import UsageError
from ..rendering import OfModel, Plotted, Summarised
from ..results.json_values import as_json, entries, head
from .eigenvalues import bounded_eigenvalues
from .extrema import Evaluate, Extremum, extrema
from .linear import Linearization
from .spectrum import left_shapes

SCHEMA = "bondgraph-response/1"
POINTS = 400
MOST_POINTS = 1_000_000
LOWEST, HIGHEST = 1e-150, 1e150  # Hz: within them squares are finite
BESIDE = (-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0)  # in widths of a resonance
BEYOND = 1e-9  # relative distance from an undamped resonance within which there are no values
NO_VALUES = np.zeros((0, 0, 0))
LEFT = 1e-7  # of a transient, relative to the steady motion, when it has settled
DOUBTFUL = 1e-6  # relative to its terms: a response that may be their rounding
DIGITS = 4 * np.finfo(float).eps
AT_ONCE = 4_000_000  # most numbers in the matrices that are solved together


@dataclass(frozen=True, eq=False, repr=False)
class Response(OfModel, Summarised, Plotted):
    """Response `values` (f, m, k) at `frequencies` (f,) in Hz, from `inputs` (k) to `outputs` (m), in SI units of the output over those of the input.

    `phase` (f, m, k): in degrees, without jumps by whole turns, however few the frequencies are. `extrema`: peaks and dips between the first and last
    frequency, computed from the poles and independent of the frequencies; an undamped one has an infinite magnitude. `notes`: remarks for the user.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    frequencies: Array
    values: ComplexArray
    phase: Array
    extrema: tuple[Extremum, ...] = ()
    notes: tuple[str, ...] = ()

    def of(self, given: str, seen: str) -> ComplexArray:
        """Return the response from an input to an output, (f,). Raises `UsageError`."""
        for name, known, what in ((given, self.inputs, "input"), (seen, self.outputs, "output")):
            if name not in known:
                raise UsageError(
                    "BR232", f"there is no {what} `{name}` in this response; there is {', '.join(known) or 'none'}"
                )
        return np.asarray(self.values[:, self.outputs.index(seen), self.inputs.index(given)])

    @property
    def magnitude(self) -> Array:
        """Magnitude (f, m, k)."""
        return np.abs(self.values)

    def extrema_of(self, given: str, seen: str) -> list[Extremum]:
        """Return peaks and dips from an input to an output, rising."""
        return [e for e in self.extrema if (e.given, e.seen) == (given, seen)]

    def peaks(self) -> list[tuple[str, str, float]]:
        """Return for each pair of input and output the frequency (Hz) of the largest magnitude: (input, output, frequency)."""
        size, found = self.magnitude, []
        for j, given in enumerate(self.inputs):
            for i, seen in enumerate(self.outputs):
                k = int(size[:, i, j].argmax())
                ends = [(float(size[k, i, j]), float(self.frequencies[k]))]
                inner = [(e.magnitude, e.frequency) for e in self.extrema_of(given, seen) if e.kind == "peak"]
                found.append((given, seen, max([*ends, *inner], key=lambda pair: pair[0])[1]))
        return found

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-response/1`.

        {schema, model, experiment, frequencies (Hz), responses: [{input, output, unit, values: [{re, im}], magnitude, phase (deg), extrema: [{kind,
        frequency, magnitude (null: infinite), undamped, phase}]}], notes}.
        """
        phase, magnitude = self.phase, self.magnitude
        responses = [
            {
                "input": given, "output": seen, "unit": self.unit(given, seen), "values": as_json(self.values[:, i, j]),
                "magnitude": as_json(magnitude[:, i, j]), "phase": as_json(phase[:, i, j]),
                "extrema": [
                    entries(e, "kind", "frequency", "magnitude", "phase") | {"undamped": math.isinf(e.magnitude)}
                    for e in self.extrema_of(given, seen)
                ],
            }
            for j, given in enumerate(self.inputs)
            for i, seen in enumerate(self.outputs)
        ]  # fmt: skip
        return {**head(SCHEMA, self), **entries(self, "frequencies", "notes"), "responses": responses}

    def unit(self, given: str, seen: str) -> str:
        """Return the unit of the output over that of the input, `m/N`."""
        above, below = self.units.get(seen, "1"), self.units.get(given, "1")
        return above if below == "1" else f"{above}/({below})" if any(c in below for c in "*/") else f"{above}/{below}"


def response(linear: Linearization, low: float | None, high: float | None, points: int = POINTS) -> Response:
    """Return the response at `points` frequencies from `low` to `high` (Hz, logarithmic; None: a decade around the modes) and at resonances."""
    if not linear.inputs or not linear.outputs:
        raise UsageError(
            "BR233", "a frequency response leads from an input to an output:", "name one that the model has (or a parameter as input)",
        )  # fmt: skip
    frequencies = frequencies_between(np.linalg.eigvals(linear.A), low, high, points)
    found = bounded_eigenvalues(linear.A)
    undamped = (np.abs(found.values.real) <= found.bounds) & (np.abs(found.values.imag) > found.bounds)
    notes = tuple(filter(None, (linear.note,)))
    return with_extrema(
        Response(linear.model, linear.experiment, linear.inputs, linear.outputs, linear.units, frequencies, NO_VALUES.astype(complex), NO_VALUES, notes=notes),
        lambda f: transfer(linear, 2j * np.pi * f), found.values, undamped,
    )  # fmt: skip


def with_extrema(made: Response, evaluate: Evaluate, poles: ComplexArray, undamped: BoolArray) -> Response:
    """Return the response with values, peaks and dips; its frequencies include the finite extrema and no infinite one.

    Phases are followed over all frequencies at which extrema were searched, too: between a few they turn by more than a half.
    """
    frequencies = made.frequencies
    low, high = float(frequencies[0]), float(frequencies[-1])
    found, searched, beside = extrema(evaluate, poles, undamped, low, high, made.inputs, made.outputs)
    infinite = np.array([e.frequency for e in found if math.isinf(e.magnitude)])
    frequencies = np.unique([*frequencies, *(e.frequency for e in found if not math.isinf(e.magnitude))])
    if len(infinite):
        frequencies = frequencies[np.abs(frequencies[:, None] / infinite - 1).min(axis=1) > BEYOND]
    values = evaluate(frequencies)
    order = np.argsort(np.concatenate([frequencies, searched]), kind="stable")
    followed = np.unwrap(np.angle(np.concatenate([values, beside])[order]), axis=0)
    phase = np.degrees(followed[np.argsort(order)[: len(frequencies)]])
    rows = np.searchsorted(frequencies, [e.frequency for e in found])
    found = tuple(
        e
        if math.isinf(e.magnitude)
        else replace(e, phase=float(phase[k, made.outputs.index(e.seen), made.inputs.index(e.given)]))
        for e, k in zip(found, rows, strict=True)
    )
    return replace(made, frequencies=frequencies, values=values, phase=phase, extrema=found)


def transfer(linear: Linearization, places: Any) -> Any:
    """Return C (s - A)^-1 B + D at complex s (f,), shape (f, m, k). Infinite where s is an eigenvalue; 0 where the last digits of the entries leave it open."""
    from scipy.linalg import matrix_balance

    n = len(linear.A)
    result = np.repeat(linear.D[None].astype(complex), len(places), axis=0)
    if not n:
        return result
    A, (scale, _) = matrix_balance(linear.A, permute=False, separate=True)
    B, C = linear.B / scale[:, None], linear.C * scale
    width = max(1, AT_ONCE // n**2)
    for first in range(0, len(places), width):
        part = places[first : first + width]
        matrices = part[:, None, None] * np.eye(n) - A
        try:
            states = np.linalg.solve(matrices, np.repeat(B[None], len(part), axis=0))
            values = result[first : first + width] + C @ states
            terms = np.abs(linear.D) + np.abs(C) @ np.abs(states)
            doubtful = np.flatnonzero((np.abs(values) < DOUBTFUL * terms).any(axis=(1, 2)))
            if len(doubtful):
                _cancel(values, doubtful, matrices[doubtful], states[doubtful], B, C, terms[doubtful])
            result[first : first + width] = values
        except np.linalg.LinAlgError:
            for i, matrix in enumerate(matrices):
                result[first + i] = _at(matrix, B, C, linear.D)
    return result


def _cancel(
    values: ComplexArray, rows: IntArray, matrices: ComplexArray, states: ComplexArray, B: Array, C: Array, terms: Array
) -> None:
    """Set to zero what relative changes of the entries by rounding change by as much as it is."""
    weights = np.swapaxes(
        np.linalg.solve(np.swapaxes(matrices, 1, 2), np.repeat(C.T[None].astype(complex), len(rows), axis=0)), 1, 2
    )
    moved = np.abs(weights) @ (np.abs(matrices) @ np.abs(states) + np.abs(B)) + terms
    values[rows] = np.where(np.abs(values[rows]) <= DIGITS * moved, 0.0, values[rows])


def _at(matrix: ComplexArray, B: Array, C: Array, D: Array) -> Any:
    try:
        return D + C @ np.linalg.solve(matrix, B)
    except np.linalg.LinAlgError:
        return np.full(D.shape, np.inf + 0j)


def frequencies_between(poles: Any, low: float | None, high: float | None, points: int) -> Any:
    """Return a logarithmic grid with resonances on it, each with some points on its flanks."""
    moving = np.abs(poles)[np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)] / (2 * np.pi)
    if (low is None or high is None) and not len(moving):
        raise UsageError(
            "BR234", "nothing in the model says over which frequencies to look:", 'give a range (`--over "1 Hz .. 1 kHz"`)',
        )  # fmt: skip
    low = float(moving.min()) / 10 if low is None else low
    high = float(moving.max()) * 10 if high is None else high
    if not 2 <= points <= MOST_POINTS:
        raise UsageError("BR235", f"a response has from 2 to {MOST_POINTS} points; these are {points}")
    if not LOWEST <= low < high <= HIGHEST:
        raise UsageError(
            "BR236", f"frequencies run upwards from above zero, within {LOWEST:g} to {HIGHEST:g} Hz; not from {low:g} to {high:g} Hz",
        )  # fmt: skip
    near = [
        (abs(p.imag) + w * abs(p.real)) / (2 * math.pi) for p in poles if 0 < abs(p.real) < abs(p.imag) for w in BESIDE
    ]
    grid = np.geomspace(low, high, points)
    return np.unique([*grid, *(f for f in near if low < f < high)])


# ---------------------------------------------------------------- measured


@dataclass(frozen=True, slots=True)
class Measured:
    """Result of a harmonic excitation: the first harmonic of an output over that of the input.

    `distortion`: the part that is neither mean nor first harmonic, relative to the first harmonic. `settling`: waiting time in s.
    """

    frequency: float
    value: complex
    distortion: float
    settling: float


def settling_time(linear: Linearization, given: str, seen: str, frequency: float) -> float:
    """Return the time (s) until a transient has decayed to the fraction `LEFT` of the steady motion, from the modes that take part in it."""
    values, inverse, shapes = left_shapes(linear.A)
    i, j = linear.outputs.index(seen), linear.inputs.index(given)
    steady = abs(transfer(linear, np.array([2j * np.pi * frequency]))[0, i, j])
    parts = np.abs((linear.C[i] @ shapes) * (inverse.conj().T @ linear.B[:, j]) / (2j * np.pi * frequency - values))
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(parts > LEFT * steady, np.log(parts / (LEFT * steady)) / -values.real, 0.0)
    if not np.isfinite(times).all() or (times < 0).any():
        raise UsageError("BR237", f"`{seen}` never settles under a harmonic `{given}`: a mode that takes part in it is not damped")  # fmt: skip
    return float(times.max(initial=0.0))


def first_harmonic(time: Array, values: Array, frequency: float) -> tuple[complex, float]:
    """Return the complex amplitude a of Im(a exp(i w t)) and the share of the other motion; least squares over whole periods."""
    angle = 2 * np.pi * frequency * time
    basis = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    size = math.hypot(found[0], found[1])
    rest = float(np.sqrt(2 * np.mean((values - basis @ found) ** 2)))
    return complex(found[0], found[1]), rest / size if size else math.inf
