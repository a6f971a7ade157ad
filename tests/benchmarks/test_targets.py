"""The page of targets: written again, it keeps its remarks."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks import bench_targets


def test_remarks_below_the_table_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for part in ("counts", "code", "startup", "ensembles", "bandwidths", "calls", "solvers"):
        monkeypatch.setattr(bench_targets, part, lambda: iter(()))
    monkeypatch.setattr(bench_targets, "RESULTS", tmp_path)
    page = tmp_path / "targets.md"
    bench_targets.main()
    first = page.read_text(encoding="utf-8")
    page.write_text(f"{first}\nA remark.\n", encoding="utf-8")
    monkeypatch.setattr(bench_targets, "counts", lambda: iter([("7. more", "1", "at most 2", "yes")]))
    bench_targets.main()
    again = page.read_text(encoding="utf-8")
    assert "7. more" in again and again.endswith(f"{first[-20:]}\nA remark.\n")
