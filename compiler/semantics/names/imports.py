"""Files and their imports. Nothing outside the project folder is read."""

from __future__ import annotations

from collections.abc import Callable, Set
from pathlib import Path

from ...errors import CompilationFailed, Diagnostic
from ...source import SYSTEM, UNIT, Source, Span, read_text
from ...syntax import SyntaxTree, parse, tree
from ...syntax.outline import Outline
from .compound_units import with_compound_units
from .domain_table import ELEMENT_KINDS
from .errors import Cycle, DuplicateName, ReservedName, TooMany, TooManyMistakes, WrongImport
from .scope import RESERVED, FileScope, ModelDefinition, SetDefinition
from .statement_errors import MAXIMUM_MISTAKES, NotImportable, Wrong, suggestion

MAXIMUM_FILES = 500


def project_folder(file: Path) -> Path:
    """The nearest ancestor with a `bondgraph.toml` or `pyproject.toml`; else the file's own folder."""
    for folder in file.resolve().parents:
        if (folder / "bondgraph.toml").is_file() or (folder / "pyproject.toml").is_file():
            return folder
    return file.resolve().parent


def within_project(target: Path, root: Path, library: Path | None) -> bool:
    """Return True if a file, with links resolved, lies in the project folder or in the library."""
    return target.is_relative_to(root) or (library is not None and target.is_relative_to(library.resolve()))


def is_there(target: Path) -> bool:
    """Return True if a file can be read there; False for names that the file system cannot hold."""
    try:
        return target.is_file()
    except (OSError, ValueError):
        return False


class Loader:
    """Loader of a file and its imports. Errors are collected.

    `held`: trees of files that somebody holds, by path and name; None for a file that is to be read.
    """

    def __init__(
        self, library: Path | None, held: Callable[[Path, str, Set[str]], SyntaxTree | None] | None = None
    ) -> None:
        self.library, self.held = library, held
        self.files: dict[Path, FileScope] = {}
        self.diagnostics: list[Diagnostic] = []

    def load(self, syntax: SyntaxTree) -> FileScope:
        root = project_folder(syntax.source.path) if syntax.source.path else None
        scope = FileScope(syntax.source, root, self.library)
        return self._declare(scope, syntax, ())

    def _declare(self, scope: FileScope, syntax: SyntaxTree, chain: tuple[Path, ...]) -> FileScope:
        """Put the statements of a file, or of a part of it, into its scope; `chain`: files that import each other, down to this one."""
        if scope.source.path is not None:
            self.files[scope.source.path.resolve()] = scope
            chain = (*chain, scope.source.path.resolve())
        for statement in syntax.statements:
            match statement:
                case tree.ModelSyntax():
                    if statement.name in ELEMENT_KINDS:
                        self.diagnostics.append(ReservedName(statement.name_span, statement.name))
                        scope.missing.add(statement.name)  # the name may mean this model or the element kind
                    elif self._new(scope, statement.name, statement.name_span):
                        scope.models[statement.name] = ModelDefinition(statement, scope)
                case tree.ParameterSet():
                    if self._new(scope, statement.name, statement.span):
                        scope.sets[statement.name] = SetDefinition(statement, scope)
                case tree.FunctionSyntax():
                    if self._new(scope, statement.name, statement.span):
                        scope.functions[statement.name] = statement
                case tree.Quantities():
                    for item in statement.items:
                        if self._new(scope, item.name, item.span):
                            scope.constants[item.name] = (item, statement)
        for statement in syntax.statements:
            if isinstance(statement, tree.Import):
                if len(self.diagnostics) >= MAXIMUM_MISTAKES:
                    raise CompilationFailed([*self.diagnostics, TooManyMistakes(statement.span, MAXIMUM_MISTAKES)])
                try:
                    self._import(statement, scope, chain)
                except Wrong as wrong:
                    self.diagnostics.append(wrong.diagnostic)
        return scope

    def _new(self, scope: FileScope, name: str, span: Span) -> bool:
        if name in RESERVED:
            self.diagnostics.append(ReservedName(span, name))
            return False
        if name in scope.places:
            self.diagnostics.append(DuplicateName(span, name, scope.places[name]))
            return False
        scope.places[name] = span
        return True

    def _import(self, statement: tree.Import, scope: FileScope, chain: tuple[Path, ...]) -> None:
        scope.missing |= {name for name, _ in statement.names}
        target = self._locate(statement, scope)
        if target in chain:
            circle = " -> ".join(p.name for p in (*chain[chain.index(target) :], target))
            raise Wrong(Cycle(statement.span, "These files import each other", circle))
        loaded = self.files.get(target)
        names = {name for name, _ in statement.names}
        try:
            if loaded is None:
                if len(self.files) >= MAXIMUM_FILES:
                    raise Wrong(TooMany(statement.span, "Imported files", MAXIMUM_FILES))
                loaded = self._read(target, scope, names, chain)
            elif loaded.outline is not None and names & loaded.outline.unused.keys():
                self._declare(loaded, with_compound_units(parse(loaded.source, loaded.outline.next_text(names))), chain)
        except OSError as error:
            what = f"`{statement.place}` cannot be read"
            raise Wrong(WrongImport(statement.span, what, str(error.strerror or error))) from None
        except UnicodeDecodeError:
            what = f"`{statement.place}` is not a text in UTF-8"
            raise Wrong(WrongImport(statement.span, what, "Only .bg files can be imported.")) from None
        except NotImportable as wrong:
            raise Wrong(WrongImport(statement.span, f"`{statement.place}` cannot be imported: {wrong.args[0]}", wrong.args[1])) from None  # fmt: skip
        except CompilationFailed as failed:
            self.diagnostics += failed.diagnostics
            return
        models = {} if loaded.outline is None else loaded.outline.models
        defined = list(dict.fromkeys([*models, *loaded.models, *loaded.sets]))
        for name, span in statement.names:
            if name not in loaded.models and name not in loaded.sets:
                hint = suggestion(name, defined, f"It defines: {', '.join(defined) or 'nothing to import'}.")
                what = f"There is no model or set `{name}` in {statement.place}"
                self.diagnostics.append(WrongImport(span, what, hint))
            elif self._new(scope, name, span):
                if name in loaded.models:
                    scope.models[name] = loaded.models[name]
                else:
                    scope.sets[name] = loaded.sets[name]
                scope.missing.discard(name)

    def _read(self, target: Path, importer: FileScope, names: set[str], chain: tuple[Path, ...]) -> FileScope:
        """Read the models of a file that have these names, with what they name.

        Raises OSError, UnicodeDecodeError, NotImportable and `CompilationFailed`.
        """
        name = _shown(target, importer.source)
        if target.suffix == UNIT:
            from .unit_file import read_unit_description, unit_model

            text = unit_model(read_unit_description(target), name, target)
            loaded = FileScope(text, importer.root, self.library)
            return self._declare(loaded, parse(text), chain)
        if target.suffix == SYSTEM:
            from .unit_file import read_system

            text, units = read_system(target, name)
            loaded = FileScope(text, importer.root, self.library)
            for word, source in units.items():
                scope = FileScope(source, importer.root, self.library)
                loaded.models[word] = self._declare(scope, parse(source), chain).models[word]
                self.files.popitem()  # it lies in the archive, which is the file
            return self._declare(loaded, parse(text), chain)
        tree = None if self.held is None else self.held(target, name, names)
        if tree is not None:
            loaded = FileScope(tree.source, importer.root, self.library)
            return self._declare(loaded, tree, chain)
        source = Source(name, read_text(target), target)
        outline = Outline(source.text)
        loaded = FileScope(source, importer.root, self.library, outline=outline)
        return self._declare(loaded, with_compound_units(parse(source, outline.next_text(names))), chain)

    def _locate(self, statement: tree.Import, scope: FileScope) -> Path:
        if not statement.is_file:
            target = (self.library / f"{statement.place}.bg").resolve() if self.library is not None else None
            if target is None or not is_there(target):
                known = sorted(p.stem for p in self.library.glob("*.bg")) if self.library is not None else []
                otherwise = 'A file beside this one stands in quotation marks: `from "parts.bg"`.'
                hint = suggestion(statement.place, known, otherwise)
                raise Wrong(WrongImport(statement.span, f"There is no library `{statement.place}`", hint))
            return target
        if scope.source.path is None or scope.root is None:
            what = f"`{statement.place}` cannot be found: this text is no file"
            hint = "Save the model as a file to import from files beside it."
            raise Wrong(WrongImport(statement.span, what, hint))
        target = (scope.source.path.parent / statement.place).resolve()  # links are resolved before the check
        if not within_project(target, scope.root, self.library):
            hint = "Only files below the project folder are read: that of the nearest `bondgraph.toml` or `pyproject.toml` above the file, else its own."
            what = f"`{statement.place}` lies outside the project folder"
            raise Wrong(WrongImport(statement.span, what, hint))
        if target.suffix not in (".bg", UNIT, SYSTEM) or not is_there(target):
            near = [p.name for p in scope.source.path.parent.glob("*") if p.suffix in (".bg", UNIT, SYSTEM)]
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
