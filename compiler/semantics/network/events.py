"""`when CONDITION { … }`, `every PERIOD { … }` and `require CONDITION "text"`: conditions of each instance, and the assignments at an event.

A value that an event, a start or a sampling sets is of the unit and kind of its target.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Expression, Number, call, select
from ...algebra.formula import Bound, Formula, bind
from ...graph.domains import DOMAINS
from ...graph.network import (
    Action,
    Element,
    Event,
    Named,
    Node,
    Quantity,
    Reading,
    Requirement,
    Sampling,
    behind,
    quantities_in,
)
from ...graph.units import ONE, SECOND
from ...syntax import tree
from ..expressions.lists import fitted, parts_of, shape_of, shaped, sort_of
from ..expressions.template import Typed
from ..names.errors import LateStorage, SamplingOutOfRange, WrongEvent, WrongExperiment, WrongSampling, WrongType
from ..names.scope import STATIC_ROLES, Items, Scalar, Scope
from ..names.statement_errors import Wrong, suggestion, wrong_unit
from ..resolution.conditions import known_or_later, rising
from ..resolution.resolver import read_condition
from .elaborate import Elaborator

LARGEST_SEED = 2.0**31
RANGES = {
    "offset": "It is the instant of the first sample behind zero: zero or more, and less than the period.",
    "delay": "What one sample computes takes effect before the next sample: delay and jitter together are less than the period. A longer one is "
    "written where the value is used: `delay(u, 3 ms)`.",
    "jitter": "An instant is late by something from zero to this: zero or more, and less than the period.",
}

STORED_BY = {"q": "qe", "p": "pf"}  # stored quantity -> variables that determine it
MAXIMUM_READINGS = 6  # values that a warning shows


def read_events(elaborator: Elaborator, nodes: Sequence[Node]) -> tuple[Event, ...]:
    """Read the events of all instances. Errors are collected."""
    elements = {n.name: n for n in nodes if isinstance(n, Element)}
    found = [elaborator.guard(_read, elaborator, scope, event, elements) for scope, event in elaborator.events]
    return tuple(item for item in found if item is not None)


def read_stops(elaborator: Elaborator, experiment: tree.Experiment | None) -> tuple[Event, ...]:
    """Read the conditions that end the run of an experiment. Errors are collected."""
    steps = experiment.steps if experiment is not None else ()
    stops = [step for step in steps if isinstance(step, tree.StopSyntax)]
    if stops and not any(isinstance(step, tree.Simulate) for step in steps):
        hint = "Write `simulate 0 .. 10 s` beside it: the run then ends at the condition, or there."
        elaborator.tell(WrongExperiment(stops[0].span, "`stop when` ends a run, but this experiment has none", hint))
    found = [elaborator.guard(_stop, elaborator, step) for step in stops]
    return tuple(item for item in found if item is not None)


def read_relays(elaborator: Elaborator) -> tuple[Event, ...]:
    """Read the two events of each `hysteresis`. Errors are collected. The list of relays may grow: one may read another."""
    pairs = [elaborator.guard(_relay, elaborator, *relay) for relay in elaborator.relays]
    return tuple(event for pair in pairs if pair is not None for event in pair)


def _relay(elaborator: Elaborator, name: str, call: tree.Call, scope: Scope) -> tuple[Event, Event]:
    x, low, high, *_ = call.arguments

    def event(operator: str, limit: tree.ExpressionSyntax, value: float) -> Event:
        condition = elaborator.comparison(call, x, operator, limit)
        _, bound = read_condition(elaborator, condition, scope, "")
        action = Action(Quantity(name), Bound(Formula(0, Number(value)), ()), call.span.words, limit.span)
        words = f"{x.span.words} {operator} {limit.span.words}"
        return Event(_owner(scope), bound, words, (action,), limit.span)

    pair = event(">", high, 1.0), event("<", low, 0.0)
    limits = [b for b in (elaborator.known_bound(limit, scope) for limit in (low, high)) if b is not None]
    known = known_or_later(elaborator, limits, call.span, call.span.words, rising) if len(limits) == 2 else None
    if known is not None and not known[0] < known[1]:
        what = f"`hysteresis` goes off below `{low.span.words}` and on above `{high.span.words}`, which is not larger"
        raise Wrong(WrongEvent(call.span, what, "Leave a gap: `hysteresis(T, 293 K, 295 K)`."))
    return pair


def _stop(elaborator: Elaborator, step: tree.StopSyntax) -> Event:
    hint = "Compare it with something: `stop when x < 0 m`."
    _, condition = read_condition(elaborator, step.condition, elaborator.root, hint)
    return Event("", condition, step.condition.span.words, (), step.condition.span, None, True)


def _read(elaborator: Elaborator, scope: Scope, event: tree.EventSyntax, elements: dict[str, Element]) -> Event:
    sampling: Sampling | None = None
    condition = Bound(Formula(0, ZERO), ())
    if event.sampled:
        sampling = read_sampling(elaborator, event, scope)
    else:
        hint = "Compare it with something: `when x < 0 m { … }`."
        _, condition = read_condition(elaborator, event.condition, scope, hint)
    actions: list[Action] = []
    for reset in event.resets:
        for action in elaborator.guard(_actions, elaborator, scope, reset, elements) or ():
            if not event.sampled and any(action.target == a.target for a in actions):
                hint = "Leave one of the two out, or choose with `a if c else b`."
                elaborator.tell(WrongEvent(reset.span, f"`{action.words}` is set twice at one instant", hint))
            if sampling is not None and sampling.delay is not None and not _is_mode(elaborator, action.target):
                elaborator.tell(LateStorage(reset.target.span, action.words))
            actions.append(action)
    span = event.condition.span
    words = " ".join(span.source.text[span.start :].partition("{")[0].split()) if event.sampled else span.words
    if "->" in words:  # a transition: its condition first, as in any `when`
        words = ", ".join(reversed(words.split(" when ", 1)))
    return Event(_owner(scope), condition, words, tuple(actions), span, sampling)


def _owner(scope: Scope) -> str:
    """Instance of an event, and its round of a `for`: no two events of one place of the text have one name."""
    return scope.path.removesuffix(".") + scope.suffix


def _is_mode(elaborator: Elaborator, target: Quantity | Reading) -> bool:
    return isinstance(target, Quantity) and elaborator.quantities[target.name].role == "mode"


def _actions(elaborator: Elaborator, scope: Scope, reset: tree.Reset, elements: dict[str, Element]) -> list[Action]:
    """The assignment of an event; that of a list is one for each item, all of one span."""
    words = reset.target.words
    found = elaborator.lookup(reset.target, scope)
    items = found.items if isinstance(found, Items) else (found,)
    targets = [_target(elaborator, reset, item, elements) for item in items]
    values = read_values(elaborator, reset.value, scope, found, f"`{words}`")
    named = [item.name for item in items] if isinstance(found, Items) else [words]
    return [Action(t, v, w, reset.span) for t, v, w in zip(targets, values, named, strict=True)]


def _target(
    elaborator: Elaborator, reset: tree.Reset, found: Scalar, elements: dict[str, Element]
) -> Quantity | Reading:
    """Target of an assignment. Raises `Wrong` for what follows from others."""
    words, target, hint = reset.target.words, found.reference, ""
    match target:
        case Quantity(name):
            if found.role != "mode" and not elaborator.is_integral(name):
                hint = "Events set what is stored, `mode`s and signals that are `integral(…)`; all else follows from those."
        case Reading(node, _, variable) if node in elaborator.mechanism_parts:
            if variable not in "qf":
                hint = "Of a part of a mechanism events set a coordinate, `x` or `phi`, or a rate, `x.v`."
        case Reading(node, port, variable):
            hint = storage_advice(elements.get(node), port, variable, "set", "`{}`")
        case _:
            hint = "Events set what is stored, `mode`s and signals that are `integral(…)`."
    if hint:
        raise Wrong(WrongEvent(reset.target.span, f"`{words}` cannot be set", hint))
    assert not isinstance(target, float)
    return target


def storage_advice(element: Element | None, port: str, variable: str, verb: str, example: str) -> str:
    """Return the advice where a variable does not determine what an element's port stores; empty where it does. `example`: of a statement that does."""
    if element is None or not element.stored:
        return f"It stores nothing: {verb} the storages that are tied to it."
    number = next(i for i, p in enumerate(element.ports) if p.name == port)
    allowed = STORED_BY[element.stored[number]]
    if variable in allowed:
        return ""
    domain, prefix = DOMAINS[element.ports[number].domain], f"{element.name}.{port}" if port else element.name
    names = " or ".join(example.format(f"{prefix}.{domain.letter(v)}") for v in allowed)
    return f"{'Set' if verb == 'set' else 'Write'} {names}."


def read_sampling(elaborator: Elaborator, event: tree.EventSyntax, scope: Scope) -> Sampling:
    """Instants of an event, all known before the run. Raises `Wrong`."""
    bounds = {"period": _time(elaborator, event.condition, scope, "What stands after `every`")}
    for timing in event.timing:
        if timing.word in bounds:
            hint = f"Leave one of the two out: `every 1 ms {timing.word} …` has one."
            raise Wrong(WrongSampling(timing.span, f"`{timing.word}` is given twice", hint))
        what = f"What stands after `{timing.word}`"
        bounds[timing.word] = _time(elaborator, timing.value, scope, what, timing.word == "seed")
    if "seed" in bounds and "jitter" not in bounds:
        span = next(t.span for t in event.timing if t.word == "seed")
        hint = "Say how late an instant may be: `every 1 ms jitter 10 us seed 1 { … }`."
        raise Wrong(WrongSampling(span, "A seed without jitter", hint))
    _check_range(elaborator, event, bounds)
    return Sampling(**bounds)


def _time(elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, what: str, bare: bool = False) -> Bound:
    """A time that is known before the run, or a bare number. Raises `Wrong`."""
    target = Scalar(0.0, ONE if scope.plain or bare else SECOND, "number", "period")
    return read_value(elaborator, value, scope, target, what, static=True)


def _check_range(elaborator: Elaborator, event: tree.EventSyntax, bounds: dict[str, Bound]) -> None:
    """Raise `Wrong` for a period, offset, delay, jitter or seed that is known and out of its range; others are looked at by the run."""
    spans = {"period": event.condition.span} | {t.word: t.value.span for t in event.timing}
    numbers = {word: elaborator.value_of(bound, spans[word]) for word, bound in bounds.items()}
    period = numbers["period"]
    if period is not None and not period > 0:
        hint = "A period is longer than nothing: `every 1 ms { … }`."
        raise Wrong(WrongType(spans["period"], "A time", f"{period:g} s", hint))
    for word in ("offset", "delay", "jitter"):
        value = numbers.get(word)
        if value is None:
            continue
        jitter = (numbers.get("jitter") or 0.0) if word == "delay" else 0.0
        if not value >= 0 or (period is not None and not value + jitter < period):
            what = f"`{word}` is {value:g} s" + (f" and `jitter` {jitter:g} s" if jitter else "")
            rest = "" if period is None else f", of a period of {period:g} s"
            raise Wrong(SamplingOutOfRange(spans[word], what + rest, RANGES[word]))
    seed = numbers.get("seed")
    if seed is not None and not (0 <= seed < LARGEST_SEED and seed == int(seed)):
        raise Wrong(
            SamplingOutOfRange(spans["seed"], f"The seed is {seed:g}", "It is a whole number from 0 to 2^31 - 1.")
        )


def _in_numbers(value: tree.ExpressionSyntax, choices: tuple[str, ...]) -> tree.ExpressionSyntax:
    """A value of a mode that is one of several words, with numbers for these. Raises `Wrong`."""
    if isinstance(value, tree.ChoiceSyntax):
        first, other = (_in_numbers(v, choices) for v in (value.value, value.otherwise))
        return replace(value, value=first, otherwise=other)
    word = value.words if isinstance(value, tree.PathSyntax) else ""
    if word not in choices:
        hint = suggestion(word, choices, f"It can be: {', '.join(choices)}.")
        raise Wrong(WrongType(value.span, f"One of {', '.join(choices)}", f"`{value.span.words}`", hint))
    return tree.Literal(value.span, 1, Fraction(1 + choices.index(word)), None)


def read_value(
    elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, target: Scalar, what: str, static: bool = False
) -> Bound:
    """New value of a target: for a mode that is a truth a condition (1 or 0), else a number of its unit. Raises `Wrong`."""
    (bound,) = read_values(elaborator, value, scope, target, what, static)
    return bound


def read_values(
    elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, found: Scalar | Items, what: str, static: bool = False
) -> list[Bound]:  # fmt: skip
    """New values of the items of a list or matrix, or of a single target. Raises `Wrong`."""
    targets = found.items if isinstance(found, Items) else (found,)
    words = found.choices if isinstance(found, Scalar) else ()
    template = elaborator.template(_in_numbers(value, words) if words else value, scope)
    parts = parts_of(template.value)
    alike = shaped(parts[:1] * len(targets), found.columns) if isinstance(found, Items) else parts[0]
    if shape_of(fitted(template.value, alike)) != shape_of(alike):
        raise Wrong(WrongType(value.span, sort_of(alike).capitalize(), sort_of(template.value)))
    for target, typed in zip(targets, parts, strict=True):
        _check_kind(value, scope, target, typed, what)
    if static:
        elaborator.require_static(template, scope, what)
    numbers = (
        Formula(len(template.slots), select(t.expression, TRUE, ZERO)) if t.truth else f
        for t, f in zip(parts, template.formulas, strict=True)
    )
    return [elaborator.bind(template, formula, scope) for formula in numbers]


def _check_kind(value: tree.ExpressionSyntax, scope: Scope, target: Scalar, typed: Typed, what: str) -> None:
    """Raise `Wrong` for a condition in place of a number, or a wrong unit."""
    if target.truth != typed.truth:
        kinds = ("A condition", "a number") if target.truth else ("A number", "a condition")
        example = "true" if target.truth else "1 if c else 0"
        raise Wrong(WrongType(value.span, kinds[0], kinds[1], f"{what} is {kinds[0].lower()}: `… = {example}`."))
    wanted = target.dimension or ONE
    if not scope.plain and typed.dimension not in (None, wanted):
        raise wrong_unit(what, wanted, value, typed.dimension)


def read_requirements(elaborator: Elaborator) -> tuple[Requirement, ...]:
    """Conditions of all instances, and limits of joints. Errors are collected."""
    found = [
        elaborator.guard(_requirement, elaborator, scope, statement) for scope, statement in elaborator.requirements
    ]
    return (*(item for item in found if item is not None), *elaborator.limits)


def parameter_checks(elaborator: Elaborator, quantities: Mapping[str, Named]) -> Iterator[Requirement]:
    """Yield what a program for all values must find of its parameters before it begins."""
    conditions: dict[str, Expression] = {}
    for words, bound in elaborator.positive:
        if any(quantities[name].role == "parameter" for name in behind(quantities_in(bound), quantities)):
            conditions[words] = select(call("less_equal", ZERO, bound.expression), conditions.get(words, TRUE), ZERO)
    span = elaborator.root.definition.model.name_span
    for words, condition in conditions.items():
        yield Requirement("", bind(condition), words, "", (), span, None, True)


def _requirement(elaborator: Elaborator, scope: Scope, statement: tree.RequirementSyntax) -> Requirement:
    hint = 'Compare it with something: `require x < 1 mm "small"`.'
    template, condition = read_condition(elaborator, statement.condition, scope, hint)
    read = [(slot.words, elaborator.scalar_at(slot, scope)) for slot in template.slots]
    moving = [(words, scalar) for words, scalar in read if scalar.role not in STATIC_ROLES] or read
    readings = tuple((words, s.reference, str(s.dimension or ONE)) for words, s in moving[:MAXIMUM_READINGS])
    words = " ".join(statement.condition.span.text.split())
    name, stands = scope.path.removesuffix("."), scope.base().stands
    return Requirement(name, condition, words, statement.text, readings, statement.span, stands)
