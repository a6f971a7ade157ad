"""Occurrences of names: each word of a file that declares or refers to a name, with what it refers to."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, fields, replace

from ...source import Span
from ...syntax import tree
from .declared_names import (
    DeclaredName,
    NameTable,
    arguments_of,
    declared_by,
    file_names,
    members_of,
    model_name,
    name_span,
    parts_of,
    ports_of,
    table_of,
)
from .domain_table import ELEMENT_KINDS, is_slot, slot_defaults
from .scope import FileScope, ModelDefinition

READ_BY_LAWS = ("parameter", "constant", "input", "signal", "solve", "mode", "index", "argument")  # kinds of numbers
_WORDED = ("prefer", "require", "axes", "colour")  # attributes whose values are words of the language
_STEP = re.compile(r"\[|\]|\.\s*([A-Za-z_]\w*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class NameUse:
    """A word of the text; `name` is None for a word that belongs to the language, such as the letter of a law.

    `home`: the model that it stands in. `reading`: the path up to it, `axle[2].k`.
    """

    span: Span
    name: DeclaredName | None
    is_definition: bool = False
    kind: str = ""  # of a word without a declared name
    reading: str = ""
    home: str = ""


@dataclass(frozen=True, slots=True)
class _Home:
    """Names that can be read at a place, and the model that it is in."""

    file: FileScope
    names: Mapping[str, DeclaredName]
    owner: tuple[str, ...] = ()
    letters: Mapping[str, DeclaredName | None] | None = None  # in a law: the element's ports
    in_law: bool = False

    def also(self, names: NameTable) -> _Home:
        return replace(self, names={**self.names, **names})


def name_uses(file: FileScope, statements: tuple[tree.SyntaxNode, ...]) -> Iterator[NameUse]:
    """Yield the occurrences of all names in the statements of a file."""
    return _uses(statements, _Home(file, file_names(file)))


def name_uses_in_path(definition: ModelDefinition, path: tree.PathSyntax) -> Iterator[NameUse]:
    """Yield the occurrences of names in a path that is read in a model."""
    return _path(path, _Home(definition.file, {**file_names(definition.file), **table_of(definition.model)}))


def words_of_path(path: tree.PathSyntax) -> list[tuple[str, Span]]:
    """The names of a path with their places; what stands in its indices is no part of it."""
    source = path.span.source
    start = path.span.start
    words = [(path.head, Span(source, start, start + len(path.head)))]
    depth = 0
    for step in _STEP.finditer(source.text, start + len(path.head), path.span.end):
        if step[1] is None:
            depth += 1 if step[0] == "[" else -1
        elif not depth:
            words.append((step[1], Span(source, *step.span(1))))
    return words


def names_inside(name: DeclaredName, file: FileScope) -> tuple[NameTable, FileScope]:
    """Names that follow a name after a point, and the file in whose words they are meant."""
    if name.kind == "instance":
        definition = model_of(name, file)
        return ({}, file) if definition is None else (table_of(definition.model), definition.file)
    if name.kind == "mechanism" and isinstance(name.node, tree.MechanismSyntax):
        return parts_of(name.node, name.owner), file
    if name.kind == "element":
        return ports_of(name), file
    node = name.node  # a set, or a parameter that stands for one: its members are those of the default
    if isinstance(node, tree.Item) and is_slot(node, "parameters") and isinstance(node.value, tree.PathSyntax):
        node = file.sets[node.value.head].syntax if node.value.head in file.sets else node
    return (members_of(node) if isinstance(node, tree.ParameterSet) else {}), file


def model_of(name: DeclaredName, file: FileScope) -> ModelDefinition | None:
    """Model of an instance; of one whose kind is a parameter, the default of that."""
    own = file.models.get(name.owner[0]) if name.owner else None
    slots = {} if own is None else slot_defaults(own.model.statements)
    return file.models.get(slots.get(name.type, name.type))


# ---------------------------------------------------------------- statements


def _uses(node: object, home: _Home) -> Iterator[NameUse]:
    """Yield the occurrences in a node, or in all nodes of a tuple: only what declares or reads a name is a case of its own."""
    match node:
        case tree.PathSyntax():
            yield from _path(node, home)
        case tree.Declaration():
            yield from _declaration(node, home)
        case tree.Experiment():
            yield from _experiment(node, home)
        case tree.ModelSyntax():
            yield NameUse(node.name_span, model_name(ModelDefinition(node, home.file)), True)
            inner = replace(home.also(table_of(node)), owner=(node.name,))
            yield from (replace(use, home=node.name) for use in _uses(node.statements, inner))
        case tree.Import():
            for name, span in node.names:
                definition = home.file.models.get(name)
                yield NameUse(span, None if definition is None else model_name(definition), kind="model")
            if not node.is_file:
                end = node.span.end
                yield NameUse(Span(node.span.source, end - len(node.place), end), None, kind="library")
        case tree.MechanismSyntax():
            yield from _defined(home, node.name, node.span)
            yield from _uses(node.index, home)
            parts = parts_of(node, home.owner)
            yield from _uses(node.statements, replace(home.also(parts), owner=(*home.owner, node.name)))
        case tree.ParameterSet():
            yield from _defined(home, node.name, node.span)
            yield from _uses(node.items, home.also(members_of(node)))
        case tree.FunctionSyntax():
            yield from _defined(home, node.name, node.span)
            arguments = arguments_of(node, home.owner)
            yield from (NameUse(a.span, a, True) for a in arguments.values())
            yield from _uses(node.body, home.also(arguments))
        case tree.SettingSyntax():
            yield NameUse(name_span(node.span, node.name), None, kind="attribute")
            yield from _uses(node.value, home)
        case tree.Call():
            span = name_span(node.span, node.function)
            function = home.names.get(node.function)
            own = function is not None and function.kind == "function"
            yield NameUse(span, function if own else None, kind="function")
            yield from _uses(node.arguments, home)
        case tree.Unit():
            yield from (NameUse(span, None, kind="unit") for _, _, span in node.factors)
        case tree.Item():
            yield from _defined(home, node.name, node.span)
            yield from _value(_parts(node), {word for word, _ in node.choices}, home)
        case tree.LoopSyntax() | tree.PortItem():
            yield from _defined(home, node.name, node.span)
            yield from _uses(_parts(node), home)
        case tree.Comparison() | tree.Reset() | tree.Set():
            sides = [list(_path(side, home))[-1].name for side in _parts(node) if isinstance(side, tree.PathSyntax)]
            yield from _value(_parts(node), {word for name in sides for word in _choices(name)}, home)
        case tree.SyntaxNode() | tree.Index():
            yield from _uses(_parts(node), home)
        case tuple():
            for part in node:
                yield from _uses(part, home)


def _value(node: object, words: Set[str], home: _Home) -> Iterator[NameUse]:
    """Yield the occurrences in what may be one of several words, which are no names there."""
    match node:
        case tree.PathSyntax() if node.words in words:
            yield NameUse(node.span, None, kind="word", reading=node.words)
        case tree.ChoiceSyntax():
            yield from _uses(node.condition, home)
            yield from _value((node.value, node.otherwise), words, home)
        case tuple():
            for part in node:
                yield from _value(part, words, home)
        case _:
            yield from _uses(node, home)


def _choices(name: DeclaredName | None) -> tuple[str, ...]:
    """The words that a parameter or a mode may be."""
    item = None if name is None else name.node
    return tuple(word for word, _ in item.choices) if isinstance(item, tree.Item) else ()


def _parts(node: tree.SyntaxNode | tree.Index) -> tuple[object, ...]:
    return tuple(getattr(node, part.name) for part in fields(node) if part.name != "span")


def _defined(home: _Home, word: str, span: Span) -> Iterator[NameUse]:
    name = home.names.get(word)
    if name is not None:
        yield NameUse(name_span(span, word), name, True)


def _declaration(declaration: tree.Declaration, home: _Home) -> Iterator[NameUse]:
    kind_span = name_span(declaration.span, declaration.kind)
    kind = home.names.get(declaration.kind) if declaration.kind not in ELEMENT_KINDS and len(home.owner) == 1 else None
    if kind is not None and kind.kind in ("model", "parameter"):  # a parameter may stand for a model
        yield NameUse(kind_span, kind)
    elif declaration.kind.isidentifier():
        yield NameUse(kind_span, None, kind="kind")
    inner: NameTable = {}
    target = home
    for declared in declaration.names:
        name = home.names.get(declared.name)
        if name is None:
            continue
        yield NameUse(name_span(declared.span, declared.name), name, True)
        yield from _uses((declared.index, *(c.width for c in declared.components)), home)
        inner, file = names_inside(name, home.file)
        if name.kind == "element":
            yield from (NameUse(c.span, c, True) for c in inner.values())
        elif name.kind == "instance":
            target = _Home(file, inner)
    law = isinstance(declaration.definition, tree.LawSyntax)
    yield from _uses(declaration.definition, replace(home, letters=inner, in_law=law))
    for attribute in declaration.attributes:
        span = name_span(attribute.span, attribute.name)
        named = target.names.get(attribute.name) if target is not home else None
        yield NameUse(span, named, kind="attribute")
        yield from _uses(attribute.target, replace(home, names=inner, in_law=True))
        own = isinstance(attribute.value, tree.PathSyntax) and target is home and attribute.name in _WORDED
        yield from _value(attribute.value, {attribute.value.span.words} if own else {*_choices(named)}, home)


def _experiment(experiment: tree.Experiment, home: _Home) -> Iterator[NameUse]:
    owner = (*home.owner, "experiment")
    name = declared_by(experiment, owner, "experiment")
    yield NameUse(name.span, name, True)
    swept: dict[str, DeclaredName] = {}
    for step in experiment.steps:
        if isinstance(step, tree.SweepSyntax) and not step.path.steps and step.path.head not in home.names:
            word, span = words_of_path(step.path)[0]
            swept[word] = DeclaredName(name.path, (*owner, experiment.name), word, "parameter", span, step)
    inner = home.also(swept)
    for step in experiment.steps:
        for attribute in getattr(step, "attributes", ()):
            yield NameUse(name_span(attribute.span, attribute.name), None, kind="attribute")
        for use in _uses(step, inner):
            is_swept = use.name is not None and use.name.span == use.span and use.name.node is step
            yield replace(use, is_definition=True) if is_swept else use


def _path(path: tree.PathSyntax, home: _Home) -> Iterator[NameUse]:
    yield from _uses(path.steps, home)
    words = words_of_path(path)
    names: Mapping[str, DeclaredName] = home.names
    head = names.get(path.head)
    if home.letters and path.head in home.letters:
        names = home.letters  # type: ignore[assignment]
    elif home.in_law and not path.steps and head is not None and head.kind not in READ_BY_LAWS:
        names = {}  # a letter, though an element or an output is called as it is
    file = home.file
    for number, (word, span) in enumerate(words):
        name = names.get(word)
        if name is None:
            yield NameUse(
                span, None, kind="variable" if number or home.in_law else "word", reading=_reading(path, span)
            )
            names = {}
            continue
        yield NameUse(span, name, reading=_reading(path, span))
        names, file = names_inside(name, file)


def _reading(path: tree.PathSyntax, span: Span) -> str:
    """A path up to one of its words, without spaces."""
    return "".join(path.span.source.text[path.span.start : span.end].split())
