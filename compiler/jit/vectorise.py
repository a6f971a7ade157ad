"""Functions of the subset as Python over numpy in which loops over arrays are array operations: what runs where there is no machine code.

`translate.py` makes machine code of the same source. Sums are added in another order here, so results agree to rounding. A loop `for i in range(a, b)` becomes
array operations if each of its statements is elementwise, a sum, a maximum or a minimum, an assignment under a condition, or the return of a constant under
a condition; other loops stay as they are. Rows of one array, at offsets that are not literal numbers, must not overlap.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping
from copy import deepcopy
from types import FunctionType
from typing import Any

import numpy as np

from .source import tree_of

_CALLS = {
    "abs": "np.abs", "sqrt": "np.sqrt", "isfinite": "np.isfinite", "pow": "np.power", "float": "", "max": "np.fmax", "min": "np.fmin",
}  # fmt: skip
_REDUCED = {"max": "np.fmax.reduce", "min": "np.fmin.reduce"}
_AT = {ast.Add: "np.add.at", ast.Sub: "np.subtract.at"}


class _StaysAsItIs(Exception):
    """Raised if a loop cannot be written as array operations."""


class Vectorised:
    """Functions with array operations, made on first use with all functions of a package that they call."""

    def __init__(self, package: str, replaced: Mapping[Callable[..., Any], Callable[..., Any]]) -> None:
        """`replaced`: functions, and those that take their place."""
        self._package = f"{package}."
        self._made: dict[Callable[..., Any], Callable[..., Any]] = dict(replaced)
        self._homes: dict[str, dict[str, Any]] = {}

    def __getitem__(self, function: Callable[..., Any]) -> Callable[..., Any]:
        if function not in self._made:
            self._add(function.__module__)
        return self._made[function]

    def _add(self, module: str) -> None:
        """Add all functions of a module."""
        known = vars(sys.modules[module])
        home = self._homes[module] = dict(known) | {"np": np}
        written = [tree_of(f) for f in known.values() if isinstance(f, FunctionType) and f.__module__ == module]
        functions = [_Vectoriser(known).visit(tree) for tree in written]
        future = ast.parse("from __future__ import annotations").body
        exec(compile(ast.fix_missing_locations(ast.Module([*future, *functions], [])), module, "exec"), home)
        for node in functions:
            self._made.setdefault(known[node.name], home[node.name])
        for name, value in known.items():
            several = value if isinstance(value, tuple) else (value,)
            if several and all(isinstance(f, FunctionType) and f.__module__.startswith(self._package) for f in several):
                home[name] = tuple(self[f] for f in several) if several is value else self[value]


class _Vectoriser(ast.NodeTransformer):
    """Writer of the loops of a function."""

    def __init__(self, known: Mapping[str, Any]) -> None:
        self.known = known
        self.lists: frozenset[str] = frozenset()  # arguments that are literal lists

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.lists = frozenset(
            a.arg for a in node.args.args if isinstance(a.annotation, ast.Name) and a.annotation.id == "Numbers"
        )
        return self.generic_visit(node)

    def visit_For(self, node: ast.For) -> Any:
        try:
            return _Loop(node, self.known, self.lists).statements
        except _StaysAsItIs:
            return self.generic_visit(node)


class _Loop:
    """One loop as array operations: `statements`. Raises `_StaysAsItIs`."""

    def __init__(self, node: ast.For, known: Mapping[str, Any], lists: frozenset[str]) -> None:
        match node:
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=[stop])):
                start: ast.expr = ast.Constant(0)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=[start, stop])):
                pass
            case _:
                raise _StaysAsItIs
        if _is_literal(start) and _is_literal(stop):
            raise _StaysAsItIs  # a few rounds
        self.index, self.start, self.stop, self.known, self.lists = name, start, stop, known, lists
        self.assigned = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        self.local: set[str] = set()  # names that are arrays within the loop
        self.rounds: set[str] = set()  # indices of loops within
        self.written: set[tuple[str, str]] = set()  # arrays and their indices
        self.read: set[tuple[str, str]] = set()
        self.masks = 0
        self.pure = all(isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Name) for n in node.body[:-1])
        self.statements = self._block(node.body, None)
        self._check_apart()

    def _check_apart(self) -> None:
        """Check that no element is read that another round writes."""
        for array, place in self.written:
            for other, there in self.read:
                if array == other and place != there:
                    names = [{n.id for n in ast.walk(ast.parse(p)) if isinstance(n, ast.Name)} for p in (place, there)]
                    if names[0] == names[1] == {self.index} or self.index not in names[1]:
                        raise _StaysAsItIs

    # ------------------------------------------------------------ statements
    def _block(self, body: list[ast.stmt], mask: ast.expr | None) -> list[ast.stmt]:
        return [made for node in body for made in self._statement(node, mask)]

    def _statement(self, node: ast.stmt, mask: ast.expr | None) -> list[ast.stmt]:
        match node:
            case ast.Assign(
                targets=[ast.Name() | ast.Attribute() as last],
                value=ast.IfExp(test=ast.UnaryOp(ast.Not(), ast.Compare(part, [ast.LtE()], [_])), orelse=same),
            ) if ast.unparse(last) == ast.unparse(same) and mask is None and self._varies(part):
                most = ast.Call(_name_of("np.maximum.reduce"), [self._array(part)], [ast.keyword("initial", same)])
                return [ast.Assign([last], _called("float", most))]
            case ast.Assign(targets=[ast.Subscript() as target]) if self._varies(target.slice) and not self._is_shifted(
                target.slice
            ):
                return self._scatter(target, node.value, mask)
            case ast.Assign(targets=[ast.Subscript() as target]):
                return self._put(target, self._array(node.value), mask)
            case ast.Assign(targets=[ast.Name(id=name)]):
                return self._name(name, node.value, mask)
            case ast.AugAssign(target=ast.Subscript() as target):
                return self._change(target, node, mask)
            case ast.AugAssign(target=ast.Name(id=name)):
                return self._sum(name, node, mask)
            case ast.If(test=test, body=[ast.Return(value=ast.Constant() | ast.Name()) as answer], orelse=[]) if (
                self.pure and mask is None and self._varies(test)
            ):
                return [ast.If(_called("np.any", self._array(test)), [answer], [])]
            case ast.If(test=test):
                return self._if(node, mask)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=bounds)) if not any(map(self._varies, bounds)):
                if not all(map(_is_literal, bounds)):
                    raise _StaysAsItIs  # the inner loop is the longer one
                self.rounds.add(name)
                rounds = ast.For(ast.Name(name, ast.Store()), node.iter, self._block(node.body, mask), [])
                self.rounds.discard(name)
                return [rounds]
        raise _StaysAsItIs

    def _if(self, node: ast.If, mask: ast.expr | None) -> list[ast.stmt]:
        if not self._varies(node.test):
            return [ast.If(node.test, self._block(node.body, mask), self._block(node.orelse, mask))]
        found: list[ast.stmt] = []

        def masked(test: ast.expr) -> ast.expr:
            """Return the name of a condition, which is evaluated before what depends on it changes its values."""
            self.masks += 1
            name = f"mask_{self.masks}"
            both = test if mask is None else ast.BinOp(mask, ast.BitAnd(), test)
            found.append(ast.Assign([ast.Name(name, ast.Store())], both))
            return ast.Name(name, ast.Load())

        holds = masked(self._array(node.test))
        fails = masked(ast.UnaryOp(ast.Invert(), self._array(node.test))) if node.orelse else None
        found += self._block(node.body, holds)
        return found if fails is None else found + self._block(node.orelse, fails)

    def _scatter(self, target: ast.Subscript, value: ast.expr, mask: ast.expr | None) -> list[ast.stmt]:
        """Return the assignment to elements of which several rounds may write one: the largest or smallest value, or one that reads none of them."""
        base, text = target.value, ast.unparse(target)
        match value:
            case ast.Call(func=ast.Name(id=order), args=[same, other]) if (
                order in _REDUCED and ast.unparse(same) == text and mask is None
            ):
                place = self._place(target, self.written)
                return [ast.Expr(_called(_REDUCED[order].replace("reduce", "at"), base, place, self._array(other)))]
        if ast.unparse(base) in ast.unparse(value):
            raise _StaysAsItIs
        return self._put(target, self._array(value), mask)

    def _put(self, target: ast.Subscript, value: ast.expr, mask: ast.expr | None) -> list[ast.stmt]:
        place = self._place(target, self.written)
        if mask is not None:
            value = _called("np.where", mask, value, _at(target.value, place, ast.Load()))
            self.read.add((ast.unparse(target.value), ast.unparse(target.slice)))
        return [ast.Assign([_at(target.value, place, ast.Store())], value)]

    def _change(self, target: ast.Subscript, node: ast.AugAssign, mask: ast.expr | None) -> list[ast.stmt]:
        value = self._array(node.value)
        if not self._varies(target.slice):
            raise _StaysAsItIs
        if isinstance(target.slice, ast.Subscript) or mask is not None:
            if mask is None and type(node.op) in _AT:
                place = self._place(target, self.written)
                return [ast.Expr(_called(_AT[type(node.op)], target.value, place, value))]
            return self._put(
                target, ast.BinOp(self._array(_at(target.value, target.slice, ast.Load())), node.op, value), mask
            )
        place = self._place(target, self.written)
        if not isinstance(place, ast.Slice) and type(node.op) in _AT:
            return [ast.Expr(_called(_AT[type(node.op)], target.value, place, value))]
        return [ast.AugAssign(_at(target.value, place, ast.Store()), node.op, value)]

    def _name(self, name: str, value: ast.expr, mask: ast.expr | None) -> list[ast.stmt]:
        """Return the assignment to a name: the largest or smallest value so far, a fact if it holds anywhere, or an array within the loop."""
        match value:
            case ast.Call(func=ast.Name(id=order), args=[ast.Name(id=same), other]) if (
                order in _REDUCED and same == name and name not in self.local
            ):
                if not self._varies(other):
                    raise _StaysAsItIs
                rest = [ast.keyword("where", mask)] if mask is not None else []
                whole = self._array(other)
                reduced = ast.Call(
                    _name_of(_REDUCED[order]), [whole], [ast.keyword("initial", ast.Name(name, ast.Load())), *rest]
                )
                return [ast.Assign([ast.Name(name, ast.Store())], _called("float", reduced))]
            case ast.Constant() if mask is not None and name not in self.local:
                return [ast.If(_called("np.any", mask), [ast.Assign([ast.Name(name, ast.Store())], value)], [])]
        if name not in self.local and any(isinstance(n, ast.Name) and n.id == name for n in ast.walk(value)):
            raise _StaysAsItIs
        made = self._array(value)
        if mask is not None and name in self.local:
            made = _called("np.where", mask, made, ast.Name(name, ast.Load()))
        if not self._varies(value):
            made = _called("np.full", _name_of(f"max(0, {ast.unparse(self.stop)} - ({ast.unparse(self.start)}))"), made)
        elif isinstance(value, ast.Subscript):
            made = _called("np.array", made)  # values before later assignments
        self.local.add(name)
        return [ast.Assign([ast.Name(name, ast.Store())], made)]

    def _sum(self, name: str, node: ast.AugAssign, mask: ast.expr | None) -> list[ast.stmt]:
        value = self._array(node.value)
        if name in self.local:
            if mask is not None:
                value = _called("np.where", mask, value, ast.Constant(0.0))
            return [ast.Assign([ast.Name(name, ast.Store())], ast.BinOp(ast.Name(name, ast.Load()), node.op, value))]
        if not isinstance(node.op, ast.Add) or self.rounds:
            raise _StaysAsItIs
        if isinstance(node.value, ast.Constant) and mask is not None:
            total: ast.expr = ast.BinOp(_called("int", _called("np.count_nonzero", mask)), ast.Mult(), node.value)
        elif self._varies(node.value):
            rest = [ast.keyword("where", mask)] if mask is not None else []
            total = _called("float", ast.Call(_name_of("np.add.reduce"), [value], rest))
        else:
            raise _StaysAsItIs
        return [ast.AugAssign(ast.Name(name, ast.Store()), ast.Add(), total)]

    # ------------------------------------------------------------ values
    def _varies(self, node: ast.AST) -> bool:
        """Return True if a value differs between the rounds of the loop."""
        return any(isinstance(n, ast.Name) and (n.id == self.index or n.id in self.local) for n in ast.walk(node))

    def _array(self, node: ast.expr) -> ast.expr:
        """Return an expression for the values of all rounds; a number where they are equal."""
        if not self._varies(node):
            changed = self.assigned - self.rounds - {self.index}
            for part in ast.walk(node):
                if isinstance(part, ast.Name) and part.id in changed:
                    raise _StaysAsItIs  # a value of another round
                if isinstance(part, ast.Subscript):
                    self.read.add((ast.unparse(part.value), ast.unparse(part.slice)))
            return node
        match node:
            case ast.Name(id=self.index):
                return _called("np.arange", self.start, self.stop)
            case ast.Name():
                return node
            case ast.Subscript():
                return _at(node.value, self._place(node, self.read), ast.Load())
            case ast.BinOp(left=left, op=op, right=right):
                return ast.BinOp(self._array(left), op, self._array(right))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return ast.UnaryOp(ast.Invert(), self._array(operand))
            case ast.UnaryOp(op=op, operand=operand):
                return ast.UnaryOp(op, self._array(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return ast.Compare(self._array(left), [op], [self._array(right)])
            case ast.BoolOp(op=op, values=[first, *others]):
                found = self._array(first)
                for other in others:
                    found = ast.BinOp(
                        found, ast.BitAnd() if isinstance(op, ast.And) else ast.BitOr(), self._array(other)
                    )
                return found
            case ast.IfExp(test=test, body=body, orelse=orelse):
                if not self._varies(test):
                    return ast.IfExp(test, self._array(body), self._array(orelse))
                return _called("np.where", *map(self._array, (test, body, orelse)))
            case ast.Call(func=ast.Name(id=name), args=arguments) if name in _CALLS:
                values = [self._array(a) for a in arguments]
                return _called(_CALLS[name], *values) if _CALLS[name] else values[0]
        raise _StaysAsItIs

    def _place(self, node: ast.Subscript, uses: set[tuple[str, str]]) -> ast.expr:
        """Return the places of an array in all rounds: a slice, or an array of indices."""
        base = node.value
        if self._varies(base) or isinstance(node.slice, ast.Slice):
            raise _StaysAsItIs
        if isinstance(base, ast.Name) and (base.id in self.lists or isinstance(self.known.get(base.id), tuple)):
            raise _StaysAsItIs
        if not self._varies(node.slice):
            raise _StaysAsItIs
        uses.add((ast.unparse(base), ast.unparse(node.slice)))
        if self._is_shifted(node.slice):
            return ast.Slice(*(self._with(node.slice, bound) for bound in (self.start, self.stop)))
        return self._array(node.slice)

    def _is_shifted(self, node: ast.expr) -> bool:
        """Return True if an index is that of the loop plus something that does not vary."""
        match node:
            case ast.Name(id=self.index):
                return True
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return (self._is_shifted(left) and not self._varies(right)) or (
                    self._is_shifted(right) and not self._varies(left)
                )
            case ast.BinOp(left=left, op=ast.Sub(), right=right):
                return self._is_shifted(left) and not self._varies(right)
        return False

    def _with(self, node: ast.expr, bound: ast.expr) -> ast.expr:
        """Return an index with a bound in the place of the loop's index."""
        index = self.index

        class Put(ast.NodeTransformer):
            def visit_Name(self, node: ast.Name) -> ast.expr:
                return deepcopy(bound) if node.id == index else node

        found: ast.expr = Put().visit(deepcopy(node))
        return found


def _is_literal(node: ast.expr) -> bool:
    """Return True for a number, or the name of one."""
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id.isupper())


def _at(base: ast.expr, place: ast.expr, context: ast.expr_context) -> ast.Subscript:
    return ast.Subscript(base, place, context)


def _name_of(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _called(name: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(_name_of(name), list(arguments), [])
