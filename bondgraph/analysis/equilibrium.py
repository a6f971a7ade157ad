"""Equilibrium of a model, and its stability."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from compiler.api import Reported

from ..errors import UsageError
from ..rendering import OfModel, Summarised
from ..results.json_values import entries, head, named, with_units
from .linear import held_note
from .operating_point import OperatingPoint
from .sampled import is_sampled, sampled_verdict
from .verdict import Verdict, verdict

SCHEMA = "bondgraph-equilibrium/1"


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(OfModel, Summarised):
    """States, unknowns of loops and outputs by name, in SI, with all rates zero at `time` (s).

    `verdict` has the largest real part of an eigenvalue (1/s) with a bound, and the eigenvalues that rounding hides. A coordinate without restoring
    force (the position of a free body) has a growth of zero and is not counted. `steady`: the rates of angles that rotate steadily, by name.
    """

    time: float
    states: Mapping[str, float]
    unknowns: Mapping[str, float]
    outputs: Mapping[str, float]
    units: Mapping[str, str]
    verdict: Verdict
    report: Sequence[Reported] = ()  # units in which the experiment shows outputs
    steady: Mapping[str, float] = field(default_factory=dict)
    note: str = ""  # of a model that time moves, and of a rest among many

    @property
    def growth(self) -> float:
        """Largest real part of a deciding eigenvalue, in 1/s."""
        return self.verdict.growth

    @property
    def stable(self) -> bool | None:
        """True if no eigenvalue grows; None if rounding hides that."""
        return self.verdict.stable

    def __getitem__(self, name: str) -> float:
        """Return an output, state or unknown by name. Raises KeyError."""
        for values in (self.outputs, self.states, self.unknowns):
            if name in values:
                return values[name]
        known = (*self.outputs, *self.states, *self.unknowns)
        raise KeyError(f"there is no `{name}` in the equilibrium of {self.model}; it has {', '.join(known)}")

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-equilibrium/1`.

        {schema, model, experiment, time, states, unknowns, outputs, growth, stable (null: not decided)}, and where there are some, `bound` of the growth,
        `undecided` eigenvalues, `undamped` ones, `steady` rates, and a `note` where time moves the model or many rests are alike.
        """
        parts = {word: with_units(getattr(self, word), self.units) for word in ("states", "unknowns", "outputs")}
        told = {
            **head(SCHEMA, self),
            **entries(self, "time", "growth", "stable", *(["note"] if self.note else [])),
            **parts,
        }
        told |= entries(self.verdict, "bound", "undecided") if self.verdict.undecided else {}
        told |= entries(self.verdict, "undamped") if self.verdict.undamped else {}
        if self.steady:
            told["steady"] = with_units(self.steady, dict.fromkeys(self.steady, "1/s"))
        return told


def equilibrium(point: OperatingPoint) -> Equilibrium:
    """Return the results for a point with all rates zero."""
    program, n = point.program, point.count
    outputs = named(program.outputs.names, point.outputs)
    return Equilibrium(
        program.name, point.made.plan.experiment, point.time, point.stored(point.state),
        named(program.unknowns.names, point.state[n:]), outputs, units_of(point), _verdict(point), point.made.plan.report, point.steady,
        "; ".join(filter(None, (held_note(point), *point.notes))),
    )  # fmt: skip


def _verdict(point: OperatingPoint) -> Verdict:
    if not is_sampled(point):
        return verdict(point)
    try:
        return sampled_verdict(point)
    except UsageError:  # samples with several periods
        return Verdict(math.nan, math.nan, None)


def units_of(point: OperatingPoint) -> dict[str, str]:
    """Return SI units by name."""
    program = point.program
    kinds = (program.states, program.unknowns, program.outputs, program.inputs, program.parameters)
    units = {n: u for kind in kinds for n, u in zip(kind.names, kind.units, strict=True)}
    return units | {n: f.unit for n, f in point.followers.items()}
