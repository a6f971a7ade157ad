"""`python tests/mutation FOLDER [--number N] [--seed S] [--only ROOM] [--seconds S] [--again] [--counts]`: random changes of the code, and whether the tests of its room notice them.

`FOLDER/journal.jsonl` has a line for each try, so that the same command goes on where it was ended; `--again` tries again what nothing noticed, `--counts` only reports. A line that starts with `#`
and the number of a mutant in `FOLDER/judged.txt` says why that mutant changes nothing that a test could see.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import signal
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.mutants import Mutant, chosen  # noqa: E402
from tests.mutation.switches import install  # noqa: E402
from tests.mutation.trials import Outcomes, Passing, Trials, forked, noticed, processor  # noqa: E402

FOLDERS = ("compiler", "bondgraph/simulation", "bondgraph/analysis")
# Tests of a room beside those in the folder of its name: machine code does not pass through Python's lines, and texts of stages and messages belong to several rooms.
BESIDE = {
    "algebra": ("reduction",),
    "codegen": ("jit",),
    "semantics": ("errors",),
    "syntax": ("semantics", "errors"),
    "graph": ("graphs", "semantics"),
    "jit": ("codegen",),
    "metamorphosis": ("metamorphic",),
}
# What becomes machine code is tried interpreted: it need not be compiled again for each mutant.
COMPILED = ("bondgraph/simulation/integrators", "compiler/codegen/llvm/runtime.py")
# Imported once for all rooms.
LIBRARIES = ("numpy", "scipy.sparse.linalg", "scipy.linalg", "sympy", "networkx", "lark", "llvmlite.binding")


@dataclass(frozen=True, slots=True)
class Room:
    """Tests of a room, run as machine code or interpreted, and where their results are kept."""

    name: str
    interpreted: bool
    folder: Path

    @property
    def label(self) -> str:
        return f"{self.name}_interpreted" if self.interpreted else self.name

    @property
    def tests(self) -> list[str]:
        named = [ROOT / "tests" / name for name in (self.name, *BESIDE.get(self.name, ()))]
        return [str(folder) for folder in named if folder.is_dir()] or [
            f"{ROOT}/tests/semantics",
            f"{ROOT}/tests/codegen",
        ]

    def run(self, trials: Trials) -> int:
        """Run the room's tests in this process, which ends with it."""
        os.environ["BONDGRAPH_CACHE"] = ""
        if self.interpreted:
            os.environ["BONDGRAPH_WITHOUT_LLVM"] = "1"
        log = os.open(self.folder / f"{self.label}.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.chdir(ROOT)
        return pytest.main(["-p", "no:cacheprovider", *self.tests], plugins=[trials, trials.outcomes])


def room_of(mutant: Mutant, folder: Path) -> Room:
    parts = Path(mutant.path).parts
    name = parts[1] if len(parts) > 2 else parts[0]
    return Room(name, mutant.path.startswith(COMPILED), folder)


@dataclass(slots=True)
class Sample:
    """The mutants by their numbers, the journal of their verdicts, and how long each may be tried."""

    folder: Path
    mutants: dict[int, Mutant]
    seconds: float
    enough: int
    search: float

    @property
    def journal(self) -> Path:
        return self.folder / "journal.jsonl"

    @property
    def note(self) -> Path:
        """The test that a fork runs."""
        return self.folder / "running.txt"

    def verdicts(self) -> dict[int, dict[str, object]]:
        """The last verdict of each mutant."""
        lines = self.journal.read_text(encoding="utf-8").splitlines() if self.journal.exists() else []
        entries = [json.loads(line) for line in lines]
        return {e["number"]: e for e in entries if str(self.mutants.get(e["number"])) == e["change"]}

    def write(self, room: Room, number: int, verdict: str, by: str = "") -> None:
        mutant = self.mutants[number]
        entry = {"number": number, "room": room.name, "change": str(mutant), "verdict": verdict, "by": by}
        with self.journal.open("a", encoding="utf-8") as book:
            book.write(json.dumps(entry | {"seconds": round(processor(), 1)}) + "\n")

    def verdict_of(self, room: Room, number: int, status: int) -> None:
        """Write the verdict of a fork: 0 if no test noticed, else the test that runs is in the note."""
        by = self.note.read_text(encoding="utf-8") if self.note.exists() else ""
        self.write(room, number, "noticed" if status else "unnoticed", f"{by} {status}" if status else "")

    def loop(self, room: Room, numbers: Sequence[int], trials: Trials, items: Sequence[pytest.Item]) -> None:
        """Find the mutants that each test passes, then try each mutant by these tests."""
        programs = os.environ["BONDGRAPH_CACHE"] = str(self.folder / "programs")
        at_import = trials.installed.switch.passed & set(numbers)
        inside, began = [n for n in numbers if n not in at_import], processor()

        def enough(found: list[Passing]) -> bool:
            counts = Counter(n for entry in found if entry["sound"] for n in entry["mutants"])
            searched = processor() - began > self.search
            return searched or (all(counts[n] >= self.enough for n in inside) and len(found) >= self.enough)

        modules = {Path(self.mutants[n].path).stem for n in inside}
        found = trials.passing(items, self.folder / f"passing{'_interpreted' * room.interpreted}.json", modules, enough)
        sound = {entry["test"]: entry["seconds"] for entry in found if entry["sound"]}
        alone: set[str] = set()  # tests that pass alone
        (self.folder / f"import_{room.label}.json").write_text(json.dumps([sorted(at_import), sound]), encoding="utf-8")
        for number in inside:
            passing = {e["test"] for e in found if number in e["mutants"]} & sound.keys()
            if not passing:
                self.write(room, number, "unreached")
                continue
            trials.installed.act(number)
            if self.mutants[number].path.startswith(("compiler", *COMPILED)):
                os.environ["BONDGRAPH_CACHE"] = ""  # programs of a changed compiler or integrator are kept nowhere
            own = [item for item in items if item.nodeid in passing]
            while status := self.status_of(own, sound, trials):
                by = self.note.read_text(encoding="utf-8")
                if by in alone:
                    break
                trials.installed.act(None)  # a test that fails without the others of its file proves nothing
                if not self.status_of([item for item in own if item.nodeid == by], sound, trials):
                    alone.add(by)
                    self.note.write_text(by, encoding="utf-8")
                    break
                own = [item for item in own if item.nodeid != by]
                trials.installed.act(number)
            trials.installed.act(None)
            os.environ["BONDGRAPH_CACHE"] = programs
            self.verdict_of(room, number, status)
        os._exit(0)

    def status_of(self, items: Sequence[pytest.Item], sound: dict[str, float], trials: Trials) -> int:
        """Exit status of a fork that runs tests until one fails: 0 if none does."""
        self.note.unlink(missing_ok=True)
        return forked(lambda: noticed(items, sound, trials.outcomes, self.seconds, self.note))

    def try_room(self, room: Room, numbers: Sequence[int]) -> None:
        """Try the mutants of a room; those that act while a module is imported each in a process of its own."""

        def warm() -> None:
            installed = install(ROOT, self.mutants)
            room.run(Trials(installed, lambda trials, items: self.loop(room, numbers, trials, items), Outcomes()))

        forked(warm, wall=math.inf)
        at_import, sound = json.loads((self.folder / f"import_{room.label}.json").read_text(encoding="utf-8"))
        for number in set(at_import) & set(numbers):

            def fresh(number: int = number) -> None:
                installed = install(ROOT, self.mutants)
                installed.act(number)

                def loop(trials: Trials, items: Sequence[pytest.Item]) -> None:
                    own = [item for item in items if item.nodeid in sound]
                    noticed(own, sound, trials.outcomes, self.seconds, self.note)

                room.run(Trials(installed, loop, Outcomes()))

            self.note.unlink(missing_ok=True)
            self.verdict_of(room, number, forked(fresh))

    def try_all(self, only: str, again: bool) -> None:
        """Try the mutants without a verdict, those of compiled functions first: what no test passes interpreted is tried as machine code."""
        known = self.verdicts()
        rooms: dict[Room, list[int]] = {}
        for number, mutant in self.mutants.items():
            open_yet = number not in known or (again and known[number]["verdict"] != "noticed")
            if open_yet and only in mutant.path:
                rooms.setdefault(room_of(mutant, self.folder), []).append(number)
        for room, numbers in [pair for pair in rooms.items() if pair[0].interpreted]:
            self.try_room(room, numbers)
            unreached = [n for n in numbers if self.verdicts()[n]["verdict"] == "unreached"]
            rooms.setdefault(replace(room, interpreted=False), []).extend(unreached)
        for room, numbers in rooms.items():
            if numbers and not room.interpreted:
                self.try_room(room, numbers)


def report(sample: Sample) -> None:
    """Print the shares of each room, and what nobody noticed."""
    judged = sample.folder / "judged.txt"
    reasons = judged.read_text(encoding="utf-8").splitlines() if judged.exists() else []
    without_effect = {line.split()[0] for line in reasons if line}
    shares: dict[str, Counter[str]] = {}
    for number, entry in sorted(sample.verdicts().items()):
        verdict = str(entry["verdict"])
        if f"#{number}" in without_effect and verdict != "noticed":
            verdict = "without effect"
        shares.setdefault(str(entry["room"]), Counter())[verdict] += 1
        if verdict in ("unnoticed", "unreached"):
            print(f"#{number} {verdict}: {entry['change']}")
    total = sum(shares.values(), Counter())
    for room, counts in [*sorted(shares.items()), ("all", total)]:
        effective = counts["noticed"] + counts["unnoticed"] + counts["unreached"]
        share = 100 * counts["noticed"] / max(effective, 1)
        print(f"{room}: {counts['noticed']} of {effective} with an effect noticed ({share:.0f} %); {dict(counts)}")


def main() -> int:
    """Try a sample of mutants."""
    parser = argparse.ArgumentParser(prog="python tests/mutation", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="files whose path contains this")
    parser.add_argument("--seconds", type=float, default=60, help="processor time for the tests of a mutant")
    parser.add_argument("--enough", type=int, default=1000, help="tests to look for that pass each mutant")
    parser.add_argument("--search", type=float, default=1e9, help="processor time of a room to look for them")
    parser.add_argument("--again", action="store_true", help="try again what nothing noticed")
    parser.add_argument("--counts", action="store_true", help="report the journal only")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    folder: Path = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    mutants = dict(enumerate(chosen(ROOT, FOLDERS, arguments.number, arguments.seed)))
    sample = Sample(folder, mutants, arguments.seconds, arguments.enough, arguments.search)
    if not arguments.counts:
        for library in LIBRARIES:
            importlib.import_module(library)
        sample.try_all(arguments.only, arguments.again)
    report(sample)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
