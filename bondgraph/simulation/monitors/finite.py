"""Reported values that are not finite: the output, the instant, and the line of the text that most likely caused it.

The cause of an expression without a value at a state, or just beyond it, is an operation with the values that it reads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import (
    Apply,
    Array,
    Assignment,
    Expression,
    LinearLoop,
    Number,
    Program,
    StateSpace,
    Symbol,
    evaluate,
    symbols,
    value_of,
)

from ...errors import RunFailed

NO_MODES: Mapping[str, float] = {}
SHOWN = 4  # most variables of a divisor in a message
LOOK_FOR = (
    "look for a division by zero, a root or logarithm of a negative number, or a part of the model that nothing ties down "
    "(a circuit without earth)"
)

SINGULAR = (
    "some combination of its flows or efforts stores nothing; two coils with all flux in common are a `TF` and one `I` on a side of it, "
    "two plates one `C` on the `1` between them"
)
SHARE = 1e-12  # relative to the larger of two values: least size for a change of sign


def check_finite(program: Program, space: StateSpace, instants: Array, values: Array, states: Array, parameters: Array) -> None:  # fmt: skip
    """Raise `RunFailed` for the first instant at which an output is not finite; shape of `values`: (points, outputs)."""
    wrong = ~np.isfinite(values)
    if not wrong.any():
        return
    point = int(np.flatnonzero(wrong.any(axis=1))[0])
    names = [n for n, bad in zip(program.outputs.names, wrong[point], strict=True) if bad]
    named = ", ".join(f"`{n}`" for n in names[:6]) + (", …" if len(names) > 6 else "")
    cause = cause_of(program, space, float(instants[point]), states[point], parameters)
    verb = "is" if len(names) == 1 else "are"
    raise RunFailed("BR748", f"at t = {instants[point]:.9g} s {named} {verb} not finite: {cause}")


def cause_of(
    program: Program, space: StateSpace, time: float, state: Array, parameters: Array, modes: Mapping[str, float] = NO_MODES
) -> str:  # fmt: skip
    """Return the line that most likely causes a value that is not finite, at a time and state; `modes`: discrete variables that only events change."""
    known = _known(program, space, time, state, parameters, modes)
    return _trouble(space, known, dict(known)) or LOOK_FOR


def cause_ahead(
    program: Program, space: StateSpace, now: tuple[float, Any], ahead: tuple[float, Any], parameters: Array, modes: Mapping[str, float]
) -> str | None:  # fmt: skip
    """Return the cause of a value that is not finite between here and a little later, or of a divisor that passes zero; None if there is none."""
    return _trouble(space, *(_known(program, space, *at, parameters, modes) for at in (now, ahead)))


def _known(
    program: Program, space: StateSpace, time: float, state: Array, parameters: Array, modes: Mapping[str, float]
) -> dict[int, float]:
    """Return the values of the variables that are not computed, by variable."""
    given = dict(zip(program.parameters.names, parameters, strict=True))
    given |= dict(zip(program.inputs.names, program.input_defaults, strict=True)) | dict(modes)
    return given_values(space, given, time, state)


def given_values(space: StateSpace, given: Mapping[str, float], time: float, state: Array) -> dict[int, float]:
    """Return the values of the variables that are not computed: time, states, unknowns, and what is `given` by name (else as in the text)."""
    numbers = [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]
    values = {v: float(x) for v, x in zip(numbers, state, strict=True)}
    for number, variable in enumerate(space.variables):
        if variable.role == "time":
            values[number] = time
        elif variable.role in ("parameter", "input", "mode", "delayed"):
            values[number] = float(given.get(variable.name, variable.value or 0.0))
    return values


def _trouble(space: StateSpace, now: dict[int, float], ahead: dict[int, float]) -> str | None:
    """Return the first computation that makes a finite value not finite ahead, or divides by a value that passes zero on the way."""
    for step in space.steps:
        if isinstance(step, Assignment):
            now[step.target], ahead[step.target] = _value(step.expression, now), _value(step.expression, ahead)
            why = reason(step.expression, now, ahead)
            if why is None and not math.isfinite(ahead[step.target]):
                why = Reason(f"has no value there; {LOOK_FOR}", None)
            if why is not None:
                if _is_of_singular_field(space, step.owner, why):
                    return f"the matrix of `{step.owner}` (line {step.span.line}) is singular{_with(space, why.about, ahead)}: {SINGULAR}"
                name = space.variables[step.target].name
                return f"`{name}`, computed at `{step.owner}` (line {step.span.line}), {why.words}{_with(space, why.about, ahead)}"
            continue
        found = _solutions(step, now, ahead)
        if found is None:
            members = ", ".join(f"`{m}`" for m in step.members[:6])
            return f"the algebraic loop through {members} has no unique solution with these numbers"
        now.update(zip(step.targets, map(float, found[0]), strict=True))
        ahead.update(zip(step.targets, map(float, found[1]), strict=True))
    return None


def _is_of_singular_field(space: StateSpace, owner: str, why: Reason) -> bool:
    """Return True if parameters alone let a storage with several ports divide by zero."""
    if why.about is None or not why.words.startswith("is divided") or not space.is_field((owner,)):
        return False
    inputs, read = space.inputs, {s.key for s in symbols(why.about)}
    while any(inputs[v] for v in read):
        read = {u for v in read for u in inputs[v] or (v,)}
    return all(space.variables[v].role == "parameter" for v in read)


def _with(space: StateSpace, about: Expression | None, known: dict[int, float]) -> str:
    """Return the values of the variables that an expression reads, as text."""
    read = [] if about is None else sorted({s.key for s in symbols(about)})
    said = ", ".join(f"`{space.variables[v].name}` = {known[v]:.6g}" for v in read[:SHOWN] if v in known)
    return f" with {said}" if said else ""


def _value(x: Expression, known: dict[int, float]) -> float:
    try:
        return evaluate(x, known.__getitem__)
    except (ArithmeticError, ValueError):
        return math.nan


def linear_loop(loop: LinearLoop, values: Mapping[int, float]) -> tuple[Any, Any]:
    """Return the matrix and the right-hand side of a linear loop."""

    def number(entry: int | float) -> float:
        return entry if isinstance(entry, float) else values[entry]

    return np.array([[number(x) for x in row] for row in loop.matrix]), np.array([number(x) for x in loop.right])


def _solutions(loop: LinearLoop, now: dict[int, float], ahead: dict[int, float]) -> tuple[Any, Any] | None:
    """Return the solution of a linear loop now and ahead; None if one does not exist, or ceases to exist in between."""
    (first, start), (last, end) = linear_loop(loop, now), linear_loop(loop, ahead)
    if not (np.isfinite(first).all() and np.isfinite(last).all()):
        return None
    signs = np.linalg.slogdet(first)[0] * np.linalg.slogdet(last)[0]
    if signs <= 0:
        return None
    found = np.linalg.solve(first, start), np.linalg.solve(last, end)
    return found if np.isfinite(found).all() else None


@dataclass(frozen=True, slots=True)
class Reason:
    """Description of the error, as the end of a sentence, and the expression that causes it."""

    words: str
    about: Expression | None


def reason(x: Expression, now: Mapping[Any, float], ahead: Mapping[Any, float]) -> Reason | None:
    """Return the innermost operation without a finite value ahead although its operands are finite, or a divisor that passes zero on the way.

    Branches that are not taken are ignored. None if there is no such operation.
    """
    return _Search(now, ahead).at(x)


class _Search:
    def __init__(self, now: Mapping[Any, float], ahead: Mapping[Any, float]) -> None:
        self.now, self.ahead = now, ahead
        self.values: dict[Expression, tuple[float, float]] = {}

    def at(self, x: Expression) -> Reason | None:
        """Return the first reason in an expression, and store its values."""
        if x in self.values:
            return None
        if isinstance(x, Number):
            self.values[x] = x.value, x.value
            return None
        if isinstance(x, Symbol):
            self.values[x] = self.now.get(x.key, math.nan), self.ahead.get(x.key, math.nan)
            return None
        assert isinstance(x, Apply)
        if x.operator == "select":
            return self._branch(x)
        for operand in x.operands:
            found = self.at(operand)
            if found is not None:
                return found
        pairs = [self.values[o] for o in x.operands]
        self.values[x] = _value_of(x.operator, [p[0] for p in pairs]), _value_of(x.operator, [p[1] for p in pairs])
        if not all(math.isfinite(p[1]) for p in pairs):
            return None
        return _wrong(x, pairs, self.values[x][1])

    def _branch(self, x: Apply) -> Reason | None:
        condition, value, otherwise = x.operands
        found = self.at(condition)
        if found is not None:
            return found
        taken = value if self.values[condition][1] else otherwise
        found = self.at(taken)
        if found is None:
            self.values[x] = self.values[taken]
        return found


def _wrong(x: Apply, pairs: list[tuple[float, float]], value: float) -> Reason | None:
    """Return the error in one operation whose operands are finite; None if there is none."""
    if x.operator == "divide":
        before, after = pairs[1]
        small = SHARE * max(abs(before), abs(after))
        if after == 0 and before == 0:
            read = "what is zero" if _reads(x.operands[1]) else "a factor of its law that is zero"
            return Reason(f"is divided by {read}", x.operands[1])
        if after == 0 or (before * after < 0 and min(abs(before), abs(after)) >= small):
            return Reason("is divided by what passes zero there", x.operands[1])
    if math.isfinite(value):
        return None
    return Reason(f"has no value there: {_words(x, [p[1] for p in pairs])}", x)


def _words(x: Apply, values: list[float]) -> str:
    match x.operator:
        case "sqrt":
            return f"the square root of {values[0]:.6g}"
        case "log" | "log10":
            return f"the logarithm of {values[0]:.6g}"
        case "asin" | "acos" | "acosh" | "atanh":
            return f"{x.operator} of {values[0]:.16g}"
        case "power" if values[0] < 0 or (values[0] == 0 and values[1] < 0):
            return f"{values[0]:.6g} to the power of {values[1]:.6g}"
        case "divide":
            return f"{values[0]:.6g} divided by {values[1]:.6g} is too large for a double"
        case "add" | "multiply":
            return "it is too large for a double"
    return f"{x.operator} of {', '.join(f'{v:.6g}' for v in values)} is too large for a double"


def _reads(x: Expression) -> bool:
    if isinstance(x, Apply):
        return any(map(_reads, x.operands))
    return isinstance(x, Symbol)


def _value_of(operator: str, values: list[float]) -> float:
    try:
        return value_of(operator, values)
    except (ArithmeticError, ValueError, OverflowError):
        return math.nan
