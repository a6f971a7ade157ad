"""Sweeps of an experiment, frequency responses, and `montecarlo`: distributions, their correlations, and the number of points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from ...chance import DISTRIBUTIONS, SPREAD, Distribution, fault, kinds_told
from ...graph.network import Named
from ...graph.units import ONE, SECOND
from ...scene import MonteCarloRequest, Plan, Study, Swept
from ...steps import ANALYSIS_STEPS
from ...syntax import tree
from ...syntax.blocks import flat
from ..expressions.lists import parts_of
from ..expressions.scales import is_absolute, is_decibel, scale_of
from ..names.domain_table import paths_of
from ..names.errors import UnknownName, WrongExperiment, WrongValue
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong, suggestion, wrong_unit
from ..network.elaborate import Elaborator
from ..resolution.cycles import refuse_bare, refuse_other_readings, refuse_rates_of_angles
from .step_attributes import each, expressions_of, number, read_attributes, refuse_twice, settable, together, word

CORRELATION = "correlation"


def read_sweep(
    elaborator: Elaborator, step: tree.SweepSyntax, experiment: tree.Experiment, root: Scope, plan: Plan
) -> Swept:
    """`sweep a = …`: the values in SI. Raises `Wrong`."""
    path, name = step.path, word(step.path)
    if any(s.name == name for s in plan.sweeps):
        raise Wrong(WrongExperiment(step.span, f"A second sweep of `{name}`", "Put all values into one."))
    entry = elaborator.lookup(path, root)
    own = not path.steps and path.head not in own_names(root.definition.model)
    if not isinstance(entry, Scalar) or (entry.role not in ("parameter", "input")):
        raise Wrong(WrongExperiment(path.span, f"`{name}` cannot be swept", "Only single parameters and inputs are."))
    read = [s.value for s in experiment.steps if isinstance(s, tree.Set)]
    read += [
        e for s in experiment.steps if isinstance(s, tree.Analysis) and s.role != "response" for e in expressions_of(s)
    ]
    if own and not any(p.head == path.head for e in read for p in paths_of(e)):
        advice = f"Sweep a parameter or an input, or read it: `set NAME = {name}`, `invert u to y = {name}`."
        raise Wrong(WrongExperiment(path.span, f"Nobody reads the swept `{name}`", advice))
    if entry.text is not None:
        texts = tuple(_text(elaborator, value, name, root) for value in step.values)
        return Swept(name, tuple(1.0 + texts.index(t) for t in texts), str(ONE), texts)
    unit = scale_of(step.unit) if step.unit is not None else None
    values: list[float] = []
    item = next((p.item for p in elaborator.pending if p.name == name), None)
    for value in step.values:
        if entry.choices:
            values.append(_choice(value, name, entry.choices))
            continue
        if item is not None and unit is None:
            refuse_other_readings(elaborator, value, root, item, root)
        elif unit is None and name in elaborator.quantities:
            refuse_bare(value, name, elaborator.quantities[name].counted)
        template = elaborator.template(value, root, unit)
        elaborator.require_static(template, root, "A swept value")
        for part, formula in zip(parts_of(template.value), template.formulas, strict=True):
            if part.dimension is not None and entry.dimension is not None and part.dimension != entry.dimension:
                raise wrong_unit(f"`{name}`", entry.dimension, value, part.dimension)
            number = elaborator.value_of(elaborator.bind(template, formula, root), value.span)
            if number is None:
                raise Wrong(WrongExperiment(value.span, "A swept value is known before the run", "Write numbers."))
            values.append(number)
    return Swept(name, tuple(values), str(entry.dimension or ONE), entry.choices)


def _text(elaborator: Elaborator, value: tree.ExpressionSyntax, name: str, root: Scope) -> str:
    """A text in quotation marks, or that of another parameter. Raises `Wrong`."""
    if isinstance(value, tree.PathSyntax) and root.find(value.head) is not None:
        text = getattr(elaborator.lookup(value, root), "text", None)
    else:
        text = value if isinstance(value, tree.TextSyntax) else None
    if text is None:
        hint = f'A text stands in quotation marks: `sweep {name} = "{value.span.words}"`.'
        raise Wrong(WrongValue(value.span, name, "the sweep", value.span.words, hint))
    return str(text.value)


def _choice(value: tree.ExpressionSyntax, name: str, choices: tuple[str, ...]) -> float:
    """Number of one of the words of a choice."""
    word = value.words if isinstance(value, tree.PathSyntax) else ""
    if word not in choices:
        hint = suggestion(word, choices, f"It can be: {', '.join(choices)}.")
        raise Wrong(WrongValue(value.span, name, "the sweep", value.span.words, hint))
    return 1.0 + choices.index(word)


def own_names(model: tree.ModelSyntax) -> set[str]:
    """Names of a model's quantities. A swept name that is not among them belongs to the experiment."""
    return {i.name for s in flat(model.statements) if isinstance(s, tree.Quantities) for i in s.items}


def read_response(elaborator: Elaborator, step: tree.Analysis, root: Scope, outputs: Mapping[str, Named]) -> Study:
    """`response`, with frequencies in Hz. Raises `Wrong` and `AlreadyTold`."""
    (source,), (target,) = step.given, step.wanted
    given, seen = word(source.path), word(target.path)
    entry = elaborator.lookup(source.path, root)
    if not isinstance(entry, Scalar) or entry.role not in ("parameter", "input", "signal", "constant"):
        what = f"A response leads from an input, which `{given}` is not"
        raise Wrong(WrongExperiment(source.span, what, "Name an input."))
    if seen not in outputs:
        hint = suggestion(seen, list(outputs), f"Outputs: {', '.join(outputs) or 'none'}.")
        raise Wrong(UnknownName(target.span, seen, "the outputs", hint))
    assert step.range is not None
    refuse_rates_of_angles(elaborator, root, step.range.first, step.range.last)
    cycles = ONE if root.plain else ONE / SECOND
    low = elaborator.static(step.range.first, root, "The lowest frequency", cycles)
    high = elaborator.static(step.range.last, root, "The highest frequency", cycles)
    if not 0 < low < high:
        what = "Frequencies run upwards from above zero"
        raise Wrong(WrongExperiment(step.range.span, what, "Write `over 1 Hz .. 1 kHz`."))
    points = read_attributes(elaborator, step, root).values.get("points", 400)
    return Study("response", given, seen, low, high, points)


def read_montecarlo(elaborator: Elaborator, step: tree.Analysis, root: Scope) -> MonteCarloRequest:
    """Read a `montecarlo` step, with its numbers in SI. Raises `Wrong` and `AlreadyTold`."""
    drawn, linked = ([g for g in step.given if (g.other is None) == alone] for alone in (True, False))
    vary, pairs, found = together(
        elaborator,
        partial(each, elaborator, _drawn, drawn, root),
        partial(each, elaborator, _correlation, linked, root, {word(g.path) for g in drawn}),
        partial(read_attributes, elaborator, step, root),
    )
    refuse_twice(drawn)
    if not vary:
        raise Wrong(WrongExperiment(step.span, "Nothing varies", "Write `NAME = normal(mean, standard deviation)`."))
    both = [frozenset(names) for names, _ in pairs]
    if len(set(both)) < len(both):
        raise Wrong(WrongExperiment(step.span, "Two correlations of one pair", "Write one number for each pair."))
    _check_indices(step, found.values)
    return MonteCarloRequest(vary, pairs, **found.values)


def _check_indices(step: tree.Analysis, values: dict[str, int]) -> None:
    rows, samples = values.get("indices", 0), values.get("samples", MonteCarloRequest(()).samples)
    if rows & (rows - 1) or rows > samples:
        span = next(a.span for a in step.attributes if a.name == "indices")
        hint = "It is a power of two, not above `samples`; 0: no indices."
        raise Wrong(WrongExperiment(span, f"Sobol indices do not stand on {rows} of {samples} points", hint))


def _drawn(elaborator: Elaborator, given: tree.GivenSyntax, root: Scope) -> tuple[str, Distribution]:
    name = settable(elaborator, given, root, "What varies is one that can be set")
    scalar = elaborator.lookup(given.path, root)
    assert isinstance(scalar, Scalar) and given.value is not None
    if scalar.choices:
        hint = f"Compare its words: `sweep {name} = {', '.join(scalar.choices)}`."
        raise Wrong(WrongExperiment(given.path.span, f"`{name}` is a choice, and words have no distribution", hint))
    return name, _distribution(elaborator, given.value, root, given.path)


def _distribution(
    elaborator: Elaborator, value: tree.ExpressionSyntax, root: Scope, path: tree.PathSyntax, inner: bool = False
) -> Distribution:  # fmt: skip
    kinds = (*DISTRIBUTIONS, *(() if inner else ("truncated",)))
    if not isinstance(value, tree.Call) or value.function not in kinds:
        near = suggestion(value.function, kinds) if isinstance(value, tree.Call) else ""
        hint = near or f"There are: {kinds_told()}."
        raise Wrong(WrongExperiment(value.span, f"`{value.span.text}` is no distribution", hint))
    words = DISTRIBUTIONS.get(value.function, ("one of the others", "low", "high"))
    if len(value.arguments) != len(words):
        what = f"{value.function} takes {len(words)} numbers: {', '.join(words)}"
        raise Wrong(WrongExperiment(value.span, what, f"There are: {kinds_told()}."))
    name = word(path)
    if value.function == "truncated":
        found = _distribution(elaborator, value.arguments[0], root, path, True)
        low, high = (_number(elaborator, a, root, path, "") for a in value.arguments[1:])
        return _checked(name, Distribution(found.kind, found.numbers, low, high), value)
    numbers = tuple(
        _number(elaborator, a, root, path, w) for a, w in zip(value.arguments, words, strict=True)
    )  # fmt: skip
    return _checked(name, Distribution(value.function, numbers), value)


def _number(
    elaborator: Elaborator, value: tree.ExpressionSyntax, root: Scope, path: tree.PathSyntax, what: str
) -> float:  # fmt: skip
    if what == SPREAD and isinstance(value, tree.Literal) and value.unit is not None:
        ratio = is_decibel(value.unit)
        if ratio or is_absolute(value.unit):
            hint = "Write it as a number, `0.1*1`." if ratio else "Write it in K."
            raise Wrong(WrongExperiment(value.span, "A standard deviation is a difference", hint))
    return number(elaborator, value, path, root, f"The {what or 'end'} of `{word(path)}`")


def _checked(name: str, drawn: Distribution, value: tree.ExpressionSyntax) -> Distribution:
    wrong = fault(drawn)
    if wrong:
        what = f"`{name}` cannot have this distribution: {wrong}"
        raise Wrong(WrongExperiment(value.span, what, "Numbers are compared in SI."))
    return drawn


def _correlation(
    elaborator: Elaborator, given: tree.GivenSyntax, root: Scope, known: set[str]
) -> tuple[tuple[str, str], float]:
    assert given.other is not None and given.value is not None
    if given.word != CORRELATION:
        hint = "Write `NAME = normal(mean, standard deviation)`, or `correlation(A, B) = 0.3`."
        raise Wrong(WrongExperiment(given.span, f"`{given.word}` of two is nothing that varies", hint))
    for path in (given.path, given.other):
        if word(path) not in known:
            hint = suggestion(word(path), sorted(known), f"It varies: {', '.join(sorted(known))}.")
            raise Wrong(UnknownName(path.span, word(path), "what varies here", hint))
    if word(given.path) == word(given.other):
        raise Wrong(WrongExperiment(given.span, "A correlation is of two different quantities", "Name two."))
    value = elaborator.static(given.value, root, "A correlation")
    if not (math.isfinite(value) and -1 <= value <= 1):
        raise Wrong(WrongExperiment(given.value.span, f"A correlation of {value:g}", "It lies between -1 and 1."))
    return (word(given.path), word(given.other)), value


def check_together(experiment: tree.Experiment | None, plan: Plan) -> None:
    """Check `montecarlo` together with the other steps. Raises `Wrong`.

    `montecarlo` repeats the other steps at each of its points. So there may be only one, and the results of the others must be numbers.
    """
    steps = experiment.steps if experiment is not None else ()
    chances = [s for s in steps if isinstance(s, tree.Analysis) and s.role == "montecarlo"]
    if not chances:
        return
    if len(chances) > 1:
        hint = "Put all that varies into one, or write a second experiment."
        raise Wrong(WrongExperiment(chances[1].span, "A second `montecarlo` in one experiment", hint))
    repeated = [f"`{word}`" for word, row in ANALYSIS_STEPS.items() if row.scalar]
    for step in steps:
        if isinstance(step, tree.Analysis) and step not in chances and not ANALYSIS_STEPS[step.role].scalar:
            hint = f"Beside it stand {', '.join(repeated)} and `simulate`; write a second experiment for this."
            raise Wrong(WrongExperiment(step.span, f"`{step.role}` has no numbers that `montecarlo` could count", hint))
    if plan.stop is None and not any(isinstance(s, tree.Analysis) and s not in chances for s in steps):
        hint = f"Add {', '.join(repeated)} or `simulate`: that is what is made at each point."
        raise Wrong(WrongExperiment(chances[0].span, "`montecarlo` of nothing", hint))
