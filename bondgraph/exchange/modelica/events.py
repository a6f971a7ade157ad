"""Events of the language for each `when`: what becomes true sets what.

Modelica's right sides read what the same `when` sets; the language's read what was. So what is set is put in the place of its name, or, in an `every`,
stands in a line before. Modelica acts on what becomes true after the start; the language also on what is true there. So a condition that may be true
there has a mode beside it, which holds what the condition was; so have conditions of which each acts alone (`when {a, b}`), and those whose `edge` is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from compiler.api import printable

from .functions import REPLACED
from .normal_form import MAXIMUM_PARTS, NormalForm, When
from .parse import FlatModel
from .start import StartEvaluator
from .system import SortedSystem, inlined
from .tree import FALSE, TRUE, Term, is_call, joined, named, names_in, negated, rebuilt, walk

STARTED, WAS = "started\n", "was\n"  # no name of a file has a line break
MAXIMUM_WHENS, MAXIMUM_CONDITIONS = 500, 30
ONLY_PRE = "Read it by `pre(…)`, or set both in one `when`."


@dataclass(slots=True)
class EventClause:
    """Settings of an event; a tuple of period and offset stands in the place of the condition of an `every`."""

    condition: Term | tuple[Term, Term]
    settings: dict[str, Term]


@dataclass(slots=True)
class EventClauses:
    """Events, and modes that only they need, which begin as false."""

    events: list[EventClause] = field(default_factory=list)
    latches: list[str] = field(default_factory=list)


class EventFinder:
    """Finder of the events of a model; what the language cannot order is refused."""

    def __init__(self, model: FlatModel, form: NormalForm, system: SortedSystem, values: StartEvaluator) -> None:
        self.model, self.form, self.system, self.values = model, form, system, values
        self.latched: dict[str, Term] = {}  # modes with the conditions that they remember
        self.apart: dict[str, list[Term]] = {}  # what keeps their ends apart from events that set them
        self.events: list[EventClause] = []
        self.by_condition: dict[Term | tuple[Term, Term], list[EventClause]] = defaultdict(list)
        self.readers: dict[str, list[str]] = defaultdict(list)
        reads = [([name], names_in(term)) for name, term in system.definitions.items()]
        for names, inside in [*reads, *((ns, names_in(*(s for p in ps for s in p[:2]))) for ns, ps in system.rings)]:
            for name in inside:
                self.readers[name] += names

    def dependent(self, names: Iterable[str]) -> set[str]:
        """Return names, and all that is computed from them."""
        reached, stack = set(names), list(names)
        while stack:
            new = set(self.readers.get(stack.pop(), ())) - reached
            reached |= new
            stack += new
        return reached

    def result(self) -> EventClauses:
        whens = self.form.whens
        if len(whens) > MAXIMUM_WHENS:
            self.model.refuse(
                whens[-1].place, f"there are more than {MAXIMUM_WHENS} events", "Import parts of the model."
            )
            return EventClauses()
        moving = self.dependent([*self.form.states, *self.form.modes])
        causes = [self._causes(when) & moving for when in whens]
        moved = [self.dependent(when.settings.keys() & self.form.modes.keys()) for when in whens]
        for i, when in enumerate(whens):
            together = [
                k for k in range(len(whens)) if k != i and (causes[i] & causes[k] or causes[i] == causes[k] == set())
            ]
            self._refuse_order(when, [moved[k] for k in together], [moved[k] for k in range(len(whens)) if k != i])
        for when in whens:
            self._add(when)
        for name, rule in self.form.memories.items():
            rule = self.before(rule)
            self._append(joined("and", negated(named(name)), rule), {name: TRUE})
            self._append(joined("and", named(name), negated(rule)), {name: FALSE})
        if self.latched:
            begun = Term("compare", ">=", (named("time"), Term("number", repr(self.values.values["time"]))))
            self.events.insert(0, EventClause(begun, {STARTED: TRUE, **self.latched}))
            for latch, condition in self.latched.items():
                self._append(
                    joined("and", named(STARTED), named(latch), negated(condition), *self.apart[latch]), {latch: FALSE}
                )
        return EventClauses(self.events, [*self.latched, STARTED] if self.latched else [])

    def _append(self, condition: Term | tuple[Term, Term], settings: dict[str, Term]) -> None:
        """Add an event; to another one with its condition, if its lines can stand there."""
        for event in self.by_condition[condition]:
            if not event.settings.keys() & settings.keys():
                if isinstance(condition, Term) or not names_in(*settings.values()) & self.dependent(event.settings):
                    event.settings |= settings
                    return
                if not names_in(*event.settings.values()) & self.dependent(settings):
                    event.settings = settings | event.settings
                    return
        self.events.append(EventClause(condition, settings))
        self.by_condition[condition].append(self.events[-1])

    def _add(self, when: When) -> None:
        conditions: list[Term] = []
        for item in when.conditions:
            item = item.parts[0] if is_call(item, "edge") else item
            sample = self.form.samples.get(item.word, item) if item.kind == "name" else item
            if is_call(sample, "sample") and len(when.conditions) == 1:
                self._sample(when, *sample.parts)
                return
            conditions += [item.parts[0], negated(item.parts[0])] if is_call(item, "change") else [item]
        if len(conditions) > MAXIMUM_CONDITIONS:
            self.model.refuse(when.place, f"a `when` has more than {MAXIMUM_CONDITIONS} conditions", "Divide it.")
            return
        plain = [self.before(c) for c in conditions]
        reads_edges = any(is_call(t, "edge") for s in when.settings.values() for t in walk(s))
        if len(plain) == 1 and self.values.value(plain[0]) == 0 and not reads_edges:
            self._append(plain[0], {n: self.before(t) for n, t in self._current(when).items()})
            return
        remembered = {f"{WAS}{len(self.latched) + i + 1}": c for i, c in enumerate(plain)}
        self.latched |= remembered
        becomes = [joined("and", c, negated(named(latch))) for latch, c in remembered.items()]
        self.apart |= dict.fromkeys(remembered, [negated(joined("or", *becomes))] if len(becomes) > 1 else [])
        edges = dict(zip(conditions, becomes, strict=True))
        settings = {n: self.before(_with_edges(t, edges)) for n, t in self._current(when).items()}
        self._append(joined("and", named(STARTED), joined("or", *becomes)), settings | remembered)

    def _sample(self, when: When, start: Term, period: Term) -> None:
        """Add an `every`: line by line as the file means it, if there is such an order, else with what is set in the place of names."""
        begin, length = self.values.value(start), self.values.value(period)
        every = (period, start)
        if begin is None or length is None or begin >= length:  # an offset is less than a period
            every = (period, REPLACED["mod", 2](start, period))
            half = Term("sum", "+-", (start, Term("product", "*/", (period, Term("number", "2")))))
            begun = Term("compare", ">", (named("time"), half))
            gated = {
                n: Term("choice", "", (begun, t, Term("call", "pre", (named(n),)))) for n, t in when.settings.items()
            }
            when = replace(when, settings=gated)
        ordered: dict[str, Term] = {}
        waiting, own = dict(when.settings), when.settings.keys() & self.form.modes.keys()
        while waiting:
            for name, term in waiting.items():
                now, before = _now(term), names_in(term) - _now(term)
                later = now & (self.dependent(own) - own | (own & waiting.keys()))
                if not later and not (before | (now - own)) & self.dependent(ordered):
                    ordered[name] = waiting.pop(name)
                    break
            else:
                for one, term in self._current(when).items():
                    self._append(every, {one: self.before(term)})
                return
        self._append(every, {n: self.before(t) for n, t in ordered.items()})

    def before(self, term: Term) -> Term:
        """Return a term without `pre`, whose names mean what was; refuse what reads an edge or a sample in other ways."""
        if is_call(term, "pre"):
            return term.parts[0]
        if is_call(term, "edge", "change", "sample") or (term.kind == "name" and term.word in self.form.samples):
            self.model.refuse(
                term, f"`{term.word}` cannot be imported here", "It stands alone as the condition of a `when`."
            )
        return rebuilt(term, self.before)

    def _current(self, when: When) -> dict[str, Term]:
        """Return what is set, with what the same `when` sets in the place of its name."""
        own = {n: t for n, t in when.settings.items() if n in self.form.modes}
        moved, left = self.dependent(own), MAXIMUM_PARTS

        def put(term: Term, within: tuple[str, ...]) -> Term:
            nonlocal left
            left -= 1
            if is_call(term, "pre") or left < 0:
                return term
            if term.kind == "name" and term.word in moved:
                inner = own.get(term.word) or inlined(term, self.system, {n: named(n) for n in own})
                if term.word not in within and inner is not None:
                    return put(inner, (*within, term.word))
                self.model.refuse(when.place, f"`{printable(term.word)}`, which is read here, moves with what is set here", ONLY_PRE)  # fmt: skip
            return rebuilt(term, lambda part: put(part, within))

        values = {n: put(t, (n,) if n in own else ()) for n, t in when.settings.items()}
        if left < 0:
            self.model.refuse(
                when.place, "what is set here is too long, with what it reads in the place of names", ONLY_PRE
            )
        return values

    def _causes(self, when: When) -> set[str]:
        """Return the names by which the conditions of a `when` change, those in truths that they name, too."""
        reached, stack = set[str](), list(names_in(*when.conditions))
        while stack:
            name = stack.pop()
            if name not in reached:
                reached.add(name)
                is_truth = self.model.declared[name].kind == "Boolean" if name in self.model.declared else False
                stack += names_in(self.system.definitions[name]) if is_truth and name in self.system.definitions else []
        return reached

    def _refuse_order(self, when: When, together: list[set[str]], others: list[set[str]]) -> None:
        """Refuse what reads another `when` at the same instant in an order that the language does not have.

        `together`: what moves with those that may act at the same instants, as their conditions share a name or are all on time; `others`: with all.
        """
        read, tested = (set().union(*map(_now, terms)) for terms in (when.settings.values(), when.conditions))
        before = names_in(*(t for s in when.settings.values() for t in walk(s) if is_call(t, "pre")))
        late = set().union(
            *(read & moved for moved in together), *(before & moved for moved in others if tested & moved)
        )
        for name in sorted(late)[:1]:
            what = f"`{printable(name)}` may be set at the same instant by another `when`, before it is read here"
            self.model.refuse(when.place, what, ONLY_PRE)


def _now(term: Term) -> set[str]:
    """Return the names that a term reads as they are, not as they were."""
    return (
        set() if is_call(term, "pre") else {term.word} if term.kind == "name" else set().union(*map(_now, term.parts))
    )


def _with_edges(term: Term, becomes: Mapping[Term, Term]) -> Term:
    """Return a term with what becomes true in the place of edges."""
    if is_call(term, "edge") and term.parts[0] in becomes:
        return becomes[term.parts[0]]
    return rebuilt(term, lambda part: _with_edges(part, becomes))
