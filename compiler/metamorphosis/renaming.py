"""Renaming of every declared name, with all references to it; and a file with all its imports as one text.

A `Key` is the identity of a declared name: the file or model that declares it, the name, and for names in a mechanism or a
field also the name of that. Renaming gets the new word of each key from a function, and resolves names by the rules of the language:
the letters of an element in its own law stay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..semantics.names.compound_units import with_compound_units
from ..semantics.names.domain_table import ELEMENT_KINDS, is_slot
from ..source import Source, read_text
from ..syntax import parse, tree
from ..syntax.blocks import flat
from .printing import with_parts

Key = tuple[str, ...]  # ("file", path, name) | ("model", path, model, name, …)
NUMBERS = ("parameter", "constant", "input", "signal", "solve", "mode")  # roles that a law can read


@dataclass(eq=False)
class File:
    """Declarations and imports of one file."""

    path: str
    statements: tuple[tree.SyntaxNode, ...]
    models: dict[str, Definition] = field(default_factory=dict)
    constants: set[str] = field(default_factory=set)
    functions: set[str] = field(default_factory=set)
    sets: dict[str, Definition] = field(default_factory=dict)


@dataclass(eq=False)
class Definition:
    """Declarations of one model, or of a set of parameters: name -> its role, its declaration, or its mechanism."""

    file: File
    model: tree.ModelSyntax
    names: dict[str, Any] = field(default_factory=dict)
    slots: dict[str, str] = field(default_factory=dict)

    def key(self, *name: str) -> Key:
        return ("model", self.file.path, self.model.name, *name)


def read_files(source: Source, library: Path | None = None) -> dict[str, File]:
    """A file and all that it imports, itself last. `library`: folder of the files that are imported by a name."""
    files: dict[str, File] = {}
    _read(source, library, files)
    return files


def _read(source: Source, library: Path | None, files: dict[str, File]) -> File:
    name = str(source.path.resolve()) if source.path is not None else source.name
    if name in files:
        return files[name]
    file = File(name, with_compound_units(parse(source)).statements)
    for statement in file.statements:
        match statement:
            case tree.ModelSyntax():
                file.models[statement.name] = _define(file, statement)
            case tree.Quantities():
                file.constants |= {i.name for i in statement.items}
            case tree.ParameterSet():
                model = tree.ModelSyntax(statement.span, statement.name, statement.span, False, ())
                members = dict.fromkeys((i.name for i in statement.items), "constant")
                file.sets[statement.name] = Definition(file, model, members)
            case tree.FunctionSyntax():
                file.functions.add(statement.name)
            case tree.Import():
                folder = Path(name).parent / statement.place
                place = folder if statement.is_file or library is None else library / f"{statement.place}.bg"
                other = _read(Source(str(place), read_text(place), place), library, files)
                file.models |= {n: other.models[n] for n, _ in statement.names if n in other.models}
                file.sets |= {n: other.sets[n] for n, _ in statement.names if n in other.sets}
    files[name] = file
    return file


def _define(file: File, model: tree.ModelSyntax) -> Definition:
    definition = Definition(file, model)
    names = definition.names
    for statement in flat(model.statements):
        match statement:
            case tree.Quantities():
                for item in statement.items:
                    names.setdefault(item.name, statement.role)
                    if is_slot(item):
                        assert isinstance(item.value, tree.PathSyntax)
                        names[item.name], definition.slots[item.name] = "slot", item.value.head
                    elif is_slot(item, "parameters"):
                        names[item.name] = item
            case tree.PortsSyntax():
                names.update({i.name: i for i in statement.items})
            case tree.Declaration():
                names.update({d.name: statement for d in statement.names})
            case tree.MechanismSyntax():
                names[statement.name] = statement
                for inside in flat(statement.statements):
                    if isinstance(inside, tree.Quantities):
                        names.update({i.name: inside.role for i in inside.items})
                    elif isinstance(inside, tree.LoopSyntax):
                        names[inside.name] = "index"
            case tree.LoopSyntax():
                names[statement.name] = "index"
            case tree.FunctionSyntax():
                names[statement.name] = "function"
            case tree.Experiment():
                for step in statement.steps:
                    if isinstance(step, tree.SweepSyntax) and not step.path.steps:
                        names.setdefault(step.path.head, "parameter")
    return definition


def has_branches(model: tree.ModelSyntax) -> bool:
    """Return True for a model with conditional parts: one name may stand for several things."""
    return any(isinstance(s, tree.ConditionalSyntax) for s in flat(model.statements))


def parts_of(mechanism: tree.MechanismSyntax) -> set[str]:
    """The names of a mechanism's bodies, frames and joints."""
    declarations = (s for s in flat(mechanism.statements) if isinstance(s, tree.Declaration))
    return {d.name for s in declarations for d in s.names}


class Renamer:
    """Rewrites the statements of files; `choose` gives the new word of a key."""

    def __init__(self, choose: Callable[[Key], str]) -> None:
        self.choose = choose

    def file(self, file: File) -> tuple[tree.SyntaxNode, ...]:
        return tuple(self.top(file, s) for s in file.statements if not isinstance(s, tree.Import))

    def top(self, file: File, statement: tree.SyntaxNode) -> tree.SyntaxNode:
        match statement:
            case tree.ModelSyntax():
                return self.model(file.models[statement.name])
            case tree.ParameterSet():
                definition = file.sets[statement.name]
                items = ReadingPlace(self, file, definition).renamed(statement.items)
                return replace(statement, name=self.model_name(definition), items=items)
            case tree.Quantities() | tree.FunctionSyntax():
                renamed: tree.SyntaxNode = ReadingPlace(self, file).renamed(statement)
                return renamed
        return statement

    def model_name(self, definition: Definition) -> str:
        return self.choose(("file", definition.file.path, definition.model.name))

    def model(self, definition: Definition) -> tree.ModelSyntax:
        statements = ReadingPlace(self, definition.file, definition).renamed(definition.model.statements)
        return replace(definition.model, name=self.model_name(definition), statements=statements)


@dataclass(frozen=True)
class ReadingPlace:
    """Place of a reading: in a file, a model or a set, a function, a mechanism, or the law of the element `own`."""

    renamer: Renamer
    file: File
    definition: Definition | None = None
    local: Mapping[str, str] = field(default_factory=dict)
    mechanism: tree.MechanismSyntax | None = None
    own: tree.Declaration | None = None

    def name(self, *name: str) -> str:
        """The new word of a name that is declared here."""
        key = ("file", self.file.path, *name) if self.definition is None else self.definition.key(*name)
        return self.renamer.choose(key)

    def renamed(self, node: object) -> Any:
        """A statement or an expression, or a tuple of some, with all its names as they are called now."""
        match node:
            case tree.Literal() | tree.Unit():
                return node
            case tree.PathSyntax():
                return self.path(node)
            case tree.Declaration() if self.mechanism is not None:
                return self._part_declaration(node, self.mechanism)
            case tree.Declaration():
                return self._declaration(node)
            case tree.FunctionSyntax():
                local = {p: self.name(node.name, p) for p in node.parameters}
                body = replace(self, local=local).renamed(node.body)
                return replace(node, name=self.name(node.name), parameters=tuple(local.values()), body=body)
            case tree.MechanismSyntax():
                statements = replace(self, mechanism=node).renamed(node.statements)
                return replace(node, name=self.name(node.name), index=self.renamed(node.index), statements=statements)
            case tree.Item() if is_slot(node):
                return replace(node, name=self.name(node.name), value=self._model_path(node.value))
        node = with_parts(node, self.renamed)
        match node:
            case tree.Call():
                return replace(node, function=self._function(node.function))
            case tree.Item() | tree.PortItem() | tree.LoopSyntax():
                return replace(node, name=self.name(node.name))
            case tree.Experiment():
                return replace(node, name=self.name("experiment", node.name))
        return node

    # ------------------------------------------------------------ expressions
    def _function(self, name: str) -> str:
        if self.definition is not None and self.definition.names.get(name) == "function":
            return self.name(name)
        return self.renamer.choose(("file", self.file.path, name)) if name in self.file.functions else name

    def path(self, node: tree.PathSyntax) -> tree.PathSyntax:
        """A path with its head and inner names as they are called now."""
        steps = tuple(replace(self, own=None).renamed(s) for s in node.steps)
        head = node.head
        if self.own is not None:
            components = {c.name for d in self.own.names for c in d.components}
            role = self.definition.names.get(head) if self.definition else None
            number = isinstance(role, str) and role in (*NUMBERS, "index")
            if head in components or (not steps and not number and head not in self.file.constants):
                return replace(node, steps=steps)  # a variable of its own
        if head in self.local:
            return replace(node, head=self.local[head], steps=steps)
        if self.definition is not None and head in self.definition.names:
            return replace(node, head=self.name(head), steps=self._inside(self.definition, head, steps))
        if head in self.file.sets:
            found = self.file.sets[head]
            return replace(node, head=self.renamer.model_name(found), steps=self._inside_of(found, steps))
        if head in self.file.constants:
            return replace(node, head=self.renamer.choose(("file", self.file.path, head)), steps=steps)
        return replace(node, steps=steps)

    def _inside_of(self, found: Definition, steps: tuple[Any, ...]) -> tuple[Any, ...]:
        """The steps behind the name of a set."""
        if not steps or not isinstance(steps[0], tree.Member):
            return steps
        return (tree.Member(self.renamer.choose(found.key(steps[0].name))), *steps[1:])

    def _inside(self, definition: Definition, name: str, steps: tuple[Any, ...]) -> tuple[Any, ...]:
        """The steps behind a name of a definition."""
        entry = definition.names[name]
        if isinstance(entry, tree.Item) and isinstance(entry.value, tree.PathSyntax):  # it stands for a set
            default = definition.file.sets.get(entry.value.head)
            return steps if default is None else self._inside_of(default, steps)
        for position, step in enumerate(steps):
            if isinstance(step, tree.Index):
                continue
            inner = kind_of(definition, entry)
            if inner is not None and step.name in inner.names:
                word = self.renamer.choose(inner.key(step.name))
                rest = self._inside(inner, step.name, steps[position + 1 :])
                return (*steps[:position], tree.Member(word), *rest)
            if isinstance(entry, tree.MechanismSyntax) and step.name in parts_of(entry):
                word = self.renamer.choose(definition.key(name, step.name))
                return (*steps[:position], tree.Member(word), *steps[position + 1 :])
            break
        return steps

    # ------------------------------------------------------------ declarations
    def _model_path(self, value: object) -> Any:
        """A model or a slot, named as a value."""
        assert isinstance(value, tree.PathSyntax)
        return replace(value, head=self._kind(value.head))

    def _kind(self, kind: str) -> str:
        assert self.definition is not None
        if kind in self.definition.slots:
            return self.name(kind)
        definition = self.file.models.get(kind)
        return kind if definition is None else self.renamer.model_name(definition)

    def _declared(self, node: tree.Declaration, *within: str) -> tuple[tree.Declared, ...]:
        return tuple(replace(with_parts(d, self.renamed), name=self.name(*within, d.name)) for d in node.names)

    def _declaration(self, node: tree.Declaration) -> tree.Declaration:
        names = self._declared(node)
        if node.kind in ELEMENT_KINDS:
            law = node.definition
            if isinstance(law, tree.LawSyntax):
                law = replace(self, own=node).renamed(law)
            elif isinstance(law, tree.PathSyntax):  # a domain, with its width
                law = replace(law, steps=self.renamed(law.steps))
            return replace(node, names=names, definition=law, attributes=self._own_attributes(node))
        assert self.definition is not None
        inner = kind_of(self.definition, node)
        assert inner is not None, node.kind
        attributes = tuple(
            replace(
                a,
                name=a.name if a.name == "parameters" else self.renamer.choose(inner.key(a.name)),
                value=self._model_path(a.value) if a.name in inner.slots else self.renamed(a.value),
            )
            for a in node.attributes
        )
        return replace(node, kind=self._kind(node.kind), names=names, attributes=attributes)

    def _own_attributes(self, node: tree.Declaration) -> tuple[tree.Attribute, ...]:
        """The attributes of an element, body or joint: their words are the language's, their numbers the author's."""
        return tuple(
            a if a.name in ("prefer", "require", "axes") else replace(a, value=self.renamed(a.value))
            for a in node.attributes
        )

    def _part_declaration(self, node: tree.Declaration, mechanism: tree.MechanismSyntax) -> tree.Declaration:
        parts, definition = parts_of(mechanism), node.definition

        def part(path: object) -> Any:
            if not isinstance(path, tree.PathSyntax) or path.head not in parts:
                return path
            return replace(path, head=self.name(mechanism.name, path.head), steps=self.renamed(path.steps))

        definition = with_parts(definition, part) if isinstance(definition, tree.LinkSyntax) else part(definition)
        names = self._declared(node, mechanism.name)
        return replace(node, names=names, definition=definition, attributes=self._own_attributes(node))


def kind_of(definition: Definition, entry: object) -> Definition | None:
    """The model of an instance."""
    if not isinstance(entry, tree.Declaration):
        return None
    return definition.file.models.get(definition.slots.get(entry.kind, entry.kind))


# ---------------------------------------------------------------- one file


def bundled(source: Source, library: Path | None) -> tuple[tree.SyntaxNode, ...]:
    """A file and its imports as the statements of one text; equal names of several files get a number."""
    files = read_files(source, library)
    main = next(reversed(files.values()))
    taken: dict[str, Key] = {}
    words: dict[Key, str] = {}

    def choose(key: Key) -> str:
        if key[0] != "file" or len(key) > 3:
            return key[-1]
        if key not in words:
            word, number = key[2], 1
            while taken.setdefault(word, key) != key:
                number += 1
                word = f"{key[2]}_{number}"
            words[key] = word
        return words[key]

    for name in main.models:
        choose(("file", main.path, name))
    renamer = Renamer(choose)
    used = _used(main)
    statements: list[tree.SyntaxNode] = []
    for file in files.values():
        for statement in file.statements:
            if isinstance(statement, tree.Import | tree.Description):
                continue
            if isinstance(statement, tree.ModelSyntax) and file.models[statement.name] not in used:
                continue
            statements.append(renamer.top(file, statement))
    return tuple(statements)


def _used(main: File) -> set[Definition]:
    """The models of a file and all that they use."""
    used: set[Definition] = set()
    waiting = [d for d in main.models.values() if d.file is main]
    while waiting:
        definition = waiting.pop()
        if definition in used:
            continue
        used.add(definition)
        for statement in flat(definition.model.statements):
            kinds = [statement.kind] if isinstance(statement, tree.Declaration) else []
            kinds += definition.slots.values()
            if isinstance(statement, tree.Declaration):
                kinds += [a.value.head for a in statement.attributes if isinstance(a.value, tree.PathSyntax)]
            waiting += [definition.file.models[k] for k in kinds if k in definition.file.models]
    return used
