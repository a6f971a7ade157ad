"""Functions of the language: number of arguments, their units, and the expression that each becomes. And checks of those that a model defines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from fractions import Fraction

from ...algebra.expression import ONE as NUMBER_ONE
from ...algebra.expression import ZERO, Expression, call, divide, multiply, select
from ...algebra.operators import OPERATORS
from ...graph.units import ONE, Dimension
from ...syntax import tree
from ..names.errors import DimensionMismatch, DuplicateName, ReservedName
from ..names.scope import RESERVED, Array, Entry, Pending, Scalar, Scope, functions_in
from ..names.statement_errors import Wrong, describe
from .scales import check_cycles
from .template import Typed, Value, common_dimension

# name -> (number of arguments, usage, builder)
Builder = Callable[[tree.Call, list[Typed]], Value]
READABLE = ("parameter", "constant")


def _pure(operator: str) -> Builder:
    """A function of a bare number."""

    def build(node: tree.Call, arguments: list[Typed]) -> Typed:
        for argument, place in zip(arguments, node.arguments, strict=True):
            if argument.dimension not in (None, ONE):
                hint = "Divide by a reference of the same unit first."
                what = (
                    f"`{node.function}` takes a bare number, but `{place.span.text}` is {describe(argument.dimension)}"
                )
                raise Wrong(DimensionMismatch(place.span, what, hint))
        return Typed(call(operator, *(a.expression for a in arguments)), ONE)

    return build


def _keeping(operator: str) -> Builder:
    """Function whose arguments and result share one unit."""

    def build(node: tree.Call, arguments: list[Typed]) -> Typed:
        dimension = _same(node, arguments)
        return Typed(call(operator, *(a.expression for a in arguments)), dimension)

    return build


def _same(node: tree.Call, arguments: list[Typed]) -> Dimension | None:
    parts = [(a, n.span) for a, n in zip(arguments, node.arguments, strict=True)]
    return common_dimension(parts, f"The arguments of `{node.function}` need one unit")


def _sqrt(node: tree.Call, arguments: list[Typed]) -> Typed:
    d = arguments[0].dimension
    return Typed(call("sqrt", arguments[0].expression), None if d is None else d ** Fraction(1, 2))


def _bare_result(operator: str) -> Builder:
    def build(node: tree.Call, arguments: list[Typed]) -> Typed:
        _same(node, arguments)
        return Typed(call(operator, *(a.expression for a in arguments)), ONE)

    return build


def _step(node: tree.Call, arguments: list[Typed]) -> Typed:
    return Typed(select(call("less_equal", ZERO, arguments[0].expression), NUMBER_ONE, ZERO), ONE)


def _pulse(node: tree.Call, arguments: list[Typed]) -> Typed:
    _same(node, arguments)
    t, a, b = (x.expression for x in arguments)
    return Typed(select(call("and", call("less_equal", a, t), call("less", t, b)), NUMBER_ONE, ZERO), ONE)


def _mod(node: tree.Call, arguments: list[Typed]) -> Typed:
    dimension = _same(node, arguments)
    x, length = (a.expression for a in arguments)
    return Typed(x - length * call("floor", divide(x, length)), dimension)


def _stairs(node: tree.Call, arguments: list[Typed]) -> Typed:
    dimension = _same(node, arguments)
    x, tread = (a.expression for a in arguments)
    return Typed(tread * call("floor", divide(x, tread)), dimension)


def _pwm(node: tree.Call, arguments: list[Typed]) -> Typed:
    x, period, duty = arguments
    common_dimension(
        [(a, n.span) for a, n in zip((x, period), node.arguments[:2], strict=True)],
        "Time and period of `pwm` need one unit",
    )
    if duty.dimension not in (None, ONE):
        what = f"The duty of `pwm` is a bare number between 0 and 1, but `{node.arguments[2].span.text}` is {describe(duty.dimension)}"
        hint = "Write `pwm(time, 1 ms, 0.3)`, or divide what is on by the period."
        raise Wrong(DimensionMismatch(node.arguments[2].span, what, hint))
    turns = divide(
        x.expression, call("max", period.expression, ZERO)
    )  # one that is not positive in a run divides by zero
    share = call("min", call("max", duty.expression, ZERO), NUMBER_ONE)
    return Typed(call("floor", turns) - call("floor", turns - share), ONE)


def _rise(shape: Callable[[Expression], Expression]) -> Builder:
    """0 before a, 1 after b, and `shape` of (t-a)/(b-a) between."""

    def build(node: tree.Call, arguments: list[Typed]) -> Typed:
        _same(node, arguments)
        t, a, b = (x.expression for x in arguments)
        u = call("min", call("max", divide(t - a, b - a), ZERO), NUMBER_ONE)
        return Typed(shape(u), ONE)

    return build


# Smooth steps from 0 to 1, by their degrees.
_SMOOTH: dict[int, Callable[[Expression], Expression]] = {
    3: lambda u: multiply(u, u, 3 - 2 * u),
    5: lambda u: multiply(u, u, u, 10 + u * (6 * u - 15)),
    7: lambda u: multiply(u, u, u, u, 35 + u * (u * (70 - 20 * u) - 84)),
    9: lambda u: multiply(u, u, u, u, u, 126 + u * (u * (540 + u * (70 * u - 315)) - 420)),
}


def _chirp(node: tree.Call, arguments: list[Typed]) -> Typed:
    t, f0, f1, t1 = arguments
    places = [a.span for a in node.arguments]
    check_cycles(*node.arguments[1:3])
    time = common_dimension([(t, places[0]), (t1, places[3])], "The times of `chirp` need one unit")
    frequency = common_dimension([(f0, places[1]), (f1, places[2])], "The frequencies of `chirp` need one unit")
    if time is not None and frequency is not None and time * frequency != ONE:
        hint = "Write `chirp(time, 1 Hz, 20 Hz, 10 s)`."
        raise Wrong(DimensionMismatch(node.span, "Time and frequency in `chirp` do not fit each other", hint))
    x, low, high, end = (a.expression for a in arguments)
    turns = x * (low + (high - low) * x / (2 * end))
    return Typed(call("sin", 2 * math.pi * turns), ONE)


def _polar(node: tree.Call, arguments: list[Typed]) -> Value:
    r, angle = arguments
    if angle.dimension not in (None, ONE):
        what = f"An angle is a bare number, but `{node.arguments[1].span.text}` is {describe(angle.dimension)}"
        hint = "Write it in deg or rad."
        raise Wrong(DimensionMismatch(node.arguments[1].span, what, hint))
    return tuple(Typed(multiply(r.expression, call(f, angle.expression)), r.dimension) for f in ("cos", "sin"))


_BY_UNITS: dict[str, Callable[[str], Builder]] = {
    "bare": _pure,
    "same": _keeping,
    "ratio": _bare_result,
    "root": lambda _: _sqrt,
}

FUNCTIONS: dict[str, tuple[int, str, Builder]] = {
    **{r.name: (r.arity, r.usage or f"{r.name}(x)", _BY_UNITS[r.units](r.name)) for r in OPERATORS.values() if r.units},
    "ln": (1, "ln(x)", _pure("log")),
    "step": (1, "step(time - 1 s)", _step),
    "pulse": (3, "pulse(time, 1 s, 2 s)", _pulse),
    "pwm": (3, "pwm(time, 1 ms, 0.3)", _pwm),
    "mod": (2, "mod(x, length)", _mod),
    "stairs": (2, "stairs(x, tread)", _stairs),
    "ramp": (3, "ramp(time, 1 s, 2 s)", _rise(lambda u: u)),
    **{f"smoothstep{n}": (3, f"smoothstep{n}(time, 1 s, 2 s)", _rise(shape)) for n, shape in _SMOOTH.items()},
    "chirp": (4, "chirp(time, 1 Hz, 20 Hz, 10 s)", _chirp),
    "polar": (2, "polar(radius, angle)", _polar),
}


def check_function(scope: Scope, function: tree.FunctionSyntax, block: Iterable[tree.SyntaxNode]) -> None:
    """Check that a function of a model, or of a `for` in it, has a name that is used nowhere else. Raises `Wrong`."""
    if function.name in RESERVED:
        raise Wrong(ReservedName(function.span, function.name))
    around = scope.outer.function(function.name) if scope.outer is not None else None
    other = functions_in(block)[function.name] if around is None else around[0]
    other = scope.definition.file.functions.get(function.name, other)
    if other is not function:
        raise Wrong(DuplicateName(function.span, function.name, other.span))
    before = scope.find(function.name)
    if before is not None:
        first = before.item.span if isinstance(before, Pending) else getattr(before, "span", function.span)
        raise Wrong(DuplicateName(function.span, function.name, first))


def may_read(entry: Entry | None) -> bool:
    """Return True if a function of the model may read this entry: a parameter, a constant, an index of a `for`, or an array of them."""
    if isinstance(entry, Array):
        return all(may_read(item) for item in entry.items.values())
    if isinstance(entry, Scalar):
        return entry.role == "index"
    return isinstance(entry, Pending) and entry.role in READABLE
