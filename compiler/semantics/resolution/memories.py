"""Signals with memory, rates and relays: `integral`, `delay`, `der` and `hysteresis`, each a signal of its own, read when all names are known."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from ...algebra.expression import Number
from ...algebra.formula import Bound, Formula
from ...graph.network import Delay, Integral, Named, Quantity
from ...graph.units import ONE, SECOND, Dimension
from ...scene import Override
from ...syntax import tree
from ..expressions.expression_compiler import ExpressionCompiler
from ..expressions.lists import columns_of, fitted, parts_of, place_in, shape_of, sort_of
from ..expressions.template import Typed, Value
from ..names.errors import DimensionMismatch, WrongType
from ..names.scope import STATIC_ROLES, Items, Pending, Scalar, Scope
from ..names.statement_errors import Wrong, describe, unit_hint
from .elaboration_cache import ElaborationCache
from .resolver import Resolver, read_condition

# name, call, the scope in which it is read, dimension, and of a list the number of the item
_Memory = tuple[str, tree.Call, Scope, Dimension | None, int | None]
Signal = TypeVar("Signal", Integral, Delay)


class MemoryResolver(Resolver):
    """Resolver of signals that the author gave no name."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        self._memories: list[_Memory] = []
        self._comparisons: dict[tuple[int, str], tree.Comparison] = {}
        self._remembered: dict[str, Integral] = {}
        self._delays: list[_Memory] = []
        self.relays: list[tuple[str, tree.Call, Scope]] = []  # name, call, the scope in which it is read
        self._nested: dict[tuple[int, int], Scalar | Items] = {}
        self._keep_scopes: list[Scope] = []  # their identity is a key above
        self._inferring = False
        self._guessed_quantities: list[Pending] = []  # those of the inference at hand
        self._units: dict[str, Dimension] = {}  # of integrals, as they were inferred

    def nested_memory(self, call: tree.Call, scope: Scope) -> Scalar | Items:
        """Integral, delay, rate or relay inside a larger expression: a signal, or a list of rates, without a name. For a unit alone none is entered."""
        if self._inferring:
            self.guesses += 1
            return self._unit_of_memory(call, scope)
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

    def _unit_of_memory(self, call: tree.Call, scope: Scope) -> Scalar | Items:
        """Integral, delay, rate or relay of which only the dimension counts."""
        name = call.function
        if name == "hysteresis":
            return Scalar(Quantity(name), ONE, "mode", name, truth=True)
        value = self._guessed(call.arguments[name == "integral"], scope)
        if name == "der" or isinstance(value, tuple):
            units = (self._per_second(p.dimension) if name == "der" else p.dimension for p in parts_of(value))
            entered = tuple(Scalar(Quantity(name), unit, "signal", name) for unit in units)
            return Items(name, entered, columns_of(value)) if isinstance(value, tuple) else entered[0]
        dimension = self._dimension(value)
        if dimension is None and name == "integral" and not scope.plain:
            dimension = self._inferred(call.arguments[0], scope)
        return Scalar(Quantity(name), dimension, "signal", name, truth=name == "delay" and value.truth)

    def _free_name(self, call: tree.Call, scope: Scope, place: str = "") -> str:
        """Name of a nested signal, or of the one at a place in a list; those in its arguments have theirs already."""
        name = scope.full(f"{call.function} at line {call.span.line}{scope.suffix}{place}")
        return min({f"{name} ({i})" if i else name for i in range(len(self._nested) + 1)} - self.quantities.keys())

    def _integral(
        self, call: tree.Call, scope: Scope, name: str, role: str, declared: Dimension | None, description: str
    ) -> Scalar | Items:
        """Enter an integral. It is known at once, so that it can depend on itself; its rate is read when all names are known."""
        rate, start = call.arguments
        template = self.template(start, scope)
        if isinstance(template.value, tuple):
            return self._listed(self._memories, call, scope, template.value, (name, role, declared, description))
        dimension = declared or self._dimension(template.value)
        if dimension is None and not scope.plain:
            dimension = self._units.get(name) or self._inferred(rate, scope)
            if name and dimension is not None:
                self._units[name] = dimension  # what it was inferred from is checked when the rate is read
        if self._inferring:
            self.guesses += 1
            return Scalar(Quantity(name), dimension, role, name)
        name = name or self._free_name(call, scope)
        self.quantities[name] = Named(name, role, str(dimension or ONE), None, None, call.span, description)
        self._memories.append((name, call, scope, dimension, None))
        return Scalar(Quantity(name), dimension if not scope.plain else None, role, name)

    def _listed(
        self,
        signals: list[_Memory],
        call: tree.Call,
        scope: Scope,
        value: Value,
        words: tuple[str, str, Dimension | None, str],
    ) -> Items:
        """Enter one signal with memory for each number of a list, in its own unit; a zero without one has that of the others."""
        name, role, declared, description = words
        units = {d for p in parts_of(value) if (d := p.dimension) is not None}
        usual = units.pop() if len(units) == 1 else ONE  # what is read later says if it is another
        entered = []
        for number, part in enumerate(parts_of(value)):
            place, dimension = place_in(value, number), declared or part.dimension or usual
            own = f"{name}{place}" if name or self._inferring else self._free_name(call, scope, place)
            if not self._inferring:
                self.quantities[own] = Named(own, role, str(dimension), None, None, call.span, description)
                signals.append((own, call, scope, dimension, number))
            entered.append(Scalar(Quantity(own), None if scope.plain else dimension, role, own))
        self.guesses += self._inferring
        return Items(name or call.function, tuple(entered), columns_of(value))

    def _delay(self, call: tree.Call, scope: Scope) -> Scalar | Items:
        """Enter a delay. It is known at once, so that its argument can depend on it; the argument is read when all names are known."""
        value = self._guessed(call.arguments[0], scope)
        if isinstance(value, tuple):
            return self._listed(self._delays, call, scope, value, ("", "signal", None, ""))
        dimension = None if scope.plain else self._dimension(value)
        name = self._free_name(call, scope)
        self.quantities[name] = Named(name, "signal", str(dimension or ONE), None, None, call.span, "")
        self._delays.append((name, call, scope, dimension, None))
        return Scalar(Quantity(name), dimension, "signal", name, truth=value.truth)

    def _rate(self, call: tree.Call, scope: Scope) -> Scalar | Items:
        """Enter the derivative of an expression, or of each number of a list, by time. It is read at once: it cannot depend on itself."""
        template = self.template(call.arguments[0], scope)
        value = template.value
        if isinstance(value, Typed) and value.truth:
            hint = "A condition jumps; it has no rate."
            raise Wrong(WrongType(call.arguments[0].span, "A number", "a condition", hint))
        rates = []
        for number, (part, formula) in enumerate(zip(parts_of(value), template.formulas, strict=True)):
            if isinstance(value, tuple) and part.dimension is None and not scope.plain:
                rates.append(Scalar(0.0, None, "constant", call.function))  # of a zero that fits any unit
                continue
            dimension = None if scope.plain else self._per_second(part.dimension)
            name = self._free_name(call, scope, place_in(value, number))
            bound = self.bind(template, formula, scope)
            self.quantities[name] = Named(name, "rate", str(dimension or ONE), bound, None, call.span, "")
            rates.append(Scalar(Quantity(name), dimension, "signal", name))
        return Items(call.function, tuple(rates), columns_of(value)) if isinstance(value, tuple) else rates[0]

    def _relay(self, call: tree.Call, scope: Scope) -> Scalar:
        """Enter a relay with memory: a mode, which two events set. These are read when all names are known, so that what they read can depend on it."""
        bound = Bound(constant(0.0), ())
        for start in call.arguments[3:]:
            template, bound = read_condition(self, start, scope, "It is on or off at the start: `true` or `false`.")
            self.require_static(template, scope, "The start of a `hysteresis`")
        name = self._free_name(call, scope)
        self.quantities[name] = Named(name, "mode", "1", bound, None, call.span, "")
        self.relays.append((name, call, scope))
        return Scalar(Quantity(name), ONE, "mode", name, truth=True)

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
        """Value of an expression for its dimension, in which quantities that are being resolved fit any. What reads these is resolved again later."""
        before, self._inferring = self._inferring, True
        try:
            return ExpressionCompiler(scope, self.resolve).compile(expression).value
        finally:
            self._inferring = before
            if not before:
                for pending in self._guessed_quantities:
                    pending.state = "waiting"
                self._guessed_quantities.clear()

    def comparison(
        self, call: tree.Call, left: tree.ExpressionSyntax, operator: str, right: tree.ExpressionSyntax
    ) -> tree.Comparison:
        """Comparison of two arguments of a call; the same node for all instances, as templates are."""
        key = (id(call), operator)
        if key not in self._comparisons:
            self._comparisons[key] = tree.Comparison(call.span, call.depth, operator, left, right)
        return self._comparisons[key]

    def known_bound(self, expression: tree.ExpressionSyntax, scope: Scope) -> Bound | None:
        """Definition of an expression that is known before the run; None for any other."""
        template = self.template(expression, scope)
        if any(self.scalar_at(slot, scope).role not in STATIC_ROLES for slot in template.slots):
            return None
        return self.bind(template, template.formulas[0], scope)

    def remember(self, integral: Integral, unit: str) -> None:
        """Enter an integral of an element's own effort or flow."""
        self._remembered[integral.name] = integral
        self.quantities[integral.name] = Named(integral.name, "signal", unit, None, None, integral.span)

    def is_integral(self, name: str) -> bool:
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

    def _read_delay(
        self, name: str, call: tree.Call, scope: Scope, dimension: Dimension | None, number: int | None
    ) -> Delay:
        value, lag = (self.template(part, scope) for part in call.arguments)
        typed = value.value if number is None else parts_of(value.value)[number]
        if not isinstance(typed, Typed):
            raise Wrong(WrongType(call.arguments[0].span, "A single number", "something else"))
        if not scope.plain and typed.dimension not in (None, dimension or ONE):
            what = f"What is delayed is {describe(typed.dimension)}, but where it is read it is {describe(dimension or ONE)}"
            raise Wrong(DimensionMismatch(call.arguments[0].span, what, unit_hint(typed.dimension, dimension or ONE)))
        late = self.static(call.arguments[1], scope, "A delay", ONE if scope.plain else SECOND)
        if not late > 0:
            raise Wrong(WrongType(call.arguments[1].span, "A time", f"{late:g} s", "A delay is longer than nothing."))
        if typed.truth:
            _, past = read_condition(self, call.arguments[0], scope, "")
        else:
            past = self.bind(value, value.formulas[number or 0], scope)
        return Delay(name, past, self.bind(lag, lag.formulas[0], scope), call.span)

    def _read_integral(
        self, name: str, call: tree.Call, scope: Scope, dimension: Dimension | None, number: int | None
    ) -> Integral:
        bounds = []
        start = self.template(call.arguments[1], scope).value
        for part, wanted in zip(call.arguments, (self._per_second(dimension), dimension), strict=True):
            template = self.template(part, scope)
            if shape_of(fitted(template.value, start)) != shape_of(start):
                wide = sort_of(start).capitalize()
                hint = (
                    "An integral is as long as its start." if number is not None else "The start of a list is a list."
                )
                raise Wrong(WrongType(part.span, wide, sort_of(template.value), hint))
            value = parts_of(template.value)[number or 0]
            if not scope.plain and value.dimension is not None and wanted is not None and value.dimension != wanted:
                entry = place_in(template.value, number or 0)
                item = f"Item {entry} of `{part.span.text}`" if entry else f"`{part.span.text}`"
                what = (
                    f"{item} is {describe(value.dimension)}, but an integral in [{dimension}] needs {describe(wanted)}"
                )
                hint = unit_hint(value.dimension, wanted)
                if parts_of(start)[number or 0].dimension is None:
                    hint = f"Give its start the unit: `0 [{value.dimension * SECOND}]`; or, as a rate is per time, divide it by a time, `(…)/1 s`."
                raise Wrong(DimensionMismatch(part.span, what, hint))
            bounds.append(self.bind(template, template.formulas[number or 0], scope))
        self.require_static(self.template(call.arguments[1], scope), scope, "The start of an integral")
        self.value_of(bounds[1], call.arguments[1].span, decides=False)
        return Integral(name, bounds[0], bounds[1], call.span)

    @staticmethod
    def _dimension(value: Value) -> Dimension | None:
        return next((p.dimension for p in parts_of(value) if p.dimension is not None), None)


def constant(value: float) -> Formula:
    return Formula(0, Number(value))
