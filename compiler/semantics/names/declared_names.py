"""Declared names: a table for each model, mechanism and file, made of the syntax tree alone, so that it holds in a half-typed file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ...source import Span
from ...syntax import tree
from .domain_table import ELEMENT_KINDS
from .scope import FileScope, ModelDefinition

_TABLES_KEPT = 2048
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class DeclaredName:
    """A name that a text declares. Equal for equal `path`, `owner` and `name`: what refers to it, has the same.

    `owner`: the model, and the mechanism or element in it, that has the name; empty for a name of a file.
    """

    path: Path
    owner: tuple[str, ...]
    name: str
    kind: str = field(compare=False)  # model parameter constant input output signal mode port element junction …
    span: Span = field(compare=False)
    node: tree.SyntaxNode = field(compare=False)
    type: str = field(default="", compare=False)  # of an element or instance its kind, of a port its domain
    description: str = field(default="", compare=False)


NameTable = Mapping[str, DeclaredName]


def name_span(span: Span, name: str) -> Span:
    """The first `name` in a span that begins with it, or has it further on."""
    match = re.compile(rf"\b{re.escape(name)}\b").search(span.source.text, span.start)
    start = span.start if match is None else match.start()
    return Span(span.source, start, start + len(name))


def path_of(span: Span) -> Path:
    """File of a span."""
    return _resolved(span.source.path or Path(span.source.name))


@lru_cache(1024)
def _resolved(path: Path) -> Path:
    """The path without links; each name of a file asks for it, and the disk is slow."""
    return path.resolve()


_tables: dict[int, tuple[tree.SyntaxNode, NameTable]] = {}  # by identity: equal nodes of other places have other names


def table_of(model: tree.ModelSyntax) -> NameTable:
    """Names that a model declares, with those of its loops; not those of its experiments."""
    return _kept(model, (model.name,))


def parts_of(mechanism: tree.MechanismSyntax, owner: tuple[str, ...]) -> NameTable:
    """Names of the parts of a mechanism; `owner` is its model."""
    return _kept(mechanism, (*owner, mechanism.name))


def _kept(node: tree.ModelSyntax | tree.MechanismSyntax, owner: tuple[str, ...]) -> NameTable:
    before = _tables.get(id(node))
    if before is not None and before[0] is node:
        return before[1]
    table: dict[str, DeclaredName] = {}
    for name in _declared(node.statements, owner):
        if name.kind != "experiment":
            table.setdefault(name.name, name)
    if len(_tables) >= _TABLES_KEPT:
        _tables.clear()
    _tables[id(node)] = (node, table)
    return table


def declared_by(
    node: Any, owner: tuple[str, ...], kind: str, sort: str = "", description: str | None = None
) -> DeclaredName:
    """The name that a node declares; `sort`: its type."""
    span = name_span(node.span, node.name)
    return DeclaredName(path_of(node.span), owner, node.name, kind, span, node, sort, description or "")


def model_name(definition: ModelDefinition) -> DeclaredName:
    model = definition.model
    name = declared_by(model, (), "model", "", first_text(model.statements))
    return replace(name, span=model.name_span)


def first_text(statements: tuple[tree.SyntaxNode, ...]) -> str:
    """The description that a file, a model or an experiment has; empty if it has none."""
    return next((s.text for s in statements if isinstance(s, tree.Description)), "")


def file_names(file: FileScope) -> NameTable:
    """Names that models of a file read besides their own: models, constants and functions."""
    names = {n: model_name(d) for n, d in file.models.items()}
    names |= {n: declared_by(item, (), "constant", "", item.description) for n, (item, _) in file.constants.items()}
    names |= {n: declared_by(defined.syntax, (), "set") for n, defined in file.sets.items()}
    return names | {n: declared_by(function, (), "function") for n, function in file.functions.items()}


def _declared(statements: tuple[tree.SyntaxNode, ...], owner: tuple[str, ...]) -> Iterator[DeclaredName]:
    for statement in statements:
        match statement:
            case tree.Quantities(role=role, items=items):
                for item in items:
                    yield declared_by(item, owner, role, "", item.description)
            case tree.PortsSyntax(items=ports):
                for port in ports:
                    yield declared_by(port, owner, "port", port.domain or "", port.description)
            case tree.Declaration():
                kind = _kind_of(statement, owner)
                for declared in statement.names:
                    name = declared_by(declared, owner, kind, statement.kind, statement.description)
                    yield replace(name, node=statement)
            case tree.MechanismSyntax():
                yield declared_by(statement, owner, "mechanism", statement.space or "planar")
            case tree.LoopSyntax():
                yield declared_by(statement, owner, "index")
                yield from _declared(statement.statements, owner)
            case tree.ConditionalSyntax():
                yield from _declared((*statement.statements, *statement.otherwise), owner)
            case tree.FunctionSyntax():
                yield declared_by(statement, owner, "function")
            case tree.Experiment():
                text = first_text(statement.steps)
                yield declared_by(statement, (*owner, "experiment"), "experiment", "", text)


def _kind_of(declaration: tree.Declaration, owner: tuple[str, ...]) -> str:
    if len(owner) > 1:
        return "part"
    if declaration.kind in ("0", "1", "splitter"):
        return "junction"
    return "element" if declaration.kind in ELEMENT_KINDS else "instance"


def members_of(defined: tree.ParameterSet) -> NameTable:
    return {i.name: declared_by(i, (defined.name,), "member", "", i.description) for i in defined.items}


def ports_of(element: DeclaredName) -> NameTable:
    """Names of the ports that an element lists in parentheses."""
    assert isinstance(element.node, tree.Declaration)
    declared = next((d for d in element.node.names if d.name == element.name), None)
    components = declared.components if declared is not None else ()
    owner = (*element.owner, element.name)
    return {c.name: declared_by(c, owner, "component", c.domain or "") for c in components}


def arguments_of(function: tree.FunctionSyntax, owner: tuple[str, ...]) -> NameTable:
    path, source = path_of(function.span), function.span.source
    names: dict[str, DeclaredName] = {}
    after = function.span.start + len(function.name)
    for match in _NAME.finditer(source.text, after, function.body.span.start):
        if match[0] in function.parameters:
            span = Span(source, *match.span())
            names[match[0]] = DeclaredName(path, (*owner, function.name), match[0], "argument", span, function)
    return names
