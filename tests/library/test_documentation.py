"""Every part is documented as it is: descriptions in its file, from which the README has its tables."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import bondgraph
from bondgraph.catalogue import interface_of, parts_of
from compiler.source import Source
from compiler.syntax import parse, tree
from tests.conftest import Golden
from tests.library.bench import LIBRARY

FILES = sorted(LIBRARY.glob("*.bg"))
BAR = r"\|"
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
    assert [f.stem for f in FILES] == [
        "control", "drivetrain", "electric", "hydraulic", "machines", "magnetic", "mechanics", "mems", "pneumatic", "power", "signals", "thermal",
    ]  # fmt: skip


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_nothing_is_wrong_with_a_file(file: Path) -> None:
    assert bondgraph.check(file) == ()


@pytest.mark.parametrize(("file", "model"), PARTS)
def test_a_part_says_what_it_is(file: Path, model: tree.ModelSyntax) -> None:
    assert isinstance(model.statements[0], tree.Description), "one line on what it is"
    assert all(p.domain for p in ports(model)), "every port has its domain"
    defaults = [i.name for i in items(model, "parameter") if i.value is None]
    without = {"Flexure": 3, "Rope": 1}  # three stiffnesses; a length that is zero or not by what is bonded
    assert len(defaults) == without.get(model.name, 0), f"{defaults} have no default"


def parts_table() -> str:
    """The tables of the README, made of the files alone."""
    found = []
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        rows = ["| part | ports | law | source |", "|---|---|---|---|"]
        for part in parts_of(file):
            ports = " ".join(f">{p.name}" if p.enters else f"{p.name}>" for p in interface_of(part).ports)
            cells = (f"`{part.name}`", ports, part.law, part.source)
            rows.append(f"| {' | '.join(c.replace('|', BAR) for c in cells)} |")
        found.append("\n".join([f"## {file.stem}", "", text.split('"')[1], "", *rows]))
    return "\n\n".join(found)


def test_the_readme_has_the_tables_of_the_files(golden: Golden) -> None:
    """`--update-golden` renews them."""
    before, mark, rest = README.partition("<!-- parts -->\n")
    assert mark
    golden(LIBRARY / "README.md", before + mark + parts_table() + "\n" + rest[rest.index("<!-- end -->") :])


def test_what_the_readme_shows_is_right() -> None:
    (example,) = re.findall(r"```bg\n(model.*?)```", README, re.DOTALL)
    assert bondgraph.check(example) == ()
