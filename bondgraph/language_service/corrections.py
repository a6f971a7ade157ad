"""Corrections of errors: edits made of their advice, of which those are offered that leave the file without the error.

The rules (`correction_rules.py`) yield edits; the text with an edit is then checked as any other. An edit that leaves the error, or brings another, is
not offered, so that no rule has to know when it holds.
"""

from __future__ import annotations

from pathlib import Path

from compiler.api import Diagnostic, Project

from .answers import Correction
from .correction_rules import MEANT, RULES, Candidate, WrongText
from .navigation import edited
from .workspace import Workspace, place_of

MOST_TRIED = 12
MOST_CHECKED = 10_000  # characters of a text whose equations are looked at after each try


def corrections(workspace: Workspace, path: Path, start: int, end: int) -> list[Correction]:
    """Return the corrections of the errors that touch a part of a file."""
    path = path.resolve()
    survey = workspace.survey(path, True)
    near = [d for d in survey.diagnostics if place_of(d.span).path == path and _touches(d, start, end)]
    return [c for d in near for c in corrections_of(workspace, path, d, len(survey.diagnostics))]


def _touches(diagnostic: Diagnostic, start: int, end: int) -> bool:
    place = place_of(diagnostic.span)
    source = diagnostic.span.source
    first = source.before[0] + source.line_starts[diagnostic.span.line - source.before[1] - 1]
    return first <= end and start <= max(place.end, first + len(source.line(diagnostic.span.line)))


def corrections_of(workspace: Workspace, path: Path, diagnostic: Diagnostic, errors: int) -> list[Correction]:
    """Return the corrections of one error of a file that has so many."""
    document = workspace.project.document(path)
    error, tried = WrongText(workspace, path, document.text, diagnostic), dict[str, Candidate]()
    for rule in RULES:
        for title, edits in rule(error):
            tried.setdefault(edited(document.text, list(edits), path), (title, edits))
    tried.pop(document.text, None)
    offered: list[Correction] = []
    for text, (title, edits) in list(tried.items())[:MOST_TRIED]:
        if title not in {c.title for c in offered} and _mends(workspace, path, text, title, diagnostic, errors):
            offered.append(Correction(title, diagnostic.code, edits))
    return offered


def _mends(workspace: Workspace, path: Path, text: str, title: str, diagnostic: Diagnostic, errors: int) -> bool:
    """Return True if a text is without the error, and has fewer than before: more only of the equations, or where a syntax error or a wrong name hid them."""
    project = workspace.project
    after = Project(project.library, {**project.open_texts, path: text}, project.most_parts)
    left = after.survey(path, diagnostic.code > "BG3" or len(text) < MOST_CHECKED).diagnostics
    line = diagnostic.span.line
    if any((d.code, d.sentence, d.span.line) == (diagnostic.code, diagnostic.sentence, line) for d in left):
        return False
    on_line = any(d.span.line == line and d.span.source.path == path for d in left)
    before = {(d.code, d.sentence) for d in workspace.survey(path, True).diagnostics}
    if title == "Leave it out" and any((d.code, d.sentence) not in before for d in left):  # something refers to it
        return False
    if diagnostic.code == "BG121" and on_line:  # another arrow may be the wrong one
        return False
    early = [d for d in left if diagnostic.code > "BG3" or d.code < "BG3"]
    hid = diagnostic.code < "BG1" and not on_line
    return len(early) < errors or hid or MEANT.search(diagnostic.help) is not None
