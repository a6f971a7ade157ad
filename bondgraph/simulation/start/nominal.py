"""How large each state is going to be, so that an absolute tolerance means the same for nanometres and megapascals.

What the author says counts; else the start and a coarse run of implicit Euler over the whole time (L-stable, so what is
fast only follows) tell the magnitude, with what a free motion from there would reach: the speed of something that is pushed
slowly is measured by the speed at which it would swing back. States of one unit support each other a little: a coordinate that
happens to stay at zero must not be held to round-off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...door import Program
from ...results import ToleranceDoubt
from ..closed.constraints import Constraints
from ..segments import Segment
from .ahead import trusted
from .chargeable import chargeable
from .coarse import SMALLEST_ANGLE, CoarseRun, Look, Looks, smallest_angles

ROUNDED = 1e-3  # of the smallest angle: what a projection on closing joints leaves
CAUTIOUS = 1e-6  # of what sources could charge in a run: the measure of a state of which nothing is known
SHARE = 1e-2  # of the largest state of the same unit in the same mechanism, at least
SLIGHT = 1e-4  # of the largest state of the same unit anywhere: a junction's charge beside that of a buffer's capacitor


@dataclass(frozen=True, slots=True)
class Magnitudes:
    """`values`, shape (n,), in SI; the time at which the coarse run gave up, if it did; the states that it then knew nothing
    of, which are measured by a small share of what could charge them."""

    values: Any
    stopped: float | None
    unknown: tuple[str, ...]

    @property
    def doubts(self) -> tuple[ToleranceDoubt, ...]:
        """The warning that a user should read, or none."""
        if self.stopped is None or not self.unknown:
            return ()
        names = ", ".join(f"`{n}`" for n in self.unknown[:6]) + ("…" if len(self.unknown) > 6 else "")
        text = (
            f"the magnitude of {names} is not known: the pilot run ended at t = {self.stopped:.6g} s; the absolute tolerance there begins at "
            f"rtol times {CAUTIOUS:g} of what the sources could charge in the whole run, and grows with what is reached; give `nominal`, or compare with "
            "a tolerance that is ten times tighter"
        )
        return (ToleranceDoubt(float(self.stopped), "", "tolerance", text, (), ""),)


def nominal_magnitudes(
    program: Program, mechanisms: Sequence[str], constants: Any, state: Any, inputs: Any, stretches: Sequence[Segment],
    choice: Looks | None = None, constraints: Constraints | None = None, largest: Any = 0.0,
) -> Magnitudes:  # fmt: skip
    """A positive magnitude for every state and unknown. `mechanisms`: their names; `choice` says where these states will be
    no longer the right ones; `largest` is what is known of them from elsewhere."""
    given = np.asarray(program.nominal(constants), dtype=float)
    peak = np.maximum(np.abs(state), largest)
    stopped = None
    if len(program.states.names):

        def look_along(way: Sequence[Segment]) -> Look:
            coarse = CoarseRun(program, constants, inputs, state, constraints, mechanisms)
            return Look(coarse.peak(way, choice), coarse.beginning, coarse.stopped)

        first = stretches[0]
        look = trusted(
            look_along, program, stretches, len(program.signals(first.start, inputs, constants, first.mode)) > 0
        )
        peak, stopped = np.maximum(peak, look.largest), look.stopped
    result = np.where(given > 0, given, peak)
    for (members, count), share in zip(_alike(program, tuple(mechanisms)), (SHARE, SLIGHT), strict=True):
        most = np.zeros(count)
        np.maximum.at(most, members, result)
        result = np.maximum(result, share * most[members])
    result = np.maximum(result, _smallest(program, mechanisms, constraints, state, stretches[0]))
    unknown = (result == 0) | ~np.isfinite(result)
    if unknown.any():
        charged = chargeable(program, constants, inputs, state, stretches, np.where(unknown, 0.0, result))
        result[unknown] = (1.0 if stopped is None else CAUTIOUS) * charged[unknown]
    names = (*program.states.names, *program.unknowns.names)
    return Magnitudes(result, stopped, () if stopped is None else tuple(names[i] for i in np.flatnonzero(unknown)))


def _alike(program: Program, mechanisms: tuple[str, ...]) -> list[tuple[Any, int]]:
    """The number of the group that each state and unknown belongs to, and how many groups there are: those of one mechanism and unit, those of one unit."""
    key = "alike", mechanisms
    if key not in program.kept:
        units = (*program.states.units, *program.unknowns.units)
        names = (*program.states.names, *program.unknowns.names)
        owners = [next((m for m in mechanisms if n.startswith(f"{m}.")), n) for n in names]
        program.kept[key] = [_numbered(list(zip(units, owners, strict=True))), _numbered(list(units))]
    return cast("list[tuple[Any, int]]", program.kept[key])


def _numbered(groups: Sequence[object]) -> tuple[Any, int]:
    """The number of each group, in the order in which they turn up, and how many there are."""
    numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
    return np.array([numbers[group] for group in groups], dtype=int), len(numbers)


def _smallest(
    program: Program, mechanisms: Sequence[str], constraints: Constraints | None, state: Any, first: Segment
) -> Any:
    """Below lies what symmetry leaves of an angle, or of a length of a mechanism with closed loops: rounding."""
    result = smallest_angles(program, mechanisms)
    if constraints:
        units = np.array([*program.states.units, *program.unknowns.units])
        result = result.copy()
        places = np.concatenate([constraints.positions, constraints.speeds])
        length = constraints.length(first.start, state, first.mode)
        result[places] = np.where(np.isin(units[places], ["m", "m/s"]), SMALLEST_ANGLE * length, result[places])
    return result


def least_tolerances(
    program: Program, mechanisms: Sequence[str], constraints: Constraints, state: Any, first: Segment
) -> Any:
    """What no absolute tolerance can be less than, as closing joints hold positions and speeds up to rounding; 0 for other states.

    What such joints lock altogether stays where it is up to that, however small a share of its magnitude a tolerance may be.
    """
    result, places = np.zeros(len(state)), np.concatenate([constraints.positions, constraints.speeds])
    result[places] = ROUNDED * _smallest(program, mechanisms, constraints, state, first)[places]
    return result
