"""The page of a model as text: complete, small, without access to the outside, and not affected by code in a model's text."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import pytest

import bondgraph
from bondgraph.presentation.page import report_text
from bondgraph.presentation.page.certificate import certificate_markup
from bondgraph.presentation.page.markup import Html, joined, tag, text
from bondgraph.presentation.page.mathml import formula, name
from bondgraph.presentation.page.shell import data_text
from compiler.algebra.expression import Number, Symbol, call, divide
from tests.compiling import MODELS

HOSTILE = """# </script><script>alert(1)</script> & <img src=x onerror=alert(2)>
model Hostile {
  "</title><script>window.broken = 1</script> <b onclick='x'>"
  parameter m = 1 kg "'><svg onload=alert(3)> </script> &lt; "
  Se push : F = 1 N*step(time - 0.1 s)
  1  body   "<!-- --><style>*{display:none}</style>"
  I  mass : p = m*v
  push -> body -> mass
  output speed = body.v "<script>"
  experiment go { simulate 0 .. 1 s; report speed in mm/s }
}
"""
# The slower pole of the motor: x^2 + (R/L + c/J) x + (K^2 + R c)/(L J), with all inertia and friction at the rotor.
J, C = 2e-5 + 0.01 / 20**2, 1e-3 / 20**2
SUM, PRODUCT = 1 / 0.5e-3 + C / J, (0.05**2 + C) / (0.5e-3 * J)
SLOW = (SUM - math.sqrt(SUM**2 - 4 * PRODUCT)) / 2 / (2 * math.pi)


class Reader(HTMLParser):
    """The elements of a page, with the attributes that could do something."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.doing: list[str] = []
        self.text: dict[str, list[str]] = {}

    def handle_starttag(self, name: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(name)
        self.doing += [f"{key}={value}" for key, value in attributes if key.startswith("on") or key in ("src", "style")]
        self.doing += [
            f"{key}={value}" for key, value in attributes if key == "href" and not (value or "").startswith("#")
        ]

    def handle_data(self, data: str) -> None:
        if self.tags:
            self.text.setdefault(self.tags[-1], []).append(data)


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    return reader


@pytest.fixture(scope="module")
def page() -> str:
    return report_text(bondgraph.load(MODELS / "dc_motor.bg"))


def test_the_page_is_one_file_that_asks_nobody(page: str) -> None:
    found = read(page)
    assert found.tags.count("script") == 2 and found.tags.count("style") == 1
    assert not {"link", "iframe", "img", "object", "embed", "form", "base"} & set(found.tags)
    assert found.doing == []
    assert set(re.findall(r"https?://[^\"'\s<)]+", page)) == {"http://www.w3.org/2000/svg"}  # a name, no address
    assert "@import" not in page and "url(" not in page


def test_what_runs_is_named_by_its_hash(page: str) -> None:
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert "unsafe" not in policy and "*" not in policy and "default-src &#x27;none&#x27;" in policy
    for kind in ("script", "style"):
        (inside,) = re.findall(rf"<{kind}>(.*?)</{kind}>", page, re.S)
        assert b64encode(sha256(inside.encode()).digest()).decode() in policy


def test_all_parts_are_there(page: str) -> None:
    found = read(page)
    assert {"svg", "math", "mfrac", "msub", "ol", "dl", "table"} <= set(found.tags)
    data = json.loads(re.findall(r'id="data">(.*?)</script>', page, re.S)[0])
    (experiment,) = data["experiments"]
    assert experiment["name"] == "start_up" and [o["name"] for o in experiment["run"]["outputs"]] == [
        "speed",
        "current",
    ]
    assert len(data["modes"]) == 2 and data["modes"][0]["frequency"] == pytest.approx(SLOW, rel=1e-6)
    assert "of 2 degrees of freedom" in page
    assert "of 1 degree of freedom" in certificate_markup(bondgraph.load(MODELS / "oscillator.bg").certificate)
    assert "is in derivative form" in page and "linear-implicit ODE" in page
    nodes = {n["name"]: n["at"] for n in data["parts"]["nodes"]}
    assert nodes["gearbox"] == ["0:18"]  # the line of the text that declares it


def test_a_models_text_is_only_ever_text() -> None:
    page = report_text(bondgraph.load(HOSTILE))
    found = read(page)
    assert found.tags.count("script") == 2 and found.tags.count("style") == 1 and found.doing == []
    assert not {"img", "b", "iframe"} & set(found.tags)
    assert found.tags.count("title") == len(re.findall(r"<title>", page))
    listing = "".join(re.sub(r"<[^>]*>", "", line) for line in re.findall(r"<li data-at.*?</li>", page))
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in listing


def test_data_cannot_end_its_element() -> None:
    told = data_text({"name": "</script><!--\u2028&", "nan": float("nan"), "list": (1, float("inf"))})
    assert not set("<>&\u2028") & set(told)
    assert json.loads(told) == {"name": "</script><!--\u2028&", "nan": None, "list": [1, None]}


def test_markup_escapes_what_is_no_markup() -> None:
    assert (
        tag("p", "<b>", Html("<i></i>"), class_='"x', hidden=True, id=None)
        == '<p class="&quot;x" hidden>&lt;b&gt;<i></i></p>'
    )
    assert joined(["a<", tag("br")], ", ") == "a&lt;, <br>"
    assert text("right\u202eleft\nnext") == "right\\u202eleft\nnext"


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ("mass.p", "<msub><mi>p</mi><mtext>mass</mtext></msub>"),
        ("gear.omega2", "<msub><mi>ω</mi><mtext>2, gear</mtext></msub>"),
        ("d[1]", "<msub><mi>d</mi><mtext>1</mtext></msub>"),
        ("k", "<mi>k</mi>"),
        ("right side of the loop for <x>", "<mtext>right side of the loop for &lt;x&gt;</mtext>"),
    ],
)
def test_names_are_typeset(words: str, shown: str) -> None:
    assert name(words) == shown


def test_expressions_are_typeset() -> None:
    x, y = Symbol("x"), Symbol("y")

    def written(expression: object) -> str:
        return re.sub(r"</?m\w+[^>]*>", " ", formula(expression, lambda key: name(str(key)))).split()  # type: ignore[arg-type]

    assert "".join(written(x - y * 2)) == "x−2y"
    assert "".join(written((x + y) * (x - y))) == "(x+y)(x−y)"
    assert "".join(written(divide(Number(-1.0), x) * y * Number(-1.0))) == "1xy"  # signs are gathered: 1/x y
    assert "".join(written(x * y * x)) == "x2y"
    assert "".join(written(call("sqrt", x) ** 2.0)) in ("x", "x2")
    assert "".join(written(Number(8.85e-12) * x)) == "8.85·10-12x" or "10" in "".join(written(Number(8.85e-12) * x))


@pytest.mark.machine_code
def test_the_page_of_the_manipulator_is_small(manipulator_page: Path) -> None:
    assert manipulator_page.stat().st_size <= 1_500_000


def test_ticks_of_powers_are_round_numbers() -> None:
    """Decades; 1, 2 and 5 where there are two of them at most; all round ones inside one of these."""
    if (node := shutil.which("node")) is None:
        pytest.skip("no node")
    script = (Path(bondgraph.__file__).parent / "presentation/page/scripts/plot.js").read_text(encoding="utf-8")
    begin, end = script.index("// Round numbers inside a range."), script.index("// A tick with as many")
    spans = "[[0.1, 3], [0.5, 20], [0.01, 1000], [20, 30]]"
    shown = f"{spans}.map(([a, b]) => powerTicks(Math.log10(a), Math.log10(b), 6).map((t) => +(10 ** t).toFixed(6)))"
    done = subprocess.run([node, "-p", f"{script[begin:end]} JSON.stringify({shown})"], capture_output=True, check=True)
    few, more, decades, inside = json.loads(done.stdout)
    assert (few, more) == ([0.1, 0.2, 0.5, 1, 2], [0.5, 1, 2, 5, 10, 20])
    assert (decades, inside) == ([0.01, 0.1, 1, 10, 100, 1000], [20, 22, 24, 26, 28, 30])
