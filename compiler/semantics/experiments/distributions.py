"""`montecarlo`: distributions of quantities, their correlations, and the number of points."""

from __future__ import annotations

import math
from functools import partial

from ...chance import DISTRIBUTIONS, SPREAD, Distribution, fault, kinds_told
from ...scene import MonteCarloRequest, Plan
from ...steps import ANALYSIS_STEPS
from ...syntax import tree
from ..expressions.scales import is_absolute, is_decibel
from ..names.errors import UnknownName, WrongExperiment
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong, suggestion
from ..network.elaborate import Elaborator
from .step_attributes import each, number, read_attributes, refuse_twice, settable, together, word

CORRELATION = "correlation"


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
