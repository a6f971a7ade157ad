"""Files that are edited: after each change the errors are those of `check`, and only the pieces that changed are read again."""

from __future__ import annotations

from pathlib import Path

import pytest

from bondgraph.language_service.workspace import Workspace, problems
from compiler.examination import check
from compiler.project import AT_ONCE, Project
from compiler.source import Source
from compiler.syntax.pieces import cut, read_piece
from tests.compiling import LIBRARY, ROOT

CASES = sorted((ROOT / "tests/errors/cases").glob("*.bg"))
MODELS = sorted([*(ROOT / "models").glob("*.bg"), *LIBRARY.glob("*.bg")])
PARTS = """import SpringDamper from mechanics
constant g0 = 9.81 m/s^2
model Load {
  parameter m = 1 kg
  port shaft: translation
  I mass : p = m*v
  shaft -> mass
  output v = mass.v
}
model Drive {
  parameter force = 2 N
  Se push : F = force*step(time)
  1 frame
  Load load { m = 3 kg }
  push -> frame -> load.shaft
  output speed = load.v, weight = load.m*g0
  experiment go { simulate 0 .. 1 s; report speed in mm/s }
}
"""


def told(text: str, path: Path) -> list[tuple[object, ...]]:
    found = check(Source(str(path), text, path), None, LIBRARY)
    return [(d.code, d.span.line, d.span.column, d.sentence, d.help) for d in found]


def surveyed(project: Project, path: Path, complete: bool = True) -> list[tuple[object, ...]]:
    found = project.survey(path, complete).diagnostics
    return [(d.code, d.span.line, d.span.column, d.sentence, d.help) for d in found]


@pytest.mark.parametrize("path", [*CASES[::3], *MODELS[::6]], ids=lambda p: p.stem)
def test_the_errors_are_those_of_check(path: Path) -> None:
    assert surveyed(Project(LIBRARY), path) == told(path.read_text(encoding="utf-8"), path)


def edits() -> list[str]:
    """The text of two models after each key of a change in one of them, and changes of what both read."""
    line = "  C stop : F = 5 [N/m]*x"
    at = PARTS.index("  shaft -> mass")
    typed = [f"{PARTS[:at]}{line[:n]}\n{PARTS[at:]}" for n in range(0, len(line) + 1, 3)]
    other = [
        ("9.81 m/s^2", "9.81 m/s"),
        ("m = 3 kg", "m = 3 N"),
        ("m = 1 kg", "mass = 1 kg"),
        ("port shaft", "port shft"),
        ("}\nmodel Drive", "\nmodel Drive"),
    ]
    return [*typed, *(PARTS.replace(a, b) for a, b in other), "# first\n" + PARTS.replace("load.v,", "load.w,"), PARTS]


def test_after_each_change_too(tmp_path: Path) -> None:
    """One project sees all changes; its errors are those of a text read from nothing, lines in sentences included."""
    path = tmp_path / "parts.bg"
    path.write_text(PARTS, encoding="utf-8")
    project = Project(LIBRARY)
    for text in edits():
        project.open_texts[path] = text
        whole = told(text, path)
        if "}\nmodel Drive" not in text:  # an open brace hides the rest of the file from `check`
            assert [row[0] for row in surveyed(project, path)] == ["BG007"]
            continue
        assert surveyed(project, path) == whole
        assert set(surveyed(project, path, False)) <= set(whole)


def test_pieces_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "parts.bg"
    path.write_text(PARTS, encoding="utf-8")
    project = Project(LIBRARY)
    before = project.document(path)
    models = project.survey(path).models
    project.open_texts[path] = PARTS.replace("force = 2 N", "force = 25 N")
    after = project.document(path)
    kept = [piece.model for piece in after.pieces if any(piece is old for old in before.pieces)]
    assert kept == ["", "Load"] and "".join(piece.text for piece in after.pieces) == after.text
    now = project.survey(path).models
    assert now["Load"] is models["Load"] and now["Drive"] is not models["Drive"]


def test_errors_of_imported_files_are_told_where_they_are(tmp_path: Path) -> None:
    """Also those that are only in the editor yet; and a file on the disk is read again when it changes."""
    parts, main = tmp_path / "parts.bg", tmp_path / "main.bg"
    part = "model Part {\n  port a: translation\n  I m : p = 1 kg*v\n  a -> m\n}\n"
    parts.write_text(part, encoding="utf-8")
    text = 'import Part from "parts.bg"\nmodel Main {\n  Se f : F = 1 N\n  Part p\n  f -> p.a\n  output v = p.m.v\n}\n'
    main.write_text(text, encoding="utf-8")
    workspace = Workspace()
    assert problems(workspace, main) == ([], True)
    workspace.open(parts, part.replace("1 kg", "1 kgg"))
    (found,), _ = problems(workspace, main)
    assert (found.code, found.place.path, found.place.start) == ("BG102", parts, part.index("kg"))
    workspace.close(parts)
    parts.write_text(part.replace("port a", "port b"), encoding="utf-8")
    codes = [p.code for p in problems(workspace, main)[0]]
    assert "BG101" in codes


def test_large_models_are_left_for_later(tmp_path: Path) -> None:
    body = "".join(f"  I m{i} : p = {i + 1} kg*v\n  f -> m{i}\n" for i in range(AT_ONCE // 30))
    text = f"model Small {{\n  output a = 1\n}}\nmodel Large {{\n  1 f : translation\n{body}  output a = wrong\n}}\n"
    path = tmp_path / "large.bg"
    path.write_text(text.replace("= 1\n", "= oops\n"), encoding="utf-8")
    project = Project(LIBRARY)
    assert [row[3] for row in surveyed(project, path, False)] == ["There is no `oops` in `Small`"]
    assert not project.survey(path, False).is_complete
    assert len(surveyed(project, path)) == 2 and project.survey(path, False).is_complete


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("model A {\n  parameter a = 1\n  experiment e {\n    simulate 0 .. 1 s\n", {"a"}),
        ("model A {\n  parameter a = 1\n  output b = \n  experiment e { simulate 0 .. 1 s }\n}\n", {"a"}),
        ("model A {\n  parameter a = 1\n  Se x : F =\n  output b = a\n}\n", {"a"}),
        ("model A {\n  parameter a = (1, 2\n  output b = a\n}\n", set()),
    ],
)
def test_half_typed_models_still_have_names(text: str, names: set[str]) -> None:
    from compiler.api import table_of

    piece = read_piece("a.bg", Path("a.bg"), text)
    assert piece.mistakes
    models = [s for s in piece.statements if type(s).__name__ == "ModelSyntax"]
    assert names <= {name for m in models for name in table_of(m)}  # type: ignore[arg-type]


def test_texts_are_cut_at_their_models() -> None:
    text = '"model B {"\n# model C {\n  plain model D {\n}\nmodel E {\n'
    assert [piece[:8] for piece in cut(text)] == ['"model B', "  plain ", "model E "] and "".join(cut(text)) == text
