"""Resets: new values that events give to stored quantities, discrete variables and computed quantities at an instant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, EventNote, IntArray, SettingNote

from ...errors import RunFailed
from ...numerics.continuation import SolutionPath, follow
from ...numerics.scales import group_numbers, largest_of_group, nonzero
from ..initialization.initial_equations import fulfil, slopes_of
from ..segments.units import refused
from .indicators import EventIndicators, HybridState

CLOSE = 1e-9  # relative accuracy with which a reset value must hold

Reset = tuple[EventNote, SettingNote, float]  # an event, one of its settings and the value it gives


def reset(indicators: EventIndicators, at: HybridState, acting: Sequence[int]) -> HybridState:
    """Return the hybrid state after these events have acted, each with the values before them. Raises `RunFailed`."""
    if not acting:
        return at
    hybrid = indicators.hybrid
    values = hybrid.values(at.time, at.state, indicators.inputs, indicators.constants, at.mode).tolist()
    _exchange(indicators, at.time, acting, values)
    owned = ((number, event, setting) for number, event in enumerate(hybrid.events) for setting in event.settings)
    resets = [(e, s, value) for (number, e, s), value in zip(owned, values, strict=True) if number in acting]
    _check(at.time, resets)
    state, mode = np.array(at.state), at.mode.copy()
    settings = [(s, value) for _, s, value in resets if s.kind != "mode"]
    for _, setting, value in resets:
        if setting.kind == "mode":
            mode[setting.position] = value
    coordinates = {*indicators.constraints.positions.tolist(), *indicators.constraints.speeds.tolist()}
    if any(s.kind == "computed" or s.position in coordinates for s, _ in settings):
        return _followed(indicators, HybridState(at.time, state, mode), settings)
    state[[s.position for s, _ in settings]] = [value for _, value in settings]
    return HybridState(at.time, state, mode)


def _exchange(indicators: EventIndicators, time: float, acting: Sequence[int], values: list[float]) -> None:
    """Put what imported units give into the values of the settings of their events. Raises `RunFailed`."""
    first = 0
    for number, event in enumerate(indicators.hybrid.events):
        here, first = first, first + len(event.settings)
        if event.span.unit is None or number not in acting:
            continue
        if indicators.units is None:
            raise refused(event)
        names = [setting.words for setting in event.settings]
        settings = dict(zip(names, values[here:first], strict=True))
        settings = indicators.units.units[number].exchange(time, settings)
        values[here:first] = [settings[name] for name in names]


def _followed(
    indicators: EventIndicators, at: HybridState, settings: Sequence[tuple[SettingNote, float]]
) -> HybridState:
    """Return the states after the least change with which loops stay closed and all quantities have the values that events set.

    `at`: before the instant. First poses follow, from where they are along those that are set, then all else: what has a rate moves no pose.
    """
    count, constraints, hybrid = indicators.count, indicators.constraints, indicators.hybrid
    states = [s.position for s, _ in settings if s.kind == "state"]
    places = [s.position for s, _ in settings if s.kind == "computed"]
    ordered = sorted(settings, key=lambda each: each[0].kind == "computed")
    required = np.array([value for _, value in ordered])
    poses = np.zeros(count, dtype=bool)
    poses[[*hybrid.poses, *constraints.positions]] = True
    closed = np.concatenate([np.flatnonzero(constraints.taking_gaps), constraints.gaps + constraints.taking_rates])

    def whole(x: Array) -> Any:
        return np.concatenate([x, at.state[count:]])

    def values(x: Array) -> Any:
        """Return the quantities that events set, then the residuals of loops."""
        parts = [x[states]]
        if places:
            full = indicators.loops.solve(at.time, whole(x), at.mode)
            parts.append(hybrid.targets(at.time, full, indicators.inputs, indicators.constants, at.mode)[places])
        if len(closed):
            parts.append(constraints.values(at.time, whole(x), at.mode)[closed])
        return np.concatenate(parts)

    wanted = np.concatenate([required, np.zeros(len(closed))])
    x = np.array(at.state[:count])
    before = values(x)[: len(settings)]
    moving = np.ones(len(wanted), dtype=bool)
    if poses.any():
        moving = slopes_of(values, x, ~poses, nonzero(np.maximum(np.abs(x), constraints.reach))[~poses]).any(axis=1)
    # coordinates of one unit change by the same measure, as do rates: a turn in space has no axes of its own
    sizes = largest_of_group(constraints.reach, group_numbers(indicators.program.states.units))
    rates = np.isin(np.arange(count), constraints.speeds)
    sizes[~(np.isin(np.arange(count), constraints.positions) | rates)] = 0.0
    free = np.ones(count, dtype=bool)
    free[states] = False
    before_set, x[states] = x.copy(), required[: len(states)]
    if constraints and poses[states].any() | (~moving[len(states) : len(settings)]).any():
        x = _posed(lambda y: (values(y) - wanted)[~moving], before_set, x, np.flatnonzero(poses), nonzero(sizes)[poses])
    # at rest they have no magnitude but that of what is set
    sizes[rates] = np.maximum(sizes[rates], np.abs(values(x) - wanted)[moving].max(initial=0.0))
    for movable, rows in ((poses, ~moving), (~poses, moving)):
        x = fulfil(lambda y, rows=rows: (values(y) - wanted)[rows], x, free & movable, sizes)  # type: ignore[misc]
    full = constraints.project(at.time, whole(x), at.mode)
    here = values(full[:count])[: len(settings)]
    most = np.maximum(np.maximum(np.abs(required), np.abs(before)), 1e-300)
    bad = np.flatnonzero(~(np.abs(here - required) <= CLOSE * most))
    if len(bad):
        names = ", ".join(f"`{s.words}` ({s.span.file_and_line})" for s in (ordered[i][0] for i in bad))
        raise RunFailed(
            "BR775", f"at t = {at.time:.9g} s events cannot set {names}: the model ties it to what stays as it is"
        )
    return HybridState(at.time, full, at.mode)


@dataclass(frozen=True, slots=True)
class _Poses:
    """Quantities that events set and residuals of loops, in units of `bound`, as functions of the coordinates in units of `size`."""

    function: Callable[[Any], Any]
    state: Array
    places: IntArray
    size: Array
    bound: Array | float = 1.0

    def values(self, z: Array) -> Any:
        return self.function(self.whole(z)) / self.bound

    def slopes(self, z: Array) -> Any:
        movable = np.isin(np.arange(len(self.state)), self.places)
        return ((slopes_of(self.function, self.whole(z), movable, self.size) * self.size).T / self.bound).T

    def whole(self, z: Array) -> Any:
        """Return all states."""
        state = self.state.copy()
        state[self.places] = z * self.size
        return state


def _posed(missed: Callable[[Any], Any], begin: Array, end: Array, places: IntArray, size: Array) -> Any:
    """Return the states with a pose in which nothing is missed: what is set as it is, if that closes, else the end of the path from the pose before."""
    rows = _Poses(missed, end, places, size)
    z = begin[places] / size
    bound = nonzero(np.abs(rows.slopes(z)).max(axis=1, initial=0.0))
    if (np.abs(missed(end)) <= CLOSE * bound).all():
        return end
    rows = replace(rows, bound=bound)
    opened = rows.values(z)
    path = follow(rows, z, SolutionPath(lambda share: (1.0 - share) * opened, lambda _: -opened))
    return rows.whole(path.z) if path.arrived else begin  # then it is refused


def _check(time: float, resets: Iterable[Reset]) -> None:
    """Raise `RunFailed` if a reset value is not finite, or if a quantity is reset twice."""
    owners: dict[tuple[str, int], tuple[int, EventNote]] = {}
    for number, (event, setting, value) in enumerate(resets):
        if not math.isfinite(value):
            raise RunFailed(
                "BR776", f"at t = {time:.9g} s the new value of `{setting.words}` ({setting.span.file_and_line}) is not finite",
            )  # fmt: skip
        first, other = owners.setdefault((setting.kind, setting.position), (number, event))
        if first != number:
            raise RunFailed(
                "BR777", f"at t = {time:.9g} s {listed_events((other, event))} set `{setting.words}` at one instant;",
                "make one event of them, or let one of them ask that the other does not hold",
            )  # fmt: skip


def listed_events(events: Iterable[EventNote]) -> str:
    """Return events and their lines as words."""
    return " and ".join(dict.fromkeys(f"`{e}` ({e.span.file_and_line})" for e in events))
