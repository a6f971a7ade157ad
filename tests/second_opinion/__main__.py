"""`python tests/second_opinion [--networks N] [--mechanisms N] [--first SEED] [--workers W] [--seconds S] [--found FOLDER]`: random models by the thousand.

Each is run by the product and by the second opinion. Counts are printed every minute, disagreements at once and, made smaller, into a folder.
Refusals by the product of what the second opinion could run are listed. Ends with 1 if anything disagreed.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))


def main() -> int:
    """Run the campaign."""
    from tests.second_opinion.trial import KINDS, Tally, smallest, tried

    parser = argparse.ArgumentParser(prog="python tests/second_opinion", description=__doc__)
    parser.add_argument("--networks", type=int, default=1000)
    parser.add_argument("--mechanisms", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--seconds", type=int, default=20, help="at most, for one model")
    parser.add_argument("--found", type=Path, default=None, help="a folder for what disagrees")
    given = parser.parse_args()
    jobs = [("network", given.first + i, given.seconds) for i in range(given.networks)]
    jobs += [("mechanism", given.first + i, given.seconds) for i in range(given.mechanisms)]
    tried(("network", 1, None))  # what is compiled once for this machine takes long
    tally, began, last = Tally(), time.monotonic(), time.monotonic()
    with ProcessPoolExecutor(given.workers) as pool:
        for number, (kind, seed, verdict) in enumerate(pool.map(tried, jobs, chunksize=4), 1):
            tally.add(kind, seed, verdict)
            if verdict.kind in ("disagreed", "refused"):
                print(f"{verdict.kind}: {kind} {seed}: {verdict.code} {verdict.words[:300]}", flush=True)
            if verdict.kind == "disagreed" and given.found is not None:
                given.found.mkdir(parents=True, exist_ok=True)
                example = smallest(KINDS[kind](seed), given.seconds)
                (given.found / f"{kind}_{seed}.bg").write_text(f"# {verdict.words}\n{example.text}", encoding="utf-8")
            if time.monotonic() - last > 60:
                last = time.monotonic()
                print(f"{number} models, {number / (last - began):.2f} each second\n{tally.told()}", flush=True)
    print(tally.told())
    return 1 if tally.disagreed else 0


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="bondgraph-opinions-") as kept:
        os.environ.setdefault("BONDGRAPH_CACHE", kept)
        code = main()
    sys.exit(code)
