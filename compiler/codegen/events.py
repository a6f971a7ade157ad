"""Events of a program: located conditions, discrete variables, assignments at events, switched junctions.

The `mode` of a program holds the discrete variables, then the truth values of conditions. It is constant between two events. A
condition on time alone is computed from time. A condition on states is located at the zero crossing of its root, left side minus
right side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from ..algebra.expression import Expression, Symbol
from ..equations.system import EventRow
from ..fast_dataclass import dataclass
from ..reduction import StateSpace
from ..reduction.order import needed
from ..source import Span
from .program import ConditionNote, EventNote, SettingNote


@dataclass(frozen=True, slots=True)
class Located:
    """A condition on states: an item of the mode that changes at the zero crossings of its root."""

    symbol: Symbol
    root: Expression
    note: ConditionNote


@dataclass(frozen=True, slots=True)
class Count:
    """A whole number of states (`floor`): an item of the mode that is computed where a condition in it changes."""

    symbol: Symbol
    position: int
    value: Expression


@dataclass(eq=False)
class LoweredEvents:
    """Expressions of all events, over `Leaf` symbols."""

    starts: tuple[Expression, ...] = ()  # of discrete variables
    timed: list[int] = field(default_factory=list)  # places in the mode of the conditions on time
    located: list[Located] = field(default_factory=list)
    counts: list[Count] = field(default_factory=list)
    triggers: tuple[Expression, ...] = ()
    values: tuple[Expression, ...] = ()  # new values of all settings, in a row
    targets: tuple[Expression, ...] = ()  # targets that are computed from states
    actives: tuple[Expression, ...] = ()
    sampling: tuple[Expression, ...] = ()  # of each sampled event, of parameters: period, offset, delay, jitter, seed
    # efforts and flows of states, then of dependent storages, where junctions switch
    conjugates: tuple[Expression, ...] = ()
    events: tuple[EventNote, ...] = ()
    junctions: tuple[tuple[str, Span], ...] = ()

    @property
    def size(self) -> int:
        """Length of the mode."""
        return len(self.starts) + len(self.timed) + len(self.located) + len(self.counts)

    @property
    def present(self) -> bool:
        """True if the model has events other than conditions on time alone."""
        return bool(self.starts or self.located or self.events or self.junctions)

    def roots(self) -> tuple[Expression, ...]:
        """All expressions of the events."""
        located = (item.root for item in self.located)
        counts = (item.value for item in self.counts)
        return (*located, *counts, *self.triggers, *self.values, *self.targets, *self.actives, *self.conjugates)


def behind_the_run(space: StateSpace) -> set[int]:
    """Variables that rates, residuals and conditions of events depend on: a step must end at their jumps."""
    wanted = [s.rate for s in space.states] + [u.residual for u in space.unknowns]
    wanted += [d.value for d in space.delays] + [f.variable for f in space.forced]
    wanted += [e.condition for e in space.events] + [s.condition for s in space.switches]
    return needed(wanted, space.inputs)


def event_variables(space: StateSpace) -> list[int]:
    """Variables that events and switched junctions read or set."""
    found = [s.condition for s in space.switches]
    for event in space.events:
        found += [event.condition, *(v for s in event.settings for v in (s.target, s.value))]
    return found


def event_notes(space: StateSpace, moving: Mapping[int, int]) -> tuple[tuple[EventNote, ...], list[int]]:
    """Notes on the events of a program, and the variables among their targets that are computed from states.

    `moving`: places of the states and unknowns.
    """
    modes = {d.variable: i for i, d in enumerate(space.discretes)}
    states = {s.variable for s in space.states}
    computed: list[int] = []

    def note(event: EventRow) -> EventNote:
        settings = []
        for setting in event.settings:
            if setting.target in modes:
                settings.append(SettingNote("mode", modes[setting.target], setting.words, setting.span))
            elif setting.target in states:
                settings.append(SettingNote("state", moving[setting.target], setting.words, setting.span))
            else:
                settings.append(SettingNote("computed", len(computed), setting.words, setting.span))
                computed.append(setting.target)
        return EventNote(
            event.owner, event.words, event.span, tuple(settings), bool(event.sampling), event.stops, event.late
        )

    return tuple(note(event) for event in space.events), computed
