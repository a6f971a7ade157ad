"""Notes on lines of `every` that read of the bond graph what an earlier line of theirs moves at once: the controller measured it before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..equations.system import EventRow
from .order import needed
from .state_space import StateSpace


def measurement_notes(space: StateSpace) -> Iterator[str]:
    """A note for each line whose right side depends, through the bond graph, on what an earlier line of its block sets."""
    rows = [event for event in space.events if event.sampling and len(event.settings) > 1]
    if not rows:
        return
    inputs = [*space.inputs]
    together = tuple(u.residual for u in space.unknowns)
    for unknown in space.unknowns:  # each follows from all equations of its loop
        inputs[unknown.variable] = together
    for event in rows:
        yield from _notes(event, inputs)


def _notes(event: EventRow, inputs: Sequence[tuple[int, ...]]) -> Iterator[str]:
    for place, setting in enumerate(event.settings):
        earlier = [s for s in event.settings[:place] if s.span != setting.span]  # a list is set together
        visible = {s.value for s in earlier}  # new values that a line sees need no measurement
        if setting.value in visible:
            continue
        read = needed([setting.value], inputs, {*visible}) - visible
        late = [s for s in earlier if s.target in read]
        if late:
            names = ", ".join(f"`{s.words}` of line {s.span.line}" for s in late)
            yield (
                f"line {setting.span.line}, `{setting.words} = …`, reads what follows {names} through the bond graph: "
                "as it was measured when the block began"
            )
