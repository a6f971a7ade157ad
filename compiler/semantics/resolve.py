"""What names stand for: paths looked up, quantities resolved when they are first asked for, values that are known before the run.

A place of the text is compiled once; each instance only looks up what its slots read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

from ..algebra.expression import ZERO, Number, evaluate, select
from ..algebra.formula import Bound, Formula
from ..errors import CompilationFailed, Diagnostic
from ..graph.domains import DOMAINS, GENERIC, Domain
from ..graph.network import TIME, Integral, Law, Named, Quantity, Reading
from ..graph.units import ONE, SECOND, Dimension, Scale
from ..scene import Override
from ..source import Span
from ..syntax import tree
from .domain_table import DomainTable, paths_of
from .errors import (
    Cycle,
    DimensionMismatch,
    MissingValue,
    NotStatic,
    NoValue,
    TooMany,
    TooManyMistakes,
    UnknownName,
    Unsupported,
    WrongIndex,
    WrongType,
)
from .scope import (
    STATIC_ROLES,
    AlreadyTold,
    Array,
    Broken,
    ElementEntry,
    Entry,
    InstanceEntry,
    Items,
    MechanismEntry,
    PartEntry,
    Pending,
    Scalar,
    Scope,
    WallEntry,
    Wrong,
    describe,
    suggestion,
    unit_hint,
)
from .typed import ExpressionCompiler, Readable, Slot, Template, Typed, bind_template, scale_of

if TYPE_CHECKING:
    from .laws import CompiledLaw


MAXIMUM_MISTAKES = 200  # told of one file
MAXIMUM_ROW = 40  # quantities that wait for one another at once


@dataclass(slots=True)
class Known:
    """What is the same whichever model of a file is opened: places of the text compiled, domains spread.

    Keys are identities of nodes and definitions, which are kept here or by the file.
    """

    templates: dict[tuple[int, Scale | None], Template] = field(default_factory=dict)
    tables: dict[int, DomainTable] = field(default_factory=dict)
    laws: dict[int, CompiledLaw] = field(default_factory=dict)  # by declaration: compiled once per definition
    interned: dict[Law, Law] = field(default_factory=dict)  # equal laws of flat text are one law
    nodes: list[tree.Expression] = field(default_factory=list)


class Resolver:
    """Looks things up in scopes. `diagnostics` collects what is wrong; `part` allows missing values (for `check`)."""

    root: Scope  # where what is set from outside is read

    def __init__(self, overrides: Iterable[Override], part: bool, known: Known) -> None:
        self.part = part
        self.overrides = {o.path: o for o in overrides if o.role == "set"}
        self.used_overrides: set[str] = set()
        self.diagnostics: list[Diagnostic] = []
        self.quantities: dict[str, Named] = {}
        self.pending: list[Pending] = []
        self.element_names: dict[str, ElementEntry] = {}
        self._file_constants: dict[str, Pending] = {}
        self._templates = known.templates
        self._memories: list[tuple[str, tree.Call, Scope, Dimension | None]] = []
        self._nested: dict[tuple[int, int], Scalar] = {}
        self._keep_scopes: list[Scope] = []
        self._inferring = False
        self._waiting = 0  # quantities that are being resolved, one because of the other
        self._entered: set[int] = set()  # those whose turn comes
        self._keep = known.nodes

    def tell(self, diagnostic: Diagnostic) -> None:
        """Collect what is wrong. Raises `CompilationFailed` when it is more than anybody reads."""
        self.diagnostics.append(diagnostic)
        if len(self.diagnostics) >= MAXIMUM_MISTAKES:
            raise CompilationFailed([*self.diagnostics, TooManyMistakes(diagnostic.span, MAXIMUM_MISTAKES)])

    def guard(self, action: Callable[..., Any], *arguments: Any) -> Any:
        """Run one statement; what is wrong in it is collected, and None comes back."""
        try:
            return action(*arguments)
        except Wrong as wrong:
            self.tell(wrong.diagnostic)
        except AlreadyTold:
            pass
        return None

    # ------------------------------------------------------------ static values
    def index_of(self, index: tree.Index | None, scope: Scope) -> tuple[int, ...] | None:
        return None if index is None else tuple(self.integer(i, scope) for i in index.items)

    def integer(self, expression: tree.Expression, scope: Scope) -> int:
        """A whole number known before the run."""
        value = self.static(expression, scope, "A range or index")
        if value != round(value) or abs(value) > 1e9:
            raise Wrong(
                WrongType(expression.span, "A whole number", f"{value:g}", "Ranges and indices count: 1, 2, 3.")
            )
        return round(value)

    def static(self, expression: tree.Expression, scope: Scope, what: str, dimension: Dimension = ONE) -> float:
        """A number known before the run, in SI."""
        if isinstance(expression, tree.Literal) and expression.unit is None and dimension == ONE:
            return float(expression.number)
        if isinstance(expression, tree.Path) and not expression.steps:  # the index of a loop, nearly always
            entry = scope.find(expression.head)
            if isinstance(entry, Scalar) and entry.role == "index" and dimension == ONE:
                assert isinstance(entry.reference, float)
                return entry.reference
        template = self.template(expression, scope)
        typed = template.value
        if not isinstance(typed, Typed):
            raise Wrong(WrongType(expression.span, "A single number", "a list"))
        if typed.dimension is not None and typed.dimension != dimension:
            raise Wrong(
                DimensionMismatch(
                    expression.span,
                    f"{what} is {describe(dimension)}, but `{expression.span.text}` is {describe(typed.dimension)}",
                    unit_hint(typed.dimension, dimension, expression),
                )
            )
        for slot in template.slots:
            scalar = self.scalar_at(slot, scope)
            if scalar.role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, what, slot.words))
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
            raise Wrong(NoValue(span, _why(error), self._values(bound))) from None
        if not math.isfinite(value):
            raise Wrong(NoValue(span, "it overflows", self._values(bound)))
        return value

    def _values(self, bound: Bound) -> str:
        parts = []
        for reference in bound.arguments:
            if isinstance(reference, Quantity) and reference.name in self.quantities:
                named = self.quantities[reference.name]
                parts.append(
                    f"{named.name} = {named.value:g} {named.unit if named.unit != '1' else ''}".strip()
                    if named.value is not None
                    else named.name
                )
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
        if isinstance(slot.path, tree.Call):
            return self._nested_integral(slot.path, scope)
        if slot.words == "time" and scope.find("time") is None:
            return Scalar(TIME, None if scope.plain else SECOND, "time", "time")
        found = self.lookup(slot.path, scope)
        if isinstance(found, Items):
            if slot.item is None or slot.item >= len(found.items):
                raise Wrong(
                    WrongIndex(
                        slot.path.span, found.name, str((slot.item or 0) + 1), f"It has {len(found.items)} items here."
                    )
                )
            return found.items[slot.item]
        return found

    def resolve(self, path: tree.Path | tree.Call, scope: Scope) -> Readable:
        """The dimensions of what a path reads, or of an integral."""
        if isinstance(path, tree.Call):
            return Readable((self._nested_integral(path, scope).dimension,), False)
        found = self.lookup(path, scope)
        if isinstance(found, Items):
            return Readable(tuple(i.dimension for i in found.items), True, tuple(map(_known, found.items)))
        return Readable((found.dimension,), False, (_known(found),), found.truth)

    def lookup(self, path: tree.Path, scope: Scope) -> Scalar | Items:
        """What a path reads. Raises `Wrong` or `AlreadyTold`."""
        entry = scope.find(path.head)
        if entry is None:
            entry = self._file_constant(path.head, scope)
        if entry is None:
            names = chain(_readable(scope), scope.definition.file.constants)
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
        if isinstance(entry, Scalar) and entry.role == "port":
            raise Wrong(
                WrongType(
                    path.span, "A number", f"the port `{name}`", f"Read its effort or flow, as `{path.words}.e`, `.f`."
                )
            )
        if isinstance(entry, Scalar | Items):
            return entry
        if isinstance(entry, Array):
            first = next(iter(entry.items.values()))
            if not isinstance(first, Scalar | Pending):
                what = f"Say which: `{indexed(path.words, next(iter(entry.items)))}`, and which of its variables."
                raise Wrong(WrongType(path.span, "A number", f"the array `{path.words}`", what))
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
        return self._file_constants.setdefault(key, pending)

    def _step(self, entry: Entry, step: tree.Member | tree.Index, name: str, path: tree.Path, scope: Scope) -> Entry:
        if isinstance(step, tree.Index):
            index = tuple(self.integer(i, scope) for i in step.items)
            if isinstance(entry, Pending):
                entry = self.quantity(entry)
            if isinstance(entry, Items):
                if len(index) == 1 and 1 <= index[0] <= len(entry.items):
                    return entry.items[index[0] - 1]
                raise Wrong(
                    WrongIndex(path.span, name, ", ".join(map(str, index)), f"Its items are 1 to {len(entry.items)}.")
                )
            if isinstance(entry, Array):
                if index in entry.items:
                    return entry.items[index]
                known = sorted(entry.items)
                raise Wrong(
                    WrongIndex(
                        path.span,
                        name,
                        ", ".join(map(str, index)),
                        f"Known are {indexed(name, known[0])} to {indexed(name, known[-1])}.",
                    )
                )
            raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), "It is no list and no array."))
        match entry:
            case InstanceEntry():
                inner = entry.scope.entries.get(step.name)
                if inner is None:
                    hint = suggestion(step.name, list(entry.scope.entries), f"It has {', '.join(entry.scope.entries)}.")
                    raise Wrong(
                        UnknownName(path.span, step.name, f"`{name}`, which is a `{entry.scope.definition.name}`", hint)
                    )
                return inner
            case ElementEntry():
                return self._element_member(entry, step.name, path)
            case WallEntry():
                raise Wrong(
                    Unsupported(
                        path.span, "Reading the variables of a port", "Read those of the junction or element behind it."
                    )
                )
            case MechanismEntry():
                part = entry.parts.entries.get(step.name)
                if part is None:
                    hint = suggestion(step.name, list(entry.parts.entries), f"It has {', '.join(entry.parts.entries)}.")
                    raise Wrong(UnknownName(path.span, step.name, f"the mechanism `{name}`", hint))
                return part
            case PartEntry():
                return self._part_member(entry, step.name, path)
            case Scalar(reference=Reading(node, port, variable)) if variable in "qe" or variable == "p":
                # `stage.platform.x.v`, `spring.x.F`: a port's other variables behind its displacement
                return self._port_variable(node, port, step.name, path)
            case Array():
                first = indexed(name, next(iter(entry.items)))
                raise Wrong(
                    WrongType(path.span, "One item", f"the array `{name}`", f"Say which: `{first}.{step.name}`.")
                )
        raise Wrong(
            UnknownName(path.span, step.name, f"`{name}`", "Only instances, elements and mechanisms have inner names.")
        )

    def _element_member(self, entry: ElementEntry, name: str, path: tree.Path) -> Scalar:
        kind = entry.kind.removeprefix("M") if len(entry.kind) > 1 else entry.kind
        if kind in ("TF", "GY"):
            letter, side = name[:-1], name[-1:]
            domain = entry.ports.get(side)
            variable = domain.variable(letter) if domain else None
            if domain is None or variable not in ("e", "f"):
                raise Wrong(
                    UnknownName(
                        path.span,
                        name,
                        f"`{entry.name}`",
                        "A transducer has efforts and flows with the number of the side: `e1`, `f2`.",
                    )
                )
            return Scalar(
                Reading(entry.name, side, variable), domain.dimension(variable), "reading", f"{entry.name}.{name}"
            )
        if "" not in entry.ports:
            if name not in entry.ports:
                hint = suggestion(name, list(entry.ports), f"Its ports: {', '.join(entry.ports)}.")
                raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
            variable = {"C": "q", "I": "p"}.get(kind, "e")
            return Scalar(
                Reading(entry.name, name, variable),
                entry.ports[name].dimension(variable),
                "reading" if kind in ("C", "I") else "port",
                f"{entry.name}.{name}",
            )
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
            return Scalar(
                Reading(part.mechanism, f"{part.name}.{name}", "q"),
                part.ports[name].dimension("q"),
                "reading",
                f"{part.mechanism}.{part.name}.{name}",
            )
        if len(part.ports) == 1:
            ((port, domain),) = part.ports.items()
            variable = domain.variable(name)
            if variable in ("e", "f", "q"):
                return Scalar(
                    Reading(part.mechanism, f"{part.name}.{port}", variable),
                    domain.dimension(variable),
                    "reading",
                    f"{part.mechanism}.{part.name}.{name}",
                )
        hint = suggestion(
            name,
            list(part.ports),
            f"It has {', '.join(part.ports) or 'no freedom'}; rates are read as `x.v`, `phi.omega`.",
        )
        raise Wrong(UnknownName(path.span, name, f"`{part.mechanism}.{part.name}`", hint))

    def _port_variable(self, node: str, port: str, letter: str, path: tree.Path) -> Scalar:
        domain = self.port_domain(node, port)
        variable = domain.variable(letter)
        if variable is None:
            raise Wrong(
                UnknownName(
                    path.span,
                    letter,
                    f"`{node}.{port}`",
                    "It has " + ", ".join(domain.letter(v) for v in GENERIC[:3]) + ".",
                )
            )
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
                letters = ", ".join(
                    f"`{name}.{domain.letter(v)}`"
                    for v in ("ef" if entry.kind not in "01" else ("e" if entry.kind == "0" else "f"))
                )
                raise Wrong(
                    WrongType(path.span, "A number", f"the element `{name}`", f"Read one of its variables: {letters}.")
                )
            case InstanceEntry():
                raise Wrong(
                    WrongType(
                        path.span,
                        "A number",
                        f"the instance `{name}`",
                        "Read something in it: an output, or the variable of an element.",
                    )
                )
        raise Wrong(
            WrongType(
                path.span, "A number", f"`{name}`, which is none", "Read one of its variables: `.x`, `.phi`, `.x.v`."
            )
        )

    # ------------------------------------------------------------ quantities
    def quantity(self, pending: Pending) -> Scalar | Items:
        """Resolve a quantity: its dimension, its definition, and its value if it does not change."""
        if pending.state == "done":
            assert pending.result is not None
            return pending.result
        if pending.state == "broken":
            raise AlreadyTold
        if pending.state == "busy" and self._inferring:
            return Scalar(Quantity(pending.name), None, pending.role, pending.name)
        if pending.state == "busy":
            pending.state = "broken"
            what = (
                "A signal depends on itself without a storage between"
                if pending.role in ("signal", "output", "input")
                else "These depend on each other"
            )
            busy = [p.name for p in self.pending if p.state == "busy"]
            self.tell(
                Cycle(
                    pending.item.span,
                    what,
                    " -> ".join([pending.name, *[name for name in busy if name != pending.name], pending.name]),
                )
            )
            raise AlreadyTold
        if not self._inferring:
            self._resolve_what_it_reads(pending)
        if pending.state != "waiting":
            return self.quantity(pending)
        if self._waiting >= MAXIMUM_ROW:
            raise Wrong(TooMany(pending.item.span, "Quantities that read each other in a ring", MAXIMUM_ROW))
        pending.state = "busy"
        self._waiting += 1
        try:
            pending.result = self._resolve_quantity(pending)
        except (Wrong, AlreadyTold) as problem:
            pending.state = "broken"
            if isinstance(problem, Wrong):
                self.tell(problem.diagnostic)
            raise AlreadyTold from None
        finally:
            self._waiting -= 1
        pending.state = "done"
        return pending.result

    def _resolve_what_it_reads(self, pending: Pending) -> None:
        """Resolve what a quantity reads, and what that reads, beginning where nothing is left to read.

        Long rows of quantities would nest as deeply otherwise; what is missed here is found when it is asked for.
        """
        rows = [(pending, self._reads(pending))]
        entered = {id(pending)} - self._entered
        self._entered |= entered
        while rows:
            current, reads = rows[-1]
            following = next((p for p in reads if p.state == "waiting" and id(p) not in self._entered), None)
            if following is not None:
                entered.add(id(following))
                self._entered.add(id(following))
                rows.append((following, self._reads(following)))
                continue
            rows.pop()
            if rows and current.state == "waiting":
                self.guard(self.quantity, current)
        self._entered -= entered

    def _reads(self, pending: Pending) -> Iterator[Pending]:
        """The quantities that its value names; not those of an integral, which are read when all names are known."""
        value = pending.value
        if value is None or (isinstance(value, tree.Call) and value.function == "integral"):
            return
        for path in paths_of(value):
            entry = pending.scope.find(path.head)
            for step in path.steps:
                if isinstance(entry, InstanceEntry) and isinstance(step, tree.Member):
                    entry = entry.scope.entries.get(step.name)
                elif isinstance(entry, Array) and isinstance(step, tree.Index):
                    try:
                        entry = entry.items.get(self.index_of(step, pending.scope) or ())
                    except (Wrong, AlreadyTold):
                        entry = None  # told when it is read
            if isinstance(entry, Pending):
                yield entry

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
        if (
            declared is None and (not is_default or number is not None) and item.value is not None
        ):  # the default tells the dimension
            found = self._dimension(self.template(item.value, pending.owner, unit).value)
            declared = found or (None if pending.owner.plain else ONE)  # a bare zero is a bare number
        if number is not None:
            return self._enter_quantity(pending, "", Bound(_constant(number), ()), declared, item.span)
        if value is None:
            if not self.part:
                role = {"parameter": "Parameter", "input": "Input", "constant": "Constant"}.get(pending.role, "Signal")
                self.tell(MissingValue(item.span, role, pending.name, item.name, pending.owner.base().stands))
                raise AlreadyTold
            self.quantities[pending.name] = Named(
                pending.name, pending.role, str(declared or ONE), None, None, item.span, item.description or ""
            )
            return Scalar(Quantity(pending.name), declared or ONE, pending.role, pending.name)
        if isinstance(value, tree.Call) and value.function == "integral" and len(value.arguments) == 2:
            return self._integral(value, scope, pending.name, pending.role, declared, item.description or "")
        template = self.template(value, scope, unit if is_default else None)
        if pending.role in ("parameter", "constant"):
            self._require_static(template, scope, pending)
        parts = template.value if isinstance(template.value, tuple) else (template.value,)
        for part in parts:
            if declared is not None and part.dimension is not None and part.dimension != declared:
                raise Wrong(
                    DimensionMismatch(
                        value.span,
                        f"`{item.name}` is {describe(declared)}, but `{value.span.text}` is {describe(part.dimension)}",
                        unit_hint(part.dimension, declared, value),
                    )
                )
        if isinstance(template.value, tuple) and not is_default and item.value is not None:
            default = self.template(item.value, pending.owner, unit).value
            if not isinstance(default, tuple):
                hint = "Its default is a single number; give it one, or an item of the list."
                raise Wrong(WrongType(value.span, f"A single number for `{item.name}`", "a list", hint))
        dimension = declared if declared is not None else self._dimension(template.value) or ONE
        bounds = [self.bind(template, f, scope) for f in template.formulas]
        if not isinstance(template.value, tuple):
            if template.value.truth:
                bounds = [
                    Bound(Formula(b.formula.arity, select(b.formula.expression, Number(1.0), ZERO)), b.arguments)
                    for b in bounds
                ]
            entered = self._enter_quantity(pending, "", bounds[0], dimension, value.span)
            return replace(entered, truth=template.value.truth)
        if pending.role == "input":
            raise Wrong(WrongType(value.span, "A single number", "a list", "An input is one signal."))
        items = tuple(
            self._enter_quantity(pending, f"[{i}]", bound, part.dimension or dimension, value.span)
            for i, (bound, part) in enumerate(zip(bounds, template.value, strict=True), 1)
        )
        return Items(pending.name, items)

    # ------------------------------------------------------------ signals with memory
    def _nested_integral(self, call: tree.Call, scope: Scope) -> Scalar:
        """An integral inside a larger expression: a signal without a name of the author's."""
        key = (id(call), id(scope))
        if key not in self._nested:
            self._keep_scopes.append(scope)
            name = scope.full(f"integral at line {call.span.line}{scope.suffix}")
            names = {f"{name} ({i})" if i else name for i in range(len(self._nested) + 1)} - self.quantities.keys()
            self._nested[key] = self._integral(call, scope, min(names), "signal", None, "")
        return self._nested[key]

    def _integral(
        self, call: tree.Call, scope: Scope, name: str, role: str, declared: Dimension | None, description: str
    ) -> Scalar:
        """Enter an integral: known at once, so that it can depend on itself; its rate is read when all names are known."""
        rate, start = call.arguments
        template = self.template(start, scope)
        dimension = declared or self._dimension(template.value)
        if dimension is None and not scope.plain:
            dimension = self._inferred(rate, scope)
        named = Named(name, role, str(dimension or ONE), None, None, call.span, description)
        self.quantities[name] = named
        self._memories.append((name, call, scope, dimension))
        return Scalar(Quantity(name), dimension if not scope.plain else None, role, name)

    def _inferred(self, rate: tree.Expression, scope: Scope) -> Dimension | None:
        """The dimension of an integral from its rate, in which the integral itself fits anything."""
        before, self._inferring = self._inferring, True
        try:
            found = self._dimension(ExpressionCompiler(scope, self.resolve).compile(rate).value)
        finally:
            self._inferring = before
        return None if found is None else found * SECOND

    def integrals(self) -> dict[str, Integral]:
        """The signals with memory, their rates read now."""
        result: dict[str, Integral] = {}
        position = 0
        while position < len(self._memories):  # a rate may contain another integral
            name, call, scope, dimension = self._memories[position]
            position += 1
            found = self.guard(self._read_integral, name, call, scope, dimension)
            if found is not None:
                result[name] = found
        return result

    def _read_integral(self, name: str, call: tree.Call, scope: Scope, dimension: Dimension | None) -> Integral:
        bounds = []
        per_second = None if dimension is None else dimension / SECOND
        for part, wanted in zip(call.arguments, (per_second, dimension), strict=True):
            template = self.template(part, scope)
            value = template.value
            if not isinstance(value, Typed):
                raise Wrong(WrongType(part.span, "A single number", "a list"))
            if not scope.plain and value.dimension is not None and wanted is not None and value.dimension != wanted:
                what = f"`{part.span.text}` is {describe(value.dimension)}, but an integral in [{dimension}] needs {describe(wanted)}"
                raise Wrong(DimensionMismatch(part.span, what, unit_hint(value.dimension, wanted)))
            bounds.append(self.bind(template, template.formulas[0], scope))
        for slot in self.template(call.arguments[1], scope).slots:
            if self.scalar_at(slot, scope).role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, "The start of an integral", slot.words))
        return Integral(name, bounds[0], bounds[1], call.span)

    @staticmethod
    def _dimension(value: Any) -> Dimension | None:
        parts = value if isinstance(value, tuple) else (value,)
        return next((p.dimension for p in parts if p.dimension is not None), None)

    def _require_static(self, template: Template, scope: Scope, pending: Pending) -> None:
        for slot in template.slots:
            scalar = self.scalar_at(slot, scope)
            if scalar.role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, f"The {pending.role} `{pending.name}`", slot.words))

    def _enter_quantity(
        self, pending: Pending, suffix: str, bound: Bound, dimension: Dimension | None, span: Span
    ) -> Scalar:
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
                if isinstance(template.value, tuple):
                    raise Wrong(WrongType(override.span, f"A single number for `{name}`", "a list"))
                if found is not None and found != dimension:
                    raise Wrong(
                        DimensionMismatch(
                            override.span,
                            f"`{name}` is {describe(dimension)}, but `{override.span.text}` is {describe(found)}",
                            unit_hint(found, dimension, override),
                        )
                    )
                bound = self.bind(template, template.formulas[0], self.root)
        value = self.value_of(bound, span) if role in ("parameter", "constant") else None
        if role == "constant" and value is not None and all(isinstance(a, float) for a in bound.arguments):
            return Scalar(value, dimension, role, name)  # a number with a name: nothing is left to be computed
        self.quantities[name] = Named(
            name, role, str(dimension or ONE), bound, value, pending.item.span, pending.item.description or ""
        )
        return Scalar(Quantity(name), dimension, role, name)


def _readable(scope: Scope) -> Iterator[str]:
    """The names in a scope that stand for numbers."""
    for name in scope.names():
        entry = scope.find(name)
        if isinstance(entry, Array):
            entry = next(iter(entry.items.values()), None)
        if isinstance(entry, Scalar | Items | Pending):
            yield name


def _known(scalar: Scalar) -> float | None:
    return scalar.reference if isinstance(scalar.reference, float) else None


def _why(error: Exception) -> str:
    """What went wrong in a calculation, in words."""
    if isinstance(error, ZeroDivisionError):
        return "a division by zero"
    if isinstance(error, OverflowError):
        return "it overflows"
    return "a root or logarithm of a negative number, or an inverse function outside its range"


def _constant(value: float) -> Formula:
    return Formula(0, Number(value))


def indexed(name: str, index: tuple[int, ...]) -> str:
    """The name of one item of an array."""
    return f"{name}[{', '.join(map(str, index))}]"
