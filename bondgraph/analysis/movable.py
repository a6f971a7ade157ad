"""Refusals of parameters by which nothing has a slope: those that decide which parts there are, words, points of tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..errors import UsageError

if TYPE_CHECKING:
    from compiler.api import Compilation, Program

    from ..compiled_scene import CompiledScene


def differentiable_program(compiled: CompiledScene) -> Program:
    """Return the program of a scene. Raises `UsageError` if nothing is differentiated by one of its quantities."""
    from compiler.api import NotDifferentiable

    try:
        return compiled.program
    except NotDifferentiable as problem:
        raise UsageError(
            "BR218", "one of the quantities is a point of a table or a seed of noise: nothing is differentiated by these",
        ) from problem  # fmt: skip


def refuse_structural(compilation: Compilation, names: Sequence[str]) -> None:
    """Raise `UsageError` if one of these quantities decides which parts there are."""
    name = next((n for n in names if n in compilation.structural), None)
    if name is not None:
        raise UsageError(
            "BR276", f"`{name}` decides which parts the model has, so nothing has a slope by it;", "`sweep` compares its values",
        )  # fmt: skip


def refuse_choice(name: str, compilation: Compilation) -> None:
    """Raise `UsageError` for a parameter that is one of several words, or a truth."""
    words = ("true", "false") if name in compilation.truths else compilation.choices.get(name, ())
    if words:
        raise UsageError(
            "BR277", f"`{name}` is one of the words {', '.join(words)}, and has nothing between them;", "`sweep` compares them",
        )  # fmt: skip
