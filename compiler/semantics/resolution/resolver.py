"""Name resolution: paths, quantities (each resolved at its first use), and values known before the run.

Each place of the text is compiled once; an instance only looks up the readings of its slots.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Expression, Number, evaluate, select
from ...algebra.formula import Bound, Formula, bind
from ...algebra.table import KINDS
from ...errors import CompilationFailed, Diagnostic, ValuesNeeded
from ...graph.domains import DOMAINS, Domain
from ...graph.mechanism import domain_of
from ...graph.network import TIME, Named, Quantity, Reading, behind, quantities_in
from ...graph.units import ONE, SECOND, Dimension, Scale
from ...scene import Override
from ...source import Span
from ...syntax import tree
from ..expressions.expression_compiler import ExpressionCompiler
from ..expressions.scales import scale_of
from ..expressions.tables import DIVISORS, check_static, must_hold
from ..expressions.template import Check, CompiledLaw, Readable, Slot, Template, Typed, bind_template
from ..names.errors import NO_NAMES, AbsentName, NotStatic, NoValue, TooManyMistakes, UnknownName, WrongIndex, WrongType
from ..names.foreign_words import name_advice
from ..names.members import (
    element_member,
    group_member,
    group_members,
    list_item,
    not_a_number,
    part_member,
    port_variable,
    wall_member,
    wall_variable,
)
from ..names.scope import (
    STATIC_ROLES,
    Absent,
    Array,
    Broken,
    ElementEntry,
    Entry,
    GroupEntry,
    InstanceEntry,
    Items,
    MechanismEntry,
    PartEntry,
    Pending,
    Scalar,
    Scope,
    WallEntry,
    indexed,
)
from ..names.statement_errors import MAXIMUM_MISTAKES, AlreadyTold, Wrong, reason_of, suggestion, wrong_unit
from .cycles import refuse_mixed_rates
from .elaboration_cache import ElaborationCache

SHOWN = 60  # characters of a line in an error


class Resolver(ABC):
    """Look-up in scopes. `diagnostics` collects errors; `part` allows missing values (for `check`)."""

    root: Scope  # scope in which settings from outside are read

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        self.part = part
        self.overrides = {o.path: o for o in overrides if o.role == "set"}
        self.used_overrides: set[str] = set()
        self.later = frozenset(o.path for o in self.overrides.values() if o.value is None)  # known when a run begins
        self.structural: set[str] = set()  # quantities that decide which parts there are
        self.asked: dict[str, Span] = {}  # quantities without a value whose value decides something, and where it does
        self.positive: list[tuple[str, Bound]] = []  # expressions that a run must find not negative
        # True for a program that begins with any values of its parameters, and checks them itself
        self.for_all_values = False
        self.diagnostics: list[Diagnostic] = []
        self._causes: set[tuple[str, str, int, str]] = set()
        self.quantities: dict[str, Named] = {}
        self.pending: list[Pending] = []
        self.element_names: dict[str, ElementEntry] = {}
        self.walls: dict[str, WallEntry] = {}  # ports of models
        self._file_constants: dict[str, Pending] = {}
        self._lists: dict[int, tuple[Array, int, Items]] = {}  # arrays as lists
        self.guesses = 0  # readings so far of what is not resolved yet, for a unit alone
        self._templates = known.templates
        self._keep = known.nodes

    def tell(self, diagnostic: Diagnostic) -> None:
        """Collect an error, unless the same was found in another instance. Raises `CompilationFailed` if there are too many."""
        if diagnostic.cause in self._causes:
            return
        self._causes.add(diagnostic.cause)
        self.diagnostics.append(diagnostic)
        if len(self.diagnostics) >= MAXIMUM_MISTAKES:
            raise CompilationFailed([*self.diagnostics, TooManyMistakes(diagnostic.span, MAXIMUM_MISTAKES)])

    def guard(self, action: Callable[..., Any], *arguments: Any) -> Any:
        """Run one statement. On an error, collect it and return None."""
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

    def integer(self, expression: tree.ExpressionSyntax, scope: Scope) -> int:
        """A whole number with a value known before the run."""
        value = self.static(expression, scope, "A range or index", structural=True)
        if value != round(value) or abs(value) > 1e9:
            hint = "Ranges and indices count: 1, 2, 3."
            raise Wrong(WrongType(expression.span, "A whole number", f"{value:g}", hint))
        return round(value)

    def static(
        self, expression: tree.ExpressionSyntax, scope: Scope, what: str, dimension: Dimension = ONE, structural: bool = False
    ) -> float:  # fmt: skip
        """A number in SI with a value known before the run; `structural`: it decides which parts there are."""
        if isinstance(expression, tree.Literal) and expression.unit is None and dimension == ONE:
            return float(expression.number)
        if isinstance(expression, tree.PathSyntax) and not expression.steps:  # the index of a loop, nearly always
            entry = scope.find(expression.head)
            if isinstance(entry, Scalar) and entry.role == "index" and dimension == ONE:
                assert isinstance(entry.reference, float)
                return entry.reference
        template = self.template(expression, scope)
        typed = template.value
        if not isinstance(typed, Typed):
            raise Wrong(WrongType(expression.span, "A single number", "a list"))
        if typed.dimension is not None and typed.dimension != dimension:
            raise wrong_unit(what, dimension, expression, typed.dimension)
        self.require_static(template, scope, what)
        bound = self.bind(template, template.formulas[0], scope)
        if structural:
            self.structural |= quantities_in(bound)
        value = self.value_of(bound, expression.span)
        if value is None:
            self.need_no_values()
            raise AlreadyTold
        return value

    def require_static(self, template: Template, scope: Scope, what: str) -> None:
        """Raise `Wrong` if an expression reads a quantity that changes during a run; `what`: the place of the expression, in words."""
        for slot in template.slots:
            if self.scalar_at(slot, scope).role not in STATIC_ROLES:
                raise Wrong(NotStatic(slot.path.span, what, slot.words))

    def need_no_values(self) -> None:
        """Raise `ValuesNeeded` if a decision depends on values that only a run knows."""
        if not self.later:
            return
        why: dict[str, str] = {}
        for name, span in self.asked.items():
            for needed in behind([name], self.quantities) & self.later:
                line = " ".join(span.source.line(span.line).split())
                why.setdefault(needed, f"line {span.line}, `{line[:SHOWN]}{'…' if len(line) > SHOWN else ''}`")
        if why:
            raise ValuesNeeded(why)

    def value_of(self, bound: Bound, span: Span, decides: bool = True) -> float | None:
        """Value of a quantity that is constant during a run; None if it depends on a quantity without a value. Raises `Wrong`.

        `decides`: the compiler chooses or refuses something by this value, so it must be known before anything is compiled.
        """
        unknown: set[str] = set()

        def lookup(key: int) -> float:
            reference = bound.arguments[key]
            if isinstance(reference, Quantity):
                value = self.quantities[reference.name].value
                if value is None:
                    unknown.add(reference.name)
                    raise AlreadyTold
                return value
            if isinstance(reference, float):
                return reference
            raise AlreadyTold

        try:
            value = evaluate(bound.formula.expression, lookup)
        except AlreadyTold:
            if decides:
                self.asked = dict.fromkeys(unknown, span) | self.asked
            return None
        except (ArithmeticError, ValueError) as error:
            raise Wrong(NoValue(span, reason_of(error), self._values(bound))) from None
        if not math.isfinite(value):
            raise Wrong(NoValue(span, "it overflows" if value == value else "it is not a number", self._values(bound)))
        return value

    def _values(self, bound: Bound) -> str:
        parts = []
        for reference in bound.arguments:
            if isinstance(reference, Quantity) and reference.name in self.quantities:
                named = self.quantities[reference.name]
                unit = f" {named.unit}" if named.unit != "1" else ""
                parts.append(named.name if named.value is None else f"{named.name} = {named.value:g}{unit}")
        return "With " + ", ".join(parts) + "." if parts else NO_NAMES

    # ------------------------------------------------------------ expressions
    def template(self, expression: tree.ExpressionSyntax, scope: Scope, unit: Scale | None = None) -> Template:
        """Compile an expression, once per place in the text (and per lengths of the lists that it reads)."""
        known = self._templates.setdefault((id(expression), unit), [])
        for template in known:
            if self.fits(template, scope):
                return template
        guesses = self.guesses
        template = ExpressionCompiler(scope, self.resolve, unit=unit).compile(expression)
        if self.guesses == guesses:
            self._keep.append(expression)
            known.append(template)
        return template

    def fits(self, made: Template | CompiledLaw, scope: Scope) -> bool:
        """Return True if lists have the same shapes and units here as when a template or law was made, and functions are those of the same branches."""
        for name, function in made.functions:
            here = scope.function(name)
            if (None if here is None else here[0]) is not function:
                return False
        for path, units in made.lists:
            found = self.lookup(path, scope)
            if units != (found.text if isinstance(found, Scalar) else found.shape(units)):
                return False
        return True

    def bind(self, template: Template, formula: Formula, scope: Scope) -> Bound:
        """Bind a formula to the readings of its slots in this scope. Raises `Wrong` if a table has wrong points here."""
        self.check(template.checks, template.slots, scope)
        return bind_template(template, formula, lambda slot: self.scalar_at(slot, scope).reference)

    def check(self, checks: Iterable[Check], slots: Sequence[Slot], scope: Scope) -> None:
        """Check the points of tables with their values in this scope, and what frequencies count."""
        for check in checks:
            refuse_mixed_rates(self, scope, check)
            # points are looked at in any branch: what turns a table round needs them
            if check.function in KINDS or not any(self._fails(guard, check, slots, scope) for guard in check.guards):
                check_static(check, lambda x, check=check: self._point(x, check, slots, scope))  # type: ignore[misc]
            if self.for_all_values:
                words = f"`{check.function}` (line {check.span.line})"
                self.positive += [
                    (words, bind(x)) for x in must_hold(check, lambda x: self._static_bound(x, slots, scope))
                ]

    def _fails(self, guard: Expression, check: Check, slots: Sequence[Slot], scope: Scope) -> bool:
        """Return True for a condition that is known before the run, and false."""
        bound = self._static_bound(guard, slots, scope)
        return bound is not None and self.value_of(bound, check.span, check.function not in DIVISORS) == 0.0

    def _static_bound(self, x: Expression, slots: Sequence[Slot], scope: Scope) -> Bound | None:
        """An expression over what is known before the run; None if it reads anything else."""
        bound = bind(x)
        scalars = [self.scalar_at(slots[key], scope) if isinstance(key, int) else None for key in bound.arguments]
        if any(scalar is None or scalar.role not in STATIC_ROLES for scalar in scalars):
            return None
        return Bound(bound.formula, tuple(scalar.reference for scalar in scalars if scalar is not None))

    def _point(self, x: Expression, check: Check, slots: Sequence[Slot], scope: Scope) -> float | None:
        """Value of a point of a table, or of a length; None if it has none yet. Raises `Wrong` for a point that changes during a run."""
        bound, length = bind(x), check.function in DIVISORS
        arguments = []
        what = "The seed or period of a noise" if check.function == "noise" else "A point of a table"
        for key in bound.arguments:
            if not isinstance(key, int):
                if length:
                    return None
                raise Wrong(NotStatic(check.span, what, f"{check.function}(…)"))
            found = self.scalar_at(slots[key], scope)
            if found.role not in STATIC_ROLES:
                if length:
                    return None
                raise Wrong(NotStatic(slots[key].path.span, what, slots[key].words))
            arguments.append(found.reference)
        return self.value_of(Bound(bound.formula, tuple(arguments)), check.span, decides=not length)

    def scalar_at(self, slot: Slot, scope: Scope) -> Scalar:
        """Quantity that a slot reads in this scope."""
        scope = scope if slot.depth is None else scope.rows()[slot.depth]
        if slot.words == "time" and scope.find("time") is None:
            return Scalar(TIME, None if scope.plain else SECOND, "time", "time")
        found = (
            self.nested_memory(slot.path, scope) if isinstance(slot.path, tree.Call) else self.lookup(slot.path, scope)
        )
        if isinstance(found, Items):
            if slot.item is None or slot.item >= len(found.items):
                hint = f"It has {len(found.items)} items here."
                raise Wrong(WrongIndex(slot.path.span, found.name, str((slot.item or 0) + 1), hint))
            return found.items[slot.item]
        return found

    def resolve(self, path: tree.PathSyntax | tree.Call, scope: Scope) -> Readable:
        """Dimensions of the quantity that a path reads, or of a signal with memory or a rate."""
        found = self.nested_memory(path, scope) if isinstance(path, tree.Call) else self.lookup(path, scope)
        if isinstance(found, Items):
            if isinstance(path, tree.PathSyntax) and any(item.choices or item.text for item in found.items):
                what = "an array of choices or texts"
                raise Wrong(WrongType(path.span, "A list of numbers", what, f"Read one: `{path.words}[1]`."))
            values = tuple(item.number for item in found.items)
            fixed = self._fixed(path, scope) if isinstance(path, tree.PathSyntax) and None not in values else None
            units = tuple(i.dimension for i in found.items)
            by_text = bool(fixed and fixed.lists)
            return Readable(units, True, values, fixed=fixed is not None, columns=found.columns, by_text=by_text)
        return Readable((found.dimension,), False, (found.number,), found.truth, choices=found.choices, text=found.text)

    def _fixed(self, path: tree.PathSyntax, scope: Scope) -> Template | None:
        """Template of a list that is a `constant` of literal numbers: the same in every instance, but for the texts that it reads."""
        entry = scope.find(path.head) or self.file_entry(path.head, scope)
        if (
            path.steps
            or path.head in scope.definition.branched
            or not isinstance(entry, Pending)
            or entry.role != "constant"
            or entry.value is None
        ):
            return None
        unit = None if entry.item.unit is None else scale_of(entry.item.unit)
        template = self.template(entry.value, entry.scope, unit)
        return template if all(isinstance(f.expression, Number) for f in template.formulas) else None

    def lookup(self, path: tree.PathSyntax, scope: Scope) -> Scalar | Items:
        """Return the quantity or list that a path reads. Raises `Wrong` or `AlreadyTold`."""
        entry = scope.find(path.head)
        if entry is None:
            entry = self.file_entry(path.head, scope)
        if entry is None:
            here = scope.names() if path.steps else scope.readable()  # an element may be before a point
            names = chain(here, scope.definition.file.constants)
            hint = suggestion(path.head, names, "Declare it with `parameter`, `constant`, `signal` or `input`.")
            hint = (scope.where_else(path.head) if path.steps else name_advice(path.head)) or hint
            raise Wrong(UnknownName(path.span, path.head, f"`{scope.definition.name}`", hint))
        name = path.head
        for step in path.steps:
            if isinstance(entry, Broken | Absent):
                break
            entry = self.step(entry, step, name, path, scope)
            name += f".{step.name}" if isinstance(step, tree.Member) else "[…]"
        if isinstance(entry, Broken):
            raise AlreadyTold
        if isinstance(entry, Absent):
            raise Wrong(AbsentName(path.span, name, entry.branch, entry.span))
        if isinstance(entry, Pending):
            return self.quantity(entry)
        if isinstance(entry, Scalar) and entry.role == "port":
            hint = f"Read its effort or flow, as `{path.words}.e`, `.f`."
            raise Wrong(WrongType(path.span, "A number", f"the port `{name}`", hint))
        if isinstance(entry, Scalar | Items):
            return entry
        if isinstance(entry, GroupEntry) and entry.name == "attitude":
            return Items(name, group_members(entry))
        if isinstance(entry, Array):
            first = next(iter(entry.items.values()))
            if not isinstance(first, Scalar | Pending | Array | Items | Absent | Broken):
                what = f"Say which: `{indexed(path.words, next(iter(entry.items)))}`, and which of its variables."
                raise Wrong(WrongType(path.span, "A number", f"the array `{path.words}`", what))
            return self._as_list(entry, path)
        raise not_a_number(entry, path)

    def _as_list(self, array: Array, path: tree.PathSyntax) -> Items:
        """An array of numbers as a list; one with two indices, or of lists of one length, as a matrix."""
        before = self._lists.get(id(array))
        if before is not None and before[0] is array and len(array.items) == before[1]:
            return before[2]
        keys, guesses = sorted(array.items), self.guesses
        items = [self._number_or_list(array.items[key], path) for key in keys]
        scalars = tuple(item for item in items if isinstance(item, Scalar))
        if not all(isinstance(item, Scalar | Items) for item in items):
            raise AlreadyTold
        if len(scalars) == len(items):
            rows, columns = ({key[i] for key in keys} for i in (0, -1))
            full = len(keys[0]) == 2 and len(rows) * len(columns) == len(keys)
            whole = Items(array.name, scalars, len(columns) * full)
            if self.guesses == guesses:  # each number of a long list is asked for by itself
                self._lists[id(array)] = array, len(keys), whole
            return whole
        lists = [item for item in items if isinstance(item, Items) and not item.columns]
        if len(lists) < len(items) or len({len(item.items) for item in lists}) > 1:
            what = f"the array `{path.words}`, whose items are no lists of one length"
            raise Wrong(WrongType(path.span, "A matrix", what, f"Read one item: `{indexed(path.words, keys[0])}`."))
        return Items(array.name, tuple(scalar for item in lists for scalar in item.items), len(lists[0].items))

    def _number_or_list(self, entry: Entry, path: tree.PathSyntax) -> Entry:
        """An item of an array, as it is read."""
        if isinstance(entry, Pending):
            return self.quantity(entry)
        if isinstance(entry, Array):
            return self._as_list(entry, path)
        if isinstance(entry, Scalar) and entry.role == "port":
            hint = f"Read their efforts or flows, as `{path.words}.e`, `.f`."
            raise Wrong(WrongType(path.span, "A list of numbers", f"the multibond `{path.words}`", hint))
        if isinstance(entry, Absent):
            raise Wrong(AbsentName(path.span, path.words, entry.branch, entry.span))
        if not isinstance(entry, Scalar | Items | Broken):
            raise not_a_number(entry, path)
        return entry

    def file_entry(self, name: str, scope: Scope) -> Entry | None:
        """A constant of the file, or what else a name of the file denotes."""
        found = scope.definition.file.constants.get(name)
        if found is None:
            return None
        item, _ = found
        home = Scope(scope.definition, "")
        pending = Pending(item, "constant", name, item.value, home, home, True)
        key = f"{scope.definition.file.source.name}:{name}"
        return self._file_constants.setdefault(key, pending)

    def step(
        self, entry: Entry, step: tree.Member | tree.Index, name: str, path: tree.PathSyntax, scope: Scope
    ) -> Entry:
        if isinstance(step, tree.Index):
            index = tuple(self.integer(i, scope) for i in step.items)
            if isinstance(entry, Pending):
                entry = self.quantity(entry)
            if isinstance(entry, Items):
                return list_item(entry, index, name, path.span)
            if isinstance(entry, Array):
                if (item := entry.at(index)) is not None:
                    return item
                known = sorted(entry.items)
                hint = f"Known are {indexed(name, known[0])} to {indexed(name, known[-1])}."
                raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), hint))
            raise Wrong(WrongIndex(path.span, name, ", ".join(map(str, index)), "It is no list and no array."))
        match entry:
            case InstanceEntry():
                kind = entry.scope.definition.name
                where = f"`{name}`, which is a `{kind}`" if kind != name else f"`{name}`"
                return _inner(entry.scope.entries, step.name, where, path.span)
            case ElementEntry():
                return element_member(entry, step.name, path)
            case WallEntry():
                return wall_member(entry, step.name, path)
            case MechanismEntry():
                return _inner(entry.parts.entries, step.name, f"the mechanism `{name}`", path.span)
            case PartEntry():
                return part_member(entry, step.name, path)
            case GroupEntry():
                return group_member(entry, step.name, path)
            case Scalar(reference=Reading(node, port), role="port") if node in self.walls:
                return wall_variable(self.walls[node], port, step.name, path)
            case Scalar(reference=Reading(_, port), name=whole) if ".attitude." in port:
                raise Wrong(UnknownName(path.span, step.name, f"`{whole}`", "An attitude is four bare numbers."))
            case Scalar(reference=Reading(node, port, variable), role=role) if role == "port" or variable in "qp":
                # `stage.platform.x.v`, `spring.x.F`: a port's other variables behind its displacement
                return port_variable(node, port, self.port_domain(node, port), step.name, path)
            case Array():  # what each of its items has under that name: a list, if it is a number
                each = Array(f"{name}.{step.name}", entry.span)
                for key, item in entry.items.items():
                    inner = self.step(item, step, indexed(name, key), path, scope)
                    more = inner.items if isinstance(inner, Array) else {(): inner}
                    each.items.update({(*key, *k): e for k, e in more.items()})
                return each
        hint = "Only instances, elements and mechanisms have inner names."
        raise Wrong(UnknownName(path.span, step.name, f"`{name}`", hint))

    def port_domain(self, node: str, port: str) -> Domain:
        """Domain of a port of a node that is already declared."""
        element = self.element_names.get(node)
        if element is not None:
            return element.ports[port]
        return DOMAINS[domain_of(port)]

    # ------------------------------------------------------------ what is resolved when it is asked for
    @abstractmethod
    def quantity(self, pending: Pending) -> Scalar | Items:
        """Resolve a quantity: its dimension, its definition, and its value if it is constant during a run."""

    @abstractmethod
    def nested_memory(self, call: tree.Call, scope: Scope) -> Scalar | Items:
        """Integral, delay or rate inside a larger expression: a signal, or a list of rates, that the author gave no name."""


def _inner(entries: Mapping[str, Entry], name: str, where: str, span: Span) -> Entry:
    """An entry by its name. Raises `Wrong` if there is none; `where`: what has the entries, in words."""
    if name not in entries:
        hint = suggestion(name, list(entries), f"It has {', '.join(entries)}.")
        raise Wrong(UnknownName(span, name, where, hint))
    return entries[name]


def read_condition(
    resolver: Resolver, expression: tree.ExpressionSyntax, scope: Scope, hint: str
) -> tuple[Template, Bound]:
    """A condition, as a number that is 1 if it holds. Raises `Wrong`, with the hint, for an expression that is no condition."""
    template = resolver.template(expression, scope)
    typed = template.value
    if not isinstance(typed, Typed) or not typed.truth:
        raise Wrong(WrongType(expression.span, "A condition", "a number", hint))
    formula = Formula(len(template.slots), select(typed.expression, TRUE, ZERO))
    return template, resolver.bind(template, formula, scope)
