"""Equations to state space: the equations that this run needs, in order of computation, with loops solved."""

from ..certificate import Certificate, LoopSummary
from .cancel import without_what_cancels
from .certificate import certify
from .idle import refuse_idle_coordinates
from .reduce import reduce_equations
from .singular import behind_loops, refuse_singular_loops
from .state_space import LinearLoop, StateSpace, TearingVariable

__all__ = [
    "Certificate",
    "LinearLoop",
    "LoopSummary",
    "StateSpace",
    "TearingVariable",
    "behind_loops",
    "certify",
    "reduce_equations",
    "refuse_idle_coordinates",
    "refuse_singular_loops",
    "without_what_cancels",
]
