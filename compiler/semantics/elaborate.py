"""Instances opened: every declaration of every instance becomes nodes and named quantities of one flat model.

First all names of an instance are declared (its loops unrolled, its own instances opened), then quantities are resolved when
they are first asked for, so their order in the text does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..algebra.expression import ZERO, evaluate
from ..algebra.formula import Bound, Formula
from ..errors import CompilationFailed, Diagnostic
from ..graph.network import TIME, Named, Quantity, Reading
from ..scene import Override
from ..source import Span
from ..syntax import tree
from .domain_table import ELEMENT_KINDS, DomainTable, domain_table, element_ports, wall_components
from ..graph.domains import DOMAINS, GENERIC, Domain
from .errors import (
    Cycle,
    DimensionMismatch,
    DuplicateName,
    MissingValue,
    NotStatic,
    NoValue,
    ReservedName,
    TooMany,
    UnknownAttribute,
    UnknownDomain,
    UnknownKind,
    UnknownName,
    Unsupported,
    WrongIndex,
    WrongType,
)
from .scope import (
    RESERVED,
    STATIC_ROLES,
    AlreadyTold,
    Array,
    Broken,
    ElementEntry,
    Entry,
    InstanceEntry,
    Items,
    MechanismEntry,
    ModelDefinition,
    PartEntry,
    Pending,
    Scalar,
    Scope,
    WallEntry,
    Wrong,
    describe,
    suggestion,
)
from .typed import ExpressionCompiler, Readable, Slot, Template, Typed, bare, bind_template, scale_of
from ..graph.units import ONE, SECOND, Dimension, Scale

MAXIMUM_INSTANCES = 200_000  # instances, elements and junctions together
MAXIMUM_ROUNDS = 100_000  # rounds of one loop
MAXIMUM_HIERARCHY = 60  # models within models


class Elaborator:
    """Opens one model. `diagnostics` collects what is wrong; `part` allows open ports and missing values (for `check`)."""

    def __init__(self, overrides: Iterable[Override], part: bool) -> None:
        self.part = part
        self.overrides = {o.path: o for o in overrides if o.role == "set"}
        self.used_overrides: set[str] = set()
        self.diagnostics: list[Diagnostic] = []
        self.quantities: dict[str, Named] = {}
        self.elements: list[tuple[Scope, tree.Declaration, ElementEntry]] = []
        self.element_names: dict[str, ElementEntry] = {}
        self.bonds: list[tuple[Scope, tree.Bonds]] = []
        self.mechanisms: list[tuple[Scope, tree.Mechanism, MechanismEntry]] = []
        self.mechanism_parts: dict[str, Any] = {}
        self.pending: list[Pending] = []
        self._file_constants: dict[str, Pending] = {}
        self.count = 0
        self.structure_broken = False  # then what is not connected would be told for the wrong reason
        self._templates: dict[tuple[int, Scale | None], Template] = {}
        self._tables: dict[int, DomainTable] = {}
        self._keep: list[Any] = []  # nodes whose identity is a key above must not be freed

    # ------------------------------------------------------------ collecting
    def tell(self, diagnostic: Diagnostic) -> None:
        self.diagnostics.append(diagnostic)

    def table_of(self, definition: ModelDefinition) -> DomainTable:
        """The domains of a definition, spread once."""
        key = id(definition)
        if key not in self._tables:
            self._tables[key] = DomainTable()  # a model that contains itself sees this empty one; the cycle is told elsewhere
            self._tables[key] = domain_table(definition, self.table_of)
            self.diagnostics += self._tables[key].diagnostics
        return self._tables[key]

    def _counted(self, span: Span) -> None:
        self.count += 1
        if self.count > MAXIMUM_INSTANCES:
            raise CompilationFailed([*self.diagnostics, TooMany(span, "Instances, elements and junctions", MAXIMUM_INSTANCES)])

    # ------------------------------------------------------------ declaring
    def open_root(self, definition: ModelDefinition) -> Scope:
        """Open the model that is run."""
        self.root = self.instantiate(definition, "", {}, ())
        return self.root

    def instantiate(self, definition: ModelDefinition, path: str, bindings: Mapping[str, tuple[tree.Attribute, Scope]], chain: tuple[ModelDefinition, ...]) -> Scope:
        """Open one instance. `bindings` are its attributes, read in the scope where it stands."""
        scope = Scope(definition, path)
        if not chain:
            self.root = scope  # loops and indices may already read what is set from outside
        self.table_of(definition)
        chain = (*chain, definition)
        self._declare(scope, definition.model.statements, bindings, chain)
        for name, (attribute, _) in bindings.items():
            entry = scope.entries.get(name)
            if not (isinstance(entry, Pending) and entry.role in ("parameter", "input")):
                known = [n for n, e in scope.entries.items() if isinstance(e, Pending) and e.role in ("parameter", "input")]
                hint = suggestion(name, known, f"Its parameters and inputs: {', '.join(known) or 'none'}.")
                if isinstance(entry, Pending) and entry.role == "constant":
                    hint = "It is a `constant`, which cannot be set from outside; declare it as `parameter`."
                self.tell(UnknownAttribute(attribute.span, definition.name, name, hint))
        return scope

    def _declare(self, scope: Scope, statements: tuple[tree.Node, ...], bindings: Mapping[str, tuple[tree.Attribute, Scope]], chain: tuple[ModelDefinition, ...]) -> None:
        later: list[tree.Node] = []
        for statement in statements:
            match statement:
                case tree.Quantities():
                    self._guard(self._declare_quantities, scope, statement, bindings)
                case tree.Ports():
                    self._guard(self._declare_ports, scope, statement)
                case tree.Declaration() | tree.Loop() | tree.Mechanism():
                    later.append(statement)
                case tree.Bonds():
                    self.bonds.append((scope, statement))
                case tree.Event():
                    self.tell(Unsupported(statement.span, "`when`", "Events are planned; a smooth law (tanh, a stiff spring) can stand in for many."))
                case tree.Function():
                    self.tell(Unsupported(statement.span, "A function inside a model", "Define it in the file, outside of models."))
        for statement in later:
            match statement:
                case tree.Declaration():
                    before = len(self.diagnostics)
                    self._guard(self._declare_parts, scope, statement, chain)
                    if len(self.diagnostics) > before:
                        self.structure_broken = True
                        for declared in statement.names:
                            scope.base().entries.setdefault(declared.name, Broken(declared.span))
                case tree.Mechanism():
                    self._guard(self._declare_mechanism, scope, statement)
                case tree.Loop():
                    self._guard(self._unroll, scope, statement, chain)

    def _guard(self, action: Any, *arguments: Any) -> Any:
        """Run one statement; what is wrong in it is collected."""
        try:
            return action(*arguments)
        except Wrong as wrong:
            self.tell(wrong.diagnostic)
        except AlreadyTold:
            pass
        return None

    guard = _guard

    def _enter(self, scope: Scope, name: str, entry: Entry, span: Span) -> None:
        if name in RESERVED:
            raise Wrong(ReservedName(span, name))
        if name in scope.entries:
            before = scope.entries[name]
            first = before.item.span if isinstance(before, Pending) else getattr(before, "span", span)
            raise Wrong(DuplicateName(span, name, first))
        scope.entries[name] = entry

    def _enter_indexed(self, scope: Scope, name: str, index: tuple[int, ...] | None, entry: Entry, span: Span) -> None:
        if index is None:
            self._enter(scope, name, entry, span)
            return
        home = scope.base()
        array = home.entries.get(name)
        if isinstance(array, Broken):
            raise AlreadyTold
        if array is None:
            array = Array(name, span)
            self._enter(home, name, array, span)
        if not isinstance(array, Array) or index in array.items:
            raise Wrong(DuplicateName(span, _indexed(name, index), getattr(array, "span", span)))
        array.items[index] = entry

    def _declare_quantities(self, scope: Scope, statement: tree.Quantities, bindings: Mapping[str, tuple[tree.Attribute, Scope]]) -> None:
        for item in statement.items:
            if statement.role == "mode":
                self.tell(Unsupported(item.span, "`mode`", "Modes come with events."))
                continue
            index = self.index_of(item.index, scope)
            value, where, is_default = item.value, scope, True
            if item.name in bindings and statement.role in ("parameter", "input") and index is None:
                value, where, is_default = bindings[item.name][0].value, bindings[item.name][1], False
            local = _indexed(item.name, index) if index is not None else item.name + scope.suffix
            pending = Pending(item, statement.role, scope.full(local), value, where, scope, is_default)
            self._enter_indexed(scope, item.name, index, pending, item.span)
            self.pending.append(pending)

    def _declare_ports(self, scope: Scope, statement: tree.Ports) -> None:
        for item in statement.items:
            if item.index is not None:
                raise Wrong(Unsupported(item.span, "An array of ports", "Name the ports one by one."))
            ports = {}
            for component in wall_components(item):
                domain = self.domain_of(scope, (item.name, component))
                if domain is None:
                    raise Wrong(UnknownDomain(item.span, item.name))
                ports[component] = domain
            self._enter(scope, item.name, WallEntry(scope.full(item.name), ports, item.span), item.span)

    def domain_of(self, scope: Scope, key: tuple[str, ...]) -> Domain | None:
        if scope.plain:
            return DOMAINS["untyped"]
        return self.table_of(scope.definition).of(*key)

    def _declare_parts(self, scope: Scope, statement: tree.Declaration, chain: tuple[ModelDefinition, ...]) -> None:
        if statement.kind in ELEMENT_KINDS:
            for declared in statement.names:
                self._guard(self._declare_element, scope, statement, declared)
            return
        definition = scope.definition.file.models.get(statement.kind)
        if definition is None:
            known = [*ELEMENT_KINDS, *scope.definition.file.models]
            hint = suggestion(statement.kind, known, "Kinds: Se Sf MSe MSf C I R MR TF GY MTF MGY 0 1 splitter, and the models of this file or imported into it.")
            raise Wrong(UnknownKind(statement.span, statement.kind, hint))
        if definition in chain:
            names = " -> ".join(d.name for d in (*chain[chain.index(definition) :], definition))
            raise Wrong(Cycle(statement.span, "A model contains itself", names))
        if len(chain) >= MAXIMUM_HIERARCHY:
            raise Wrong(TooMany(statement.span, "Models within models", MAXIMUM_HIERARCHY))
        if statement.definition is not None:
            raise Wrong(WrongType(statement.definition.span, "The end of the line or `{`", "a law", f"`{statement.kind}` is a model: its parameters are set in braces."))
        for declared in statement.names:
            self._counted(declared.span)
            index = self.index_of(declared.index, scope)
            local = _indexed(declared.name, index) if index is not None else declared.name
            if index is None and scope.outer is not None:
                raise Wrong(WrongType(declared.span, "An index", "a name alone", f"What stands in a `for` carries an index: `{declared.name}[{_loop_names(scope)}]`."))
            bindings: dict[str, tuple[tree.Attribute, Scope]] = {}
            for attribute in statement.attributes:
                if attribute.target is not None or attribute.name in bindings:
                    self.tell(UnknownAttribute(attribute.span, declared.name, attribute.span.text.split("=")[0].strip(), "Parameters and inputs are set once, as `name = value`."))
                    continue
                bindings[attribute.name] = (attribute, scope)
            inner = self.instantiate(definition, scope.full(local) + ".", bindings, chain)
            self._enter_indexed(scope, declared.name, index, InstanceEntry(scope.full(local), inner, declared.span), declared.span)

    def _declare_element(self, scope: Scope, statement: tree.Declaration, declared: tree.Declared) -> None:
        self._counted(declared.span)
        if statement.kind in ("IC", "RS"):
            what = "`IC`" if statement.kind == "IC" else "`RS`"
            raise Wrong(Unsupported(statement.span, what, "Use C, I and R with several ports where that is enough."))
        index = self.index_of(declared.index, scope)
        if index is None and scope.outer is not None:
            raise Wrong(WrongType(declared.span, "An index", "a name alone", f"What stands in a `for` carries an index: `{declared.name}[{_loop_names(scope)}]`."))
        local = _indexed(declared.name, index) if index is not None else declared.name
        ports: dict[str, Domain] = {}
        for port in element_ports(statement, declared.name):
            domain = self.domain_of(scope, (declared.name, port))
            if domain is None:
                raise Wrong(UnknownDomain(declared.span, f"{declared.name}.{port}" if port and port not in "12" else declared.name))
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
        return range(first, last + 1)

    @staticmethod
    def round_scope(scope: Scope, name: str, number: int) -> Scope:
        """The scope of one round."""
        inner = Scope(scope.definition, scope.path, f"{scope.suffix}[{number}]", scope)
        inner.entries[name] = Scalar(float(number), ONE, "index", name)
        return inner

    def _declare_mechanism(self, scope: Scope, statement: tree.Mechanism) -> None:
        from .mechanisms import declare_mechanism

        if scope.outer is not None:
            raise Wrong(Unsupported(statement.span, "A `multibody` block in a `for`", "Put the `for` inside the block, or the block into a model of its own."))
        entry = declare_mechanism(self, scope, statement)
        self._enter(scope, statement.name, entry, statement.span)
        self.mechanisms.append((scope, statement, entry))

    # ------------------------------------------------------------ static values
    def index_of(self, index: tree.Index | None, scope: Scope) -> tuple[int, ...] | None:
        return None if index is None else tuple(self.integer(i, scope) for i in index.items)

    def integer(self, expression: tree.Expression, scope: Scope) -> int:
        """A whole number known before the run."""
        value = self.static(expression, scope, "A range or index")
        if value != round(value) or abs(value) > 1e9:
            raise Wrong(WrongType(expression.span, "A whole number", f"{value:g}"))
        return round(value)

    def static(self, expression: tree.Expression, scope: Scope, what: str, dimension: Dimension = ONE) -> float:
        """A number known before the run, in SI."""
        if isinstance(expression, tree.Literal) and expression.unit is None and dimension == ONE:
            return float(expression.number)
        template = self.template(expression, scope)
        typed = template.value
        if not isinstance(typed, Typed):
            raise Wrong(WrongType(expression.span, "A single number", "a list"))
        if typed.dimension is not None and typed.dimension != dimension:
            raise Wrong(DimensionMismatch(expression.span, f"{what} is in {describe(dimension)}", describe(dimension), f"`{expression.span.text}` is {describe(typed.dimension)}", ""))
        for slot in template.slots:
            scalar = self.scalar_at(slot, scope)
            if scalar.role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, what, slot.path.words))
        value = self.value_of(self.bind(template, template.formulas[0], scope), expression.span)
        if value is None:
            raise AlreadyTold
        return value

    def value_of(self, bound: Bound, span: Span) -> float | None:
        """The value of what does not change during a run; None where something has no value yet. Raises `Wrong`."""

        def lookup(key: Any) -> float:
            reference = bound.arguments[key]
            if isinstance(reference, Quantity):
                value = self.quantities[reference.name].value
                if value is None:
                    raise AlreadyTold
                return value
            if isinstance(reference, float):
                return reference
            raise AlreadyTold

        try:
            value = evaluate(bound.formula.expression, lookup)
        except AlreadyTold:
            return None
        except (ArithmeticError, ValueError) as error:
            raise Wrong(NoValue(span, str(error) or type(error).__name__, self._values(bound))) from None
        if not math.isfinite(value):
            raise Wrong(NoValue(span, "it overflows", self._values(bound)))
        return value

    def _values(self, bound: Bound) -> str:
        parts = []
        for reference in bound.arguments:
            if isinstance(reference, Quantity) and reference.name in self.quantities:
                named = self.quantities[reference.name]
                parts.append(f"{named.name} = {named.value:g} {named.unit if named.unit != '1' else ''}".strip() if named.value is not None else named.name)
        return "With " + ", ".join(parts) + "." if parts else ""

    # ------------------------------------------------------------ expressions
    def template(self, expression: tree.Expression, scope: Scope, unit: Scale | None = None) -> Template:
        """The expression compiled, once per place in the text."""
        key = (id(expression), unit)
        found = self._templates.get(key)
        if found is None:
            found = ExpressionCompiler(scope, self.resolve, unit=unit).compile(expression)
            self._templates[key] = found
            self._keep.append(expression)
        return found

    def bind(self, template: Template, formula: Formula, scope: Scope) -> Bound:
        """A formula with what its slots read in this scope."""
        return bind_template(template, formula, lambda slot: self.scalar_at(slot, scope).reference)

    def scalar_at(self, slot: Slot, scope: Scope) -> Scalar:
        """What a slot reads in this scope."""
        if slot.path.words == "time" and scope.find("time") is None:
            return Scalar(TIME, None if scope.plain else SECOND, "time", "time")
        found = self.lookup(slot.path, scope)
        if isinstance(found, Items):
            if slot.item is None or slot.item >= len(found.items):
                raise Wrong(WrongIndex(slot.path.span, found.name, str((slot.item or 0) + 1), f"It has {len(found.items)} items here."))
            return found.items[slot.item]
        return found

    def resolve(self, path: tree.Path, scope: Scope) -> Readable:
        """The dimensions of what a path reads."""
        found = self.lookup(path, scope)
        if isinstance(found, Items):
            return Readable(tuple(i.dimension for i in found.items), True)
        return Readable((found.dimension,), False)

    def lookup(self, path: tree.Path, scope: Scope) -> Scalar | Items:
        """What a path reads. Raises `Wrong` or `AlreadyTold`."""
        entry = scope.find(path.head)
        if entry is None:
            entry = self._file_constant(path.head, scope)
        if entry is None:
            names = [*scope.names(), *scope.definition.file.constants]
            hint = suggestion(path.head, names, "Declare it with `parameter`, `constant`, `signal` or `input`.")
            raise Wrong(UnknownName(path.span, path.head, f"`{scope.definition.name}`", hint))
        name = path.head
        for step in path.steps:
            if isinstance(entry, Broken):
                break
            entry = self._step(entry, step, name, path, scope)
            name += f".{step.name}" if isinstance(step, tree.Member) else "[…]"
        if isinstance(entry, Broken):
            raise AlreadyTold
        if isinstance(entry, Pending):
            return self.quantity(entry)
        if isinstance(entry, Scalar | Items):
            return entry
        if isinstance(entry, Array):
            items = [self._as_scalar(e) for _, e in sorted(entry.items.items())]
            return Items(entry.name, tuple(items))
        return self._read_default(entry, path)

    def _as_scalar(self, entry: Entry) -> Scalar:
        if isinstance(entry, Pending):
            found = self.quantity(entry)
            if isinstance(found, Scalar):
                return found
        if isinstance(entry, Scalar):
            return entry
        raise AlreadyTold

    def _file_constant(self, name: str, scope: Scope) -> Entry | None:
        found = scope.definition.file.constants.get(name)
        if found is None:
            return None
        item, _ = found
        home = Scope(scope.definition, "")
        pending = Pending(item, "constant", name, item.value, home, home, True)
        key = f"{scope.definition.file.source.name}:{name}"
        cached = self._file_constants.setdefault(key, pending)
        return cached

    def _step(self, entry: Entry, step: tree.Member | tree.Index, name: str, path: tree.Path, scope: Scope) -> Entry:
        if isinstance(step, tree.Index):
            index = tuple(self.integer(i, scope) for i in step.items)
            if isinstance(entry, Pending):
                entry = self.quantity(entry)
            if isinstance(entry, Items):
                if len(index) == 1 and 1 <= index[0] <= len(entry.items):
                    return entry.items[index[0] - 1]
                raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), f"Its items are 1 to {len(entry.items)}."))
            if isinstance(entry, Array):
                if index in entry.items:
                    return entry.items[index]
                known = sorted(entry.items)
                raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), f"Known are {_indexed(name, known[0])} to {_indexed(name, known[-1])}."))
            raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), "It is no list and no array."))
        match entry:
            case InstanceEntry():
                inner = entry.scope.entries.get(step.name)
                if inner is None:
                    hint = suggestion(step.name, list(entry.scope.entries))
                    raise Wrong(UnknownName(path.span, step.name, f"`{name}`, which is a `{entry.scope.definition.name}`", hint))
                return inner
            case ElementEntry():
                return self._element_member(entry, step.name, path)
            case WallEntry():
                raise Wrong(Unsupported(path.span, "Reading the variables of a port", "Read those of the junction or element behind it."))
            case MechanismEntry():
                part = entry.parts.entries.get(step.name)
                if part is None:
                    hint = suggestion(step.name, list(entry.parts.entries))
                    raise Wrong(UnknownName(path.span, step.name, f"the mechanism `{name}`", hint))
                return part
            case PartEntry():
                return self._part_member(entry, step.name, path)
            case Scalar(reference=Reading(node, port, variable)) if variable in "qe" or variable == "p":
                # `stage.platform.x.v`, `spring.x.F`: a port's other variables behind its displacement
                return self._port_variable(node, port, step.name, path)
            case Array():
                raise Wrong(WrongIndex(path.span, name, "", f"It is an array: say which, `{_indexed(name, next(iter(entry.items)))}`."))
        raise Wrong(UnknownName(path.span, step.name, f"`{name}`", "Only instances, elements and mechanisms have inner names."))

    def _element_member(self, entry: ElementEntry, name: str, path: tree.Path) -> Scalar:
        kind = entry.kind.removeprefix("M") if len(entry.kind) > 1 else entry.kind
        if kind in ("TF", "GY"):
            letter, side = name[:-1], name[-1:]
            domain = entry.ports.get(side)
            variable = domain.variable(letter) if domain else None
            if domain is None or variable not in ("e", "f"):
                raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", "A transducer has efforts and flows with the number of the side: `e1`, `f2`."))
            return Scalar(Reading(entry.name, side, variable), domain.dimension(variable), "reading", f"{entry.name}.{name}")
        if "" not in entry.ports:
            if name not in entry.ports:
                hint = suggestion(name, list(entry.ports), f"Its ports: {', '.join(entry.ports)}.")
                raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
            variable = {"C": "q", "I": "p"}.get(kind, "e")
            return Scalar(Reading(entry.name, name, variable), entry.ports[name].dimension(variable), "reading", f"{entry.name}.{name}")
        domain = entry.ports[""]
        variable = domain.variable(name)
        allowed = {"C": "efq", "I": "efp", "0": "e", "1": "f"}.get(kind, "ef")
        if variable is None or variable not in allowed:
            hint = "It has " + ", ".join(domain.letter(v) for v in allowed) + "."
            if entry.kind in "01" and variable is not None:
                hint += " The bonds of a junction share only that; integrate with a C, or read an element on it."
            raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
        return Scalar(Reading(entry.name, "", variable), domain.dimension(variable), "reading", f"{entry.name}.{name}")

    def _part_member(self, part: PartEntry, name: str, path: tree.Path) -> Scalar:
        if name in part.ports:
            return Scalar(Reading(part.mechanism, f"{part.name}.{name}", "q"), part.ports[name].dimension("q"), "reading", f"{part.mechanism}.{part.name}.{name}")
        if len(part.ports) == 1:
            ((port, domain),) = part.ports.items()
            variable = domain.variable(name)
            if variable in ("e", "f", "q"):
                return Scalar(Reading(part.mechanism, f"{part.name}.{port}", variable), domain.dimension(variable), "reading", f"{part.mechanism}.{part.name}.{name}")
        hint = suggestion(name, list(part.ports), f"It has {', '.join(part.ports) or 'no freedom'}; rates are read as `x.v`, `phi.omega`.")
        raise Wrong(UnknownName(path.span, name, f"`{part.mechanism}.{part.name}`", hint))

    def _port_variable(self, node: str, port: str, letter: str, path: tree.Path) -> Scalar:
        domain = self.port_domain(node, port)
        variable = domain.variable(letter)
        if variable is None:
            raise Wrong(UnknownName(path.span, letter, f"`{node}.{port}`", "It has " + ", ".join(domain.letter(v) for v in GENERIC[:3]) + "."))
        return Scalar(Reading(node, port, variable), domain.dimension(variable), "reading", f"{node}.{port}.{letter}")

    def port_domain(self, node: str, port: str) -> Domain:
        """The domain of a port of a node that is already declared."""
        element = self.element_names.get(node)
        if element is not None:
            return element.ports[port]
        return DOMAINS["rotation" if port.endswith("phi") else "translation"]

    def _read_default(self, entry: Entry, path: tree.Path) -> Scalar:
        name = path.words
        match entry:
            case ElementEntry():
                domain = next(iter(entry.ports.values()))
                letters = ", ".join(f"`{name}.{domain.letter(v)}`" for v in ("ef" if entry.kind not in "01" else ("e" if entry.kind == "0" else "f")))
                raise Wrong(WrongType(path.span, "A number", f"the element `{name}`", f"Read one of its variables: {letters}."))
            case InstanceEntry():
                raise Wrong(WrongType(path.span, "A number", f"the instance `{name}`", "Read something in it: an output, or the variable of an element."))
        raise Wrong(WrongType(path.span, "A number", f"`{name}`, which is none", "Read one of its variables: `.x`, `.phi`, `.x.v`."))

    # ------------------------------------------------------------ quantities
    def quantity(self, pending: Pending) -> Scalar | Items:
        """Resolve a quantity: its dimension, its definition, and its value if it does not change."""
        if pending.state == "done":
            assert pending.result is not None
            return pending.result
        if pending.state == "broken":
            raise AlreadyTold
        if pending.state == "busy":
            pending.state = "broken"
            what = "A signal depends on itself without a storage between" if pending.role in ("signal", "output", "input") else "These depend on each other"
            chain = [p.name for p in self.pending if p.state == "busy"]
            self.tell(Cycle(pending.item.span, what, " -> ".join([pending.name, *[c for c in chain if c != pending.name], pending.name])))
            raise AlreadyTold
        pending.state = "busy"
        try:
            pending.result = self._resolve_quantity(pending)
        except (Wrong, AlreadyTold) as problem:
            pending.state = "broken"
            if isinstance(problem, Wrong):
                self.tell(problem.diagnostic)
            raise AlreadyTold from None
        pending.state = "done"
        return pending.result

    def _resolve_quantity(self, pending: Pending) -> Scalar | Items:
        item = pending.item
        override = self.overrides.get(pending.name)
        value, scope, is_default = pending.value, pending.scope, pending.is_default
        number: float | None = None
        if override is not None and pending.role in ("parameter", "input"):
            self.used_overrides.add(pending.name)
            if isinstance(override.value, float):
                number = override.value
            else:
                value, scope, is_default = override.value, self.root, False
        unit = scale_of(item.unit) if item.unit is not None else None
        if unit is not None and pending.owner.plain:
            raise Wrong(WrongType(item.span, "A bare number", "a unit", "A `plain model` has no units."))
        declared = None if unit is None else unit.dimension
        if declared is None and not is_default and item.value is not None:  # the default tells the dimension
            declared = self._dimension(self.template(item.value, pending.owner).value)
        if number is not None:
            return self._enter_quantity(pending, "", Bound(_constant(number), ()), declared, item.span)
        if value is None:
            if not self.part:
                role = {"parameter": "Parameter", "input": "Input", "constant": "Constant"}.get(pending.role, "Signal")
                self.tell(MissingValue(item.span, role, pending.name, item.name))
                raise AlreadyTold
            self.quantities[pending.name] = Named(pending.name, pending.role, str(declared or ONE), None, None, item.span, item.description or "")
            return Scalar(Quantity(pending.name), declared or ONE, pending.role, pending.name)
        own_unit = unit if is_default and _all_bare(value) else None
        template = self.template(value, scope, own_unit)
        if pending.role in ("parameter", "constant"):
            self._require_static(template, scope, pending)
        parts = template.value if isinstance(template.value, tuple) else (template.value,)
        for part in parts:
            if declared is not None and part.dimension is not None and part.dimension != declared:
                what = f"`{item.name}` is in {describe(declared)}"
                raise Wrong(DimensionMismatch(value.span, what, describe(declared), f"`{value.span.text}` is {describe(part.dimension)}", f"Write the unit in brackets after the number: `{_example(value)} [{declared}]`." if part.dimension == ONE else ""))
        dimension = declared if declared is not None else self._dimension(template.value) or ONE
        bounds = [self.bind(template, f, scope) for f in template.formulas]
        if not isinstance(template.value, tuple):
            if template.value.truth:
                from ..algebra.expression import ONE as YES
                from ..algebra.expression import select

                bounds = [Bound(Formula(b.formula.arity, select(b.formula.expression, YES, ZERO)), b.arguments) for b in bounds]
            return self._enter_quantity(pending, "", bounds[0], dimension, value.span)
        if pending.role == "input":
            raise Wrong(WrongType(value.span, "A single number", "a list", "An input is one signal."))
        items = tuple(self._enter_quantity(pending, f"[{i}]", bound, dimension, value.span) for i, bound in enumerate(bounds, 1))
        return Items(pending.name, items)

    @staticmethod
    def _dimension(value: Any) -> Dimension | None:
        parts = value if isinstance(value, tuple) else (value,)
        return next((p.dimension for p in parts if p.dimension is not None), None)

    def _require_static(self, template: Template, scope: Scope, pending: Pending) -> None:
        for slot in template.slots:
            scalar = self.scalar_at(slot, scope)
            if scalar.role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, f"The {pending.role} `{pending.name}`", slot.path.words))

    def _enter_quantity(self, pending: Pending, suffix: str, bound: Bound, dimension: Dimension | None, span: Span) -> Scalar:
        name = pending.name + suffix
        role = pending.role
        if suffix and name in self.overrides and role == "parameter":
            self.used_overrides.add(name)
            override = self.overrides[name].value
            if isinstance(override, float):
                bound = Bound(_constant(override), ())
            else:
                template = self.template(override, self.root)
                found = self._dimension(template.value)
                if isinstance(template.value, tuple) or (found is not None and found != dimension):
                    raise Wrong(DimensionMismatch(override.span, f"`{name}` is in {describe(dimension)}", describe(dimension), describe(found), ""))
                bound = self.bind(template, template.formulas[0], self.root)
        value = self.value_of(bound, span) if role in ("parameter", "constant") else None
        if role == "constant" and value is not None and all(isinstance(a, float) for a in bound.arguments):
            return Scalar(value, dimension, role, name)  # a number with a name: nothing is left to be computed
        self.quantities[name] = Named(name, role, str(dimension or ONE), bound, value, pending.item.span, pending.item.description or "")
        return Scalar(Quantity(name), dimension, role, name)

    root: Scope


def _constant(value: float) -> Formula:
    from ..algebra.expression import Number

    return Formula(0, Number(value))


def _all_bare(value: tree.Expression) -> bool:
    return all(map(bare, value.items)) if isinstance(value, tree.Vector) else bare(value)


def _example(value: tree.Expression) -> str:
    return value.span.text if bare(value) else "2"


def _indexed(name: str, index: tuple[int, ...]) -> str:
    return f"{name}[{', '.join(map(str, index))}]"


def _loop_names(scope: Scope) -> str:
    names: list[str] = []
    inner: Scope | None = scope
    while inner is not None and inner.outer is not None:
        names += [n for n, e in inner.entries.items() if isinstance(e, Scalar) and e.role == "index"]
        inner = inner.outer
    return ", ".join(reversed(names))

