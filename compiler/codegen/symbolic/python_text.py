"""Sympy to Python: expressions and the lines of a function, with the author's line beside each."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import sympy
from sympy import Basic, Symbol
from sympy.printing.precedence import PRECEDENCE, precedence
from sympy.printing.str import StrPrinter

from ...algebra.operators import OPERATORS, SLOPES, Operator
from ...algebra.sympy_form import sympy_name
from ...errors import printable
from ...source import Span
from .state_equations import Line, LinearSystem, SolvedEquation

WIDTH = 110  # characters of a line of code; a comment may stand beyond
LONGEST_LAW = 70  # characters of the author's line in a comment


def function_names(text: Callable[[Operator], str]) -> dict[str, str]:
    """Names of functions by their names in sympy, from rows of the table of operators."""
    return {sympy_name(row.name): text(row) for row in OPERATORS.values()}


class PythonPrinter(StrPrinter):  # type: ignore[misc]  # sympy has no types
    """Expressions as Python text. `names` are those of symbols, `functions` those of sympy's functions by name."""

    def __init__(self, names: Mapping[Symbol, str], functions: Mapping[str, str]) -> None:
        super().__init__({"order": "none"})
        self.names, self.functions = names, functions
        self.called: set[str] = set()
        self.tables: dict[str, str] = {}  # text of a table of numbers -> its name

    def text(self, x: Basic) -> str:
        """The text of a whole expression, which needs no brackets around it."""
        return self._choice(x) if isinstance(x, sympy.Piecewise) else str(self.doprint(x))

    def _print_Symbol(self, x: Basic) -> str:
        return self.names[x]

    def _print_Float(self, x: Basic) -> str:
        return repr(float(x))

    def _print_Infinity(self, x: Basic) -> str:
        return "float('inf')"

    def _print_NegativeInfinity(self, x: Basic) -> str:
        return "-float('inf')"

    def _print_NaN(self, x: Basic) -> str:
        return "float('nan')"

    def _print_Add(self, x: Basic, order: str | None = None) -> str:
        parts = [self.parenthesize(term, PRECEDENCE["Add"]) for term in x.args]
        first = next((i for i, part in enumerate(parts) if not part.startswith("-")), 0)
        text = ""
        for part in (parts.pop(first), *parts):
            text += part if not text else f" - {part[1:]}" if part.startswith("-") else f" + {part}"
        return text

    def _print_Mul(self, x: Basic) -> str:
        first, *rest = x.args
        sign = "-" if first.is_Number and first.is_negative else ""
        above: list[Basic] = []
        below: list[Basic] = []
        for factor in (first if not sign else -first, *rest):
            if factor == 1:
                continue
            if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
                below.append(factor.base if factor.exp == -1 else sympy.Pow(factor.base, -factor.exp, evaluate=False))
            else:
                above.append(factor)
        top = "*".join(self.parenthesize(f, PRECEDENCE["Mul"]) for f in above) or "1"
        if not below:
            return sign + top
        bottom = "*".join(self.parenthesize(f, PRECEDENCE["Mul"], strict=len(below) == 1) for f in below)
        return f"{sign}{top}/{bottom}" if len(below) == 1 else f"{sign}{top}/({bottom})"

    def _print_Pow(self, x: Basic, rational: bool = False) -> str:
        if x.exp == -1:
            return f"1/{self.parenthesize(x.base, PRECEDENCE['Mul'], strict=True)}"
        if x.exp == sympy.S.Half:
            return self._called("sqrt", [x.base])
        return f"{self.parenthesize(x.base, PRECEDENCE['Pow'], strict=True)}**{self.parenthesize(x.exp, PRECEDENCE['Pow'])}"

    def parenthesize(self, item: Basic, level: int, strict: bool = False) -> str:
        """The text of an operand, in brackets where the operator around it binds more strongly."""
        text = self._print(item)
        own = precedence(item)
        if item.is_Pow and item.exp == -1:
            own = PRECEDENCE["Mul"]
        elif item.is_Pow and item.exp == sympy.S.Half:
            own = PRECEDENCE["Atom"]
        return f"({text})" if own < level or (strict and own <= level) else text

    def _print_Function(self, x: Basic) -> str:
        name = type(x).__name__
        if name in SLOPES:
            return f"{self._called(name, x.args[1:])}[{x.args[0]}]"
        return self._called(name, x.args)

    def _print_Tuple(self, points: Basic) -> str:
        """A list of a table; numbers are a tuple of the module."""
        text = f"({', '.join(map(self.text, points))},)"
        return text if points.free_symbols else self.tables.setdefault(text, f"TABLE_{len(self.tables) + 1}")

    _print_Abs = _print_LatticeOp = _print_Function

    def _called(self, name: str, arguments: Sequence[Basic]) -> str:
        self.called.add(name)
        return f"{self.functions[name]}({', '.join(map(self.text, arguments))})"

    def _choice(self, x: Basic) -> str:
        (value, condition), (otherwise, _) = x.args
        return f"{self._print(value)} if {self.text(condition)} else {self.text(otherwise)}"

    def _print_Piecewise(self, x: Basic) -> str:
        return f"({self._choice(x)})"

    def _print_Relational(self, x: Basic) -> str:
        left, right = (self.parenthesize(a, PRECEDENCE["Relational"], strict=True) for a in x.args)
        return f"{left} {'==' if isinstance(x, sympy.Eq) else x.rel_op} {right}"

    def _print_And(self, x: Basic) -> str:
        return " and ".join(self.parenthesize(a, PRECEDENCE["And"]) for a in x.args)

    def _print_Or(self, x: Basic) -> str:
        return " or ".join(self.parenthesize(a, PRECEDENCE["Or"]) for a in x.args)

    def _print_Not(self, x: Basic) -> str:
        return f"not ({self._print(x.args[0])})"


def needed_lines(lines: Sequence[Line], results: Iterable[Basic]) -> list[Line]:
    """Lines that some results need, in their order."""
    wanted = {symbol for x in results for symbol in x.free_symbols}
    found: list[Line] = []
    for line in reversed(lines):
        if not wanted.isdisjoint(targets_of(line)):
            found.append(line)
            wanted |= read_by(line)
    return found[::-1]


def targets_of(line: Line) -> tuple[Symbol, ...]:
    """Symbols that a line computes."""
    return (line.target,) if isinstance(line, SolvedEquation) else line.targets


def results_of(line: Line) -> tuple[Basic, ...]:
    """Expressions on the right side of a line."""
    return (
        (line.right,) if isinstance(line, SolvedEquation) else (*(x for row in line.matrix for x in row), *line.right)
    )


def read_by(line: Line) -> set[Symbol]:
    """Symbols that a line reads."""
    return {symbol for x in results_of(line) for symbol in x.free_symbols}


def lines_text(lines: Iterable[Line], printer: PythonPrinter, solve: str) -> list[str]:
    """The text of lines. `solve` is the function for linear systems. Of lines with one cause the first cites it."""
    text: list[str] = []
    before = ""
    for line in lines:
        place = cited(line.span, line.owner)
        text += _line_text(line, printer, solve, "" if place == before else place)
        before = place
    return text


def _line_text(line: Line, printer: PythonPrinter, solve: str, place: str) -> list[str]:
    if isinstance(line, LinearSystem):
        rows = [text for row in line.matrix for text in filled(f"[{', '.join(map(printer.text, row))}],")]
        *names, last = filled(", ".join(printer.names[t] for t in line.targets))
        right = [f"    {text}" for text in filled(", ".join(map(printer.text, line.right)))]
        start = [f"{last.lstrip()} = {solve}(["] if not names else ["(", *names, last, f") = {solve}(["]
        end = ["    ], [", *right, "    ])"] if len(right) > 1 or names else [f"], [{right[0].lstrip()}])"]
        return [*([f"# {place}"] if place else []), *start, *rows, *end]
    return assigned(printer.names[line.target], printer.text(line.right), place)


def assigned(name: str, text: str, comment: str = "") -> list[str]:
    """An assignment, with a comment beside it, or above it where both are too long for a line."""
    code = f"{name} = {text}"
    if len(code) > WIDTH:
        return [*([f"# {comment}"] if comment else []), f"{name} = (", *filled(text), ")"]
    if not comment:
        return [code]
    return [f"{code}  # {comment}"] if len(code) + len(comment) <= WIDTH else [f"# {comment}", code]


def filled(text: str) -> list[str]:
    """A text inside brackets, broken at spaces."""
    lines = [""]
    for word in text.split(" "):
        if lines[-1] and len(lines[-1]) + len(word) > WIDTH - 8:
            lines.append("")
        lines[-1] += f" {word}" if lines[-1] else word
    return [f"    {line}" for line in lines]


def cited(span: Span | None, owner: str) -> str:
    """File, line, and the author's law; else its owner."""
    if span is None:
        return ""
    law = re.sub(r'\s*\{.*|\s*#.*|\s*"[^"]*"\s*$', "", span.source.line(span.line).strip())
    law = " ".join(law.split())
    owner = owner if len(owner) <= LONGEST_LAW else f"{owner[:LONGEST_LAW]}…"
    if not law or len(law) > LONGEST_LAW or owner.split(".")[-1].split("[")[0] not in law:
        law = owner
    return printable(f"{span.file_and_line}  {law}".rstrip())
