"""Result of a stress test: what was tried with a model, what held and what broke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..rendering import OfModel, Summarised
from ..results.json_values import entries, head

SCHEMA = "bondgraph-stress/1"


@dataclass(frozen=True, slots=True)
class StressBreak:
    """A change after which the results were others: its kind, which change it was, what differed, and the smallest files that show it."""

    kind: str
    change: str
    sentence: str
    files: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StressRow:
    """Changes of one kind: the number that was tried, that of those that broke, and reasons why others could not be tried."""

    kind: str
    changed: str
    tried: int
    broke: int
    untried: tuple[str, ...] = ()

    @property
    def held(self) -> int:
        """Number of changes after which the results were the same."""
        return self.tried - self.broke

    def to_json(self) -> dict[str, Any]:
        """Return {kind, changed, tried, held, broke, untried}."""
        return entries(self, "kind", "changed", "tried", "held", "broke", "untried")


@dataclass(frozen=True, slots=True, repr=False)
class StressTest(OfModel, Summarised):
    """Stress test of an experiment: a row for each kind of change, and the breaks.

    `error`: largest estimated error of an output of the unchanged run, relative to its magnitude (NaN: there is no estimate, for the reason `doubt`).
    `seconds` that it took.
    """

    rows: tuple[StressRow, ...]
    breaks: tuple[StressBreak, ...]
    error: float
    doubt: str
    seconds: float
    seed: int

    @property
    def holds(self) -> bool:
        """True if something was tried and nothing broke."""
        return not self.breaks and any(row.tried for row in self.rows)

    @property
    def sentence(self) -> str:
        """Conclusion as a sentence."""
        tried, kinds = sum(row.tried for row in self.rows), sum(row.tried > 0 for row in self.rows)
        if not tried:
            return "Nothing could be tried in this time: allow more."
        of_kinds = f"{tried} changes of {kinds} kinds were tried"
        if self.holds:
            return f"{of_kinds}: all held."
        return f"{of_kinds}: {tried - len(self.breaks)} held, {len(self.breaks)} broke."

    def to_json(self) -> dict[str, Any]:
        """Return {schema, model, experiment, holds, sentence, error, doubt, seconds, seed, rows, breaks}; null: not finite, or none."""
        told = entries(self, "holds", "sentence", "error", "seconds", "seed", "rows", "breaks")
        return {**head(SCHEMA, self), **told, "doubt": self.doubt or None}
