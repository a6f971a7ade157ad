"""State space to one file of C."""

from __future__ import annotations

from collections.abc import Mapping

from ...errors import CompilationFailed
from ...reduction import StateSpace
from ..c.write import write_c
from ..common_factors import with_shared_products
from ..errors import NumpyAlone
from ..lower import lower
from .target import TextTarget


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the file. Raises `CompilationFailed` for events, switched junctions and delays."""
    refuse_hybrid(space, "C")
    return write_c(with_shared_products(lower(space, located=False)))


def refuse_hybrid(space: StateSpace, target: str) -> None:
    """Raise `CompilationFailed` for a model with events, switched junctions or delays."""
    places = [x.span for group in (space.events, space.switches, space.delays) for x in group]
    if places or space.discretes:
        raise CompilationFailed([NumpyAlone([*places, *(step.span for step in space.steps)][0], target)])


TARGET = TextTarget("c", ".c", write)
