"""Renaming of every declared name, with all references to it; and a file with all its imports as one text.

A `Key` is the identity of a declared name: the file or model that declares it, the name, and for names in a mechanism or a
field also the name of that. Renaming gets the new word of each key from a function, and resolves names by the rules of the language:
the letters of an element in its own law stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..semantics.names.compound_units import with_compound_units
from ..semantics.names.domain_table import ELEMENT_KINDS, is_slot
from ..source import Source, read_text
from ..syntax import parse, tree
from ..syntax.blocks import flat, with_inner_blocks

Key = tuple[str, ...]  # ("file", path, name) | ("model", path, model, name, …)
NUMBERS = ("parameter", "constant", "input", "signal", "mode")  # roles that a law can read


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
            case tree.Quantities():
                items = (
                    replace(
                        i, name=self.choose(("file", file.path, i.name)), value=ReadingPlace(self, file).value(i.value)
                    )
                    for i in statement.items
                )
                return replace(statement, items=tuple(items))
            case tree.ParameterSet():
                return self.parameter_set(file, statement)
            case tree.FunctionSyntax():
                own = ("file", file.path, statement.name)
                place = ReadingPlace(self, file, local={p: self.choose((*own, p)) for p in statement.parameters})
                parameters = tuple(place.local.values())
                return replace(
                    statement, name=self.choose(own), parameters=parameters, body=place.value(statement.body)
                )
        return statement

    def parameter_set(self, file: File, statement: tree.ParameterSet) -> tree.ParameterSet:
        definition = file.sets[statement.name]
        local = {name: self.choose(definition.key(name)) for name in definition.names}
        place = ReadingPlace(self, file, local=local)
        items = tuple(replace(i, name=local[i.name], value=place.value(i.value)) for i in statement.items)
        return replace(statement, name=self.model_name(definition), items=items)

    def model_name(self, definition: Definition) -> str:
        return self.choose(("file", definition.file.path, definition.model.name))

    def model(self, definition: Definition) -> tree.ModelSyntax:
        place = ReadingPlace(self, definition.file, definition)
        statements = tuple(place.statement(s) for s in definition.model.statements)
        return replace(definition.model, name=self.model_name(definition), statements=statements)


class ReadingPlace:
    """ReadingPlace of a reading: in a file, a model, a function, a mechanism or the law of an element."""

    def __init__(
        self,
        renamer: Renamer,
        file: File,
        definition: Definition | None = None,
        local: dict[str, str] | None = None,
        mechanism: tree.MechanismSyntax | None = None,
    ) -> None:
        self.renamer, self.file, self.definition, self.local = renamer, file, definition, local or {}
        self.mechanism = mechanism

    def name(self, *name: str) -> str:
        assert self.definition is not None
        return self.renamer.choose(self.definition.key(*name))

    # ------------------------------------------------------------ expressions
    def value(self, node: object, own: tree.Declaration | None = None) -> Any:
        """An expression, or anything that contains some; `own` is the element whose law it is."""
        match node:
            case tree.PathSyntax():
                return self.path(node, own)
            case tree.Call():
                function = node.function
                if self.definition is not None and self.definition.names.get(function) == "function":
                    function = self.name(function)
                elif function in self.file.functions:
                    function = self.renamer.choose(("file", self.file.path, function))
                return replace(node, function=function, arguments=tuple(self.value(a, own) for a in node.arguments))
            case tuple():
                return tuple(self.value(n, own) for n in node)
            case tree.Sum():
                return replace(node, terms=tuple((s, self.value(t, own)) for s, t in node.terms))
            case tree.Product():
                return replace(node, factors=tuple((s, self.value(f, own)) for s, f in node.factors))
            case tree.Literal() | tree.TextSyntax() | None:
                return node
            case tree.Index() | tree.VectorSyntax():
                return replace(node, items=self.value(node.items, own))
        assert isinstance(node, tree.SyntaxNode)
        names = {
            tree.Negative: ("operand",), tree.Power: ("base", "exponent"), tree.Comparison: ("left", "right"),
            tree.Logical: ("operands",), tree.ChoiceSyntax: ("value", "condition", "otherwise"), tree.Range: ("first", "last"),
            tree.Equation: ("left", "right"), tree.LawSyntax: ("equations",), tree.ReadingSyntax: ("value",),
        }[type(node)]  # fmt: skip
        return replace(node, **{n: self.value(getattr(node, n), own) for n in names})

    def path(self, node: tree.PathSyntax, own: tree.Declaration | None = None) -> tree.PathSyntax:
        """A path with its head and inner names as they are called now."""
        steps = tuple(self.value(s) if isinstance(s, tree.Index) else s for s in node.steps)
        head = node.head
        if own is not None:
            components = {c.name for d in own.names for c in d.components}
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

    # ------------------------------------------------------------ statements
    def statement(self, node: object) -> Any:
        assert self.definition is not None
        match node:
            case tree.Quantities():
                return replace(node, items=tuple(map(self._item, node.items)))
            case tree.PortsSyntax():
                return replace(node, items=tuple(map(self._port, node.items)))
            case tree.Declaration() if self.mechanism is not None:
                return self._part_declaration(node)
            case tree.Declaration():
                return self._declaration(node)
            case tree.Bonds():
                return replace(node, places=tuple(tuple(map(self._bonded, g)) for g in node.places))
            case tree.SettingSyntax():
                return replace(node, value=self.value(node.value))
            case tree.RequirementSyntax():
                return replace(node, condition=self.value(node.condition))
            case tree.LoopSyntax():
                return replace(
                    node,
                    name=self.name(node.name),
                    range=self.value(node.range),
                    statements=tuple(map(self.statement, node.statements)),
                )
            case tree.ConditionalSyntax():
                node = replace(node, condition=self.value(node.condition))
                return with_inner_blocks(node, lambda block: tuple(map(self.statement, block)))
            case tree.MechanismSyntax():
                inside = ReadingPlace(self.renamer, self.file, self.definition, self.local, node)
                statements = tuple(map(inside.statement, node.statements))
                return replace(node, name=self.name(node.name), index=self.value(node.index), statements=statements)
            case tree.FunctionSyntax():
                local = {p: self.name(node.name, p) for p in node.parameters}
                body = ReadingPlace(self.renamer, self.file, self.definition, local).value(node.body)
                return replace(node, name=self.name(node.name), parameters=tuple(local.values()), body=body)
            case tree.Experiment():
                word = self.name("experiment", node.name)
                return replace(node, name=word, steps=tuple(map(self._step, node.steps)))
            case tree.EventSyntax():
                resets = tuple(replace(r, target=self.path(r.target), value=self.value(r.value)) for r in node.resets)
                timing = tuple(replace(t, value=self.value(t.value)) for t in node.timing)
                return replace(node, condition=self.value(node.condition), resets=resets, timing=timing)
        return node

    def _item(self, item: tree.Item) -> tree.Item:
        value = self._model_path(item.value) if is_slot(item) else self.value(item.value)
        return replace(item, name=self.name(item.name), index=self.value(item.index), value=value)

    def _port(self, item: tree.PortItem) -> tree.PortItem:
        index, width = self.value(item.index), self.value(item.width)
        return replace(item, name=self.name(item.name), index=index, width=width)

    def _model_path(self, value: object) -> Any:
        """A model or a slot, named as a value."""
        assert isinstance(value, tree.PathSyntax) and self.definition is not None
        return replace(value, head=self._kind(value.head))

    def _kind(self, kind: str) -> str:
        assert self.definition is not None
        if kind in self.definition.slots:
            return self.name(kind)
        definition = self.file.models.get(kind)
        return kind if definition is None else self.renamer.model_name(definition)

    def _declared(self, node: tree.Declaration, *within: str) -> tuple[tree.Declared, ...]:
        def listed(declared: tree.Declared) -> tuple[tree.Component, ...]:
            return tuple(replace(c, width=self.value(c.width)) for c in declared.components)

        return tuple(
            replace(d, name=self.name(*within, d.name), index=self.value(d.index), components=listed(d))
            for d in node.names
        )

    def _declaration(self, node: tree.Declaration) -> tree.Declaration:
        names = self._declared(node)
        if node.kind in ELEMENT_KINDS:
            attributes = tuple(self._own_attribute(a) for a in node.attributes)
            law = node.definition
            if isinstance(law, tree.LawSyntax):
                law = self.value(law, node)
            elif isinstance(law, tree.PathSyntax):  # a domain, with its width
                law = replace(law, steps=self.value(law.steps))
            return replace(node, names=names, definition=law, attributes=attributes)
        assert self.definition is not None
        inner = kind_of(self.definition, node)
        assert inner is not None, node.kind
        attributes = tuple(
            replace(
                a,
                name=a.name if a.name == "parameters" else self.renamer.choose(inner.key(a.name)),
                value=self._model_path(a.value) if a.name in inner.slots else self.value(a.value),
            )
            for a in node.attributes
        )
        return replace(node, kind=self._kind(node.kind), names=names, attributes=attributes)

    def _own_attribute(self, attribute: tree.Attribute) -> tree.Attribute:
        """An attribute of an element, body or joint: its words are the language's, its numbers the author's."""
        if attribute.name in ("prefer", "require", "axes"):
            return attribute
        return replace(attribute, value=self.value(attribute.value))

    def _part_declaration(self, node: tree.Declaration) -> tree.Declaration:
        assert self.mechanism is not None
        definition = node.definition
        if isinstance(definition, tree.LinkSyntax):
            definition = replace(definition, first=self._part(definition.first), second=self._part(definition.second))
        elif isinstance(definition, tree.PathSyntax):
            definition = self._part(definition)
        attributes = tuple(map(self._own_attribute, node.attributes))
        return replace(
            node, names=self._declared(node, self.mechanism.name), definition=definition, attributes=attributes
        )

    def _part(self, node: object) -> Any:
        assert self.mechanism is not None and isinstance(node, tree.PathSyntax)
        if node.head not in parts_of(self.mechanism):
            return node
        steps = tuple(self.value(s) if isinstance(s, tree.Index) else s for s in node.steps)
        return replace(node, head=self.name(self.mechanism.name, node.head), steps=steps)

    def _bonded(self, place: tree.PathSyntax | tree.Nest) -> tree.PathSyntax | tree.Nest:
        if isinstance(place, tree.PathSyntax):
            return self.path(place)
        return replace(place, members=tuple(map(self._bonded, place.members)))

    def _step(self, step: object) -> Any:
        match step:
            case tree.Set():
                return replace(step, target=self.path(step.target), value=self.value(step.value))
            case tree.Simulate():
                return replace(step, range=self.value(step.range), attributes=self._settings(step.attributes))
            case tree.Bandwidth():
                return replace(step, value=self.value(step.value))
            case tree.StopSyntax():
                return replace(step, condition=self.value(step.condition))
            case tree.Report():
                return replace(step, readings=self.value(step.readings))
            case tree.SweepSyntax():
                return replace(step, path=self.value(step.path), values=self.value(step.values))
            case tree.Analysis():
                inputs, outputs = (tuple(map(self._given, some)) for some in (step.given, step.wanted))
                attributes = self._settings(step.attributes)
                return replace(step, given=inputs, wanted=outputs, range=self.value(step.range), attributes=attributes)
        return step

    def _given(self, given: tree.GivenSyntax) -> tree.GivenSyntax:
        other = None if given.other is None else self.path(given.other)
        return replace(
            given, path=self.path(given.path), other=other, value=self.value(given.value), range=self.value(given.range)
        )

    def _settings(self, attributes: tuple[tree.Attribute, ...]) -> tuple[tree.Attribute, ...]:
        return tuple(
            replace(a, target=None if a.target is None else self.path(a.target), value=self.value(a.value))
            for a in attributes
        )


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
