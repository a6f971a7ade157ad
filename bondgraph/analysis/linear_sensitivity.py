"""Sensitivity of the linear model at equilibrium, and of its frequency response, to parameters: second derivatives, no differences.

The compiled equations give the derivatives of rates, of loop residuals and of outputs by states, unknowns and inputs as one matrix W. Along the
common change of a parameter, states and unknowns it changes by dW, which a tape computes. With M = s diag(1 .. 1, 0 .. 0) - W of states and
unknowns the response is y = Y v + Y_u, M v = W_u, and its derivative is (Y M^-1 dW_rates + dW_outputs) (v, 1): one solution forwards and one
backwards for all parameters. Loop joints need nothing more, as rates satisfy the constraints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray

from ..errors import RunFailed, UsageError
from ..rendering import Summarised
from ..results.json_values import as_json, head, named, with_units
from .linear import Linearization, linearization
from .operating_point import OperatingPoint
from .response import Response, response
from .sensitivity import Sensitivity, directions_of, place_in, rest_moves

SCHEMA = "bondgraph-response-sensitivity/1"
ON = 1e-9  # relative distance at which an end of the range lies on an undamped mode


@dataclass(frozen=True, eq=False, repr=False)
class ResponseSensitivity(Summarised):
    """Derivatives `slopes` (f, m, k, q) of `response.values` by `parameters` (q), with values `at`, in SI; `units` of the parameters."""

    response: Response
    parameters: tuple[str, ...]
    at: Array
    slopes: ComplexArray
    units: Mapping[str, str]

    def of(self, given: str, seen: str, parameter: str) -> ComplexArray:
        """Return the derivatives from an input to an output, (f,). Raises `UsageError`."""
        self.response.of(given, seen)  # raises for unknown names
        i, j = self.response.outputs.index(seen), self.response.inputs.index(given)
        return np.asarray(self.slopes[:, i, j, place_in(parameter, self.parameters)])

    @property
    def magnitude(self) -> Array:
        """Derivative of the magnitude, (f, m, k, q)."""
        values = self.response.values[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope: Array = (values.conj() * self.slopes).real / np.abs(values)
        return slope

    @property
    def phase(self) -> Array:
        """Derivative of the phase, in degrees, (f, m, k, q)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slope: Array = np.degrees((self.slopes / self.response.values[..., None]).imag)
        return slope

    @property
    def relative(self) -> Array:
        """Change of the magnitude in percent per percent of a parameter, (f, m, k, q); NaN where it is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.magnitude * self.at / self.response.magnitude[..., None]
        return np.where(np.isfinite(ratio), ratio, np.nan)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-response-sensitivity/1`.

        {schema, model, experiment, frequencies (Hz), parameters: {name: {value, unit}}, responses: [{input, output, values: [{re, im}], slopes:
        {parameter: [{re, im}]}, relative: {parameter: [number]}}]}.
        """
        told = self.response
        relative = self.relative
        responses = [
            {
                "input": given, "output": seen, "values": as_json(told.values[:, i, j]),
                "slopes": {p: as_json(self.slopes[:, i, j, q]) for q, p in enumerate(self.parameters)},
                "relative": {p: as_json(relative[:, i, j, q]) for q, p in enumerate(self.parameters)},
            }
            for j, given in enumerate(told.inputs)
            for i, seen in enumerate(told.outputs)
        ]  # fmt: skip
        parameters = with_units(named(self.parameters, self.at), self.units)
        frequencies = told.frequencies.tolist()
        return {**head(SCHEMA, told), "frequencies": frequencies, "parameters": parameters, "responses": responses}


class _Moving:
    """Matrix W and its changes: rows are rates, residuals, outputs; columns states, unknowns, inputs. The point's `by` has inputs and parameters."""

    def __init__(self, point: OperatingPoint, inputs: tuple[str, ...], parameters: tuple[str, ...]) -> None:
        self.point, self.inputs, self.parameters = point, inputs, parameters
        self.n, self.size = point.count, point.all
        space = point.compilation.state_space
        rows = (*(s.rate for s in space.states), *(u.residual for u in space.unknowns), *space.outputs.values())
        columns = [point.by.index(n) for n in inputs]
        by = [point.by.index(n) for n in parameters]
        if columns and np.any(point.reduced.following[:, columns]):
            raise UsageError(
                "BR210", "an input moves places of closing joints themselves: how its response moves with parameters is not told",
            )  # fmt: skip
        whole = linearization(point)
        self.linear: Linearization = replace(
            whole, inputs=inputs, B=whole.B[:, columns], D=whole.D[:, columns], u=whole.u[columns]
        )
        self.at, self.units = whole.u[by], whole.units
        self.chosen = [*range(self.size), *(self.size + c for c in columns)]
        self.W = point.slopes(rows)[:, self.chosen]
        slopes = point.slopes_of(rows)
        moved = rest_moves(point, replace(whole, inputs=parameters, B=whole.B[:, by]), by)
        _, changes = slopes.tape.slopes(point.lookup, directions_of(point, moved, parameters), len(parameters))
        self.dW = np.zeros((len(parameters), len(rows), self.size + len(point.by)))
        for row, column, change in zip(slopes.rows, slopes.columns, changes, strict=True):
            if change is not None:
                self.dW[:, row, column] += change
        self.dW = self.dW[:, :, self.chosen]


def linear_sensitivity(point: OperatingPoint, inputs: tuple[str, ...], parameters: tuple[str, ...]) -> Sensitivity:
    """Return derivatives of the entries of A, B, C and D that are not constantly zero: `A[state, state]`.

    Raises `UsageError` where loop joints tie coordinates.
    """
    if point.reduced.tied:
        raise UsageError(
            "BR211", "closing joints tie coordinates here: which of them A stands for is a choice; modes and responses have sensitivities of their own",
        )  # fmt: skip
    moving = _Moving(point, inputs, parameters)
    n, size, linear = moving.n, moving.size, moving.linear
    W, dW = moving.W, moving.dW
    kept = [*range(n), *range(size, len(moving.chosen))]  # states and inputs
    follow = -np.linalg.solve(W[n:size, n:size], W[n:size, kept]) if size > n else np.zeros((0, len(kept)))
    turned = dW[:, n:size][:, :, kept] + dW[:, n:size, n:size] @ follow
    followed = -np.linalg.solve(W[n:size, n:size], turned) if size > n else np.zeros((len(parameters), 0, len(kept)))
    rows = [*range(n), *range(size, len(W))]
    changes = dW[:, rows][:, :, kept] + dW[:, rows, n:size] @ follow + W[rows, n:size] @ followed
    values = np.block([[linear.A, linear.B], [linear.C, linear.D]])
    above: list[tuple[str, bool]] = [
        *((linear.units[s], True) for s in linear.states),
        *((linear.units[o], False) for o in linear.outputs),
    ]
    names: list[str] = []
    units = {p: moving.units[p] for p in parameters}
    places = [*zip(*np.nonzero((values != 0) | changes.any(axis=0)), strict=True)]
    for i, j in places:
        letter = ("A" if j < n else "B") if i < n else ("C" if j < n else "D")
        row, column = (*linear.states, *linear.outputs)[i], (*linear.states, *linear.inputs)[j]
        names.append(f"{letter}[{row}, {column}]")
        unit, a_second = above[i]
        units[names[-1]] = _ratio(unit, a_second, linear.units[column])
    slopes = np.array([changes[:, i, j] for i, j in places]).reshape(len(names), len(parameters))
    return Sensitivity(
        linear.model, linear.experiment, tuple(names), parameters, np.array([values[p] for p in places]), moving.at,
        slopes, units, (),
    )  # fmt: skip


def _ratio(above: str, a_second: bool, below: str) -> str:
    """Return the unit of an entry: of a state or output (of a state's rate: per second) over that of a state or input."""
    if above == below:
        return "1/s" if a_second else "1"
    found = above if not a_second else above.removesuffix("*s") if above.endswith("*s") else f"{above}/s"
    return found if below == "1" else f"{found}/({below})" if any(c in below for c in "*/") else f"{found}/{below}"


def response_sensitivity(
    point: OperatingPoint, inputs: tuple[str, ...], parameters: tuple[str, ...], low: float | None, high: float | None, points: int
) -> ResponseSensitivity:  # fmt: skip
    """Return derivatives of the frequency response from inputs to all outputs of the point, at `points` frequencies and resonances.

    Raises as `response`, and `RunFailed` on a pole.
    """
    moving = _Moving(point, inputs, parameters)
    found = response(moving.linear, low, high, points)
    for peak in (e.frequency for e in found.extrema if np.isinf(e.magnitude)):
        if peak in (found.frequencies[0], found.frequencies[-1]) or any(
            f is not None and abs(f - peak) <= ON * peak for f in (low, high)
        ):
            raise _without_bound(peak)
    slopes = np.empty((*found.values.shape, len(parameters)), dtype=complex)
    for number, frequency in enumerate(found.frequencies):
        slopes[number] = _moves(moving, 2j * np.pi * frequency)
    units = {p: moving.units[p] for p in parameters}
    return ResponseSensitivity(found, parameters, moving.at, slopes, units)


def _without_bound(frequency: float) -> RunFailed:
    return RunFailed("BR212", f"at {frequency:.6g} Hz an undamped mode answers without bound: its response does not move smoothly there")  # fmt: skip


def _moves(moving: _Moving, s: complex) -> Any:
    """Return the derivatives of the response at s, (m, k, q)."""
    size, k = moving.size, len(moving.inputs)
    matrix = -moving.W[:size, :size].astype(complex)
    matrix[np.arange(moving.n), np.arange(moving.n)] += s
    rows = 1 / np.maximum(np.abs(matrix).max(axis=1, initial=0.0), np.finfo(float).tiny)
    columns = 1 / np.maximum(np.abs(matrix * rows[:, None]).max(axis=0, initial=0.0), np.finfo(float).tiny)
    scaled = matrix * rows[:, None] * columns
    try:
        forwards = columns[:, None] * np.linalg.solve(scaled, rows[:, None] * moving.W[:size, size:])
        backwards = np.linalg.solve(scaled.T, columns[:, None] * moving.W[size:, :size].T).T * rows
    except np.linalg.LinAlgError as problem:
        raise _without_bound(abs(s) / (2 * np.pi)) from problem
    whole = np.concatenate([forwards, np.eye(k)])
    left = np.concatenate([backwards, np.eye(len(moving.W) - size)], axis=1)
    return np.einsum("mr,qrc,ck->mkq", left, moving.dW, whole)
