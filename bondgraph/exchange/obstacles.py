"""Refusals: models that a functional mock-up unit cannot hold, by the line of the text that stands against it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NoReturn

from compiler.api import CompilationFailed, NotInUnit, narrow_conditions

if TYPE_CHECKING:
    from compiler.api import Compilation, NotJoined, Span

_RUN = "Run the model here, or give other tools the run's numbers (`run --out R.csv`)."


def refuse(compilation: Compilation) -> None:
    """Raise `CompilationFailed` with all that a unit cannot hold."""
    if refusals := [NotInUnit(span, what, instead) for span, what, instead in _obstacles(compilation)]:
        raise CompilationFailed(refusals)


def refuse_junctions(reason: NotJoined) -> NoReturn:
    """Raise `CompilationFailed` for switched junctions that a unit cannot hold."""
    raise CompilationFailed([NotInUnit(reason.span, reason.words, _RUN)])


def _obstacles(compilation: Compilation) -> Iterator[tuple[Span, str, str]]:
    space, graph = compilation.state_space, compilation.whole_graph
    lowered = compilation.lowered
    if space.forced:
        name = space.variables[space.forced[0].variable].name
        yield space.forced[0].span, f"the rate of `{name}`, which may jump as only a run sees,", _RUN
    for event in lowered.events.events:
        if event.span.unit is not None:
            text = "Join the two in the tool that imports this one."
            yield event.span, f"`{event.owner}`, a unit itself ({event.span.source.name})", text
        for setting in event.settings:
            if setting.kind == "state" and space.invariants:
                text = "Let it change a `mode`, on which forces depend."
                yield setting.span, f"`{setting.words}`, which an event sets in a model with constraints", text
            if setting.kind == "computed":
                text = "Set the state of a storage, or a `mode`."
                yield setting.span, f"`{setting.words}`, which an event sets and states compute", text
    if space.delays:
        yield space.delays[0].span, "delayed signals, whose past has no largest size,", _RUN
    multipliers = 0 if lowered.solved is None else len(lowered.solved.multipliers)
    if multipliers < len(space.unknowns) and (lowered.events.present or multipliers):
        names = ", ".join(f"`{space.variables[u.variable].name}`" for u in space.unknowns[:3])
        what = "closed loops of a mechanism" if multipliers else "events"
        why = "where a run searches for another solution,"
        yield graph.span, f"nonlinear algebraic loops ({names}) beside {what}, {why}", _RUN
    elif space.unknowns and not space.states:
        what = "nonlinear algebraic loops of a model without states, one of whose solutions a run follows,"
        yield graph.span, what, _RUN
    if space.claims and not space.invariants:
        text = "Give the start of the storage itself."
        yield graph.span, "starts of quantities that are computed from states", text
    for number, _, _ in narrow_conditions(lowered):
        text = "Compare without quotients, exponentials and high powers of what moves: multiply by the divisor, take logarithms or roots."
        yield lowered.events.located[number].note.span, "a condition that may hold for less than a step shows", text
    if lowered.crossings:
        yield graph.span, "instants that only a search over time finds", _RUN
