"""Runs as data for a page: reported outputs, and effort and flow of every bond and the poses of all bodies.

Plots get every instant in double precision. Data shown along a run get some hundred instants in single precision.
Arrays are text: little-endian in base64, which a browser turns into a typed array without reading digits.

The page rotates points that are fixed to bodies in the reference, as `diagram/mechanism_geometry.py` does for a picture, and draws them again at each instant.
A body has the shape that its text gives; one in space without a shape is seen as the box or cylinder that has its mass and inertia.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from compiler.api import Array, BondGraph, Compilation, MechanismNode, Scene, letters

from ...analysed_model import AnalysedModel
from ...results.result import Result
from ...simulation.repetition import simulate
from ...simulation.run_options import RunOptions, RunRequest
from ..diagram.body_shapes import BodyShape, solid_of
from ..diagram.mechanism_geometry import mechanisms_of, pose_parts, reference_of
from ..diagram.styles import FILLS
from ..diagram.vectors import number_of, numbers_of, quaternion
from ..text.tables import short, visible
from .bonds import BondColumns, bond_columns, powers

OUTPUTS = 24  # most curves of one run
POINTS = 2001  # most instants of a plot
COARSE = 0.03  # largest difference of energies by every second instant, relative to the largest
ROUNDING = 1e-6  # of what went to and fro
BETWEEN = 20  # most steps of the solver for an instant: else equal phases of a period may be all that is seen
MOST = 301  # instants kept of the data shown along a run, except plots


@dataclass(frozen=True)
class PageModel:
    """A model with the data that a page needs of every run."""

    model: AnalysedModel

    @cached_property
    def graph(self) -> BondGraph:
        """Graph of the whole text, as the diagram shows it."""
        return self._compilation.causal.graph

    @property
    def _compilation(self) -> Compilation:
        return self.model.compilation(Scene(self.model.model, None, free=frozenset({"*"})))

    @cached_property
    def bonds(self) -> BondColumns:
        return bond_columns(self.graph, self._compilation.whole_graph)

    @cached_property
    def scenes(self) -> Scenes:
        return scenes_of(self.graph)

    @cached_property
    def powers(self) -> tuple[tuple[str, str, tuple[tuple[int, float], ...]], ...]:
        return tuple(powers(self.graph))

    def outputs(self, experiment: str | None) -> tuple[str, ...]:
        """Return the plotted names: those that the experiment reports, else the outputs of the model."""
        compilation = self.model.compilation(self.model.scene(experiment))
        return tuple(compilation.whole_graph.outputs)[:OUTPUTS]

    def names(self, experiment: str | None) -> tuple[str, ...]:
        """Return the names that a run must report."""
        return tuple(dict.fromkeys([*self.outputs(experiment), *self.bonds.names, *self.scenes.names]))

    def simulate(
        self, experiment: str | None, settings: Mapping[str, str | float] | None = None, energy: bool = False, error: bool = False
    ) -> Result:  # fmt: skip
        """Run an experiment. Raises as `Model.simulate`."""
        options = RunOptions(energy=energy, error=error)
        return simulate(self.model, RunRequest(experiment, settings or {}, self.names(experiment), options))


def run_data(watched: PageModel, experiment: str | None, result: Result) -> dict[str, Any]:
    outputs = set(watched.outputs(experiment))
    shown = [(item, values) for item, values in result.shown() if item.name in outputs]
    plotted = thinned(len(result.time), POINTS)
    return {
        "time": packed(result.time[plotted], single=False),
        "outputs": [{"name": short(i.name), "unit": "" if i.unit == "1" else visible(i.unit)} for i, _ in shown],
        "values": packed([v[plotted] for _, v in shown], single=False),
        "along": _along(watched, result),
        "steps": int(result.steps),
        "events": [float(e.time) for e in result.events[:200]],
        "notes": [visible(str(n)) for n in (*result.warnings, *result.notes)][:40],
    }  # fmt: skip


def _along(watched: PageModel, result: Result) -> dict[str, Any]:
    """Return the data of diagram and mechanisms at a selection of instants."""
    kept = thinned(len(result.time))
    columns = watched.bonds.values(result.to_numpy(), len(result.time))
    return {
        "time": packed(result.time[kept], single=False),
        "bonds": packed(columns[:, kept]),
        "poses": packed([result[name][kept] for name in watched.scenes.names], single=False),
        "energy": packed(shown_energies(watched, result, columns)[:, kept]),
    }


def shown_energies(watched: PageModel, result: Result, columns: Array) -> Array:
    """Return the energies of a run; NaN, which is not shown, where its instants are too few for the trapezoidal rule."""
    fine, coarse = (_integrals(watched, result.time[::n], columns[:, ::n]) for n in (1, 2))
    apart = np.abs(coarse[:3, -1] - fine[:3, ::2][:, -1]).max()
    least = COARSE * np.abs(fine[:3]).max() + ROUNDING * fine[3, -1]
    between = result.steps > BETWEEN * len(result.time)
    return np.full_like(fine[:3], np.nan) if between or apart > least else fine[:3]


def energies(watched: PageModel, time: Array, columns: Array) -> Array:
    """Return supplied, dissipated and stored energy since the start of a run, shape (3, instants), in J: powers by the trapezoidal rule."""
    return _integrals(watched, time, columns)[:3]


def _integrals(watched: PageModel, time: Array, columns: Array) -> Array:
    """Return the energies, and what went to and fro in all."""
    sums = np.zeros((4, len(time)))
    for _, kind, around in watched.powers:
        into = power_into(watched, columns, around)
        if into is not None:
            supplied, lost = kind in letters("source"), kind in letters("loss")
            place, sign = (0, -1.0) if supplied else (1 if lost else 2, 1.0)
            if kind not in letters("transducer"):
                sums[place] += sign * into
            sums[3] += np.abs(into)
    steps = np.diff(time) * (sums[:, 1:] + sums[:, :-1]) / 2
    return np.concatenate([np.zeros((4, 1)), np.cumsum(steps, axis=1)], axis=1)


def power_into(watched: PageModel, columns: Array, around: Sequence[tuple[int, float]]) -> Any:
    """Return the power that some bonds bring; None where one of them is not known."""
    total: Any = 0.0
    for bond, sign in around:
        effort, flow = watched.bonds.places[bond]
        if effort is None or flow is None:
            return None
        total = total + sign * columns[effort] * columns[flow]
    return total


def packed(values: Any, single: bool = True) -> dict[str, str]:
    """Return `{"f4": …}` or `{"f8": …}`: all numbers, rows one after the other. Values that are not finite are NaN."""
    kind = "<f4" if single else "<f8"
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(values, dtype=kind)
    array = np.where(np.isfinite(array), array, np.nan).astype(kind)
    return {kind[1:]: b64encode(array.tobytes()).decode("ascii")}


def thinned(count: int, most: int = MOST) -> Any:
    """Return the indices of at most `most` of `count` instants, with both ends."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(int)) if count else []


@dataclass(frozen=True, slots=True)
class Scenes:
    """Mechanisms of a page: `told` has their data; `names` has the poses, body by body in the order of the data."""

    told: tuple[dict[str, Any], ...]
    names: tuple[str, ...]


def scenes_of(graph: BondGraph) -> Scenes:
    """Return all mechanisms of a model."""
    scenes: list[dict[str, Any]] = []
    names: list[str] = []
    for node in mechanisms_of(graph):
        if node.mechanism.bodies:
            scenes.append({**_scene(graph, node), "first": len(names)})
            names += pose_parts(node)
    return Scenes(tuple(scenes), tuple(names))


def _scene(graph: BondGraph, node: MechanismNode) -> dict[str, Any]:
    """Return the data of a mechanism: bodies and joints by number, -1 is the ground; points in m in world axes."""
    mechanism = reference_of(graph, node)
    numbers = {body.name: number for number, body in enumerate(mechanism.bodies)}
    bodies = [
        {
            "name": b.name,
            "at": b.place,
            "centre": b.centre,
            "points": b.points,
            "outlines": b.outlines,
            "turn": quaternion(b.turn),
            "heavy": number_of(graph, own.mass) > 0,
            "solid": _solid(b.shape or (None if mechanism.planar else solid_of(graph, own))),
            "given": b.shape is not None,
            "colour": FILLS.get(b.colour),
        }
        for b, own in zip(mechanism.bodies, node.mechanism.bodies, strict=True)
    ]
    links = [
        {
            "name": j.name, "kind": j.kind, "axis": j.axis, "axis_of": numbers.get(j.axis_of, -1),
            "ends": [{"body": numbers.get(body, -1), "at": point} for body, point in j.ends],
            "grounded": j.grounded, "sprung": j.sprung,
        }
        for j in mechanism.joints
    ]  # fmt: skip
    marks = [{"name": name, "body": numbers.get(body, -1), "at": point} for name, body, point in mechanism.frames]
    return {
        "name": mechanism.name, "planar": mechanism.planar, "bodies": bodies, "links": links, "marks": marks,
        "up": _up(graph, node), "floor": not mechanism.planar or _weight(graph, node)[1] < 0,
    }  # fmt: skip


def _solid(shape: BodyShape | None) -> dict[str, Any] | None:
    return None if shape is None else {"round": shape.around, "axes": shape.axes}


def _up(graph: BondGraph, node: MechanismNode) -> Sequence[float]:
    """Return the direction that a picture has upwards: in space against gravity, else z; in the plane y."""
    if node.mechanism.planar:
        return 0.0, 1.0, 0.0
    weight = _weight(graph, node)
    size = math.hypot(*weight)
    return [-w / size for w in weight] if 0 < size < math.inf else (0.0, 0.0, 1.0)


def _weight(graph: BondGraph, node: MechanismNode) -> Sequence[float]:
    return numbers_of(graph, node.mechanism.gravity)
