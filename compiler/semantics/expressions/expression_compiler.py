"""Expressions with units: compiled to formulas over SI numbers, or refused with a diagnostic.

A formula is made once per place in the text and cached there; each instance only looks up the readings of its slots.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from ...algebra.expression import ONE as NUMBER_ONE
from ...algebra.expression import ZERO, Expression, Number, Symbol, call, power, select
from ...algebra.formula import Formula
from ...graph.units import ONE, UNITS, Dimension, Scale
from ...source import Span
from ...syntax import tree
from ...syntax.errors import NumberTooLarge
from ..names import foreign_words
from ..names.errors import (
    NO_NAMES,
    Cycle,
    NoValue,
    TooMany,
    UnknownFunction,
    UnknownName,
    Unsupported,
    WrongArguments,
    WrongType,
)
from ..names.scope import Scope, TextValue
from ..names.statement_errors import Wrong, describe, reading_of, suggestion
from . import tables
from .functions import FUNCTIONS, may_read
from .lists import each, item_of, parts_of, place_in, product, rows_of, selected, shape_of, shaped, sort_of, total
from .rates import own_rates, rates_in
from .scales import bare, is_absolute, is_decibel, scale_of
from .template import (
    Check,
    ListUnits,
    OwnVariable,
    Readable,
    Resolve,
    Slot,
    Template,
    Typed,
    Value,
    bare_number,
    beside,
    common_dimension,
    has_value,
    negated,
    no_choice,
    times,
)
from .vectors import VECTORS, compile_vector
from .words import compare_words

# signals of their own: with memory, and rates
MEMORIES = {
    "integral": "integral(rate, start)",
    "delay": "delay(x, 1 ms)",
    "der": "der(x)",
    "hysteresis": "hysteresis(x, low, high, false)",
}
RELAYS = ("hysteresis",)  # truths; their last argument is the start and may be left out
INSIDE = {  # advice in a function
    "integral": "Integrate", "delay": "Delay it", "der": "Differentiate", "hysteresis": "Let it be a parameter, and give it",
}  # fmt: skip
BUILT_IN = (*FUNCTIONS, *MEMORIES, *tables.USAGE, *VECTORS)
MAXIMUM_ITEMS = 10_000  # of one list
MAXIMUM_CALLS = 1000  # functions opened in one expression
MOST_DECIBELS = 6000  # a ratio of 1e300


class ExpressionCompiler:
    """Compiler of one place of the text."""

    def __init__(
        self,
        scope: Scope,
        resolve: Resolve,
        own: Mapping[str, OwnVariable | Sequence[OwnVariable]] | None = None,
        unit: Scale | None = None,
    ) -> None:
        self.scope, self.resolve, self.own = scope, resolve, own or {}
        self.unit = unit  # unit of bare numbers, after `name : unit =`
        self.slots: dict[tuple[str, int | None, int | None], int] = {}
        self.slot_list: list[Slot] = []
        self.local: dict[str, Value] = {}  # parameters of a function being opened
        # what is written for parameters of a function being opened, and a law's own rates of angles
        self.written = own_rates(self.own)
        self.opening: list[str] = []  # functions being opened, outermost first
        # names are read there: those of a function where it is defined; None in a function of the file
        self.home: Scope | None = scope
        self.opened = 0
        self.checks: list[Check] = []
        self.lists: dict[str, tuple[tree.PathSyntax, ListUnits | TextValue]] = {}
        self.functions: dict[str, tree.FunctionSyntax | None] = {}  # of the model, as they are here

    def compile(self, expression: tree.ExpressionSyntax) -> Template:
        value = self._in_unit(expression) if self.unit is not None else self.value(expression)
        if isinstance(value, Typed):
            no_choice(value, expression.span)
        formulas = tuple(Formula(len(self.slot_list), p.expression) for p in parts_of(value))
        read = tuple(self.lists.values()), tuple(self.functions.items())
        return Template(value, tuple(self.slot_list), formulas, tuple(self.checks), *read)

    def _in_unit(self, expression: tree.ExpressionSyntax) -> Value:
        """Value after `name : unit =`: a bare number, alone or in a list, is in that unit; any other expression has its own."""
        if isinstance(expression, tree.VectorSyntax):
            return self._listed(expression, self._in_unit)
        unit = self.unit
        self.unit = unit if bare(expression) else None
        try:
            return self.numbers(self.value(expression), expression.span)
        finally:
            self.unit = unit

    def _listed(self, node: tree.VectorSyntax, read: Callable[[tree.ExpressionSyntax], Value]) -> Value:
        """A list of numbers, or of lists of one length, which are the rows of a matrix."""
        if len(node.items) > MAXIMUM_ITEMS:
            raise Wrong(TooMany(node.span, "Items of a list", MAXIMUM_ITEMS))
        values = [read(item) for item in node.items]
        numbers = [self._number(v, i.span) for v, i in zip(values, node.items, strict=True) if isinstance(v, Typed)]
        if len(numbers) == len(values):
            return tuple(numbers)
        length = next(len(value) for value in values if isinstance(value, tuple))
        for value, item in zip(values, node.items, strict=True):
            if shape_of(value) != (length, 0):
                hint = "A list of lists is a matrix, row by row: `[[1, 2, 3], [4, 5, 6]]`. One item of a list is `name[1]`."
                raise Wrong(WrongType(item.span, f"A row of {length}", sort_of(value), hint))
        if len(values) * length > MAXIMUM_ITEMS:
            raise Wrong(TooMany(node.span, "Items of a list", MAXIMUM_ITEMS))
        return tuple(parts_of(value) for value in values)

    # ------------------------------------------------------------ the cases
    def value(self, node: tree.ExpressionSyntax) -> Value:
        """Compile a node. Raises `Wrong` for a number that is not finite."""
        value = self._value(node)
        self.checks += rates_in(node, value, self.written)
        for part in parts_of(value):
            if not part.truth and not has_value(part.expression):
                why = "a division by zero, an overflow, or a root or logarithm of a negative number"
                raise Wrong(NoValue(node.span, why, NO_NAMES))
        return value

    def _value(self, node: tree.ExpressionSyntax) -> Value:
        match node:
            case tree.Literal():
                return self._literal(node)
            case tree.PathSyntax():
                return self._path(node)
            case tree.Sum():
                return self._sum(node)
            case tree.Product():
                return self._product(node)
            case tree.Negative(operand=tree.Literal() as literal) if (
                literal.unit is None or "(" not in literal.span.text
            ):
                return self._literal(literal, -literal.number)  # -20 dB is not 20 dB, negated, which -(20 dB) is
            case tree.Negative():
                return each(lambda t: negated(self._number(t, node.span)), self.value(node.operand))
            case tree.Power():
                return self._power(node)
            case tree.VectorSyntax():
                return self._listed(node, self.value)
            case tree.Call():
                return self._call(node)
            case tree.TextSyntax():
                return Typed(ZERO, ONE, text=TextValue(node.value, self.scope.definition.file))
            case tree.Comparison():
                return self._comparison(node)
            case tree.Logical():
                operands = [self.condition(o) for o in node.operands]
                result = operands[0] if len(operands) > 1 else call("not", operands[0])
                for operand in operands[1:]:
                    result = call(node.operator, result, operand)
                return Typed(result, ONE, truth=True)
            case tree.ChoiceSyntax():
                return self._choice(node)
        raise AssertionError(type(node))

    def scalar(self, node: tree.ExpressionSyntax) -> Typed:
        """One number."""
        value = self.value(node)
        if isinstance(value, tuple):
            text = node.span.text if isinstance(node, tree.PathSyntax) else "name"
            hint = f"Take one item: `{text}{place_in(value, 0)}`."
            raise Wrong(WrongType(node.span, "A single number", sort_of(value), hint))
        return self._number(value, node.span)

    def numbers(self, value: Value, span: Span) -> Value:
        """A number, a list or a matrix, with 1 and 0 for a condition."""
        return value if isinstance(value, tuple) else self._number(value, span)

    def _no_word(self, node: tree.ExpressionSyntax) -> Value:
        """A value that is no choice and no text."""
        value = self.value(node)
        return no_choice(value, node.span) if isinstance(value, Typed) else value

    def condition(self, node: tree.ExpressionSyntax) -> Expression:
        """A condition: a comparison, or a name that is one."""
        value = self._no_word(node)
        if isinstance(value, tuple) or not value.truth:
            raise Wrong(WrongType(node.span, "A condition", "a number", "Compare it with something: `x > 0`."))
        return value.expression

    def _number(self, value: Typed, span: Span) -> Typed:
        if value.truth:  # a condition read as a number is 1 or 0: `output lift_off = tyre.x < 0 m`
            return Typed(select(value.expression, NUMBER_ONE, ZERO), ONE)
        return no_choice(value, span)

    def _literal(self, node: tree.Literal, number: Fraction | None = None) -> Typed:
        value = node.number if number is None else number
        if node.unit is not None:
            if self.scope.plain:
                hint = "A `plain model` has no units; drop the word `plain` to use them."
                raise Wrong(WrongType(node.unit.span, "A bare number", "a unit", hint))
            if is_decibel(node.unit):
                return Typed(self._finite(10.0 ** float(value / 20) if value < MOST_DECIBELS else math.inf, node), ONE)
            scale = scale_of(node.unit)
            return Typed(self._finite(scale.to_si(value), node), scale.dimension)
        if self.unit is not None:
            return Typed(self._finite(self.unit.to_si(value), node), self.unit.dimension)
        return Typed(Number(float(value)), None if value == 0 else ONE)

    @staticmethod
    def _finite(value: float, node: tree.Literal) -> Number:
        if not math.isfinite(value):
            raise Wrong(NumberTooLarge(node.span, node.span.text[:40]))
        return Number(value)

    def _path(self, node: tree.PathSyntax) -> Value:
        if not node.steps:
            if node.head in self.local:
                return self.local[node.head]
            if node.head == "pi":
                return Typed(Number(math.pi), ONE)
            if node.head in ("true", "false"):
                return Typed(call("less", ZERO if node.head == "true" else NUMBER_ONE, Number(0.5)), ONE, truth=True)
        words = node.words
        if words in self.own and not self.opening:
            own = self.own[words]
            if isinstance(own, OwnVariable):
                return Typed(Symbol(own.own), own.dimension)
            return tuple(Typed(Symbol(variable.own), variable.dimension) for variable in own)
        if words == "time":
            return Typed(Symbol(self._slot(node, None)), None if self.scope.plain else UNITS["s"].dimension)
        if node.head in self.local:
            return item_of(self.local[node.head], node)
        if self.opening:
            return self._in_function(node)
        return self._read(node, None)

    def _read(self, node: tree.PathSyntax, home: Scope | None) -> Value:
        """Quantity that a path reads in the scope, or in that of a function."""
        found = self.resolve(node, home or self.scope)
        depth = None if home is None else len(home.rows()) - 1
        words = node.words if home is None else f"{node.words} of the function's scope"
        if found.text is not None:
            self.lists[words] = node, found.text
            return Typed(ZERO, ONE, text=found.text)
        if not found.is_list:
            symbol = Symbol(self._slot(node, None, depth))
            if found.truth:
                return Typed(call("less", Number(0.5), symbol), ONE, truth=True)
            return Typed(symbol, found.dimensions[0], choices=found.choices)
        if found.by_text:
            self.lists[words] = node, (found.dimensions, found.columns, found.values)
        if found.fixed:
            known = [v for v in found.values if v is not None]
            parts = [Typed(Number(v), d) for v, d in zip(known, found.dimensions, strict=True)]
            return shaped(parts, found.columns)
        self.lists[words] = node, (found.dimensions, found.columns)
        return self._slots_of(node, found, depth)

    def _slots_of(self, node: tree.PathSyntax | tree.Call, found: Readable, depth: int | None) -> Value:
        """Readings of the numbers of a list; of those that fit any unit, which are zero, none."""
        parts = [
            Typed(ZERO, None)
            if unit is None and not self.scope.plain
            else Typed(Symbol(self._slot(node, i, depth)), unit)
            for i, unit in enumerate(found.dimensions)
        ]
        return shaped(parts, found.columns)

    def _in_function(self, node: tree.PathSyntax) -> Value:
        """Value of a name in a function: a parameter of the function or a constant of its file, no name of the calling model.

        A function of a model also reads the parameters and constants of that model.
        """
        if self.home is not None and may_read(self.home.find(node.head)):
            return self._read(node, self.home)
        if self.scope.find(node.head) is not None and node.head not in self.scope.definition.file.constants:
            function = self.opening[-1]
            known = " and those of its model, and constants" if self.home is not None else " and its file's constants"
            hint = f"It reads its parameters{known}; make it one: `{function}(…, {node.head})`."
            raise Wrong(UnknownName(node.span, node.head, f"the function `{function}`", hint))
        outside = Scope(self.scope.definition, "")
        found = self.resolve(node, outside)
        if found.text is not None:
            return Typed(ZERO, ONE, text=found.text)
        values = [v for v in found.values if v is not None]
        if len(values) < len(found.dimensions):
            what = "A parameter of the function or a constant of the file"
            raise Wrong(WrongType(node.span, what, f"`{node.words}`"))
        parts = tuple(Typed(Number(v), d) for v, d in zip(values, found.dimensions, strict=True))
        return shaped(parts, found.columns) if found.is_list else parts[0]

    def _slot(self, path: tree.PathSyntax | tree.Call, item: int | None, depth: int | None = None) -> int:
        key = (
            path.words if isinstance(path, tree.PathSyntax) else f"{path.function} at {path.span.start}",
            item,
            depth,
        )
        if key not in self.slots:
            self.slots[key] = len(self.slot_list)
            self.slot_list.append(Slot(path, item, depth))
        return self.slots[key]

    def _sum(self, node: tree.Sum) -> Value:
        absolute = [s for s, t in node.terms if isinstance(t, tree.Literal) and t.unit and is_absolute(t.unit)]
        if len(absolute) > 1 and sum(absolute) not in (0, 1):
            hint = "A difference of temperatures is in K: `20 degC + 5 K`."
            raise Wrong(WrongType(node.span, "A temperature or a difference", "a sum of absolute temperatures", hint))
        values = [(sign, term.span, self.numbers(self.value(term), term.span)) for sign, term in node.terms]
        return total(values)

    def _product(self, node: tree.Product) -> Value:
        result: Value = Typed(NUMBER_ONE, ONE)
        before = node.factors[0][1].span
        for direction, factor in node.factors:
            value = beside(self.numbers(self.value(factor), factor.span), node)
            if isinstance(value, Typed):
                result = each(lambda t, n=value, d=direction: times(t, n, d), result)  # type: ignore[misc]
            elif isinstance(result, Typed) and direction > 0:
                result = each(lambda t, n=result: times(n, t, 1), value)  # type: ignore[misc]
            else:
                try:
                    result = product(result, value, (before, factor.span), direction < 0)
                except Wrong as wrong:
                    told, hint = wrong.diagnostic, reading_of(node)
                    if not hint or not isinstance(told, WrongType):
                        raise
                    raise Wrong(replace(told, hint=hint)) from None
            before = before.to(factor.span)
        return result

    def _power(self, node: tree.Power) -> Typed:
        base, exponent = self.value(node.base), self.scalar(node.exponent)
        if isinstance(base, tuple):
            words = node.base.span.words
            ways = (f"dot({words}, {words})`, or item by item", f"{words}*{words}`, or `inverse({words})`")
            hint = f"Write `{ways[bool(rows_of(base))]}."
            raise Wrong(WrongType(node.base.span, "A single number", sort_of(base), hint))
        base = self._number(base, node.base.span)
        bare_number(exponent, node.exponent, "The exponent")
        dimension: Dimension | None = ONE
        if base.dimension not in (None, ONE):
            if not isinstance(exponent.expression, Number):
                hint = f"The base is {describe(base.dimension)}, so the exponent decides the unit of the result: only a number can stand here."
                raise Wrong(WrongType(node.exponent.span, "A number as exponent", "an expression", hint))
            dimension = base.dimension ** Fraction(exponent.expression.value).limit_denominator(60)
        if isinstance(exponent.expression, Number) and abs(exponent.expression.value) > 1000:
            raise Wrong(WrongType(node.exponent.span, "An exponent up to 1000", "a larger one", "Use exp() and log()."))
        return Typed(power(base.expression, exponent.expression), dimension)

    def _choice_at(self, node: tree.ExpressionSyntax) -> Typed | None:
        """The choice or text that one side of a comparison is; None for anything else."""
        names = (self.scope.find, self.local.get, self.scope.definition.file.constants.get)
        named = isinstance(node, tree.PathSyntax) and any(find(node.head) for find in names)
        value = self.value(node) if named or isinstance(node, tree.TextSyntax) else None
        return value if isinstance(value, Typed) and (value.choices or value.text) else None

    def _comparison(self, node: tree.Comparison) -> Typed:
        sides = self._choice_at(node.left), self._choice_at(node.right)
        if sides != (None, None):
            return compare_words(node, sides)
        left, right = self.scalar(node.left), self.scalar(node.right)
        common_dimension([(left, node.left.span), (right, node.right.span)], "These cannot be compared")
        self.checks += rates_in(node, (left, right), self.written)
        a, b = left.expression, right.expression
        match node.operator:
            case "<":
                result = call("less", a, b)
            case ">":
                result = call("less", b, a)
            case "<=":
                result = call("less_equal", a, b)
            case ">=":
                result = call("less_equal", b, a)
            case "==":
                result = call("equal", a, b)
            case _:
                result = call("not", call("equal", a, b))
        return Typed(result, ONE, truth=True)

    def _choice(self, node: tree.ChoiceSyntax) -> Value:
        condition = self.condition(node.condition)
        value = self._guarded(node.value, condition)
        otherwise = self._guarded(node.otherwise, call("not", condition))
        return selected(condition, (value, node.value.span), (otherwise, node.otherwise.span))

    def _guarded(self, node: tree.ExpressionSyntax, condition: Expression) -> Value:
        """A branch of a choice; what is left to an instance to check there is checked where the condition may hold."""
        first = len(self.checks)
        value = self._no_word(node)
        self.checks[first:] = [check.under(condition) for check in self.checks[first:]]
        return value

    def _call(self, node: tree.Call) -> Value:
        function = self._function(node.function)
        if function is not None:
            return self._open(*function, node)
        if node.function in MEMORIES:
            return self._memory(node)
        if node.function in tables.USAGE:
            readers = tables.Arguments(self.value, self.scalar, self.checks)
            return tables.compile_table(readers, node)
        if node.function in VECTORS:
            return compile_vector(node, [self._no_word(a) for a in node.arguments], self.checks)
        rule = FUNCTIONS.get(node.function)
        if rule is None:
            own = (name for row in self.scope.rows() for name in (row.functions or row.definition.functions))
            names = [*BUILT_IN, *self.scope.definition.file.functions, *own]
            hint = suggestion(node.function, names, "A product is written with `*`.")
            hint = foreign_words.function_advice(node.function, FUNCTIONS) or hint
            raise Wrong(UnknownFunction(node.span, node.function, hint))
        count, usage, build = rule
        if len(node.arguments) != count:
            raise Wrong(WrongArguments(node.span, node.function, _arguments(count), len(node.arguments), usage))
        arguments = [self.scalar(a) for a in node.arguments]
        value = build(node, arguments)
        if node.function in tables.DIVISORS:
            tables.settle_divisor(self.checks, node.function, node.arguments[1].span, arguments[1].expression)
        return value

    def _function(self, name: str) -> tuple[tree.FunctionSyntax, Scope | None] | None:
        """The author's function of that name, and its scope. A function of the file cannot call functions of the model."""
        own = self.home.function(name) if self.home is not None else None
        if self.home is not None and (own is not None or name in self.scope.definition.branched):
            self.functions[name] = None if own is None else own[0]
        shared = self.scope.definition.file.functions.get(name)
        return own or (None if shared is None else (shared, None))

    def _memory(self, node: tree.Call) -> Value:
        """Reading of `integral(rate, start)`, `delay(x, 1 ms)` or `der(x)`, which are signals of their own, or of the `der` of a list."""
        usage = MEMORIES[node.function]
        count = usage.count(",") + 1
        relay = node.function in RELAYS
        if len(node.arguments) not in (count, count - relay):
            counts = f"{count - 1} or {_arguments(count)}" if relay else _arguments(count)
            raise Wrong(WrongArguments(node.span, node.function, counts, len(node.arguments), usage))
        if self.opening:
            hint = f"{INSIDE[node.function]} where the function is used."
            raise Wrong(Unsupported(node.span, f"`{node.function}` inside a function", hint))
        found = self.resolve(node, self.scope)
        if found.is_list:
            return self._slots_of(node, found, None)
        symbol = Symbol(self._slot(node, None))
        if found.truth:
            return Typed(call("less", Number(0.5), symbol), ONE, truth=True)
        return Typed(symbol, found.dimensions[0])

    def _open(self, function: tree.FunctionSyntax, home: Scope | None, node: tree.Call) -> Value:
        if len(node.arguments) != len(function.parameters):
            usage = f"{function.name}({', '.join(function.parameters)})"
            count = _arguments(len(function.parameters))
            raise Wrong(WrongArguments(node.span, function.name, count, len(node.arguments), usage))
        self.opened += 1
        if function.name in self.opening:
            raise Wrong(Cycle(node.span, "A function cannot call itself", " -> ".join([*self.opening, function.name])))
        if self.opened > MAXIMUM_CALLS:
            raise Wrong(TooMany(node.span, "Calls of functions in one expression", MAXIMUM_CALLS))
        values = {name: self.value(a) for name, a in zip(function.parameters, node.arguments, strict=True)}
        saved = self.local, self.home, self.written
        written = dict(zip(function.parameters, node.arguments, strict=True)), self.written
        self.local, self.home, self.written = values, home, written
        self.opening.append(function.name)
        try:
            return self.value(function.body)
        finally:
            self.local, self.home, self.written = saved
            self.opening.pop()


def _arguments(count: int) -> str:
    return f"{count} argument{'s' * (count != 1)}"
