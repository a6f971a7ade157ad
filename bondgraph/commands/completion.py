"""Completion of what a shell asks for: files, and the experiments, parameters, inputs and outputs of the file that is already typed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from click import Context, Parameter
from click.shell_completion import CompletionItem

from .. import Model
from ..model.shown import STAGES

Completion = Callable[[Context, Parameter, str], list[CompletionItem]]


def files(context: Context, parameter: Parameter, typed: str) -> list[CompletionItem]:
    """Leave files to the shell."""
    return [CompletionItem(typed, type="file")]


def names_in_model(names_of: Callable[[Model], Iterable[str]], ending: str = "") -> Completion:
    """Complete names of the model in the file of the command line; nothing where there is no file yet, or none that can be read."""

    def complete(context: Context, parameter: Parameter, typed: str) -> list[CompletionItem]:
        from .. import BondgraphError, CompilationFailed, load

        # An option without its value ends the reading of the line: then the file is among what is left.
        file = context.params.get("file") or next((a for a in context.args if not a.startswith("-")), None)
        if file is None:
            return []
        try:
            names = list(names_of(load(Path(file), context.params.get("model"))))
        except (BondgraphError, CompilationFailed, OSError):
            return []
        return [CompletionItem(name + ending) for name in names if name.startswith(typed)]

    return complete


experiments = names_in_model(lambda model: model.experiments)
outputs = names_in_model(lambda model: model.outputs)
inputs = names_in_model(lambda model: model.inputs)
parameters = names_in_model(lambda model: [*model.parameters, *model.inputs])
settings = names_in_model(lambda model: [*model.parameters, *model.inputs], "=")
targets = names_in_model(lambda model: model.outputs, "=")
stages = names_in_model(lambda model: STAGES)
