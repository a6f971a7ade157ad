"""What a stepper is asked to hold, and what comes of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .segments import Segment

if TYPE_CHECKING:
    from ..door import Program
    from .closed.singular import SingularPose
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


@dataclass(frozen=True, slots=True)
class Kept:
    """Where a run stands after a step that it accepted: enough to go on from there, and to tell it from what came of later ones."""

    time: float
    state: Any  # with the unknowns of loops; shape (n,)
    mode: Any
    begun: float  # where the current piece begins
    position: int  # reported instants that have been passed
    pieces: int  # that are over
    jumps: int  # of energy
    happened: int  # events, in the log
    remembered: int  # steps whose delayed signals are known
    work: Any
    on: Mapping[tuple[str, int], bool]  # which events' conditions hold


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
    settled: int | None = (
        None  # the method that goes on whatever the next stretch looks like, and the next leg of this program
    )
    solvers: dict[str, None] = field(default_factory=dict)  # that were at work, in the order of their first use
    pieces: list[Segment] = field(default_factory=list)  # of the stretches, with their modes, as they were run through
    peak: Any = None  # the largest magnitudes on the way
    notes: list[str] = field(default_factory=list)  # of what held the steps
    jumps: list[tuple[Any, Any]] = field(default_factory=list)  # powers and what is stored, before and after each event
    kept: Kept | None = None  # after the last accepted step

    def cut(self, stretches: Sequence[Segment]) -> Kept | None:
        """Only what came before the last accepted step, which an error may have left half looked at; None if there was none."""
        kept = self.kept
        if kept is None:
            self.states = self.states[:0]
            return None
        self.states, self.work, self.final = self.states[: kept.position], kept.work, kept.state
        self.jumps = self.jumps[: kept.jumps]
        if self.pieces or kept.pieces:
            self.pieces = [*self.pieces[: kept.pieces], Segment(kept.begun, kept.time, kept.mode)]
        else:
            passed = (s for s in stretches if s.start < kept.time)
            self.pieces = [Segment(s.start, min(s.stop, kept.time), s.mode) for s in passed]
            self.pieces = self.pieces or [Segment(kept.time, kept.time, kept.mode)]
        return kept


def empty(program: Program, instants: Any) -> Trajectory:
    """A trajectory in which nothing has been reached yet."""
    return Trajectory(np.empty((len(instants), len(program.states.names) + len(program.unknowns.names))))
