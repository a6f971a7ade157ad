"""Files and their imports. Nothing outside the project folder is read."""

from __future__ import annotations

from pathlib import Path

from ...errors import CompilationFailed, Diagnostic
from ...source import Source, Span, read_text
from ...syntax import SyntaxTree, parse, tree
from .domain_table import ELEMENT_KINDS
from .errors import Cycle, DuplicateName, ReservedName, TooMany, TooManyMistakes, WrongImport
from .project_folder import is_there, project_folder, within_project
from .scope import RESERVED, FileScope, ModelDefinition
from .statement_errors import MAXIMUM_MISTAKES, Wrong, suggestion

MAXIMUM_FILES = 500


class Loader:
    """Loader of a file and its imports. Errors are collected."""

    def __init__(self, library: Path | None) -> None:
        self.library = library
        self.files: dict[Path, FileScope] = {}
        self.diagnostics: list[Diagnostic] = []

    def load(self, syntax: SyntaxTree) -> FileScope:
        root = project_folder(syntax.source.path) if syntax.source.path else None
        return self._file(syntax, root, ())

    def _file(self, syntax: SyntaxTree, root: Path | None, chain: tuple[Path, ...]) -> FileScope:
        scope = FileScope(syntax.source, {}, {}, {}, root=root, library=self.library)
        if syntax.source.path is not None:
            self.files[syntax.source.path.resolve()] = scope
            chain = (*chain, syntax.source.path.resolve())
        seen: dict[str, Span] = {}
        for statement in syntax.statements:
            match statement:
                case tree.ModelSyntax():
                    if statement.name in ELEMENT_KINDS:
                        self.diagnostics.append(ReservedName(statement.name_span, statement.name))
                        scope.missing.add(statement.name)  # the name may mean this model or the element kind
                    elif self._new(seen, statement.name, statement.name_span):
                        scope.models[statement.name] = ModelDefinition(statement, scope)
                case tree.FunctionSyntax():
                    if self._new(seen, statement.name, statement.span):
                        scope.functions[statement.name] = statement
                case tree.Quantities():
                    for item in statement.items:
                        if self._new(seen, item.name, item.span):
                            scope.constants[item.name] = (item, statement)
        for statement in syntax.statements:
            if isinstance(statement, tree.Import):
                if len(self.diagnostics) >= MAXIMUM_MISTAKES:
                    raise CompilationFailed([*self.diagnostics, TooManyMistakes(statement.span, MAXIMUM_MISTAKES)])
                try:
                    self._import(statement, scope, root, chain, seen)
                except Wrong as wrong:
                    self.diagnostics.append(wrong.diagnostic)
        return scope

    def _new(self, seen: dict[str, Span], name: str, span: Span) -> bool:
        if name in RESERVED:
            self.diagnostics.append(ReservedName(span, name))
            return False
        if name in seen:
            self.diagnostics.append(DuplicateName(span, name, seen[name]))
            return False
        seen[name] = span
        return True

    def _import(
        self,
        statement: tree.Import,
        scope: FileScope,
        root: Path | None,
        chain: tuple[Path, ...],
        seen: dict[str, Span],
    ) -> None:
        scope.missing |= {name for name, _ in statement.names}
        target = self._locate(statement, scope, root)
        if target in chain:
            names = " -> ".join(p.name for p in (*chain[chain.index(target) :], target))
            raise Wrong(Cycle(statement.span, "These files import each other", names))
        loaded = self.files.get(target)
        if loaded is None:
            if len(self.files) >= MAXIMUM_FILES:
                raise Wrong(TooMany(statement.span, "Imported files", MAXIMUM_FILES))
            try:
                source = Source(_shown(target, scope.source), read_text(target), target)
                loaded = self._file(parse(source), root, chain)
            except OSError as error:
                what = f"`{statement.place}` cannot be read"
                raise Wrong(WrongImport(statement.span, what, str(error.strerror or error))) from None
            except UnicodeDecodeError:
                what = f"`{statement.place}` is not a text in UTF-8"
                raise Wrong(WrongImport(statement.span, what, "Only .bg files can be imported.")) from None
            except CompilationFailed as failed:
                self.diagnostics += failed.diagnostics
                return
        for name, span in statement.names:
            if name in loaded.models:
                if self._new(seen, name, span):
                    scope.models[name] = loaded.models[name]
                    scope.missing.discard(name)
            else:
                hint = suggestion(name, list(loaded.models), f"It defines: {', '.join(loaded.models) or 'no model'}.")
                self.diagnostics.append(WrongImport(span, f"There is no model `{name}` in {statement.place}", hint))

    def _locate(self, statement: tree.Import, scope: FileScope, root: Path | None) -> Path:
        if not statement.is_file:
            target = (self.library / f"{statement.place}.bg").resolve() if self.library is not None else None
            if target is None or not is_there(target):
                known = sorted(p.stem for p in self.library.glob("*.bg")) if self.library is not None else []
                otherwise = 'A file beside this one stands in quotation marks: `from "parts.bg"`.'
                hint = suggestion(statement.place, known, otherwise)
                raise Wrong(WrongImport(statement.span, f"There is no library `{statement.place}`", hint))
            return target
        if scope.source.path is None or root is None:
            what = f"`{statement.place}` cannot be found: this text is no file"
            hint = "Save the model as a file to import from files beside it."
            raise Wrong(WrongImport(statement.span, what, hint))
        target = (scope.source.path.parent / statement.place).resolve()  # links are resolved before the check
        if not within_project(target, root, self.library):
            hint = "Only files below the project folder are read: that of the nearest `bondgraph.toml` or `pyproject.toml` above the file, else its own."
            what = f"`{statement.place}` lies outside the project folder"
            raise Wrong(WrongImport(statement.span, what, hint))
        if target.suffix != ".bg" or not is_there(target):
            near = [p.name for p in scope.source.path.parent.glob("*.bg")]
            hint = suggestion(statement.place, near, "The path is relative to the file with the import.")
            raise Wrong(WrongImport(statement.span, f"There is no file `{statement.place}`", hint))
        return target


def _shown(path: Path, importer: Source) -> str:
    """Name of an imported file, written in the same way as the importing file's name."""
    if importer.path is not None:
        try:
            return str(Path(importer.name).parent / path.relative_to(importer.path.resolve().parent))
        except ValueError:
            pass
    return path.name
