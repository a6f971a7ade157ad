"""Answers about one text as JSON values, for an editor on a page or a conversation: corrections as whole texts, a text about a word, words that may follow."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Lock
from typing import TypeAlias

from .completion import completion
from .corrections import corrections
from .hover import hover
from .navigation import edited
from .workspace import Workspace

MOST_WORDS = 60  # suggestions of one answer

Answers: TypeAlias = list[dict[str, object]]


@dataclass(slots=True, eq=False)
class TextAnswers:
    """Answers to a `question`, a key of `QUESTIONS`, about a text that stands in place of a file; `at` is a character of it."""

    workspace: Workspace = field(default_factory=Workspace)
    lock: Lock = field(default_factory=Lock)

    def __call__(self, question: str, text: str, path: Path, at: int = 0) -> Answers:
        with self.lock:
            self.workspace.project.open_texts.clear()  # of files that were shown before, the disk's text holds
            self.workspace.open(path, text)
            return QUESTIONS[question](self.workspace, path.resolve(), text, min(at, len(text)))


def _corrections(workspace: Workspace, path: Path, text: str, at: int) -> Answers:
    """Return for each error the corrections that are known to mend it: title, code, line, and the whole text after it."""
    return [
        {
            "title": c.title, "code": c.code, "line": text.count("\n", 0, c.edits[0].place.start) + 1,
            "text": edited(text, list(c.edits), path),
        }
        for c in corrections(workspace, path, 0, len(text))
    ]  # fmt: skip


def _hover(workspace: Workspace, path: Path, text: str, at: int) -> Answers:
    """Return the text in Markdown about the word at the character, with the word's place, if there is one."""
    about = hover(workspace, path, at)
    return [] if about is None else [{"start": about.place.start, "end": about.place.end, "text": about.text}]


def _complete(workspace: Workspace, path: Path, text: str, at: int) -> Answers:
    """Return the words that may stand at the character and begin as what is typed there; each with edits elsewhere, as of an import."""
    typed = re.findall(r"\w*\Z", text[:at])[0].lower()
    begun = [s for s in completion(workspace, path, at) if s.label.lower().startswith(typed)]
    return [
        {
            "label": s.label, "kind": s.kind, "detail": s.detail, "documentation": s.documentation, "insert": s.insert or s.label,
            "is_snippet": s.is_snippet, "typed": len(typed), "edits": [asdict(e) | {"place": [e.place.start, e.place.end]} for e in s.edits],
        }
        for s in begun[:MOST_WORDS]
    ]  # fmt: skip


QUESTIONS: Mapping[str, Callable[[Workspace, Path, str, int], Answers]] = {
    "corrections": _corrections, "hover": _hover, "complete": _complete,
}  # fmt: skip
