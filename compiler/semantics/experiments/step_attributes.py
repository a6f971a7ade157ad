"""Common syntax of analysis steps: attributes in braces, and names that can be set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import partial
from typing import Any

from ...fast_dataclass import dataclass
from ...graph.units import ONE
from ...scene import full_name
from ...steps import ANALYSIS_STEPS
from ...syntax import tree
from ..names.errors import DuplicateName, UnknownAttribute, WrongExperiment
from ..names.scope import Scalar, Scope
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from ..network.elaborate import Elaborator
from ..resolution.cycles import refuse_bare

Read = Callable[[tree.Attribute, Scope], tuple[str, Any]]


@dataclass(slots=True)
class StepAttributes:
    """Attributes of a step. `values`: by attribute. `named`: those with a target, `limit u = 3 V`, by attribute and target."""

    values: dict[str, Any] = field(default_factory=dict)
    named: dict[str, dict[str, Any]] = field(default_factory=dict)


def word(path: tree.PathSyntax) -> str:
    """A path as a name."""
    return full_name(path.words)


def expressions_of(step: tree.Analysis) -> list[tree.ExpressionSyntax]:
    """All expressions of a step: values, bounds and attributes."""
    given = (*step.given, *step.wanted)
    ranges = [r for r in (step.range, *(g.range for g in given)) if r is not None]
    values = [g.value for g in given if g.value is not None]
    return [*values, *(e for r in ranges for e in (r.first, r.last)), *(a.value for a in step.attributes)]


def each(
    elaborator: Elaborator, read: Callable[..., Any], given: Sequence[tree.GivenSyntax], root: Scope, *more: Any
) -> tuple[Any, ...]:
    """Apply `read` to each name and return the results. Raises as `together`."""
    return together(elaborator, *(partial(read, elaborator, one, root, *more) for one in given))


def together(elaborator: Elaborator, *parts: Callable[[], Any]) -> tuple[Any, ...]:
    """Read every part, even after an error in another. Raises `AlreadyTold` if one had an error."""
    found = tuple(elaborator.guard(part) for part in parts)
    if any(one is None for one in found):
        raise AlreadyTold
    return found


def settable(elaborator: Elaborator, given: tree.GivenSyntax, root: Scope, what: str) -> str:
    """The name of a single parameter or input. Raises `Wrong`."""
    scalar = elaborator.lookup(given.path, root)
    name = word(given.path)
    if not isinstance(scalar, Scalar) or scalar.role not in ("parameter", "input"):
        hint = "Name a single parameter or input."
        raise Wrong(WrongExperiment(given.path.span, f"{what}, which `{name}` cannot be", hint))
    return name


def number(
    elaborator: Elaborator, value: tree.ExpressionSyntax, path: tree.PathSyntax, root: Scope, what: str
) -> float:
    """Return a number of the kind of a quantity, in SI. Raises `Wrong`, as for a setting of it."""
    scalar = elaborator.lookup(path, root)
    if word(path) in elaborator.quantities:
        refuse_bare(value, word(path), elaborator.quantities[word(path)].counted)
    return elaborator.static(value, root, what, getattr(scalar, "dimension", None) or ONE)


def refuse_twice(given: Sequence[tree.GivenSyntax]) -> None:
    """Raise `Wrong` for a name that occurs twice."""
    seen: dict[str, tree.GivenSyntax] = {}
    for one in given:
        for path in (one.path, one.other):
            if path is not None and word(path) in seen:
                raise Wrong(DuplicateName(path.span, word(path), seen[word(path)].span))
            if path is not None:
                seen[word(path)] = one


def read_attributes(
    elaborator: Elaborator, step: tree.Analysis, root: Scope, named: Mapping[str, Read] | None = None
) -> StepAttributes:
    """Read the attributes that the step's row has; `named`: how those of a name are read.

    Raises `AlreadyTold` after all errors are reported.
    """
    found, before = StepAttributes(named={n: {} for n in named or {}}), len(elaborator.diagnostics)
    for attribute in step.attributes:
        elaborator.guard(_read, elaborator, step, attribute, root, named or {}, found)
    if len(elaborator.diagnostics) > before:
        raise AlreadyTold
    return found


def _read(
    elaborator: Elaborator, step: tree.Analysis, attribute: tree.Attribute, root: Scope, named: Mapping[str, Read], found: StepAttributes
) -> None:  # fmt: skip
    name, row = attribute.name, ANALYSIS_STEPS[step.role]
    counts = {count: (low, high) for count, low, high in row.counts}
    if attribute.target is not None and name in named:
        target, value = named[name](attribute, root)
        found.named[name][target] = value
    elif attribute.target is None and name in row.truths:
        if attribute.value.span.words not in ("true", "false"):
            raise Wrong(WrongExperiment(attribute.span, f"`{name}` is true or false", f"Write `{name} = true`."))
        found.values[name] = attribute.value.span.words == "true"
    elif attribute.target is None and name in counts:
        found.values[name] = _count(elaborator, attribute, root, counts[name])
    else:
        words = [*counts, *row.truths, *(f"`{n} NAME = …`" for n in row.named)]
        hint = suggestion(
            name, [*counts, *row.truths, *row.named], f"It has: {', '.join(words)}." if words else "It has none."
        )
        raise Wrong(UnknownAttribute(attribute.span, step.role, name, hint))


def _count(elaborator: Elaborator, attribute: tree.Attribute, root: Scope, limits: tuple[int, int]) -> int:
    value = elaborator.static(attribute.value, root, f"`{attribute.name}`")
    low, high = limits
    if value != round(value) or not low <= value <= high:
        what = f"`{attribute.name} = {value:g}` makes no sense"
        raise Wrong(WrongExperiment(attribute.span, what, f"It is a whole number from {low} to {high}."))
    return round(value)
