"""Setpoints from a file: a CSV whose headings are outputs with units, `x [um],phi [deg]`, each line held at equilibrium; with `time [s]` a path.

A column of a parameter or input is a setting of its line. Lines that begin with `#` are ignored.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..analysed_model import AnalysedModel
from ..analysis.inversion.feed_forward import FeedForward
from ..analysis.outcome import Outcome, Point
from ..errors import UsageError
from ..simulation.settings import Settings
from .experiment import made
from .measured import OF_MODES, SIGMA, check_complete, check_path, read_columns
from .workers import ALONE, Workers


@dataclass(frozen=True, slots=True)
class SetpointStudy:
    """Request at each line: the inputs that hold its outputs."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    experiment: str | None
    settings: tuple[tuple[str, str | float], ...]

    def answer(self, model: AnalysedModel, point: Mapping[str, float]) -> Point:
        """Return the point of one line."""
        wanted = {n: point[n] for n in self.outputs}
        given = {**dict(self.settings), **{n: v for n, v in point.items() if n not in wanted}}
        return Point(point, analyses=(("invert", model.invert(wanted, self.inputs, self.experiment, given)),))


def invert_file(
    model: AnalysedModel, file: str | os.PathLike[str], inputs: Sequence[str], experiment: str | None, settings: Settings, along: Mapping[str, Any],
    workers: Workers | None = None,
) -> Outcome | FeedForward:  # fmt: skip
    """Return a table of inputs by lines, or inputs over time. `along`: as for `Model.invert` along a path. Raises as that, and OSError."""
    name = os.fspath(file)
    compilation = model.compilation(model.scene(experiment, settings))
    graph = compilation.whole_graph
    settable = {n: q for n, q in graph.quantities.items() if q.role in ("parameter", "input")}
    outputs = model.compilation(model.scene(None)).whole_graph.outputs
    quantities = {**settable, **outputs}
    columns = read_columns(name, {n: q.kind for n, q in quantities.items()})
    wanted = _checked(name, columns, outputs, settable, settings, inputs)
    held = SetpointStudy(tuple(inputs), wanted, experiment, tuple(settings.items()))
    if "time" in columns:
        return _along(model, name, columns, held, along)
    asked_for = [w for w in ("to", "start", "moving", "limits") if along.get(w)]
    if asked_for:
        raise UsageError(
            "BR451", f"{name}: without a column `time [s]` each line is held at rest: there is no path to go along"
        )
    points = [dict(zip(columns, map(float, row), strict=True)) for row in np.array(list(columns.values())).T]
    found = made(model, held, points, workers or ALONE)
    shown = {r.name: (r.unit, r.scale, r.offset) for r in compilation.plan.report}
    swept = {n: quantities[n].unit for n in columns}
    return Outcome(
        graph.name, compilation.plan.experiment, swept, found, {n: s for n, s in shown.items() if n in swept}
    )


def _checked(
    file: str, columns: Mapping[str, Any], outputs: Collection[str], settable: Collection[str], settings: Settings, inputs: Sequence[str],
) -> tuple[str, ...]:  # fmt: skip
    """Return the outputs of the setpoints. Raises `UsageError` for columns that are no setpoints."""
    sought = {n.strip() for pair in inputs for n in pair.split("/")}
    for name, values in columns.items():
        if name.startswith(SIGMA) or OF_MODES.fullmatch(name):
            raise UsageError(
                "BR452", f"{file}: `{name}` is nothing that inputs could hold; columns are outputs, `time [s]`, and what is set",
            )  # fmt: skip
        check_complete(file, name, values)
        if name in sought:
            raise UsageError("BR453", f"{file}: `{name}` is to be found, and set line by line:", "one of the two")
        if name in settings:
            raise UsageError("BR454", f"{file}: `{name}` is set for all, and line by line:", "one of the two")
    wanted = tuple(n for n in columns if n in outputs)
    if not wanted:
        raise UsageError(
            "BR455", f"{file}: there is no column of an output; outputs are {', '.join(outputs) or 'none'}"
        )
    if "time" in columns:
        check_path(file, columns["time"], [n for n in columns if n in settable and n not in outputs])
    return wanted


def _along(
    model: AnalysedModel, file: str, columns: Mapping[str, Any], held: SetpointStudy, along: Mapping[str, Any]
) -> FeedForward:
    time = columns["time"]
    if len(time) < 2:
        raise UsageError("BR456", f"{file}: a path has two instants or more")
    paths = {n: (time, columns[n]) for n in held.outputs}
    start, stop = along.get("start"), along.get("to")
    return model.invert(
        paths, held.inputs, held.experiment, dict(held.settings), to=float(time[-1]) if stop is None else stop,
        start=float(time[0]) if start is None else start, points=along.get("points") or 501, moving=bool(along.get("moving")), limits=along.get("limits") or {},
    )  # fmt: skip
