"""`every` blocks line by line, as a controller's program: each line reads what the lines before it have set; a line that sets a list
sets its items together.

The result sets all at once, like `when`: each line that reads an earlier one reads that line's new value, a signal of its own. What a line
reads of the bond graph stays as it was when the block began, measured by the controller.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

from ..algebra.expression import Symbol
from ..algebra.formula import Bound, Formula
from .network import Action, BondGraph, Event, Named, Quantity, Reading

FOLLOWING = ("signal", "output", "input")  # roles of what is computed anew from what it reads

ITSELF = Formula(1, Symbol(0))


def in_order(graph: BondGraph) -> BondGraph:
    """The same model with blocks whose right sides read values from before the instant alone. New values are signals `new TARGET`."""
    if not any(event.sampling is not None for event in graph.events):
        return graph
    order = _Order(graph)
    events = [e for event in graph.events for e in ((event,) if event.sampling is None else order.sampled(event))]
    return replace(graph, events=tuple(events), quantities=order.quantities)


class _Order:
    """The quantities of a model, with those that lines of blocks add."""

    def __init__(self, graph: BondGraph) -> None:
        self.quantities = dict(graph.quantities)

    def sampled(self, event: Event) -> tuple[Event, ...]:
        """One block: of a target that several lines set the last one counts, and lines between see each. With a delay it is two."""
        new_values: dict[Quantity | Reading, Quantity] = {}
        last: dict[Quantity | Reading, Action] = {}
        for _, line in groupby(event.actions, lambda action: action.span):
            set_before = dict(new_values)  # the items of a list are set together
            for action in line:
                value = self._after(action.value, set_before)
                if action is not event.actions[-1]:
                    unit = self.quantities[action.target.name].unit if isinstance(action.target, Quantity) else ""
                    new = self._added(Named(f"new {action.words}", "signal", unit, value, None, action.span))
                    new_values[action.target], value = new, Bound(ITSELF, (new,))
                last.pop(action.target, None)
                last[action.target] = replace(action, value=value)
        block = replace(event, actions=tuple(last.values()))
        return self._delayed(block) if event.sampling is not None and event.sampling.delay is not None else (block,)

    def _delayed(self, event: Event) -> tuple[Event, Event]:
        """A block that sets copies of its modes, `late TARGET`, and one that sets the modes to those when the delay is over."""
        assert event.sampling is not None
        first, then = [], []
        for action in event.actions:
            assert isinstance(action.target, Quantity)
            mode = self.quantities[action.target.name]
            copy = self._added(replace(mode, name=f"late {mode.name}"))
            first.append(replace(action, target=copy))
            then.append(replace(action, value=Bound(ITSELF, (copy,))))
        block = replace(event, actions=tuple(first), sampling=replace(event.sampling, delay=None))
        return block, replace(event, actions=tuple(then), late=True)

    def _after(self, bound: Bound, new_values: dict[Quantity | Reading, Quantity]) -> Bound:
        """Return a right side as it is after these lines. Signals that read what they have set become signals of their own."""
        fresh: dict[Quantity | Reading, Quantity | Reading] = dict(new_values)
        rows: list[tuple[Quantity | None, Bound]] = [(None, bound)]
        while True:  # not by recursion: a row of signals may be longer than Python nests calls
            name, definition = rows[-1]
            following = self._next(definition, fresh)
            if following is not None:
                rows.append(following)
                continue
            rows.pop()
            arguments = tuple(fresh.get(a, a) for a in definition.arguments)
            new = definition if arguments == definition.arguments else Bound(definition.formula, arguments)
            if name is None:
                return new
            signal = self.quantities[name.name]
            renamed = replace(signal, name=f"new {signal.name}", definition=new)
            fresh[name] = name if new is definition else self._added(renamed)

    def _next(
        self, definition: Bound, fresh: dict[Quantity | Reading, Quantity | Reading]
    ) -> tuple[Quantity, Bound] | None:
        """The next signal that a definition reads of which it is not known yet. What has no definition, a memory for example, is as it was."""
        for argument in definition.arguments:
            if isinstance(argument, Quantity) and argument not in fresh:
                named = self.quantities.get(argument.name)
                if named is not None and named.role in FOLLOWING and named.definition is not None:
                    return argument, named.definition
        return None

    def _added(self, named: Named) -> Quantity:
        while named.name in self.quantities:
            named = replace(named, name=f"{named.name}'")
        self.quantities[named.name] = named
        return Quantity(named.name)
