"""Exercises of a model: a text with gaps for a student, and marks for what was written into them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.api import Scene, Source

if TYPE_CHECKING:
    from ..compiled_model import CompiledModel
    from .answer import MarkedAnswer


def exercise(model: CompiledModel, what: str, experiment: str | None = "") -> str:
    """Return the text of an exercise, `strokes` or `equations`; strokes are those of an experiment. Raises `CompilationFailed`, `UsageError`."""
    from .equations import equations_to_write
    from .strokes import strokes_to_put

    if what == "equations":
        return equations_to_write(model)
    return strokes_to_put(model.compilation(Scene(model.model, experiment)))


def mark(model: CompiledModel, what: str, answer: Source, experiment: str | None = "") -> MarkedAnswer:
    """Return the marks of an exercise that somebody filled in. Raises `CompilationFailed` for errors of the model, `UsageError`."""
    from .equations import mark_equations
    from .strokes import mark_strokes

    if what == "equations":
        return mark_equations(model, answer)
    return mark_strokes(model.compilation(Scene(model.model, experiment)), answer)
