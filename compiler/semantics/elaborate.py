"""Elaboration: the declarations of every instance enter its scope; elements, bonds and mechanisms are collected.

All names of an instance are declared first (loops unrolled, nested instances opened), so their order in the text does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import CompilationFailed
from ..graph.domains import DOMAINS, Domain
from ..graph.network import Requirement
from ..graph.units import ONE
from ..scene import Override
from ..source import Span
from ..syntax import tree
from .domain_table import ELEMENT_KINDS, domain_table, element_ports, is_slot, wall_components, wall_items
from .errors import (
    Cycle,
    DuplicateName,
    ReservedName,
    TooMany,
    UnknownAttribute,
    UnknownDomain,
    UnknownKind,
    Unsupported,
    WrongConnection,
    WrongType,
)
from .known import Known
from .mechanisms import declare_mechanism
from .own_functions import check_function
from .port_domains import DomainTable
from .quantities import QuantityResolver
from .resolve import indexed
from .scope import (
    RESERVED,
    Array,
    Broken,
    ElementEntry,
    Entry,
    InstanceEntry,
    MechanismEntry,
    ModelDefinition,
    Pending,
    Scalar,
    Scope,
    SlotEntry,
    WallEntry,
)
from .statement_errors import AlreadyTold, Wrong, suggestion

MAXIMUM_INSTANCES = 100_000  # instances, elements, junctions, quantities and rounds of loops together
MAXIMUM_ROUNDS = 100_000  # rounds of one loop
MAXIMUM_HIERARCHY = 60  # models within models


class Elaborator(QuantityResolver):
    """Elaboration of one model. `part` allows open ports."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: Known) -> None:
        super().__init__(overrides, part, known)
        self.elements: list[tuple[Scope, tree.Declaration, ElementEntry]] = []
        self.bonds: list[tuple[Scope, tree.Bonds]] = []
        self.stands: dict[str, Span] = {}  # instance -> where it is declared
        self.requirements: list[tuple[Scope, tree.Requirement]] = []
        self.limits: list[Requirement] = []  # those of joints
        self.events: list[tuple[Scope, tree.Event]] = []
        self.mechanisms: list[tuple[Scope, tree.Mechanism, MechanismEntry]] = []
        self.mechanism_parts: dict[str, Any] = {}
        self.swept: tuple[tree.Study, ...] = ()  # an experiment's own names: those that it sweeps
        self.count = 0
        self.structure_broken = False  # then missing connections would be reported for the wrong reason
        self._tables = known.tables

    def table_of(self, definition: ModelDefinition) -> DomainTable:
        """Domain table of a definition, computed once."""
        key = id(definition)
        if key not in self._tables:
            self._tables[key] = DomainTable()  # seen by a model that contains itself; the cycle is reported elsewhere
            self._tables[key] = domain_table(definition, self.table_of)
            self.diagnostics += self._tables[key].diagnostics
        return self._tables[key]

    def counted(self, span: Span, more: int = 1) -> None:
        """Count one more instance, element, junction, quantity or round, up to the limit."""
        self.count += more
        if self.count > MAXIMUM_INSTANCES:
            limit = TooMany(span, "Instances, elements, junctions, quantities and rounds", MAXIMUM_INSTANCES)
            raise CompilationFailed([*self.diagnostics, limit])

    # ------------------------------------------------------------ declaring
    def open_root(self, definition: ModelDefinition) -> Scope:
        """Elaborate the main model."""
        self.root = self.instantiate(definition, "", {}, ())
        return self.root

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
        chain = (*chain, definition)
        self._declare(scope, definition.model.statements, bindings, chain)
        for name, (attribute, _) in bindings.items():
            entry = scope.entries.get(name)
            settable = isinstance(entry, Pending) and entry.role in ("parameter", "input")
            if not settable and not isinstance(entry, SlotEntry | Broken):
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
        own = {i.name for s in root.definition.model.statements if isinstance(s, tree.Quantities) for i in s.items}
        for study in self.swept:
            path = study.paths[0]
            if not path.steps and path.head not in own:
                item = tree.Item(path.span, path.head, None, study.unit, study.values[0], None)
                pending = Pending(item, "parameter", path.head, study.values[0], root, root, True)
                self.guard(self.enter, root, path.head, pending, path.span)
                self.pending.append(pending)

    def _declare(
        self,
        scope: Scope,
        statements: tuple[tree.Node, ...],
        bindings: Mapping[str, tuple[tree.Attribute, Scope]],
        chain: tuple[ModelDefinition, ...],
    ) -> None:
        later: list[tree.Node] = []
        functions: list[tree.Function] = []
        for statement in statements:
            match statement:
                case tree.Quantities():
                    self.guard(self.declare_quantities, scope, statement, bindings)
                case tree.Ports():
                    self.guard(self._declare_ports, scope, statement)
                case tree.Declaration() | tree.Loop() | tree.Mechanism():
                    later.append(statement)
                case tree.Bonds():
                    self.bonds.append((scope, statement))
                case tree.Requirement():
                    self.requirements.append((scope, statement))
                case tree.Event():
                    self.events.append((scope, statement))
                case tree.Function():
                    functions.append(statement)
        for statement in later:
            match statement:
                case tree.Declaration():
                    before = len(self.diagnostics)
                    self.guard(self._declare_parts, scope, statement, chain)
                    for declared in statement.names:
                        if declared.name not in scope.base().entries:
                            scope.base().entries[declared.name] = Broken(declared.span)
                            self.structure_broken = True
                    self.structure_broken |= len(self.diagnostics) > before
                case tree.Mechanism():
                    self.guard(self._declare_mechanism, scope, statement)
                case tree.Loop():
                    self.guard(self._unroll, scope, statement, chain)
        for function in functions:  # when all names are known
            self.guard(check_function, scope, function)

    def enter(self, scope: Scope, name: str, entry: Entry, span: Span) -> None:
        """Enter a name in a scope. If it is declared twice, the later declaration in the text is the error."""
        if name in RESERVED:
            raise Wrong(ReservedName(span, name))
        before = scope.entries.get(name)
        if before is None:
            scope.entries[name] = entry
            return
        first = before.item.span if isinstance(before, Pending) else getattr(before, "span", span)
        if isinstance(before, Broken):
            raise AlreadyTold
        if first.source is span.source and first.start > span.start:  # quantities are entered before elements
            scope.entries[name] = entry
            self.tell(DuplicateName(first, name, span))
            return
        raise Wrong(DuplicateName(span, name, first))

    def _enter_indexed(self, scope: Scope, name: str, index: tuple[int, ...] | None, entry: Entry, span: Span) -> None:
        if index is None:
            self.enter(scope, name, entry, span)
            return
        home = scope.base()
        array = home.entries.get(name)
        if isinstance(array, Broken):
            raise AlreadyTold
        if array is None:
            array = Array(name, span)
            self.enter(home, name, array, span)
        if not isinstance(array, Array) or index in array.items:
            first = array.item.span if isinstance(array, Pending) else getattr(array, "span", span)
            raise Wrong(DuplicateName(span, indexed(name, index), first))
        array.items[index] = entry

    def declare_quantities(
        self, scope: Scope, statement: tree.Quantities, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        for item in statement.items:
            before = len(self.diagnostics)
            self.guard(self._declare_quantity, scope, statement.role, item, bindings)
            if len(self.diagnostics) > before:
                scope.entries.setdefault(item.name, Broken(item.span))

    def _declare_quantity(
        self, scope: Scope, role: str, item: tree.Item, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        if role == "parameter" and is_slot(item):
            self._declare_slot(scope, item, bindings)
            return
        self.counted(item.span)
        index = self.index_of(item.index, scope)
        value, where, is_default = item.value, scope, True
        if item.name in bindings and role in ("parameter", "input") and index is None:
            value, where, is_default = bindings[item.name][0].value, bindings[item.name][1], False
        local = indexed(item.name, index) if index is not None else item.name + scope.suffix
        pending = Pending(item, role, scope.full(local), value, where, scope, is_default)
        self._enter_indexed(scope, item.name, index, pending, item.span)
        self.pending.append(pending)

    def _declare_slot(
        self, scope: Scope, item: tree.Item, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        """Declare a slot, `parameter Joint: model = Flexure`: a kind that an instance or a setting may replace by another model."""
        default = self._model_of(item.value, scope, item.span)
        found, span = default, item.span
        override = self.overrides.get(scope.full(item.name))
        if override is not None:
            self.used_overrides.add(override.path)
            value = None if isinstance(override.value, float) else override.value
            found, span = self._model_of(value, scope, override.span), override.span
        elif item.name in bindings:
            attribute, where = bindings[item.name]
            found, span = self._model_of(attribute.value, where, attribute.span), attribute.span
        wanted, given = self._walls(default), self._walls(found)
        if wanted != given:
            what = f"`{found.name}` cannot stand for `{default.name}`: its ports are {_listed(given)}, not {_listed(wanted)}"
            raise Wrong(WrongConnection(span, what, "A model in a slot has ports of the same names and domains."))
        self.enter(scope, item.name, SlotEntry(found, item.span), item.span)

    def _model_of(self, value: tree.Expression | None, scope: Scope, span: Span) -> ModelDefinition:
        """Return the model that the value of a slot names."""
        name = value.words if isinstance(value, tree.Path) else ""
        entry = scope.find(name)
        if isinstance(entry, SlotEntry):
            return entry.definition
        definition = scope.definition.file.models.get(name)
        if definition is None:
            hint = suggestion(
                name, list(scope.definition.file.models), "A slot names a model: `parameter Joint: model = Flexure`."
            )
            raise Wrong(UnknownKind(span if value is None else value.span, name or "this", hint))
        return definition

    def _walls(self, definition: ModelDefinition) -> dict[str, str]:
        """Ports of a model, by name, with the names of their domains."""
        table = self.table_of(definition)
        walls = {}
        for item in wall_items(definition.model):
            name = item.name if item.index is None else f"{item.name}[…]"
            for component in wall_components(item):
                domain = table.of(item.name, component)
                walls[f"{name}.{component}".rstrip(".")] = domain.name if domain else "unknown"
        return walls

    def _declare_ports(self, scope: Scope, statement: tree.Ports) -> None:
        for item in statement.items:
            index = self.index_of(item.index, scope)
            if index is None and scope.outer is not None:
                hint = f"What stands in a `for` carries an index: `{item.name}[{_loop_names(scope)}]`."
                raise Wrong(WrongType(item.span, "An index", "a name alone", hint))
            ports = {}
            for component in wall_components(item):
                domain = self.domain_of(scope, (item.name, component))
                if domain is None:
                    raise self.unknown_domain(scope, item.span, item.name)
                ports[component] = domain
            local = item.name if index is None else indexed(item.name, index)
            wall = WallEntry(scope.full(local), ports, item.span)
            self._enter_indexed(scope, item.name, index, wall, item.span)
            self.walls[wall.name] = wall

    def unknown_domain(self, scope: Scope, span: Span, name: str) -> Exception:
        """Error for a port of unknown domain. If the domains of its model have errors, these are already reported: `AlreadyTold`."""
        if self.table_of(scope.definition).diagnostics:
            return AlreadyTold()
        return Wrong(UnknownDomain(span, name))

    def domain_of(self, scope: Scope, key: tuple[str, ...]) -> Domain | None:
        if scope.plain:
            return DOMAINS["untyped"]
        return self.table_of(scope.definition).of(*key)

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
                "Kinds: Se Sf MSe MSf C I IC R MR RS TF GY MTF MGY 0 1 splitter, and the models of this file or imported into it.",
            )
            raise Wrong(UnknownKind(statement.span, statement.kind, hint))
        if definition in chain:
            names = " -> ".join(d.name for d in (*chain[chain.index(definition) :], definition))
            raise Wrong(Cycle(statement.span, "A model contains itself", names))
        if len(chain) >= MAXIMUM_HIERARCHY:
            raise Wrong(TooMany(statement.span, "Models within models", MAXIMUM_HIERARCHY))
        if statement.definition is not None:
            raise Wrong(
                WrongType(
                    statement.definition.span,
                    "The end of the line or `{`",
                    "a law",
                    f"`{statement.kind}` is a model: its parameters are set in braces.",
                )
            )
        for declared in statement.names:
            self.counted(declared.span)
            index = self.index_of(declared.index, scope)
            local = indexed(declared.name, index) if index is not None else declared.name
            if index is None and scope.outer is not None:
                raise Wrong(
                    WrongType(
                        declared.span,
                        "An index",
                        "a name alone",
                        f"What stands in a `for` carries an index: `{declared.name}[{_loop_names(scope)}]`.",
                    )
                )
            bindings: dict[str, tuple[tree.Attribute, Scope]] = {}
            for attribute in statement.attributes:
                if attribute.target is not None or attribute.name in bindings:
                    self.tell(
                        UnknownAttribute(
                            attribute.span,
                            declared.name,
                            attribute.span.text.split("=")[0].strip(),
                            "Parameters and inputs are set once, as `name = value`.",
                        )
                    )
                    continue
                bindings[attribute.name] = (attribute, scope)
            inner = self.instantiate(definition, scope.full(local) + ".", bindings, chain, declared.span)
            self._enter_indexed(
                scope, declared.name, index, InstanceEntry(scope.full(local), inner, declared.span), declared.span
            )

    def _declare_element(self, scope: Scope, statement: tree.Declaration, declared: tree.Declared) -> None:
        self.counted(declared.span)
        if statement.kind in ("IC", "RS") and len(declared.components) < 2:
            hint = (
                "An RS has a port for what it loses: `RS pad(shaft, heat)`."
                if statement.kind == "RS"
                else "With one port it is a C or an I."
            )
            raise Wrong(WrongType(declared.span, "Two or more ports in parentheses", "a name alone", hint))
        index = self.index_of(declared.index, scope)
        if index is None and scope.outer is not None:
            raise Wrong(
                WrongType(
                    declared.span,
                    "An index",
                    "a name alone",
                    f"What stands in a `for` carries an index: `{declared.name}[{_loop_names(scope)}]`.",
                )
            )
        local = indexed(declared.name, index) if index is not None else declared.name
        ports: dict[str, Domain] = {}
        for port in element_ports(statement, declared.name):
            domain = self.domain_of(scope, (declared.name, port))
            if domain is None:
                name = f"{declared.name}.{port}" if port and port not in "12" else declared.name
                raise self.unknown_domain(scope, declared.span, name)
            if port in ports:
                raise Wrong(DuplicateName(declared.span, port, declared.span))
            ports[port] = domain
        entry = ElementEntry(scope.full(local), statement.kind, statement, ports, declared.span)
        self._enter_indexed(scope, declared.name, index, entry, declared.span)
        self.elements.append((scope, statement, entry))
        self.element_names[entry.name] = entry

    def _unroll(self, scope: Scope, loop: tree.Loop, chain: tuple[ModelDefinition, ...]) -> None:
        for number in self.rounds(loop, scope):
            inner = self.round_scope(scope, loop.name, number)
            self._declare(inner, loop.statements, {}, chain)

    def rounds(self, loop: tree.Loop, scope: Scope) -> range:
        """The numbers that a loop runs over."""
        if loop.name in RESERVED:
            raise Wrong(ReservedName(loop.span, loop.name))
        first, last = self.integer(loop.range.first, scope), self.integer(loop.range.last, scope)
        if last - first >= MAXIMUM_ROUNDS:
            raise Wrong(TooMany(loop.range.span, "Rounds of a `for`", MAXIMUM_ROUNDS))
        self.counted(loop.range.span, max(0, last - first + 1))
        return range(first, last + 1)

    @staticmethod
    def round_scope(scope: Scope, name: str, number: int) -> Scope:
        """The scope of one round."""
        inner = Scope(scope.definition, scope.path, f"{scope.suffix}[{number}]", scope)
        inner.entries[name] = Scalar(float(number), ONE, "index", name)
        return inner

    def _declare_mechanism(self, scope: Scope, statement: tree.Mechanism) -> None:
        if scope.outer is not None:
            raise Wrong(
                Unsupported(
                    statement.span,
                    "A `multibody` block in a `for`",
                    "Put the `for` inside the block, or the block into a model of its own.",
                )
            )
        entry = declare_mechanism(self, scope, statement)
        self.enter(scope, statement.name, entry, statement.span)
        self.mechanisms.append((scope, statement, entry))


def _listed(walls: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {domain}" for name, domain in walls.items()) or "none"


def _loop_names(scope: Scope) -> str:
    names: list[str] = []
    inner: Scope | None = scope
    while inner is not None and inner.outer is not None:
        names += [n for n, e in inner.entries.items() if isinstance(e, Scalar) and e.role == "index"]
        inner = inner.outer
    return ", ".join(reversed(names))
