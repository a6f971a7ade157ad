"""Paths of outputs: expressions of time in the language, with all derivatives that an inverse needs.

Derivatives are those of the expression's power series in time, no differences. Before a path begins it rests at its first value, unless it is
declared to begin in motion; so a path that starts too suddenly has a jump at its first instant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler import api
from compiler.api import Array, Leaf, TaylorSeries

from ...compiled_model import CompiledModel
from ...errors import UsageError
from ...simulation.segments.timeline import Segment, segments

BESIDE = 1e-9  # fraction of the path's length: distance from an instant at which both sides are compared
DEGREE = 9  # degree of a curve through points
JUMP = 1e-5  # relative to the largest value of a derivative: least jump beyond rounding
ORDINALS = ("value", "first derivative", "second derivative", "third derivative", "fourth derivative")


@dataclass(frozen=True, slots=True)
class Jump:
    """Jump of a derivative of a path (order 0: the value itself), in SI."""

    output: str
    order: int
    time: float
    before: float
    after: float

    def __str__(self) -> str:
        word = ORDINALS[self.order] if self.order < len(ORDINALS) else f"derivative of order {self.order}"
        return (
            f"the {word} of `{self.output}` jumps at t = {self.time:.6g} s from {self.before:.6g} to {self.after:.6g}"
        )


class Path:
    """Functions `derivatives(times, order)` of all outputs over [start, stop], and their jumps. `samples`: those given by points instead of a text."""

    def __init__(
        self, names: Sequence[str], model: CompiledModel, start: float, stop: float, samples: Mapping[str, Any] | None = None
    ) -> None:  # fmt: skip
        made = model.compiled_scene(model.scene(None), True, "numpy")
        program, lowered = made.program, made.compilation.lowered
        self.names, self.start, self.stop = tuple(names), start, stop
        self._parameters = np.array(program.defaults, dtype=float)
        with np.errstate(all="ignore"):
            self.stretches: list[Segment] = segments(program, program.constants(self._parameters), start, stop)
        self._series = TaylorSeries(list(lowered.outputs.values()), frozenset({"time"}))
        self._samples = {self.names.index(n): curve for n, curve in (samples or {}).items()}

    @property
    def first(self) -> dict[str, float]:
        """Values at the beginning."""
        return self._at(self.start)

    @property
    def last(self) -> dict[str, float]:
        """Values at the end."""
        return self._at(self.stop)

    def _at(self, time: float) -> dict[str, float]:
        return dict(zip(self.names, self.derivatives(np.array([time]), 0)[:, 0, 0].tolist(), strict=True))

    def derivatives(self, times: Array, order: int) -> Any:
        """Return derivatives (outputs, order + 1, instants), in SI. Raises `UsageError` where there is none."""
        times = np.asarray(times, dtype=float)
        values = np.zeros((len(self.names), order + 1, len(times)))
        owner = np.searchsorted([s.start for s in self.stretches], times, side="right") - 1
        for number in np.unique(np.clip(owner, 0, None)):
            here = np.flatnonzero(np.clip(owner, 0, None) == number)
            values[:, :, here] = self._derivatives(times[here], order, self.stretches[number].mode)
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            output, k, at = bad[0]
            what = "value" if k == 0 else f"derivative of order {k}"
            raise UsageError("BR318", f"what is wanted of `{self.names[output]}` has no {what} at t = {times[at]:.6g} s")  # fmt: skip
        return values

    def _derivatives(self, times: Array, order: int, mode: Array) -> Any:
        given = {Leaf("time", 0): times[None]}
        given |= {Leaf("parameter", i): np.array([[v]]) for i, v in enumerate(self._parameters)}
        given |= {Leaf("mode", i): np.array([[v]]) for i, v in enumerate(np.atleast_1d(mode))}
        expansion = self._series.expand(given)
        found = np.zeros((len(self.names), order + 1, len(times)))
        for k in range(order + 1):
            if k:
                expansion.advance({Leaf("time", 0): np.ones((1, 1)) if k == 1 else None})
            for row in range(len(self.names)):
                coefficient = expansion[row]
                if coefficient is not None:
                    found[row, k] = math.factorial(k) * coefficient[0]
        for row, curve in self._samples.items():
            found[row] = [curve(times, k) for k in range(order + 1)]
        return found

    def jumps(self, orders: Sequence[int], moving: bool) -> list[Jump]:
        """Return the jumps of each output's derivatives up to an order; for each instant the lowest order."""
        highest = max(orders)
        sizes = np.abs(self.derivatives(np.linspace(self.start, self.stop, 257), highest)).max(axis=2)
        step = BESIDE * (self.stop - self.start)
        found: list[Jump] = []
        for number, stretch in enumerate(self.stretches):
            after = self._derivatives(np.array([stretch.start + step]), highest, stretch.mode)[:, :, 0]
            if number:
                earlier = self.stretches[number - 1]
                before = self._derivatives(np.array([earlier.stop - step]), highest, earlier.mode)[:, :, 0]
            else:
                before = np.zeros_like(after)
                before[:, 0] = after[:, 0]
                if moving:
                    continue
            for row, name in enumerate(self.names):
                for k in range(orders[row] + 1):
                    allowed = JUMP * max(sizes[row, k], 1e-300)
                    if abs(after[row, k] - before[row, k]) > allowed:
                        found.append(Jump(name, k, stretch.start, float(before[row, k]), float(after[row, k])))
                        break
        return found


def curve_through(points: Any, name: str, start: float, stop: float) -> Any:
    """Return a spline of degree 9 through (times, values), with eight continuous derivatives; at rest, to the fourth, at both ends.

    It is called with times and an order. Raises `UsageError`.
    """
    from scipy.interpolate import make_interp_spline

    times, values = (np.asarray(x, dtype=float) for x in points)
    if times.ndim != 1 or times.shape != values.shape or len(times) < 2 or not (np.diff(times) > 0).all():
        raise UsageError("BR319", f"what is wanted of `{name}` by points are rising times and as many values")
    if not np.isfinite(values).all():
        raise UsageError("BR320", f"what is wanted of `{name}` by points are finite numbers")
    if start < times[0] or stop > times[-1]:
        raise UsageError(
            "BR321", f"the path goes from {start:.6g} s to {stop:.6g} s, and what is wanted of `{name}` by points from {times[0]:.6g} s to {times[-1]:.6g} s",
        )  # fmt: skip
    still = [(k, 0.0) for k in range(1, (DEGREE + 1) // 2)]
    # unit of time: derivatives of order 9 in 1/s are too large for the system of a spline
    span = float(times[-1] - times[0])
    spline = make_interp_spline((times - times[0]) / span, values, k=DEGREE, bc_type=(still, still))
    return lambda at, k: spline((np.asarray(at) - times[0]) / span, k) / span**k


def is_plain(model: CompiledModel) -> bool:
    """Return True if the model has bare numbers without units."""
    return any(
        getattr(s, "plain", False) and getattr(s, "name", None) == model.name
        for s in model.compilation().tree.statements
    )


def path_of(model: CompiledModel, wanted: Mapping[str, Any], start: float, stop: float) -> Path:
    """Return the path of texts such as `8 um*smoothstep9(time, 0 s, 5 ms)`, numbers in SI, or points (times in s, values in SI).

    Tables of a text (`cubic(time, column("curve.csv", "t"), column("curve.csv", "x"))`) are files beside the model. Raises `UsageError`,
    `CompilationFailed`.
    """
    outputs = model.compilation(model.scene(None)).whole_graph.outputs
    unknown = [n for n in wanted if n not in outputs]
    if unknown or not wanted:
        raise UsageError("BR322", f"there is no output `{(*unknown, '')[0]}`; outputs are {', '.join(outputs) or 'none'}")  # fmt: skip
    lines, samples = [f"{'plain ' if is_plain(model) else ''}model Wanted {{"], {}
    for number, (name, value) in enumerate(wanted.items(), 1):
        unit = outputs[name].unit
        if not isinstance(value, str | float | int):
            samples[name], value = curve_through(value, name, start, stop), 0.0
        if isinstance(value, str):
            api.parse_expression(api.Source(f"what is wanted of {name}", value))
        text = value if isinstance(value, str) else f"{float(value)!r}{'' if unit == '1' else f' [{unit}]'}"
        lines.append(f"  output wanted_{number}{'' if unit == '1' else f': {unit}'} = {' '.join(text.split())}")
    text = "\n".join([*lines, "}"])
    source = api.Source("what is wanted", text, model.source.path)
    return Path(tuple(wanted), CompiledModel(source), start, stop, samples)
