"""Files of columns: reading of the named columns alone; lists that differ from instance to instance."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.semantics.names import column_file
from tests.compiling import compiled, mistake, mistakes, numbers, outputs_of

SHEET = (
    '# bench 3\n\nway [mm], force [N], "share, relative", T [degC]\n0, -1.5e1, 0, 0\r\n 1 ,2.5,0.5, 10\n2,+30.,1,20\n'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "curve.csv").write_text(SHEET, encoding="utf-8")
    return tmp_path


def model(folder: Path, body: str, name: str = "main.bg") -> Path:
    file = folder / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(f"model A {{\n{body}\n}}\n", encoding="utf-8")
    return file


def test_columns_have_their_units(folder: Path) -> None:
    file = model(
        folder,
        'constant F = column("curve.csv", "force"), s = column("curve.csv", "share, relative"), T = column("curve.csv", "T")\n'
        'parameter x: mm = column("curve.csv", "way")\n'
        "output y = linear(1.5 mm, x, F), z = s[2], t = T[3], last = x[3]",
    )
    found = outputs_of(compiled(file))
    assert found == pytest.approx({"y": 16.25, "z": 0.5, "t": 293.15, "last": 2e-3})


def test_a_column_of_parameters_can_be_set(folder: Path) -> None:
    file = model(folder, 'parameter F = column("curve.csv", "force")\noutput y = linear(0.5, (0, 1, 2), F)')
    assert outputs_of(compiled(file))["y"] == pytest.approx(-6.25)
    assert outputs_of(compiled(file, {"F[1]": "2.5 N"}))["y"] == pytest.approx(2.5)


def test_nothing_outside_of_the_project_is_read(folder: Path) -> None:
    inside = folder / "project"
    file = model(inside, 'output y = linear(1 mm, column("../curve.csv", "way"), column("../curve.csv", "force"))')
    assert "outside the project folder" in mistakes(file)[0].sentence
    (inside / "link.csv").symlink_to(folder / "curve.csv")
    file = model(inside, 'constant a = column("link.csv", "way")\noutput y = a[1]')
    assert "outside the project folder" in mistake(file, "BG152").sentence
    (folder / "bondgraph.toml").write_text("", encoding="utf-8")
    assert mistakes(file) == ()


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no rows of numbers"), ("x [mm]\n", "no rows of numbers"), ("x\n1,5\n2;3\n", "`2;3` in curve.csv, line 3"), ("x, x\n1, 2\n", "more than one column `x`"),
        ("x [N/0]\n1\n", "is not a unit"), ("x\nnan\n", "`nan`"), ("x\n1e999\n", "`1e999`"), ("x\n1_0\n", "`1_0`"), ("y, x\n1\n", "missing in curve.csv, line 2"),
    ],
)  # fmt: skip
def test_what_is_no_file_of_columns(folder: Path, text: str, part: str) -> None:
    (folder / "curve.csv").write_text(text, encoding="utf-8")
    file = model(folder, 'constant a = column("curve.csv", "x")\noutput y = a[1]')
    assert part in mistake(file, "BG152").sentence


def test_limits(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = model(folder, 'constant a = column("curve.csv", "way")\noutput y = a[1]')
    monkeypatch.setattr(column_file, "MAXIMUM_ROWS", 2)
    assert "3 rows" in mistake(file, "BG152").sentence
    monkeypatch.setattr(column_file, "MAXIMUM_SIZE", 20)
    assert "bytes" in mistake(file, "BG152").sentence


def test_bytes_that_are_no_text(folder: Path) -> None:
    (folder / "curve.csv").write_bytes(b"x\n\xff\xfe\n")
    file = model(folder, 'constant a = column("curve.csv", "x")\noutput y = a[1]')
    assert "UTF-8" in mistake(file, "BG152").sentence


def test_long_files_are_quick(folder: Path) -> None:
    """Ten thousand rows are one array of the program."""
    rows = "\n".join(f"{i}, {i * i}" for i in range(10_000))
    (folder / "curve.csv").write_text(f"x, y\n{rows}\n", encoding="utf-8")
    file = model(folder, 'output y = cubic(time/(1 s), column("curve.csv", "x"), column("curve.csv", "y"))')
    assert outputs_of(compiled(file), time=77.5)["y"] == pytest.approx(77.5**2, rel=1e-9)


def test_lists_may_differ_in_length_from_instance_to_instance() -> None:
    """In a law and in an output; the text of the definition is one."""
    text = """
    model Curve {
      parameter xs = (0, 1), ys = (0, 1)
      input at = 0.5
      Se s : u = 1 V
      R r : i = 1 A*linear(u/1 V, xs, ys)
      s -> r
      output y = linear(at, xs, ys), first = r.i
    }
    model A {
      Curve a
      Curve b { xs = (0, 0.5, 2), ys = (0, 4, 10) }
      Curve c { at = 1.5, xs = (0, 2), ys = (5, 6) }
      output a_y = a.y, b_y = b.y, c_y = c.y, b_i = b.first
    }"""
    assert numbers(text) == pytest.approx({"a_y": 0.5, "b_y": 4, "c_y": 5.75, "b_i": 6})


def test_wrong_points_of_one_instance_are_told() -> None:
    text = "model Curve {\n  parameter xs = (0, 1)\n  output y = linear(0.5, xs, (1, 2))\n}\nmodel A {\n  Curve a\n  Curve b { xs = (1, 0) }\n  output y = a.y + b.y\n}\n"
    assert "must rise" in mistake(text, "BG151").sentence
    assert "3 places but 2 values" in mistake(text.replace("(1, 0)", "(0, 1, 2)"), "BG151").sentence


def test_many_points_that_are_parameters_are_refused() -> None:
    many = ", ".join(map(str, range(201)))
    text = f"model A {{\n  parameter xs = ({many})\n  output y = cubic(0.5, xs, xs)\n}}\n"
    assert "201 points" in mistake(text, "BG151").sentence
    assert mistakes(text.replace("parameter", "constant")) == ()
