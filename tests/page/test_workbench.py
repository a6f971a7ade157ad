"""The live page as a workbench: a folder, an editor that saves, entries with units, curves that stay, files of plots."""

from __future__ import annotations

import csv
import html
import json
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.files import write_text
from bondgraph.language_service.text_answers import TextAnswers
from bondgraph.presentation.page.document import text_markup
from bondgraph.presentation.page.serve import Server, Session
from bondgraph.presentation.page.serve.settings import parameters_of
from compiler.api import Source
from tests.page.test_serve import CURVE, TEXT, ask, final, unpacked, until

QUARTER = """model QuarterCar {
  parameter m_b = 300 kg, m_w = 40 kg, k_s = 20 [kN/m], k_t = 180 [kN/m], r = 1.5 [kN*s/m]
  Se load : F = 1 kN*step(time - 0.1 s)
  1 body : translation
  1 wheel : translation
  0 strut : translation
  I mass_b : p = m_b*v
  I mass_w : p = m_w*v
  C spring : F = k_s*x
  R damper : F = r*v
  C tyre   : F = k_t*x
  load -> body -> mass_b, strut
  strut -> wheel, 1(spring, damper)
  wheel -> mass_w, tyre
  output travel = spring.x
  experiment bump { simulate 0 .. 8 s; report travel in mm }
}
"""
WRONG = QUARTER.replace("300 kg,", "300 kgg,").replace("k_s*x", "k_z*x").replace("m_w*v", "m_w*x")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "swing.bg").write_text(TEXT, encoding="utf-8")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "windows.bg").write_bytes(TEXT.replace("\n", "\r\n").encode())
    (tmp_path / ".hidden.bg").write_text("", encoding="utf-8")
    return tmp_path


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    server = Server(Session(folder, None, TextAnswers()))
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    server.start()
    thread.start()
    yield server
    server.end()
    thread.join()


def test_values_are_texts_with_units(folder: Path) -> None:
    session = Session(folder / "swing.bg")
    session.load()
    found = json.loads(session.run("go", {"k": "0.016 N/mm", "m": "2000 g", "r": "4 [N*s/m]"}))
    assert final(found["run"]) == pytest.approx(1 / 16, rel=1e-4)
    assert found["set"] == {"k": 16, "m": 2, "r": 4}  # in the author's units
    for wrong in ("4 kg", "4 N/", "", "1e400", "nan", "1 + 1", "4 um/m"):
        told = json.loads(session.run("go", {"k": wrong, "m": "1 kg"}))
        assert told["kind"] == "unread" and list(told["wrong"]) == ["k"] and "in N/m" in told["wrong"]["k"]


def test_numbers_of_the_text_keep_their_digits() -> None:
    """Those that are computed have six: nobody reads more, and none is sent before it is changed."""
    text = 'model A {{\n  parameter eps0 = 8.8541878128e-12 [F/m], l = {}, n: um = -1234567.5, third = l/3 "a hundredth of n"\n  R r : u = i*1 ohm\n  C c : q = 1 F*u\n  Se s : u = 1 V\n  s -> 1(c, r)\n}}\n'
    model = bondgraph.load(text.format("0.30000001 m"))
    assert [p["value"] for p in parameters_of(model)] == [8.8541878128e-12, 0.30000001, -1234567.5, 0.1]
    assert [p["value"] for p in parameters_of(bondgraph.load(text.format("100 um")))][1::2] == [100, 33.3333]


COLOURED = {
    "  Part a { R = R_1, C=2 }": [], "C  spring : F = k*x { start C.x = 1 mm }": ["kind C", "word start"], "  1  body": [], "push -> body -> mass": [], "  time = 3": [],
    "for i in 1 { R r[i] : e = f }": ["word for", "word in", "kind R"], "mode on = true; R r": ["word mode", "word true", "kind R"],
    "y = if not on then pi else time": ["word if", "word not", "word pi", "word else", "word time"],
}  # fmt: skip


def spans(text: str) -> list[str]:
    """Classes and words of a report's listing."""
    return [f"{k} {html.unescape(w)}" for k, w in re.findall(r'<span class="(\w+)">(.*?)</span>', text_markup([Source("a.bg", text)]))]  # fmt: skip


def test_a_letter_is_a_kind_where_it_declares() -> None:
    """In a report; the editor's colours are compared with it below."""
    for line, coloured in COLOURED.items():
        assert [s for s in spans(line) if s.startswith(("kind", "word "))] == coloured, line


def test_a_swept_axis_has_the_author_s_unit(tmp_path: Path) -> None:
    path = tmp_path / "slow.bg"
    swept = "sweep m = 500 g, 1 kg; simulate 0 .. 1 s; report x in mm }\n  experiment rest { sweep push = 1 mN, 2 mN; equilibrium }\n}"
    path.write_text(TEXT.rstrip().removesuffix("}") + "  experiment family { " + swept, encoding="utf-8")
    session = Session(path)
    session.load()
    family, rest = (json.loads(session.run(name, {}))["plot"] for name in ("family", "rest"))
    assert family["axis"] is None and [o["name"] for o in family["outputs"]] == ["x, m = 0.5 kg", "x, m = 1 kg"]
    assert rest["axis"] == {"name": "push", "unit": "N", "log": False}


def test_files_of_a_folder(folder: Path) -> None:
    session = Session(folder)
    session.load()
    assert session.names == ("swing.bg", "sub/windows.bg") and session.name == "swing.bg"
    session.open("sub/windows.bg")
    windows, before = folder / "sub" / "windows.bg", session.shown.stamp
    assert session.shown.text == TEXT  # line ends are the file's matter
    changed = TEXT.replace("m = 2 kg", "m = 3 kg")
    assert json.loads(session.save("sub/windows.bg", changed, before))["saved"]
    assert windows.read_bytes() == changed.replace("\n", "\r\n").encode() and session.shown.text == changed
    # somebody else's change is not overwritten, and no file that exists already by a new one
    assert not json.loads(session.save("sub/windows.bg", TEXT, before))["saved"]
    assert not json.loads(session.save("swing.bg", "model A {}\n", ""))["saved"]
    assert b"3 kg" in windows.read_bytes() and (folder / "swing.bg").read_text(encoding="utf-8") == TEXT
    assert json.loads(session.save("new.bg", "model New {}\n", ""))["saved"] and session.name == "new.bg"
    (folder / "new.bg").unlink()
    assert not json.loads(session.save("new.bg", "model Lost {}\n", session.shown.stamp))["saved"]
    for name in ("../out.bg", "/out.bg", "sub/../../out.bg", ".hidden.bg", "a/b.bg", "x.txt", "", "x.bg\n"):
        with pytest.raises(UsageError, match="is no model of the folder"):
            session.save(name, "", "")
    with pytest.raises(UsageError, match="about one file"):
        Session(folder / "swing.bg").open("sub/windows.bg")


def test_requests_about_files(server: Server, folder: Path) -> None:
    assert ask(server, "/save", {"file": "swing.bg", "text": "x", "before": ""}, X_Bondgraph_Token="")[0] == 403
    for body in ({}, {"file": 1, "text": "", "before": ""}, {"file": "swing.bg", "text": "\ud800", "before": ""}, []):
        assert ask(server, "/save", json.dumps(body).encode())[0] == 400
    assert ask(server, "/open", {"file": "none.txt"})[0] == 400
    long = f"{TEXT}# {'x' * 100_000}\n"  # longer than any other request
    assert json.loads(ask(server, "/check", {"text": long})[1]) == {"problems": "", "lines": [], "corrections": []}
    told = json.loads(ask(server, "/check", {"text": TEXT.replace("r*v", "q*v")})[1])
    assert told["lines"] == [8] and "`q`" in told["problems"] and (folder / "swing.bg").read_text() == TEXT


def test_an_hour(server: Server, folder: Path, open_page: Callable[..., Any], tmp_path: Path) -> None:
    """A quarter car is written with three mistakes, mended by advice, run, pinned, overlaid and exported; F/k_s is what its spring gives at rest."""
    opened = open_page(server.guard.address)
    page = opened.page
    page.on("dialog", lambda d: d.accept("quarter_car.bg") if d.type == "prompt" else d.accept())
    until(page, CURVE)
    page.click("#bar button:has-text('New')")
    until(page, "document.getElementById('file').value === 'quarter_car.bg'")
    for text in ("\n".join(COLOURED), WRONG):
        page.fill("textarea", text)
        listed = page.evaluate(
            "[...document.querySelectorAll('.listing span')].map(s => `${s.className} ${s.textContent}`)"
        )
        assert listed == spans(text)
    until(page, "document.querySelectorAll('#problems li').length === 3")
    assert page.evaluate("[...document.querySelectorAll('.listing .bad')].map(l => l.dataset.at)") == [
        "0:2",
        "0:8",
        "0:9",
    ]
    assert "k_z*x" in page.inner_text("#text .listing") and page.inner_text("#said") == "not saved"
    page.focus("#problems li:nth-child(2) a")
    page.keyboard.press("Enter")
    before = "document.querySelector('textarea').value.slice(0, document.querySelector('textarea').selectionStart)"
    assert page.evaluate(f"{before}.split('\\n').length") == 8
    page.click(".mend button:has-text('k_s')")  # `did you mean`
    until(page, "document.querySelectorAll('#problems li').length === 2")
    page.fill("textarea", page.input_value("textarea").replace("kgg", "kg").replace("m_w*x", "m_w*v"))
    until(page, "document.getElementById('problems').innerText === ''")
    page.keyboard.press("Control+s")
    first = until(page, f"document.title === 'QuarterCar' && {CURVE}")
    assert (folder / "quarter_car.bg").read_text(encoding="utf-8") == QUARTER and page.inner_text("#said") == ""

    page.focus("#plots button:has-text('pin')")
    page.keyboard.press("Enter")
    entry = page.locator(".slider input[aria-label^='k_s in']")
    assert entry.input_value() == "20 kN/m"
    entry.fill("40 kg")
    entry.press("Enter")
    assert "`40 kg` is no quantity in kN/m" in until(
        page, "document.querySelector('.slider .wrong:not([hidden])')?.innerText"
    )
    entry.fill("40")  # in the unit that stands there
    entry.press("Enter")
    until(
        page, f"{CURVE} !== {first!r} && document.querySelectorAll('.plot')[0].querySelectorAll('.curve').length === 2"
    )
    assert entry.input_value() == "40 kN/m" and page.locator(".slider .wrong:not([hidden])").count() == 0
    assert "travel (bump)" in page.inner_text("#plots .legend >> nth=0")
    with page.expect_download() as download:
        page.locator("#plots .panel >> nth=0").get_by_role("button", name="CSV").click()
    download.value.save_as(tmp_path / "travel.csv")
    head, *rows = csv.reader((tmp_path / "travel.csv").read_text(encoding="utf-8").splitlines())
    assert head == ["time [s]", "travel [mm]", "travel (bump) [mm]"]
    assert [float(x) for x in rows[-1]] == pytest.approx([8, 25, 50], rel=1e-4)
    with page.expect_download() as download:
        page.locator("#plots .panel >> nth=0").get_by_role("button", name="SVG").click()
    download.value.save_as(tmp_path / "travel.svg")
    drawn = (tmp_path / "travel.svg").read_text(encoding="utf-8")
    assert drawn.count('class="curve') == 2 and "travel (bump) [mm]" in drawn and "stroke-dasharray: 7" in drawn
    page.click(".pins button")
    until(page, "document.querySelectorAll('.plot')[0].querySelectorAll('.curve').length === 1")

    page.fill("textarea", QUARTER.replace("300 kg", "301 kg"))
    write_text(folder / "quarter_car.bg", QUARTER + "# elsewhere\n")  # in one step, as editors do
    until(page, "document.getElementById('said').innerText.includes('changed on disk')")
    page.keyboard.press("Control+s")
    assert (folder / "quarter_car.bg").read_text(encoding="utf-8").endswith("# elsewhere\n")
    page.click("#bar button:has-text('take')")
    assert page.input_value("textarea").endswith("# elsewhere\n")
    page.fill("textarea", QUARTER.replace("300 kg", "302 kg"))
    write_text(folder / "quarter_car.bg", QUARTER + "# again\n")
    until(page, "document.getElementById('said').innerText.includes('changed on disk')")
    page.click("#bar button:has-text('save this one')")
    until(page, "document.getElementById('said').innerText === ''")
    assert "302 kg" in (folder / "quarter_car.bg").read_text(encoding="utf-8")
    until(page, "!document.body.classList.contains('busy')")
    page.select_option("#file", "swing.bg")
    until(page, "document.title === 'Swing'")
    assert opened.console == [] and opened.elsewhere(f"http://127.0.0.1:{server.server_port}", "blob:") == []


def test_help_at_the_cursor(server: Server, open_page: Callable[..., Any]) -> None:
    """By keyboard and pointer: the value and law of what stands there, words that may follow, a part with the import that it needs."""
    for body in ({"text": "", "at": 1}, {"text": "", "at": "-1"}, {"text": ""}):
        assert ask(server, "/hover", body)[0] == 400
    assert json.loads(ask(server, "/hover", {"text": "", "at": "99"})[1]) == []
    opened = open_page(server.guard.address)
    page = opened.page
    until(page, CURVE)

    def at(words: str, behind: bool = True) -> None:
        page.evaluate("([words, behind]) => { const a = document.querySelector('textarea'); a.focus(); const n = a.value.indexOf(words) + (behind ? words.length : 0); a.setSelectionRange(n, n); }", [words, behind])  # fmt: skip

    written = f"# \U0001d714, one letter of two codes\n{TEXT}"
    page.fill("textarea", written)
    about = "!document.getElementById('suggestions').hidden && document.querySelector('#suggestions .about').innerText"
    at("C  spring")
    page.keyboard.press("F1")
    told = until(page, about)
    assert told.startswith("C spring") and "translation" in told and "F = k*x" in told
    page.keyboard.press("Escape")
    assert not page.locator("#suggestions").is_visible()
    spring = page.locator("#text .listing li", has_text="C  spring").locator("code")
    box = spring.bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + 8)
    assert until(page, about) == told
    page.keyboard.press("Escape")

    at("r*v")
    page.keyboard.type(" + spring.")
    until(page, "document.querySelectorAll('#offered li').length > 1")
    assert opened.obstacles() == []
    assert "F" in page.locator("#offered li b").all_inner_texts()
    page.keyboard.press("Escape")
    at("experiment go", behind=False)
    page.keyboard.type("param")
    until(page, "document.querySelector('#offered b')?.innerText === 'parameter'")
    assert page.get_attribute("textarea", "aria-activedescendant") == "offered-0"
    page.keyboard.press("Tab")
    chosen = "(a => a.value.slice(a.selectionStart, a.selectionEnd))(document.querySelector('textarea'))"
    assert page.evaluate(chosen) == "name"
    page.keyboard.type("c = 1; Resi")
    page.keyboard.press("Control+ ")
    until(page, "!document.getElementById('suggestions').hidden && document.querySelector('#offered b')?.innerText")
    page.keyboard.press("Enter")
    text = page.input_value("textarea")
    assert "import Resistor from " in text and "parameter c = 1; Resistor resistor" in text
    while page.input_value("textarea") != written:  # all of it can be taken back
        page.keyboard.press("Control+z")
    assert opened.console == []


def test_analyses_are_curves(tmp_path: Path) -> None:
    """x/push = 1/(k - m w^2 + i r w); rest at push/k; half of the points lie below 1/k at the middle of an even distribution of k."""
    experiments = """  experiment lines { response push to x over 0.01 Hz .. 10 Hz { points = 31 } }
  experiment along { continue push over 0 N .. 4 N; report x in mm }
  experiment chances { montecarlo k = uniform(6 [N/m], 10 [N/m]) { samples = 64, indices = 0 }; equilibrium; report x in mm }
  experiment lead { invert push to x = 8 mm*smoothstep9(time, 0 s, 1 s) over 0 .. 2 s { points = 21 }; report x in mm }
  experiment find { simulate 0 .. 1 s; fit r to "bench.csv"; report x in mm }
  experiment shapes { modes }
  experiment both { simulate 0 .. 1 s; modes }
}
"""
    (tmp_path / "bench.csv").write_text("time [s],x [mm]\n0.2,2\n0.4,\n0.8,20\n1,30\n", encoding="utf-8")
    path = tmp_path / "lines.bg"
    path.write_text(TEXT.rstrip().removesuffix("}") + experiments, encoding="utf-8")
    session = Session(path)
    session.load()
    plots = {
        name: json.loads(session.run(name, {}))["plot"]
        for name in ("lines", "along", "chances", "lead", "find", "shapes")
    }
    axes = {name: tuple((plot["axis"] or {}).values()) for name, plot in plots.items()}
    assert axes == {
        "lines": ("frequency", "Hz", True),
        "along": ("push", "N", False),
        "chances": ("share of the points below", "%", False),
        "lead": (),
        "find": ("line of the data", "", False),
        "shapes": ("frequency", "Hz", True),
    }
    assert [o["unit"] for o in plots["lines"]["outputs"]] == ["dB of m/N", "deg"]
    frequency = unpacked(plots["lines"]["time"])
    magnitude, phase = np.split(unpacked(plots["lines"]["values"]), 2)
    w = 2 * np.pi * frequency
    response = 1 / (8 - 2 * w**2 + 0.5j * w)
    assert magnitude == pytest.approx(20 * np.log10(np.abs(response)), abs=1e-6)
    assert phase == pytest.approx(np.degrees(np.unwrap(np.angle(response))), abs=1e-6)
    assert plots["along"]["outputs"] == [{"name": "x", "unit": "mm"}]
    assert unpacked(plots["along"]["values"]) == pytest.approx(unpacked(plots["along"]["time"]) / 8 * 1e3)
    below = unpacked(plots["chances"]["values"])
    assert (plots["chances"]["outputs"][0]["unit"], len(below)) == ("mm", 201)
    assert below[[0, 100, 200]] == pytest.approx([100, 125, 1e3 / 6], rel=0.03)
    assert plots["lead"]["outputs"] == [{"name": "x", "unit": "mm"}, {"name": "push", "unit": "N"}]
    way, force = unpacked(plots["lead"]["values"]).reshape(2, 21)
    assert (force[-1], way[-1]) == pytest.approx((8 * 8e-3, 8))
    measured, computed = unpacked(plots["find"]["values"]).reshape(2, 4)
    assert measured == pytest.approx([2, np.nan, 20, 30], nan_ok=True) and 0 < computed[2] < computed[3] < 60
    assert [o["name"] for o in plots["find"]["outputs"]] == ["x, measured", "x, computed"]
    assert unpacked(plots["shapes"]["time"]) == pytest.approx([1 / np.pi] * 3)
    assert unpacked(plots["shapes"]["values"]) == pytest.approx([0, 0.5 / (2 * np.sqrt(8 * 2)), np.nan], nan_ok=True)
    both = json.loads(session.run("both", {}))
    assert both["kind"] == "run" and "0.318" in both["told"]
