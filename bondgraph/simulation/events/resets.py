"""Resets: new values that events give to stored quantities, discrete variables and computed quantities at an instant."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, EventNote, SettingNote

from ...errors import RunFailed
from ..initialization.initial_equations import fulfil
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
    free = np.ones(indicators.count, dtype=bool)
    for _, setting, value in resets:
        if setting.kind == "mode":
            mode[setting.position] = value
        elif setting.kind == "state":
            state[setting.position], free[setting.position] = value, False
    now = HybridState(at.time, state, mode)
    computed = [(s, value) for _, s, value in resets if s.kind == "computed"]
    return _followed(indicators, now, computed, free) if computed else now


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


def _followed(indicators: EventIndicators, at: HybridState, computed: Sequence[tuple[SettingNote, float]], free: BoolArray) -> HybridState:  # fmt: skip
    """Return the states after the least change that gives computed quantities the values that events set."""
    count, places, required = indicators.count, [s.position for s, _ in computed], np.array([v for _, v in computed])

    def missed(x: Array) -> Any:
        full = indicators.loops.solve(at.time, np.concatenate([x, at.state[count:]]), at.mode)
        targets = indicators.hybrid.targets(at.time, full, indicators.inputs, indicators.constants, at.mode)
        return targets[places] - required

    before = missed(at.state[:count])
    x = fulfil(missed, at.state[:count], free)
    rest = np.abs(missed(x))
    size = np.maximum(np.abs(required), np.abs(before))
    bad = [s for (s, _), r, most in zip(computed, rest, size, strict=True) if not r <= CLOSE * max(most, 1e-300)]
    if bad:
        names = ", ".join(f"`{s.words}` ({s.span.file_and_line})" for s in bad)
        raise RunFailed(
            "BR775", f"at t = {at.time:.9g} s events cannot set {names}: the model ties it to what stays as it is"
        )
    return HybridState(at.time, np.concatenate([x, at.state[count:]]), at.mode)


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
