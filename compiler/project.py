"""Files that are being edited: their trees and errors after each change, at the cost of the pieces that changed.

`diagnostics` are those of `examination.check`. Each model's own errors are kept until a model or a name of a file that it reads changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import field
from functools import lru_cache
from pathlib import Path

from .compilation import Compilation, too_long
from .errors import CompilationFailed, Diagnostic
from .examination import look_at_equations, models_with
from .fast_dataclass import dataclass
from .garbage_collection import uncollected
from .scene import Scene
from .semantics.build import CheckedModel, check_model, check_sets, main_model
from .semantics.names.compound_units import shared_names, statements_with_compound_units
from .semantics.names.imports import Loader
from .semantics.names.scope import FileScope, ModelDefinition
from .semantics.resolution.elaboration_cache import MAXIMUM_PARTS, ElaborationCache
from .source import Source, move, read_text
from .syntax import SyntaxTree, tree
from .syntax.pieces import Piece, cut, read_piece, words_of

AT_ONCE = 20_000  # characters of a model and all that it uses, up to which it is checked at each key press
READS_FILES = frozenset(
    {"column", "fit"}
)  # words of models whose errors depend on files of numbers, which are not watched


@dataclass(frozen=True, slots=True, eq=False)
class EditedFile:
    """A file as it is now: its pieces, where they begin, and its tree. Of a piece that cannot be read at all, the tree has the last one of its name."""

    path: Path
    text: str
    pieces: tuple[Piece, ...]
    folded: tuple[tuple[tree.SyntaxNode, ...], ...]  # statements of each piece, compound units in one literal
    tree: SyntaxTree
    mistakes: tuple[Diagnostic, ...]

    @property
    def broken(self) -> frozenset[str]:
        """Names of models with lines that cannot be parsed."""
        names: set[str] = set()
        for piece in self.pieces:
            if piece.mistakes:
                names |= models_with(piece.mistakes, SyntaxTree(piece.source, piece.statements)) or {piece.model}
        return frozenset(names - {""})

    @property
    def is_broken_outside(self) -> bool:
        """True if a line outside of models cannot be parsed: then nothing is known of the names that it gives to all of them."""
        return any(
            p.mistakes
            and not (p.model and (not p.statements or models_with(p.mistakes, SyntaxTree(p.source, p.statements))))
            for p in self.pieces
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A checked model with all that its errors depend on; `places`: where that stands, as sentences may tell lines."""

    grounds: list[object]
    places: list[tuple[int, int]]
    checked: CheckedModel

    def holds(self, grounds: list[object], places: list[tuple[int, int]]) -> bool:
        """Return True if the errors are still the same."""
        if self.checked.diagnostics and places != self.places:
            return False
        same = (a is b or (type(a) is tuple and a == b) for a, b in zip(grounds, self.grounds, strict=False))
        return len(grounds) == len(self.grounds) and all(same)


@dataclass(slots=True, eq=False)
class FileSurvey:
    """Knowledge of a file: its names with those it imports, its models as they were checked, and its main model's stages if that has no errors."""

    file: FileScope
    diagnostics: tuple[Diagnostic, ...] = ()
    models: dict[str, CheckedModel] = field(default_factory=dict)
    is_complete: bool = True  # False if models were left for later
    main: Compilation | None = None


@dataclass(slots=True, eq=False)
class Project:
    """Files that are open, as they stand in the editor, and all that was read from the disk for them."""

    library: Path | None = None
    open_texts: dict[Path, str] = field(default_factory=dict)
    most_parts: int = MAXIMUM_PARTS
    _documents: dict[Path, EditedFile] = field(default_factory=dict)
    _stamps: dict[Path, tuple[int, int]] = field(default_factory=dict)
    _kept: dict[tuple[Path, str, bool], _Kept] = field(default_factory=dict)
    _mains: dict[Path, tuple[CheckedModel | None, Compilation, list[Diagnostic]]] = field(default_factory=dict)

    # ------------------------------------------------------------ files
    def document(self, path: Path, name: str = "") -> EditedFile:
        """Return a file as it is in the editor, else on the disk. Raises OSError and UnicodeDecodeError."""
        path = path.resolve()
        text, before = self.open_texts.get(path), self._documents.get(path)
        if text is None:
            status = path.stat()
            stamp = (status.st_mtime_ns, status.st_size)
            if before is not None and self._stamps.get(path) == stamp:
                return before
            text = read_text(path)
            self._stamps[path] = stamp
        else:
            self._stamps.pop(path, None)
        if before is None or before.text != text:
            with uncollected():
                self._documents[path] = before = _document(path, name or str(path), text, before)
        return before

    def _held(self, path: Path, name: str, wanted: Set[str]) -> SyntaxTree:
        """Return the tree of an imported file. Raises `CompilationFailed` if the models of these names, or what they name, have syntax errors."""
        document = self.document(path, name)
        words, rest, needed = set(wanted), list(document.pieces), list[Piece]()
        while used := [p for p in rest if not p.model or p.model in words]:
            rest = [p for p in rest if p not in used]
            needed += used
            for piece in used:
                words |= piece.words
        mistakes = [m for piece in needed for m in piece.mistakes]
        if mistakes:
            raise CompilationFailed(mistakes)
        return document.tree

    # ------------------------------------------------------------ errors
    def survey(self, path: Path, complete: bool = True) -> FileSurvey:
        """Return what is known of a file. If not `complete`, large models that must be looked at again are left for later.

        Raises OSError and UnicodeDecodeError for a file that cannot be read.
        """
        with uncollected():
            return self._survey(self.document(path), complete)

    def scope(self, path: Path) -> FileScope:
        """Return the names of a file with those it imports; nothing is checked. Raises OSError and UnicodeDecodeError."""
        with uncollected():
            return self._loaded(self.document(path))[0]

    def _loaded(self, document: EditedFile) -> tuple[FileScope, list[Diagnostic]]:
        loader = Loader(self.library, self._held)
        try:
            return loader.load(document.tree), loader.diagnostics
        except (CompilationFailed, RecursionError):
            return FileScope(document.tree.source), loader.diagnostics

    def _survey(self, document: EditedFile, complete: bool) -> FileSurvey:
        file, wrong_imports = self._loaded(document)
        definitions = [d for d in file.models.values() if d.file is file]
        main = main_model(file, None)
        for name in document.broken:
            file.models.pop(name, None)
        file.missing |= document.broken
        survey = FileSurvey(file)
        mistakes = [*document.mistakes, *wrong_imports]
        for definition in definitions:
            is_main = definition is main and not mistakes
            checked = self._checked(document, definition, is_main, complete)
            if checked is None:
                survey.is_complete = False
                checked = self._outdated(document, definition)
            if checked is not None:
                survey.models[definition.name] = checked
        if document.is_broken_outside:
            mistakes = list(document.mistakes)
        else:
            mistakes += [d for n, c in survey.models.items() if n not in document.broken for d in c.diagnostics]
            mistakes += check_sets(file, ElaborationCache(self.most_parts)) if file.sets else []
        if not mistakes and (main is not None or not (definitions or file.sets)) and (complete or survey.is_complete):
            mistakes = self._equations(document, survey, main, complete)
        survey.diagnostics = CompilationFailed(mistakes).diagnostics
        file.models.update({d.name: d for d in definitions})
        return survey

    def _checked(
        self, document: EditedFile, definition: ModelDefinition, is_main: bool, complete: bool
    ) -> CheckedModel | None:
        """Return the errors of one model: those from before if they still hold; None if they are left for later."""
        closure = list(_closure(definition))
        grounds, places = _grounds(closure), [item.model.span.source.before for item in closure]
        key = (document.path, definition.name, is_main)
        before = self._kept.get(key)
        if before is not None and before.holds(grounds, places):
            return before.checked
        if not complete and sum(len(item.model.span.source.text) for item in closure) > AT_ONCE:
            return None
        try:
            checked = check_model(definition, is_main, ElaborationCache(self.most_parts))
        except CompilationFailed as failed:  # a limit was passed
            checked = CheckedModel(list(failed.diagnostics), None, None)
        except RecursionError:
            checked = CheckedModel([too_long(document.tree)], None, None)
        if not any(READS_FILES & _words(item.model.span.source) for item in closure):
            self._kept[key] = _Kept(grounds, places, checked)
        return checked

    def _outdated(self, document: EditedFile, definition: ModelDefinition) -> CheckedModel | None:
        """Return the errors that a model had, if its own text is still the same."""
        results = (self._kept.get((document.path, definition.name, is_main)) for is_main in (True, False))
        return next((k.checked for k in results if k is not None and k.grounds[0] is definition.model), None)

    def _equations(
        self, document: EditedFile, survey: FileSurvey, main: ModelDefinition | None, complete: bool
    ) -> list[Diagnostic]:
        """Return the errors that the equations of the main model show; if there are none, the survey has its stages."""
        checked = None if main is None else survey.models[main.name]
        before = self._mains.get(document.path)
        if before is None or before[0] is not checked or checked is None:
            if not complete:
                survey.is_complete = False
                return []
            compilation = Compilation(document.tree.source, Scene(None, None), self.library, most_parts=self.most_parts)
            compilation.__dict__["tree"] = document.tree
            if checked is not None and checked.built is not None:
                compilation.__dict__["_built"] = checked.built
            before = (checked, compilation, look_at_equations(compilation)[0])
            self._mains[document.path] = before
        if checked is not None and checked.built is not None:
            survey.main = before[1]
        return before[2]


def _document(path: Path, name: str, text: str, before: EditedFile | None) -> EditedFile:
    """Return a file with this text. Pieces that it had before are kept."""
    old: dict[str, list[Piece]] = {}
    last: dict[str, Piece] = {}
    folded: dict[Piece, tuple[tree.SyntaxNode, ...]] = {}
    if before is not None:
        name = before.tree.source.name
        for piece, statements in zip(before.pieces, before.folded, strict=True):
            old.setdefault(piece.text, []).append(piece)
            last[piece.model] = piece
            folded[piece] = statements
    pieces, characters, lines = [], 0, 0
    for part in cut(text):
        piece = old[part].pop(0) if old.get(part) else _after(read_piece(name, path, part), last)
        for source in piece.sources:
            move(source, characters, lines)
        characters, lines = characters + len(part), lines + part.count("\n")
        pieces.append(piece)
    return _assembled(path, name, text, tuple(pieces), before, folded)


def _after(piece: Piece, last: Mapping[str, Piece]) -> Piece:
    """Return a piece as it was read; of one that cannot be read at all, with the statements of the last one of its name."""
    before = last.get(piece.model)
    if piece.statements or not piece.mistakes or before is None:
        return piece
    return Piece(
        piece.text, (*piece.sources, before.source), piece.model, before.statements, piece.mistakes, piece.words
    )


def _assembled(
    path: Path, name: str, text: str, pieces: tuple[Piece, ...], before: EditedFile | None,
    folded: Mapping[Piece, tuple[tree.SyntaxNode, ...]],
) -> EditedFile:  # fmt: skip
    source = Source(name, text, path)
    shared = shared_names(tuple(s for p in pieces for s in p.statements))
    if before is None or shared != shared_names(before.tree.statements):
        folded = {}
    statements = tuple(
        folded[p] if p in folded else statements_with_compound_units(p.statements, p.text, shared) for p in pieces
    )
    whole = SyntaxTree(source, tuple(s for part in statements for s in part))
    return EditedFile(path, text, pieces, statements, whole, tuple(m for p in pieces for m in p.mistakes))


# ---------------------------------------------------------------- what a model's errors depend on


def _closure(definition: ModelDefinition) -> Iterator[ModelDefinition]:
    """Yield a model and all models that its text names, at any depth."""
    rest, visited = [definition], {id(definition)}
    while rest:
        item = rest.pop()
        yield item
        for name in sorted(_words(item.model.span.source) & item.file.models.keys()):
            other = item.file.models[name]
            if id(other) not in visited:
                visited.add(id(other))
                rest.append(other)


def _grounds(closure: Sequence[ModelDefinition]) -> list[object]:
    """Return everything on which the errors of a model depend: the models behind it, and what their files give to all of their models."""
    grounds: list[object] = [item.model for item in closure]
    for file in {id(item.file): item.file for item in closure}.values():
        grounds += [item for item, _ in file.constants.values()]
        grounds += file.functions.values()
        grounds += [defined.syntax for defined in file.sets.values()]
        grounds += (tuple(sorted(file.missing)), tuple(sorted(file.models)))
    return grounds


@lru_cache(4096)
def _words(source: Source) -> frozenset[str]:
    """Names in a piece of a file."""
    return words_of(source.text)
