"""How much of the way a coarse run can be trusted: steps much longer than a swing lead it astray."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..segments import Segment

if TYPE_CHECKING:
    from ...door import Program
    from .coarse import Look

ASTRAY = 1e3  # times what the beginning says
FAR = 2.0  # times as much as a steady growth would bring
PARTS, SHORTER = 6, 0.1  # of the way, each so much of the next, that are looked at then
SLIGHT = 1e-4  # of the largest of one unit: no sign of anything
LARGEST = 200  # states up to which the way is looked at again


def trusted(
    look_along: Callable[[Sequence[Segment]], Look], program: Program, stretches: Sequence[Segment], driven: bool
) -> Look:
    """A coarse run over the stretches, or over its beginning only. `driven`: something depends on time.

    What nothing drives swings about as far as its forces bring it at first, or grows by and by: then its tolerances grow with it. Where states
    get much farther, they must do so on a tenth, a hundredth … of the way as well, in proportion; the longest part of the way counts that
    passes, or the shortest that does on its own tenth, with what the beginning tells.
    """
    looks = [look_along(stretches)]
    found, first, beginning = looks[0].largest, stretches[0], looks[0].beginning
    if driven or len(stretches) > 1 or len(found) > LARGEST:
        return looks[0]
    if (found <= ASTRAY * np.maximum(beginning, SLIGHT * _most_alike(program, beginning))).all():
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
    return replace(sound, largest=np.maximum(sound.largest, beginning))


def _follows_from(program: Program, found: Any, before: Any, times: float) -> bool:
    """Whether magnitudes are not so many times beyond those of a part of the way."""
    most = times * np.maximum(before, SLIGHT * _most_alike(program, before))
    return bool((found <= np.where(most > 0, most, np.inf)).all())


def _most_alike(program: Program, values: Any) -> Any:
    """For every state and unknown the largest value of its unit."""
    units = np.array([*program.states.units, *program.unknowns.units])
    return np.array([values[units == unit].max() for unit in units])
