"""Conditional parts: the conditions of `if` blocks, read before the run, and the statements of the branches that are taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ...errors import Diagnostic
from ...graph.domains import BUNDLES, DOMAINS, GENERIC
from ...graph.network import behind, quantities_in
from ...syntax import tree
from ...syntax.blocks import Statements, flat, inner_blocks, nodes_in
from ..expressions.expression_compiler import BUILT_IN
from ..names.compound_units import NAMED, names_in
from ..names.domain_table import ELEMENT_KINDS, paths_of
from ..names.errors import UnknownAttribute, UnknownFunction, UnknownKind, UnknownName, Unsupported, WrongStructure
from ..names.part_kinds import kinds_of
from ..names.scope import Absent, Broken, Entry, FileScope, ModelDefinition, Scope
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from .declarations import Declarations
from .resolver import Resolver, read_condition

Bindings = Mapping[str, tuple[tree.Attribute, Scope]]
_CONDITION = "Parts depend on a condition: `if heated { … }`, `if n > 1 { … }`."
_STRUCTURAL = "Parts depend on whole numbers, truths and choices: declare a parameter for this choice, as `parameter stiff = true`."
_LETTERS = {*GENERIC, *(letter for domain in DOMAINS.values() for letter in domain.letters if letter)}
_WORDS = frozenset(  # of laws, attributes and domains
    {"time", "pi", "true", "false", "ground", "energy", "world", "body", "from", "to", "middle", "x", "y", "z"}
    | {"integral", "derivative", "effort", "flow"}
).union(DOMAINS, BUNDLES, (letter + side for letter in _LETTERS for side in ("", "1", "2")))


def taken(
    declarations: Declarations, scope: Scope, home: Scope, statements: Statements, bindings: Bindings
) -> Statements:
    """Return the statements of a block with those of the taken branch in the place of each `if`. Their quantities are declared.

    `home`: the scope of indexed names and parts. All conditions of a block are read before its branches: their order does not matter.
    """
    for statement in statements:
        if isinstance(statement, tree.Quantities):
            declarations.guard(declarations.declare_quantities, scope, statement, bindings)
    conditionals = [s for s in statements if type(s) is tree.ConditionalSyntax]
    if not conditionals:
        return statements
    for conditional in conditionals:
        for branch, words in _branches(conditional):
            _enter_all(scope, home, branch, words)
    choices = {id(c): declarations.guard(_holds, declarations, c.condition, scope) for c in conditionals}
    result: list[tree.SyntaxNode] = []
    for statement in statements:
        if not isinstance(statement, tree.ConditionalSyntax):
            result.append(statement)
        elif (first := choices[id(statement)]) is None:
            declarations.structure_broken = True
            for branch, _ in _branches(statement):
                _enter_all(scope, home, branch, "")
        else:
            branch, other = statement.statements, statement.otherwise
            branch, other = (branch, other) if first else (other, branch)
            check_untaken(scope, other, declarations.tell)
            result += taken(declarations, scope, home, branch, bindings)
    return tuple(result)


def check_blocks(declarations: Declarations, definition: ModelDefinition) -> None:
    """Report experiments in the blocks of `for` and `if`."""
    for outer in definition.model.statements:
        for statement in (s for block in inner_blocks(outer) for s in flat(block)):
            if isinstance(statement, tree.Experiment):
                hint = "An experiment stands in the model itself; its `set` chooses values and branches."
                declarations.tell(Unsupported(statement.span, "An experiment in a `for` or `if`", hint))


def _branches(conditional: tree.ConditionalSyntax) -> tuple[tuple[Statements, str], tuple[Statements, str]]:
    words = f"`if {conditional.condition.span.words}`"
    return (conditional.statements, words), (conditional.otherwise, f"the `else` of {words}")


def _holds(resolver: Resolver, condition: tree.ExpressionSyntax, scope: Scope) -> bool:
    """Return True if a condition on the structure holds in this scope. Raises `Wrong`, `AlreadyTold` or `ValuesNeeded`."""
    for path in paths_of(condition):
        if any(isinstance(step, tree.Member) for step in path.steps):
            what = f"Which parts there are depends on parameters, constants and indices, not on `{path.words}`"
            hint = "What changes during a run is for `if … else` in a law, `when`, or `active` of a junction."
            raise Wrong(WrongStructure(path.span, what, hint))
    template, bound = read_condition(resolver, condition, scope, _CONDITION)
    resolver.require_static(template, scope, "A condition on parts")
    value = resolver.value_of(bound, condition.span)
    if value is None:
        resolver.need_no_values()
        raise AlreadyTold
    resolver.structural |= quantities_in(bound)
    for name in sorted(behind(quantities_in(bound), resolver.quantities)):
        named = resolver.quantities[name]
        whole = named.value is None or named.value == round(named.value)
        if named.role == "parameter" and not (whole and named.unit == "1"):
            what = f"`{name}` decides which parts there are, but it is " + (
                f"a quantity in [{named.unit}]" if named.unit != "1" else f"{named.value:g}"
            )
            raise Wrong(WrongStructure(condition.span, what, _STRUCTURAL))
    return value != 0.0


def _enter_all(scope: Scope, home: Scope, statements: Statements, branch: str) -> None:
    """Enter the names of a branch as absent; as broken if the condition of the branch has an error (an empty `branch`)."""

    def enter(place: Scope, name: str, node: tree.SyntaxNode) -> None:
        entry: Entry = Absent(node.span, branch) if branch else Broken(node.span)
        if place.vacant(name):
            place.entries[name] = entry

    for statement in flat(statements):
        match statement:
            case tree.Quantities(items=items):
                for item in items:
                    enter(scope if item.index is None else home, item.name, item)
            case tree.PortsSyntax(items=ports):
                for port in ports:
                    enter(home, port.name, port)
            case tree.Declaration(names=names):
                for declared in names:
                    enter(home, declared.name, declared)
            case tree.MechanismSyntax(name=name):
                enter(home, name, statement)


def check_untaken(scope: Scope, statements: Statements, tell: Callable[[Diagnostic], None]) -> None:
    """Report names, kinds and functions of a branch that are not declared anywhere."""
    definition = scope.definition
    file = definition.file
    declared = names_in(definition.model, NAMED) | set(scope.names())
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
