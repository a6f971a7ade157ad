"""Conditional parts: the conditions of `if` blocks, read before the run, and the statements of the branches that are taken."""

from __future__ import annotations

from collections.abc import Mapping

from ...graph.run_time_parameters import behind, quantities_in
from ...syntax import tree
from ...syntax.blocks import Statements, flat, inner_blocks
from ..names.domain_table import paths_of
from ..names.errors import NotStatic, Unsupported, WrongStructure
from ..names.scope import STATIC_ROLES, Absent, Broken, Entry, ModelDefinition, Scope
from ..names.statement_errors import AlreadyTold, Wrong
from .declarations import Declarations
from .resolver import Resolver, read_condition
from .untaken import check_untaken

Bindings = Mapping[str, tuple[tree.Attribute, Scope]]
_CONDITION = "Parts depend on a condition: `if heated { … }`, `if n > 1 { … }`."
_STRUCTURAL = "Parts depend on whole numbers, truths and choices: declare a parameter for this choice, as `parameter stiff = true`."


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
    for slot in template.slots:
        if resolver.scalar_at(slot, scope).role not in STATIC_ROLES:
            raise Wrong(NotStatic(slot.path.span, "A condition on parts", slot.words))
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
