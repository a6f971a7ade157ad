"""Equations to state space: what this run needs, in the order in which it is computed, loops solved."""

from ..certificate import Certificate, Loop
from .cancel import without_what_cancels
from .certificate import certify
from .idle import refuse_idle_coordinates
from .reduce import reduce_equations
from .singular import behind_loops, refuse_singular_loops
from .state_space import LinearLoop, StateSpace, Unknown

__all__ = [
    "Certificate",
    "LinearLoop",
    "Loop",
    "StateSpace",
    "Unknown",
    "behind_loops",
    "certify",
    "reduce_equations",
    "refuse_idle_coordinates",
    "refuse_singular_loops",
    "without_what_cancels",
]
