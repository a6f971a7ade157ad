"""Every part is documented as it is: descriptions in its file, its ports and parameters in the README."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import bondgraph
from compiler.source import Source
from compiler.syntax import parse, tree
from tests.library.bench import LIBRARY

FILES = sorted(LIBRARY.glob("*.bg"))
README = (LIBRARY / "README.md").read_text(encoding="utf-8")


def models(file: Path) -> list[tree.ModelSyntax]:
    """The models of a file."""
    return [
        s
        for s in parse(Source(file.name, file.read_text(encoding="utf-8"), file)).statements
        if isinstance(s, tree.ModelSyntax)
    ]


PARTS = [pytest.param(file, model, id=f"{file.stem}.{model.name}") for file in FILES for model in models(file)]


def items(model: tree.ModelSyntax, role: str) -> list[tree.Item]:
    return [i for s in model.statements if isinstance(s, tree.Quantities) and s.role == role for i in s.items]


def ports(model: tree.ModelSyntax) -> list[tree.PortItem]:
    return [i for s in model.statements if isinstance(s, tree.PortsSyntax) for i in s.items]


def test_the_library_is_there() -> None:
    assert [f.stem for f in FILES] == ["control", "electric", "hydraulic", "mechanics", "mems", "thermal"]


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_nothing_is_wrong_with_a_file(file: Path) -> None:
    assert bondgraph.check(file) == ()


@pytest.mark.parametrize(("file", "model"), PARTS)
def test_a_part_says_what_it_is(file: Path, model: tree.ModelSyntax) -> None:
    assert isinstance(model.statements[0], tree.Description), "one line on what it is"
    assert all(p.domain for p in ports(model)), "every port has its domain"
    defaults = [i.name for i in items(model, "parameter") if i.value is None]
    assert not defaults or model.name == "Flexure", f"{defaults} have no default"


@pytest.mark.parametrize(("file", "model"), PARTS)
def test_a_part_is_in_the_readme_with_its_ports_and_parameters(file: Path, model: tree.ModelSyntax) -> None:
    section = README.split(f"\n## {file.stem}\n")[1].split("\n## ")[0]
    (row,) = [line for line in section.splitlines() if line.startswith(f"| `{model.name}` |")]
    cells = re.split(r"(?<!\\)\|", row)[2:-1]
    if file.stem == "control":
        inputs, outputs, parameters = cells[:3]
        assert [i.strip() for i in inputs.split(",")] == [i.name for i in items(model, "input")]
        assert [o.strip() for o in outputs.split(",")] == [o.name for o in items(model, "output")]
    else:
        drawn, parameters = cells[:2]
        assert re.findall(r"\w+", drawn.replace("(planar)", "")) == [p.name for p in ports(model)]
        assert re.findall(r"`(\w+)`", parameters.partition("input")[2]) == [i.name for i in items(model, "input")]
    names = re.findall(r"`(\w+)`", parameters.partition("input")[0])
    assert sorted(names) == sorted(i.name for i in items(model, "parameter"))


def test_the_readme_names_nothing_else() -> None:
    known = {p.values[1].name for p in PARTS}
    assert set(re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE)) == known
