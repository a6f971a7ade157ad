"""Functions in a small subset of Python to LLVM IR as text.

The subset: floats, integers, booleans, one-dimensional arrays, records (dataclasses of these), functions as arguments; assignments,
arithmetic, comparisons, `if`, `while`, `for … in range(…)`, calls of other such functions and of some of `math`. A slice `x[k:]` is the
array from there on. The same source runs as plain Python over numpy arrays, with the same numbers bit by bit: nothing is reordered, nothing
is contracted. Anything outside of the subset is a `TranslationError` with its line.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from typing import Any

from .kinds import BOOL, INT, NOTHING, TranslationError, Value, text_of
from .values import EVERYTHING, Choices, SubsetModule, ValueWriter, apart

LONGEST_INLINED = 200  # lines of a function that may become a part of its only caller: LLVM takes longer for both as one, and runs are no faster


def translate(exported: Sequence[Callable[..., Any]], choices: Choices = EVERYTHING) -> str:
    """Text of a module with these functions and all that they call. The names of the exported ones are visible."""
    module = SubsetModule(choices)
    for function in exported:
        module.need(function)
    names = {function.__name__ for function in exported}
    bodies: list[str] = []
    while module.waiting:
        bodies.append(_Function(module, module.waiting.pop(), names).text())
    return "\n".join(
        [*module.constants.values(), *module.declared.values(), *bodies, *apart(), *module.scalar_loops, ""]
    )


class _Function(ValueWriter):
    """Writer of one function."""

    def text(self) -> str:
        """Definition of the function."""
        names = [a.arg for a in self.tree.args.args]
        for name, kind in zip(names, self.arguments, strict=True):
            self._variable(name, kind)
            self.lines.append(f"  store {text_of(kind)} %{name}, ptr %{name}.v")
        self._block(self.tree.body)
        if not self.ended:
            if self.result != NOTHING:
                raise TranslationError(f"`{self.tree.name}` ends without a value")
            self.lines.append("  ret void")
        given = ", ".join(f"{text_of(k)} %{n}" for n, k in zip(names, self.arguments, strict=True))
        linkage = "" if self.exported else "internal "
        whole = "noinline " if len(self.lines) > LONGEST_INLINED else ""
        head = f"define {linkage}{text_of(self.result)} @{self.tree.name}({given}) {whole}{{"
        return "\n".join([head, "entry:", *self.opening, *self.lines, "}"])

    # ------------------------------------------------------------ statements
    def _block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            if self.ended:
                return
            self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value=ast.Call() as call):
                self._call(call)
            case ast.Assign(targets=[target]):
                self._assign(target, self._value(node.value))
            case ast.AnnAssign(target=target, value=value) if value is not None:
                self._assign(target, self._value(value))
            case ast.AugAssign(target=ast.Subscript() as target):
                place = self._place(target)
                assert place is not None
                self._store(place, self._binary(node.op, self._load(place), self._value(node.value), node), node)
            case ast.AugAssign(target=target):
                self._assign(target, self._binary(node.op, self._value(target), self._value(node.value), node))
            case ast.If():
                self._if(node)
            case ast.While():
                self._while(node)
            case ast.For():
                self._for(node)
            case ast.Return(value=value):
                self._return(value, node)
            case ast.Break() | ast.Continue():
                self._go(self.loops[-1][isinstance(node, ast.Break)])
            case _:
                raise self._fail(node, f"{type(node).__name__} is not in the subset")

    def _return(self, value: ast.expr | None, node: ast.stmt) -> None:
        if value is None:
            self.lines.append("  ret void")
        else:
            found = self._as(self._value(value), self.result, node)
            self.lines.append(f"  ret {text_of(self.result)} {found.text}")
        self.ended = True

    def _assign(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._variable(target.id, value.kind)
            self._store(Value(self.variables[target.id], f"%{target.id}.v"), value, target)
            return
        place = self._place(target)
        if place is None:
            raise self._fail(target, "this cannot be assigned to")
        self._store(place, value, target)

    def _if(self, node: ast.If) -> None:
        yes, no, end = self._labels("yes", "no", "end")
        self._branch(self._truth(node.test), yes, no)
        self._start(yes)
        self._block(node.body)
        self._go(end)
        self._start(no)
        self._block(node.orelse)
        self._go(end)
        self._start(end)

    def _while(self, node: ast.While) -> None:
        test, body, end = self._labels("test", "body", "end")
        self._start(test)
        self._branch(self._truth(node.test), body, end)
        self._loop(node.body, body, test, end)
        self._go(test)
        self._start(end)

    def _loop(self, statements: Sequence[ast.stmt], body: str, again: str, end: str) -> None:
        self.loops.append((again, end))
        self._start(body)
        self._block(statements)
        self.loops.pop()

    def _for(self, node: ast.For) -> None:
        match node:
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=bounds)):
                pass
            case _:
                raise self._fail(node, "only `for name in range(…)`")
        numbers = [self._as(self._value(b), INT, node) for b in bounds]
        start = numbers[0] if len(numbers) > 1 else Value(INT, "0")
        stop = numbers[1] if len(numbers) > 1 else numbers[0]
        step = numbers[2].text if len(numbers) > 2 else "1"
        if not step.lstrip("-").isdigit():
            raise self._fail(node, "the step of a range must be a number")
        test, body, again, end = self._labels("test", "body", "again", "end")
        counter = f"for.{test}"
        self._variable(counter, INT)
        self._variable(name, INT)
        self.lines.append(f"  store i64 {start.text}, ptr %{counter}.v")
        self._start(test)
        at = self._load(Value(INT, f"%{counter}.v"))
        order = "sgt" if step.startswith("-") else "slt"
        self._branch(self._emit(BOOL, f"icmp {order} i64 {at.text}, {stop.text}"), body, end)
        self.loops.append((again, end))
        self._start(body)
        self.lines.append(f"  store i64 {at.text}, ptr %{name}.v")
        self._block(node.body)
        self.loops.pop()
        self._start(again)
        next_one = self._emit(INT, f"add nsw i64 {at.text}, {step}")
        self.lines.append(f"  store i64 {next_one.text}, ptr %{counter}.v")
        self._go(test)
        if not self.module.choices.in_vectors(self.function):
            self.lines[-1] += self.module.scalar_loop()
        self._start(end)
