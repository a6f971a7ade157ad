"""Random models by their numbers, each run by the product and by the second opinion; a disagreement is made smaller."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from tests.second_opinion.comparison import Verdict, compared
from tests.second_opinion.random_models import Example, mechanism, network
from tests.second_opinion.spatial_models import spatial
from tests.second_opinion.structured_models import structured
from tests.second_opinion.typed_models import typed

KINDS: dict[str, Callable[[int], Example]] = {
    "network": network,
    "mechanism": mechanism,
    "structured": structured,
    "typed": typed,
    "spatial": spatial,
}
BUDGET = 2500  # iterations of Newton's method
POINTS = 4


Entry = tuple[str, int, str, str, str, tuple[str, ...]]  # kind, seed, verdict, code, words, traits


@dataclass
class Tally:
    """Counts of verdicts and of the traits of agreeing models; cases to examine."""

    verdicts: Counter[str] = field(default_factory=Counter)
    traits: Counter[str] = field(default_factory=Counter)
    disagreed: list[tuple[str, int, str]] = field(default_factory=list)
    refused: list[tuple[str, int, str]] = field(default_factory=list)  # by the product alone
    seen: set[tuple[str, int]] = field(default_factory=set)

    def add(self, kind: str, seed: int, verdict: str, code: str, words: str, traits: Iterable[str]) -> None:
        self.seen.add((kind, seed))
        self.verdicts[f"{kind}: {verdict}" + (f" {code}" if code else "")] += 1
        if verdict == "agreed":
            self.traits.update(traits)
        elif verdict in ("disagreed", "refused"):
            (self.disagreed if verdict == "disagreed" else self.refused).append((kind, seed, words))

    def told(self, all_of_it: bool = False) -> str:
        lines = [f"{n:7} {what}" for what, n in sorted(self.verdicts.items())]
        lines.append("traits of what agreed: " + ", ".join(f"{n} {t}" for t, n in self.traits.most_common()))
        if all_of_it:
            for what, cases in (("refused", self.refused), ("disagreed", self.disagreed)):
                lines += [f"{what}: {kind} {seed}: {words[:200]}" for kind, seed, words in cases]
        return "\n".join(lines)


class TooLong(Exception):
    """The time of one model is over."""


@contextmanager
def limited(seconds: int | None) -> Any:
    """Raise `TooLong` after some seconds of the processor, in the main thread."""
    if seconds is None:
        yield
        return

    def over(*_: Any) -> None:
        raise TooLong(TooLong.__name__)

    before = signal.signal(signal.SIGPROF, over)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def verdict_on(example: Example, seconds: int | None = None) -> Verdict:
    """Verdict of both on one model. An error without words of either is a disagreement."""
    try:
        with limited(seconds):
            return compared(
                example.text, example.span, points=POINTS, settings=example.settings, witness=example.witness, structure=example.structure,
                goal=1e-5, most=128, budget=BUDGET,
            )  # fmt: skip
    except TooLong:
        return Verdict("too long")
    except Exception as error:
        if TooLong.__name__ in str(error):  # in words, where a run tells what broke it off
            return Verdict("too long")
        return Verdict("disagreed", f"{type(error).__name__}: {error}")


def smallest(example: Example, seconds: int | None = None) -> Example:
    """The example without the parts that its disagreement does not need."""
    found = True
    while found:
        found = False
        for smaller in example.smaller():
            if verdict_on(smaller, seconds).kind == "disagreed":
                example, found = smaller, True
                break
    return example


def tried(job: tuple[str, int, int | None]) -> Entry:
    """One model by kind and seed; for worker processes."""
    kind, seed, seconds = job
    example = KINDS[kind](seed)
    verdict = verdict_on(example, seconds)
    traits = {*example.traits, *(["events that happened"] if verdict.events else [])}
    return kind, seed, verdict.kind, verdict.code, verdict.words, tuple(sorted(traits))


def campaign(kind: str, seeds: Iterable[int]) -> Tally:
    """Many models, one after the other."""
    tally = Tally()
    for seed in seeds:
        tally.add(*tried((kind, seed, None)))
    return tally
