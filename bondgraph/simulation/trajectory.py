"""What a stepper is asked to hold, and what comes of its steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .closed.singular import SingularPose
    from .segments import Segment
    from .watch.choice import Handover


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative, and per state absolute tolerance and magnitude, in SI; shape (n,).

    `held` marks the absolute tolerances that the author gave; others grow with a state that exceeds its magnitude.
    """

    relative: float
    absolute: Any
    magnitude: Any
    held: Any

    @property
    def scaled(self) -> Any:
        """Absolute tolerances of the states divided by their magnitudes, as the solver is to see them."""
        return self.absolute / self.magnitude


@dataclass(slots=True)
class Trajectory:
    """States at the requested instants, and what the solver did."""

    states: Any  # (points, n)
    steps: int = 0
    evaluations: dict[str, int] = field(default_factory=dict)
    work: Any = None  # integral of the powers, if asked
    final: Any = None
    poses: list[SingularPose] = field(default_factory=list)  # that were passed
    handover: Handover | None = None  # the run stops there: other states should go on
    solvers: dict[str, None] = field(default_factory=dict)  # that were at work, in the order of their first use
    pieces: list[Segment] = field(default_factory=list)  # of the stretches, with their modes, as they were run through
    peak: Any = None  # the largest magnitudes on the way
    notes: list[str] = field(default_factory=list)  # of what held the steps
    jumps: list[tuple[Any, Any]] = field(default_factory=list)  # powers and what is stored, before and after each event
