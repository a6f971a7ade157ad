"""Files of an editor and the folders that it shows: the one state of the service."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from compiler import api
from compiler.api import CompilationFailed, Diagnostic, Source, format_text

from ..compiled_model import LIBRARY, most_parts
from ..presentation.text.causality import CausalityExplanation
from .answers import TextPlace, TextProblem
from .facts import strokes

MOST_FILES = 2000  # files of a folder that are searched for a name


@dataclass(slots=True, eq=False, repr=False)  # trees of all files are no text
class Workspace:
    """Open texts and folders. Texts are replaced as a whole; only the pieces that changed are read again."""

    folders: list[Path] = field(default_factory=list)
    project: api.Project = field(default_factory=lambda: api.Project(LIBRARY.resolve(), most_parts=most_parts()))
    _surveys: dict[Path, tuple[api.EditedFile, api.FileSurvey]] = field(default_factory=dict)
    _occurrences: dict[Path, tuple[api.FileScope, list[api.NameUse]]] = field(default_factory=dict)
    _strokes: dict[Path, tuple[api.Compilation, CausalityExplanation | None]] = field(default_factory=dict)

    def open(self, path: Path, text: str) -> None:
        """Take a text for that of a file, whatever the disk says."""
        self.project.open_texts[path.resolve()] = text

    def close(self, path: Path) -> None:
        """Read a file from the disk again."""
        self.project.open_texts.pop(path.resolve(), None)

    def survey(self, path: Path, complete: bool = False) -> api.FileSurvey:
        """Return what is known of a file now; large models may be those of an earlier text unless it shall be `complete`."""
        survey = self.project.survey(path, complete)
        self._surveys[path.resolve()] = (self.project.document(path), survey)
        return survey

    def names(self, path: Path, complete: bool = False) -> tuple[api.EditedFile, api.FileSurvey]:
        """Return a file with its names, from the last survey of this text if there is one (and it is `complete`, where that is asked for)."""
        document = self.project.document(path)
        before = self._surveys.get(path.resolve())
        if before is not None and before[0] is document and (before[1].is_complete or not complete):
            return before
        self.survey(path, complete)
        return self._surveys[path.resolve()]

    def occurrences(self, path: Path) -> list[api.NameUse]:
        """Return all names of a file and the places that refer to them, in the order of the text. Nothing is checked for that."""
        path, document = path.resolve(), self.project.document(path)
        surveyed, before = self._surveys.get(path), self._occurrences.get(path)
        file = surveyed[1].file if surveyed is not None and surveyed[0] is document else None
        if before is None or file is None or before[0] is not file:
            file = self.project.scope(path) if file is None else file
            with api.uncollected():
                found: dict[tuple[int, str], api.NameUse] = {}
                # Transitions name their mode where it is declared.
                for use in api.name_uses(file, document.tree.statements):
                    found.setdefault((use.span.offset, use.span.source.name), use)
                listed = [found[place] for place in sorted(found)]
            before = self._occurrences[path] = (file, listed)
        return before[1]

    def occurrence_at(self, path: Path, at: int) -> api.NameUse | None:
        """Return the name at a character, or that ends there."""
        path = path.resolve()
        near = [o for o in self.occurrences(path) if o.span.offset <= at <= o.span.offset + len(o.span.text)]
        near = [o for o in near if api.path_of(o.span) == path]
        return max(near, key=lambda o: (o.name is not None, o.span.offset), default=None)

    def strokes(self, path: Path) -> CausalityExplanation | None:
        """Return the explanation of all strokes of a file's main model; None if it has errors, or there is none."""
        main = self.names(path)[1].main
        if main is None:
            return None
        before = self._strokes.get(path.resolve())
        if before is None or before[0] is not main:
            before = self._strokes[path.resolve()] = (main, strokes(main))
        return before[1]

    def files(self, *starts: Path) -> Iterator[Path]:
        """Yield the files of the editor, of its folders, and of the projects of some files (default: of those that are open)."""
        own = [p for p in starts or self.project.open_texts if not p.is_relative_to(LIBRARY.resolve())]
        folders = dict.fromkeys([*self.folders, *map(api.project_folder, own)])
        listed = (p.resolve() for folder in folders for p in _models_in(folder))
        yield from dict.fromkeys([*self.project.open_texts, *starts, *listed])

    def text(self, path: Path) -> str:
        """Return the text of a file, unread. Raises OSError and UnicodeDecodeError."""
        text = self.project.open_texts.get(path)
        return api.read_text(path) if text is None else text


def _models_in(folder: Path) -> Iterable[Path]:
    listed: list[Path] = []
    for path in folder.rglob("*.bg"):
        if not any(part.startswith(".") for part in path.relative_to(folder).parts):
            listed.append(path)
        if len(listed) >= MOST_FILES:
            break
    return sorted(listed)


def place_of(span: api.Span) -> TextPlace:
    """The place of a span in its file."""
    return TextPlace(api.path_of(span), span.offset, span.offset + span.end - span.start)


def formatted(workspace: Workspace, path: Path) -> str | None:
    """Return the text as `bondgraph fmt` writes it; None for one that cannot be read."""
    document = workspace.project.document(path)
    try:
        return format_text(Source(str(path), document.text, path))
    except CompilationFailed:
        return None


def problems(workspace: Workspace, path: Path, complete: bool = True) -> tuple[list[TextProblem], bool]:
    """Return all errors of a file and of what it imports, and whether these are all: large models are looked at only if `complete`."""
    survey = workspace.survey(path, complete)
    return [problem(d) for d in survey.diagnostics], survey.is_complete


def problem(diagnostic: Diagnostic) -> TextProblem:
    """A diagnostic as data."""
    related = tuple((place_of(span), why) for span, why in (*diagnostic.related(), *diagnostic.stands))
    return TextProblem(place_of(diagnostic.span), diagnostic.code, diagnostic.sentence, diagnostic.help, related)
