"""The worked changes of the page for contributors: each applies to these sources, and its own test passes then."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.compiling import ROOT

PATCHES = sorted((ROOT / "bondgraph" / "manual" / "worked").glob("*.patch"))
TRIED = """
import runpy, sys

for path in sys.argv[1:]:
    tests = [noun for name, noun in runpy.run_path(path).items() if name.startswith("test_")]
    assert tests, path
    for test in tests:
        test()
"""


def test_worked_changes(tmp_path: Path) -> None:
    for package in ("bondgraph", "compiler"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("manual"), copy_function=shutil.copy2
        )
    added = []
    for patch in PATCHES:
        done = subprocess.run(["git", "apply", str(patch)], cwd=tmp_path, env=os.environ | {"GIT_CEILING_DIRECTORIES": str(tmp_path.parent)}, capture_output=True, text=True, check=False)  # fmt: skip
        assert done.returncode == 0, f"{patch.name} does not apply: renew it\n{done.stderr}"
        added += re.findall(r"^\+\+\+ b/(tests/.*)$", patch.read_text(encoding="utf-8"), re.M)
    assert len(added) == len(PATCHES) == 3
    done = subprocess.run([sys.executable, "-c", TRIED, *added], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = (ROOT / "bondgraph" / "manual" / "contributing.md").read_text(encoding="utf-8")
    assert all(f"worked/{patch.name}" in page for patch in PATCHES)
