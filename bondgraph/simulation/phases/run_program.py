"""A program in a run, with what its phases have in common: each of many phases takes over what the one before has found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..segments.run_values import RunValues
from ..segments.timeline import Timeline
from ..segments.trajectory import Tolerances

if TYPE_CHECKING:
    from ..events.events import Events


@dataclass(slots=True)
class RunProgram:
    """Values and segments of a program in the whole run. `given`: absolute tolerances of the experiment, by index."""

    values: RunValues
    course: Timeline
    given: Mapping[int, float]
    events: Events | None = None  # of the last phase
    tolerances: Tolerances | None = None  # the same
