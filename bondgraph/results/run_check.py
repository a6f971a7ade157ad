"""Comparison of a run with its repetition: by another method, and if the tolerance covers the differences; more tightly, as an estimate of the error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..quantities import behind
from .json_values import entries, finite

# in units of rtol: difference relative to an output's magnitude that a tolerance covers, as step errors add up
FACTOR = 30
ROUNDING = 1e-9  # of the largest magnitude of the same unit: an output that stays below may be the rounding of others


@dataclass(frozen=True, slots=True)
class OutputDifference:
    """Largest difference of an output between two runs, and its magnitude in the second, in SI; `promised` is the difference that the tolerance covers."""

    name: str
    unit: str
    difference: float
    magnitude: float
    promised: float

    @property
    def share(self) -> float:
        """Difference relative to the magnitude."""
        return self.difference / self.magnitude if self.magnitude else (0.0 if not self.difference else math.inf)

    @property
    def holds(self) -> bool:
        """True if the tolerance covers the difference."""
        return self.difference <= self.promised  # False for NaN


@dataclass(frozen=True, slots=True)
class RunCheck:
    """Comparison of a run with its repetition by `solver` at `rtol`, restarted in `parts` parts, so that events are searched more finely.

    `events`: numbers of events in the run and in the repetition; `shift`: largest difference of their instants in s (NaN if the numbers differ), of which
    `allowed` is covered. `failure`: reason why there is no repetition, or "".
    """

    solver: str
    rtol: float
    parts: int
    outputs: tuple[OutputDifference, ...]
    events: tuple[int, int]
    shift: float
    allowed: float
    failure: str = ""

    @property
    def holds(self) -> bool:
        """True if the tolerance covers all differences."""
        if self.failure or self.events[0] != self.events[1] or self.shift > self.allowed:
            return False
        return all(row.holds for row in self.outputs)

    @property
    def sentence(self) -> str:
        """Conclusion as a sentence."""
        if self.failure:
            return f"The check does not hold: the run could not be repeated: {self.failure}"
        if self.events[0] != self.events[1]:
            return f"The check does not hold: {self.events[0]} events acted in the run and {self.events[1]} in its repetition."
        wrong = [row for row in self.outputs if not row.holds]
        if wrong:
            worst = max(wrong, key=lambda row: row.share if math.isfinite(row.share) else math.inf)
            return (
                f"The check does not hold: `{worst.name}` differs by {worst.difference:.3g}{behind(worst.unit)}, {worst.share:.2g} of its magnitude; "
                f"the tolerance covers {worst.promised:.3g}{behind(worst.unit)}."
            )
        if self.shift > self.allowed:
            return f"The check does not hold: an event acted {self.shift:.3g} s earlier or later; the tolerance covers {self.allowed:.3g} s."
        return "The check holds: the tolerance covers all differences."

    def to_json(self) -> dict[str, Any]:
        """Return {holds, sentence, solver, rtol, parts, outputs: {name: {unit, difference, magnitude, covered, holds}}, events, shift}; null: not finite."""
        return {
            **entries(self, "holds", "sentence", "solver", "rtol", "parts", "events", "shift"),
            "outputs": {
                r.name: entries(r, "unit", "difference", "magnitude", "holds") | {"covered": finite(r.promised)}
                for r in self.outputs
            },
        }


@dataclass(frozen=True, slots=True)
class ErrorEstimate:
    """Estimate of the global error of each output: its largest difference to a repetition with the tolerance `rtol`, a tenth.

    The error of a run falls in proportion to its tolerance or faster, so the difference is nine tenths of it or more. `failure`: reason
    why there is no estimate, or "".
    """

    rtol: float
    outputs: tuple[OutputDifference, ...]
    failure: str = ""

    @property
    def worst(self) -> OutputDifference | None:
        """The output with the largest relative error, of those that are more than the rounding of others of their unit."""
        largest: dict[str, float] = {}
        for row in self.outputs:
            largest[row.unit] = max(largest.get(row.unit, 0.0), row.magnitude)
        counted = (r for r in self.outputs if not r.magnitude < ROUNDING * largest[r.unit])
        return max(counted, key=lambda r: math.inf if math.isnan(r.share) else r.share, default=None)

    def reaches(self, accuracy: float) -> bool:
        """Return True if no output has a larger relative error."""
        return not self.failure and (self.worst is None or self.worst.share <= accuracy)

    def of(self, name: str) -> float:
        """Return the estimated error of an output in SI; NaN if there is none."""
        return next((row.difference for row in self.outputs if row.name == name), math.nan)

    def to_json(self) -> dict[str, Any]:
        """Return {rtol of the repetition, outputs: {name: {unit, error, magnitude}}, failure}; null: not finite, or none."""
        rows = {r.name: entries(r, "unit", "magnitude") | {"error": finite(r.difference)} for r in self.outputs}
        return {"rtol": finite(self.rtol), "outputs": rows, "failure": self.failure or None}
