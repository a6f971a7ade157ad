"""Quantities: parameters, constants, inputs, signals, outputs, and signals with memory. Each is resolved at its first use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TypeVar

from ...algebra.expression import ZERO, Number, select, substitute, symbols
from ...algebra.formula import Bound, Formula
from ...errors import ValuesNeeded
from ...graph.network import Delay, Integral, Named, Quantity
from ...graph.units import ONE, SECOND, Dimension, Scale
from ...scene import Override
from ...source import Span
from ...syntax import tree
from ..expressions.expression_compiler import MEMORIES, ExpressionCompiler
from ..expressions.scales import scale_of
from ..expressions.template import Template, Typed, Value
from ..names.domain_table import paths_of
from ..names.errors import (
    Cycle,
    DimensionMismatch,
    DuplicateName,
    MissingValue,
    NotStatic,
    TooMany,
    WrongType,
    WrongValue,
)
from ..names.scope import STATIC_ROLES, Array, InstanceEntry, Items, Pending, Scalar, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion, unit_hint
from .elaboration_cache import ElaborationCache
from .resolver import SHOWN, Resolver, read_condition

UNCHANGING_ROLES = ("parameter", "constant", "mode")  # their values are known before the run; of a mode the first one
MAXIMUM_ROW = 40  # quantities that wait for one another at once
_Memory = tuple[str, tree.Call, Scope, Dimension | None]  # name, call, the scope in which it is read, dimension
Signal = TypeVar("Signal", Integral, Delay)


class QuantityResolver(Resolver):
    """Resolver of quantities, each once. A cycle is found at the reference that closes it."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        self._memories: list[_Memory] = []
        self._comparisons: dict[tuple[int, str], tree.Comparison] = {}
        self._remembered: dict[str, Integral] = {}
        self._guessing: list[str] = []  # signals of loops whose units are being looked for
        self._loops: dict[str, Scalar] = {}  # signals that depend on themselves, as they are read within
        self._delays: list[_Memory] = []
        self.relays: list[tuple[str, tree.Call, Scope]] = []  # name, call, the scope in which it is read
        self._nested: dict[tuple[int, int], Scalar] = {}
        self._keep_scopes: list[Scope] = []  # their identity is a key above
        self._inferring = False
        self._waiting = 0  # quantities that are being resolved, one because of the other
        self._entered: set[int] = set()  # those whose turn comes

    # ------------------------------------------------------------ quantities
    def quantity(self, pending: Pending) -> Scalar | Items:
        """Resolve a quantity: its dimension, its definition, and its value if it is constant during a run."""
        if pending.state == "done":
            assert pending.result is not None
            return pending.result
        if pending.state == "broken":
            raise AlreadyTold
        if pending.state == "busy" and self._inferring:
            return Scalar(Quantity(pending.name), self._guessed_unit(pending), pending.role, pending.name)
        if pending.state == "busy" and (loop := self._in_loop(pending)) is not None:
            return loop
        if pending.state == "busy":
            pending.state = "broken"
            what = (
                "A signal depends on itself without a storage between"
                if pending.role in ("signal", "output", "input")
                else "These depend on each other"
            )
            busy = [p.name for p in self.pending if p.state == "busy"]
            chain = [pending.name, *(name for name in busy if name != pending.name), pending.name]
            self.tell(Cycle(pending.item.span, what, " -> ".join(chain)))
            raise AlreadyTold
        if not self._inferring:
            self._resolve_what_it_reads(pending)
        if pending.state != "waiting":
            return self.quantity(pending)
        if self._waiting >= MAXIMUM_ROW:
            raise Wrong(self._too_long(pending))
        pending.state = "busy"
        self._waiting += 1
        try:
            pending.result = self._resolve_quantity(pending)
            if pending.name in self._loops:
                self._close(pending, self._loops[pending.name])
        except (Wrong, AlreadyTold) as problem:
            pending.state = "broken"
            if isinstance(problem, Wrong):
                self.tell(problem.diagnostic)
            raise AlreadyTold from None
        finally:
            self._waiting -= 1
        pending.state = "done"
        return pending.result

    def _in_loop(self, pending: Pending) -> Scalar | None:
        """Signal that depends on itself, read before its definition is known; None for a list, or what must be known before the run.

        Its unit is the declared one, or that of its definition, in which signals that are being resolved fit any unit.
        """
        if pending.role not in ("signal", "output", "input"):
            return None
        if pending.name not in self._loops:
            if pending.value is None or isinstance(pending.value, tree.VectorSyntax):
                return None
            self._guessing.append(pending.name)
            try:
                value = self._guessed(pending.value, pending.scope)
            finally:
                self._guessing.pop()
            if isinstance(value, tuple):
                return None
            unit = None if pending.item.unit is None else scale_of(pending.item.unit).dimension
            if unit is None and pending.role == "input" and pending.item.value is not None:
                unit = self._looked_at(pending.item.value, pending.owner)
            dimension = None if pending.owner.plain else unit or value.dimension or ONE
            loop = Scalar(Quantity(pending.name), dimension, pending.role, pending.name, truth=value.truth)
            self._loops[pending.name] = loop
        return self._loops[pending.name]

    def _guessed_unit(self, pending: Pending) -> Dimension | None:
        """Unit of a signal of a loop whose unit is looked for; None, which fits any, if it is that one, or in other places."""
        value = pending.value
        memory = value is None or (isinstance(value, tree.Call) and value.function in MEMORIES)
        if not self._guessing or pending.name in self._guessing or memory or isinstance(value, tree.VectorSyntax):
            return None
        if pending.item.unit is not None:
            return scale_of(pending.item.unit).dimension
        self._guessing.append(pending.name)
        try:
            assert value is not None
            return self._looked_at(value, pending.scope)
        finally:
            self._guessing.pop()

    def _close(self, pending: Pending, loop: Scalar) -> None:
        """Mark a signal as one that a run solves for, and check that it is what was read of it."""
        result = pending.result
        if not isinstance(result, Scalar) or result.truth is not loop.truth:
            what = "A signal depends on itself, now as a number and now as a list or condition"
            raise Wrong(Cycle(pending.item.span, what, f"{pending.name} -> {pending.name}"))
        if loop.dimension is not None and result.dimension != loop.dimension:
            what = f"`{pending.item.name}` depends on itself, as {describe(loop.dimension)}, but its definition is {describe(result.dimension)}"
            hint = f"Say its unit: `{pending.role} {pending.item.name} : m = …`, and check its terms."
            raise Wrong(DimensionMismatch(pending.item.span, what, hint))
        self.quantities[pending.name] = replace(self.quantities[pending.name], role="loop")

    def _too_long(self, pending: Pending) -> TooMany:
        if self._inferring:  # an integral's rate is read later; only its unit is inferred now
            hint = f"Say the unit of one of them: `{pending.role} {pending.item.name} : m = …`."
            return TooMany(
                pending.item.span, "Integrals in a row that take their units from one another", MAXIMUM_ROW, hint
            )
        return TooMany(pending.item.span, "Quantities that read each other in a ring", MAXIMUM_ROW)

    def _resolve_what_it_reads(self, pending: Pending) -> None:
        """Resolve the quantities that a quantity depends on, in an order in which each only needs resolved ones.

        Without this, long chains of quantities would recurse too deeply. Quantities missed here are resolved at their first use.
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
        """Quantities that its value names. Those in an integral are left out: they are read when all names are known."""
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
                        entry = None  # reported when it is read
            if isinstance(entry, Pending):
                yield entry

    def _resolve_quantity(self, pending: Pending) -> Scalar | Items:
        item = pending.item
        override = self.overrides.get(pending.name)
        if override is not None and pending.role in ("parameter", "input"):
            self.used_overrides.add(pending.name)
        else:
            override = None
        if item.choices:
            return self._choice(pending, override)
        unit = scale_of(item.unit) if item.unit is not None else None
        if unit is not None and pending.owner.plain:
            raise Wrong(WrongType(item.span, "A bare number", "a unit", "A `plain model` has no units."))
        declared = None if unit is None else unit.dimension
        if item.value is None or (pending.is_default and override is None):
            return self._settled(pending, override, declared, unit)
        default = self.template(item.value, pending.owner, unit).value
        if declared is None:  # the default gives the dimension; a bare zero is a bare number
            declared = self._dimension(default) or (None if pending.owner.plain else ONE)
        entered = self._settled(pending, override, declared, unit)
        # The default also says whether it is a truth: a place of the text that reads it is compiled once for all instances.
        truth = isinstance(default, Typed) and default.truth
        return replace(entered, truth=truth) if isinstance(entered, Scalar) else entered

    def _choice(self, pending: Pending, override: Override | None) -> Scalar:
        """A parameter that is one of several words: the number of its word, from 1, which is never an argument of a program."""
        item, words = pending.item, tuple(word for word, _ in pending.item.choices)
        for number, (word, span) in enumerate(item.choices):
            if word in words[:number]:
                raise Wrong(DuplicateName(span, word, item.choices[words.index(word)][1]))
        if pending.role != "parameter":
            hint = "Only a parameter is one of several words; a `mode` is a number or a truth."
            raise Wrong(WrongType(item.choices[0][1], "A number", "a choice", hint))
        value = override.value if override is not None else pending.value
        if override is not None and value is None:  # structure: a run's program is made for one choice
            line = item.span.source.line(item.span.line).strip()
            raise ValuesNeeded({pending.name: f"line {item.span.line}, `{line[:SHOWN]}`"})
        if value is None:
            entered = self._without_value(pending, ONE)
            return replace(entered, choices=words)
        hint = f"It can be: {', '.join(words)}."
        if isinstance(value, float):
            if value not in range(1, len(words) + 1):
                raise Wrong(WrongValue(item.span, item.name, pending.owner.definition.name, f"{value:g}", hint))
            return Scalar(value, ONE, "parameter", pending.name, choices=words)
        word = value.words if isinstance(value, tree.PathSyntax) else ""
        if word in words:
            return Scalar(1.0 + words.index(word), ONE, "parameter", pending.name, choices=words)
        scope = self.root if override is not None else pending.scope
        if isinstance(value, tree.PathSyntax) and scope.find(value.head) is not None:
            other = self.lookup(value, scope)
            if isinstance(other, Scalar) and other.choices == words:
                return replace(other, name=pending.name)
        hint = suggestion(word, words, hint)
        raise Wrong(WrongValue(value.span, item.name, pending.owner.definition.name, value.span.words, hint))

    def _settled(
        self, pending: Pending, override: Override | None, declared: Dimension | None, unit: Scale | None
    ) -> Scalar | Items:
        """Quantity from what is set from outside, else from its binding or default."""
        if override is None:
            return self._valued(pending, pending.value, pending.scope, declared, unit if pending.is_default else None)
        if override.value is None:
            return self._enter_later(pending, "", declared, pending.item.span)
        if isinstance(override.value, float):
            return self._enter_quantity(pending, "", Bound(_constant(override.value), ()), declared, pending.item.span)
        return self._valued(pending, override.value, self.root, declared, None)

    def _valued(
        self,
        pending: Pending,
        value: tree.ExpressionSyntax | None,
        scope: Scope,
        declared: Dimension | None,
        unit: Scale | None,
    ) -> Scalar | Items:
        """Quantity from its value, which is read in `scope`. Bare numbers in it are in `unit`."""
        if value is None:
            return self._without_value(pending, declared)
        if isinstance(value, tree.Call) and value.function == "integral" and len(value.arguments) == 2:
            if pending.role in UNCHANGING_ROLES:
                raise Wrong(NotStatic(value.span, f"The {pending.role} `{pending.name}`", f"{value.function}(…)"))
            return self._integral(value, scope, pending.name, pending.role, declared, pending.item.description or "")
        template = self.template(value, scope, unit)
        if pending.role in UNCHANGING_ROLES:
            self._require_static(template, scope, pending)
        self._check_value(pending, template.value, value, declared)
        dimension = declared if declared is not None else self._dimension(template.value) or ONE
        bounds = [self.bind(template, f, scope) for f in template.formulas]
        if isinstance(template.value, tuple):
            items = tuple(
                self._enter_quantity(pending, f"[{i}]", bound, part.dimension or dimension, value.span)
                for i, (bound, part) in enumerate(zip(bounds, template.value, strict=True), 1)
            )
            return Items(pending.name, items)
        bound = bounds[0]
        if template.value.truth:
            truth = select(bound.formula.expression, Number(1.0), ZERO)
            bound = Bound(Formula(bound.formula.arity, truth), bound.arguments)
        entered = self._enter_quantity(pending, "", bound, dimension, value.span)
        return replace(entered, truth=True) if template.value.truth else entered

    def _without_value(self, pending: Pending, declared: Dimension | None) -> Scalar:
        """Quantity that has no value, which is allowed only in a part."""
        item = pending.item
        if not self.part:
            roles = {"parameter": "Parameter", "input": "Input", "constant": "Constant", "mode": "Mode"}
            role = roles.get(pending.role, "Signal")
            self.tell(MissingValue(item.span, role, pending.name, item.name, pending.owner.base().stands))
            raise AlreadyTold
        self.quantities[pending.name] = Named(
            pending.name, pending.role, str(declared or ONE), None, None, item.span, item.description or ""
        )
        return Scalar(Quantity(pending.name), declared or ONE, pending.role, pending.name)

    def _check_value(
        self,
        pending: Pending,
        typed: Typed | tuple[Typed, ...],
        value: tree.ExpressionSyntax,
        declared: Dimension | None,
    ) -> None:
        """Raise `Wrong` for a value of another dimension, or for a list in place of a single number."""
        item = pending.item
        for part in typed if isinstance(typed, tuple) else (typed,):
            if declared is not None and part.dimension is not None and part.dimension != declared:
                what = f"`{item.name}` is {describe(declared)}, but `{value.span.text}` is {describe(part.dimension)}"
                raise Wrong(DimensionMismatch(value.span, what, unit_hint(part.dimension, declared, value)))
        if not isinstance(typed, tuple):
            return
        if value is not item.value and item.value is not None:
            default = self.template(item.value, pending.owner, scale_of(item.unit) if item.unit is not None else None)
            if not isinstance(default.value, tuple):
                hint = "Its default is a single number; give it one, or an item of the list."
                raise Wrong(WrongType(value.span, f"A single number for `{item.name}`", "a list", hint))
        if pending.role in ("input", "mode"):
            hints = {"input": "An input is one signal.", "mode": "Declare a mode for each: `mode on[i] = false`."}
            raise Wrong(WrongType(value.span, "A single number", "a list", hints[pending.role]))

    # ------------------------------------------------------------ signals with memory
    def nested_memory(self, call: tree.Call, scope: Scope) -> Scalar:
        """Integral, delay or rate inside a larger expression: a signal that the author gave no name."""
        if call.function == "der" and self._inferring:
            return Scalar(Quantity("der"), self._per_second(self._looked_at(call.arguments[0], scope)), "signal", "der")
        if call.function == "hysteresis" and self._inferring:
            return Scalar(Quantity("hysteresis"), ONE, "mode", "hysteresis")
        key = (id(call), id(scope))
        if key not in self._nested:
            self._keep_scopes.append(scope)
            if call.function == "delay":
                self._nested[key] = self._delay(call, scope)
            elif call.function == "der":
                self._nested[key] = self._rate(call, scope)
            elif call.function == "hysteresis":
                self._nested[key] = self._relay(call, scope)
            else:
                self._nested[key] = self._integral(call, scope, "", "signal", None, "")
        return self._nested[key]

    def _free_name(self, call: tree.Call, scope: Scope) -> str:
        """Name of a nested signal; those in its arguments have theirs already."""
        name = scope.full(f"{call.function} at line {call.span.line}{scope.suffix}")
        return min({f"{name} ({i})" if i else name for i in range(len(self._nested) + 1)} - self.quantities.keys())

    def _integral(
        self, call: tree.Call, scope: Scope, name: str, role: str, declared: Dimension | None, description: str
    ) -> Scalar:
        """Enter an integral. It is known at once, so that it can depend on itself; its rate is read when all names are known."""
        rate, start = call.arguments
        template = self.template(start, scope)
        dimension = declared or self._dimension(template.value)
        if dimension is None and not scope.plain:
            dimension = self._inferred(rate, scope)
        name = name or self._free_name(call, scope)
        self.quantities[name] = Named(name, role, str(dimension or ONE), None, None, call.span, description)
        self._memories.append((name, call, scope, dimension))
        return Scalar(Quantity(name), dimension if not scope.plain else None, role, name)

    def _delay(self, call: tree.Call, scope: Scope) -> Scalar:
        """Enter a delay. It is known at once, so that its argument can depend on it; the argument is read when all names are known."""
        dimension = None if scope.plain else self._looked_at(call.arguments[0], scope)
        name = self._free_name(call, scope)
        self.quantities[name] = Named(name, "signal", str(dimension or ONE), None, None, call.span, "")
        self._delays.append((name, call, scope, dimension))
        return Scalar(Quantity(name), dimension, "signal", name)

    def _rate(self, call: tree.Call, scope: Scope) -> Scalar:
        """Enter the derivative of an expression by time, which is read at once: it cannot depend on itself."""
        template = self.template(call.arguments[0], scope)
        if not isinstance(template.value, Typed) or template.value.truth:
            what = "a condition" if isinstance(template.value, Typed) else "a list"
            raise Wrong(WrongType(call.arguments[0].span, "A single number", what, "Differentiate item by item."))
        dimension = None if scope.plain else self._per_second(template.value.dimension)
        bound = self.bind(template, template.formulas[0], scope)
        name = self._free_name(call, scope)
        self.quantities[name] = Named(name, "rate", str(dimension or ONE), bound, None, call.span, "")
        return Scalar(Quantity(name), dimension, "signal", name)

    def _relay(self, call: tree.Call, scope: Scope) -> Scalar:
        """Enter a relay with memory: a mode, which two events set. These are read when all names are known, so that what they read can depend on it."""
        bound = Bound(_constant(0.0), ())
        for start in call.arguments[3:]:
            template, bound = read_condition(self, start, scope, "It is on or off at the start: `true` or `false`.")
            for slot in template.slots:
                if self.scalar_at(slot, scope).role not in STATIC_ROLES:
                    raise Wrong(NotStatic(slot.path.span, "The start of a `hysteresis`", slot.words))
        name = self._free_name(call, scope)
        self.quantities[name] = Named(name, "mode", "1", bound, None, call.span, "")
        self.relays.append((name, call, scope))
        return Scalar(Quantity(name), ONE, "mode", name)

    @staticmethod
    def _per_second(dimension: Dimension | None) -> Dimension | None:
        return None if dimension is None else dimension / SECOND

    def _inferred(self, rate: tree.ExpressionSyntax, scope: Scope) -> Dimension | None:
        """Dimension of an integral from its rate. In the rate, the integral itself fits any dimension."""
        found = self._looked_at(rate, scope)
        return None if found is None else found * SECOND

    def _looked_at(self, expression: tree.ExpressionSyntax, scope: Scope) -> Dimension | None:
        """Dimension of an expression. Quantities that are being resolved fit any dimension."""
        return self._dimension(self._guessed(expression, scope))

    def _guessed(self, expression: tree.ExpressionSyntax, scope: Scope) -> Value:
        """Value of an expression for its dimension, in which quantities that are being resolved fit any."""
        before, self._inferring = self._inferring, True
        try:
            return ExpressionCompiler(scope, self.resolve).compile(expression).value
        finally:
            self._inferring = before

    def comparison(
        self, call: tree.Call, left: tree.ExpressionSyntax, operator: str, right: tree.ExpressionSyntax
    ) -> tree.Comparison:
        """Comparison of two arguments of a call; the same node for all instances, as templates are."""
        key = (id(call), operator)
        if key not in self._comparisons:
            self._comparisons[key] = tree.Comparison(call.span, call.depth, operator, left, right)
        return self._comparisons[key]

    def known_value(self, expression: tree.ExpressionSyntax, scope: Scope) -> float | None:
        """Value of an expression that is known before the run; None for any other."""
        template = self.template(expression, scope)
        if any(self.scalar_at(slot, scope).role not in STATIC_ROLES for slot in template.slots):
            return None
        return self.value_of(self.bind(template, template.formulas[0], scope), expression.span, decides=False)

    def remember(self, integral: Integral, unit: str) -> None:
        """Enter an integral of an element's own effort or flow."""
        self._remembered[integral.name] = integral
        self.quantities[integral.name] = Named(integral.name, "signal", unit, None, None, integral.span)

    def is_integral(self, name: str) -> bool:
        """Return True for an integral."""
        return name in self._remembered or any(name == known for known, *_ in self._memories)

    def integrals(self) -> dict[str, Integral]:
        """Signals with memory, with their rates read now."""
        return self._remembered | self._read_all(self._memories, self._read_integral)

    def delays(self) -> dict[str, Delay]:
        """Delayed signals, with their arguments and delay times."""
        return self._read_all(self._delays, self._read_delay)

    def _read_all(self, signals: list[_Memory], read: Callable[..., Signal]) -> dict[str, Signal]:
        """Read signals with memory by their names. The list may grow: a rate or an argument may contain another one."""
        results = ((signal[0], self.guard(read, *signal)) for signal in signals)
        return {name: result for name, result in results if result is not None}

    def _read_delay(self, name: str, call: tree.Call, scope: Scope, dimension: Dimension | None) -> Delay:
        value, lag = (self.template(part, scope) for part in call.arguments)
        typed = value.value
        if not isinstance(typed, Typed) or typed.truth:
            raise Wrong(WrongType(call.arguments[0].span, "A single number", "something else"))
        if not scope.plain and typed.dimension not in (None, dimension or ONE):
            what = f"What is delayed is {describe(typed.dimension)}, but where it is read it is {describe(dimension or ONE)}"
            raise Wrong(DimensionMismatch(call.arguments[0].span, what, unit_hint(typed.dimension, dimension or ONE)))
        late = self.static(call.arguments[1], scope, "A delay", ONE if scope.plain else SECOND)
        if not late > 0:
            raise Wrong(WrongType(call.arguments[1].span, "A time", f"{late:g} s", "A delay is longer than nothing."))
        return Delay(
            name, self.bind(value, value.formulas[0], scope), self.bind(lag, lag.formulas[0], scope), call.span
        )

    def _read_integral(self, name: str, call: tree.Call, scope: Scope, dimension: Dimension | None) -> Integral:
        bounds = []
        for part, wanted in zip(call.arguments, (self._per_second(dimension), dimension), strict=True):
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
        self.value_of(bounds[1], call.arguments[1].span, decides=False)
        return Integral(name, bounds[0], bounds[1], call.span)

    @staticmethod
    def _dimension(value: Value) -> Dimension | None:
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
            if override is None:
                return self._enter_later(pending, suffix, dimension, span)
            if isinstance(override, float):
                bound = Bound(_constant(override), ())
            else:
                template = self.template(override, self.root)
                self._require_static(template, self.root, pending)
                found = self._dimension(template.value)
                if isinstance(template.value, tuple):
                    raise Wrong(WrongType(override.span, f"A single number for `{name}`", "a list"))
                if found is not None and found != dimension:
                    what = f"`{name}` is {describe(dimension)}, but `{override.span.text}` is {describe(found)}"
                    hint = unit_hint(found, dimension, override)
                    raise Wrong(DimensionMismatch(override.span, what, hint))
                bound = self.bind(template, template.formulas[0], self.root)
        value = self.value_of(bound, span, decides=False) if role in ("parameter", "constant") else None
        if role == "constant" and value is not None and _reads_nothing(bound):
            return Scalar(value, dimension, role, name)  # a number with a name: nothing is left to be computed
        self.quantities[name] = Named(
            name, role, str(dimension or ONE), bound, value, pending.item.span, pending.item.description or ""
        )
        return Scalar(Quantity(name), dimension, role, name)

    def _enter_later(self, pending: Pending, suffix: str, dimension: Dimension | None, span: Span) -> Scalar:
        """Enter a number that only a run knows, a parameter or an input, as an argument of the program."""
        name = pending.name + suffix
        description = pending.item.description or ""
        self.quantities[name] = Named(name, "parameter", str(dimension or ONE), None, None, span, description)
        return Scalar(Quantity(name), dimension, pending.role, name)


def _constant(value: float) -> Formula:
    return Formula(0, Number(value))


def _reads_nothing(bound: Bound) -> bool:
    """Return True if only numbers are left after folding: `a*sin(0)` does not read `a`."""
    if all(isinstance(a, float) for a in bound.arguments):
        return True
    arguments = [Number(a) if isinstance(a, float) else None for a in bound.arguments]
    return not any(symbols(substitute(bound.formula.expression, lambda s: arguments[s.key] or s)))
