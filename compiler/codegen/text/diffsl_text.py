"""State equations to DiffSL, the language of diffsol's solvers.

Each state has a scale, a line that another program may change, as a solver there has one absolute tolerance for all. DiffSL has no conditions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import sympy
from sympy import Basic, Symbol
from sympy.printing.precedence import PRECEDENCE

from ...errors import CompilationFailed, printable
from ...reduction import StateSpace
from ..errors import NumpyAlone
from ..symbolic.formulate import formulate
from ..symbolic.python_text import PythonPrinter, cited, function_names, needed_lines, results_of, targets_of
from ..symbolic.state_equations import Entry, Line, LinearSystem, NamedSymbol, StateEquations
from .c_file import refuse_hybrid
from .targets import TextTarget

KNOWN = frozenset({"sin", "cos", "exp", "log", "log10", "sqrt", "sinh", "cosh", "tanh", "abs", "min", "max"})
OTHERS = {"asinh": "arcsinh", "acosh": "arccosh"}
MOST_FACTORS = 8  # of a power that is written as a product


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the equations. Raises `CompilationFailed` for events, delays, algebraic loops, conditions, tables and other functions."""
    refuse_hybrid(space, "DiffSL")
    return _DiffslText(formulate(space, descriptions)).text()


TARGET = TextTarget("diffsl", ".diffsl", write)


class DiffslPrinter(PythonPrinter):
    """Expressions of DiffSL, which has no operator for powers."""

    def _print_Integer(self, x: Basic) -> str:
        return f"{int(x)}.0"

    def _print_Rational(self, x: Basic) -> str:
        return f"({int(x.p)}.0/{int(x.q)}.0)"

    def _print_Pow(self, x: Basic, rational: bool = False) -> str:
        base, exponent = x.args
        if exponent == sympy.S.Half:
            return self._called("sqrt", [base])
        count = abs(int(exponent)) if exponent.is_number and float(exponent).is_integer() else 0
        if not 0 < count <= MOST_FACTORS:
            return f"pow({self.text(base)}, {self.text(exponent)})"
        product = "*".join([self.parenthesize(base, PRECEDENCE["Mul"], strict=True)] * count)
        return f"({product})" if exponent > 0 else f"(1.0/({product}))"


class _DiffslText:
    """Writer of one text."""

    def __init__(self, equations: StateEquations) -> None:
        self.equations = e = equations
        self.settable = settable = [*e.parameters, *e.inputs]
        names: dict[Symbol, str] = {e.time: "t"}
        names |= {q.symbol: f"p{i}" for i, q in enumerate(settable)} | {
            q.symbol: f"x{i}" for i, q in enumerate(e.states)
        }
        targets = [symbol for line in e.lines for symbol in targets_of(line)]
        names |= {symbol: f"v{i}" for i, symbol in enumerate(targets)}
        functions = dict.fromkeys(function_names(lambda row: row.name), "")
        functions |= function_names(lambda row: OTHERS.get(row.name, row.name if row.name in KNOWN else ""))
        self.names, self.functions = names, functions
        self.printer = DiffslPrinter(names, functions)

    def text(self) -> str:
        e = self.equations
        self._refuse()
        scales = [f"scale{i}" for i in range(len(e.states))]
        starts = [(entry, f"({self.printer.text(entry.value)})/{s}") for entry, s in zip(e.starts, scales, strict=True)]
        rates = [(entry, f"({self.printer.text(entry.value)})/{s}") for entry, s in zip(e.rates, scales, strict=True)]
        before = needed_lines(e.lines, (entry.value for entry in e.starts))
        during = [
            line
            for line in needed_lines(e.lines, [entry.value for entry in (*e.rates, *e.outputs)])
            if line not in before
        ]
        return "\n".join([
            f"// {printable(e.name)}: state equations of a bond graph, in SI units",
            *self._inputs(),
            *(f"{s} {{ 1.0 }}  // of {_words(q)}" for s, q in zip(scales, e.states, strict=True)),
            *self._lines(before),
            *_vector("u_i", [f"z{i} = {text}" for i, (_, text) in enumerate(starts)]),
            *(f"x{i} {{ z{i}*{s} }}  // {_words(q)}" for i, (s, q) in enumerate(zip(scales, e.states, strict=True))),
            *self._lines(during),
            *_vector("F_i", [text for _, text in rates]),
            *_vector("out_i", [self.printer.text(entry.value) for entry in e.outputs], [entry.name for entry in e.outputs]),
        ]) + "\n"  # fmt: skip

    def _refuse(self) -> None:
        """Raise `CompilationFailed` for what the language does not have."""
        e = self.equations
        if e.unknowns or not e.states or any(isinstance(line, LinearSystem) for line in e.lines):
            place = next((line.span for line in e.lines if line.span is not None), None)
            place = place or next(
                entry.span for entry in (*e.residuals, *e.rates, *e.outputs) if entry.span is not None
            )
            raise CompilationFailed([NumpyAlone(place, "DiffSL", "Algebraic loops, and models without states")])
        for line in (*e.lines, *e.rates, *e.outputs):
            values = (line.value,) if isinstance(line, Entry) else results_of(line)
            if line.span is not None and not all(map(self._has, values)):
                what = f"Conditions, tables, noise and functions other than {', '.join(sorted(KNOWN))}"
                raise CompilationFailed([NumpyAlone(line.span, "DiffSL", what)])

    def _has(self, value: Basic) -> bool:
        """Return True if all functions of an expression can be written."""
        for part in sympy.preorder_traversal(value):
            if isinstance(part, sympy.Piecewise | sympy.core.relational.Relational):
                return False
            if part.is_Function and not self.functions.get(type(part).__name__, ""):
                return False
        return True

    def _inputs(self) -> list[str]:
        """Return the lines of the parameters and inputs, with their default values."""
        defaults = [f"p{i} = {float(q.value or 0.0)!r}" for i, q in enumerate(self.settable)]
        return _vector("in_i", defaults, list(map(_words, self.settable)))

    def _lines(self, lines: Iterable[Line]) -> Iterator[str]:
        for line in lines:
            assert not isinstance(line, LinearSystem)
            place = cited(line.span, line.owner)
            yield f"{self.names[line.target]} {{ {self.printer.text(line.right)} }}" + (
                f"  // {place}" if place else ""
            )


def _vector(name: str, entries: Sequence[str], words: Sequence[str] = ()) -> list[str]:
    """Return a vector, an entry a line."""
    if not entries:
        return []
    comments = [f"  // {printable(w)}" for w in words] or [""] * len(entries)
    return [f"{name} {{", *(f"  {entry},{comment}" for entry, comment in zip(entries, comments, strict=True)), "}"]


def _words(q: NamedSymbol) -> str:
    return printable(", ".join(word for word in (q.name, q.unit, q.description) if word))
