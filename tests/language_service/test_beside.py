"""What an editor shows beside and above a text: the diagram, whose parts know their places, and commands of experiments."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bondgraph.language_service.diagram import MOST_NODES, diagram
from bondgraph.language_service.outline import lenses
from bondgraph.language_service.workspace import Workspace
from tests.compiling import ROOT

CHAIN = """model Cell {
  port left: translation, right: translation
  parameter m = 1 kg
  1 body
  0 gap
  I mass : p = m*v
  C spring : F = 5 [N/m]*x
  left -> body -> mass, gap
  gap -> spring, right
}
model Chain {
  input u = 1 N
  MSe push : F = u
  Cell a
  Cell b { m = 2 kg }
  R end : F = 1 [N*s/m]*v
  push -> a.left
  a.right -> b.left
  b.right -> end
  output x = a.spring.x
  experiment go { simulate 0 .. 1 s }
  experiment heavy { set a.m = 3 kg }
}
"""


def open_text(folder: Path, text: str) -> tuple[Workspace, Path]:
    workspace, path = Workspace(), folder / "a.bg"
    workspace.open(path, text)
    return workspace, path


def parts(workspace: Workspace, path: Path) -> dict[str, list[tuple[str, ...]]]:
    """Parts of the diagram by name, or `tail head` for bonds, each with the texts of its places."""
    drawn = diagram(workspace, path)
    assert drawn is not None
    named = re.findall(r'data-id="(\d+)" data-(?:name="([^"]*)"|bonds="[^"]*" data-tail="([^"]*)" data-head="([^"]*)")', drawn.svg)  # fmt: skip
    assert len(named) == len(drawn.parts)
    listed: dict[str, list[tuple[str, ...]]] = {}
    for number, name, tail, head in named:
        texts = tuple(workspace.text(p.path)[p.start : p.end] for p in drawn.parts[number])
        listed.setdefault(name or f"{tail} {head}", []).append(texts)
    return listed


def test_parts_of_the_diagram_have_their_places(tmp_path: Path) -> None:
    """An element of an instance has its own declaration first, then that of the instance."""
    listed = parts(*open_text(tmp_path, CHAIN))
    assert listed["push"] == [("push",)] and listed["end"] == [("end",)]
    assert listed["a.mass"] == [("mass", "a")] and listed["b.spring"] == [("spring", "b")]
    assert {"a.body", "a.gap", "b.body", "b.gap"} < listed.keys()
    bonds = {name: rows for name, rows in listed.items() if " " in name}
    assert len(bonds) == 9 and all([(n.rpartition(".")[2].split()[-1],)] == rows for n, rows in bonds.items())


@pytest.mark.parametrize("name", ["dc_motor", "rc_ladder", "manipulator", "four_bar"])
def test_the_place_of_a_part_has_its_name(name: str) -> None:
    path = ROOT / f"models/{name}.bg"
    for part, rows in parts(Workspace(), path).items():
        own = re.sub(r"\[\d+\]|\(.*", "", part).rpartition(".")[2]
        assert " " in part or all(own in texts[0] for texts in rows), (part, rows)


def test_there_is_no_diagram_of_a_text_with_errors_or_of_too_many_parts(tmp_path: Path) -> None:
    assert diagram(*open_text(tmp_path, CHAIN.replace("a.right", "a.write"))) is None
    assert diagram(*open_text(tmp_path, "constant c = 1\n")) is None
    count = MOST_NODES // 2 + 1
    many = "".join(f"  1 j{i}; R r{i} : F = 1 [N*s/m]*v; j{i} -> r{i}\n" for i in range(count))
    assert diagram(*open_text(tmp_path, f"model Many {{\n{many}}}\n")) is None


def test_commands_above_experiments(tmp_path: Path) -> None:
    """Those that make sense: a run needs a step, a frequency response an input; `--model` names a model that is not the last."""
    workspace, path = open_text(tmp_path, CHAIN.replace("1 body\n", "1 body\n  experiment alone { equilibrium }\n", 1))
    shown = [(workspace.text(path)[x.place.start : x.place.end], x.title, x.words[2:]) for x in lenses(workspace, path)]
    assert shown == [
        *[("alone", title, ("-e", "alone", "--model", "Cell")) for title in ("Run", "Modes")],
        ("Chain", "Diagram", ()),
        *[("go", title, ("-e", "go")) for title in ("Run", "Modes", "Bode")],
        *[("heavy", title, ("-e", "heavy")) for title in ("Modes", "Bode")],
    ]
    assert lenses(*open_text(tmp_path, "model {")) == []
