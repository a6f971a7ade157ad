"""Direction of imports: one arrow from the product to the compiler, to its api; rooms in the order of the pipeline."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from compiler import api
from tests.compiling import ROOT

COMPILER = sorted((ROOT / "compiler").rglob("*.py"))
PRODUCT = sorted((ROOT / "bondgraph").rglob("*.py"))


def imports(path: Path) -> Iterator[tuple[str, int]]:
    """Absolute names of everything a module imports, and the lines."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            origin = ".".join(x for x in (base, node.module or "") if x)
            yield from (
                [(f"compiler.{a.name}", node.lineno) for a in node.names]
                if origin == "compiler"
                else [(origin, node.lineno)]
            )
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "import_module":
            yield from ((str(a.value), node.lineno) for a in node.args[:1] if isinstance(a, ast.Constant))


def of(path: Path, package: str) -> list[str]:
    return [f"{path.relative_to(ROOT)}:{line}: {name}" for name, line in imports(path) if name.split(".")[0] == package]


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_there_is_something_to_look_at() -> None:
    assert len(COMPILER) > 40 and len(PRODUCT) > 10
    assert any(of(path, "compiler") for path in PRODUCT), "the reader of imports does not see them"


@pytest.mark.parametrize("path", COMPILER, ids=name)
def test_the_compiler_knows_nothing_of_the_product(path: Path) -> None:
    assert of(path, "bondgraph") == []


@pytest.mark.parametrize("path", PRODUCT, ids=name)
def test_the_product_imports_the_api_alone(path: Path) -> None:
    assert [found for found in of(path, "compiler") if not found.endswith(": compiler.api")] == []


def test_the_api_names_what_is_used() -> None:
    """No more, and each is found."""
    nodes = [n for p in PRODUCT for n in ast.walk(ast.parse(p.read_text(encoding="utf-8")))]
    used = {n.attr for n in nodes if isinstance(n, ast.Attribute)}
    used |= {a.name for n in nodes if isinstance(n, ast.ImportFrom) and n.module == "compiler.api" for a in n.names}
    assert [name for name in dir(api) if name not in used or getattr(api, name) is None] == []


@pytest.mark.parametrize("script", ["script.py", "compiler.py"])
def test_a_file_that_hides_the_compiler_is_named(script: str, tmp_path: Path) -> None:
    (tmp_path / "compiler.py").write_text("raise SystemExit('it was run')\n", encoding="utf-8")
    (tmp_path / script).write_text("import bondgraph\nbondgraph.load('model a {}')\n", encoding="utf-8")
    command = [sys.executable, str(tmp_path / script)]
    done = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    sentence = f"ImportError: bondgraph needs its own package `compiler`, but Python found {tmp_path / 'compiler.py'} first: rename that file"
    assert done.stderr.splitlines()[-1] == sentence


# Each room, and what it may import of the others. `algebra`, `errors`, `source` and `graph` (nouns) serve all.
ROOMS = {
    "algebra": set(),
    "syntax": set(),
    "graph": {"algebra"},
    "semantics": {"syntax", "graph", "algebra"},
    "multibody": {"graph", "algebra"},
    "causality": {"multibody", "graph", "algebra"},  # which ports of a mechanism may be driven
    "equations": {"causality", "multibody", "graph", "algebra"},
    "reduction": {"equations", "algebra"},
    "codegen": {"reduction", "equations", "algebra", "jit"},
    "jit": set(),
    "linking": set(),
    "metamorphosis": {"semantics", "syntax", "graph", "algebra"},
    "unparse": {"semantics", "syntax", "graph", "algebra"},
}


def test_every_room_is_listed() -> None:
    found = {p.name for p in (ROOT / "compiler").iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert found == set(ROOMS)


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_rooms_import_in_the_order_of_the_pipeline(room: str) -> None:
    allowed = ROOMS[room] | {
        room,
        "arrays",
        "fast_dataclass",
        "errors",
        "source",
        "scene",
        "solvers",
        "steps",
        "garbage_collection",
        "persistent_cache",
        "certificate",
        "chance",
    }
    found = []
    for path in sorted((ROOT / "compiler" / room).rglob("*.py")):
        for imported, line in imports(path):
            parts = imported.split(".")
            if parts[0] == "compiler" and len(parts) > 1 and parts[1] not in allowed:
                found.append(f"{name(path)}:{line}: {imported}")
    assert found == []


RUN_ONCE = {
    ROOT / "compiler" / "fast_dataclass.py": ["exec"],  # of the names of our own classes' fields, as `dataclasses` does
    ROOT / "compiler" / "jit" / "vectorise.py": [
        "exec"
    ],  # of our own source of the steps, loops written as array operations
    ROOT / "bondgraph" / "manual" / "running.py": ["exec"],  # of the Python that our own pages show
}


@pytest.mark.parametrize("path", [*COMPILER, *PRODUCT], ids=name)
def test_no_text_is_ever_run(path: Path) -> None:
    """A file is data: nothing named eval, exec, sympify or parse_expr is called or imported, no text is compiled but generated code."""
    forbidden = {"eval", "exec", "sympify", "parse_expr", "execfile"}
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in forbidden:
                found.append(called)
        elif isinstance(node, ast.ImportFrom):
            found += [a.name for a in node.names if a.name in forbidden]
    assert found == RUN_ONCE.get(path, [])


CALLS_MACHINE_CODE = ("compiler/jit/machine.py", "compiler/codegen/llvm/evaluate.py")


@pytest.mark.parametrize("path", COMPILER, ids=name)
def test_the_compiler_opens_nothing_but_bg_files(path: Path) -> None:
    """No network, no processes, no environment; files are read in the room of imports, the command line and the grammar only."""
    outside = {
        "socket",
        "urllib",
        "http",
        "subprocess",
        "os",
        "shutil",
        "ctypes",
        "pickle",
        "marshal",
        "requests",
        "tempfile",
    }
    if name(path) in CALLS_MACHINE_CODE:
        outside.discard("ctypes")
    assert [n for n, _ in imports(path) if n.split(".")[0] in outside] == []
