"""Structures of a model with switched junctions in one state space, for targets that cannot change the program on the way.

Each set of junctions that are off is a system of equations of its own, over the same states. Steps that are equal in several of them are one step;
the conditions of the junctions choose what rates, outputs and events read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations

from ..algebra.expression import Expression, Symbol, select
from ..algebra.formula import bind
from ..equations.system import Argument, Assignment, EventRow, Variable
from ..source import Span
from .state_space import StateSpace, Step

MOST = 4  # junctions, of sixteen structures
_OF_ALL = ("parameter", "input", "time", "state", "mode")  # roles of variables that the structures share

Off = tuple[str, ...]


class NotJoined(Exception):
    """The junction whose structures cannot be one system, and the reason in words."""

    def __init__(self, span: Span, words: str) -> None:
        super().__init__(words)
        self.span, self.words = span, words


def joined(base: StateSpace, valves: Sequence[str], with_off: Callable[[Off], StateSpace]) -> StateSpace:
    """Return one state space for all structures. `base`: all junctions are on. Raises `NotJoined` where a switching does more than change rates."""
    spans = {s.junction: s.span for s in base.switches}
    if valves:
        raise NotJoined(spans[valves[0]], "ideal valves, which a run opens and closes together,")
    if len(spans) > MOST:
        raise NotJoined(base.switches[MOST].span, f"more than {MOST} switched junctions")
    sets = chain.from_iterable(combinations(spans, count) for count in range(1, len(spans) + 1))
    structures = {(): base, **{off: with_off(off) for off in sets}}
    union = _Union(base)
    if any(x.unknowns or x.delays or x.forced or x.invariants for x in structures.values()):
        words = "switched junctions beside nonlinear loops, closed mechanisms, delays and `der`"
        raise NotJoined(base.switches[0].span, words)
    reads: dict[Off, list[int]] = {(): [*_read(base)]}
    for off, space in structures.items():
        if off:
            numbers = union.add(space)
            _refuse_jumps(base, off, space, numbers)
            reads[off] = [numbers[v] for v in _read(space)]
    chosen = (union.chosen(dict(zip(reads, row, strict=True)), base) for row in zip(*reads.values(), strict=True))
    states = tuple(replace(s, rate=next(chosen)) for s in base.states)
    outputs = {name: next(chosen) for name in base.outputs}
    events = tuple(
        replace(e, condition=next(chosen), settings=tuple(replace(s, value=next(chosen)) for s in e.settings))
        for e in base.events
    )
    limits = tuple(
        replace(x, condition=next(chosen), values=tuple((n, next(chosen) if isinstance(v, int) else v, u) for n, v, u in x.values))
        for x in base.limits
    )  # fmt: skip
    return replace(
        base, variables=tuple(union.variables), steps=tuple(union.steps), pieced=base.pieced | union.pieced, states=states, outputs=outputs, events=events,
        limits=limits, switches=(), momenta=(), ports=(), storages=(), stored={},
    )  # fmt: skip


def _read(space: StateSpace) -> Iterator[int]:
    """Yield what rates, outputs, events and limits read, in their order."""
    yield from (s.rate for s in space.states)
    yield from space.outputs.values()
    for event in space.events:
        yield event.condition
        yield from (s.value for s in event.settings)
    for limit in space.limits:
        yield limit.condition
        yield from (v for _, v, _ in limit.values if isinstance(v, int))


def _refuse_jumps(base: StateSpace, off: Off, space: StateSpace, numbers: Mapping[int, int]) -> None:
    """Raise `NotJoined` where switched junctions change more than rates, or read what they change."""
    span = next((s.span for s in base.switches if s.junction in off), base.switches[0].span)
    states, here = ([x.variables[s.variable].name for s in x.states] for x in (base, space))
    tied = {d.element: d.variable for d in base.dependents}
    tied_here = {d.element: numbers[d.variable] for d in space.dependents}
    jumping = [n for n in (*states, *here) if n not in states or n not in here]
    jumping += [n for n in (*tied, *tied_here) if tied.get(n) != tied_here.get(n)]
    if jumping or states != here:
        what = f"`{jumping[0]}`" if jumping else "states"
        raise NotJoined(span, f"{what}, which may jump where {' and '.join(f'`{n}`' for n in off)} is switched off,")
    for switch, other in zip(base.switches, space.switches, strict=True):
        if numbers[other.condition] != switch.condition:
            raise NotJoined(switch.span, f"`{switch.junction}`, whose condition reads what switching changes,")
    if [_event(e) for e in base.events] != [_event(e) for e in space.events]:
        raise NotJoined(span, "events that act in some sets of switched junctions alone")


def _event(event: EventRow) -> tuple[str, ...]:
    """Return what tells an event from others."""
    return (event.owner, event.words, *(s.words for s in event.settings))


class _Union:
    """Variables and steps of several structures. Those of the first one keep their numbers."""

    def __init__(self, base: StateSpace) -> None:
        self.variables, self.steps, self.pieced = list(base.variables), list(base.steps), set[int]()
        self.shared = {(v.role, v.name): n for n, v in enumerate(base.variables) if v.role in _OF_ALL}
        same = {n: n for n in range(len(base.variables))}
        self.known = {_key(step, same): step.targets for step in base.steps}

    def add(self, space: StateSpace) -> dict[int, int]:
        """Add the steps of a structure; return the numbers of its variables here."""
        numbers: dict[int, int] = {}
        for number, variable in enumerate(space.variables):
            if variable.role in _OF_ALL:
                numbers[number] = self._numbered(variable)
        for step in space.steps:
            key = _key(step, numbers)
            if key not in self.known:
                targets = tuple(self._new(space.variables[v]) for v in step.targets)
                self.pieced |= {n for n, v in zip(targets, step.targets, strict=True) if v in space.pieced}
                self.known[key] = targets
                self.steps.append(_moved(step, targets, numbers))
            numbers |= zip(step.targets, self.known[key], strict=True)
        return numbers

    def _numbered(self, variable: Variable) -> int:
        key = variable.role, variable.name
        if key not in self.shared:
            self.shared[key] = self._new(variable)
        return self.shared[key]

    def _new(self, variable: Variable) -> int:
        self.variables.append(variable)
        return len(self.variables) - 1

    def chosen(self, numbers: Mapping[Off, int], base: StateSpace) -> int:
        """Return a variable that is one of these, by the junctions that are off."""

        def branch(place: int, off: Off) -> Expression:
            if place == len(base.switches):
                return Symbol(numbers[off])
            switch = base.switches[place]
            on, otherwise = branch(place + 1, off), branch(place + 1, (*off, switch.junction))
            return on if on == otherwise else select(Symbol(switch.condition), on, otherwise)

        expression = branch(0, ())
        if expression == Symbol(numbers[()]):
            return numbers[()]
        bound = bind(expression)
        variable = base.variables[numbers[()]]
        target = self._new(Variable(variable.name, "computed", variable.unit))
        span, owner = base.switches[0].span, base.switches[0].junction
        self.steps.append(Assignment(target, bound.formula, bound.arguments, span, owner))
        return target


def _key(step: Step, numbers: Mapping[int, int]) -> tuple[object, ...]:
    """Return what a step computes: equal steps have equal keys."""
    if isinstance(step, Assignment):
        return step.formula, tuple(_entry(a, numbers) for a in step.arguments)
    return tuple(tuple(_entry(e, numbers) for e in row) for row in (*step.matrix, step.right))


def _moved(step: Step, targets: tuple[int, ...], numbers: Mapping[int, int]) -> Step:
    """Return a step over other numbers of variables."""
    if isinstance(step, Assignment):
        arguments = tuple(_entry(a, numbers) for a in step.arguments)
        return replace(step, target=targets[0], arguments=arguments, residual=None)
    matrix = tuple(tuple(_entry(e, numbers) for e in row) for row in step.matrix)
    return replace(step, targets=targets, matrix=matrix, right=tuple(_entry(e, numbers) for e in step.right))


def _entry(entry: Argument, numbers: Mapping[int, int]) -> Argument:
    return entry if isinstance(entry, float) else numbers[entry]
