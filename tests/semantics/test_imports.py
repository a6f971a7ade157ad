"""Imports: files beside this one, inside the project folder only; nothing outside is read, nothing is read twice."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from compiler.compilation import Compilation
from compiler.errors import CompilationFailed, Diagnostic
from compiler.examination import check
from compiler.scene import Scene
from compiler.semantics.names.imports import project_folder
from compiler.source import Source
from tests.compiling import LIBRARY, Running

WHEEL = "model Wheel {\n  parameter r = 2 m\n  output y = 2*pi*r\n}\n"
MAIN = 'import Wheel from "%s"\nmodel A {\n  Wheel left { r = 1 m }\n  output y = left.y\n}\n'


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def load(file: Path) -> Source:
    return Source(str(file), file.read_text(encoding="utf-8"), file)


def told(file: Path) -> list[Diagnostic]:
    return list(check(load(file), None, LIBRARY))


def value(file: Path) -> float:
    return Running(Compilation(load(file), Scene(None, None), LIBRARY)).outputs()["y"]


def test_a_file_beside_this_one(tmp_path: Path) -> None:
    write(tmp_path, {"main.bg": MAIN % "parts.bg", "parts.bg": WHEEL})
    assert told(tmp_path / "main.bg") == []
    assert value(tmp_path / "main.bg") == pytest.approx(6.283185307179586)


def test_relative_to_the_importing_file(tmp_path: Path) -> None:
    """a/main.bg -> b/c.bg -> b/deep/wheel.bg: each path counts from its own file."""
    write(
        tmp_path,
        {
            "bondgraph.toml": "",
            "a/main.bg": 'import Car from "../b/c.bg"\nmodel A {\n  Car car\n  output y = car.wheel.r\n}\n',
            "b/c.bg": 'import Wheel from "deep/wheel.bg"\nmodel Car {\n  Wheel wheel { r = 7 m }\n}\n',
            "b/deep/wheel.bg": WHEEL,
        },
    )
    assert value(tmp_path / "a" / "main.bg") == 7.0


def test_an_imported_model_keeps_the_names_of_its_file(tmp_path: Path) -> None:
    """Constants, functions and models of the part's file, not of the importer's."""
    part = "constant g = 3\nfunction twice(x) = 2*x\nmodel Inner { output y = 5 }\nmodel Part {\n  Inner i\n  output y = twice(g) + i.y\n}\n"
    main = 'import Part from "part.bg"\nconstant g = 100\nfunction twice(x) = 200*x\nmodel Inner { output y = 300 }\nmodel A {\n  Part p\n  Inner j\n  output y = p.y, z = j.y + g\n}\n'
    write(tmp_path, {"main.bg": main, "part.bg": part})
    assert value(tmp_path / "main.bg") == 11.0


def test_only_what_is_named_comes_in(tmp_path: Path) -> None:
    write(
        tmp_path,
        {
            "main.bg": 'import Wheel from "parts.bg"\nmodel A {\n  Wheel w\n  Other o\n  output y = w.y\n}\n',
            "parts.bg": WHEEL + "model Other { output y = 1 }\n",
        },
    )
    assert [d.code for d in told(tmp_path / "main.bg")] == ["BG105"]


@pytest.mark.parametrize(
    ("statement", "word"),
    [
        ('import Wheel from "nowhere.bg"', "nowhere.bg"), ('import Whee from "parts.bg"', "`Wheel`"), ('import Wheel from "parts"', "parts"), ('import Wheel from "."', "."),
        ('import Wheel from "folder.bg"', "folder.bg"), ("import Wheel from nolibrary", "nolibrary"), ('import Wheel, Wheel from "parts.bg"', "Wheel"), ('import Wheel from ""', ""),
        ('import Wheel from "parts.txt"', "parts.txt"),
    ],
)  # fmt: skip
def test_what_cannot_be_imported(tmp_path: Path, statement: str, word: str) -> None:
    write(
        tmp_path,
        {
            "parts.bg": WHEEL,
            "parts.txt": WHEEL,
            "main.bg": statement + "\nmodel A { output y = 1 }\n",
            "folder.bg/x": "",
        },
    )
    found = told(tmp_path / "main.bg")
    assert [d.code for d in found] in (["BG131"], ["BG104"])
    assert found[0].span.line == 1 and word in found[0].sentence + found[0].help


def test_a_mistake_in_an_imported_file_is_told_there(tmp_path: Path) -> None:
    write(
        tmp_path,
        {"main.bg": MAIN % "parts.bg", "parts.bg": "model Wheel {\n  parameter r = 2 m\n  output y = r + 1 s\n}\n"},
    )
    (found,) = told(tmp_path / "main.bg")
    assert (found.code, Path(found.span.source.name).name, found.span.line) == ("BG103", "parts.bg", 3)


def test_a_syntax_mistake_in_an_imported_file(tmp_path: Path) -> None:
    write(tmp_path, {"main.bg": MAIN % "parts.bg", "parts.bg": "model Wheel {\n  parameter r = 2 m +\n}\n"})
    found = told(tmp_path / "main.bg")
    assert found and {Path(d.span.source.name).name for d in found} == {"parts.bg"}


def test_what_is_no_text(tmp_path: Path) -> None:
    write(tmp_path, {"main.bg": MAIN % "parts.bg"})
    (tmp_path / "parts.bg").write_bytes(b"\xff\xfe\x00\x01")
    assert [d.code for d in told(tmp_path / "main.bg")] == ["BG131"]


def test_a_byte_order_mark_is_no_character(tmp_path: Path) -> None:
    write(tmp_path, {"main.bg": MAIN % "parts.bg", "parts.bg": "\ufeff" + WHEEL})
    assert told(tmp_path / "main.bg") == []


class TestCircles:
    def test_two_files(self, tmp_path: Path) -> None:
        write(
            tmp_path,
            {
                "a.bg": 'import B from "b.bg"\nmodel A { B b; output y = 1 }\n',
                "b.bg": 'import A from "a.bg"\nmodel B { output y = 1 }\n',
            },
        )
        (found,) = told(tmp_path / "a.bg")
        assert found.code == "BG107" and "a.bg -> b.bg -> a.bg" in found.sentence

    def test_itself(self, tmp_path: Path) -> None:
        write(tmp_path, {"a.bg": 'import A from "a.bg"\nmodel A { output y = 1 }\n'})
        assert "BG107" in {d.code for d in told(tmp_path / "a.bg")}

    def test_a_diamond_is_no_circle(self, tmp_path: Path) -> None:
        left, right = (
            'import Wheel from "w.bg"\nmodel %s {\n  Wheel w\n  output y = w.y\n}\n' % n for n in ("L", "R_")
        )
        main = 'import L from "l.bg"\nimport R_ from "r.bg"\nmodel A {\n  L l\n  R_ r\n  output y = l.y + r.y\n}\n'
        write(
            tmp_path,
            {"main.bg": main, "l.bg": left, "r.bg": right, "w.bg": "model Wheel { parameter r = 2; output y = r }\n"},
        )
        assert told(tmp_path / "main.bg") == []
        assert value(tmp_path / "main.bg") == 4.0


class TestTheProjectFolder:
    @pytest.mark.parametrize("marker", ["bondgraph.toml", "pyproject.toml"])
    def test_the_nearest_ancestor_with_a_marker(self, tmp_path: Path, marker: str) -> None:
        write(
            tmp_path,
            {f"outer/{marker}": "", f"outer/inner/{marker}": "", "outer/inner/deep/main.bg": "", "other/main.bg": ""},
        )
        assert project_folder(tmp_path / "outer/inner/deep/main.bg") == tmp_path / "outer" / "inner"
        assert project_folder(tmp_path / "other/main.bg") == tmp_path / "other"

    def test_below_it_everything_may_be_imported(self, tmp_path: Path) -> None:
        write(tmp_path, {"bondgraph.toml": "", "models/main.bg": MAIN % "../parts/wheel.bg", "parts/wheel.bg": WHEEL})
        assert told(tmp_path / "models" / "main.bg") == []

    @pytest.mark.parametrize("place", ["../secret.bg", "../project/../secret.bg", "sub/../../secret.bg", "{absolute}"])
    def test_nothing_above_it(self, tmp_path: Path, place: str) -> None:
        place = place.replace("{absolute}", str(tmp_path / "secret.bg"))
        write(
            tmp_path,
            {"secret.bg": WHEEL, "project/bondgraph.toml": "", "project/main.bg": MAIN % place, "project/sub/x.bg": ""},
        )
        (found,) = told(tmp_path / "project" / "main.bg")
        assert found.code == "BG131" and "outside the project folder" in found.sentence

    def test_a_file_without_a_project_sees_its_own_folder_only(self, tmp_path: Path) -> None:
        write(
            tmp_path,
            {
                "secret.bg": WHEEL,
                "project/main.bg": MAIN % "../secret.bg",
                "project/sub/wheel.bg": WHEEL,
                "project/other.bg": MAIN % "sub/wheel.bg",
            },
        )
        assert [d.code for d in told(tmp_path / "project" / "main.bg")] == ["BG131"]
        assert told(tmp_path / "project" / "other.bg") == []

    @pytest.mark.skipif(not hasattr(os, "symlink"), reason="this system has no symbolic links")
    def test_links_are_followed_before_the_check(self, tmp_path: Path) -> None:
        """A link inside that points outside is outside; one that stays inside is fine."""
        write(tmp_path, {"secret/wheel.bg": WHEEL, "project/bondgraph.toml": "", "project/real.bg": WHEEL})
        project = tmp_path / "project"
        (project / "file.bg").symlink_to(tmp_path / "secret" / "wheel.bg")
        (project / "folder").symlink_to(tmp_path / "secret")
        (project / "inside.bg").symlink_to(project / "real.bg")
        for place, codes in (("file.bg", ["BG131"]), ("folder/wheel.bg", ["BG131"]), ("inside.bg", [])):
            write(project, {"main.bg": MAIN % place})
            assert [d.code for d in told(project / "main.bg")] == codes, place

    @pytest.mark.skipif(not hasattr(os, "symlink"), reason="this system has no symbolic links")
    def test_a_project_reached_through_a_link(self, tmp_path: Path) -> None:
        write(tmp_path, {"real/main.bg": MAIN % "parts.bg", "real/parts.bg": WHEEL})
        (tmp_path / "link").symlink_to(tmp_path / "real")
        assert told(tmp_path / "link" / "main.bg") == []

    def test_a_text_that_is_no_file_imports_nothing(self) -> None:
        with pytest.raises(CompilationFailed, match="BG131"):
            _ = Compilation(Source("text", MAIN % "parts.bg"), Scene(None, None), LIBRARY).whole_graph

    def test_the_content_of_a_refused_file_is_not_shown(self, tmp_path: Path) -> None:
        write(tmp_path, {"secret.bg": "the secret of the neighbour", "project/main.bg": MAIN % "../secret.bg"})
        (found,) = told(tmp_path / "project" / "main.bg")
        assert "neighbour" not in found.sentence + found.help

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
    def test_a_pipe_does_not_hang(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe.bg")
        write(tmp_path, {"main.bg": MAIN % "pipe.bg"})
        assert [d.code for d in told(tmp_path / "main.bg")] == ["BG131"]


def test_the_number_of_files_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from compiler.semantics.names import imports as room

    assert room.MAXIMUM_FILES <= 10_000
    monkeypatch.setattr(room, "MAXIMUM_FILES", 10)
    write(
        tmp_path,
        {
            f"f{i}.bg": f'import M{i + 1} from "f{i + 1}.bg"\nmodel M{i} {{ M{i + 1} m; output y = 1 }}\n'
            for i in range(20)
        }
        | {"f20.bg": "model M20 { output y = 1 }\n"},
    )
    assert "BG160" in {d.code for d in told(tmp_path / "f0.bg")}


def test_a_long_chain_of_files_is_fine(tmp_path: Path) -> None:
    write(
        tmp_path,
        {
            f"f{i}.bg": f'import M{i + 1} from "f{i + 1}.bg"\nmodel M{i} {{\n  M{i + 1} m\n  output y = 1\n}}\n'
            for i in range(50)
        }
        | {"f50.bg": "model M50 { output y = 1 }\n"},
    )
    assert told(tmp_path / "f0.bg") == []
