"""Conversion to sympy, for readable output and further work by users."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import sympy

from .expression import Apply, Expression, Number, Symbol
from .operators import OPERATORS
from .table import chosen_slopes, lists

SHOWN_POINTS = 12  # of a table, in equations that people read


def to_sympy(x: Expression, name: Callable[[Any], Any]) -> Any:
    """The expression in sympy. `name` gives the sympy object for a symbol's key."""
    known: dict[Expression, Any] = {}

    def walk(node: Expression) -> Any:
        if isinstance(node, Number):
            whole = int(node.value) if abs(node.value) < 1e15 and node.value == int(node.value) else None
            if whole is not None:
                return sympy.Integer(whole)
            if node.value in (0.5, -0.5, 0.25, 1.5):
                return sympy.Rational(node.value)
            return sympy.Float(repr(node.value), 17) if len(repr(node.value)) > 15 else sympy.Float(node.value)
        found = known.get(node)
        if found is None:
            found = name(node.key) if isinstance(node, Symbol) else build(node)  # type: ignore[arg-type]
            known[node] = found
        return found

    def build(node: Apply) -> Any:
        operands = [walk(o) for o in node.operands]
        match node.operator:
            case "linear" | "cubic" | "monotone" | "inverse":
                return _table(node, operands)
            case "noise":
                return sympy.Function(_differentiated("noise", operands[0]))(*operands[1:])
            case "natural_slope" | "monotone_slope":
                return sympy.Function(node.operator)(*operands)
        form = OPERATORS[node.operator].in_sympy
        return getattr(sympy, form)(*operands) if isinstance(form, str) else form(sympy, *operands)

    return walk(x)


def _differentiated(name: str, order: Any) -> str:
    return name if order == 0 else f"{name}_{'slope' if order == 1 else f'derivative_{order}'}"


def _table(node: Apply, operands: list[Any]) -> Any:
    """A readable table; a long one only with the number of its points."""
    n = len(lists(node)[0])
    points = [sympy.Tuple(*operands[2:][i * n : (i + 1) * n]) for i in range(2 if chosen_slopes(node) is None else 3)]
    shown = points if n <= SHOWN_POINTS else [sympy.Symbol(f"{n} points")]
    return sympy.Function(_differentiated(node.operator, operands[0]))(operands[1], *shown)


def as_written(
    x: Expression, name: Callable[[Any], sympy.Basic], known: dict[Expression, sympy.Basic] | None = None
) -> sympy.Basic:
    """The expression in sympy without evaluation: a line printed from it computes the same in the same order.

    Curves keep all of their points, and functions that sympy lacks keep their names. `name` gives the sympy object for a symbol's key.
    `known` holds those of subexpressions, and receives all others.
    """
    known = {} if known is None else known

    def walk(node: Expression) -> sympy.Basic:
        found = known.get(node)
        if found is None:
            if isinstance(node, Number):
                found = number_as_written(node.value)
            else:
                found = name(node.key) if isinstance(node, Symbol) else _unevaluated(node, walk)  # type: ignore[arg-type]
            known[node] = found
        return found

    return walk(x)


def number_as_written(value: float) -> sympy.Basic:
    """A double in sympy, bit by bit."""
    return sympy.Integer(int(value)) if abs(value) < 1e15 and value == int(value) else sympy.Float(value)


def _unevaluated(node: Apply, walk: Callable[[Expression], sympy.Basic]) -> sympy.Basic:
    operands = [walk(o) for o in node.operands]
    match node.operator:
        case "add":
            return sympy.Add(*operands, evaluate=False)
        case "multiply":
            return _product(operands)
        case "divide":
            return quotient(*operands)
        case "power":
            return sympy.Pow(*operands, evaluate=False)
        case "linear" | "cubic" | "monotone" | "inverse":
            n = len(lists(node)[0])
            points = [sympy.Tuple(*operands[i : i + n]) for i in range(2, len(operands), n)]
            return sympy.Function(node.operator)(*operands[:2], *points)
        case "natural_slope" | "monotone_slope":
            n = len(operands) // 2
            points = [sympy.Tuple(*operands[i : i + n]) for i in (1, 1 + n)]
            return sympy.Function(node.operator)(operands[0], *points)
        case "select":
            condition = operands[0]
            if isinstance(condition, sympy.Piecewise) and [x for x, _ in condition.args] == [1, 0]:
                condition = condition.args[0].cond  # a truth as a number
            return sympy.Piecewise((operands[1], condition), (operands[2], True), evaluate=False)
        case "root":  # that of sympy is a power, which has no value below zero
            return sympy.Function("root")(*operands)
    return getattr(sympy, sympy_name(node.operator), sympy.Function(node.operator))(*operands, evaluate=False)


def sympy_name(operator: str) -> str:
    """Name of an operator's function in sympy; its own if sympy has it only as a formula, or not at all."""
    form = OPERATORS[operator].in_sympy
    return form if isinstance(form, str) else operator


def quotient(top: sympy.Basic, bottom: sympy.Basic) -> sympy.Basic:
    """The quotient of two sympy objects, unevaluated; a sign of the denominator goes in front."""
    if bottom.is_Mul and bottom.args[0] == -1:
        return _product([sympy.S.NegativeOne, top, sympy.Pow(_product(bottom.args[1:]), -1, evaluate=False)])
    return _product([top, sympy.Pow(bottom, -1, evaluate=False)])


def _product(factors: Iterable[sympy.Basic]) -> sympy.Basic:
    """A product with one sign in front, of which nothing else is evaluated."""
    opened = [inner for factor in factors for inner in (factor.args if factor.is_Mul else (factor,))]
    rest = [factor for factor in opened if factor not in (1, -1)]
    if opened.count(sympy.S.NegativeOne) % 2:
        rest.insert(0, sympy.S.NegativeOne)
    return rest[0] if len(rest) == 1 else sympy.Mul(*rest, evaluate=False)
