"""Branch of equilibria as a function of a parameter, through its folds: pull-in, snap-through, buckling.

Pseudo-arclength continuation (Keller, in: Applications of Bifurcation Theory, 1977): steps along the branch instead of along the parameter, in
scaled coordinates, each corrected by Newton's method with exact derivatives on the plane perpendicular to its tangent. At a fold the tangent
has no component along the parameter; there, and where an eigenvalue crosses the imaginary axis, the step is found by bracketing.
Conserved quantities (the charge of an isolated node) are constant along the branch. At a branch point another branch crosses: it is reported, and
followed on request.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, BoolArray, Reported

from ..errors import UsageError
from ..rendering import OfModel, Summarised, draw
from ..results.json_values import arrays_with_units, head, named, with_units
from .branch_line import BranchLine
from .branch_steps import BranchFollower, BranchPlace
from .operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "bondgraph-branch/1"


@dataclass(frozen=True, eq=False)
class Special:
    """Point at which a branch turns or changes stability.

    `kind`: "fold"; "branch" (a real eigenvalue crosses zero: another branch passes); "oscillation" (a pair crosses the imaginary axis); "jump" (the
    rates jump with the parameter alone; the values are those beyond it). States and outputs by name, in SI.
    """

    kind: str
    value: float
    states: Mapping[str, float]
    outputs: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Branch(OfModel, Summarised):
    """Equilibria along a branch: `values` (n,) of the parameter, `states` and `outputs` name -> (n,), `stable` and `unstable` (n,), all in SI."""

    parameter: str
    values: Array
    states: Mapping[str, Array]
    outputs: Mapping[str, Array]
    stable: BoolArray  # certainly stable
    unstable: BoolArray  # certainly unstable; neither, where rounding hides it
    special: tuple[Special, ...]
    units: Mapping[str, str]
    ended: str  # reason for the end of the branch
    others: tuple[Branch, ...] = ()  # branches through its branch points, if requested
    report: Sequence[Reported] = ()  # units in which the experiment shows outputs

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, name: str) -> Array:
        """Return the parameter, an output or a state along the branch. Raises KeyError."""
        if name == self.parameter:
            return self.values
        return self.outputs[name] if name in self.outputs else self.states[name]

    @property
    def folds(self) -> tuple[Special, ...]:
        """The special points that are folds."""
        return tuple(s for s in self.special if s.kind == "fold")

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-branch/1`.

        {schema, model, experiment, parameter: {name, unit, values}, outputs, states: {name: {unit, values}}, stable, special: [{kind, value, outputs,
        states}], ended}; `others` are the crossing branches, as such objects, if they were followed.
        """
        unit = self.units.get(self.parameter, "1")
        parameter = {"name": self.parameter, "unit": unit, "values": self.values.tolist()}
        entries = {**head(SCHEMA, self), "ended": self.ended, "parameter": parameter}
        entries |= {word: arrays_with_units(getattr(self, word), self.units) for word in ("outputs", "states")}
        special = [
            {"kind": s.kind, "value": s.value}
            | {word: with_units(getattr(s, word), self.units) for word in ("outputs", "states")}
            for s in self.special
        ]
        verdicts = [True if s else False if u else None for s, u in zip(self.stable, self.unstable, strict=True)]
        entries |= {"stable": verdicts, "special": special}
        return {**entries, "others": [b.to_json() for b in self.others]} if self.others else entries

    def plot(self, path: str | os.PathLike[str] | None = None, names: Sequence[str] = ()) -> Figure:
        """Plot outputs (or `names`) over the parameter, also into a .png, .svg or .pdf file. Raises as `Result.plot`."""
        return draw(self, path, "plot", names)


def follow(first: OperatingPoint, name: str, low: float, high: float, points: int, most: int, branches: bool = False) -> Branch:  # fmt: skip
    """Follow a branch from an equilibrium at `low` towards `high` in steps of about 1/`points` of the range, until the parameter leaves it.

    `branches`: also follow the branches through its branch points, in both directions.
    """
    if not points >= 2 or low == high:
        raise UsageError("BR201", "a branch goes from one value to another, in 2 steps or more")
    if first.lowered.events.counts:
        raise UsageError(
            "BR270", "a branch cannot pass the jumps of a law: `floor`, `ceil`, `mod`, `stairs` or `pwm` of states stands behind the rates;",
            "find rests at single values, with `equilibrium` and `sweep`",
        )  # fmt: skip
    first = first.one_sided()  # rests at kinks are followed, their stability is not decided
    follower = BranchFollower(first, name, low, high, points)
    towards = np.zeros(first.count + 1)
    towards[-1] = 1.0
    line = BranchLine(follower, low, high, points, most)
    special = line.go(follower.place(first, low, towards))
    branch = _told(first, name, line.places, special, line.ended)
    if not branches:
        return branch
    others = []
    for kind, place in special:
        for sign in (1.0, -1.0) if kind == "branch" else ():
            begun = follower.beside(place, sign)
            if begun is not None:
                other = BranchLine(follower, low, high, points, most)
                turns = other.go(begun)
                others.append(_told(first, name, [place, *other.places], turns, other.ended))
    return replace(branch, others=tuple(others))


def _told(
    first: OperatingPoint, name: str, places: Sequence[BranchPlace], special: Sequence[tuple[str, BranchPlace]], ended: str
) -> Branch:  # fmt: skip
    from .equilibrium import units_of

    program, n = first.program, first.count
    states = np.array([p.point.state[:n] for p in places]).T
    outputs = np.array([p.point.outputs for p in places]).T.reshape(len(program.outputs.names), len(places))

    def told(kind: str, place: BranchPlace) -> Special:
        point = place.point
        return Special(
            kind, place.value, named(program.states.names, point.state[:n]), named(program.outputs.names, point.outputs)
        )  # fmt: skip

    special_points = tuple(told(kind, place) for kind, place in special)
    stable = np.array([p.unstable() == 0 and p.decided for p in places])
    return Branch(
        program.name, first.made.plan.experiment, name, np.array([p.value for p in places]),
        dict(zip(program.states.names, states, strict=True)), dict(zip(program.outputs.names, outputs, strict=True)),
        stable, np.array([p.unstable() > 0 for p in places]), special_points, units_of(first), ended,
        report=first.made.plan.report,
    )  # fmt: skip
