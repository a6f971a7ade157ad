"""Equations to state space: the equations that this run needs, in order of computation, with loops solved."""

from ..certificate import Certificate, LoopSummary
from .cancel import without_what_cancels
from .certificate import certify
from .reduce import reduce_equations
from .singular import LinearLoops, behind_loops, linear_loops, refuse_idle_coordinates, refuse_singular_loops
from .state_space import LinearLoop, StateSpace, TearingVariable
from .steep_roots import with_roots_as_unknowns
from .structures import NotJoined, joined

__all__ = [
    "Certificate",
    "LinearLoop",
    "LinearLoops",
    "LoopSummary",
    "NotJoined",
    "StateSpace",
    "TearingVariable",
    "behind_loops",
    "certify",
    "joined",
    "linear_loops",
    "reduce_equations",
    "refuse_idle_coordinates",
    "refuse_singular_loops",
    "with_roots_as_unknowns",
    "without_what_cancels",
]
