"""`python tests/mutation FOLDER [--number N] [--seed S] [--only ROOM] [--counts]`: random changes of the code, and whether the tests of its room notice them.

First the tests of each room run once under `coverage`, which tells for each line the tests that pass through it; then each mutant is tried by these alone, in a copy of the
repository. A line that none passes through may be machine code only: then the room's tests run with it. `FOLDER/journal.jsonl` has a line for each mutant, so that the same command goes on where it was ended; `--counts` only reports it. A line that starts with `#` and the number of a
mutant in `FOLDER/judged.txt` says why that mutant changes nothing that a test could see.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.mutants import Mutant, chosen  # noqa: E402

FOLDERS = ("compiler", "bondgraph/simulation", "bondgraph/analysis")
# Tests of a room beside those in the folder of its name: machine code does not pass through Python's lines, and texts of stages belong to several rooms.
BESIDE = {
    "codegen": ("jit",),
    "syntax": ("semantics",),
    "graph": ("graphs", "semantics"),
    "jit": ("codegen",),
}
LIMIT, LIMIT_OF_ROOM = 600, 3600  # seconds for the tests that pass through a line, and for all of a room


def room_of(path: str) -> str:
    parts = Path(path).parts
    return parts[1] if len(parts) > 2 else parts[0]


def tests_of(root: Path, room: str) -> list[str]:
    named = [f"tests/{name}" for name in (room, *BESIDE.get(room, ()))]
    present = [folder for folder in named if (root / folder).is_dir()]
    return present or ["tests/semantics", "tests/codegen"]


def environment(copy: Path, machine_code: bool = False) -> dict[str, str]:
    """Interpreted steps unless machine code is wanted, so that coverage sees them and a mutant compiles nothing; the copy comes first."""
    interpreted = {} if machine_code else {"BONDGRAPH_WITHOUT_LLVM": "1"}
    return os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"} | interpreted


def pytest_in(copy: Path, arguments: list[str], seconds: float, machine_code: bool) -> int:
    """Exit status of a run of tests in the copy; 124 if it does not end in time."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-x", *arguments]
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment(copy, machine_code), capture_output=True, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return 124
    return done.returncode


def covered(copy: Path, room: str, folder: Path) -> dict[tuple[str, int], list[str]]:
    """Tests that pass through each line, from one run under `coverage`; made once for each room."""
    data = folder / f"coverage_{room}"
    if not data.exists():
        settings = folder / "coverage.ini"
        settings.write_text(
            f"[run]\ndynamic_context = test_function\nsource = {copy}/compiler,{copy}/bondgraph\n", encoding="utf-8"
        )
        command = [
            sys.executable,
            "-m",
            "coverage",
            "run",
            f"--rcfile={settings}",
            f"--data-file={data}",
            "-m",
            "pytest",
            "-p",
            "no:cacheprovider",
        ]
        subprocess.run(
            [*command, *tests_of(copy, room)], cwd=copy, env=environment(copy), capture_output=True, check=False
        )
    with sqlite3.connect(data) as book:
        files = dict(book.execute("select id, path from file"))
        contexts = dict(book.execute("select id, context from context"))
        rows = list(book.execute("select file_id, context_id, numbits from line_bits"))
    lines: dict[tuple[str, int], list[str]] = {}
    for file, context, bits in rows:
        name = str(Path(files[file]).relative_to(copy))
        for byte, value in enumerate(bits):
            for bit in range(8):
                if value >> bit & 1:
                    lines.setdefault((name, 8 * byte + bit), []).append(contexts[context])
    return lines


def selected(tests: list[str]) -> list[str]:
    """Arguments for pytest of the tests that `coverage` names as `tests.room.test_file.test_name`."""
    arguments = []
    for name in sorted(set(tests) - {""}):
        module, _, function = name.rpartition(".")
        arguments.append(f"{module.replace('.', '/')}.py::{function}")
    return arguments


def tried(copy: Path, mutant: Mutant, lines: dict[tuple[str, int], list[str]]) -> str:
    """`noticed`, `unnoticed`, `unreached` (unnoticed, and no test passes through the line interpreted), or `too long` for a sound room's tests."""
    reached = lines.get((mutant.path, mutant.line)) or lines.get((mutant.path, mutant.statement), [])
    # A line that runs while a module is imported belongs to every test.
    whole = not reached or "" in reached
    arguments = tests_of(copy, room_of(mutant.path)) if whole else selected(reached)
    path = copy / mutant.path
    source = path.read_text(encoding="utf-8")
    path.write_text(mutant.applied(source), encoding="utf-8")
    try:
        status = pytest_in(copy, arguments, LIMIT_OF_ROOM if whole else LIMIT, machine_code=not reached)
    finally:
        path.write_text(source, encoding="utf-8")
    if status == 124 and whole:
        return "too long"
    if status != 0:
        return "noticed"
    return "unnoticed" if reached else "unreached"


def report(folder: Path) -> None:
    """Print the shares of each room, and what nobody noticed."""
    entries = [json.loads(line) for line in (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()]
    judged = folder / "judged.txt"
    without_effect = (
        {line.split()[0] for line in judged.read_text(encoding="utf-8").splitlines()} if judged.exists() else set()
    )
    shares: dict[str, Counter[str]] = {}
    for number, entry in enumerate(entries):
        verdict = (
            "without effect" if f"#{number}" in without_effect and entry["verdict"] != "noticed" else entry["verdict"]
        )
        shares.setdefault(entry["room"], Counter())[verdict] += 1
        if verdict in ("unnoticed", "unreached"):
            print(f"#{number} {verdict}: {entry['change']}")
    total = sum(shares.values(), Counter())
    for room, counts in [*sorted(shares.items()), ("all", total)]:
        effective = counts["noticed"] + counts["unnoticed"] + counts["unreached"]
        print(
            f"{room}: {counts['noticed']} of {effective} with an effect noticed ({100 * counts['noticed'] / max(effective, 1):.0f} %); {dict(counts)}"
        )


def main() -> int:
    """Try a sample of mutants."""
    parser = argparse.ArgumentParser(prog="python tests/mutation", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="files whose path contains this")
    parser.add_argument("--counts", action="store_true", help="report the journal only")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the file of the mutant is restored
    folder: Path = arguments.folder.resolve()
    if arguments.counts:
        report(folder)
        return 0
    folder.mkdir(parents=True, exist_ok=True)
    copy, journal = folder / "copy", folder / "journal.jsonl"
    if not copy.exists():
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", "__pycache__", ".*_cache"))
    known = (
        {json.loads(line)["change"] for line in journal.read_text(encoding="utf-8").splitlines()}
        if journal.exists()
        else set()
    )
    by_room: dict[str, dict[tuple[str, int], list[str]]] = {}
    for mutant in chosen(copy, FOLDERS, arguments.number, arguments.seed):
        if str(mutant) in known or (arguments.only and arguments.only not in mutant.path):
            continue
        room = room_of(mutant.path)
        if room not in by_room:
            by_room[room] = covered(copy, room, folder)
        began = time.monotonic()
        verdict = tried(copy, mutant, by_room[room])
        entry = {"room": room, "change": str(mutant), "verdict": verdict, "seconds": round(time.monotonic() - began, 1)}
        with journal.open("a", encoding="utf-8") as book:
            book.write(json.dumps(entry) + "\n")
        print(f"{verdict}: {mutant}", flush=True)
    report(folder)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
