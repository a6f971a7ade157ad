"""Expressions to C: one function without branches for each function of a program, over arrays of the caller.

Every function is `void NAME_derivative(double time, state, inputs, constants, mode, out)`. Nothing is allocated, nothing is global.
The code needs a compiler for C11 and its mathematical library.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence, Set
from typing import Any

from ...algebra.expression import Apply, Expression, Number, Symbol
from ...algebra.interpolate import SMOOTH_STEP, random_number
from ...algebra.operators import CONDITIONS, OPERATORS
from ...algebra.systems import LEADING, SYSTEMS, shape_of
from ...algebra.table import lists, order_of
from ...errors import printable
from ...jit.c_source import c_number, c_source, small_functions
from ..description import name_tables
from ..functions import ProgramFunction
from ..limits import Leaf
from ..llvm import runtime
from ..loop_rolling import OrderedFunction, Place, ordered
from ..lowered import Lowered
from ..numpy.write import Writer
from ..order import operations_in_order
from ..structure import more_of
from .kernels import GIVEN, CKernels
from .stepping import obstacle, stepping

ARGUMENTS = (
    "double time, const double *state, const double *inputs, const double *constants, const double *mode, double *out"
)
_OWN = """static inline double chosen(int condition, double value, double otherwise) { return condition ? value : otherwise; }
static inline double lesser(double a, double b) { return a <= b || a != a ? a : b; }
static inline double greatest(double a, double b) { return a >= b || a != a ? a : b; }
static inline double sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : x == 0 ? 0.0 : x; }
"""
_WORDS = {"double": "float", "<math.h>": "<tgmath.h>"}
# A number below the second would be zero: what guards a divisor becomes the smallest normal one.
SMALLEST, VANISHING = "1.17549435e-38", 1.4e-45
# texts and comments stay; then the words and numbers that change
_TOKENS = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/|\bdouble\b|<math\.h>|(?<![\w.])(?:\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])',
    re.DOTALL,
)


def write_c(lowered: Lowered, jumps: Sequence[str] = ()) -> str:
    """Return the text of a file, with a loop over fixed steps unless the model has something for which that has no method.

    `jumps`: places of conditions on states that are no items of the mode, for a comment.
    """
    return _File(lowered, (), jumps).text()


def write_library_c(
    lowered: Lowered, beside: Sequence[Callable[..., Any]] = (), left_out: Set[Callable[..., Any]] = frozenset()
) -> tuple[str, str]:
    """Return the text of a file with the functions of a library, and the prefix of its names. `beside`: functions of the subset that are in it, too."""
    file = _File(lowered, more_of(lowered), (), beside, left_out)
    return file.text(), file.prefix


class _File:
    """Writer of the file."""

    def __init__(
        self, lowered: Lowered, more: Sequence[tuple[ProgramFunction, Sequence[Expression]]], jumps: Sequence[str] = (),
        beside: Sequence[Callable[..., Any]] = (), left_out: Set[Callable[..., Any]] = frozenset(),
    ) -> None:  # fmt: skip
        self.lowered, self.writer, self.jumps = lowered, Writer(lowered, more), jumps
        self.prefix = re.sub(r"\W", "_", lowered.space.name, flags=re.ASCII)
        self.beside, self.left_out = beside, left_out
        self.called: set[str] = set()
        self.arrays: dict[tuple[float, ...], str] = {}
        self.steps = not more and obstacle(lowered) is None

    def text(self) -> str:
        """The whole text."""
        constants = self.writer.constants
        parameters = range(len(self.lowered.parameters))
        leaves: dict[Expression, Place] = {Symbol(Leaf("parameter", i)): ("constants", i) for i in parameters}
        known: dict[Expression, Place] = {node: ("constants", i) for i, node in enumerate(constants)}
        space = self.lowered.space
        known |= {Symbol(Leaf("state", i)): ("state", i) for i in range(len(space.states) + len(space.unknowns))}
        known |= {Symbol(Leaf("input", i)): ("inputs", i) for i in range(len(self.lowered.inputs))}
        known |= {Symbol(Leaf("mode", i)): ("mode", i) for i in range(self.lowered.events.size)}
        notes = {"constants": "All that depends on parameters alone; `constants` are the parameters."}
        written = [ordered("constants", constants, leaves)]
        for row, roots in self.writer.functions:
            notes[row.name] = row.description(self.lowered)
            written.append(ordered(row.name, roots, known))
        kernels = CKernels.of(self.lowered, written)
        functions = [] if kernels is None else kernels.kernels(self._computed)
        functions += [self._function(f, notes[f.name], kernels) for f in written]
        counts = [(f.name, len(f.roots)) for f in written]
        support = [runtime.BY_OPERATOR[o] for o in sorted(self.called)]
        support += [random_number] if self.steps else []
        support_text = c_source([*dict.fromkeys([*support, *self.beside])], self.left_out, inner=True)
        points = [f"static const double {n}[] = {{{', '.join(map(c_number, v))}}};" for v, n in self.arrays.items()]
        steps = [stepping(self.lowered, self.prefix)] if self.steps else []
        text = "\n".join([support_text, *points, "", *functions, *steps])
        return "\n".join([self._head(counts), small_functions(text, _OWN), text])

    def _head(self, counts: Sequence[tuple[str, int]]) -> str:
        name = self.prefix
        sizes = "".join(f"    {name}_{word}_count = {count},\n" for word, count in counts)
        tables = []
        for heading, rows in name_tables(self.lowered):
            items = "".join(f"    {{{c_string(n)}, {c_string(u)}}},\n" for n, u in rows)
            tables.append(
                f"const char *const {name}_{heading.lower()}[][2] = {{ /* name, SI unit */\n{items}    {{0, 0}}\n}};\n"
            )
        values = [self.lowered.space.variables[v].value or 0.0 for v in self.lowered.parameters]
        inputs = [self.lowered.space.variables[v].value or 0.0 for v in self.lowered.inputs]
        places = sorted(self.lowered.jacobian)
        lists = (
            ("double", "defaults", [*map(c_number, values), "0"]),
            ("double", "input_defaults", [*map(c_number, inputs), "0"]),
            ("int", "rows", [*(str(p[0]) for p in places), "-1"]),
            ("int", "columns", [*(str(p[1]) for p in places), "-1"]),
        )
        data = [f"const {kind} {name}_{word}[] = {{{', '.join(items)}}};" for kind, word, items in lists]
        jumps = ""
        if self.jumps:
            jumps = f"\n   Rates jump or bend where a condition on states changes; a step must end there: {_comment(', '.join(self.jumps))}."
        comment = (
            f"/* {_comment(self.lowered.space.name)}: generated from a bond graph; C11, no dependencies. All quantities are in SI.\n\n"
            f"   {name}_constants(0, 0, 0, {name}_defaults, 0, c); {name}_start(0, 0, 0, c, 0, x); {name}_switches(t, 0, 0, c, 0, mode);\n"
            f"   {name}_derivative(t, x, {name}_input_defaults, c, mode, rates). The entries of the Jacobian lie at {name}_rows,\n"
            f"   {name}_columns. How many values a function writes is NAME_count. Compile without contraction of operations\n"
            f"   (-ffp-contract=off) to get the numbers of other targets.{jumps} */\n"
        )
        headers = "#include <math.h>\n#include <stdint.h>\n#include <stdlib.h>\n"
        return "\n".join([comment, headers, f"enum {{\n{sizes}}};\n", *tables, *data, ""])

    def array(self, values: tuple[float, ...]) -> str:
        """The name of a list of numbers."""
        return self.arrays.setdefault(values, f"points_{len(self.arrays) + 1}")

    def _computed(self, expression: Expression, names: dict[Expression, str], count: int) -> list[str]:
        return _Body(self, names).compute(expression, count)

    def _function(self, function: OrderedFunction, note: str, kernels: CKernels | None) -> str:
        written_as = {node: f"{array}[{place}]" for node, (array, place) in function.known.items()}
        written_as[Symbol(Leaf("time", 0))] = "time"
        lines = kernels.body(function.name) if kernels is not None else _Body(self, written_as).write(function)
        unused = "".join(f" (void){a};" for a in GIVEN)
        head = f"/* {_comment(note)} */\nvoid {self.prefix}_{function.name}({ARGUMENTS})\n{{\n   {unused}"
        return "\n".join([head, *(f"    {line}" for line in lines), "}\n"])


class _Body:
    """The lines of one function."""

    def __init__(self, file: _File, known: dict[Expression, str]) -> None:
        self.file, self.known = file, known
        self.names: dict[Expression, str] = {}
        self.lines: list[str] = []
        self.count = 0
        self.slopes: dict[tuple[str, tuple[Expression, ...]], str] = {}

    def write(self, function: OrderedFunction) -> list[str]:
        """Write the operations behind the roots, then the roots into `out`."""
        self._operations(function.order)
        self.lines += [f"out[{place}] = {self._double(root)};" for place, root in enumerate(function.roots)]
        return self.lines

    def compute(self, expression: Expression, count: int) -> list[str]:
        """Write one value, or those of a linear system, to `target`."""
        self._operations(operations_in_order([expression], {}))
        if isinstance(expression, Apply) and expression.operator in SYSTEMS:
            return [*self.lines, f"for (int i = 0; i < {count}; i++) target[i] = {self.names[expression]}[i];"]
        return [*self.lines, f"*target = {self._double(expression)};"]

    def _operations(self, order: Sequence[Apply]) -> None:
        for node in order:
            text = self._operation(node)
            if node.operator in SYSTEMS:
                self.names[node] = text
                continue
            kind = "int" if node.operator in CONDITIONS else "double"
            self.count += 1
            self.names[node] = f"t{self.count}"
            self.lines.append(f"const {kind} t{self.count} = {text};")

    def _double(self, node: Expression) -> str:
        cast = "(double)" if isinstance(node, Apply) and node.operator in CONDITIONS else ""
        return f"{cast}{self._name(node)}"

    def _name(self, node: Expression) -> str:
        if isinstance(node, Number):
            return c_number(node.value)
        return self.names.get(node) or self.known[node]

    def _truth(self, node: Expression) -> str:
        """The name of a condition, or a number as one."""
        name = self._name(node)
        return name if isinstance(node, Apply) and node.operator in CONDITIONS else f"({name} != 0)"

    def _all(self, nodes: Sequence[Expression]) -> list[str]:
        return [self._name(n) for n in nodes]

    def _room(self, count: int) -> str:
        self.count += 1
        self.lines.append(f"double room{self.count}[{max(1, count)}];")
        return f"room{self.count}"

    def _points(self, nodes: Sequence[Expression]) -> str:
        numbers = tuple(x.value for x in nodes if isinstance(x, Number))
        if len(numbers) == len(nodes):
            return self.file.array(numbers)
        place = self._room(len(nodes))
        self.lines += [f"{place}[{i}] = {value};" for i, value in enumerate(self._all(nodes))]
        return place

    def _operation(self, node: Apply) -> str:
        operator, operands = node.operator, node.operands
        if operator in runtime.BY_OPERATOR:
            self.file.called.add(operator)
            return self._supported(node)
        match operator:
            case "add":
                return " + ".join(self._all(operands))
            case "multiply" if operands[0] == Number(-1.0):
                return "-" + " * ".join(self._all(operands[1:]))
            case "multiply":
                return " * ".join(self._all(operands))
            case "divide":
                return " / ".join(self._all(operands))
            case "power":
                return self._power(*operands)
            case "select":
                return f"chosen({', '.join([self._truth(operands[0]), *self._all(operands[1:])])})"
            case "not":
                return f"!{self._truth(operands[0])}"
            case "item":
                index = operands[1]
                assert isinstance(index, Number)
                return f"{self._name(operands[0])}[{int(index.value)}]"
        name = OPERATORS[operator].in_c
        if operator in CONDITIONS:
            return f" {name} ".join(map(self._truth, operands) if operator in ("and", "or") else self._all(operands))
        return f"{name}({', '.join(self._all(operands))})"

    def _power(self, base: Expression, exponent: Expression) -> str:
        x = self._name(base)
        if isinstance(exponent, Number) and exponent.value in (2.0, 3.0):
            return " * ".join([x] * int(exponent.value))
        return f"pow({x}, {self._name(exponent)})"

    def _supported(self, node: Apply) -> str:
        operands = node.operands
        match node.operator:
            case "solve" | "banded":
                shape = (*shape_of(node), int(node.operator == "banded"))
                entries = self._points(operands[LEADING:] if node.operator == "banded" else operands)
                out, work = self._room(shape[0]), self._room(runtime.room(*shape))
                self.lines.append(f"solve({', '.join(map(str, shape))}, {entries}, {work}, {out});")
                return out
            case "natural_slope" | "monotone_slope":
                return self._slope(node)
            case "noise":
                steps = tuple(map(float, SMOOTH_STEP[order_of(node)]))
                return f"noise({order_of(node)}, {', '.join(self._all(operands[1:]))}, {self.file.array(steps)}, {len(steps)})"
            case "root":
                return f"root({', '.join(self._all(operands))})"
        points = lists(node)
        arrays = ", ".join(map(self._points, points))
        name = runtime.BY_OPERATOR[node.operator].__name__
        return f"{name}({order_of(node)}, {self._name(operands[1])}, {arrays}, {len(points[0])})"

    def _slope(self, node: Apply) -> str:
        number, points = node.operands[0], node.operands[1:]
        assert isinstance(number, Number)
        key = (node.operator, points)
        if key not in self.slopes:
            n = len(points) // 2
            places, values = self._points(points[:n]), self._points(points[n:])
            self.slopes[key], work = self._room(n), self._room(n)
            self.lines.append(f"{node.operator}({n}, {places}, {values}, {work}, {self.slopes[key]});")
        return f"{self.slopes[key]}[{int(number.value)}]"


def c_string(text: str) -> str:
    """A string literal in UTF-8. Bytes that C or a terminal would interpret are written as octal numbers."""
    plain = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode("utf-8"))
    return f'"{plain}"'


def _comment(text: str) -> str:
    """A text that cannot end the comment around it."""
    return printable(text).replace("*/", "* /").replace("/*", "/ *")


def in_single_precision(text: str) -> str:
    """Return the same file for single precision. Functions of <tgmath.h> are those of their arguments."""
    return _TOKENS.sub(_changed, text)


def _changed(match: re.Match[str]) -> str:
    word = match[0]
    if word[0] in '"/':
        return word
    if word in _WORDS:
        return _WORDS[word]
    return f"{SMALLEST if 0 < float(word) < VANISHING else word}f"
