"""The page in a headless Chromium: everything moves together, by pointer and by keyboard, and nothing leaves the machine."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import bondgraph
from bondgraph.presentation.page import report_text
from tests.compiling import MODELS
from tests.page.test_page import HOSTILE

Open = Callable[..., Any]
CURVES = "[...document.querySelectorAll('.plot .curve')].map(c => c.getAttribute('d').length)"


def written(model: bondgraph.Model, folder: Path) -> str:
    path = folder / "page.html"
    path.write_text(report_text(model), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def motor(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(bondgraph.load(MODELS / "dc_motor.bg"), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(bondgraph.load(MODELS / "pendulum.bg"), tmp_path_factory.mktemp("page"))


def to_instant(page: Any, share: float) -> None:
    page.evaluate(
        "share => { const r = document.getElementById('instant'); r.value = 1000*share; r.dispatchEvent(new Event('input')); }",
        share,
    )


def test_plots_are_drawn_and_nothing_is_asked(motor: str, open_page: Open) -> None:
    opened = open_page(motor)
    lengths = opened.page.evaluate(CURVES)
    assert len(lengths) > 5 + 3 and min(lengths) > 1000  # speed, current, three energies, and powers
    assert "supply" in opened.page.inner_text("#plots figure:last-child .legend")
    assert opened.console == [] and opened.elsewhere() == []


def test_a_bond_under_the_pointer_tells_its_numbers(motor: str, open_page: Open) -> None:
    opened = open_page(motor)
    to_instant(opened.page, 1.0)
    bond = opened.page.locator("g.bond[data-tail='supply'] path.target")
    bond.hover(force=True)
    told = opened.page.inner_text("#bond").replace("−", "-")
    assert "supply" in told
    numbers = re.findall(r"=\s*(-?[\d.e-]+) (\w)?", told)
    effort, flow, power = (float(x) * {"m": 1e-3, "µ": 1e-6}.get(prefix, 1.0) for x, prefix in numbers)
    assert effort == pytest.approx(12, rel=1e-3)
    assert power == pytest.approx(effort * flow, rel=2e-3) and power > 0


def test_power_is_the_width_behind_a_bond(motor: str, open_page: Open) -> None:
    opened = open_page(motor)
    widths = "[...document.querySelectorAll('.flow')].map(f => parseFloat(f.style.strokeWidth))"
    assert max(opened.page.evaluate(widths)) == 0  # nothing flows before the step
    to_instant(opened.page, 0.03)
    supply, *others = opened.page.evaluate(widths)
    assert supply > 5 and max(others) <= supply + 1e-9
    opened.page.uncheck("#power")
    assert max(opened.page.evaluate(widths)) == 0


def test_text_and_diagram_light_each_other(motor: str, open_page: Open) -> None:
    opened = open_page(motor)
    opened.page.hover("li[data-at='0:18'] code")
    assert opened.page.evaluate("[...document.querySelectorAll('g.node.lit')].map(g => g.dataset.name)") == ["gearbox"]
    opened.page.locator("g.node[data-name='coil']").hover(force=True)
    assert opened.page.evaluate("[...document.querySelectorAll('li.lit')].map(l => l.dataset.at)") == ["0:14"]


def test_zoom_by_dragging_and_by_keys(motor: str, open_page: Open) -> None:
    page = open_page(motor).page
    ticks = "[...document.querySelectorAll('.plot:first-of-type')][0].querySelectorAll('.tick').length && [...document.querySelector('.plot').querySelectorAll('.tick')].map(t => t.textContent).join()"
    before = page.evaluate(ticks)
    page.locator(".plot").first.scroll_into_view_if_needed()
    box = page.locator(".plot").first.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 60)
    page.mouse.up()
    near = page.evaluate(ticks)
    assert near != before
    page.locator(".plot").first.focus()
    page.keyboard.press("0")
    assert page.evaluate(ticks) == before
    page.keyboard.press("+")
    assert page.evaluate(ticks) != before
    page.click("#plots .tools button:has-text('all')")
    assert page.evaluate(ticks) == before


def test_by_keyboard_alone(motor: str, open_page: Open) -> None:
    from playwright.sync_api import expect

    page = open_page(motor).page
    seen = set()
    for _ in range(90):
        page.keyboard.press("Tab")
        seen.add(page.evaluate("(e => e.id || e.getAttribute('class') || e.tagName)(document.activeElement)"))
    assert {"power", "sheet", "plot", "play", "instant"} <= {word for name in seen for word in name.split()}
    page.focus("#play")
    page.keyboard.press("Enter")
    # Not wait_for_function: what it asks a second time is text that the page's policy does not let run.
    expect(page.locator("#instant")).not_to_have_value("0", timeout=30_000)
    page.keyboard.press("Enter")
    assert page.get_attribute("#play", "aria-label") == "play"


def test_a_mechanism_moves_with_the_cursor(pendulum: str, open_page: Open) -> None:
    opened = open_page(pendulum)
    shape = "[...document.querySelectorAll('.stage .plate')].map(p => p.getAttribute('d')).join()"
    first = opened.page.evaluate(shape)
    assert first and "NaN" not in first
    to_instant(opened.page, 0.3)
    then = opened.page.evaluate(shape)
    assert then != first and "NaN" not in then
    cursor = opened.page.get_attribute(".plot .cursor", "d")
    to_instant(opened.page, 0.6)
    assert opened.page.get_attribute(".plot .cursor", "d") != cursor and opened.page.evaluate(shape) != then
    assert opened.console == []


@pytest.mark.parametrize(("width", "dark"), [(390, False), (390, True), (1280, True)])
def test_it_fits(motor: str, open_page: Open, width: int, dark: bool) -> None:
    page = open_page(motor, width, dark).page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    red, green, blue = map(
        int, re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))[:3]
    )
    assert (red + green + blue < 120) == dark
    letter = page.evaluate("getComputedStyle(document.querySelector('.bondgraph .letter')).fill")
    assert (int(re.findall(r"\d+", letter)[0]) > 128) == dark


def test_a_hostile_model_does_nothing(open_page: Open, tmp_path: Path) -> None:
    opened = open_page(written(bondgraph.load(HOSTILE), tmp_path))
    dialogs: list[str] = []
    opened.page.on("dialog", lambda d: dialogs.append(d.message))
    opened.page.hover("g.bond path.target", force=True)
    assert opened.page.evaluate("window.broken") is None
    assert dialogs == [] and opened.console == [] and opened.elsewhere() == []
    assert opened.page.locator("#text .listing").inner_text().count("<script>") == 3


@pytest.mark.machine_code
def test_the_manipulator(manipulator_page: Path, open_page: Open) -> None:
    """Three experiments, a stage of four bodies, its modes; the time until the page is usable is printed."""
    opened = open_page(manipulator_page.as_uri())
    page = opened.page
    print("interactive after", page.evaluate("performance.getEntriesByName('interactive')[0].startTime"), "ms")
    assert min(page.evaluate(CURVES)) > 1000
    first = page.evaluate("document.querySelector('.plot .curve').getAttribute('d')")
    page.click("#choice button:has-text('drive_560')")
    assert page.evaluate("document.querySelector('.plot .curve').getAttribute('d')") != first
    assert page.locator(".stage .plate").count() == 4
    page.select_option("#choice select", "0")
    assert "1.119 kHz" in page.inner_text("#plots")
    shape = "[...document.querySelectorAll('.stage .plate')].map(p => p.getAttribute('d')).join()"
    to_instant(page, 0.25)
    quarter = page.evaluate(shape)
    to_instant(page, 0.5)
    assert page.evaluate(shape) != quarter and "NaN" not in quarter
    assert opened.console == [] and opened.elsewhere() == []


def test_it_prints_whole(motor: str, open_page: Open) -> None:
    page = open_page(motor, dark=True).page
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details:not([open])").count() == 0 and not page.locator("#player").is_visible()
    hidden = (
        "[...document.querySelectorAll('#text, .equations, .sheet')].filter(e => e.scrollHeight > e.clientHeight + 4)"
    )
    assert page.evaluate(f"{hidden}.length") == 0
    letter = page.evaluate("getComputedStyle(document.querySelector('.bondgraph .letter')).fill")
    assert int(re.findall(r"\d+", letter)[0]) < 128  # dark on paper
