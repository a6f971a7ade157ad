"""Layout of the repository: the folders, and a description in every room."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.compiling import ROOT

ALLOWED = {
    "pyproject.toml",
    "bondgraph",
    "models",
    "compiler",
    "tests",
    "README.md",
    "LICENSE",
    "CITATION.cff",
    "Containerfile",
    ".ci",
    ".gitignore",
    ".git",
}
ROOMS = sorted(p for p in [ROOT / "compiler", *(ROOT / "compiler").iterdir()] if p.is_dir() and p.name != "__pycache__")
MODULES = sorted([*(ROOT / "compiler").rglob("*.py"), *(ROOT / "bondgraph").rglob("*.py")])


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def ignored(names: set[str]) -> set[str]:
    """Those that git ignores."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        patterns = [line.strip().rstrip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()]
        return {n for n in names if n in patterns or any(p.startswith("*") and n.endswith(p[1:]) for p in patterns)}
    done = subprocess.run(
        ["git", "-C", str(ROOT), "check-ignore", *sorted(names)], capture_output=True, text=True, check=False
    )
    return set(done.stdout.split())


def test_the_top_of_the_house() -> None:
    found = {p.name for p in ROOT.iterdir()}
    assert found - ALLOWED - ignored(found - ALLOWED) == set()
    assert {"pyproject.toml", "bondgraph", "models", "compiler", "tests", "README.md", "LICENSE"} <= found


@pytest.mark.parametrize("room", ROOMS, ids=name)
def test_every_room_has_a_readme(room: Path) -> None:
    """The README describes the room: its input and its output."""
    text = (room / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) >= 25


def test_tests_are_no_packages() -> None:
    """A tests/compiler/__init__.py would hide the package."""
    assert list((ROOT / "tests").rglob("__init__.py")) == []


def test_test_folders_are_named_after_rooms() -> None:
    rooms = (
        {p.name for p in ROOMS}
        | {p.name for p in (ROOT / "bondgraph" / "presentation").iterdir()}
        | {p.name for p in (ROOT / "bondgraph").iterdir()}
        | {p.stem for p in (ROOT / "bondgraph").iterdir()}
    )
    others = {
        "golden",
        "errors",
        "physics",
        "architecture",
        "benchmarks",
        "acceptance",
        "metamorphic",
        "gallery",
        "published",
        "graphs",
        "second_opinion",
        "stress",
        "mutation",
    }
    found = {
        p.name for p in (ROOT / "tests").iterdir() if p.is_dir() and p.name != "__pycache__" and any(p.rglob("*.py"))
    }
    assert found - rooms - others == set()


@pytest.mark.parametrize("path", MODULES, ids=name)
def test_a_module_says_its_role(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", sorted((ROOT / "compiler").glob("*/**/errors.py")), ids=name)
def test_codes_of_errors(path: Path) -> None:
    """Every diagnostic has a code of its room's range, a title and an advice; no code is used twice."""
    ranges = {
        "syntax": "0",
        "semantics": "1",
        "graph": "2",
        "multibody": "2",
        "causality": "3",
        "equations": "4",
        "reduction": "5",
        "codegen": "6",
        "unparse": "7",
    }
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            values = {
                t.id: s.value
                for s in node.body
                if isinstance(s, ast.Assign)
                for t in s.targets
                if isinstance(t, ast.Name)
            }
            code = values["code"]
            assert isinstance(code, ast.Constant) and re.fullmatch(
                rf"BG{ranges[path.relative_to(ROOT).parts[1]]}\d\d", str(code.value)
            ), node.name
            worded = [base.id for base in node.bases if isinstance(base, ast.Name)] == ["WordedDiagnostic"]
            assert worded or ("title" in values and "advice" in values), node.name


def test_no_code_is_used_twice() -> None:
    found: dict[str, str] = {}
    for path in (ROOT / "compiler").rglob("errors.py"):
        for match in re.finditer(
            r'^class (\w+)\((?:Worded)?Diagnostic\):.*?code = "(BG\d+)"',
            path.read_text(encoding="utf-8"),
            re.MULTILINE | re.DOTALL,
        ):
            assert match.group(2) not in found, f"{match.group(2)}: {found[match.group(2)]} and {match.group(1)}"
            found[match.group(2)] = match.group(1)
    assert len(found) > 30


@pytest.mark.parametrize("path", MODULES, ids=name)
def test_names_of_modules(path: Path) -> None:
    """No `utils`, `helpers`, `common`, `manager`."""
    assert not {"utils", "util", "helpers", "helper", "common", "manager", "misc"} & set(
        path.relative_to(ROOT).with_suffix("").parts
    )


def functions_of(path: Path) -> dict[str, ast.FunctionDef]:
    """The functions and methods of a test file, and those of other files of tests/ that it imports."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {n.name: n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tests."):
            names = {a.name for a in node.names}
            file = ROOT.joinpath(*(node.module or "").split(".")).with_suffix(".py")
            body = ast.parse(file.read_text(encoding="utf-8")).body if file.is_file() else []
            imported = [n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name in names]
            found |= {n.name: n for i in imported for n in ast.walk(i) if isinstance(n, ast.FunctionDef)}
    return found


@pytest.mark.parametrize("path", sorted((ROOT / "tests").rglob("test_*.py")), ids=name)
def test_a_test_can_fail(path: Path) -> None:
    """Every test asserts, raises, or hands on to something that does."""
    functions = functions_of(path)

    def checks(node: ast.AST, seen: frozenset[str]) -> bool:
        for inner in ast.walk(node):
            if isinstance(inner, ast.Assert | ast.Raise):
                return True
            if isinstance(inner, ast.Call):
                called = inner.func.attr if isinstance(inner.func, ast.Attribute) else getattr(inner.func, "id", "")
                if called in ("raises", "golden", "fail") or called.startswith("assert_"):
                    return True
                if called in functions and called not in seen and checks(functions[called], seen | {called}):
                    return True
        return False

    assert [n for n, f in functions.items() if n.startswith("test_") and not checks(f, frozenset({n}))] == []
