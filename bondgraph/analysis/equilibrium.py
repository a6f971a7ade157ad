"""Where a model is at rest, and whether it stays there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .linear import linearization
from .operating_point import OperatingPoint
from .spectrum import spectrum
from .told import named, with_units

if TYPE_CHECKING:
    from ..results import Reporting

SCHEMA = "bondgraph-equilibrium/1"
ROUNDING = 1e-9  # of the fastest mode: a growth below it is none
NEVER = 1e-12  # 1/s: nor is one that takes thirty thousand years


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """States, unknowns of loops and outputs by name, in SI, where all rates vanish at `time` (s).

    `growth` is the largest real part of an eigenvalue, in 1/s; `stable` whether it is not above rounding. What nothing brings back
    (the position of a free body) has a growth of zero and counts as stable.
    """

    model: str
    experiment: str | None
    time: float
    states: Mapping[str, float]
    unknowns: Mapping[str, float]
    outputs: Mapping[str, float]
    units: Mapping[str, str]
    growth: float
    stable: bool
    report: Sequence[Reporting] = ()  # how the experiment shows outputs

    def __getitem__(self, name: str) -> float:
        """An output, state or unknown by name. Raises KeyError."""
        for values in (self.outputs, self.states, self.unknowns):
            if name in values:
                return values[name]
        known = (*self.outputs, *self.states, *self.unknowns)
        raise KeyError(f"there is no `{name}` in the equilibrium of {self.model}; it has {', '.join(known)}")

    def to_json(self) -> dict[str, Any]:
        """By the schema `bondgraph-equilibrium/1`: {schema, model, experiment, time, states, unknowns, outputs, growth, stable}."""
        parts = {word: with_units(getattr(self, word), self.units) for word in ("states", "unknowns", "outputs")}
        told = {"schema": SCHEMA, "model": self.model, "experiment": self.experiment, "time": self.time}
        return {**told, **parts, "growth": self.growth, "stable": self.stable}

    def summary(self) -> str:
        """A table for terminals."""
        from ..views.analyses import equilibrium_text

        return equilibrium_text(self)


def equilibrium(point: OperatingPoint) -> Equilibrium:
    """What is told of a point where all rates vanish."""
    program, n = point.program, point.count
    growth, stable = stability(point)
    outputs = named(program.outputs.names, point.outputs)
    return Equilibrium(
        program.name, point.made.plan.experiment, point.time, point.stored(point.state),
        named(program.unknowns.names, point.state[n:]), outputs, units_of(point), growth, stable, point.made.plan.report,
    )  # fmt: skip


def stability(point: OperatingPoint) -> tuple[float, bool]:
    """The largest real part of an eigenvalue (1/s), and whether that is no growth."""
    values = spectrum(linearization(point).A).values
    growth = float(values.real.max(initial=-np.inf)) if len(values) else -np.inf
    return growth, growth <= max(ROUNDING * float(np.abs(values).max(initial=0.0)), NEVER)


def units_of(point: OperatingPoint) -> dict[str, str]:
    """SI units by name."""
    program = point.program
    kinds = (program.states, program.unknowns, program.outputs, program.inputs, program.parameters)
    found = {n: u for kind in kinds for n, u in zip(kind.names, kind.units, strict=True)}
    return found | {n: f.unit for n, f in point.followers.items()}
