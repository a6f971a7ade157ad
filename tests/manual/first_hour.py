"""The commands of a built page, run again in processes of their own, beside what the page shows."""

from __future__ import annotations

import html
import math
import os
import re
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

FIRST_RUN = "note: making the machine code of the "  # once on a machine; the page leaves it out, too
MEASURED = re.compile(r"took [\d.]+ \w+")


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Yield the files (name, text) and the commands (line, output) of a page, in their order."""
    text = page.read_text(encoding="utf-8")
    pattern = r'<p class="file-name">.*?<span class="pre">(?P<name>[^<]*)</span>|<pre[^>]*>(?P<block>.*?)</pre>'
    name = ""
    for match in re.finditer(pattern, text, re.DOTALL):
        if match["name"]:
            name = html.unescape(match["name"])
            continue
        block = html.unescape(re.sub(r"<[^>]*>", "", match["block"]))
        if name:
            yield name, block
        for command in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:] if block.startswith("$ bondgraph ") else ():
            line, _, output = command.partition("\n")
            yield f"$ {line}", output
        name = ""


def agree(printed: str, shown: str) -> bool:
    """Return True if the words are the same, and the numbers but for round-off, by which counts of evaluations differ in one of a thousand."""

    def close(a: str, b: str) -> bool:
        if a[-1] == b[-1] == ",":
            a, b = a[:-1], b[:-1]
        try:
            return a == b or math.isclose(float(a), float(b), rel_tol=1e-3 if a.isdigit() else 1e-5, abs_tol=1e-15)
        except ValueError:
            return a == b

    words, others = printed.split(), shown.split()
    return len(words) == len(others) and all(map(close, words, others))


def compare(page: Path, folder: Path, bondgraph: Sequence[str], only: str = "") -> int:
    """Write the files of a page into a folder, run its commands (`only` those that begin so) there, and return how many. Raises AssertionError."""
    count = 0
    for name, text in blocks(page):
        if not name.startswith("$ "):
            (folder / name).write_text(text, encoding="utf-8")
        elif name.startswith(f"$ bondgraph {only}"):
            count += 1
            done = subprocess.run([*bondgraph, *shlex.split(name)[2:]], cwd=folder, env={**os.environ, "COLUMNS": "100"}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)  # fmt: skip
            printed = "\n".join(line for line in done.stdout.splitlines() if not line.startswith(FIRST_RUN))
            assert agree(MEASURED.sub("", printed), MEASURED.sub("", text)), (
                f"{name}\n{printed}\nbut the page shows\n{text}"
            )
    return count
