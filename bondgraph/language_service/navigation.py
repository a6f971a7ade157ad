"""Ways from name to name: its definition, all that refers to it, and another name in all files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from compiler.api import ELEMENT_KINDS, RESERVED, SYSTEM, UNIT, DeclaredName, NameUse, path_of, tree

from ..compiled_model import LIBRARY
from .answers import OutlineNode, TextEdit, TextPlace
from .outline import outline
from .workspace import Workspace, place_of

MOST_SYMBOLS = 200


def definition(workspace: Workspace, path: Path, at: int) -> TextPlace | None:
    """Return where the name at a character is declared; of a file that is imported, its beginning; None for a unit, which is no text."""
    occurrence = workspace.occurrence_at(path, at)
    if occurrence is None or occurrence.name is None:
        place = _imported_file(workspace, path, at)
    else:
        place = place_of(occurrence.name.span)
    return None if place is None or place.path.suffix in (UNIT, SYSTEM) else place


def _imported_file(workspace: Workspace, path: Path, at: int) -> TextPlace | None:
    document, _ = workspace.names(path)
    for statement in document.tree.statements:
        if isinstance(statement, tree.Import) and statement.span.offset <= at <= place_of(statement.span).end:
            target = path.parent / statement.place if statement.is_file else LIBRARY / f"{statement.place}.bg"
            if target.is_file():
                return TextPlace(target.resolve(), 0, 0)
    return None


def references(workspace: Workspace, path: Path, at: int, with_definition: bool = True) -> list[TextPlace]:
    """Return all places that refer to the name at a character, in all files that may."""
    occurrence = workspace.occurrence_at(path, at)
    if occurrence is None or occurrence.name is None:
        return []
    return list(_places_of(workspace, occurrence.name, with_definition))


def _places_of(workspace: Workspace, name: DeclaredName, with_definition: bool = True) -> Iterator[TextPlace]:
    for file in _files_with(workspace, name):
        for other in workspace.occurrences(file):
            if other.name == name and (with_definition or not other.is_definition) and path_of(other.span) == file:
                yield place_of(other.span)


def _files_with(workspace: Workspace, name: DeclaredName) -> Iterator[Path]:
    """Yield the files that have a word and can mean this name by it: its own, and those that import from files, or from its library."""
    word = re.compile(rf"\b{re.escape(name.name)}\b")
    imports = re.compile(rf'\bfrom\s*(?:"|{re.escape(name.path.stem)}\b)')
    for file in workspace.files(name.path):
        try:
            text = workspace.text(file)
        except (OSError, UnicodeDecodeError):
            continue  # a file that cannot be read refers to nothing
        if word.search(text) and (file == name.path or imports.search(text)):
            yield file


def rename_place(workspace: Workspace, path: Path, at: int) -> TextPlace | None:
    """Return the place of a name that can be changed; None for words of the language and of the library."""
    occurrence = workspace.occurrence_at(path, at)
    name = None if occurrence is None else occurrence.name
    # A member of a set is handed over to parameters of its name.
    if occurrence is None or name is None or name.kind == "member" or name.path.is_relative_to(LIBRARY.resolve()):
        return None
    return place_of(occurrence.span)


def rename(workspace: Workspace, path: Path, at: int, new: str) -> list[TextEdit] | str:
    """Return the edits that give a name another one in all files; or a sentence why it cannot be."""
    occurrence = workspace.occurrence_at(path, at)
    if rename_place(workspace, path, at) is None or occurrence is None or occurrence.name is None:
        return "There is no name here that can be changed."
    name = occurrence.name
    if not re.fullmatch(r"[A-Za-z_]\w*", new, re.ASCII):
        return f"`{new}` is no name: letters, digits and `_`, and no digit first."
    if new in RESERVED or (name.kind == "model" and new in ELEMENT_KINDS):
        return f"`{new}` is reserved."
    files = map(workspace.project.document, _files_with(workspace, name))
    broken = [f.path for f in files if any(piece.mistakes and name.name in piece.words for piece in f.pieces)]
    if broken:
        return f"`{broken[0].name}` has lines that cannot be read, in which the name may stand: mend them first."
    edits = [TextEdit(place, new) for place in _places_of(workspace, name)]
    if not _means_the_same(workspace, edits, name, new):
        return f"With the name `{new}` a word would mean something else: it is a name, a unit or a letter of a law already."
    return edits


def _means_the_same(workspace: Workspace, edits: list[TextEdit], name: DeclaredName, new: str) -> bool:
    """Return True if after the edits each word still refers to what it refers to now."""
    files = {edit.place.path for edit in edits}
    texts = {file: edited(workspace.project.document(file).text, edits, file) for file in files}
    after = Workspace()
    after.project.open_texts.update(workspace.project.open_texts | texts)
    taken = (name.path, name.owner, new)
    if any(
        o.name is not None and (o.name.path, o.name.owner, o.name.name) == taken
        for f in files
        for o in workspace.occurrences(f)
    ):
        return False
    return all(
        [_meaning(o, name, new) for o in workspace.occurrences(file)]
        == [_meaning(o, name, "") for o in after.occurrences(file)]
        for file in files
    )


def _meaning(occurrence: NameUse, renamed: DeclaredName, new: str) -> tuple[object, ...]:
    """Owner and name of what a word refers to, with the new name for what is renamed, and whether it declares it."""
    name = occurrence.name
    if name is None:
        return occurrence.kind, occurrence.span.text, occurrence.is_definition
    word = new if new and name == renamed else name.name
    owner = [new if new and _is_owner(name, renamed, level) else o for level, o in enumerate(name.owner)]
    return name.path, tuple(owner), word, occurrence.is_definition


def _is_owner(name: DeclaredName, renamed: DeclaredName, level: int) -> bool:
    """Return True if the owner of a name at a level is what is renamed."""
    return name.path == renamed.path and (*renamed.owner, renamed.name) == name.owner[: level + 1]


def edited(text: str, edits: list[TextEdit], file: Path) -> str:
    """Return the text of a file with those of the edits that are in it."""
    for edit in sorted((e for e in edits if e.place.path == file), key=lambda e: -e.place.start):
        text = text[: edit.place.start] + edit.text + text[edit.place.end :]
    return text


def workspace_symbols(workspace: Workspace, query: str) -> list[OutlineNode]:
    """Return the models, and what they declare, whose names have the letters of a query in their order."""
    letters = re.compile(".*?".join(map(re.escape, query)), re.IGNORECASE)
    listed: list[OutlineNode] = []
    for file in workspace.files():
        try:
            nodes = outline(workspace, file)
        except (OSError, UnicodeDecodeError):
            continue
        listed += [n for n in _flat(nodes) if letters.search(n.name)]
        if len(listed) >= MOST_SYMBOLS:
            break
    return sorted(listed, key=lambda n: (n.name.lower() != query.lower(), len(n.name), n.name))[:MOST_SYMBOLS]


def _flat(nodes: list[OutlineNode]) -> Iterator[OutlineNode]:
    for node in nodes:
        yield node
        yield from _flat(list(node.children))
