"""State space to one file of C."""

from __future__ import annotations

from collections.abc import Mapping

from ...errors import CompilationFailed
from ...reduction import StateSpace
from ...source import Span
from ..c.stepping import obstacle
from ..c.write import write_c
from ..common_factors import with_shared_products
from ..errors import NoSteps, NumpyAlone
from ..lower import lower
from .targets import TextTarget


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the file. Raises `CompilationFailed` for a model with events for which a loop over fixed steps has no method.

    A model without events for which it has none is written without the loop: its conditions are then evaluated where they stand, and a comment names them.
    """
    lowered = lower(space)
    if (what := obstacle(lowered)) is None:
        return write_c(with_shared_products(lowered))
    if is_hybrid(space):
        raise CompilationFailed([NoSteps(_place(space), what)])
    jumps = dict.fromkeys(f"{c.note.owner} (line {c.note.span.line})" for c in lowered.events.located)
    return write_c(with_shared_products(lower(space, located=False)), tuple(jumps))


def refuse_hybrid(space: StateSpace, target: str) -> None:
    """Raise `CompilationFailed` for a model with events, switched junctions or delays."""
    if is_hybrid(space):
        raise CompilationFailed([NumpyAlone(_place(space), target)])


def is_hybrid(space: StateSpace) -> bool:
    """Return True for a model with events, switched junctions or delays."""
    return bool(space.events or space.switches or space.delays or space.discretes)


def _place(space: StateSpace) -> Span:
    """Place of the first event, switch or delay."""
    places = [x.span for group in (space.switches, space.delays, space.events) for x in group]
    return [*places, *(step.span for step in space.steps)][0]


TARGET = TextTarget("c", ".c", write)
