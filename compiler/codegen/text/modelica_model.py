"""State equations to flat Modelica: parameters, starts, equations in the order of computation, events by `when`.

Conditions of events count as false before the start, as `when` has it; a model where one is true there, at its own values, is refused. Constraints are
written as their second derivatives, whose unknowns are the multipliers: they have to hold at the start, where a run would assemble the mechanism.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite

import numpy as np
import sympy
from sympy import Basic, Symbol
from sympy.logic.boolalg import Boolean
from sympy.printing.precedence import PRECEDENCE

from ...errors import CompilationFailed, printable
from ...reduction import StateSpace
from ...source import Span
from ..errors import NumpyAlone
from ..numpy.names import Identifiers
from ..symbolic.formulate import formulate
from ..symbolic.python_text import PythonPrinter, cited, function_names, needed_lines, results_of, targets_of
from ..symbolic.state_equations import EventEquations, Line, LinearSystem, NamedSymbol, SolvedEquation, StateEquations
from .targets import TextTarget

KNOWN = frozenset((
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "abs", "sign", "min", "max",
    "floor", "ceil",
))  # fmt: skip
WORDS = frozenset("""algorithm and annotation block break class connect connector constant constrainedby der discrete each else elseif elsewhen encapsulated
    end enumeration equation expandable extends external false final flow for function if import impure in initial inner input loop model not operator or
    outer output package parameter partial protected public pure record redeclare replaceable return stream then true type when while within Real
    Integer Boolean String time pre edge change reinit sample assert terminate""".split())  # fmt: skip  # noqa: SIM905
ASSEMBLED = "Give the mechanism starts with which its constraints hold, as a run prints them, and leave out joints that others make superfluous."
# Fraction by which a constraint may be open at the start: of the largest quantity of its unit, or of 1e-3 in SI.
MET, SMALL = 1e-9, 1e-3
FACTOR = re.compile(r"([*/]?)(1|[A-Za-z]+(?:\^-?\d+)?)")  # of a unit


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the model. Raises `CompilationFailed` for what flat Modelica, or the order of its events, cannot hold."""
    equations, place = formulate(space, descriptions), space.steps[0].span
    problems = [NumpyAlone(span or place, "Modelica", what) for span, what in _obstacles(equations)]
    if equations.constraints and not problems:
        problems = [
            NumpyAlone(span or place, "Modelica", what, ASSEMBLED) for span, what in _open_constraints(equations)
        ]
    if problems:
        raise CompilationFailed(problems)
    return _ModelicaText(equations).text()


TARGET = TextTarget("modelica", ".mo", write)


def _obstacles(e: StateEquations) -> Iterator[tuple[Span | None, str]]:
    """Yield what cannot be written, each with its place."""
    if e.switches:
        yield e.switches[0].span, "Switched junctions"
    if e.delays:
        yield e.delays[0][0].span, "Delays"
    if e.initial:
        yield e.initial[0].span, "Starts of quantities that are computed from states"
    for event in e.events:
        if any(reset.target in e.reset_targets for reset in event.resets):
            yield event.span, "Events that set what is computed from states"
        if e.constraints and any(q.symbol == reset.target for q in e.states for reset in event.resets):
            yield event.span, "Events that set a state beside constraints"
        if event.sampling and any(x != 0 for x in event.sampling[2:4]):
            yield event.span, "Samples with a delay or jitter"
        if any(isinstance(line, LinearSystem) for line in needed_lines(e.lines, _read(event))):
            yield event.span, "Events that read an algebraic loop"
    writable = {name for name, own in function_names(lambda row: row.name).items() if own in KNOWN} | {"Piecewise"}
    for line in e.lines:
        for part in (p for x in results_of(line) for p in sympy.preorder_traversal(x)):
            if part.is_Function and not _is_condition(part) and type(part).__name__ not in writable:
                yield line.span, f"`{type(part).__name__}`, tables and noise"
            if part.is_number and part.is_finite is False:
                yield line.span, "Infinite numbers"
    if any(q.value is not None and not isfinite(q.value) for q in (*e.parameters, *e.inputs)):
        yield None, "Infinite numbers"
    if not e.switches and not e.delays and not all(event.sampling for event in e.events):
        yield from ((event.span, "Events whose condition holds at the start") for event in _true_at_start(e))


def _read(event: EventEquations) -> tuple[Basic, ...]:
    """Expressions of an event."""
    return event.condition, *event.sampling, *(reset.value for reset in event.resets)


class _ModelicaStart:
    """Values at the start, with those of the model."""

    def __init__(self, e: StateEquations) -> None:
        self.lines: tuple[Line, ...] = (*e.lines, *e.partials.lines)
        self.values: dict[Basic, Basic] = {
            q.symbol: sympy.Float(q.value or 0.0) for q in (*e.parameters, *e.inputs, *e.unknowns)
        } | {e.time: 0.0}
        for q, entry in [*zip(e.states, e.starts, strict=True), *zip(e.discretes, e.discrete_starts, strict=True)]:
            value = self.of(entry.value)
            self.values[q.symbol] = sympy.Float(bool(value)) if _is_condition(value) else value

    def of(self, x: Basic) -> Basic:
        """The value of an expression."""
        for line in needed_lines(self.lines, [x]):
            if isinstance(line, SolvedEquation):
                if line.target not in self.values:
                    self.values[line.target] = line.right.subs(self.values)
            elif line.targets[0] not in self.values:
                matrix, right = sympy.Matrix(line.matrix).subs(self.values), sympy.Matrix(line.right).subs(self.values)
                self.values.update(zip(line.targets, matrix.LUsolve(right), strict=True))
        return x.subs(self.values)


def _true_at_start(e: StateEquations) -> Iterator[EventEquations]:
    """Yield the events whose condition holds at the start, or may do so, with the values of the model."""
    start = _ModelicaStart(e)
    for event in e.events:
        if not event.sampling and start.of(event.condition) not in (sympy.false, 0, 0.0):
            yield event


def _open_constraints(e: StateEquations) -> Iterator[tuple[Span | None, str]]:
    """Yield a constraint that the starts do not meet, or one of those that do not decide their multipliers."""
    start, sizes = _ModelicaStart(e), dict[str, float]()
    for q in (*e.parameters, *e.states):
        sizes[q.unit] = max(sizes.get(q.unit, 0.0), abs(float(start.values[q.symbol])))
    for entry in e.constraints:
        if not abs(float(start.of(entry.value))) <= MET * (sizes.get(entry.unit) or SMALL):
            yield entry.span, f"The constraint `{entry.name}`, which a run assembles first,"
            return
    first, count = len(e.states), len(e.unknowns)
    if not count:
        return
    slopes = np.zeros((count, count))
    for (row, column), slope in e.partials.entries.items():
        if row >= first <= column:
            slopes[row - first, column - first] = float(start.of(slope))
    with np.errstate(all="ignore"):
        slopes /= np.abs(slopes).max(axis=1, keepdims=True)
        slopes /= np.abs(slopes).max(axis=0)
    if not np.isfinite(slopes).all() or np.linalg.matrix_rank(slopes, MET) < count:
        yield e.constraints[0].span, "Constraints that depend on others at the start, of which a run chooses some,"


class ModelicaPrinter(PythonPrinter):
    """Expressions of Modelica. `truths`: symbols that are Boolean; others hold a truth as 0 or 1."""

    truths: frozenset[Symbol] = frozenset()

    def number(self, x: Basic) -> str:
        """The text of a number; of a truth 1 or 0."""
        return f"if {self.text(x)} then 1 else 0" if self._is_truth(x) else self.text(x)

    def truth(self, x: Basic) -> str:
        """The text of a truth."""
        if isinstance(x, sympy.Piecewise) and tuple(value for value, _ in x.args) == (1, 0):
            return self.truth(x.args[0].cond)
        return self.text(x) if self._is_truth(x) else f"{self._print(x)} > 0.5"

    def _is_truth(self, x: Basic) -> bool:
        return x in self.truths or _is_condition(x)

    def _choice(self, x: Basic) -> str:
        (value, condition), (otherwise, _) = x.args
        return f"if {self.truth(condition)} then {self.number(value)} else {self.number(otherwise)}"

    def _print_Pow(self, x: Basic, rational: bool = False) -> str:
        if x.exp in (-1, sympy.S.Half):
            return super()._print_Pow(x, rational)
        return f"{self.parenthesize(x.base, PRECEDENCE['Pow'], strict=True)}^{self.parenthesize(x.exp, PRECEDENCE['Atom'])}"

    def _print_Relational(self, x: Basic) -> str:
        left, right = (self.parenthesize(a, PRECEDENCE["Relational"], strict=True) for a in x.args)
        if isinstance(x, sympy.Eq):  # which Modelica does not have of real numbers
            return f"({left} <= {right} and {left} >= {right})"
        return f"{left} {x.rel_op} {right}"

    def _print_And(self, x: Basic) -> str:
        return f"({' and '.join(f'({self.truth(a)})' for a in x.args)})"

    def _print_Or(self, x: Basic) -> str:
        return f"({' or '.join(f'({self.truth(a)})' for a in x.args)})"

    def _print_Not(self, x: Basic) -> str:
        return f"(not ({self.truth(x.args[0])}))"

    def _print_NumberSymbol(self, x: Basic) -> str:
        return repr(float(x))

    def _print_BooleanTrue(self, x: Basic) -> str:
        return "true"

    def _print_BooleanFalse(self, x: Basic) -> str:
        return "false"


class _ModelicaText:
    """Writer of one model."""

    def __init__(self, equations: StateEquations) -> None:
        self.equations = e = equations
        identifiers = Identifiers()
        identifiers.taken |= {*WORDS, *KNOWN}
        self.name = identifiers.of(e.name)
        entries = (*e.rates, *e.residuals, *e.outputs, *e.starts, *e.discrete_starts, *e.requirements)
        read = [
            *(entry.value for entry in entries),
            *(x for event in e.events for x in map(self._inlined, _read(event))),
        ]
        self.lines = needed_lines(e.lines, read)
        computed = [t for line in self.lines for t in targets_of(line)]
        groups = (e.parameters, e.inputs, e.states, e.unknowns, e.discretes)
        quantities = [q.symbol for group in groups for q in group]
        self.names: dict[Symbol, str] = {e.time: "time"}
        for symbol in (*quantities, *computed):
            self.names[symbol] = identifiers.of(str(symbol))
        self.outputs = [identifiers.of(f"{entry.name}_output" if entry.name in identifiers.taken else entry.name) for entry in e.outputs]  # fmt: skip
        self.truths = self._truths()
        moved = {q.symbol for group in (e.states, e.discretes) for q in group}
        self.printer = self._printer(set())
        self.before, self.just = self._printer(moved), self._printer({q.symbol for q in e.discretes})
        self.conditions = [identifiers.of(f"event_{i + 1}") for i in range(len(e.events))]

    def _inlined(self, x: Basic) -> Basic:
        """An expression of states, modes, inputs and what parameters decide: what is computed stands in its place."""
        for line in reversed(needed_lines(self.equations.lines, [x])):
            if isinstance(line, SolvedEquation) and line.target not in self.equations.constant:
                x = x.xreplace({line.target: line.right})
        return x

    def _truths(self) -> frozenset[Symbol]:
        truths: set[Symbol] = set()
        for line in self.lines:
            if isinstance(line, SolvedEquation) and (_is_condition(line.right) or line.right in truths):
                truths.add(line.target)
        return frozenset(truths)

    def _printer(self, earlier: set[Symbol]) -> ModelicaPrinter:
        """A printer that reads some symbols as they were before an event."""
        names = {s: f"pre({name})" if s in earlier else name for s, name in self.names.items()}
        functions = function_names(lambda row: row.name)
        printer = ModelicaPrinter(names, functions)
        printer.truths = self.truths
        return printer

    def text(self) -> str:
        e = self.equations
        parts = [f'model {self.name} "{_plain(e.name)}: state equations of a bond graph, in SI units"']
        parts += [self._declared("parameter Real", q, _equal(q.value)) for q in e.parameters]
        parts += [self._declared("input Real", q, _equal(q.value or 0.0)) for q in e.inputs]
        for kind, group, starts in (("Real", e.states, e.starts), ("discrete Real", e.discretes, e.discrete_starts)):
            for q, entry in zip(group, starts, strict=True):
                parts.append(self._declared(kind, q, "", f"start = {self.printer.number(entry.value)}, fixed = true"))
        parts += [self._declared("Real", q, "", f"start = {q.value or 0.0!r}") for q in e.unknowns]
        for name, entry in zip(self.outputs, e.outputs, strict=True):
            parts.append(f"  output Real {name}{_attributes(entry.unit)} {_comment(entry.name, entry.unit)};")
        parts += ["protected"] if self.lines or e.events else []
        for line in self.lines:
            kind = "Boolean" if targets_of(line)[0] in self.truths else "Real"
            if isinstance(line, SolvedEquation) and line.target in e.constant:
                parts.append(f"  final parameter {kind} {self._line(line)}")
            else:
                parts += [f"  {kind} {self.names[t]};" for t in targets_of(line)]
        parts += [f"  Boolean {name};" for name in self.conditions]
        return "\n".join([*parts, *self._equations(), *self._events(), f"end {self.name};"]) + "\n"

    def _declared(self, kind: str, q: NamedSymbol, value: str, more: str = "") -> str:
        return f"  {kind} {self.names[q.symbol]}{_attributes(q.unit, more)}{value} {_comment(q.name, q.unit, q.description)};"

    def _line(self, line: SolvedEquation) -> str:
        """An equation, with the author's line."""
        place = cited(line.span, line.owner)
        text = self.printer.truth(line.right) if line.target in self.truths else self.printer.number(line.right)
        return f"{self.names[line.target]} = {text};{f'  // {place}' if place else ''}"

    def _equations(self) -> Iterator[str]:
        e = self.equations
        yield "equation"
        for q, rate in zip(e.states, e.rates, strict=True):
            yield f"  der({self.names[q.symbol]}) = {self.printer.number(rate.value)};"
        for line in self.lines:
            if isinstance(line, LinearSystem):
                for row, right in zip(line.matrix, line.right, strict=True):
                    terms = sympy.Add(*(sympy.Mul(a, x, evaluate=False) for a, x in zip(row, line.targets, strict=True)), evaluate=False)  # fmt: skip
                    yield f"  {self.printer.text(terms)} = {self.printer.text(right)};  // {cited(line.span, line.owner)}"
            elif line.target not in e.constant:
                yield f"  {self._line(line)}"
        yield from (f"  0 = {self.printer.number(entry.value)};" for entry in e.residuals)
        for name, entry in zip(self.outputs, e.outputs, strict=True):
            yield f"  {name} = {self.printer.number(entry.value)};"
        for entry in e.requirements:
            yield f'  assert({self.printer.truth(entry.value)}, "{_plain(entry.name)}", AssertionLevel.warning);'

    def _events(self) -> Iterator[str]:
        """Yield the conditions, and what each state or discrete variable is set to: from the values before, as the conditions read modes."""
        e = self.equations
        for name, event in zip(self.conditions, e.events, strict=True):
            period, offset = event.sampling[:2] if event.sampling else (None, None)
            if period is None:
                words = self.just.truth(self._inlined(event.condition))
            else:
                words = f"sample({self.printer.number(offset)}, {self.printer.number(period)})"
            yield f"  {name} = {words};  // {printable(event.words)}"
        if e.constraints:
            yield "  // Constraints hold at the start, with these starts; later as far as a solver keeps their second derivatives zero."
        if e.events:
            yield "  // Conditions count as false before the start; with other parameters one may hold there."
        discretes = {q.symbol for q in e.discretes}
        settings: dict[Symbol, list[tuple[str, Basic]]] = {}
        for name, event in zip(self.conditions, e.events, strict=True):
            for reset in event.resets:
                settings.setdefault(reset.target, []).append((name, self._inlined(reset.value)))
        for target, values in settings.items():
            for number, (name, value) in enumerate(values):
                text = self.before.number(value)
                yield f"  {'elsewhen' if number else 'when'} {name} then"
                name = self.names[target]
                yield f"    {name} = {text};" if target in discretes else f"    reinit({name}, {text});"
            yield "  end when;"
        # Modes that no event sets keep their start.
        for q in e.discretes:
            if q.symbol not in settings:
                yield f"  {self.names[q.symbol]} = pre({self.names[q.symbol]});"


def _is_condition(x: Basic) -> bool:
    return isinstance(x, Boolean) and not x.is_Symbol


def _equal(value: float | None) -> str:
    return "" if value is None else f" = {float(value)!r}"


def _attributes(unit: str, more: str = "") -> str:
    attributes = [f'unit = "{_unit(unit)}"'] if _unit(unit) else []
    attributes += [more] if more else []
    return f"({', '.join(attributes)})" if attributes else ""


def _unit(unit: str) -> str:
    """A unit as Modelica writes it, with one quotient at most; "" for one that it cannot write."""
    factors = FACTOR.findall(unit)
    if "".join(sign + factor for sign, factor in factors) != unit:
        return ""
    above, below = (
        ".".join(f.replace("^", "") for sign, f in factors if (sign == "/") == under) for under in (False, True)
    )
    return above + (f"/({below})" if "." in below else f"/{below}" if below else "")


def _comment(name: str, unit: str, description: str = "") -> str:
    words: Sequence[str] = (name, "" if _unit(unit) else unit, description)
    return f'"{_plain(", ".join(w for w in words if w))}"'


def _plain(text: str) -> str:
    return printable(text).replace("\\", "\\\\").replace('"', '\\"')
