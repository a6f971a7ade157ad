"""The manual: it builds strictly, everything on it runs, its inner links hold, and its search knows words that users look for."""

from __future__ import annotations

import html
import json
import re
import sys
import tomllib
import warnings
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

import bondgraph
from tests.compiling import ROOT
from tests.manual.first_hour import compare

pytest.importorskip("sphinx", reason="the manual needs the extra `manual`")
pytest.importorskip("myst_parser", reason="the manual needs the extra `manual`")

MANUAL = ROOT / "bondgraph" / "manual"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The built pages, and what the build printed. Pictures of the library's parts are left out: `tests/library` draws them."""
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    from sphinx.cmd.build import build_main

    folder, printed = tmp_path_factory.mktemp("manual"), StringIO()
    with warnings.catch_warnings(), redirect_stdout(printed), redirect_stderr(printed):
        warnings.filterwarnings("ignore", module=r"(sphinx|myst_parser|furo|docutils|sphinx_design)\b")
        code = build_main(["-W", "-n", "-N", "-D", "manual_pictures=0", str(MANUAL), str(folder)])
    problems = re.findall(r"^.*(?:WARNING|ERROR|rror:).*$", printed.getvalue(), re.MULTILINE)
    assert (code, problems) == (0, [])
    return folder, printed.getvalue()


@pytest.mark.machine_code
def test_what_it_shows_was_run(site: tuple[Path, str]) -> None:
    """The count at the end of the build; a failure of any of them has ended the build."""
    counts = re.findall(r"(\d+) (commands|models checked|pieces of Python)", site[1])
    number = {kind: int(count) for count, kind in counts}
    fences = [f for p in MANUAL.rglob("*.md") if p.name != "README.md" for f in re.findall(r"^```\{(\w+)\}", p.read_text(encoding="utf-8"), re.MULTILINE)]  # fmt: skip
    assert number["pieces of Python"] == fences.count("python") > 10
    assert number["commands"] > 60 and number["models checked"] > 60


@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("page", "printed"),
    [
        ("python", r"^0\.0(6|599999\d*|600000\d*)\nmodel Chain {"),  # three times 2 N over 100 N/m
        ("python", r"^1119\.48\d+ "),
        ("python", r"^(8|7\.99999\d*|8\.00000\d*)e-06\n42\.45\d* "),
        ("first_hour", r"^x +9\.67[56]\d* .* um$"),
        ("how_to/fit", r"^fold +2\.6885\d* +(1|1\.0000\d*|0\.9999\d*)$"),  # a third of the gap, volt^2 = 8*k*gap^3/(27*eps0*A)
        ("course/8_mechanisms", r"^0\.49848\d+ Hz"),  # sqrt(g/l)/(2 pi)
        ("course/9_control", r"^speed +9\.52\d* "),  # gain/(gain + b) of the wanted 10 rad/s
        ("course/10_thermal", r"^T +46\.85 "),  # 100 J into 5 J/K, from 300 K
        ("explanations", r"^ +v +458\.177\d* +mV$"),
    ],
)  # fmt: skip
def test_it_prints_what_is_known(site: tuple[Path, str], page: str, printed: str) -> None:
    text = html.unescape(re.sub(r"<[^>]*>", "", (site[0] / f"{page}.html").read_text(encoding="utf-8")))
    assert re.search(printed, text, re.MULTILINE)


@pytest.mark.machine_code
def test_the_first_hour_in_a_process_of_its_own(
    site: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The checks of the page print there what it shows; `.ci/release` does the same with all commands, in fresh environments."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    assert compare(site[0] / "first_hour.html", tmp_path, [sys.executable, "-m", "bondgraph"], "check") == 2


@pytest.mark.machine_code
def test_a_keyboard_and_a_reader_find_their_way(site: tuple[Path, str]) -> None:
    """Blocks that scroll take the focus, headings have a level, pictures a text."""
    for page in ("first_hour", "course/12_mems", "commands"):
        text = (site[0] / f"{page}.html").read_text(encoding="utf-8")
        assert "<pre" in text and "<pre>" not in text
        assert 'role="heading"' in text and 'role="heading">' not in text
        assert all(re.search(r'alt="[^"]+"', image) for image in re.findall("<img[^>]*>", text))


def test_the_version_has_its_changes() -> None:
    """The release page tells the changes of this version, and how to cite it; there is one number."""
    text = (MANUAL / "release.md").read_text(encoding="utf-8")
    assert (
        re.findall(r"^### (\S+)$", text, re.MULTILINE)[0] == bondgraph.__version__
        and f"version = {{{bondgraph.__version__}}}" in text
    )
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {bondgraph.__version__}\n" in citation
    assert "version" in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dynamic"]


@pytest.mark.machine_code
def test_inner_links_hold(site: tuple[Path, str]) -> None:
    """Each page, picture and place in a page that a page names is there."""
    pages = {p: p.read_text(encoding="utf-8") for p in site[0].rglob("*.html")}
    places = {p: set(re.findall(r'\bid="([^"]+)"', text)) for p, text in pages.items()}
    missing = []
    for page, text in pages.items():
        for link in re.findall(r'(?:href|src)="([^"]+)"', text):
            path, place = urldefrag(unquote(link))
            target = (page.parent / path.partition("?")[0]).resolve() if path else page
            if re.match(r"\w+:", link) or (target.is_file() and (not place or place in places.get(target, {place}))):
                continue
            missing.append(f"{page.name}: {link}")
    assert len(pages) > 20 and missing == []


@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("words", "page"),
    [("tearing", "explanations"), ("BG301", "errors"), ("gyrator", "language"), ("pull-in", "how_to/fit")],
)
def test_the_search_finds(site: tuple[Path, str], words: str, page: str) -> None:
    """The index has the page for each word, stemmed as the search of the page stems it."""
    from sphinx.search.en import SearchEnglish

    text = (site[0] / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text[text.index("{") : text.rindex("}") + 1])
    language = SearchEnglish({})
    for word in re.findall(r"\w+", words.lower()):
        if not language.word_filter(word):
            continue
        stem = language.stem(word)
        found = [n for table in ("terms", "titleterms") for n in [index[table].get(stem, [])]]
        numbers = {n for entry in found for n in (entry if isinstance(entry, list) else [entry])}
        assert page in {index["docnames"][n] for n in numbers}, (word, stem)
