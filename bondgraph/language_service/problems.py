"""Diagnostics of a file as data."""

from __future__ import annotations

from pathlib import Path

from compiler.api import Diagnostic

from .answers import TextProblem
from .workspace import Workspace, place_of


def problems(workspace: Workspace, path: Path, complete: bool = True) -> tuple[list[TextProblem], bool]:
    """Return all errors of a file and of what it imports, and whether these are all: large models are looked at only if `complete`."""
    survey = workspace.survey(path, complete)
    return [problem(d) for d in survey.diagnostics], survey.is_complete


def problem(diagnostic: Diagnostic) -> TextProblem:
    """A diagnostic as data."""
    related = tuple((place_of(span), why) for span, why in (*diagnostic.related(), *diagnostic.stands))
    return TextProblem(place_of(diagnostic.span), diagnostic.code, diagnostic.sentence, diagnostic.help, related)
