"""The short version of the stress tests, in this process's back-end: nothing fails that is not known to."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stress.__main__ import SECTIONS, stress


@pytest.mark.few(7)
@pytest.mark.parametrize("name", SECTIONS)
def test_short(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page is written, and reports nothing new."""
    code = stress((name,), True, tmp_path)
    page = (tmp_path / "short.md").read_text(encoding="utf-8")
    assert code == 0, page
    assert "tried" in page and "Traceback" not in page
