"""`python tests/stress [--short] [--results FOLDER] [SECTION ...]`: stress tests, with a page that tells what was tried and what came of it."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
import tempfile
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.stress.report import Section

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

SECTIONS = (
    "scales",
    "drift",
    "proportion",
    "kinks",
    "instants",
    "assemblies",
    "events",
    "faults",
    "edits",
    "machines",
    "gallery",
)


def main(arguments: list[str] | None = None) -> int:
    """Run the sections, write the page; 1 if something failed that is not known to."""
    parser = argparse.ArgumentParser(prog="python tests/stress", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"only these: {', '.join(SECTIONS)}")
    parser.add_argument("--short", action="store_true", help="a version of some 40 s")
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results", help="where the page goes")
    given = parser.parse_args(arguments)
    unknown = set(given.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"there is no section {', '.join(sorted(unknown))}; sections are {', '.join(SECTIONS)}")
    return stress(given.sections or SECTIONS, given.short, given.results)


def stress(names: list[str] | tuple[str, ...], short: bool, folder: Path) -> int:
    """Run these sections and write the page into a folder."""
    from tests.stress import report, standing

    folder.mkdir(parents=True, exist_ok=True)
    sections = []
    for name in names:
        began = sum(os.times()[:4])
        section = _section(name, short, folder)
        section.seconds = sum(os.times()[:4]) - began  # of computing, in this process and its children
        sections.append(section)
        print(
            f"{section.title}: {section.tried} tried, {len(section.failed)} failed, {len(section.refused)} refused, {section.seconds:.0f} s",
            flush=True,
        )
        for finding in section.failed:
            print(f"  {finding.where}: {finding.what[:300]}", flush=True)
    new = standing.unknown(sections)
    about = [
        f"`python tests/stress{' --short' if short else ''}{'' if len(names) == len(SECTIONS) else ' ' + ' '.join(names)}`, "
        f"Python {platform.python_version()}, {platform.machine()}, {sum(s.seconds for s in sections):.0f} s.",
        *standing.told(sections),
    ]
    path = folder / ("short.md" if short else "stress.md" if len(names) == len(SECTIONS) else f"{'-'.join(names)}.md")
    path.write_text(report.page(sections, "Stress tests", about), encoding="utf-8")
    print(f"wrote {path}; {len(new)} failures that were not known", flush=True)
    return 1 if new else 0


def _section(name: str, short: bool, folder: Path) -> Section:
    from tests.stress.report import Section

    try:
        module = importlib.import_module(f"tests.stress.{name}")
        return module.section(short, folder) if name in ("drift", "proportion") else module.section(short)
    except Exception as error:
        section = Section(name)
        section.fail("the section itself", f"{type(error).__name__}: {error}; {traceback.format_exc(limit=-3)}")
        return section


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="bondgraph-stress-") as kept:
        os.environ.setdefault("BONDGRAPH_CACHE", kept)
        code = main()
    sys.exit(code)
