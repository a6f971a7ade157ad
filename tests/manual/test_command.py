"""`bondgraph manual`: the page, section or search of a word; one build for each state of the code; refusals with advice."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands, manual

PAGES = {"index": "", "errors": '<section id="bg301">', "how_to/fit": "", "commands": '<section id="fit">'}


@pytest.fixture
def builds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders that were built, each with a few pages; a cache folder of its own, and no display."""
    folders: list[Path] = []

    def build(folder: Path) -> Path:
        folders.append(folder)
        for name, text in PAGES.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / f"{name}.html").write_text(text, encoding="utf-8")
        return folder

    monkeypatch.setattr(manual, "build", build)
    monkeypatch.setenv("BONDGRAPH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return folders


@pytest.mark.parametrize(
    ("word", "address"),
    [(None, "index.html"), ("BG301", "errors.html#bg301"), ("fit", "how_to/fit.html"), ("pull-in", "search.html?q=pull-in"), ("a b", "search.html?q=a%20b")],
)  # fmt: skip
def test_the_place_of_a_word(builds: list[Path], tmp_path: Path, word: str | None, address: str) -> None:
    done = CliRunner().invoke(commands, ["manual", *([word] if word else [])])
    assert (done.exit_code, done.stdout.strip()) == (0, f"{(tmp_path / 'cache' / 'manual').as_uri()}/{address}")


def test_it_is_built_once(builds: list[Path], tmp_path: Path) -> None:
    """Until the code or a model changes; a stamp of something else is no such build. An own folder is built anew."""
    for _ in range(2):
        assert CliRunner().invoke(commands, ["manual"]).exit_code == 0
    assert len(builds) == 1 and builds[0].parent == tmp_path / "cache" and not builds[0].exists()
    (tmp_path / "cache" / "manual" / "stamp").write_text("of another version", encoding="ascii")
    assert CliRunner().invoke(commands, ["manual"]).exit_code == 0
    assert CliRunner().invoke(commands, ["manual", "-o", str(tmp_path / "site")]).exit_code == 0
    assert builds[2:] == [tmp_path / "site"] and len(builds) == 3


def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the package for it, without the repository, without a cache."""
    call = ["manual", "-o", str(tmp_path / "site")]
    for name, value, advice in (
        ("NEEDED", ("no_such_package",), 'the manual needs Sphinx: pip install "bondgraph-lang[manual]"'),
        ("MODELS", tmp_path / "nowhere", "the manual is built in a clone of the repository: install that, `pip install -e .`"),
    ):  # fmt: skip
        with monkeypatch.context() as changed:
            changed.setattr(manual, name, value)
            done = CliRunner().invoke(commands, call)
        assert (done.exit_code, done.stderr.strip()) == (2, f"bondgraph: {advice}")
    monkeypatch.setenv("BONDGRAPH_CACHE", "")
    assert "name one: `bondgraph manual -o FOLDER`" in CliRunner().invoke(commands, ["manual"]).stderr
    assert not (tmp_path / "site").exists()
