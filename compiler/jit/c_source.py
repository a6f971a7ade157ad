"""Functions of the subset to C source, with the same operations as `translate.py`, for use with a C compiler and without LLVM."""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Callable, Sequence, Set
from typing import Any

from .kinds import (
    BOOL,
    BYTE,
    BYTES,
    FLOAT,
    FLOATS,
    INT,
    INTS,
    ITEMS,
    NOTHING,
    WORD,
    WORDS,
    Fields,
    Handed,
    TranslationError,
    signature,
)  # fmt: skip
from .source import is_declared
from .stores import Stores

_WORDS = {
    FLOAT: "double",
    INT: "int64_t",
    BOOL: "int",
    FLOATS: "double *",
    INTS: "int64_t *",
    WORDS: "int32_t *",
    BYTES: "uint8_t *",
    NOTHING: "void",
}
_FOR_C = {INT: "size_t", FLOAT: "double"}
_NARROWED = {WORD: "(int32_t)", BYTE: "(uint8_t)"}
_SIGNS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "/", ast.Mod: "%", ast.BitAnd: "&", ast.BitXor: "^",
    ast.RShift: ">>", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.And: "&&", ast.Or: "||",
}  # fmt: skip
_UNSIGNED = (ast.BitAnd, ast.BitXor, ast.RShift, ast.Mult, ast.Add)
BEGINNING = """static inline double ulp(double x) { return nextafter(fabs(x), INFINITY) - fabs(x); }
static inline double smaller(double a, double b) { return b < a ? b : a; }
static inline double larger(double a, double b) { return b > a ? b : a; }
static inline int64_t fewer(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t more(int64_t a, int64_t b) { return b > a ? b : a; }
"""


def small_functions(text: str, own: str = "") -> str:
    """Those of `BEGINNING`, and of others of one line each, that a text calls: compilers warn of the rest."""
    lines = (BEGINNING + own).splitlines(keepends=True)
    return "".join(x for x in lines if re.search(rf"\b{x.partition('(')[0].split()[-1]}\(", text))


def c_source(
    exported: Sequence[Callable[..., Any]], left_out: Set[Callable[..., Any]] = frozenset(), inner: bool = False
) -> str:
    """Definitions of these functions, after those of all functions that they call. `left_out`: functions that a call by number never reaches.

    `inner`: no function is seen by other files, and each field of a record takes 8 bytes on every processor.
    """
    names = set() if inner else {f.__name__ for f in exported}
    writer = _CModule(names, left_out, Stores(exported, left_out), inner)
    for function in exported:
        writer.need(function)
    while writer.waiting:
        writer.bodies.append(_CFunction(writer, writer.waiting.pop()).text())
    records: dict[str, str] = {}
    while missing := writer.records.keys() - records.keys():  # a record names others
        records |= {name: writer.record(writer.records[name]) for name in sorted(missing)}
    return "\n".join([*records.values(), *writer.lists.values(), *writer.heads, "", *writer.bodies])


def c_number(value: float) -> str:
    """A double, written exactly."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = repr(float(value))
    return text if value >= 0 and not text.startswith("-") else f"({text})"


class _CModule:
    """Common data of the functions."""

    def __init__(self, exported: set[str], left_out: Set[Callable[..., Any]], stores: Stores, wide: bool) -> None:
        self.exported, self.left_out, self.stores, self.wide = exported, left_out, stores, wide
        self.waiting: list[Callable[..., Any]] = []
        self.seen: set[Callable[..., Any]] = set()
        self.records: dict[str, Fields] = {}
        self.lists: dict[tuple[float, ...], str] = {}
        self.heads: list[str] = []
        self.bodies: list[str] = []

    def need(self, function: Callable[..., Any]) -> None:
        """Add this function to those to be written."""
        if function not in self.seen:
            self.seen.add(function)
            self.waiting.append(function)

    def array(self, values: tuple[float, ...]) -> str:
        """Name of a list of numbers."""
        whole = all(isinstance(v, int) for v in values)
        name = f"list_{len(self.lists) + 1}"
        if values not in self.lists:
            items = ", ".join(str(v) if whole else c_number(v) for v in values)
            kind = "int64_t" if whole else "double"
            self.lists[values] = f"static const {kind} {name}[] = {{{items}}};"
        return self.lists[values].split()[3].partition("[")[0]

    def declared(self, kind: Any, name: str, written: Set[str] | None = None) -> str:
        """Declaration of a variable or argument, `const` if a pointer is not among those that are written to."""
        if written is not None and name not in written and (isinstance(kind, Fields) or kind in ITEMS):
            return f"const {self.declared(kind, name)}"
        if isinstance(kind, Fields):
            self.records[kind.name] = kind
            return f"struct {kind.name} *{name}"
        if isinstance(kind, Handed):
            arguments = ", ".join(self.declared(k, "").strip() for k in kind.arguments)
            return f"{_WORDS[kind.result]} (*{name})({arguments})"
        return f"{_WORDS[kind]} {name}".replace("* ", "*")

    def record(self, kind: Fields) -> str:
        """Struct of a record."""
        typed = {n: f"{kind.name}_{n}" for n, k in kind.fields.items() if self.wide and isinstance(k, Handed)}
        heads = "".join(f"typedef {self.declared(kind.fields[n], name)};\n" for n, name in typed.items())
        wide = "_Alignas(8) " if self.wide else ""
        words = {n: f"{typed[n]} {n}" if n in typed else self.declared(k, n) for n, k in kind.fields.items()}
        fields = "".join(f"    {wide}{word};\n" for word in words.values())
        return f"{heads}struct {kind.name} {{\n{fields}}};\n"


class _CFunction:
    """Writer of one function."""

    def __init__(self, writer: _CModule, function: Callable[..., Any]) -> None:
        self.writer, self.tree, self.home = writer, writer.stores.trees[function], function.__globals__
        self.written = writer.stores.written(function)
        kinds, self.result = signature(function)
        self.arguments = dict(zip((a.arg for a in self.tree.args.args), kinds, strict=True))
        self.variables = dict(self.arguments)
        self.lines: list[str] = []
        self.declared: list[str] = []  # what is used in several blocks
        self.places: dict[str, list[ast.stmt] | None] = {}
        self.depth = 1
        self.names: dict[ast.AST, frozenset[str]] = {}  # in each part of the function
        for node in reversed([*ast.walk(self.tree)]):
            inner = [self.names[x] for x in ast.iter_child_nodes(node)]
            self.names[node] = frozenset((node.id,)) if isinstance(node, ast.Name) else frozenset().union(*inner)

    def text(self) -> str:
        """Definition of the function. Its declaration is added to the writer."""
        self._block(self.tree.body)
        given = ", ".join(self.writer.declared(k, n, self.written) for n, k in self.arguments.items())
        static = "" if self.tree.name in self.writer.exported else "static "
        head = f"{static}{self.writer.declared(self.result, self.tree.name)}({given})"
        self.writer.heads.append(f"{head};")
        read = frozenset().union(*(self.names[x] for x in self.tree.body))
        unused = [f"    (void){name};" for name in self.arguments if name not in read]
        return "\n".join([f"{head}", "{", *self.declared, *unused, *self.lines, "}\n"])

    def _line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def _block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            self._statement(statement)

    def _inner(self, body: Sequence[ast.stmt]) -> None:
        self.depth += 1
        self._block(body)
        self.depth -= 1

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value=value):
                self._line(f"{self._value(value)};")
            case ast.Assign(targets=[target], value=value) | ast.AnnAssign(target=target, value=ast.expr() as value):
                name = self._declare(target.id, self._kind(value), node) if isinstance(target, ast.Name) else ""
                narrow = self._item(target) if isinstance(target, ast.Subscript) else ""
                self._line(f"{name or self._value(target)} = {_NARROWED.get(narrow, '')}{self._value(value)};")
            case ast.AugAssign(target=target, op=op, value=value):
                self._line(f"{self._value(target)} {_SIGNS[type(op)]}= {self._value(value)};")
            case ast.If():
                self._line(f"if {self._condition(node.test)} {{")
                self._inner(node.body)
                if node.orelse:
                    self._line("} else {")
                    self._inner(node.orelse)
                self._line("}")
            case ast.While():
                self._line(f"while {self._condition(node.test)} {{")
                self._inner(node.body)
                self._line("}")
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=bounds)):
                self._for(self._declare(name, INT, node), name, bounds, node.body)
            case ast.Return(value=value):
                self._line("return;" if value is None else f"return {self._value(value)};")
            case ast.Break() | ast.Continue():
                self._line(f"{type(node).__name__.lower()};")
            case _:
                raise TranslationError(f"{type(node).__name__} is not in the subset")

    def _declare(self, name: str, kind: Any, node: ast.stmt) -> str:
        """Return a name as a statement sets it: declared there if each use that follows is in the same block."""
        if name not in self.variables:
            self.variables[name] = kind
            self.places[name] = self._declared_at(name, self.tree.body)
            if self.places[name] is None:
                self.declared.append(f"    {self.writer.declared(kind, name, self.written)};")
        here = node in (self.places.get(name) or ())
        return self.writer.declared(self.variables[name], name, self.written) if here else name

    def _declared_at(self, name: str, block: Sequence[ast.stmt]) -> list[ast.stmt] | None:
        """Return statements that may declare a variable where they set it: no use of it lies outside of their blocks; None if there are none."""
        places: list[ast.stmt] = []
        for statement in block:
            if name not in self.names[statement]:
                continue
            match statement:
                case ast.Assign(targets=[ast.Name(id=target)], value=value) if (
                    target == name and not places and name not in self.names[value]
                ):
                    return [statement]
                case ast.For(target=ast.Name(id=target), iter=bounds) if (
                    target == name and name not in self.names[bounds]
                ):
                    places.append(statement)
                case ast.If(test=head) | ast.While(test=head) | ast.For(iter=head) if name not in self.names[head]:
                    for body in (statement.body, statement.orelse):
                        inner = self._declared_at(name, body)
                        if inner is None:
                            return None
                        places += inner
                case _:
                    return None
        return places

    def _for(self, first: str, name: str, bounds: Sequence[ast.expr], body: Sequence[ast.stmt]) -> None:
        values = [self._value(b) for b in bounds]
        start, stop = (values[0], values[1]) if len(values) > 1 else ("0", values[0])
        back = len(values) > 2 and values[2].lstrip("(").startswith("-")
        step = values[2] if len(values) > 2 else "1"
        self._line(f"for ({first} = {start}; {name} {'>' if back else '<'} {stop}; {name} += {step}) {{")
        self._inner(body)
        self._line("}")

    # ------------------------------------------------------------ values
    def _value(self, node: ast.expr) -> str:
        match node:
            case ast.Constant(value=value):
                return self._constant(value)
            case ast.Name(id=name):
                return name if name in self.variables else self._constant(self.home[name])
            case ast.Attribute(value=owner, attr=name):
                return f"{self._value(owner)}->{name}"
            case ast.Subscript(value=array, slice=ast.Slice(lower=ast.expr() as lower)):
                return f"({self._value(array)} + {self._value(lower)})"
            case ast.Subscript(value=array, slice=index):
                return f"{self._value(array)}[{self._value(index)}]"
            case ast.UnaryOp(op=op, operand=operand):
                return f"({'!' if isinstance(op, ast.Not) else '-'}{self._value(operand)})"
            case ast.BoolOp(op=op, values=values):
                return f"({f' {_SIGNS[type(op)]} '.join(map(self._value, values))})"
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return f"({self._value(test)} ? {self._value(body)} : {self._value(orelse)})"
            case ast.Compare(left=left, ops=signs, comparators=others):
                values = [left, *others]
                pairs = zip(signs, values, others, strict=False)
                parts = [f"{self._value(a)} {_SIGNS[type(s)]} {self._value(b)}" for s, a, b in pairs]
                return f"({' && '.join(parts)})"
            case ast.BinOp():
                return self._binary(node)
            case ast.Call():
                return self._call(node)
        raise TranslationError(f"{type(node).__name__} is not in the subset")

    def _condition(self, node: ast.expr) -> str:
        """Return a condition in one pair of brackets, which most have already: a second one looks like a mistake to compilers."""
        value = self._value(node)
        return value if isinstance(node, ast.Compare | ast.BoolOp | ast.UnaryOp) else f"({value})"

    def _constant(self, value: Any) -> str:
        if isinstance(value, bool | int):
            return f"{int(value)}" if abs(int(value)) < 2**31 else f"UINT64_C({value})"
        if isinstance(value, tuple):
            return self.writer.array(value)
        return c_number(value)

    def _binary(self, node: ast.BinOp) -> str:
        if isinstance(node.op, ast.Pow):
            return c_number(ast.literal_eval(node.left) ** ast.literal_eval(node.right))
        a, b = self._value(node.left), self._value(node.right)
        if self._kind(node) == INT and isinstance(node.op, _UNSIGNED):  # no overflow, `>>` brings zeros
            return f"((int64_t)((uint64_t){a} {_SIGNS[type(node.op)]} (uint64_t){b}))"
        kinds = self._kind(node.left), self._kind(node.right)
        if isinstance(node.op, ast.Div) or FLOAT in kinds:  # no conversion that is not written
            a, b = (f"(double){x}" if kind == INT else x for x, kind in zip((a, b), kinds, strict=True))
        return f"({a} {_SIGNS[type(node.op)]} {b})"

    def _call(self, node: ast.Call) -> str:
        values = [self._value(a) for a in node.args]
        if isinstance(node.func, ast.Subscript):
            return f"({self._chosen(node.func)})({', '.join(values)})"
        if isinstance(node.func, ast.Name):
            name = node.func.id
            if name in ("min", "max"):
                whole = self._kind(node) == INT
                word = {"min": ("smaller", "fewer"), "max": ("larger", "more")}[name][whole]
                result = values[0]
                for value in values[1:]:
                    result = f"{word}({result}, {value})"
                return result
            words = {
                "abs": "llabs" if self._kind(node) == INT else "fabs",
                "float": "(double)",
                "int": "(int64_t)",
                "id": "(int64_t)(intptr_t)",
            }
            if name in words:
                return f"{words[name]}({values[0]})"
            known = self.home.get(name)
            if inspect.isfunction(known) and is_declared(known):
                kinds = signature(known)[0]
                values = [f"({_FOR_C.get(k, 'void *')}){v}" for v, k in zip(values, kinds, strict=True)]
            elif inspect.isfunction(known):
                self.writer.need(known)
        return (
            f"{self._value(node.func) if isinstance(node.func, ast.Attribute) else node.func.id}({', '.join(values)})"  # type: ignore[attr-defined]
        )

    def _chosen(self, which: ast.Subscript) -> str:
        """The item of a tuple of functions that an index names; the last for any other index."""
        functions = self.home[ast.unparse(which.value)]
        index, chosen = self._value(which.slice), ""
        present = [(i, f) for i, f in enumerate(functions) if f not in self.writer.left_out]
        for number, function in reversed(present):
            self.writer.need(function)
            if chosen != function.__name__:
                chosen = f"{index} == {number} ? {function.__name__} : {chosen}" if chosen else function.__name__
        return chosen

    def _kind(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=value):
                return BOOL if isinstance(value, bool) else INT if isinstance(value, int) else FLOAT
            case ast.Name(id=name):
                known = self.variables.get(name, self.home.get(name))
                if isinstance(known, tuple):
                    return INTS if all(isinstance(v, int) for v in known) else FLOATS
                return {int: INT, float: FLOAT, bool: BOOL}.get(type(known), known)
            case ast.Attribute(value=owner, attr=name):
                return self._kind(owner).fields[name]
            case ast.Subscript(value=array, slice=index):
                if isinstance(index, ast.Slice):
                    return self._kind(array)
                return INT if self._item(node) in _NARROWED else self._item(node)
            case ast.UnaryOp(op=op, operand=operand):
                return BOOL if isinstance(op, ast.Not) else self._kind(operand)
            case ast.BinOp(op=op, left=left, right=right):
                return FLOAT if isinstance(op, ast.Div | ast.Pow) else self._wider(left, right)
            case ast.IfExp(body=body, orelse=orelse):
                return self._wider(body, orelse)
            case ast.Compare() | ast.BoolOp():
                return BOOL
            case ast.Call(func=ast.Name(id=name), args=arguments):
                if name in ("min", "max", "abs"):
                    return self._wider(*arguments)
                if inspect.isfunction(self.home.get(name)):
                    return signature(self.home[name])[1]
                return {"int": INT, "id": INT, "isfinite": BOOL, "isnan": BOOL}.get(name, FLOAT)
            case ast.Call(func=ast.Subscript(value=which)):
                return signature(self.home[ast.unparse(which)][0])[1]
            case ast.Call(func=ast.Attribute() as function):
                return self._kind(function).result
        raise TranslationError(f"{type(node).__name__} is not in the subset")

    def _item(self, node: ast.Subscript) -> str:
        return ITEMS[self._kind(node.value)]

    def _wider(self, *nodes: ast.expr) -> Any:
        kinds = [self._kind(n) for n in nodes]
        return FLOAT if FLOAT in kinds else kinds[0] if len(set(kinds)) == 1 and kinds[0] != BOOL else INT
