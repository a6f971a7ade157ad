"""`python tests/second_opinion FOLDER [--networks N] [--mechanisms N] [--structured N] [--typed N] [--spatial N] [--first SEED] [--workers W] [--seconds S] [--counts] [--scales N]`: random models by the thousand.

Each is run by the product and by the second opinion. `FOLDER/journal.jsonl` has a line for each verdict: the same command goes on where it was ended, and
`--counts` only says what is there. What disagrees and what the product refuses alone is written as a model into the folder, made smaller. Ends with 1 if anything disagreed.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("BONDGRAPH_CACHE", "")  # nothing is kept: no model comes twice
TOGETHER = 8  # models in a row of one structure: a worker takes them together, so that it compiles once
SHARE = 10  # networks for each mechanism


def jobs(given: argparse.Namespace, known: set[tuple[str, int]]) -> Iterator[tuple[str, int, int]]:
    """Models without a verdict yet, mechanisms between networks."""
    first = given.first
    mechanisms = (("mechanism", s, given.seconds) for s in range(first, first + given.mechanisms))
    structured = (("structured", s, given.seconds) for s in range(first, first + given.structured))
    for number, seed in enumerate(range(first, first + given.networks), 1):
        yield from (j for j in [("network", seed, given.seconds)] if j[:2] not in known)
        if number % (SHARE * TOGETHER) == 0:
            yield from (j for j in itertools.islice(mechanisms, TOGETHER) if j[:2] not in known)
    typed = (("typed", s, given.seconds) for s in range(first, first + given.typed))
    spatial = (("spatial", s, given.seconds) for s in range(first, first + given.spatial))
    yield from (j for j in itertools.chain(mechanisms, structured, typed, spatial) if j[:2] not in known)


def in_other_units(numbers: range, seconds: int) -> int:
    """Run and analyse models at powers of ten of their units; print what differs."""
    from tests.second_opinion import scaled_analyses, scales

    tried = wrong = 0
    runs, analyses = (room.campaign(numbers, 100 * seconds) for room in (scales, scaled_analyses))
    for name, words in itertools.chain(runs, analyses):
        tried, wrong = tried + 1, wrong + bool(words)
        if words:
            print(f"{name}: {words}", flush=True)
    print(f"{tried} runs and analyses in other units, {wrong} of them differ")
    return 1 if wrong else 0


def main() -> int:
    """Run the campaign."""
    from tests.second_opinion.trial import KINDS, Entry, Tally, smallest, tried

    parser = argparse.ArgumentParser(prog="python tests/second_opinion", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--networks", type=int, default=100_000)
    parser.add_argument("--mechanisms", type=int, default=10_000)
    parser.add_argument("--structured", type=int, default=10_000, help="of multibonds, conditions and loops of signals")
    parser.add_argument("--typed", type=int, default=10_000, help="of planar and spatial multibonds, units and slots")
    parser.add_argument("--spatial", type=int, default=10_000, help="mechanisms in space")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=5, help="of the processor, at most, for one model")
    parser.add_argument(
        "--scales", type=int, default=0, help="only run and analyse as many of each kind, and all texts, in other units"
    )
    parser.add_argument("--counts", action="store_true", help="only say what the journal has")
    given = parser.parse_args()
    if given.scales:
        return in_other_units(range(given.first, given.first + given.scales), given.seconds)
    given.folder.mkdir(parents=True, exist_ok=True)
    journal, tally = given.folder / "journal.jsonl", Tally()
    for line in journal.read_text(encoding="utf-8").splitlines() if journal.exists() else ():
        tally.add(*json.loads(line))
    if given.counts:
        print(tally.told(True))
        return 1 if tally.disagreed else 0
    left = list(jobs(given, tally.seen))
    last = time.monotonic()
    began, number = last, 0
    with journal.open("a", encoding="utf-8") as book, ExitStack() as stack:
        found: Iterable[Entry] = map(tried, left)
        if given.workers > 1:  # none is forked: what waits for a compilation would wait for ever
            pool = stack.enter_context(multiprocessing.get_context("spawn").Pool(given.workers))
            found = pool.imap_unordered(tried, left, chunksize=TOGETHER)
        for number, entry in enumerate(found, 1):
            book.write(json.dumps(entry) + "\n")
            book.flush()
            tally.add(*entry)
            kind, seed, verdict, code, words, _ = entry
            if verdict in ("disagreed", "refused"):
                print(f"{verdict}: {kind} {seed}: {code} {words[:300]}", flush=True)
                example = KINDS[kind](seed)
                if verdict == "disagreed":
                    example = smallest(example, given.seconds)
                (given.folder / f"{verdict}_{kind}_{seed}.bg").write_text(
                    f"# {words} {example.structure or ''}\n{example.written(example.parameters)}", encoding="utf-8"
                )
            if time.monotonic() - last > 60:
                last = time.monotonic()
                print(f"{number} models, {number / (last - began):.2f} each second\n{tally.told()}", flush=True)
    print(tally.told(True))
    return 1 if tally.disagreed else 0


if __name__ == "__main__":
    sys.exit(main())
