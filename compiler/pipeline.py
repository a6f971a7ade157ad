"""The stages from a bond graph to the equations of a run: each is a type, made from the one before it.

`compilation.py` keeps the stages of a scene and makes the choices that a scene leaves open.
"""

from __future__ import annotations

from .causality import CausalGraph, assign_causality
from .equations import EquationSystem, derive_equations
from .fast_dataclass import dataclass
from .graph.network import BondGraph
from .reduction import StateSpace, reduce_equations, with_roots_as_unknowns


@dataclass(frozen=True, slots=True)
class Request:
    """Settings of a scene that the stages behind the graph read: what is zero, free, or changed its form in the middle of a run."""

    zeros: frozenset[str]
    free: frozenset[str] = frozenset()
    changed: frozenset[str] = frozenset()
    everything: bool = False
    opened: bool = False
    steep: bool = False


@dataclass(frozen=True, slots=True)
class Derivation:
    """The stages from a bond graph to the equations of a run."""

    causal: CausalGraph
    equations: EquationSystem
    reduced: StateSpace


def derive(graph: BondGraph, request: Request) -> Derivation:
    """Derive the equations of a run. Raises `CompilationFailed`."""
    causal = assign_causality(graph)  # BondGraph -> CausalGraph
    equations = equations_of(causal, request)  # -> EquationSystem
    reduced = reduce_equations(equations, request.everything, graph.span, request.opened)  # -> StateSpace
    return Derivation(causal, equations, reduced)


def equations_of(causal: CausalGraph, request: Request) -> EquationSystem:
    """Derive the equations, not yet in order."""
    equations = derive_equations(causal, request.zeros, request.free, request.changed)
    return with_roots_as_unknowns(equations) if request.steep else equations


def is_steep(equations: EquationSystem) -> bool:
    """Return True if the equations have a root that `Request.steep` would take as an unknown."""
    return with_roots_as_unknowns(equations) is not equations
