"""Other words for names: in one text, and of a file with its imports, which become one text."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from ..errors import CompilationFailed
from ..semantics.names.compound_units import with_compound_units
from ..semantics.names.declared_names import DeclaredName, model_name
from ..semantics.names.imports import Loader
from ..semantics.names.name_uses import NameUse, name_uses
from ..semantics.names.scope import FileScope, ModelDefinition
from ..source import Source
from ..syntax import SyntaxTree, parse, tree
from ..syntax.blocks import Statements, flat
from .printing import text_of


@dataclass(frozen=True, slots=True)
class NamedText:
    """Statements of one text, and the names in it."""

    statements: Statements
    file: FileScope

    @property
    def models(self) -> dict[str, ModelDefinition]:
        return self.file.models


def parsed(text: str) -> Statements:
    return _tree(text).statements


def _tree(text: str) -> SyntaxTree:
    return with_compound_units(parse(Source("one.bg", text)))


def as_file(statements: Statements) -> NamedText:
    """Statements with their names looked up."""
    syntax = _tree(text_of(statements))
    return NamedText(syntax.statements, Loader(None).load(syntax))


def has_branches(model: tree.ModelSyntax) -> bool:
    """Return True for a model with conditional parts: one name may stand for several things."""
    return any(isinstance(s, tree.ConditionalSyntax) for s in flat(model.statements))


def in_other_words(text: str, uses: Iterable[NameUse], word: Callable[[DeclaredName], str]) -> str:
    """A text with new words for its names; ports in the parentheses of an element keep theirs."""
    names = {use.span: use.name for use in uses if use.name is not None and use.name.kind != "component"}
    pieces, last = list[str](), 0
    for span, name in sorted(names.items(), key=lambda item: item[0].start):
        pieces += [text[last : span.start], word(name)]
        last = span.end
    return "".join([*pieces, text[last:]])


def bundled(source: Source, library: Path | None) -> Statements:
    """A file and its imports as the statements of one text; equal names of several files get a number.

    `library`: folder of the files that are imported by a name. Raises `CompilationFailed`.
    """
    loader = Loader(library)
    main = loader.load(with_compound_units(parse(source)))
    if loader.diagnostics:
        raise CompilationFailed(loader.diagnostics)
    taken: dict[str, DeclaredName] = {}
    words: dict[DeclaredName, str] = {}

    def word(name: DeclaredName) -> str:
        if name.owner:
            return name.name
        if name not in words:
            new, number = name.name, 1
            while taken.setdefault(new, name) != name:
                number += 1
                new = f"{name.name}_{number}"
            words[name] = new
        return words[name]

    for definition in main.models.values():
        word(model_name(definition))
    used = _used(main)
    statements: list[tree.SyntaxNode] = []
    for file in (*(f for f in loader.files.values() if f is not main), main):
        whole = with_compound_units(parse(file.source)).statements
        kept = [
            not isinstance(s, tree.Import | tree.Description)
            and not (isinstance(s, tree.ModelSyntax) and model_name(ModelDefinition(s, file)) not in used)
            for s in whole
        ]
        own = tuple(s for s, is_kept in zip(whole, kept, strict=True) if is_kept)
        renamed = parsed(in_other_words(file.source.text, name_uses(file, own), word))
        statements += [s for s, is_kept in zip(renamed, kept, strict=True) if is_kept]
    return tuple(statements)


def _used(main: FileScope) -> set[DeclaredName]:
    """The models of a file and all that they use."""
    used: set[DeclaredName] = set()
    waiting = [d for d in main.models.values() if d.file is main]
    while waiting:
        definition = waiting.pop()
        if (name := model_name(definition)) not in used:
            used.add(name)
            uses = name_uses(definition.file, (definition.model,))
            kinds = (use.span.text for use in uses if use.name is not None and use.name.kind == "model")
            waiting += [definition.file.models[kind] for kind in kinds]
    return used
