"""Experiment steps other than simulations: sweeps, and the analyses at each of their points."""

from __future__ import annotations

from ...graph.network import Named
from ...graph.units import ONE, SECOND
from ...scene import Plan, Study, Swept
from ...syntax import tree
from ..expressions.scales import scale_of
from ..names.domain_table import paths_of
from ..names.errors import DimensionMismatch, NotStatic, UnknownAttribute, UnknownName, WrongExperiment
from ..names.scope import STATIC_ROLES, Scalar, Scope
from ..names.statement_errors import Wrong, describe, suggestion
from ..network.elaborate import Elaborator
from .step_attributes import expressions_of

MOST_POINTS = 1_000_000


def read_sweep(
    elaborator: Elaborator, step: tree.StudySyntax, experiment: tree.Experiment, root: Scope, plan: Plan
) -> Swept:
    """`sweep a = …`: the values in SI. Raises `Wrong`."""
    path = step.paths[0]
    name = path.words.replace(" ", "")
    if any(s.name == name for s in plan.sweeps):
        raise Wrong(WrongExperiment(step.span, f"A second sweep of `{name}`", "Put all values into one."))
    entry = elaborator.lookup(path, root)
    own = not path.steps and path.head not in own_names(root.definition.model)
    if not isinstance(entry, Scalar) or (entry.role not in ("parameter", "input")):
        raise Wrong(WrongExperiment(path.span, f"`{name}` cannot be swept", "Only single parameters and inputs are."))
    read = [s.value for s in experiment.steps if isinstance(s, tree.Set)]
    read += [e for s in experiment.steps if isinstance(s, tree.Analysis) for e in expressions_of(s)]
    if own and not any(p.head == path.head for e in read for p in paths_of(e)):
        advice = f"Sweep a parameter or an input, or read it: `set NAME = {name}`, `invert u to y = {name}`."
        raise Wrong(WrongExperiment(path.span, f"Nobody reads the swept `{name}`", advice))
    unit = scale_of(step.unit) if step.unit is not None else None
    values: list[float] = []
    for value in step.values:
        template = elaborator.template(value, root, unit)
        for slot in template.slots:
            if elaborator.scalar_at(slot, root).role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, "A swept value", slot.words))
        parts = template.value if isinstance(template.value, tuple) else (template.value,)
        for part, formula in zip(parts, template.formulas, strict=True):
            if part.dimension is not None and entry.dimension is not None and part.dimension != entry.dimension:
                what = f"`{name}` is {describe(entry.dimension)}, but `{value.span.text}` is {describe(part.dimension)}"
                raise Wrong(DimensionMismatch(value.span, what, "Write values of the same kind."))
            number = elaborator.value_of(elaborator.bind(template, formula, root), value.span)
            if number is None:
                raise Wrong(WrongExperiment(value.span, "A swept value is known before the run", "Write numbers."))
            values.append(number)
    return Swept(name, tuple(values), str(entry.dimension or ONE))


def own_names(model: tree.ModelSyntax) -> set[str]:
    """Names of a model's quantities. A swept name that is not among them belongs to the experiment."""
    return {i.name for s in model.statements if isinstance(s, tree.Quantities) for i in s.items}


def read_study(elaborator: Elaborator, step: tree.StudySyntax, root: Scope, outputs: dict[str, Named]) -> Study:
    """`equilibrium`, `modes`, `response`. Raises `Wrong`."""
    if step.role != "response":
        for attribute in step.attributes:
            raise Wrong(UnknownAttribute(attribute.span, step.role, attribute.name, "It has none."))
        return Study(step.role)
    given, seen = (path.words.replace(" ", "") for path in step.paths)
    entry = elaborator.lookup(step.paths[0], root)
    if not isinstance(entry, Scalar) or entry.role not in ("parameter", "input", "signal", "constant"):
        raise Wrong(
            WrongExperiment(
                step.paths[0].span, f"A response leads from an input, which `{given}` is not", "Name an input."
            )
        )
    if seen not in outputs:
        hint = suggestion(seen, list(outputs), f"Outputs: {', '.join(outputs) or 'none'}.")
        raise Wrong(UnknownName(step.paths[1].span, seen, "the outputs", hint))
    assert step.range is not None
    cycles = ONE if root.plain else ONE / SECOND
    low = elaborator.static(step.range.first, root, "The lowest frequency", cycles)
    high = elaborator.static(step.range.last, root, "The highest frequency", cycles)
    if not 0 < low < high:
        raise Wrong(
            WrongExperiment(step.range.span, "Frequencies run upwards from above zero", "Write `over 1 Hz .. 1 kHz`.")
        )
    points = 400.0
    for attribute in step.attributes:
        if attribute.name != "points" or attribute.target is not None:
            raise Wrong(UnknownAttribute(attribute.span, "response", attribute.name, "It has: points."))
        points = elaborator.static(attribute.value, root, "`points`")
        if points != round(points) or not 2 <= points <= MOST_POINTS:
            raise Wrong(
                WrongExperiment(attribute.span, f"`points = {points:g}` makes no sense", "It is a whole number from 2.")
            )
    return Study("response", given, seen, low, high, round(points))
