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

KINDS: dict[str, Callable[[int], Example]] = {"network": network, "mechanism": mechanism}
BUDGET = 6000  # iterations of Newton's method
POINTS = 4


@dataclass
class Tally:
    """Counts of verdicts and of the traits of what agreed; what is to be looked at."""

    verdicts: Counter[str] = field(default_factory=Counter)
    traits: Counter[str] = field(default_factory=Counter)
    disagreed: list[tuple[str, int, str]] = field(default_factory=list)
    refused: list[tuple[str, int, str]] = field(default_factory=list)  # by the product alone

    def add(self, kind: str, seed: int, verdict: Verdict) -> None:
        name = verdict.kind + (f" {verdict.code}" if verdict.code else "")
        self.verdicts[f"{kind}: {name}"] += 1
        if verdict.kind == "agreed":
            self.traits.update(KINDS[kind](seed).traits)
        elif verdict.kind == "disagreed":
            self.disagreed.append((kind, seed, verdict.words))
        elif verdict.kind == "refused":
            self.refused.append((kind, seed, verdict.words))

    def told(self) -> str:
        lines = [f"{n:7} {what}" for what, n in sorted(self.verdicts.items())]
        lines.append("traits of what agreed: " + ", ".join(f"{n} {t}" for t, n in self.traits.most_common()))
        return "\n".join(lines)


class TooLong(Exception):
    """The time of one model is over."""


@contextmanager
def limited(seconds: int | None) -> Any:
    """Raise `TooLong` after some seconds, in the main thread."""
    if seconds is None:
        yield
        return

    def over(*_: Any) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, over)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def verdict_on(example: Example, seconds: int | None = None) -> Verdict:
    """What the two say of one model. An error that neither of them words is a disagreement."""
    try:
        with limited(seconds):
            return compared(example.text, example.span, points=POINTS, goal=1e-5, most=128, budget=BUDGET)
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


def tried(job: tuple[str, int, int | None]) -> tuple[str, int, Verdict]:
    """One model by kind and seed; for worker processes."""
    kind, seed, seconds = job
    return kind, seed, verdict_on(KINDS[kind](seed), seconds)


def campaign(kind: str, seeds: Iterable[int]) -> Tally:
    """Many models, one after the other."""
    tally = Tally()
    for seed in seeds:
        tally.add(*tried((kind, seed, None)))
    return tally
