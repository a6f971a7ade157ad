"""Many runs of one model. What is set are arguments of one program, so it is compiled once; machine code runs outside of the interpreter's lock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..ensembles import Ensemble
from ..results import Result
from ..simulation.run import Wanted, check_wanted, simulate
from .sharing import WRONG, Sharing, answers

if TYPE_CHECKING:
    from ..model import Model


@dataclass(frozen=True, slots=True)
class Run:
    """A run at each point, which is its settings."""

    experiment: str | None
    outputs: tuple[str, ...] | None
    wanted: Wanted

    def answer(self, model: Model, point: Mapping[str, str | float]) -> Result | Exception:
        """What goes wrong in a run stays with it."""
        try:
            return simulate(model, self.experiment, point, self.outputs, self.wanted)
        except WRONG as problem:
            return problem


def simulate_many(
    model: Model, experiment: str | None, settings: Sequence[Mapping[str, str | float]], outputs: tuple[str, ...] | None, wanted: Wanted,
    sharing: Sharing,
) -> Ensemble:  # fmt: skip
    """Run a model with each of several settings. Raises `UsageError` for what is wrong in all."""
    check_wanted(wanted)
    points = tuple(dict(s) for s in settings)
    return Ensemble(points, tuple(answers(model, Run(experiment, outputs, wanted), points, sharing)))
