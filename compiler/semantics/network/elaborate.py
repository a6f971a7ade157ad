"""Elaboration: the declarations of every instance enter its scope; elements, bonds and mechanisms are collected.

All names of an instance are declared first (loops unrolled, nested instances opened), so their order in the text does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ...graph.domains import Domain, multibond_of
from ...graph.elements import ELEMENTS
from ...scene import Override
from ...source import Span
from ...syntax import tree
from ...syntax.blocks import flat
from ..expressions.functions import check_function
from ..mechanisms.blocks import declare_mechanism
from ..names.domain_table import ELEMENT_KINDS, element_ports, junction_width, lone_multibond, wall_components
from ..names.errors import AbsentName, Cycle, DuplicateName, TooMany, UnknownAttribute, UnknownKind, WrongType
from ..names.foreign_words import kind_advice
from ..names.scope import (
    Absent,
    Broken,
    ElementEntry,
    InstanceEntry,
    MechanismEntry,
    ModelDefinition,
    Pending,
    Scalar,
    Scope,
    SlotEntry,
    WallEntry,
    functions_in,
    indexed,
)
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from ..resolution.declarations import Declarations
from ..resolution.elaboration_cache import ElaborationCache
from ..resolution.parameter_sets import WORD
from ..resolution.structure import check_blocks, taken

MAXIMUM_HIERARCHY = 60  # models within models


class Elaborator(Declarations):
    """Elaboration of one model. `part` allows open ports."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        self.elements: list[tuple[Scope, tree.Declaration, ElementEntry]] = []
        self.bonds: list[tuple[Scope, tree.Bonds]] = []
        self._blocks_checked: set[int] = set()  # definitions whose blocks hold what may stand there
        self.stands: dict[str, Span] = {}  # instance -> where it is declared
        self.requirements: list[tuple[Scope, tree.RequirementSyntax]] = []
        self.events: list[tuple[Scope, tree.EventSyntax]] = []
        self.mechanisms: list[tuple[Scope, tree.MechanismSyntax, MechanismEntry]] = []
        self.swept: tuple[tree.SweepSyntax, ...] = ()  # an experiment's own names: those that it sweeps

    # ------------------------------------------------------------ declaring

    def instantiate(
        self,
        definition: ModelDefinition,
        path: str,
        bindings: Mapping[str, tuple[tree.Attribute, Scope]],
        chain: tuple[ModelDefinition, ...],
        stands: Span | None = None,
    ) -> Scope:
        """Elaborate one instance. `bindings` are its attributes, each with the scope in which it is read."""
        scope = Scope(definition, path, stands=stands)
        if stands is not None:
            self.stands[path.removesuffix(".")] = stands
        if not chain:
            self.root = scope  # loops and indices may already read what is set from outside
            self._enter_swept(scope)
        self.table_of(definition)
        if id(definition) not in self._blocks_checked:
            self._blocks_checked.add(id(definition))
            check_blocks(self, definition)
        chain = (*chain, definition)
        self._declare(scope, definition.model.statements, bindings, chain)
        for name, (attribute, where) in bindings.items():
            entry = scope.entries.get(name)
            if isinstance(entry, Absent) and where in self.set_scopes():
                continue  # a set is handed over to what is there
            if isinstance(entry, Absent):
                self.tell(AbsentName(attribute.span, name, entry.branch, entry.span))
                continue
            settable = isinstance(entry, Pending) and entry.role in ("parameter", "input")
            if not settable and not isinstance(entry, SlotEntry | Broken) and getattr(entry, "word", "") != "set":
                known = [
                    n for n, e in scope.entries.items() if isinstance(e, Pending) and e.role in ("parameter", "input")
                ]
                hint = suggestion(name, known, f"Its parameters and inputs: {', '.join(known) or 'none'}.")
                if isinstance(entry, Pending) and entry.role == "constant":
                    hint = "It is a `constant`, which cannot be set from outside; declare it as `parameter`."
                self.tell(UnknownAttribute(attribute.span, definition.name, name, hint))
        return scope

    def _enter_swept(self, root: Scope) -> None:
        """Enter swept names that the model does not have as names of the experiment, with their first values."""
        own = {
            i.name for s in flat(root.definition.model.statements) if isinstance(s, tree.Quantities) for i in s.items
        }
        for study in self.swept:
            path = study.path
            if not path.steps and path.head not in own:
                item = tree.Item(path.span, path.head, None, study.unit, study.values[0], None)
                pending = Pending(item, "parameter", path.head, study.values[0], root, root, True)
                self.guard(self.enter, root, path.head, pending, path.span)
                self.pending.append(pending)

    def _declare(
        self,
        scope: Scope,
        statements: tuple[tree.SyntaxNode, ...],
        bindings: Mapping[str, tuple[tree.Attribute, Scope]],
        chain: tuple[ModelDefinition, ...],
    ) -> None:
        scope.functions = functions_in(statements)
        later: list[tree.SyntaxNode] = []
        functions: list[tree.FunctionSyntax] = []
        statements = taken(self, scope, scope.base(), statements, bindings)
        scope.functions = functions_in(statements)
        for statement in statements:
            match statement:
                case tree.PortsSyntax():
                    self.guard(self._declare_ports, scope, statement)
                    for item in statement.items:
                        if scope.base().vacant(item.name):
                            scope.base().entries[item.name] = Broken(item.span)
                            self.structure_broken = True
                case tree.Declaration() | tree.LoopSyntax() | tree.MechanismSyntax():
                    later.append(statement)
                case tree.Bonds():
                    self.bonds.append((scope, statement))
                case tree.RequirementSyntax():
                    self.requirements.append((scope, statement))
                case tree.EventSyntax():
                    self.events.append((scope, statement))
                case tree.FunctionSyntax():
                    functions.append(statement)
        for statement in later:
            match statement:
                case tree.Declaration():
                    before = len(self.diagnostics)
                    self.guard(self._declare_parts, scope, statement, chain)
                    for declared in statement.names:
                        if scope.base().vacant(declared.name):
                            scope.base().entries[declared.name] = Broken(declared.span)
                            self.structure_broken = True
                    self.structure_broken |= len(self.diagnostics) > before
                case tree.MechanismSyntax():
                    self.guard(self._declare_mechanism, scope, statement)
                case tree.LoopSyntax():
                    self.guard(self._unroll, scope, statement, chain)
        for function in functions:  # when all names are known
            self.guard(check_function, scope, function, statements)

    def _declare_ports(self, scope: Scope, statement: tree.PortsSyntax) -> None:
        for item in statement.items:
            index, _ = self._indexed_name(item, scope)
            ports = {}
            for component in wall_components(item):
                domain = self.domain_of(scope, (item.name, component))
                if domain is None:
                    raise self.unknown_domain(scope, item.span, (item.name, component))
                ports[component] = domain
            for place in self._places(item.name, index, item.width, scope):
                name = scope.full(item.name if place is None else indexed(item.name, place))
                self.walls[name] = wall = WallEntry(name, ports, item.span)
                self.enter_indexed(scope, item.name, place, wall, item.span)

    def _declare_parts(self, scope: Scope, statement: tree.Declaration, chain: tuple[ModelDefinition, ...]) -> None:
        if statement.kind in ELEMENT_KINDS:
            if statement.kind in scope.definition.file.missing:  # a model has the same name; already reported
                raise AlreadyTold
            for declared in statement.names:
                self.guard(self._declare_element, scope, statement, declared)
            return
        slot = scope.find(statement.kind)
        if isinstance(slot, Broken):
            raise AlreadyTold
        if isinstance(slot, Absent):
            raise Wrong(AbsentName(statement.span, statement.kind, slot.branch, slot.span))
        definition = (
            slot.definition if isinstance(slot, SlotEntry) else scope.definition.file.models.get(statement.kind)
        )
        if definition is None and statement.kind in scope.definition.file.missing:
            raise AlreadyTold
        if definition is None:
            known = [*ELEMENT_KINDS, *scope.definition.file.models]
            hint = suggestion(
                statement.kind,
                known,
                f"Kinds: {' '.join(ELEMENT_KINDS)}, and the models of this file or imported into it.",
            )
            hint = kind_advice(statement.kind, known, scope.definition.file.library) or hint
            raise Wrong(UnknownKind(statement.span, statement.kind, hint))
        if definition in chain:
            names = " -> ".join(d.name for d in (*chain[chain.index(definition) :], definition))
            raise Wrong(Cycle(statement.span, "A model contains itself", names))
        if len(chain) >= MAXIMUM_HIERARCHY:
            raise Wrong(TooMany(statement.span, "Models within models", MAXIMUM_HIERARCHY))
        if statement.definition is not None:
            hint = f"`{statement.kind}` is a model: its parameters are set in braces."
            raise Wrong(WrongType(statement.definition.span, "The end of the line or `{`", "a law", hint))
        for declared in statement.names:
            self.counted(declared.span)
            index, local = self._indexed_name(declared, scope)
            bindings: dict[str, tuple[tree.Attribute, Scope]] = {}
            sets: tree.Attribute | None = None
            for attribute in statement.attributes:
                if attribute.name == WORD and attribute.target is None and sets is None:
                    sets = attribute
                    continue
                if attribute.target is not None or attribute.name in bindings:
                    words = attribute.span.text.split("=")[0].strip()
                    hint = "Parameters and inputs are set once, as `name = value`."
                    self.tell(UnknownAttribute(attribute.span, declared.name, words, hint))
                    continue
                bindings[attribute.name] = (attribute, scope)
            if sets is not None:
                self.guard(self.hand_over, sets, definition, bindings, scope)
            inner = self.instantiate(definition, scope.full(local) + ".", bindings, chain, declared.span)
            self.enter_indexed(
                scope, declared.name, index, InstanceEntry(scope.full(local), inner, declared.span), declared.span
            )

    def _declare_element(self, scope: Scope, statement: tree.Declaration, declared: tree.Declared) -> None:
        self.counted(declared.span)
        row = ELEMENTS.get(statement.kind)
        lone = lone_multibond(statement, declared.name)
        if row is not None and row.least_ports > 1:
            count = len(self._ports_of(scope, statement, declared) if lone else declared.components)
            if count < row.least_ports:
                shown = f"`{lone}` alone" if lone else "a name alone"
                raise Wrong(WrongType(declared.span, "Two or more ports in parentheses", shown, row.ports_advice))
        index, _ = self._indexed_name(declared, scope)
        ports = self._ports_of(scope, statement, declared)
        for place in self._places(declared.name, index, junction_width(statement), scope):
            name = scope.full(declared.name if place is None else indexed(declared.name, place))
            entry = ElementEntry(name, statement.kind, statement, ports, declared.span)
            self.enter_indexed(scope, declared.name, place, entry, declared.span)
            self.elements.append((scope, statement, entry))
            self.element_names[entry.name] = entry

    def _places(
        self, name: str, index: tuple[int, ...] | None, width: tree.Index | None, scope: Scope
    ) -> list[tuple[int, ...] | None]:
        """Indices of a declared name: its own, with a further one for each bond of a width."""
        return [index if number == () else (*(index or ()), *number) for number in self.widths(width, scope, name)]

    def _ports_of(self, scope: Scope, statement: tree.Declaration, declared: tree.Declared) -> dict[str, Domain]:
        """The ports of an element with their domains; of a port of a width all: `p[1]`, `p[2]`."""
        ports: dict[str, Domain] = {}
        widths = {c.name: c.width for c in declared.components}
        for port in element_ports(statement, declared.name):
            domain = self.domain_of(scope, (declared.name, port))
            if domain is None:
                alone = declared.index is None and junction_width(statement) is None
                raise self.unknown_domain(scope, declared.span, (declared.name, port), alone)
            if (whole := multibond_of(port) or port) != port and widths.get(whole) is not None:
                hint = f"`{whole}` is as wide as its domain; junctions and ports of models may be several of it."
                raise Wrong(WrongType(declared.span, f"One multibond `{whole}`", "several", hint))
            if statement.kind not in ELEMENTS and widths.get(port) is not None:
                hint = f"A junction of a width has the bonds `{declared.name}[1]`, `{declared.name}[2]`; list others by their names."
                raise Wrong(WrongType(declared.span, f"One bond `{port}`", "several", hint))
            for number in self.widths(widths.get(port), scope, port):
                name = indexed(port, number) if number else port
                if name in ports:
                    raise Wrong(DuplicateName(declared.span, name, declared.span))
                ports[name] = domain
        return ports

    def _indexed_name(
        self, named: tree.Declared | tree.PortItem | tree.MechanismSyntax, scope: Scope
    ) -> tuple[tuple[int, ...] | None, str]:
        """Index of a declared name, if it has one, and the name with it. In a loop it must have one."""
        index = self.index_of(named.index, scope)
        if index is not None:
            return index, indexed(named.name, index)
        if scope.outer is not None:
            hint = f"What stands in a `for` carries an index: `{named.name}[{_loop_names(scope)}]`."
            raise Wrong(WrongType(named.span, "An index", "a name alone", hint))
        return None, named.name

    def _unroll(self, scope: Scope, loop: tree.LoopSyntax, chain: tuple[ModelDefinition, ...]) -> None:
        rounds, before, outermost = self.rounds(loop, scope), self.count, scope.outer is None and not scope.path
        for done, number in enumerate(rounds):
            if outermost:
                self.progress = before, done / len(rounds)
            inner = self.round_scope(scope, loop.name, number)
            self._declare(inner, loop.statements, {}, chain)
        self.progress = None if outermost else self.progress

    def _declare_mechanism(self, scope: Scope, statement: tree.MechanismSyntax) -> None:
        index, local = self._indexed_name(statement, scope)
        entry = declare_mechanism(self, scope, statement, local)
        self.enter_indexed(scope, statement.name, index, entry, statement.span)
        self.mechanisms.append((scope, statement, entry))


def _loop_names(scope: Scope) -> str:
    names: list[str] = []
    inner: Scope | None = scope
    while inner is not None and inner.outer is not None:
        names += [n for n, e in inner.entries.items() if isinstance(e, Scalar) and e.role == "index"]
        inner = inner.outer
    return ", ".join(reversed(names))
