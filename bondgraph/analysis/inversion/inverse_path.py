"""Inputs that move outputs along a path: check of the path, equilibria at its ends, solution of the equations in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray

from ...compiled_model import CompiledModel
from ...errors import RunFailed, UsageError
from ...keywords import AnalysisRequest
from ...numerics.scales import group_numbers, largest_of_group
from ...quantities import behind
from ...simulation.segments.timeline import segments
from ..equilibrium import units_of
from ..operating_point import OperatingPoint
from ..placement import operating_point
from .equations import Drive, InversionEquations, drives_of
from .feed_forward import NEAR, FeedForward, within_limits
from .motion import Ends, Motion, motion
from .path import Path, is_plain, path_of
from .static import Search, held_at, rest_with

MOST_POINTS = 200_000
SCHEME = "smoothstep9"
SHOWN = 4  # most eigenvalues in a note
HELD = 1e-6  # relative to the largest of its unit: distance of a start from rest


@dataclass(frozen=True, slots=True)
class PathRequest:
    """Request for inputs with which outputs of a model follow their targets from `start` to `stop` (s), at `points` instants.

    `asked`: experiment and settings. `moving`: the model need not be at rest at the beginning. `limits`: largest absolute values, in SI.
    """

    model: CompiledModel
    targets: Mapping[str, Any]
    asked: AnalysisRequest
    start: float
    stop: float
    points: int
    moving: bool
    limits: Mapping[str, float]


def invert_path(request: PathRequest, inputs: Sequence[str]) -> FeedForward:
    """Return the inputs over time. Raises `UsageError` for impossible requests or paths that are not smooth enough, `RunFailed`, `CompilationFailed`."""
    if not request.stop > request.start or not 2 <= request.points <= MOST_POINTS:
        raise UsageError("BR301", f"a path goes from one instant to a later one, at 2 to {MOST_POINTS} points")
    path = path_of(request.model, request.targets, request.start, request.stop)
    drives = drives_of(inputs)
    if len(drives) != len(path.names):
        raise UsageError("BR302", f"{len(path.names)} outputs want as many inputs or pairs `push/pull`; there are {len(drives)}")  # fmt: skip
    names = tuple(n for d in drives for n in (d.push, d.pull) if n is not None)
    asked = replace(request.asked, outputs=path.names, by=names, time=request.start)
    if request.moving:
        point = operating_point(request.model, replace(asked, state="start"))
        search = Search(point, [point.program.outputs.names.index(n) for n in path.names], drives)
    else:
        search = held_at(request.model, asked, path.first, drives)
    _refuse_jumps(search.point, request)
    equations = InversionEquations(search.point, path.names, search.drives)
    notes = _smooth_enough(path, equations, request)
    times = np.linspace(request.start, request.stop, request.points)
    degree = max(equations.degrees)
    found = motion(equations, times, lambda t: path.derivatives(t, degree), _ends(search, path, equations, request))
    return _feed_forward(request, search, equations, path, found, notes)


def _refuse_jumps(point: OperatingPoint, request: PathRequest) -> None:
    """Raise an error if the model itself changes on the way."""
    with np.errstate(all="ignore"):
        stretches = segments(point.program, point.constants, request.start, request.stop)
    for before, after in pairwise(stretches):
        if (np.asarray(before.mode) != np.asarray(after.mode)).any():
            raise UsageError(
                "BR303", f"something in the model itself jumps at t = {after.start:.6g} s:", "invert it before and after that",
            )  # fmt: skip


def _smooth_enough(path: Path, equations: InversionEquations, request: PathRequest) -> list[str]:
    """Return notes on jumps of the path. Raises `UsageError` where an inverse would need impulses."""
    notes = []
    for jump in path.jumps(equations.degrees, request.moving):
        degree = equations.degrees[path.names.index(jump.output)]
        if jump.order < degree:
            way = ", or say that the model begins in motion" if jump.time == path.start else ""
            raise UsageError(
                "BR304",
                f"{jump}: an exact inverse takes {degree} derivatives of `{jump.output}`, all but the last continuous, as its inputs show in no lower one.",
                f"Let it go by `{SCHEME}`{way}",
            )
        notes.append(f"{jump}, and the inputs with it: a table of them is not exact there")
    return notes


def _ends(search: Search, path: Path, equations: InversionEquations, request: PathRequest) -> Ends:
    first = np.concatenate([search.point.state, search.strengths])
    if not equations.free:
        return Ends(first, None)
    end = path.derivatives(np.array([request.stop]), max(equations.degrees))[:, 1:, 0]
    largest = np.abs(path.derivatives(np.linspace(request.start, request.stop, 65), max(equations.degrees)))[:, 1:].max(
        axis=2
    )
    if (np.abs(end) > HELD * largest).any():
        return Ends(first, None)
    try:
        last = rest_with(search.point, path.last, search.drives)
    except RunFailed:
        return Ends(first, None)
    return Ends(first, np.concatenate([last.point.state, last.strengths]))


def _feed_forward(
    request: PathRequest, search: Search, equations: InversionEquations, path: Path, found: Motion, notes: list[str]
) -> FeedForward:
    point, program = search.point, search.point.program
    n, size, times, drives = equations.count, equations.all, found.times, search.drives
    units, strengths = units_of(point), found.unknowns[size:]
    inputs = _inputs(drives, strengths)
    within_limits(inputs, times, request.limits, units)
    notes += _left(point, found.unknowns[:size], times, inputs)
    start, begins = _start(point, found.unknowns[:n, 0]), point.program.name
    if len(found.internal):
        notes += _inside(found.internal, search, found.unknowns[:n, 0], units)
    settings = {k: _number(request, k, v) for k, v in (request.asked.settings or {}).items() if k not in inputs}
    return FeedForward(
        begins, point.made.plan.experiment, {n: v if isinstance(v, str) else _told_of(v) for n, v in request.targets.items()}, settings, times, inputs,
        dict(zip(path.names, path.derivatives(times, 0)[:, 0], strict=True)), dict(zip(program.states.names, found.unknowns[:n], strict=True)),
        {d.push if d.pull is None else f"{d.push}/{d.pull}": s for d, s in zip(drives, strengths, strict=True)}, tuple(drives),
        dict(zip(path.names, equations.degrees, strict=True)), tuple(complex(v) for v in found.internal), start, units, tuple(notes),
        request.model.source.path, is_plain(request.model), point.made.plan.report,
    )  # fmt: skip


def _told_of(value: Any) -> str:
    return repr(float(value)) if isinstance(value, float | int) else f"{len(value[0])} points"


def _number(request: PathRequest, name: str, value: str | float) -> float:
    if not isinstance(value, str):
        return float(value)
    model, asked = request.model, request.asked
    known = model.compilation(model.scene(asked.experiment, asked.settings)).whole_graph.quantities[name]
    if known.value is None:
        raise UsageError("BR305", f"`{name}` moves with time; a path is found with values that hold")
    return known.value


def _inputs(drives: Sequence[Drive], strengths: Array) -> dict[str, Any]:
    inputs: dict[str, Any] = {}
    for drive, strength in zip(drives, strengths, strict=True):
        size = np.sqrt(np.abs(strength)) if drive.power == 2 else np.abs(strength)
        if drive.pull is None:
            inputs[drive.push] = np.copysign(size, strength)
            continue
        inputs[drive.push] = np.where(strength >= 0, size, 0.0)
        inputs[drive.pull] = np.where(strength < 0, size, 0.0)
    return inputs


def _left(point: OperatingPoint, states: Array, times: Array, inputs: Mapping[str, Any]) -> list[str]:
    """Return notes on violated limits along the path. Raises `RunFailed` where a table ends, or a condition on states changes."""
    program, notes = point.program, []
    told: set[int] = set()
    for i, time in enumerate(times):
        here = point.inputs.copy()
        for name, values in inputs.items():
            role, place = point.set_at(name)
            if role == "input":
                here[place] = values[i]
        state = states[:, i]
        mode = np.asarray(program.mode_at(time, state, here, point.constants))
        if program.hybrid is not None and len(mode) and (mode != np.asarray(point.mode)).any():
            raise RunFailed("BR306", f"a condition on states changes before t = {time:.6g} s: the equations are others from there on")  # fmt: skip
        if not program.limits:
            continue
        holds = np.asarray(program.holds(time, state, here, point.constants, point.mode))
        for k in np.flatnonzero(holds == 0):
            limit = program.limits[k]
            if limit.kind == "table":
                raise RunFailed("BR307", f"at t = {time:.6g} s the path leads out of the table `{limit.words}` of `{limit.owner}`")  # fmt: skip
            if k not in told:
                told.add(int(k))
                notes.append(
                    f"from t = {time:.6g} s on `{limit.words}` does not hold{f' ({limit.text})' if limit.text else ''}"
                )
    return notes


def _start(point: OperatingPoint, states: Array) -> dict[str, float]:
    """Return the states in which the path begins, if they differ from those of the model."""
    program, n = point.program, point.count
    own = np.asarray(program.start(point.constants), dtype=float)[:n]
    largest = largest_of_group(np.maximum(np.abs(own), np.abs(states)), group_numbers(program.states.units))
    if (np.abs(states - own) <= NEAR * np.maximum(largest, point.sizes[:n])).all():
        return {}
    return point.stored(states)


def _inside(eigenvalues: Array | ComplexArray, search: Search, first: Array, units: Mapping[str, str]) -> list[str]:
    """Return notes on the internal dynamics."""
    kept, shown = int((eigenvalues == 0).sum()), [v for v in eigenvalues if v != 0]
    notes = []
    if shown:
        some = ", ".join(f"{v.real:.4g}" if v.imag == 0 else f"{v:.4g}" for v in shown[:SHOWN])
        more = f" and {len(shown) - SHOWN} more" if len(shown) > SHOWN else ""
        notes.append(
            f"the outputs leave {len(shown) + kept} coordinates to move by themselves, with eigenvalues {some}{more} in 1/s"
        )
    if eigenvalues.real.max() > 0:
        rest, names = search.point.state[: len(first)], search.point.program.states.names
        away = np.abs(first - rest)
        worst = int(away.argmax())
        notes.append(
            f"some of that grows, so the inputs begin before the outputs do: in the beginning `{names[worst]}` is {away[worst]:.3g}"
            f"{behind(units.get(names[worst], '1'))} from rest; a path that rests longer before it moves has less of that"
        )
    return notes
