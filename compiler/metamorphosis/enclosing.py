"""A model as an instance, or an array of instances, of another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from ..semantics.names.domain_table import paths_of
from ..syntax import tree
from .changing import Changed, Statements, as_file
from .printing import path, path_text, rewrite, statement, text_of
from .renaming import Definition


def enclosed(
    statements: Statements, model: str, experiment: str | None, outputs: tuple[str, ...], copies: int | None
) -> Changed:
    """The model as an instance of a new one, or as an array; inputs go in, outputs come out."""
    definition = as_file(statements).models[model]
    instances = ["inner"] if copies is None else [f"inner[{j}]" for j in range(1, copies + 1)]
    inputs = [i for i in _items(definition, "input") if i.index is None and not _reads(definition, i.value)]
    passed = {i.name for i in inputs}

    def outer(node: tree.SyntaxNode) -> Any:
        """An expression of the model, read outside of it."""

        def change(part: object) -> object:
            if isinstance(part, tree.PathSyntax) and part.head in definition.names and part.head not in passed:
                return path(f"{instances[0]}.{path_text(part)}")
            return part

        return rewrite(node, change)

    bindings = " { " + ", ".join(f"{i} = {i}" for i in sorted(passed)) + " }" if passed else ""
    lines = [statement(replace(s, items=tuple(inputs)), "  ") for s in _any_quantities(definition) if inputs]
    if copies is None:
        lines.append(f"  {model} inner{bindings}")
    else:
        lines.append(f"  for round in 1..{copies} {{ {model} inner[round]{bindings} }}")
    for j, instance in enumerate(instances):
        lines += [f"  output result_{k}_{j} = {instance}.{name}" for k, name in enumerate(outputs)]
    for s in definition.model.statements:
        if isinstance(s, tree.Experiment) and s.name == experiment:
            lines.append(statement(replace(s, steps=tuple(_steps(s, definition, passed, instances, outer))), "  "))
    text = text_of(statements) + f"{'plain ' * definition.model.plain}model Outer {{\n" + "\n".join(lines) + "\n}\n"
    numbers = {name: k for k, name in enumerate(outputs)}
    return Changed(
        text, "Outer", experiment,
        lambda name: tuple(f"result_{numbers[name]}_{j}" for j in range(len(instances))),
        lambda name: tuple(f"{instance}.{name}" for instance in instances),
        len(instances),
    )  # fmt: skip


def _items(definition: Definition, role: str) -> Iterator[tree.Item]:
    for s in definition.model.statements:
        if isinstance(s, tree.Quantities) and s.role == role:
            yield from s.items


def _any_quantities(definition: Definition) -> list[tree.Quantities]:
    return [s for s in definition.model.statements if isinstance(s, tree.Quantities) and s.role == "input"][:1]


def _reads(definition: Definition, value: tree.ExpressionSyntax | None) -> bool:
    return value is not None and any(p.head in definition.names for p in paths_of(value))


def _steps(
    experiment: tree.Experiment,
    definition: Definition,
    passed: set[str],
    instances: list[str],
    outer: Callable[[tree.SyntaxNode], Any],
) -> Iterator[tree.SyntaxNode]:
    """Settings and duration of the experiment, as steps of the outer model."""
    for step in experiment.steps:
        if isinstance(step, tree.Set):
            if step.target.head in passed:
                yield replace(step, value=outer(step.value))
                continue
            for instance in instances:
                target = path(f"{instance}.{path_text(step.target)}")
                yield replace(step, target=target, value=outer(step.value))
        elif isinstance(step, tree.Simulate):
            own = tuple(replace(a, value=outer(a.value)) for a in step.attributes if a.target is None)
            yield replace(step, range=outer(step.range), attributes=own)
        elif isinstance(step, tree.Bandwidth):
            yield replace(step, value=outer(step.value))
        elif isinstance(step, tree.StopSyntax):
            yield replace(step, condition=outer(step.condition))
        elif isinstance(step, tree.Analysis) and step.role == "equilibrium":  # the run begins there
            yield replace(step, attributes=())
