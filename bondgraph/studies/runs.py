"""Many runs of one model. Settings are arguments of one program, so it is compiled once; machine code runs outside the interpreter's lock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..results.ensemble import Ensemble
from ..results.result import Result
from ..simulation.repetition import simulate
from ..simulation.run import RunOptions, check_run_options
from .point_failure import check_some_stand
from .workers import Workers, answers

if TYPE_CHECKING:
    from ..analysed_model import AnalysedModel


@dataclass(frozen=True, slots=True)
class RunStudy:
    """Run at each point; a point is a mapping of settings."""

    experiment: str | None
    outputs: tuple[str, ...] | None
    wanted: RunOptions

    def answer(self, model: AnalysedModel, point: Mapping[str, str | float]) -> Result:
        """Return the result of a run."""
        return simulate(model, self.experiment, point, self.outputs, self.wanted)


def simulate_many(
    model: AnalysedModel, experiment: str | None, settings: Sequence[Mapping[str, str | float]], outputs: tuple[str, ...] | None, wanted: RunOptions,
    workers: Workers,
) -> Ensemble:  # fmt: skip
    """Run a model with each of several settings. Raises `UsageError` for an error common to all, `RunBroken` for a defect in all."""
    check_run_options(wanted)
    points = tuple(dict(s) for s in settings)
    found = answers(model, RunStudy(experiment, outputs, wanted), points, workers)
    check_some_stand(found)
    return Ensemble(points, tuple(found))
