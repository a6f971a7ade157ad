"""Speed of pages: from an address to a usable page, and from a slider to its new curve, measured in the browser.

    python -m tests.benchmarks pages

Needs the extra `browser` and a Chromium. Times are wall times, so they depend on the load of the machine.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bondgraph
from bondgraph.presentation.page import report_text
from tests.compiling import MODELS, ROOT
from tests.page.chromium import FLAGS, found_browser

RESULTS = Path(__file__).with_name("results")
PAGES = ("dc_motor", "manipulator")
SLIDERS = (("manipulator", "d[1]"), ("manipulator", "h"), ("manipulator", "r"), ("dc_motor", "K"))
TIMES, MOVES = 5, 30
READY = "performance.getEntriesByName('interactive')[0]?.startTime"


def main() -> None:
    from playwright.sync_api import sync_playwright

    program = found_browser()
    if program is None:
        print("no Chromium is on the path")
        return
    lines = ["# Pages", "", f"Wall times on {os.cpu_count()} cores with a load of {os.getloadavg()[0]:.1f}.", ""]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
        lines += ["| page | size, kB | usable after, ms (median, largest) |", "|---|---|---|", *_pages(browser), ""]
        lines += ["| model and slider | to the new curve, ms (median, largest) |", "|---|---|", *_sliders(browser), ""]
        browser.close()
    text = "\n".join(lines)
    print(text)
    (RESULTS / "pages.md").write_text(text, encoding="utf-8")


def _told(times: list[float]) -> str:
    return f"{statistics.median(times):.0f}, {max(times):.0f}"


def _pages(browser: Any) -> Iterator[str]:
    """From opening a file to the end of the page's own start."""
    with TemporaryDirectory() as folder:
        for name in PAGES:
            path = Path(folder) / f"{name}.html"
            path.write_text(report_text(bondgraph.load(MODELS / f"{name}.bg")), encoding="utf-8")
            times = []
            for _ in range(TIMES):
                page = browser.new_page()
                page.goto(path.as_uri())
                times.append(page.evaluate(READY))
                page.close()
            yield f"| {name} | {path.stat().st_size / 1000:.0f} | {_told(times)} |"


def _sliders(browser: Any) -> Iterator[str]:
    """From the event of the slider to the frame after the curve is drawn; the first run, which compiles, is not among them."""
    for name, slider in SLIDERS:
        with _served(MODELS / f"{name}.bg") as address:
            page = browser.new_page()
            page.goto(address)
            _until(lambda page=page: page.evaluate("document.querySelectorAll('.plot .curve').length"))  # type: ignore[misc]
            times = []
            for move in range(MOVES):
                page.evaluate(
                    "([name, value]) => { performance.clearMeasures(); const r = document.querySelector("
                    "`.slider input[type=range][aria-label=\"${name}\"]`); r.value = value; r.dispatchEvent(new Event('input')); }",
                    [slider, 400 + 7 * move],
                )
                times.append(
                    _until(lambda page=page: page.evaluate("performance.getEntriesByName('slider')[0]?.duration"))
                )  # type: ignore[misc]
            page.close()
            yield f"| {name}, {slider} | {_told(times[1:])} |"


@contextmanager
def _served(path: Path) -> Iterator[str]:
    command = [sys.executable, "-u", "-m", "bondgraph", "serve", str(path)]
    server = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        yield server.stdout.readline().rpartition(" at ")[2].split()[0]
    finally:
        server.terminate()
        server.wait()


def _until(found: Callable[[], Any]) -> Any:
    end = time.monotonic() + 120
    while time.monotonic() < end:
        value = found()
        if value:
            return value
        time.sleep(0.05)
    raise TimeoutError("the page does not answer")


if __name__ == "__main__":
    main()
