"""The pipeline, to be read aloud: each stage is a type, made from the one before it.

`compilation.py` keeps the stages of a scene and makes the choices that a scene leaves open.
"""

from __future__ import annotations

from pathlib import Path

from .causality import CausalGraph, assign_causality
from .codegen.common_factors import with_shared_products
from .codegen.lower import lower
from .codegen.program import Program
from .equations import EquationSystem, derive_equations
from .fast_dataclass import dataclass
from .graph.network import BondGraph
from .graph.prune import known_zeros, prune
from .reduction import StateSpace, reduce_equations
from .scene import Scene
from .semantics import build_graph
from .source import Source
from .syntax import parse


@dataclass(frozen=True, slots=True)
class Request:
    """Settings of a scene that the stages behind the graph read: what is zero, free, or changed its form in the middle of a run."""

    zeros: frozenset[str]
    free: frozenset[str] = frozenset()
    changed: frozenset[str] = frozenset()
    everything: bool = False
    opened: bool = False


@dataclass(frozen=True, slots=True)
class Derivation:
    """The stages from a bond graph to the equations of a run."""

    causal: CausalGraph
    equations: EquationSystem
    reduced: StateSpace


def derive(graph: BondGraph, request: Request) -> Derivation:
    """Derive the equations of a run. Raises `CompilationFailed`."""
    causal = assign_causality(graph)  # BondGraph -> CausalGraph
    equations = derive_equations(causal, request.zeros, request.free, request.changed)  # -> EquationSystem
    reduced = reduce_equations(equations, request.everything, graph.span, request.opened)  # -> StateSpace
    return Derivation(causal, equations, reduced)


def compile_source(source: Source, scene: Scene, library: Path | None = None) -> Program:
    """Turn bond-graph text into a program, for a model that leaves no choices open. Raises `CompilationFailed`."""
    from .codegen.numpy import generate_program

    tree = parse(source)  # Source -> SyntaxTree
    graph = build_graph(tree, scene, library).graph  # SyntaxTree -> BondGraph
    zeros = known_zeros(graph, scene.free)
    system = derive(prune(graph, zeros), Request(zeros, scene.free)).reduced  # BondGraph -> StateSpace
    lowered = with_shared_products(lower(system))  # StateSpace -> Lowered
    return generate_program(lowered)  # Lowered -> Program
