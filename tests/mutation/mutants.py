"""Mutants: copies of a source text in which one operator, constant or condition is changed."""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

OPERATORS: dict[type[ast.AST], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/", "+")),
    ast.Div: ("/", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.MatMult: ("@", ("*",)),
    ast.BitAnd: ("&", ("|",)),
    ast.BitOr: ("|", ("&",)),
    ast.Lt: ("<", ("<=", ">")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
    ast.And: ("and", ("or",)),
    ast.Or: ("or", ("and",)),
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one file: the text between two offsets becomes another."""

    path: str  # relative to the repository
    line: int
    start: int
    end: int
    before: str
    after: str

    def applied(self, text: str) -> str:
        return text[: self.start] + self.after + text[self.end :]

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.before} -> {self.after}"


class Text:
    """A source text with the offset of each line and column (columns of `ast` count bytes)."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.lines = text.splitlines(keepends=True)
        self.starts = [0]
        for line in self.lines:
            self.starts.append(self.starts[-1] + len(line))

    def offset(self, line: int, column: int) -> int:
        return self.starts[line - 1] + len(self.lines[line - 1].encode()[:column].decode())

    def span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return self.offset(node.lineno, node.col_offset), self.offset(node.end_lineno, node.end_col_offset)


def changed_constant(value: object) -> list[str]:
    """Other constants of the same type."""
    if isinstance(value, bool):
        return [str(not value)]
    if isinstance(value, int):
        return [str(value + 1), str(value - 1)]
    if isinstance(value, float):
        return [repr(2 * value), repr(value / 2)] if value else ["1.0"]
    return []


def names_a_type(node: ast.expr) -> bool:
    name = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")
    return (
        name[:1].isupper()
        or name in ("int", "float", "str", "bool")
        or (isinstance(node, ast.Constant) and node.value is None)
    )


def without_effect_by_kind(tree: ast.Module) -> set[ast.AST]:
    """Nodes that no test can see changed: types, imports for types, sentences of messages."""
    hidden: set[ast.AST] = set()
    for node in ast.walk(tree):
        roots: list[ast.AST | None] = []
        if isinstance(node, ast.FunctionDef):
            roots = [node.returns, *(a.annotation for a in ast.walk(node.args) if isinstance(a, ast.arg))]
        elif isinstance(node, ast.AnnAssign):
            roots = [node.annotation]
        elif (
            (isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING")
            or isinstance(node, ast.JoinedStr)
            or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr) and names_a_type(node.right))
        ):
            roots = [node]
        for root in roots:
            hidden |= set(ast.walk(root)) if root is not None else set()
    return hidden


def between(text: Text, left: ast.expr, right: ast.expr, symbol: str) -> tuple[int, int] | None:
    """Place of an operator between its operands; None if brackets or comments hide it."""
    start, end = text.span(left)[1], text.span(right)[0]
    gap = text.text[start:end]
    if gap.count(symbol) != 1 or "#" in gap:
        return None
    at = start + gap.index(symbol)
    return at, at + len(symbol)


def places(tree: ast.Module, text: Text) -> Iterator[tuple[int, int, int, tuple[str, ...]]]:
    """Line, start, end and replacements of all that can be changed."""
    hidden = without_effect_by_kind(tree)
    for node in ast.walk(tree):
        if node in hidden:
            continue
        found: list[tuple[ast.expr, ast.expr, ast.AST]] = []
        if isinstance(node, ast.BinOp):
            found = [(node.left, node.right, node.op)]
        elif isinstance(node, ast.BoolOp):
            found = [(a, b, node.op) for a, b in zip(node.values, node.values[1:], strict=False)]
        elif isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            found = list(zip(operands, operands[1:], node.ops, strict=False))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            start, _ = text.span(node)
            yield node.lineno, start, text.span(node.operand)[0], ("",)
        elif isinstance(node, ast.Constant) and (others := changed_constant(node.value)):
            yield node.lineno, *text.span(node), tuple(others)
        elif isinstance(node, ast.If | ast.While | ast.IfExp):
            start, end = text.span(node.test)
            yield node.test.lineno, start, end, (f"(not ({text.text[start:end]}))",)
        for left, right, op in found:
            symbol, replacements = OPERATORS.get(type(op), ("", ()))
            if symbol and (where := between(text, left, right, symbol)):
                yield left.lineno, *where, replacements


def candidates(root: Path, path: Path) -> list[Mutant]:
    """Changes of one file, Python or not."""
    source = path.read_text(encoding="utf-8")
    text, name = Text(source), str(path.relative_to(root))
    return [
        Mutant(name, line, start, end, source[start:end], after)
        for line, start, end, replacements in places(ast.parse(source), text)
        for after in replacements
    ]


def is_python(mutant: Mutant, source: str) -> bool:
    try:
        compile(mutant.applied(source), mutant.path, "exec")
    except (SyntaxError, ValueError):
        return False
    return True


def mutants_of(root: Path, path: Path) -> list[Mutant]:
    """All mutants of one file that are Python still."""
    source = path.read_text(encoding="utf-8")
    return [m for m in candidates(root, path) if is_python(m, source)]


def chosen(root: Path, folders: tuple[str, ...], number: int, seed: int) -> list[Mutant]:
    """A random sample of the mutants of all files below some folders, in random order: each place is as likely as any other."""
    paths = sorted(p for folder in folders for p in (root / folder).rglob("*.py"))
    everything = [m for path in paths for m in candidates(root, path)]
    random.Random(seed).shuffle(everything)
    python = (m for m in everything if is_python(m, (root / m.path).read_text(encoding="utf-8")))
    return list(islice(python, number))
