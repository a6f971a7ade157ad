"""Completion of what a shell asks for: files, and the experiments, parameters, inputs and outputs of the file that is already typed, and units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from click import Context, Parameter
from click.shell_completion import BashComplete, CompletionItem, ZshComplete, add_completion_class

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
            model = load(Path(file), context.params.get("model"))
            items = (
                [*_with_units(model, typed)] if ending and ending in typed else [n + ending for n in names_of(model)]
            )
        except (BondgraphError, CompilationFailed, OSError):
            return []
        return [CompletionItem(item) for item in items if item.startswith(typed)]

    return complete


def _with_units(model: Model, typed: str) -> Iterator[str]:
    """Yield `NAME=NUMBER` as it is typed, with the units that its last number may have."""
    from ..language_service.units import units_beside

    name, _, value = typed.partition("=")
    number = re.search(
        r"(?:^|[^A-Za-z_0-9.\]])[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?[ ]*(?=(?:\[|\[?[A-Za-z%][^\s,()]*)?$)", value
    )
    quantity = model.compilation().whole_graph.quantities.get(name)
    if number is not None and quantity is not None:
        yield from (f"{name}={value[: number.end()]}{symbol}" for symbol in units_beside(quantity.unit))


class _Bash(BashComplete):
    """Bash, which takes `=` for a word of its own: it is given what follows the last one. Nothing follows a name that ends in it."""

    source_template = BashComplete.source_template.replace(
        "    return 0\n", "    [[ ${COMPREPLY-} == *= ]] && compopt -o nospace\n    return 0\n"
    )

    def get_completion_args(self) -> tuple[list[str], str]:
        words, typed = super().get_completion_args()
        self.before = ""
        if typed == "=" or words[-1:] == ["="]:
            ahead = words if typed == "=" else words[:-1]
            self.before = f"{ahead.pop()}="
            words, typed = ahead, self.before + typed.removeprefix("=")
        return words, typed

    def format_completion(self, item: CompletionItem) -> str:
        return f"{item.type},{item.value.removeprefix(self.before)}"


class _Zsh(ZshComplete):
    """Zsh, with nothing behind a name that ends in `=`."""

    source_template = ZshComplete.source_template.replace(
        "compadd -U -V unsorted -a",
        "[[ $completions[1] == *= ]] && local -a joined=(-S '')\n        compadd $joined -U -V unsorted -a",
    )


add_completion_class(_Bash, "bash")
add_completion_class(_Zsh, "zsh")


experiments = names_in_model(lambda model: model.experiments)
outputs = names_in_model(lambda model: model.outputs)
inputs = names_in_model(lambda model: model.inputs)
parameters = names_in_model(lambda model: [*model.parameters, *model.inputs])
settings = names_in_model(lambda model: [*model.parameters, *model.inputs], "=")
targets = names_in_model(lambda model: model.outputs, "=")
stages = names_in_model(lambda model: STAGES)
