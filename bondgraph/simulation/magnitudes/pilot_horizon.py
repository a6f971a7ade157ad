"""Pilot horizon: part of a coarse run whose magnitudes are reliable; steps much longer than a period make them wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...numerics.scales import largest_of_group
from ..integrators.pilot.schedule import unit_numbers
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from compiler.api import Array, Program

    from .pilot_run import PilotObserver

ASTRAY = 1e3  # factor on the magnitudes of the beginning above which the run is suspect
FAR = 2.0  # factor on steady growth up to which a part is accepted
PARTS, SHORTER = 6, 0.1  # number of parts of the run examined then, and ratio of their lengths
SLIGHT = 1e-4  # relative to the largest state of one unit: smaller magnitudes are ignored
LARGEST = 200  # most states for which parts of the run are examined


def trusted(
    look_along: Callable[[Sequence[Segment]], PilotObserver], program: Program, stretches: Sequence[Segment], driven: bool
) -> PilotObserver:  # fmt: skip
    """Return a coarse run over the segments, or over their beginning only. `driven`: some input depends on time.

    A motion without drive swings about as far as its forces take it at first, or grows gradually; then its tolerances grow with it. Where states
    get much farther, they must do so proportionally on a tenth, a hundredth … of the run as well. The longest part that passes this test counts, or
    the shortest that passes it on its own tenth, together with the magnitudes of the beginning.
    """
    looks = [look_along(stretches)]
    found, first, beginning = looks[0].largest, stretches[0], looks[0].beginning
    if driven or len(stretches) > 1 or len(found) > LARGEST:
        return looks[0]
    if not goes_astray(program, found, beginning):
        return looks[0]

    def largest(part: int) -> Any:
        while len(looks) <= part:
            stop = first.start + (first.stop - first.start) * SHORTER ** len(looks)
            looks.append(look_along((replace(first, stop=stop),)))
        return looks[part].largest

    def is_sound(part: int, most: int) -> bool:
        shorter = range(1, most + 1)
        return all(_follows_from(program, largest(part), largest(part + k), FAR * SHORTER**-k) for k in shorter)

    parts = [(part, PARTS - 1) for part in range(PARTS)] + [(part, 1) for part in reversed(range(PARTS))]
    sound = next((looks[part] for part, most in parts if is_sound(part, most)), looks[0])
    return replace(sound, largest=np.maximum(sound.largest, beginning), sure=np.maximum(sound.sure, beginning))


def goes_astray(program: Program, largest: Array, beginning: Array) -> Any:
    """Return True where magnitudes, shape (…, n), are far above those of the beginning."""
    return ~(largest <= ASTRAY * np.maximum(beginning, SLIGHT * _most_alike(program, beginning))).all(axis=-1)


def _follows_from(program: Program, found: Array, before: Array, times: float) -> bool:
    """Return True if magnitudes are at most `times` those of a part of the run."""
    most = times * np.maximum(before, SLIGHT * _most_alike(program, before))
    return bool((found <= np.where(most > 0, most, np.inf)).all())


def _most_alike(program: Program, values: Array) -> Any:
    """Return for every state and unknown the largest value of its unit."""
    return largest_of_group(values, unit_numbers(program))
