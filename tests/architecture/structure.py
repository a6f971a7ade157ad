"""Counts of the structure of both packages, read from the syntax trees of their files: import cycles, parameters, types, names and prose."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import networkx as nx

from tests.compiling import ROOT

PACKAGES = ("bondgraph", "compiler")
VAGUE_LOCALS = {"found", "told", "known", "given", "wanted", "kept", "made", "seen", "held", "asked"}
# Words that a term of the field has replaced in all names of modules, classes and functions.
RETIRED = (
    "Asked Because CompiledRadau Drawn End Facts Flow Following Form Found Given Handover Happening Held InMachineCode Known Laid LeftOut Leg Lent Look "
    "Moment Moving NoSlope Numbers Occurrence OneByOne Own Pace Past Placed Prepared Question Script Sharing Shelf Sought Unknown Varying Wanted Watched "
    "Whole Wish along asked asking balances bending bends choice closing crawling described door ended everything flipping forced forms given holding "
    "instants known left_out looks nouns patience piece pieced prepared question scatter scenery shares spin stands stuck subject support telling traffic "
    "walls writing"
)
OPENS_WITH_A_QUESTION = re.compile(r"(What|Where|Which|How|Whether)\b")


@cache
def trees() -> dict[str, ast.Module]:
    """Syntax tree of each file by the dotted name of its module; a package goes by the name of its folder."""
    by_module = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            by_module[module] = ast.parse(path.read_text(encoding="utf-8"))
    return by_module


def is_package(module: str) -> bool:
    return (ROOT / Path(*module.split(".")) / "__init__.py").is_file()


def imported_from(module: str, node: ast.ImportFrom) -> Iterator[str]:
    """Modules that one `from … import …` reaches: the module itself where the name is one, else the module that has the name."""
    package = module.split(".") if is_package(module) else module.split(".")[:-1]
    base = package[: len(package) - node.level + 1] if node.level else []
    origin = ".".join([*base, *(node.module.split(".") if node.module else [])])
    for alias in node.names:
        yield f"{origin}.{alias.name}" if f"{origin}.{alias.name}" in trees() else origin


def reached(module: str, tree: ast.Module) -> Iterator[str]:
    """Modules that a file reaches: by imports at module level, in functions and for types, and by names of modules in strings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from imported_from(module, node)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            named = node.value.partition(":")[0]
            if "." in named:  # the word `bondgraph` alone names no module
                yield named


@cache
def file_imports() -> nx.DiGraph:
    """Directed graph of the files: an edge from each file to each file that it reaches."""
    graph = nx.DiGraph()
    graph.add_nodes_from(trees())
    for module, tree in trees().items():
        graph.add_edges_from((module, other) for other in reached(module, tree) if other in trees() and other != module)
    return graph


def room(module: str) -> str:
    """Folder of a file; a file at the top of a package is a room of its own."""
    folder = module if is_package(module) else module.rpartition(".")[0]
    return module if folder in PACKAGES else folder


def room_imports() -> nx.DiGraph:
    """The graph of the files with those of one folder taken together; the folders in a folder are rooms of their own."""
    graph = nx.DiGraph()
    graph.add_edges_from((room(a), room(b)) for a, b in file_imports().edges if room(a) != room(b))
    return graph


def on_cycles(graph: nx.DiGraph, package: str) -> list[str]:
    """Nodes of a package that lie on a cycle."""
    circles = [part for part in nx.strongly_connected_components(graph) if len(part) > 1]
    return sorted(node for part in circles for node in part if node.split(".")[0] == package)


def functions() -> list[tuple[str, ast.FunctionDef]]:
    return [(m, n) for m, tree in trees().items() for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]


def parameters(function: ast.FunctionDef) -> list[ast.arg]:
    """Parameters but for `self` and `cls`."""
    a = function.args
    return [p for p in (*a.posonlyargs, *a.args, *a.kwonlyargs) if p.arg not in ("self", "cls")]


def functions_with_more_parameters(limit: int) -> list[str]:
    return [f"{m}.{f.name}: {len(parameters(f))}" for m, f in functions() if len(parameters(f)) > limit]


def functions_longer_than(limit: int) -> list[str]:
    lengths = [(f"{m}.{f.name}", (f.end_lineno or 0) - f.lineno) for m, f in functions()]
    return [f"{name}: {length} lines" for name, length in lengths if length > limit]


def files_longer_than(limit: int) -> list[str]:
    lengths = [
        (path, path.read_text(encoding="utf-8").count("\n"))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    ]
    return [f"{path.relative_to(ROOT)}: {length} lines" for path, length in lengths if length > limit]


def share_of_bare_any(package: str) -> float:
    """Share of a package's parameters whose type is `Any` alone."""
    annotations = [p.annotation for m, f in functions() if m.split(".")[0] == package for p in parameters(f)]
    return sum(isinstance(a, ast.Name) and a.id == "Any" for a in annotations) / len(annotations)


def classes_of_one_name() -> dict[str, list[str]]:
    """Names of classes that more than one file defines, and the files."""
    modules = defaultdict(list)
    for module, tree in trees().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                modules[node.name].append(module)
    return {name: places for name, places in modules.items() if len(places) > 1}


def retired_names() -> list[str]:
    """Modules, classes and functions whose whole name is a retired word."""
    named = [(f"{module}.{n.name}", n.name) for module, n in definitions()]
    return [place for place, name in [*named, *((m, m.rpartition(".")[2]) for m in trees())] if name in RETIRED.split()]


def definitions() -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef]]:
    for module, tree in trees().items():
        yield from ((module, n) for n in ast.walk(tree) if isinstance(n, ast.ClassDef | ast.FunctionDef))


def vague_locals() -> int:
    """Assignments to names that do not say what they hold."""
    nodes = (n for tree in trees().values() for n in ast.walk(tree) if isinstance(n, ast.Name))
    return sum(isinstance(n.ctx, ast.Store) and n.id in VAGUE_LOCALS for n in nodes)


def docstrings_that_open_with_a_question() -> list[str]:
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return [
        f"{module}: {text.splitlines()[0]}"
        for module, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, documented) and OPENS_WITH_A_QUESTION.match(text := ast.get_docstring(node) or "")
    ]


def lines() -> int:
    """Lines of Python of both packages."""
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
