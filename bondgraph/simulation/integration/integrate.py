"""A run over smooth segments: the integrator stops and restarts where the right-hand side jumps or has a kink."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.api import Array

from ..segments.timeline import Segment
from ..segments.trajectory import Trajectory
from .integration_state import PhaseProblem
from .segment_integrator import SegmentIntegrator


def integrate(problem: PhaseProblem, state: Array, stretches: Sequence[Segment], into: Trajectory) -> Trajectory:
    """Integrate over the segments, into a trajectory that keeps the part before an exception. Raises `RunFailed` with time and variable."""
    if problem.events is not None:
        from .event_integrator import EventIntegrator

        return EventIntegrator(problem, into).through(state, stretches)
    return SegmentIntegrator(problem, into).through(state, stretches)
