"""Expressions to LLVM IR: the lines of one function, without branches, over arrays of the caller.

Operations have the same order as in the numpy target, so both agree except for the last bits of powers and of library functions.
The IR is written as text directly: it is the largest part of a model's compilation time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

from ...algebra.expression import Apply, Expression, Number, Symbol
from ...algebra.interpolate import SMOOTH_STEP
from ...algebra.operators import CONDITIONS, OPERATORS
from ...algebra.systems import LEADING, SYSTEMS, shape_of
from ...algebra.table import lists, order_of
from ...fast_dataclass import dataclass
from ...jit.values import float_text
from ..limits import Leaf
from ..order import operations_in_order
from . import runtime

ARGUMENTS = ("state", "inputs", "constants", "mode")
HEAD = "(double %time, {arrays}, ptr noalias nocapture %out) {{\nentry:".format(
    arrays=", ".join(f"ptr noalias nocapture readonly %{a}" for a in ARGUMENTS)
)
LARGEST_PRODUCT = 32  # power that is written as products


@dataclass(slots=True)
class LlvmNeeds:
    """Parts of a module that its functions need: operators with support, functions of the library, lists of numbers."""

    called: set[str] = field(default_factory=set)
    declared: set[str] = field(default_factory=set)
    arrays: dict[tuple[float, ...], str] = field(default_factory=dict)

    def array(self, values: tuple[float, ...]) -> str:
        """Name of a list of numbers, which is written once per module."""
        return self.arrays.setdefault(values, f"@points.{len(self.arrays) + 1}")


class LlvmLines:
    """Lines of one function. Values are doubles, except conditions, which are `i1`."""

    def __init__(self, needs: LlvmNeeds, known: Mapping[Expression, tuple[str, int]]) -> None:
        self.needs, self.known = needs, known
        self.names: dict[Expression, str] = {Symbol(Leaf("time", 0)): "%time"}
        self.truths: set[str] = set()  # names that are no doubles
        self.lines: list[str] = []
        self.opening: list[str] = []
        self.count = 0
        self.slopes: dict[tuple[str, tuple[Expression, ...]], str] = {}

    def compute(self, expression: Expression, count: int) -> list[str]:
        """Write one value, or the values of a linear system, to `%target`."""
        for node in operations_in_order([expression], {}):
            self.names[node] = self._operation(node)
        if isinstance(expression, Apply) and expression.operator in SYSTEMS:
            self.lines.append(
                f"  call void @llvm.memcpy.p0.p0.i64(ptr %target, ptr {self.names[expression]}, i64 {8 * count}, i1 false)"
            )
        else:
            self.lines.append(f"  store double {self._double(expression)}, ptr %target")
        return self.lines

    def write(self, order: Sequence[Apply], roots: Sequence[Expression]) -> list[str]:
        """Write the operations in their order, then the roots into `out`."""
        for node in order:
            self.names[node] = self._operation(node)
        for place, root in enumerate(roots):
            value = self._double(root)
            self.lines += [
                f"  %o{place} = getelementptr inbounds double, ptr %out, i64 {place}",
                f"  store double {value}, ptr %o{place}",
            ]
        return self.lines

    # ------------------------------------------------------------ values
    def _emit(self, text: str, truth: bool = False) -> str:
        self.count += 1
        name = f"%{'c' if truth else 't'}{self.count}"
        self.lines.append(f"  {name} = {text}")
        if truth:
            self.truths.add(name)
        return name

    def _name(self, node: Expression) -> str:
        if isinstance(node, Number):
            return float_text(node.value)
        name = self.names.get(node)
        if name is None:
            array, place = self.known[node]
            pointer = self._emit(f"getelementptr inbounds double, ptr %{array}, i64 {place}")
            name = self.names[node] = self._emit(f"load double, ptr {pointer}")
        return name

    def _double(self, node: Expression) -> str:
        name = self._name(node)
        return self._emit(f"uitofp i1 {name} to double") if name in self.truths else name

    def _truth(self, node: Expression) -> str:
        name = self._name(node)
        return name if name in self.truths else self._emit(f"fcmp une double {name}, {float_text(0.0)}", True)

    def _doubles(self, nodes: Sequence[Expression]) -> list[str]:
        return [self._double(n) for n in nodes]

    def _room(self, count: int) -> str:
        """Stack space for some numbers, for the time of a call."""
        name = f"%room{len(self.opening)}"
        self.opening.append(f"  {name} = alloca [{max(1, count)} x double], align 16")
        return name

    def _points(self, nodes: Sequence[Expression]) -> str:
        """A list as an array: a constant of the module if it holds numbers alone."""
        numbers = tuple(x.value for x in nodes if isinstance(x, Number))
        if len(numbers) == len(nodes):
            return self.needs.array(numbers)
        place = self._room(len(nodes))
        for i, value in enumerate(self._doubles(nodes)):
            pointer = self._emit(f"getelementptr inbounds double, ptr {place}, i64 {i}")
            self.lines.append(f"  store double {value}, ptr {pointer}")
        return place

    # ------------------------------------------------------------ operations
    def _operation(self, node: Apply) -> str:
        operator, operands = node.operator, node.operands
        if operator in CONDITIONS:
            return self._condition(node)
        if operator in runtime.BY_OPERATOR:
            self.needs.called.add(operator)
            return self._supported(node)
        match operator:
            case "add":
                return self._sum(operands)
            case "multiply":
                return self._product(operands)
            case "divide":
                return self._emit("fdiv double {}, {}".format(*self._doubles(operands)))
            case "power":
                return self._power(*operands)
            case "select":
                condition, value, otherwise = self._truth(operands[0]), *self._doubles(operands[1:])
                return self._emit(f"select i1 {condition}, double {value}, double {otherwise}")
            case "min" | "max":
                return self._extreme(operator, *self._doubles(operands))
            case "sign":
                return self._sign(self._double(operands[0]))
            case "item":
                index = operands[1]
                assert isinstance(index, Number)
                place = f"getelementptr inbounds double, ptr {self._name(operands[0])}, i64 {int(index.value)}"
                return self._emit(f"load double, ptr {self._emit(place)}")
        return self._call(operator, self._doubles(operands))

    def _call(self, operator: str, values: Sequence[str]) -> str:
        name = OPERATORS[operator].llvm or OPERATORS[operator].in_c
        self.needs.declared.add(f"{name}({', '.join(['double'] * len(values))})")
        return self._emit(f"call double @{name}({', '.join(f'double {v}' for v in values)})")

    def _condition(self, node: Apply) -> str:
        comparison = OPERATORS[node.operator].llvm
        if comparison:
            a, b = self._doubles(node.operands)
            return self._emit(f"fcmp {comparison} double {a}, {b}", True)
        values = [self._truth(o) for o in node.operands]
        if node.operator == "not":
            return self._emit(f"xor i1 {values[0]}, true", True)
        return self._emit(f"{node.operator} i1 {values[0]}, {values[1]}", True)

    def _sum(self, operands: Sequence[Expression]) -> str:
        values = self._doubles(operands)
        result = values[0]
        for value in values[1:]:
            result = self._emit(f"fadd double {result}, {value}")
        return result

    def _product(self, operands: Sequence[Expression]) -> str:
        values = self._doubles(operands)
        if operands[0] == Number(-1.0):
            values[1] = self._emit(f"fneg double {values[1]}")
            values = values[1:]
        result = values[0]
        for value in values[1:]:
            result = self._emit(f"fmul double {result}, {value}")
        return result

    def _power(self, base: Expression, exponent: Expression) -> str:
        x = self._double(base)
        if isinstance(exponent, Number) and abs(exponent.value) <= LARGEST_PRODUCT and exponent.value % 1 == 0:
            left, square, result = abs(int(exponent.value)), x, ""
            while left:
                if left % 2:
                    result = self._emit(f"fmul double {result}, {square}") if result else square
                left //= 2
                if left:
                    square = self._emit(f"fmul double {square}, {square}")
            return result if exponent.value > 0 else self._emit(f"fdiv double {float_text(1.0)}, {result}")
        return self._call("power", [x, self._double(exponent)])

    def _extreme(self, operator: str, a: str, b: str) -> str:
        """Minimum or maximum as in numpy: the first of two equal values, NaN if one is NaN."""
        better = self._emit(f"fcmp {'ole' if operator == 'min' else 'oge'} double {a}, {b}", True)
        none = self._emit(f"fcmp uno double {a}, {a}", True)
        first = self._emit(f"or i1 {better}, {none}", True)
        return self._emit(f"select i1 {first}, double {a}, double {b}")

    def _sign(self, x: str) -> str:
        zero, one, less = (float_text(v) for v in (0.0, 1.0, -1.0))
        above, below, none = (self._emit(f"fcmp {w} double {x}, {zero}", True) for w in ("ogt", "olt", "uno"))
        result = self._emit(f"select i1 {none}, double {x}, double {zero}")
        result = self._emit(f"select i1 {below}, double {less}, double {result}")
        return self._emit(f"select i1 {above}, double {one}, double {result}")

    # ------------------------------------------------------------ what needs a function
    def _supported(self, node: Apply) -> str:
        operands = node.operands
        match node.operator:
            case "solve" | "banded":
                shape = (*shape_of(node), int(node.operator == "banded"))
                entries = self._points(operands[LEADING:] if node.operator == "banded" else operands)
                out, work = self._room(shape[0]), self._room(runtime.room(*shape))
                sizes = ", ".join(f"i64 {x}" for x in shape)
                self.lines.append(f"  call void @solve({sizes}, ptr {entries}, ptr {work}, ptr {out})")
                return out
            case "natural_slope" | "monotone_slope":
                return self._slope(node)
            case "noise":
                place, seed = self._doubles(operands[1:])
                steps = tuple(map(float, SMOOTH_STEP[order_of(node)]))
                rest = f"double {place}, double {seed}, ptr {self.needs.array(steps)}, i64 {len(steps)}"
                return self._emit(f"call double @noise(i64 {order_of(node)}, {rest})")
            case "root":
                return self._emit("call double @root(double {}, double {})".format(*self._doubles(operands)))
        points = lists(node)
        arrays = ", ".join(f"ptr {self._points(p)}" for p in points)
        name = runtime.BY_OPERATOR[node.operator].__name__
        return self._emit(
            f"call double @{name}(i64 {order_of(node)}, double {self._double(operands[1])}, {arrays}, i64 {len(points[0])})"
        )

    def _slope(self, node: Apply) -> str:
        """One slope of a curve. All slopes of a curve are computed together."""
        number, points = node.operands[0], node.operands[1:]
        assert isinstance(number, Number)
        key = (node.operator, points)
        if key not in self.slopes:
            n = len(points) // 2
            places, values = self._points(points[:n]), self._points(points[n:])
            self.slopes[key] = out = self._room(n)
            self.lines.append(
                f"  call void @{node.operator}(i64 {n}, ptr {places}, ptr {values}, ptr {self._room(n)}, ptr {out})"
            )
        place = f"getelementptr inbounds double, ptr {self.slopes[key]}, i64 {int(number.value)}"
        return self._emit(f"load double, ptr {self._emit(place)}")
