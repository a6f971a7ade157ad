"""Browser for the tests of pages, and its start: headless, without access to the network."""

from __future__ import annotations

import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


def found_browser() -> str | None:
    """The first that is on the path."""
    return next((found for found in map(shutil.which, NAMES) if found), None)
