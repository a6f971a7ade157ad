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


MEASURED = "\ufeff# of the bench\ntime [ms],speed [1/s],current [mA]\n\n5,-1,100\n10,2,200\n20,,300\n9000,1,1\n"


def test_measured_values_marks_and_pictures(motor: str, open_page: Open, tmp_path: Path) -> None:
    """Dots in the panel of their unit, in its unit: 200 mA are 0.2 A. The mark tells differences; a picture has twice the dots of the page."""
    opened = open_page(motor)
    page = opened.page
    panels, whole = page.locator("#plots figure").count(), page.inner_text("#clock")
    legend = "[...document.querySelectorAll('#plots .key')].map(k => k.innerText.replaceAll('\u2212', '-')).filter(t => t.includes('bench'))"
    for name, text in (("bench.csv", MEASURED), ("odd.csv", "x [mm],y\n1,2\n"), ("torn.csv", "time [s],y\n1,two\n"), ("point.csv", "t;y\n1,5;2\n")):  # fmt: skip
        (tmp_path / name).write_text(text, encoding="utf-8")
    files = [tmp_path / name for name in ("bench.csv", "odd.csv", "torn.csv", "point.csv")]
    page.set_input_files("#plots input[type=file]", files)
    page.locator("#plots .note").nth(2).wait_for()
    told = " ".join(page.locator("#plots .note").all_inner_texts())
    assert "`x [mm]`, not a time" in told and "line 2: `two` is no number" in told and "point.csv: it needs two columns" in told  # fmt: skip
    assert page.locator(".curve.dots").count() == 2
    unit = page.evaluate("[...document.querySelectorAll('#plots figure')].filter(f => f.querySelector('.dots.curve')).map(f => f.querySelector('figcaption > small').innerText)")  # fmt: skip
    assert "[A]" in unit and page.inner_text("#clock") == whole
    current = page.locator("#plots .key", has_text="current (bench.csv)")
    page.locator(".plot").first.focus()
    to_instant(page, 0.0)
    assert current.inner_text().split()[-1] == "0.1"  # the nearest one
    page.keyboard.press("m")
    assert current.inner_text().endswith("0.1, Δ 0") and page.inner_text("#apart") == "Δ time = 0 ms"
    to_instant(page, 1.0)
    assert current.inner_text().endswith("0.3, Δ 0.2") and page.inner_text("#apart") == "Δ time = 500 ms"
    with page.expect_download() as download:
        page.locator("#plots .panel").first.get_by_role("button", name="PNG").click()
    dots = Path(download.value.path()).read_bytes()
    width = int(page.evaluate("document.querySelector('.plot').getAttribute('viewBox').split(' ')[2]"))
    assert dots.startswith(b"\x89PNG") and int.from_bytes(dots[16:20], "big") == 2 * width
    page.click(".pins button:has-text('bench.csv')")
    assert page.locator("#plots figure").count() == panels and page.evaluate(legend) == []
    assert opened.console == []


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


SEEN = "document.querySelector('.stage canvas').toDataURL()"
NAMES = "[...document.querySelectorAll('.stage text')].map(t => [t.textContent, Number(t.getAttribute('x')), Number(t.getAttribute('y'))])"


def test_a_mechanism_moves_with_the_cursor(pendulum: str, open_page: Open) -> None:
    opened = open_page(pendulum)
    first = opened.page.evaluate(SEEN)
    to_instant(opened.page, 0.3)
    then = opened.page.evaluate(SEEN)
    assert then != first and "NaN" not in str(opened.page.evaluate(NAMES))
    cursor = opened.page.get_attribute(".plot .cursor", "d")
    to_instant(opened.page, 0.6)
    assert opened.page.get_attribute(".plot .cursor", "d") != cursor and opened.page.evaluate(SEEN) != then
    assert opened.console == []


# The dots of the fine picture, which follows the coarse one of a motion.
FINE = """window.fine = async () => {
  const canvas = document.querySelector('.stage canvas');
  while (canvas.width < 2 * canvas.parentElement.clientWidth) await new Promise((then) => setTimeout(then, 20));
  return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
}"""

TWO = """model Two {
  multibody m : spatial {
    body near { mass = 3 kg, inertia = 1 [kg*m^2]*(0.08, 0.08, 0.08), at = (0, -1 m, 0), start x.v = 0 [m/s] }
    body far  { mass = 3 kg, inertia = 1 [kg*m^2]*(0.08, 0.08, 0.08), at = (0, 1 m, 0), start x.v = 0.4 [m/s] }
    free a : ground to near
    free b : ground to far
  }
  output x = m.far.x
  experiment glide { simulate 0 .. 1 s }
}"""


def test_what_is_near_hides_what_is_far(open_page: Open, tmp_path: Path) -> None:
    """Two balls behind each other, in the colours of their bodies: seen from the front, from behind and from the side; then one moves past."""
    page = open_page(written(bondgraph.load(TWO), tmp_path)).page
    page.evaluate(FINE)
    dots = """async ([key, times]) => {
      for (let i = 0; i < times; i++) document.activeElement.dispatchEvent(new KeyboardEvent('keydown', { key }));
      const { data, width, height } = await fine();
      let near = 0, far = 0;
      for (let i = 0; i < data.length; i += 16) if (data[i + 3] > 200) { if (data[i + 2] > 1.2 * data[i]) near++; else if (data[i] > 1.2 * data[i + 2]) far++; }
      return [4 * near / width / height, 4 * far / width / height];
    }"""

    def turned(key: str, times: int) -> Any:
        return page.evaluate(dots, [key, times])

    page.click("figcaption button:has-text('front')")
    page.focus(".stage")
    near, far = turned("x", 1)
    assert near > 0.02 and far < 0.05 * near
    near, far = turned("ArrowLeft", 18)
    assert far > 0.02 and near < 0.05 * far
    near, far = turned("ArrowRight", 9)
    assert near == pytest.approx(far, rel=0.15) and near > 0.005
    turned("ArrowRight", 9)
    to_instant(page, 1.0)
    near, far = turned("x", 1)
    assert far > 0.2 * near  # it came out from behind
    home = turned("0", 1)
    assert turned("+", 2)[0] > 1.3 * home[0]
    assert turned("0", 1) == pytest.approx(home, rel=0.05)
    box = page.locator(".stage").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 220, box["y"] + 160)
    page.mouse.up()
    assert turned("x", 1)[1] < 0.8 * home[1]  # less of the far one
    page.dblclick(".stage")
    assert turned("x", 1) == pytest.approx(home, rel=0.05)


ABOVE = """model Above {
  multibody m : spatial {
    gravity = (0, 0, -1 [m/s^2])
    body table { mass = 1 kg, shape = box(2 m, 1 m, 0.1 m), colour = blue }
    body ball  { mass = 1 kg, at = (0, 0, 0.9 m), shape = sphere(0.2 m), colour = orange }
    weld foot  : ground to table
    slide rail : ground to ball { along = (1, 0, 0), start x.v = 3 [m/s] }
  }
  output x = m.rail.x
  experiment glide { simulate 0 .. 1 s }
}"""


def test_bodies_cast_shadows(open_page: Open, tmp_path: Path) -> None:
    """A ball in the sun glides over a table, then beyond it: its shadow is on the table, then on the floor; no floor is seen from its level or from below."""
    page = open_page(written(bondgraph.load(ABOVE), tmp_path)).page
    page.evaluate(FINE)
    # Shares of the picture: floor in the sun, floor in shadow, table in the sun, table in shadow (seen from above); and where the floor's shadow is.
    dots = """async keys => {
      for (const key of keys) document.querySelector('.stage').dispatchEvent(new KeyboardEvent('keydown', { key }));
      const { data, width, height } = await fine();
      let sunny = 0, shadow = 0, bright = 0, dim = 0, right = 0;
      for (let i = 0; i < data.length; i += 4) {
        const [r, g, b, a] = data.slice(i, i + 4);
        if (a > 20 && a < 50 && r > 100) sunny++; else if (a > 60 && a < 110 && r < 60) { shadow++; right += i / 4 % width / width; }
        else if (a > 200 && b > 1.2 * r) { if (b > 190) bright++; else if (b < 150) dim++; }
      }
      return [...[sunny, shadow, bright, dim].map((v) => v / width / height), right / shadow];
    }"""
    page.click("figcaption button:has-text('top')")
    floor, shadow, table, dim, before = page.evaluate(dots, ["x"])
    assert floor > 0.2 and shadow > 0.002 and table > 0.02 and 0.05 * table < dim < 0.5 * table
    to_instant(page, 1.0)
    _, more, _, left, after = page.evaluate(dots, ["x"])
    assert more > 1.03 * shadow and left < 0.3 * dim and after > before + 0.02
    page.click("figcaption button:has-text('front')")
    assert page.evaluate(dots, ["x"])[:2] == [0, 0]
    assert page.evaluate(dots, ["ArrowUp"])[:2] == [0, 0]
    assert page.evaluate(dots, ["ArrowDown"] * 4)[1] > 0.002


@pytest.mark.parametrize(("width", "dark"), [(390, False), (390, True), (1280, True)])
def test_it_fits(motor: str, open_page: Open, width: int, dark: bool) -> None:
    opened = open_page(motor, width, dark)
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert opened.obstacles() == []
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
    names = [name for name, *_ in page.evaluate(NAMES)]
    assert names == ["platform", "shuttle[1]", "shuttle[2]", "shuttle[3]", "x", "y", "z"]
    page.select_option("#choice select", "0")
    assert "1.119 kHz" in page.inner_text("#plots")
    to_instant(page, 0.25)
    quarter = page.evaluate(SEEN)
    to_instant(page, 0.5)
    assert page.evaluate(SEEN) != quarter and "NaN" not in str(page.evaluate(NAMES))
    assert opened.obstacles() == []
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 1000})
    ends = "[...document.querySelectorAll('.equations math *')].map(e => e.getBoundingClientRect().right)"
    assert max(page.evaluate(ends)) < 700  # no formula runs off the paper
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
