"""Work and precision of the solvers on one experiment: run time against error, and the tolerance for a wanted error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..rendering import OfModel, Plotted, Summarised
from ..results.json_values import entries, head

SCHEMA = "bondgraph-benchmark/1"
HARDLY = 1.2  # ratio of times that is within their scatter
DISTINCT = 3.0  # smallest ratio of an error to the disagreement of the references from which on it is one


@dataclass(frozen=True, slots=True)
class WorkPoint:
    """Runs of one solver at one tolerance. `errors`: largest errors of the outputs relative to their magnitudes, `error`: the largest of these.

    `seconds`: median time of a repeated run: program, magnitudes and start are known; `failure`: reason why there is no error, or "".
    `peer`: another program's solver, whose `steps` are 0 if it does not report them.
    """

    solver: str
    rtol: float
    error: float = math.nan
    seconds: float = math.nan
    steps: int = 0
    evaluations: int = 0
    errors: Mapping[str, float] = field(default_factory=dict)
    failure: str = ""
    peer: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return {solver, peer, rtol, error, seconds, steps, evaluations, errors: {name: relative}, failure}; null: not finite, or none."""
        names = ("solver", "peer", "rtol", "error", "seconds", "steps", "evaluations", "errors")
        return {**entries(self, *names), "failure": self.failure or None}


@dataclass(frozen=True, slots=True, repr=False)
class WorkPrecision(OfModel, Summarised, Plotted):
    """Work and precision of all solvers that can run an experiment, each at tolerances from 1e-3 to 1e-12.

    `references`: the two solvers at their tightest tolerance beside whose first the errors are measured; `agreement`: the largest relative difference of
    the two (NaN if there is one alone). `refused`: reasons of solvers without runs. `error`: the wanted one.
    """

    references: tuple[str, ...]
    agreement: float
    points: tuple[WorkPoint, ...]
    refused: Mapping[str, str]
    error: float

    @property
    def solvers(self) -> tuple[str, ...]:
        """Solvers with runs, in order."""
        return tuple(dict.fromkeys(point.solver for point in self.points))

    @property
    def recommended(self) -> WorkPoint | None:
        """Of our own solvers' runs with at most the wanted error, the most accurate that takes hardly longer than the fastest.

        None if none has that error, or if the references cannot tell.
        """
        if DISTINCT * self.agreement > self.error:
            return None
        enough = [p for p in self.points if not p.peer and p.error <= self.error]
        fastest = min((p.seconds for p in enough), default=math.nan)
        return min((p for p in enough if p.seconds <= HARDLY * fastest), key=lambda p: p.error, default=None)

    @property
    def sentence(self) -> str:
        """The recommendation as a sentence."""
        if (best := self.recommended) is not None:
            return f"For an error of {self.error:g}: solver = {best.solver}, rtol = {best.rtol:g} (error {best.error:.1e}, {1e3 * best.seconds:.3g} ms)."
        if DISTINCT * self.agreement > self.error:
            return (
                f"For an error of {self.error:g} there is no recommendation: {' and '.join(self.references)} at their tightest tolerances "
                f"differ by {self.agreement:.1e}."
            )
        return f"No solver has an error of {self.error:g} at any of these tolerances."

    def to_json(self) -> dict[str, Any]:
        """Return {schema, model, experiment, references, agreement, error, recommended: {solver, rtol} or null, points: [as a point's], refused}."""
        best = None if self.recommended is None else entries(self.recommended, "solver", "rtol")
        told = entries(self, "references", "agreement", "error", "points", "refused")
        return {**head(SCHEMA, self), **told, "recommended": best}
