"""A headless Chromium for the tests of pages, if this machine has one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import bondgraph
from bondgraph.presentation.page import report_text
from tests.compiling import MODELS
from tests.page.chromium import FLAGS, found_browser

OBSTACLES = Path(__file__).with_name("obstacles.js").read_text(encoding="utf-8")


@dataclass
class Opened:
    """A page in the browser, its console, and its requests."""

    page: Any
    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def watch(self) -> None:
        self.page.on("console", lambda m: self.console.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda e: self.console.append(str(e)))
        self.page.on("request", lambda r: self.requests.append(r.url))

    def elsewhere(self, *homes: str) -> list[str]:
        """Requests to anything but a file, data, and the given origins."""
        return [url for url in self.requests if not url.startswith(("file:", "data:", *homes))]

    def obstacles(self) -> list[str]:
        """What keeps people with a keyboard alone, a screen reader or weak eyes from what the page shows now."""
        found: list[str] = self.page.evaluate(OBSTACLES)
        return found


@pytest.fixture(scope="session")
def manipulator_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the manipulator, with its three experiments."""
    path = tmp_path_factory.mktemp("page") / "manipulator.html"
    path.write_text(report_text(bondgraph.load(MODELS / "manipulator.bg")), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Skips where playwright or the browser is missing."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="pages are tried in a browser with the extra `browser`"
    )
    program = found_browser()
    if program is None:
        pytest.skip("pages are tried in a browser: install chromium")
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=program, args=list(FLAGS), env={**os.environ})
        yield made
        made.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[..., Opened]]:
    """Opens an address in a window of some width, light or dark."""
    contexts = []

    def opened(url: str, width: int = 1280, dark: bool = False) -> Opened:
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light"
        )
        contexts.append(context)
        found = Opened(context.new_page())
        found.watch()
        found.page.goto(url)
        return found

    yield opened
    for context in contexts:
        context.close()
