"""Values of the subset, as sequences of LLVM operations."""

from __future__ import annotations

import ast
import inspect
import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .kinds import (
    BOOL,
    BYTE,
    FLOAT,
    FLOATS,
    INT,
    INTS,
    ITEMS,
    MEMORIES,
    NOTHING,
    WIDENED,
    WORD,
    Fields,
    Handed,
    TranslationError,
    Value,
    signature,
    text_of,
)
from .source import is_declared, tree_of

_INTRINSICS = {
    "sqrt": "llvm.sqrt.f64",
    "fabs": "llvm.fabs.f64",
    "floor": "llvm.floor.f64",
    "copysign": "llvm.copysign.f64",
}
_LIBRARY = frozenset(("exp", "log", "sin", "cos", "pow"))
_FLOAT_SIGNS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
# Whole numbers have 64 bits and no overflow: `&` with 64 ones, as Python needs it, keeps what is there. `>>` brings zeros.
_INT_SIGNS = {
    ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.FloorDiv: "sdiv", ast.Mod: "srem", ast.BitAnd: "and", ast.BitXor: "xor",
    ast.RShift: "lshr",
}  # fmt: skip
_COMPARE = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}


def float_text(value: float) -> str:
    """A double, written exactly."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


def apart() -> list[str]:
    """Metadata for LLVM: memories of different kinds do not overlap (type-based alias analysis)."""
    lines = ['!0 = !{!"memories"}']
    for number, name in enumerate(MEMORIES, 1):
        lines += [
            f'!{2 * number - 1} = !{{!"{name}", !0}}',
            f"!{2 * number} = !{{!{2 * number - 1}, !{2 * number - 1}, i64 0}}",
        ]
    return lines


def _apart(place: Value) -> str:
    return f", !tbaa !{2 * MEMORIES.index(place.memory) + 2}" if place.memory else ""


@dataclass(frozen=True, slots=True)
class Choices:
    """Parts of a module that cost much to compile and are not always worth it.

    `left_out`: functions that a call by number never reaches. `vectors`: files whose loops LLVM may compute several rounds at once of; None: all.
    `elsewhere`: functions of other modules, which a caller links (`MachineCode.link`); one that is not linked answers `absent`.
    """

    left_out: frozenset[Callable[..., Any]] = frozenset()
    vectors: frozenset[str] | None = None
    elsewhere: frozenset[Callable[..., Any]] = frozenset()
    absent: int = 0

    def in_vectors(self, function: Callable[..., Any]) -> bool:
        """Return True if LLVM may compute several rounds of the loops of a function at once."""
        return self.vectors is None or function.__module__.rpartition(".")[2] in self.vectors


EVERYTHING = Choices()


class SubsetModule:
    """Common data of the functions of a module."""

    def __init__(self, choices: Choices = EVERYTHING) -> None:
        self.choices = choices
        self.scalar_loops: list[str] = []
        self.waiting: list[Callable[..., Any]] = []
        self.known: dict[str, Callable[..., Any]] = {}
        self.constants: dict[tuple[float, ...], str] = {}
        self.declared: dict[str, str] = {}

    def need(self, function: Callable[..., Any]) -> None:
        """Add this function to those to be translated."""
        name = function.__name__
        if self.known.setdefault(name, function) is not function:
            raise TranslationError(f"two functions are called `{name}`")
        if function not in self.waiting and f"{name} done" not in self.declared:
            self.declared[f"{name} done"] = ""
            self.waiting.append(function)

    def elsewhere(self, function: Callable[..., Any]) -> str:
        """Declare a function of another module; return the global variable that has its address."""
        name, (arguments, result) = function.__name__, signature(function)
        head = f"define internal {text_of(result)} @{name}.absent({', '.join(map(text_of, arguments))})"
        absent = {FLOAT: float_text(self.choices.absent), NOTHING: ""}.get(result, self.choices.absent)
        body = f"  ret {text_of(result)} {absent}"
        self.declared[f"{name}.at"] = f"@{name}.at = global ptr @{name}.absent\n{head} {{\n{body}\n}}"
        return f"@{name}.at"

    def external(self, name: str, result: str, arguments: Sequence[str]) -> str:
        """Declare a function of LLVM or of the mathematical library."""
        self.declared[name] = f"declare {result} @{name}({', '.join(arguments)})"
        return f"@{name}"

    def scalar_loop(self) -> str:
        """Mark of a loop that stays as it is."""
        first = 2 * len(MEMORIES) + 1
        if not self.scalar_loops:
            self.scalar_loops = [f'!{first} = !{{!"llvm.loop.vectorize.enable", i1 false}}']
        number = first + len(self.scalar_loops)
        self.scalar_loops.append(f"!{number} = distinct !{{!{number}, !{first}}}")
        return f", !llvm.loop !{number}"

    def array(self, values: tuple[float, ...]) -> Value:
        """Constant for a list of numbers."""
        kind, one = (INTS, INT) if all(isinstance(v, int) for v in values) else (FLOATS, FLOAT)
        name = f"@list.{len(self.constants) + 1}"
        if values not in self.constants:
            items = ", ".join(f"{one} {v if one == INT else float_text(v)}" for v in values)
            self.constants[values] = f"{name} = private unnamed_addr constant [{len(values)} x {one}] [{items}]"
        return Value(kind, self.constants[values].split(" ", 1)[0])


class ValueWriter:
    """Writer of the values of one function."""

    def __init__(self, module: SubsetModule, function: Callable[..., Any], exported: set[str]) -> None:
        self.module, self.function = module, function
        self.home: dict[str, Any] = function.__globals__
        tree = tree_of(function)
        self.tree, self.exported = tree, tree.name in exported
        self.first = function.__code__.co_firstlineno
        self.variables: dict[str, Any] = {}  # name -> type
        self.lines: list[str] = []
        self.opening: list[str] = []
        self.count = 0
        self.loops: list[tuple[str, str]] = []  # targets of `continue` and `break`
        self.ended = False  # True if the block has its last instruction
        self.arguments, self.result = signature(function)

    # ------------------------------------------------------------ pieces of text
    def _new(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def _labels(self, *words: str) -> list[str]:
        self.count += 1
        return [f"{word}.{self.count}" for word in words]

    def _emit(self, kind: Any, text: str) -> Value:
        name = self._new()
        self.lines.append(f"  {name} = {text}")
        return Value(kind, name)

    def _start(self, label: str) -> None:
        if not self.ended:
            self.lines.append(f"  br label %{label}")
        self.lines.append(f"{label}:")
        self.ended = False

    def _go(self, label: str) -> None:
        if not self.ended:
            self.lines.append(f"  br label %{label}")
        self.ended = True

    def _branch(self, condition: Value, yes: str, no: str) -> None:
        self.lines.append(f"  br i1 {condition.text}, label %{yes}, label %{no}")
        self.ended = True

    def _fail(self, node: ast.AST, why: str) -> TranslationError:
        line = self.first + getattr(node, "lineno", 1) - 1
        return TranslationError(f"{self.function.__module__}:{line} `{self.tree.name}`: {why}")

    def _variable(self, name: str, kind: Any) -> None:
        if name not in self.variables:
            self.variables[name] = kind
            self.opening.append(f"  %{name}.v = alloca {text_of(kind)}")

    # ------------------------------------------------------------ places
    def _place(self, node: ast.expr) -> Value | None:
        """Address of a field or an item, with the type of its content."""
        if isinstance(node, ast.Attribute):
            owner = self._value(node.value)
            if not isinstance(owner.kind, Fields):
                raise self._fail(node, "only records have fields")
            number = owner.kind.place(node.attr)
            found = self._emit(None, f"getelementptr inbounds i64, ptr {owner.text}, i64 {number}")
            kind = owner.kind.fields[node.attr]
            return Value(kind, found.text, f"field {text_of(kind)}")
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            array = self._value(node.value)
            if array.kind not in ITEMS:
                raise self._fail(node, "only arrays have items")
            if isinstance(node.slice, ast.UnaryOp):
                raise self._fail(node, "items are counted from the first, as in C")
            index = self._as(self._value(node.slice), INT, node)
            item = ITEMS[array.kind]
            found = self._emit(None, f"getelementptr inbounds {item}, ptr {array.text}, i64 {index.text}")
            return Value(item, found.text, f"item {item}")
        return None

    def _load(self, place: Value) -> Value:
        value = self._emit(place.kind, f"load {text_of(place.kind)}, ptr {place.text}{_apart(place)}")
        if place.kind in (WORD, BYTE):
            return self._emit(INT, f"{WIDENED[place.kind]} {place.kind} {value.text} to i64")
        return value

    def _store(self, place: Value, value: Value, node: ast.AST) -> None:
        if place.kind in (WORD, BYTE):
            value = self._emit(place.kind, f"trunc i64 {self._as(value, INT, node).text} to {place.kind}")
        value = self._as(value, place.kind, node)
        self.lines.append(f"  store {text_of(place.kind)} {value.text}, ptr {place.text}{_apart(place)}")

    # ------------------------------------------------------------ values
    def _value(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=value):
                return self._constant(value, node)
            case ast.Name(id=name) if name in self.variables:
                return self._load(Value(self.variables[name], f"%{name}.v"))
            case ast.Name(id=name):
                return self._constant(self.home.get(name), node)
            case ast.Attribute():
                place = self._place(node)
                assert place is not None
                return self._load(place)
            case ast.Subscript(slice=ast.Slice(lower=lower, upper=None, step=None)) if lower is not None:
                array = self._value(node.value)
                index = self._as(self._value(lower), INT, node)
                return self._emit(
                    array.kind, f"getelementptr inbounds {ITEMS[array.kind]}, ptr {array.text}, i64 {index.text}"
                )
            case ast.Subscript():
                place = self._place(node)
                if place is None:
                    raise self._fail(node, "only slices `x[k:]`")
                return self._load(place)
            case ast.BinOp():
                if isinstance(node.op, ast.Pow):
                    return self._power(node)
                return self._binary(node.op, self._value(node.left), self._value(node.right), node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BoolOp() | ast.IfExp():
                return self._chosen(node)
            case ast.Compare():
                return self._compare(node)
            case ast.Call():
                return self._call(node)
        raise self._fail(node, f"{type(node).__name__} is not in the subset")

    def _constant(self, value: Any, node: ast.AST) -> Value:
        if isinstance(value, bool):
            return Value(BOOL, "true" if value else "false")
        if isinstance(value, int):
            return Value(INT, str(value))
        if isinstance(value, float):
            return Value(FLOAT, float_text(value))
        if isinstance(value, tuple) and value and all(isinstance(v, int | float) for v in value):
            return self.module.array(value)
        raise self._fail(node, f"`{ast.unparse(node)}` is unknown")

    def _power(self, node: ast.BinOp) -> Value:
        """A constant power such as 2.0**-52. Other powers are written as products, or as `pow` of math."""
        try:
            base, exponent = ast.literal_eval(node.left), ast.literal_eval(node.right)
        except ValueError:
            raise self._fail(node, "powers are products, or `pow` of math") from None
        return self._constant(base**exponent, node)

    def _binary(self, sign: ast.operator, a: Value, b: Value, node: ast.AST) -> Value:
        if FLOAT in (a.kind, b.kind) or isinstance(sign, ast.Div):
            a, b = self._as(a, FLOAT, node), self._as(b, FLOAT, node)
            if type(sign) not in _FLOAT_SIGNS:
                raise self._fail(node, "not an operation of floats")
            return self._emit(FLOAT, f"{_FLOAT_SIGNS[type(sign)]} double {a.text}, {b.text}")
        a, b = self._as(a, INT, node), self._as(b, INT, node)
        if type(sign) not in _INT_SIGNS:
            raise self._fail(node, "not an operation of whole numbers")
        return self._emit(INT, f"{_INT_SIGNS[type(sign)]} i64 {a.text}, {b.text}")

    def _unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self._emit(BOOL, f"xor i1 {self._truth(node.operand).text}, true")
        if not isinstance(node.op, ast.USub):
            raise self._fail(node, "only - and not")
        if isinstance(node.operand, ast.Constant):
            return self._constant(-node.operand.value, node)  # type: ignore[operator]
        inner = self._value(node.operand)
        if inner.kind == FLOAT:
            return self._emit(FLOAT, f"fneg double {inner.text}")
        return self._emit(INT, f"sub i64 0, {self._as(inner, INT, node).text}")

    def _compare(self, node: ast.Compare) -> Value:
        values = [self._value(v) for v in (node.left, *node.comparators)]
        found = [self._compared(s, a, b, node) for s, a, b in zip(node.ops, values, values[1:], strict=False)]
        result = found[0]
        for other in found[1:]:
            result = self._emit(BOOL, f"and i1 {result.text}, {other.text}")
        return result

    def _compared(self, sign: ast.cmpop, a: Value, b: Value, node: ast.AST) -> Value:
        word = _COMPARE.get(type(sign))
        if word is None:
            raise self._fail(node, "not a comparison of the subset")
        if FLOAT in (a.kind, b.kind):
            a, b = self._as(a, FLOAT, node), self._as(b, FLOAT, node)
            return self._emit(BOOL, f"fcmp {'u' if word == 'ne' else 'o'}{word} double {a.text}, {b.text}")
        a, b = self._as(a, INT, node), self._as(b, INT, node)
        return self._emit(BOOL, f"icmp {word if word in ('eq', 'ne') else 's' + word} i64 {a.text}, {b.text}")

    def _chosen(self, node: ast.BoolOp | ast.IfExp) -> Value:
        """`and`, `or`, `a if c else b`: operands that are not needed are not evaluated."""
        self.count += 1
        name = f"chosen.{self.count}"
        end = self._labels("end")[0]
        if isinstance(node, ast.BoolOp):
            for number, part in enumerate(node.values):
                found = self._truth(part)
                self._variable(name, BOOL)
                self.lines.append(f"  store i1 {found.text}, ptr %{name}.v")
                if number < len(node.values) - 1:
                    further = self._labels("further")[0]
                    ways = (further, end) if isinstance(node.op, ast.And) else (end, further)
                    self._branch(found, *ways)
                    self._start(further)
        else:
            yes, no = self._labels("yes", "no")
            self._branch(self._truth(node.test), yes, no)
            for label, part in ((yes, node.body), (no, node.orelse)):
                self._start(label)
                value = self._value(part)
                self._variable(name, value.kind)
                self._store(Value(self.variables[name], f"%{name}.v"), value, node)
                self._go(end)
        self._start(end)
        return self._load(Value(self.variables[name], f"%{name}.v"))

    def _truth(self, node: ast.expr) -> Value:
        value = self._value(node)
        if value.kind == BOOL:
            return value
        if value.kind == INT:
            return self._emit(BOOL, f"icmp ne i64 {value.text}, 0")
        raise self._fail(node, "not a truth")

    def _as(self, value: Value, kind: Any, node: ast.AST) -> Value:
        """The value in another type, if the conversion is exact."""
        if value.kind == kind:
            return value
        if kind == FLOAT and value.kind == INT:
            if value.text.lstrip("-").isdigit():
                return Value(FLOAT, float_text(float(value.text)))
            return self._emit(FLOAT, f"sitofp i64 {value.text} to double")
        if kind == INT and value.kind == BOOL:
            return self._emit(INT, f"zext i1 {value.text} to i64")
        raise self._fail(node, f"{value.kind} is no {kind}")

    # ------------------------------------------------------------ calls
    def _call(self, node: ast.Call) -> Value:
        if isinstance(node.func, ast.Attribute):
            function = self._value(node.func)
            if not isinstance(function.kind, Handed):
                raise self._fail(node, "only functions can be called")
            return self._called(function.text, function.kind.arguments, function.kind.result, node)
        if isinstance(node.func, ast.Subscript):
            return self._chosen_call(node.func, node)
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        if name in self.variables:
            function = self._value(node.func)
            assert isinstance(function.kind, Handed)
            return self._called(function.text, function.kind.arguments, function.kind.result, node)
        if name in _BUILT_IN:
            return _BUILT_IN[name](self, node)
        known = self.home.get(name)
        if known is not None and getattr(math, name, None) is known:
            return self._library(name, node)
        if not inspect.isfunction(known):
            raise self._fail(node, f"`{name}` is unknown")
        arguments, result = signature(known)
        if is_declared(known):
            self.module.external(name, text_of(result), [text_of(k) for k in arguments])
            return self._called(f"@{name}", arguments, result, node)
        return self._called(self._function(known), arguments, result, node)

    def _function(self, function: Callable[..., Any]) -> str:
        """The address of a function, of this module or another."""
        if function in self.module.choices.elsewhere:
            return self._emit(None, f"load ptr, ptr {self.module.elsewhere(function)}").text
        self.module.need(function)
        return f"@{function.__name__}"

    def _chosen_call(self, which: ast.Subscript, node: ast.Call) -> Value:
        """Call the item of a tuple of functions that an index names; the last for any other index."""
        functions = self.home.get(ast.unparse(which.value))
        if not isinstance(functions, tuple) or len({str(signature(f)) for f in functions}) != 1:
            raise self._fail(node, f"`{ast.unparse(which.value)}` is no tuple of functions of one type")
        index = self._as(self._value(which.slice), INT, node)
        chosen = ""
        present = [(i, f) for i, f in enumerate(functions) if f not in self.module.choices.left_out]
        for number, function in reversed(present):
            address = self._function(function)
            if not chosen:
                chosen = address
                continue
            equal = self._emit(BOOL, f"icmp eq i64 {index.text}, {number}")
            chosen = self._emit(None, f"select i1 {equal.text}, ptr {address}, ptr {chosen}").text
        return self._called(chosen, *signature(functions[0]), node)

    def _called(self, function: str, kinds: Sequence[Any], result: Any, node: ast.Call) -> Value:
        if len(kinds) != len(node.args) or node.keywords:
            raise self._fail(node, f"{len(kinds)} arguments are wanted")
        values = [self._as(self._value(a), k, node) for a, k in zip(node.args, kinds, strict=True)]
        given = ", ".join(f"{text_of(v.kind)} {v.text}" for v in values)
        text = f"call {text_of(result)} {function}({given})"
        if result == NOTHING:
            self.lines.append(f"  {text}")
            return Value(NOTHING, "")
        return self._emit(result, text)

    def _library(self, name: str, node: ast.Call) -> Value:
        values = [self._as(self._value(a), FLOAT, node) for a in node.args]
        if name in _INTRINSICS or name in _LIBRARY:
            function = self.module.external(_INTRINSICS.get(name, name), FLOAT, [FLOAT] * len(values))
            return self._emit(FLOAT, f"call double {function}({', '.join(f'double {v.text}' for v in values)})")
        if name == "isfinite":
            size = self._fabs(values[0])
            return self._emit(BOOL, f"fcmp olt double {size.text}, {float_text(math.inf)}")
        if name == "isnan":
            return self._emit(BOOL, f"fcmp uno double {values[0].text}, {values[0].text}")
        if name == "ulp":
            size = self._fabs(values[0])
            bits = self._emit(INT, f"bitcast double {size.text} to i64")
            above = self._emit(INT, f"add i64 {bits.text}, 1")
            larger = self._emit(FLOAT, f"bitcast i64 {above.text} to double")
            return self._emit(FLOAT, f"fsub double {larger.text}, {size.text}")
        raise self._fail(node, f"`{name}` is not in the subset")

    def _fabs(self, value: Value) -> Value:
        function = self.module.external("llvm.fabs.f64", FLOAT, [FLOAT])
        return self._emit(FLOAT, f"call double {function}(double {value.text})")

    def _absolute(self, node: ast.Call) -> Value:
        value = self._value(node.args[0])
        if value.kind == FLOAT:
            return self._fabs(value)
        opposite = self._emit(INT, f"sub i64 0, {value.text}")
        below = self._emit(BOOL, f"icmp slt i64 {value.text}, 0")
        return self._emit(INT, f"select i1 {below.text}, i64 {opposite.text}, i64 {value.text}")

    def _extreme(self, node: ast.Call) -> Value:
        """`min` and `max` as in Python: the first, unless another is smaller or larger."""
        assert isinstance(node.func, ast.Name)
        values = [self._value(a) for a in node.args]
        kind = FLOAT if any(v.kind == FLOAT for v in values) else INT
        result = self._as(values[0], kind, node)
        for value in values[1:]:
            other = self._as(value, kind, node)
            better = self._compared(ast.Lt() if node.func.id == "min" else ast.Gt(), other, result, node)
            result = self._emit(kind, f"select i1 {better.text}, {kind} {other.text}, {kind} {result.text}")
        return result

    def _address(self, node: ast.Call) -> Value:
        return self._emit(INT, f"ptrtoint ptr {self._value(node.args[0]).text} to i64")

    def _float(self, node: ast.Call) -> Value:
        return self._as(self._value(node.args[0]), FLOAT, node)

    def _int(self, node: ast.Call) -> Value:
        value = self._value(node.args[0])
        return value if value.kind == INT else self._emit(INT, f"fptosi double {value.text} to i64")


_BUILT_IN: dict[str, Callable[[ValueWriter, ast.Call], Value]] = {
    "abs": ValueWriter._absolute, "min": ValueWriter._extreme, "max": ValueWriter._extreme, "float": ValueWriter._float, "int": ValueWriter._int,
    "id": ValueWriter._address,
}  # fmt: skip
