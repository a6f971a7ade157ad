"""One command computes the thesis again. Invalid lists of published values are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.reproduction import reproduce
from tests.compiling import MODELS


@pytest.mark.parametrize("path", sorted((MODELS / "thesis").glob("*.bg")), ids=lambda p: p.stem)
def test_models_check_clean(path: Path) -> None:
    assert bondgraph.check(path) == ()


@pytest.mark.machine_code
def test_everything_agrees(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    done = CliRunner().invoke(commands, ["reproduce", str(MODELS / "thesis"), "--json", "--page", str(page)])
    assert done.exit_code == 0
    told = json.loads(done.stdout)  # what else is said, as that machine code is made, goes beside it
    assert told["agrees"] and len(told["values"]) >= 121 and len(told["errata"]) == 8
    by_name = {(v["where"], v["what"]): v["computed"] for v in told["values"]}
    # The same numbers by hand-written equations (tests/physics) and as the reference implementation gives them.
    for (where, what), wanted, rel in (
        (("4.2.1", "V_side, (4.2)"), 414.7, 1e-4), (("4.4.1", "x under 30 uN"), 9.67567, 1e-6),
        (("4.4.1", "y under 30 uN"), 8.92099, 1e-6), (("4.4.2", "resonance in x"), 1119.485, 1e-6),
        (("4.4.2", "resonance in y"), 1161.447, 1e-6), (("5.3.1", "V3^2/x over V1^2/y"), 0.8095, 1e-4),
        (("5.3.1", "V1^2/V2^2 in y"), 2.107, 2e-4), (("(4.24)", "resonance by hand"), 1087, 5e-4),
        (("4.4.2, Figure 6.2 (a)", "peak to peak in x at 14 V"), 10.2, 5e-3), (("(4.19)", "k_y of arms 2, 3"), 37525, 1e-9),
    ):  # fmt: skip
        assert by_name[where, what] == pytest.approx(wanted, rel=rel)
    exact = next(t for t in told["tables"] if t["where"] == "5.2, 5.3")
    assert len(exact["rows"]) == 18 and max(r[-1] for r in exact["rows"]) < 1e-10  # off by, in m and rad
    turned = [r for r in exact["rows"] if r[0] in ("phi = 3 deg", "phi = -3 deg")]
    assert all(0.55 < abs(x) < 0.74 for r in turned for x in r[4:7])  # um: what the printed kinematics miss (erratum 7)
    assert all(abs(x) < 0.3 for r in turned for x in r[7:10])  # nm: with the term that they lack
    text = page.read_text(encoding="utf-8")
    assert "## Errata" in text and text.count("| agrees") == len(told["values"])


def test_twelve_joints_of_one_freedom_are_three_joints_of_three() -> None:
    """What section 4.1 built, with the forces (3.11) to (3.13), moves as the flexures of one energy, in the same count of states."""
    model = bondgraph.load(MODELS / "thesis" / "body_editor.bg")
    found = model.simulate("push_x", rtol=1e-9)
    assert found.final("x") == pytest.approx(9.67584e-6, rel=1e-6)
    for name in ("x", "y", "phi"):
        np.testing.assert_allclose(found[name], found[f"{name}_written"], rtol=0, atol=1e-9 * np.abs(found[name]).max())
    pairs = np.sort([m.frequency for m in model.modes().modes]).reshape(-1, 2)
    assert len(pairs) == 6
    np.testing.assert_allclose(pairs[:, 0], pairs[:, 1], rtol=1e-12)


def test_ring_gives_way_below_the_stage() -> None:
    """Legs and leaves in a row, three of them around: z, tilt and x of the ring by hand; in x the stage adds its own."""
    stage, upper = (bondgraph.load(MODELS / "thesis" / name) for name in ("stacked.bg", "stage.bg"))
    loads = {"fx": 1e-9, "fz": 1e-9, "mx": 1e-12}
    still = stage.equilibrium(settings=loads)
    b, across, along, leg = 2e-3, 20.0, 1500.0, 1 / (1 / 15 + 1 / 1500)
    alone = upper.equilibrium(settings={"fx": 1e-9})["x"]
    assert still["z"] == pytest.approx(1e-9 / (3 * leg), rel=1e-6)
    assert still["rx"] == pytest.approx(1e-12 / (1.5 * (b**2 * leg + 4e-7 + 1e-7)), rel=1e-6)
    assert still["stage.ring.x"] == pytest.approx(1e-9 / (1.5 * (across + along)), rel=1e-6)
    assert still["x"] == pytest.approx(alone + 1e-9 / (1.5 * (across + along)), rel=1e-6)


LIST = """
title = "Two springs"
[[value]]
where = "1"
what = "stretch"
model = "spring.bg"
experiment = "pull"
of = "x"
published = 2.5
unit = "mm"
digits = 0.05
"""
SPRING = """
model Spring {
  Se pull : F = 2 N
  I mass : p = 1 kg*v
  C spring : F = 800 [N/m]*x
  R r : F = 1 [N*s/m]*v
  pull -> 1(spring, mass, r)
  output x = spring.x
  experiment pull { equilibrium }
}
"""


def folder(tmp_path: Path, listed: str) -> Path:
    (tmp_path / "spring.bg").write_text(SPRING, encoding="utf-8")
    (tmp_path / "published.toml").write_text(listed, encoding="utf-8")
    return tmp_path


def test_what_does_not_agree_is_told(tmp_path: Path) -> None:
    found = reproduce(folder(tmp_path, LIST))
    assert found.agrees and found.values[0].computed == pytest.approx(2.5, rel=1e-12)
    wrong = folder(tmp_path, LIST.replace("2.5", "2.6"))
    (value,) = reproduce(wrong).values
    assert not value.agrees and value.error == pytest.approx(-0.1 / 2.6, rel=1e-9)
    done = CliRunner().invoke(commands, ["reproduce", str(wrong)])
    assert done.exit_code == 3 and "0 of 1 agree" in done.output


@pytest.mark.machine_code
def test_what_is_taken_of_a_run_tables_and_pictures(tmp_path: Path) -> None:
    """The spring rings about 2.5 mm with almost no damping: between 0 and 5 mm; a table of a sweep; a picture beside the page."""
    pytest.importorskip("matplotlib")
    more = (
        LIST.replace('"pull"', '"ring"')
        .replace("2.5", "5")
        .replace("digits = 0.05", 'digits = 0.02\ntake = "peak to peak"')
    )
    more += '[[table]]\nwhere = "2"\nwhat = "two loads"\nmodel = "spring.bg"\nexperiment = "both"\nswept_in = "kN/m"\n'
    more += '[[picture]]\nwhere = "3"\nwhat = "ringing"\nmodel = "spring.bg"\nexperiment = "ring"\nkind = "time"\n'
    more += '[[picture]]\nwhere = "4"\nwhat = "energy"\nmodel = "spring.bg"\nexperiment = "ring"\nkind = "energy"\n'
    place = folder(tmp_path, more)
    text = (
        SPRING.replace("1 [N*s/m]", "0.01 [N*s/m]")
        .replace("F = 800 [N/m]*x", "F = k*x")
        .replace("  Se", "  parameter k = 800 [N/m]\n  Se")
    )
    text = text.replace(
        "  experiment",
        "  experiment ring { simulate 0 .. 1 s }\n  experiment both { sweep k = 400 [N/m], 800 [N/m]; equilibrium; report x in mm }\n  experiment",
    )
    (place / "spring.bg").write_text(text, encoding="utf-8")
    found = reproduce(place, place / "page.md", "svg")
    assert found.agrees and found.values[0].computed == pytest.approx(5, rel=2e-3)
    (table,) = found.tables
    assert table.heads == ("k [kN/m]", "x [mm]") and table.rows[0] == (pytest.approx(0.4), pytest.approx(5.0))
    assert [p.file for p in found.pictures] == ["page_1.svg", "page_2.svg"]
    assert all((place / p.file).read_text(encoding="utf-8").startswith("<?xml") for p in found.pictures)
    assert "![3](page_1.svg)" in found.page() and "| 0.4 | 5 |" in found.page()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('of = "x"', 'of = "y"', "there is no `y` at point 0 of `pull`"),
        ('unit = "mm"', 'unit = "mN"', "it is in m, not in mN"),
        ('unit = "mm"', 'unit = "wide"', "`wide` is no unit"),
        ("published = 2.5", 'published = "2.5"', "has no `published`"),
        ('model = "spring.bg"', 'model = "../spring.bg"', "lies outside of"),
        ("[[value]]", "[[value]", "published.toml"),
        ("digits = 0.05", 'digits = 0.05\ntake = "mean"', "`take` is final, minimum"),
        ("published = 2.5", "published = [2.5, 2.5]", "2 values are published, and the experiment has 1 points"),
        ("[[value]]", '[[picture]]\nkind = "oil"\n[[value]]', "picture 1"),
    ],
)
def test_a_list_that_makes_no_sense(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(UsageError, match=told.replace("[", r"\[").replace("(", r"\(")):
        reproduce(folder(tmp_path, LIST.replace(old, new)))
