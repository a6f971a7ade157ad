"""Switches: a module that holds all its mutants of a sample, of which one at most acts, and that tells which it passed."""

from __future__ import annotations

import ast
import builtins
import importlib
import linecache
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType

from tests.mutation.mutants import Mutant

SWITCH = "__mutant__"  # a builtin: `changed if __mutant__(7) else original`
Step = tuple[str, int]  # a field of a node, and the place in it; -1 where it is no list


@dataclass(slots=True)
class Switch:
    """The mutant that acts, and those that the code passed since `passed` was cleared."""

    active: int | None = None
    passed: set[int] = field(default_factory=set)

    def __call__(self, number: int) -> bool:
        self.passed.add(number)
        return number == self.active


def children(node: ast.AST) -> list[tuple[Step, ast.AST]]:
    """Steps to the nodes right below one, with the nodes."""
    found: list[tuple[Step, ast.AST]] = []
    for name, value in ast.iter_fields(node):
        if isinstance(value, ast.AST):
            found.append(((name, -1), value))
        elif isinstance(value, list):
            found += [((name, place), v) for place, v in enumerate(value) if isinstance(v, ast.AST)]
    return found


def difference(original: ast.AST, changed: ast.AST) -> list[Step]:
    """Steps to the smallest node that holds all in which two trees differ."""
    steps: list[Step] = []
    while True:
        left, right = children(original), children(changed)
        if type(original) is not type(changed) or [s for s, _ in left] != [s for s, _ in right]:
            return steps
        pairs = zip(left, right, strict=True)
        differing = [(s, a, b) for (s, a), (_, b) in pairs if ast.dump(a) != ast.dump(b)]
        if len(differing) != 1:
            return steps
        step, original, changed = differing[0]
        steps.append(step)


def below(node: ast.AST, step: Step) -> ast.AST:
    value = getattr(node, step[0])
    result = value if step[1] < 0 else value[step[1]]
    assert isinstance(result, ast.AST)
    return result


def switched_place(tree: ast.AST, steps: Sequence[Step]) -> list[Step]:
    """Steps to the expression that a switch can replace, else to the statement."""
    nodes = [tree]
    for step in steps:
        nodes.append(below(nodes[-1], step))
    statement = max(i for i, node in enumerate(nodes) if isinstance(node, ast.stmt))
    last = statement
    for i in range(statement + 1, len(nodes)):
        if isinstance(nodes[i], ast.expr):
            last = i
        elif not isinstance(nodes[i], ast.keyword | ast.comprehension | ast.operator | ast.cmpop | ast.boolop):
            return list(steps[: last if isinstance(nodes[i], ast.arguments) else statement])
    return list(steps[:last])


def replaced(original: ast.AST, changed: ast.AST, number: int) -> ast.AST:
    """Both nodes behind the switch of a mutant."""
    asked = ast.Call(ast.Name(SWITCH, ast.Load()), [ast.Constant(number)], [])
    if isinstance(original, ast.expr):
        assert isinstance(changed, ast.expr)
        result: ast.AST = ast.IfExp(asked, changed, original)
    else:
        assert isinstance(original, ast.stmt) and isinstance(changed, ast.stmt)
        result = ast.If(asked, [changed], [original])
    return ast.copy_location(result, original)


def switched(source: str, mutants: Iterable[tuple[int, Mutant]]) -> ast.Module:
    """The module with a switch for each of its mutants, lines as they are."""
    tree = ast.parse(source)
    places: list[tuple[list[Step], ast.AST, int]] = []
    for number, mutant in mutants:
        changed: ast.AST = ast.parse(mutant.applied(source))
        steps = switched_place(tree, difference(tree, changed))
        for step in steps:
            changed = below(changed, step)
        places.append((steps, changed, number))
    for steps, changed, number in sorted(places, key=lambda place: -len(place[0])):  # inner ones first
        parent: ast.AST = tree
        for step in steps[:-1]:
            parent = below(parent, step)
        name, place = steps[-1]
        new = replaced(below(parent, steps[-1]), changed, number)
        if place < 0:
            setattr(parent, name, new)
        else:
            getattr(parent, name)[place] = new
    return ast.fix_missing_locations(tree)


class SwitchingLoader(SourceFileLoader):
    """Loader of a module with its mutants; the file stays as it is, for those that read the source of a function."""

    def __init__(self, name: str, path: str, mutants: list[tuple[int, Mutant]]) -> None:
        super().__init__(name, path)
        self.mutants = mutants

    def get_code(self, fullname: str) -> CodeType:
        source = Path(self.path).read_text(encoding="utf-8")
        return compile(switched(source, self.mutants), self.path, "exec", dont_inherit=True)


class SwitchingFinder(MetaPathFinder):
    """Finder of the modules in which a mutant of the sample lies."""

    def __init__(self, root: Path, mutants: Iterable[tuple[int, Mutant]]) -> None:
        self.files: dict[str, list[tuple[int, Mutant]]] = {}
        for number, mutant in mutants:
            self.files.setdefault(str(root / mutant.path), []).append((number, mutant))

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path) if fullname.startswith(("compiler", "bondgraph")) else None
        if spec is None or spec.origin not in self.files:
            return None
        spec.loader = SwitchingLoader(fullname, spec.origin, self.files[spec.origin])
        return spec


@dataclass(frozen=True, slots=True)
class Installed:
    """Modules with their mutants: those that are imported from now on, and the switch between them."""

    root: Path
    mutants: Mapping[int, Mutant]
    switch: Switch

    def act(self, number: int | None) -> None:
        """Let one mutant act, or none, also for those that read the text of a function: what becomes machine code."""
        linecache.clearcache()
        self.switch.active = number
        if number is not None:
            path = self.root / self.mutants[number].path
            text = self.mutants[number].applied(path.read_text(encoding="utf-8"))
            linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))


def install(root: Path, mutants: Mapping[int, Mutant]) -> Installed:
    installed = Installed(root, mutants, Switch())
    setattr(builtins, SWITCH, installed.switch)
    sys.meta_path.insert(0, SwitchingFinder(root, mutants.items()))
    return installed


def allow_switches_in_compiled_functions() -> None:
    """Compile the text of a function even if its code has switches, which looks like a file that has changed."""
    source = importlib.import_module("compiler.jit.source")
    source._content = lambda code: ()
