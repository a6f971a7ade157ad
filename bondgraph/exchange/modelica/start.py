"""Starts of states and modes, by their attributes and by initial equations; and values at the start, as far as they are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .functions import ERRORS, computed
from .normal_form import NormalForm, Pair
from .parse import FlatModel
from .system import SortedSystem, inlined, isolated
from .tree import FALSE, TRUE, ZERO, Term, is_call, named, names_in

MAXIMUM_DEPTH = 60  # of names that are read through names


@dataclass(slots=True)
class Starts:
    """Start of each state and mode. `is_rest`: all states begin at rest, which a search finds."""

    instant: Term
    terms: dict[str, Term] = field(default_factory=dict)
    is_rest: bool = False


def find_starts(model: FlatModel, form: NormalForm, system: SortedSystem) -> Starts:
    """Return the starts; an initial equation that gives none of them by parameters is refused."""
    starts, free = Starts(Term("number", repr(instant_of(model)))), []
    for name in (*form.states, *form.modes):
        item = model.declared[name]
        starts.terms[name] = form.starts.get(name, FALSE if item.kind == "Boolean" else ZERO)
        if item.attributes.get("fixed", FALSE).word != "true":
            free.append(name)
    rests = [{left, right} for left, right, _ in form.initial]
    if rests and all({named(f"der({name})"), ZERO} in rests for name in form.states) and len(rests) == len(form.states):
        starts.is_rest = True
        return starts
    constant = {name for name, item in model.declared.items() if item.is_fixed}
    waiting, before = list(form.initial), -1
    while waiting and len(waiting) != before:
        before = len(waiting)
        waiting = [pair for pair in waiting if not _use(pair, free, starts, system, constant)]
    for pair in waiting:
        model.refuse(pair[2], "this initial equation gives no start of one state by parameters", "Give each state a `start`, or all a rate of 0.")  # fmt: skip
    return starts


def _use(pair: Pair, free: list[str], starts: Starts, system: SortedSystem, constant: set[str]) -> bool:
    """Take the start of one state or mode from an equation, if it gives one."""
    left, right = (s.parts[0] if is_call(s, "pre") else s for s in pair[:2])
    begun = {"time": starts.instant, **starts.terms, **{name: named(name) for name in free}}
    sides = [inlined(side, system, begun) for side in (left, right)]
    if sides[0] is None or sides[1] is None:
        return False
    unknown = [name for name in free if name in names_in(*filter(None, sides))]
    direct = [name for name in unknown if named(name) in (left, right)]
    for name in direct or unknown if len(unknown) == 1 or direct else ():
        term = isolated(name, (sides[0], sides[1], pair[2]))
        if term is not None and names_in(term) <= constant:
            starts.terms[name] = term
            free.remove(name)
            return True
    return False


def instant_of(model: FlatModel) -> float:
    """Return the instant at which runs begin."""
    return model.experiment.get("StartTime", 0.0)


class StartEvaluator:
    """Values at the start of a run with the model's own numbers; a truth is 0 or 1, None what is not known."""

    def __init__(self, model: FlatModel, form: NormalForm, system: SortedSystem, starts: Starts) -> None:
        self.terms: Mapping[str, Term] = {**form.values, **system.definitions, **starts.terms}
        inputs = (name for name, item in model.declared.items() if "input" in item.prefixes)  # which a run may set
        self.values: dict[str, float | None] = {"time": instant_of(model), **dict.fromkeys(inputs)}
        for name, rule in form.memories.items():  # which follow their rule at once
            value = self.value(rule)
            self.values = {n: v for n, v in self.values.items() if n not in self.terms} | {name: value}
            starts.terms[name] = starts.terms[name] if value is None else TRUE if value else FALSE

    def value(self, term: Term, depth: int = 0) -> float | None:
        if term.kind == "name" or is_call(term, "pre"):
            name = term.word if term.kind == "name" else term.parts[0].word
            if name not in self.values:
                self.values[name] = None  # in a ring
                if name in self.terms and depth < MAXIMUM_DEPTH:
                    self.values[name] = self.value(self.terms[name], depth + 1)
            return self.values[name]
        values = [self.value(p, depth) for p in term.parts]
        if term.kind in ("and", "or"):
            decisive = float(term.kind == "or")
            return decisive if decisive in values else None if None in values else 1 - decisive
        if term.kind == "choice" and values[0] is not None:
            return values[1] if values[0] else self.value(Term("choice", "", term.parts[2:]), depth) if len(values) > 3 else values[2]  # fmt: skip
        numbers = [v for v in values if v is not None]
        try:
            return float(computed(term, numbers)) if len(numbers) == len(values) else None
        except ERRORS:
            return None
