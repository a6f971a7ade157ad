"""Sweeps of an experiment, and frequency responses."""

from __future__ import annotations

from collections.abc import Mapping

from ...graph.network import Named
from ...graph.units import ONE, SECOND
from ...scene import Plan, Study, Swept
from ...syntax import tree
from ...syntax.blocks import flat
from ..expressions.lists import parts_of
from ..expressions.scales import scale_of
from ..names.domain_table import paths_of
from ..names.errors import UnknownName, WrongExperiment, WrongValue
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong, suggestion, wrong_unit
from ..network.elaborate import Elaborator
from ..resolution.cycles import refuse_bare, refuse_other_readings, refuse_rates_of_angles
from .step_attributes import expressions_of, read_attributes, word


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
            refuse_other_readings(elaborator, value, root, item)
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
