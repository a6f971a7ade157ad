"""Study requests: the computation at each point of a study, and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.modes import moving_frequencies
from ..analysis.operating_point import Asked, operating_point
from ..analysis.outcome import MODES, Point
from ..door import Analysis, CompilationFailed, Differentiating, Study, Varying
from ..errors import RunFailed
from ..simulation.run import Wanted, simulate
from ..simulation.settings import compiled_in
from .sharing import Sharing
from .steps import differentiated, made_of, varied
from .wrong import kept

if TYPE_CHECKING:
    from ..analysed_model import AnalysedModel

STEPS = ("equilibrium", "modes", "simulate")
Settings = Mapping[str, str | float]


@dataclass(frozen=True, slots=True)
class Failed:
    """Reason why a point has no result."""

    why: str


def why(problem: Exception) -> str:
    """Return an error as one line."""
    if isinstance(problem, CompilationFailed):
        return "; ".join(f"{d.code} {d.sentence}" for d in problem.diagnostics) or "the model does not compile"
    return str(problem)


def compilation_notes(
    model: AnalysedModel, experiment: str | None, settings: Settings, points: Sequence[Mapping[str, str | float]]
) -> tuple[str, ...]:
    """Return notes on names with several values that must be compiled in: each such point takes as long as the compiler."""
    varying = [n for n in (points[0] if points else ()) if len({p[n] for p in points}) > 1]
    if not varying:
        return ()
    why = compiled_in(model, experiment, {**settings, **points[0]}, varying)
    return tuple(
        f"`{name}` is compiled into the model anew at each of its {len({p[name] for p in points})} values: more than numbers go with it in {place}"
        for name, place in why.items()
    )


@dataclass(frozen=True, slots=True)
class Numbers:
    """Scalar study: numbers by name at each point, in SI and Hz.

    `of`: equilibrium (outputs at equilibrium), modes (frequencies), simulate (outputs at the end).
    """

    of: tuple[str, ...]
    experiment: str | None
    settings: tuple[tuple[str, str | float], ...]  # settings of the call
    outputs: tuple[str, ...] | None
    wanted: Wanted
    most: int = MODES  # most frequencies

    def answer(self, model: AnalysedModel, point: Mapping[str, str | float]) -> dict[str, float] | Failed:
        """Return the numbers at one point, or the reason of its failure."""
        try:
            return self._numbers(model, {**dict(self.settings), **point})
        except Exception as problem:
            return Failed(why(kept(problem)))

    def _numbers(self, model: AnalysedModel, settings: Settings) -> dict[str, float]:
        found: dict[str, float] = {}
        if "equilibrium" in self.of or "modes" in self.of:
            outputs = self.outputs if "equilibrium" in self.of else None
            at_rest = operating_point(model, Asked(self.experiment, settings, outputs))
            if "equilibrium" in self.of:
                found |= dict(zip(at_rest.program.outputs.names, map(float, at_rest.outputs), strict=True))
            if "modes" in self.of:
                frequencies = moving_frequencies(at_rest)[: self.most]
                found |= {f"frequency {i}": f for i, f in enumerate(frequencies, 1)}
        if "simulate" in self.of:
            run = simulate(model, self.experiment, settings, self.outputs, self.wanted)
            if run.warnings:
                raise RunFailed(f"the model does not hold there: {run.warnings[0]}")
            found |= {name: run.final(name) for name in run.names}
        bad = [name for name, value in found.items() if not np.isfinite(value)]
        if bad:
            raise RunFailed(f"`{bad[0]}` is no number there")
        return found


@dataclass(frozen=True, slots=True)
class Whole:
    """Experiment study: all results of an experiment or a sweep at a point, that is analyses and a run."""

    experiment: str | None
    settings: tuple[tuple[str, str | float], ...]
    studies: tuple[Analysis, ...]
    simulates: bool
    outputs: tuple[str, ...] | None
    wanted: Wanted

    def answer(self, model: AnalysedModel, point: Mapping[str, float]) -> Point | Exception:
        """Return the results at one point, or its exception, which is raised where the results are collected."""
        try:
            return self.made(model, point, Sharing(workers=1))
        except Exception as problem:
            return kept(problem)

    def made(self, model: AnalysedModel, point: Mapping[str, float], sharing: Sharing) -> Point:
        """Compute one point; `sharing`: the workers for the points of a Monte Carlo study in it."""
        settings = {**dict(self.settings), **point}
        studies = self._at(model, settings) if point else self.studies
        chance = next((s for s in studies if isinstance(s, Varying)), None)
        of = tuple(dict.fromkeys(s.role for s in studies if s.role in STEPS)) + ("simulate",) * self.simulates
        if chance is not None:  # Monte Carlo evaluates all other steps
            found = varied(model, chance, of, self.experiment, settings, self.outputs, self.wanted, sharing)
            return Point(point, analyses=((chance.role, found),))
        return self._point(model, Point(point), studies, of, settings)

    def _at(self, model: AnalysedModel, settings: Settings) -> tuple[Analysis, ...]:
        """Return the steps, whose numbers may depend on swept values."""
        if all(isinstance(s, Study) for s in self.studies):
            return self.studies
        return model.compilation(model.scene(self.experiment, settings, outputs=self.outputs)).plan.studies

    def _point(
        self, model: AnalysedModel, found: Point, studies: Sequence[Analysis], of: tuple[str, ...], settings: Settings
    ) -> Point:
        for study in studies:
            match study:
                case Study(role="equilibrium"):
                    found = replace(found, equilibrium=model.equilibrium(self.experiment, settings, self.outputs))
                case Study(role="modes"):
                    found = replace(found, modes=model.modes(self.experiment, settings))
                case Study():
                    made = model.response(
                        study.given, study.seen, study.low, study.high, study.points, self.experiment, settings
                    )  # fmt: skip
                    found = replace(found, responses=(*found.responses, made))
                case Differentiating():
                    some = differentiated(
                        model, study, of, studies, self.experiment, settings, self.outputs, self.wanted
                    )
                    found = replace(found, analyses=(*found.analyses, *some))
                case _:
                    one = made_of(model, study, self.experiment, settings, self.outputs)
                    found = replace(found, analyses=(*found.analyses, (study.role, one)))
        if self.simulates:
            found = replace(found, run=simulate(model, self.experiment, settings, self.outputs, self.wanted))
        return found
