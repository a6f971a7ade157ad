"""Notes on `every` blocks that differ from a controller's program: all their right sides read the values from before the instant."""

from __future__ import annotations

from collections.abc import Iterator

from .network import Action, BondGraph, Event, Quantity, Reading
from .run_time_parameters import behind


def sample_notes(graph: BondGraph) -> Iterator[str]:
    """A note for each line of an `every` block that reads a target of an earlier line of it."""
    for event in graph.events:
        if event.period is not None:
            yield from _notes(event, graph)


def _notes(event: Event, graph: BondGraph) -> Iterator[str]:
    actions = sorted(event.actions, key=lambda a: a.span.start)
    for position, action in enumerate(actions):
        read = _read(action, graph)
        late = [a for a in actions[:position] if a.target in read]
        if late:
            names = ", ".join(f"`{a.words}` of line {a.span.line}" for a in late)
            yield (
                f"line {action.span.line}, `{action.words} = …`, does not see {names}: the right sides of one instant read "
                "the values from before it, one period old"
            )


def _read(action: Action, graph: BondGraph) -> frozenset[Quantity | Reading]:
    """All references of a right side, direct and through signals. Integrals count as themselves, not as their arguments."""
    quantities = graph.quantities
    names = behind([a.name for a in action.value.arguments if isinstance(a, Quantity)], quantities)
    definitions = [action.value, *(d for n in names if (d := quantities[n].definition) is not None)]
    return frozenset(a for d in definitions for a in d.arguments if isinstance(a, Quantity | Reading))
