"""Every part documents itself, and its example runs to its closed form on each back-end; pages and lists are made of the files alone."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import bondgraph
from bondgraph.catalogue import LibraryPart, example_of, found_by, interface_of, library_parts
from bondgraph.commands import commands
from compiler.source import Source
from compiler.syntax.format import format_text
from tests.library.bench import RTOL, near
from tests.library.formulas import FORMULAS

PARTS = library_parts()
NAMES = [p.name for p in PARTS]
LOOSE = {
    "Bjt": 1e4,
    "OpAmp": 1e2,
    "IdealDiode": 1e2,
    "IdealThyristor": 1e2,
}  # times the tolerance: what their closed forms leave out


@cache
def example(name: str) -> bondgraph.Model:
    (part,) = (p for p in PARTS if p.name == name)
    return bondgraph.load(example_of(part, PARTS))


def test_a_name_means_one_part() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert set(FORMULAS) == set(NAMES)


@pytest.mark.parametrize("part", PARTS, ids=lambda p: f"{p.library}.{p.name}")
def test_a_part_is_documented(part: LibraryPart) -> None:
    assert part.description and part.law and part.example, "text, law and example"
    text = example_of(part, PARTS)
    assert format_text(Source(part.name, text)) == text
    assert part.name in re.findall(r"import (.*) from", text)[0].split(", ")
    interface = interface_of(part)
    assert all(p.domain for p in interface.ports)


@pytest.mark.few(100)
@pytest.mark.parametrize(
    "target",
    [pytest.param("native", marks=pytest.mark.machine_code), pytest.param("numpy", marks=pytest.mark.interpreted)],
)
@pytest.mark.parametrize("name", NAMES)
def test_an_example_has_its_closed_form(name: str, target: str) -> None:
    found = example(name).simulate(rtol=RTOL, target=target, points=41)
    assert found.warnings == ()
    expected = FORMULAS[name](found.time)
    assert set(expected) == {item.name for item, _ in found.shown()}
    for output, values in expected.items():
        whole = hasattr(values, "shape") and values.shape == found.time.shape
        near(found[output] if whole else found.final(output), values, rtol=RTOL * LOOSE.get(name, 1))


@pytest.mark.few(75)
@pytest.mark.parametrize("name", NAMES)
def test_an_example_can_be_written_flat(name: str) -> None:
    """No part reads a port that nothing shows where its bonds are joined."""
    assert bondgraph.check(example(name).text()) == ()


# ---------------------------------------------------------------------- the command


def run(*arguments: str) -> Result:
    return CliRunner().invoke(commands, ["library", *arguments])


def test_the_list_has_every_part_with_its_file() -> None:
    done = run()
    assert done.exit_code == 0
    assert re.findall(r"^  (\w+)", done.stdout, re.MULTILINE) == [
        p.name for p in sorted(PARTS, key=lambda p: p.library)
    ]
    assert re.findall(r"^(\w+)$", done.stdout, re.MULTILINE) == sorted({p.library for p in PARTS})
    assert f"{len(PARTS)} parts" in done.stdout


def test_words_find_parts_by_all_that_is_told_of_them() -> None:
    assert {p.name for p in found_by(PARTS, ["STRIBECK", "bearing"])} == {"RotaryFriction"}
    assert found_by(PARTS, ["valve"])[0].name == "Valve"
    for words, name in {
        "gap-closing": "GapClosingComb",
        "squeeze film": "SqueezeFilm",
        "side-moving": "SideComb",
        "BLDC": "Pmsm",
        "ball screw": "Screw",
    }.items():
        assert found_by(PARTS, [words])[0].name == name
    assert run("no", "such").exit_code == 2
    assert "there is Diode" in run("Dioda").stderr


def test_a_page_has_everything() -> None:
    page = run("pipe").stdout
    for piece in (
        "Pipe, of hydraulic",
        "128 μ l",
        "Hagen 1839",
        "abs(reynolds) < 2300 (laminar flow)",
        "a  hydraulic  arrow in",
        "b  hydraulic  arrow out",
        "viscosity",
        "Pa*s",
    ):
        assert piece in page, piece
    assert page.endswith(example_of(next(p for p in PARTS if p.name == "Pipe"), PARTS))


def test_json_says_the_same() -> None:
    told = json.loads(run("Diode", "--json").stdout)
    assert told["schema"] == "bondgraph-library/1"
    (part,) = told["parts"]
    assert part["name"] == "Diode" and part["library"] == "electric" and part["source"] == "Shockley 1949; SPICE"
    assert part["ports"] == [{"name": "pins", "domain": "electric", "enters": True, "description": ""}]
    assert {
        "role": "parameter",
        "name": "C_j",
        "unit": "pF",
        "value": "4",
        "description": "capacitance of the junction without voltage, not zero",
    } in part["quantities"]
    assert bondgraph.check(part["example"]) == ()


@pytest.mark.parametrize(
    ("ending", "begin"), [("bg", "import Resistor, Diode from electric"), ("svg", "<svg"), ("html", "<!doctype html>")]
)
def test_an_example_is_written(ending: str, begin: str, tmp_path: Path) -> None:
    out = tmp_path / f"diode.{ending}"
    assert run("Diode", "-o", str(out)).exit_code == 0
    assert begin.lower() in out.read_text(encoding="utf-8").lower()
    assert run("valve", "hydraulic", "-o", str(out)).exit_code == 2  # several parts


@pytest.mark.parametrize("call", ["draw FILE --model Diode -o OUT.svg", "report FILE --model Diode -o OUT.html"])
def test_a_part_with_open_ports_is_shown_in_its_example(call: str, tmp_path: Path) -> None:
    from bondgraph.catalogue import LIBRARY

    words = call.replace("FILE", str(LIBRARY / "electric.bg")).replace("OUT", str(tmp_path / "out")).split()
    done = CliRunner().invoke(commands, words)
    assert done.exit_code == 0, done.stderr
    assert "`Diode` has open ports: this is its example" in done.stderr
    (out,) = tmp_path.iterdir()
    assert "lead" in out.read_text(encoding="utf-8")


OWN = """model Half {
  "Half of what it gets."
  # law: v_b = v_a/2
  # example:
  #   Sf drive : v = 2 [m/s]
  #   Half part
  #   R load : F = 3 [N*s/m]*v
  #   drive -> part.a
  #   part.b -> load
  #   output v = load.v
  #   experiment go { simulate 0 .. 1 s }
  port a: translation, b: translation

  TF lever : v2 = v1/2
  a -> lever -> b
}
"""


def test_a_part_of_ones_own_is_shown_in_its_example(tmp_path: Path) -> None:
    file, out = tmp_path / "parts.bg", tmp_path / "half.svg"
    file.write_text(OWN, encoding="utf-8")
    done = CliRunner().invoke(commands, ["draw", str(file), "-o", str(out)])
    assert done.exit_code == 0, done.stderr
    assert "drive" in out.read_text(encoding="utf-8")
    file.write_text(re.sub(r"  #.*\n", "", OWN), encoding="utf-8")
    done = CliRunner().invoke(commands, ["draw", str(file), "-o", str(out)])
    assert done.exit_code == 1 and "BG121" in done.stderr
