"""READMEs of rooms: files that they name exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.compiling import ROOT

READMES = sorted(path for package in ("bondgraph", "compiler") for path in (ROOT / package).rglob("README.md"))
PYTHON_FILE = re.compile(r"`([\w/]+\.py)`")


def exists(name: str, room: Path) -> bool:
    """True for a file of the room or of a folder in it, or a path from a package or from the room above."""
    return any(room.rglob(name)) or any(
        (base / name).is_file() for base in (ROOT, ROOT / "bondgraph", ROOT / "compiler", room.parent)
    )


@pytest.mark.parametrize("readme", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_a_readme_names_exist(readme: Path) -> None:
    names = PYTHON_FILE.findall(readme.read_text(encoding="utf-8"))
    assert [name for name in names if not exists(name, readme.parent)] == []


def test_the_walks_name_files() -> None:
    """The two packages show their layers, and the way of one law through them."""
    for package in ("bondgraph", "compiler"):
        text = (ROOT / package / "README.md").read_text(encoding="utf-8")
        assert len(set(PYTHON_FILE.findall(text))) >= 8 and "spring" in text
