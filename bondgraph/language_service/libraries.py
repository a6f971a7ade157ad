"""Models of other files: those that an import may name, and library parts with the import that they need."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from compiler.api import SYSTEM, UNIT, EditedFile, FileScope, first_text, table_of, tree

from ..compiled_model import LIBRARY
from .answers import Suggestion, TextEdit, TextPlace
from .context import Context
from .workspace import Workspace


def import_suggestions(workspace: Workspace, path: Path, context: Context) -> Iterator[Suggestion]:
    """Yield what may stand in an import: names of models, libraries, files."""
    words = [w.text for w in context.statement]
    if "from" in words or context.is_silent:
        yield from (
            Suggestion(p.stem, "library", first_text(workspace.project.document(p).tree.statements))
            for p in sorted(LIBRARY.glob("*.bg"))
            if not context.is_silent
        )
        for file in sorted(path.parent.glob("*")):
            if file.suffix in (".bg", UNIT, SYSTEM) and file.name != path.name:
                yield Suggestion(file.name, "file", insert=file.name if context.is_silent else f'"{file.name}"')
        return
    if len(words) > 1 and words[-1] != ",":
        yield Suggestion("from", "keyword")
        return
    for library in sorted(LIBRARY.glob("*.bg")):
        for name, model in workspace.project.document(library).tree.models.items():
            insert = f"{name} from {library.stem}" if len(words) == 1 else name
            yield Suggestion(name, "model", library.stem, _text(model), insert)


def library_models(workspace: Workspace, document: EditedFile, file: FileScope) -> Iterator[Suggestion]:
    """Yield the parts of the library that a file does not import yet, with the line that does."""
    for library in sorted(LIBRARY.glob("*.bg")):
        if library.resolve() == document.path:
            continue
        for name, model in workspace.project.document(library).tree.models.items():
            if name not in file.models:
                yield part_suggestion(name, model, library.stem, import_edits(document, name, library.stem))


def import_edits(document: EditedFile, name: str, library: str) -> tuple[TextEdit, ...]:
    """Return the edit by which a file imports a model of a library: in the line that imports others of it, else in a new one."""
    imports = [
        s
        for s in document.tree.statements
        if isinstance(s, tree.Import) and s.span.source.path == document.tree.source.path
    ]
    for statement in imports:
        if not statement.is_file and statement.place == library:
            end = statement.names[-1][1]
            at = end.offset + len(end.text)
            return (TextEdit(TextPlace(document.path, at, at), f", {name}"),)
    at = document.text.find("\n", imports[-1].span.offset) + 1 if imports else 0
    if imports and not at:
        last = len(document.text)
        return (TextEdit(TextPlace(document.path, last, last), f"\nimport {name} from {library}\n"),)
    return (TextEdit(TextPlace(document.path, at, at), f"import {name} from {library}\n" + "\n" * (not imports)),)


def part_suggestion(
    name: str, model: tree.ModelSyntax, library: str = "", edits: tuple[TextEdit, ...] = ()
) -> Suggestion:
    """An instance of a model, with its parameters that have no value, or else its first three."""
    items = [n.node for n in table_of(model).values() if n.kind == "parameter" and isinstance(n.node, tree.Item)]
    needed = [i for i in items if i.value is None] or items[:3]
    set_ones = [f"{i.name} = ${{{k}:{_value(i)}}}" for k, i in enumerate(needed, 2)]
    braces = f" {{ {', '.join(set_ones)} }}" if set_ones else ""
    detail = f"from {library}" if library else "model"
    return Suggestion(
        name, "model", detail, _text(model), f"{name} ${{1:{name[0].lower()}{name[1:]}}}{braces}", True, edits
    )


def _value(item: tree.Item) -> str:
    if item.value is None:
        return "1"
    words = item.value.span.words.replace("}", "")
    return f"{words} [{item.unit.span.words}]" if item.unit is not None and words.replace(".", "").isdigit() else words


def _text(model: tree.ModelSyntax) -> str:
    text = first_text(model.statements)
    ports = [f"`{n.name}`: {n.type} {n.description}".strip() for n in table_of(model).values() if n.kind == "port"]
    return "\n\n".join(filter(None, [text, ", ".join(ports)]))
