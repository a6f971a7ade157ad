"""Branches that are not taken: their names, kinds and functions are checked. What only values decide is looked at when they are taken."""

from __future__ import annotations

from collections.abc import Callable

from ...errors import Diagnostic
from ...graph.domains import BUNDLES, DOMAINS, GENERIC
from ...syntax import tree
from ...syntax.blocks import Statements, flat, nodes_in
from ..expressions.expression_compiler import BUILT_IN
from ..names.compound_units import names_in
from ..names.domain_table import ELEMENT_KINDS
from ..names.errors import UnknownAttribute, UnknownFunction, UnknownKind, UnknownName
from ..names.part_kinds import kinds_of
from ..names.scope import FileScope, Scope
from ..names.statement_errors import suggestion

_LETTERS = {*GENERIC, *(letter for domain in DOMAINS.values() for letter in domain.letters if letter)}
_WORDS = frozenset(  # of laws, attributes and domains
    {"time", "pi", "true", "false", "ground", "energy", "world", "body", "from", "to", "middle", "x", "y", "z"}
    | {"integral", "derivative", "effort", "flow"}
).union(DOMAINS, BUNDLES, (letter + side for letter in _LETTERS for side in ("", "1", "2")))


def check_untaken(scope: Scope, statements: Statements, tell: Callable[[Diagnostic], None]) -> None:
    """Report names, kinds and functions of a branch that are not declared anywhere."""
    definition = scope.definition
    file = definition.file
    declared = names_in(definition.model) | set(scope.names())
    names = declared | file.constants.keys() | file.models.keys() | file.sets.keys() | file.missing
    functions = {*BUILT_IN, *file.functions, *declared}
    kinds = {*ELEMENT_KINDS, *file.models, *file.missing, *kinds_of(True), *kinds_of(False), *declared}
    for node in nodes_in(statements):
        match node:
            case tree.PathSyntax(head=head) if not (head in names or head in _WORDS or head in _choices(file)):
                hint = suggestion(head, sorted(names), "Declare it with `parameter`, `constant`, `signal` or `input`.")
                tell(UnknownName(node.span, head, f"`{definition.name}`", hint))
            case tree.Call(function=name) if name not in functions:
                tell(UnknownFunction(node.span, name, suggestion(name, functions, "A product is written with `*`.")))
            case tree.Declaration(kind=kind) if kind not in kinds:
                hint = suggestion(kind, kinds, f"Kinds: {' '.join(ELEMENT_KINDS)}, and the models of this file.")
                tell(UnknownKind(node.span, kind, hint))
            case tree.Declaration() if node.kind in file.models:
                _check_attributes(node, file, tell)


def _choices(file: FileScope) -> set[str]:
    """Words of the choices of all models: one of them may be set in an instance."""
    statements = (s for d in file.models.values() for s in flat(d.model.statements) if isinstance(s, tree.Quantities))
    return {word for s in statements for item in s.items for word, _ in item.choices}


def _check_attributes(node: tree.Declaration, file: FileScope, tell: Callable[[Diagnostic], None]) -> None:
    """Report attributes of an instance that are no parameters or inputs of its model."""
    quantities = (s for s in flat(file.models[node.kind].model.statements) if isinstance(s, tree.Quantities))
    names = [i.name for s in quantities if s.role in ("parameter", "input") for i in s.items]
    for attribute in node.attributes:
        if attribute.name not in (*names, "parameters"):
            hint = suggestion(attribute.name, names, f"Its parameters and inputs: {', '.join(names) or 'none'}.")
            tell(UnknownAttribute(attribute.span, node.kind, attribute.name, hint))
